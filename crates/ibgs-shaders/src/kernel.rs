//! What the host knows of a kernel.

use crate::{KernelSet, KernelStage, MatrixUnits, SHARED, Variant};

/// How a kernel uses a storage buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// `var<storage, read>`
    Read,
    /// `var<storage, read_write>`
    ReadWrite,
}

/// One storage binding of group 0; its index is its position in [`Kernel::bindings`].
#[derive(Clone, Copy, Debug)]
pub struct Binding {
    /// Variable name in the WGSL source.
    pub name: &'static str,
    /// Declared access.
    pub access: Access,
}

/// A compute kernel: one file under `wgsl/`, entry point `main`.
#[derive(Debug)]
pub struct Kernel {
    /// File name without extension.
    pub name: &'static str,
    /// Text of the file, imports not yet resolved.
    pub source: &'static str,
    /// Who needs it.
    pub set: KernelSet,
    /// The part of the work that it belongs to.
    pub stage: KernelStage,
    /// Storage bindings of group 0 in binding order.
    pub bindings: &'static [Binding],
    /// Workgroup size; of the [`MATRIX_KERNELS`](crate::MATRIX_KERNELS) that with subgroups of 32 lanes.
    pub workgroup: [u32; 3],
    /// Size in bytes of the immediate data (0: none).
    pub immediates: u32,
}

impl Kernel {
    /// The complete WGSL source: shared constants, imported files, the kernel.
    pub fn wgsl(&self) -> String {
        Variant::Plain.text(self.source, SHARED)
    }

    /// The same for devices whose subgroups all have this number of lanes: 8, 16 or 32. Kernels that have a form for such
    /// devices differ.
    pub fn wgsl_with_subgroups(&self, lanes: u32) -> String {
        Variant::Subgroups(lanes).text(self.source, SHARED)
    }

    /// The same for devices without immediate data, which is then a uniform at binding 0 of group 1.
    pub fn wgsl_with_uniform(&self) -> String {
        self.wgsl().replace("var<immediate>", "@group(1) @binding(0) var<uniform>")
    }

    /// Whether this is one of the [`MATRIX_KERNELS`](crate::MATRIX_KERNELS).
    pub fn needs_matrix_units(&self) -> bool {
        self.set == KernelSet::Matrix
    }

    /// The same of one of the [`MATRIX_KERNELS`](crate::MATRIX_KERNELS).
    pub fn wgsl_for(&self, units: MatrixUnits) -> String {
        Variant::Matrix(units).text(self.source, SHARED)
    }
}

/// The buffers of one kernel by name; [`bindings`](crate::bindings) has a struct for each. `B` is the host's buffer type.
pub trait Bindings<'a, B: ?Sized + 'a> {
    /// The kernel that they are for.
    const KERNEL: &'static Kernel;

    /// Its immediate data; `()`: it has none.
    type Params: bytemuck::Pod;

    /// An array as long as [`Kernel::bindings`].
    type InOrder: AsRef<[&'a B]> + IntoIterator<Item = &'a B>;

    /// The buffers in binding order.
    fn in_order(&self) -> Self::InOrder;
}
