//! What the host knows of a kernel.

use crate::{KernelSet, KernelStage, MATRIX_KERNELS, MatrixUnits, RENDER_KERNELS, SHARED, TRAIN_KERNELS, Variant};
use std::hash::{DefaultHasher, Hash, Hasher};

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

/// A compute kernel: a file under `wgsl/`, or a part of one, with the entry point `main`.
#[derive(Debug)]
pub struct Kernel {
    /// Name: that of the file, or one that begins with it.
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
        Variant::Plain.text(self.name, self.source, SHARED)
    }

    /// The same for devices whose subgroups all have this number of lanes: 8, 16 or 32. Kernels that have a form for such
    /// devices differ.
    pub fn wgsl_with_subgroups(&self, lanes: u32) -> String {
        Variant::Subgroups(lanes).text(self.name, self.source, SHARED)
    }

    /// The same for devices without immediate data, which is then a uniform at binding 0 of group 1.
    pub fn wgsl_with_uniform(&self) -> String {
        with_uniform(&self.wgsl())
    }

    /// Whether this is one of the [`MATRIX_KERNELS`](crate::MATRIX_KERNELS).
    pub fn needs_matrix_units(&self) -> bool {
        self.set == KernelSet::Matrix
    }

    /// The same of one of the [`MATRIX_KERNELS`](crate::MATRIX_KERNELS).
    pub fn wgsl_for(&self, units: MatrixUnits) -> String {
        Variant::Matrix(units).text(self.name, self.source, SHARED)
    }
}

/// A number that changes with the text of any kernel.
pub fn fingerprint() -> u64 {
    let mut hasher = DefaultHasher::new();
    let kernels = [RENDER_KERNELS, TRAIN_KERNELS, MATRIX_KERNELS].concat();
    kernels.iter().for_each(|kernel| kernel.source.hash(&mut hasher));
    SHARED.hash(&mut hasher);
    hasher.finish()
}

/// The text of a kernel with its immediate data as a uniform at binding 0 of group 1.
pub fn with_uniform(wgsl: &str) -> String {
    wgsl.replace("var<immediate>", "@group(1) @binding(0) var<uniform>")
}

/// The host's buffer, whatever its rows are.
pub trait UntypedBuffer {
    /// One whose rows are of type `T`.
    type Of<T>: ?Sized;

    /// The same buffer without the type.
    fn untyped<T>(buffer: &Self::Of<T>) -> &Self;
}

/// The buffers of one kernel by name; [`bindings`](crate::bindings) has a struct for each. `B` is the host's buffer. Each field
/// has the type of the rows that the kernel declares, so buffers of different rows cannot be exchanged:
///
/// ```
/// # use ibgs_shaders::{Bindings, UntypedBuffer, bindings::ShortestAxisBindings};
/// # use std::marker::PhantomData;
/// # struct Untyped(&'static str);
/// # struct Buffer<T>(Untyped, PhantomData<T>);
/// # impl UntypedBuffer for Untyped {
/// #     type Of<T> = Buffer<T>;
/// #     fn untyped<T>(buffer: &Buffer<T>) -> &Self { &buffer.0 }
/// # }
/// # fn buffer<T>(name: &'static str) -> Buffer<T> { Buffer(Untyped(name), PhantomData) }
/// let rotations: Buffer<[f32; 4]> = buffer("rotations");
/// let [log_scales, normals, plane_offsets]: [Buffer<f32>; 3] = ["scales", "normals", "offsets"].map(buffer);
/// let buffers: ShortestAxisBindings<Untyped> = ShortestAxisBindings {
///     log_scales: &log_scales,
///     rotations: &rotations,
///     normals: &normals,
///     plane_offsets: &plane_offsets,
/// };
/// assert_eq!(buffers.in_order().map(|buffer| buffer.0), ["rotations", "scales", "normals", "offsets"]);
/// ```
///
/// The same with two of them exchanged does not compile:
///
/// ```compile_fail,E0308
/// # use ibgs_shaders::{Bindings, UntypedBuffer, bindings::ShortestAxisBindings};
/// # use std::marker::PhantomData;
/// # struct Untyped(&'static str);
/// # struct Buffer<T>(Untyped, PhantomData<T>);
/// # impl UntypedBuffer for Untyped {
/// #     type Of<T> = Buffer<T>;
/// #     fn untyped<T>(buffer: &Buffer<T>) -> &Self { &buffer.0 }
/// # }
/// # fn buffer<T>(name: &'static str) -> Buffer<T> { Buffer(Untyped(name), PhantomData) }
/// let rotations: Buffer<[f32; 4]> = buffer("rotations");
/// let [log_scales, normals, plane_offsets]: [Buffer<f32>; 3] = ["scales", "normals", "offsets"].map(buffer);
/// let buffers: ShortestAxisBindings<Untyped> = ShortestAxisBindings {
///     log_scales: &rotations,
///     rotations: &log_scales,
///     normals: &normals,
///     plane_offsets: &plane_offsets,
/// };
/// ```
pub trait Bindings<'a, B: UntypedBuffer + 'a> {
    /// The kernel that they are for.
    const KERNEL: &'static Kernel;

    /// Its immediate data; `()`: it has none.
    type Params: bytemuck::Pod;

    /// An array as long as [`Kernel::bindings`].
    type InOrder: AsRef<[&'a B]> + IntoIterator<Item = &'a B>;

    /// The buffers in binding order.
    fn in_order(&self) -> Self::InOrder;
}
