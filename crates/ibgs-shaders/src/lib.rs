//! The WGSL compute kernels of ibgs and what the host must know of them: bindings with access, workgroup size,
//! immediate data, shared constants. Knows neither wgpu devices nor burn.
//!
//! The table of kernels, [`types`] and [`bindings`] are made from the WGSL by the build script.

#![forbid(unsafe_code)]

mod choices;
mod class;
mod constants;
mod import;
mod kernel;
pub mod layers;
mod variant;

pub use choices::{Aggregation, ConvInput, Output, Presented, Store};
pub use class::{KernelSet, KernelStage};
pub use constants::*;
pub use kernel::{Access, Binding, Bindings, Kernel, UntypedBuffer, fingerprint, with_uniform};
pub use variant::MatrixUnits;
use variant::Variant;

include!(concat!(env!("OUT_DIR"), "/shared.rs"));
include!(concat!(env!("OUT_DIR"), "/kernels.rs"));

/// The structs that travel to the kernels as immediate data, or that buffers are rows of.
pub mod types {
    use bytemuck::{Pod, Zeroable};

    /// A number in half precision, by its bits. The host moves such rows and computes with none of them.
    #[repr(transparent)]
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
    pub struct F16(pub u16);

    include!(concat!(env!("OUT_DIR"), "/types.rs"));
}

/// The buffers of each kernel by name, with the types of their rows, for [`Bindings`].
pub mod bindings {
    use crate::types::{self, F16};
    use crate::{Bindings, Kernel, UntypedBuffer};

    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}
