//! burn tensors as buffers of [`ibgs_core`], on the one wgpu device that both share.

use burn::tensor::wgpu::{MemoryConfiguration, WgpuSetup};
use burn::tensor::{DType, Device, Shape, Tensor};
use burn_cubecl::tensor::CubeTensor;
use burn_wgpu::{AutoCompiler, CubeBackend};
use cubecl::wgpu::WgpuServer;
use ibgs_core::gpu::{Buffer, Gpu, GpuError, flush};
use std::sync::{Mutex, PoisonError};

/// What burn keeps with the device.
struct BurnDevice {
    device: Device,
    /// Leads to burn's memory.
    seed: CubeTensor,
}

/// burn's name of the device (without autodiff); registers the device with burn when it is first asked for.
///
/// # Errors
/// burn refuses the device.
pub fn device(gpu: &Gpu) -> Result<&Device, GpuError> {
    Ok(&burn_device(gpu)?.device)
}

fn burn_device(gpu: &Gpu) -> Result<&BurnDevice, GpuError> {
    if let Some(attached) = gpu.attached() {
        return Ok(attached);
    }
    // Register only once: tensors of two registrations would not see each other's work.
    static REGISTERING: Mutex<()> = Mutex::new(());
    let _guard = REGISTERING.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(attached) = gpu.attached() {
        return Ok(attached);
    }
    let setup = WgpuSetup {
        instance: gpu.instance.clone(),
        adapter: gpu.adapter.clone(),
        device: gpu.device.clone(),
        queue: gpu.queue.clone(),
        backend: gpu.info.backend,
    };
    // Exclusive pages: every tensor is a wgpu buffer of its own, so that one dispatch may read one tensor and write another.
    let device = Device::wgpu_options()
        .setup(setup)
        .memory_config(MemoryConfiguration::ExclusivePages)
        .init()
        .map_err(|e| GpuError::Device { adapter: gpu.info.name.clone(), reason: e.to_string() })?;
    let seed = primitive(Tensor::<1>::empty([1], &device));
    // In place of burn's callbacks, of which the one for errors panics.
    gpu.watch();
    Ok(gpu.attach(BurnDevice { device, seed }))
}

/// Runs `task` on the thread that owns burn's memory: there a tensor is made and [bound](bind) at once, elsewhere each costs a
/// message to that thread and its answer.
///
/// # Errors
/// burn refuses the device.
///
/// # Panics
/// When the task does.
pub fn at_memory<R: Send + 'static>(gpu: &Gpu, task: impl FnOnce() -> R + Send) -> Result<R, GpuError> {
    Ok(burn_device(gpu)?.seed.client.exclusive(task).expect("the task does not panic"))
}

/// Gives memory back that burn and we keep for reuse.
pub fn release_unused(gpu: &Gpu) {
    gpu.release_unused();
    if let Some(BurnDevice { device, .. }) = gpu.attached() {
        device.memory_cleanup();
    }
}

/// A new float32 tensor; every value must be written before it is read.
///
/// # Errors
/// When the device cannot bind that much at once. burn panics where no memory is left.
pub fn empty(gpu: &Gpu, what: &'static str, shape: &[usize]) -> Result<CubeTensor, GpuError> {
    gpu.check_size(what, 4 * shape.iter().product::<usize>() as u64)?;
    Ok(empty_like(&burn_device(gpu)?.seed, shape))
}

/// A new float32 tensor beside another; every value must be written before it is read. Its size must have passed
/// [`Gpu::check_size`].
pub fn empty_like(like: &CubeTensor, shape: &[usize]) -> CubeTensor {
    let values: usize = shape.iter().product();
    let handle = like.client.empty((values * size_of::<f32>()).max(16));
    let (client, device) = (like.client.clone(), like.device.clone());
    CubeTensor::new_contiguous(client, device, Shape::from(shape.to_vec()), handle, DType::F32)
}

/// A new float32 tensor with values of the host.
///
/// # Errors
/// As [`empty`].
pub fn upload(gpu: &Gpu, what: &'static str, values: &[f32], shape: &[usize]) -> Result<CubeTensor, GpuError> {
    let tensor = empty(gpu, what, shape)?;
    gpu.write(&bind(&tensor), 0, values);
    Ok(tensor)
}

/// The memory behind a float tensor, which it keeps alive. Flushes burn's pending work, so that what we submit next follows it.
pub fn bind(tensor: &CubeTensor) -> Buffer<f32> {
    let client = &tensor.client;
    let guard =
        client.get_resource::<WgpuServer<AutoCompiler>>(tensor.handle.clone()).expect("a live tensor has memory");
    let resource = guard.resource();
    let (buffer, offset, size) = (resource.buffer.clone(), resource.offset, resource.size);
    // The buffer holds a clone of the tensor: burn computes in place if it believes that nobody else uses a tensor.
    Buffer::owned_by(buffer, offset, size, Mutex::new((tensor.clone(), guard)))
}

/// The same as rows of `N` values, of a tensor whose last dimension has as many.
///
/// # Panics
/// When it has not: a bug of ours.
pub fn bind_rows<const N: usize>(tensor: &CubeTensor) -> Buffer<[f32; N]> {
    assert_eq!(tensor.meta.shape()[..].last(), Some(&N), "last dimension of a tensor");
    bind(tensor).cast()
}

/// The contiguous primitive behind a float tensor outside autodiff.
///
/// # Panics
/// When the tensor lives on another backend: a bug of ours.
pub fn primitive<const D: usize>(tensor: Tensor<D>) -> CubeTensor {
    contiguous(tensor.try_into_primitive::<CubeBackend>().expect("tensors live on the wgpu backend"))
}

/// The same values without gaps.
pub fn contiguous(tensor: CubeTensor) -> CubeTensor {
    if !tensor.is_contiguous() {
        flush();
    }
    burn_wgpu::into_contiguous(tensor)
}

/// The tensor of a primitive.
pub fn from_primitive<const D: usize>(cube: CubeTensor) -> Tensor<D> {
    Tensor::from_primitive::<CubeBackend>(cube)
}

/// Values of a tensor.
#[cfg(test)]
pub fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.into_data().try_into_vec::<f32>().unwrap().into_iter().map(f64::from).collect()
}
