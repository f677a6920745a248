//! Buffers of our own, and burn tensors seen as buffers.

use super::{Gpu, GpuError};
use burn::tensor::{DType, Shape, Tensor};
use burn_cubecl::tensor::CubeTensor;
use burn_wgpu::{AutoCompiler, CubeBackend};
use cubecl::wgpu::WgpuServer;
use std::sync::mpsc;

/// A storage buffer, or a part of one.
#[derive(Clone, Debug)]
pub struct Buffer {
    /// The wgpu buffer.
    pub buffer: wgpu::Buffer,
    /// First byte.
    pub offset: u64,
    /// Bytes.
    pub size: u64,
}

/// A burn tensor's memory, kept alive while a pass that uses it is recorded and submitted.
pub struct Bound {
    view: Buffer,
    _guard: Box<dyn Send>,
}

impl std::ops::Deref for Bound {
    type Target = Buffer;
    fn deref(&self) -> &Buffer {
        &self.view
    }
}

impl Gpu {
    /// A new storage buffer of `bytes`, contents zero.
    ///
    /// # Errors
    /// When the device cannot bind that much at once, or has no memory left.
    pub fn allocate(&self, what: &'static str, bytes: u64) -> Result<Buffer, GpuError> {
        self.check()?;
        self.check_size(what, bytes)?;
        let size = bytes.max(16).next_multiple_of(16);
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(what),
            size,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        match pollster::block_on(scope.pop()) {
            None => Ok(Buffer { buffer, offset: 0, size }),
            Some(_) => Err(GpuError::OutOfMemory { what, bytes: size }),
        }
    }

    /// Bytes that the device can bind at once.
    pub fn binding_limit(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// Whether the device can bind `bytes` at once.
    ///
    /// # Errors
    /// When it cannot.
    pub fn check_size(&self, what: &'static str, bytes: u64) -> Result<(), GpuError> {
        let limit = self.binding_limit();
        if bytes > limit { Err(GpuError::TooLarge { what, bytes, limit }) } else { Ok(()) }
    }

    /// A new storage buffer with the given contents.
    ///
    /// # Errors
    /// As [`Gpu::allocate`].
    pub fn upload<T: bytemuck::Pod>(&self, what: &'static str, data: &[T]) -> Result<Buffer, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.allocate(what, bytes.len() as u64)?;
        self.queue.write_buffer(&buffer.buffer, 0, bytes);
        Ok(buffer)
    }

    /// Reads `count` values from the start of a buffer; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn read<T: bytemuck::Pod>(&self, source: &Buffer, count: usize) -> Result<Vec<T>, GpuError> {
        let bytes = (count * size_of::<T>()) as u64;
        let staging = self.staging(bytes);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&source.buffer, source.offset, &staging, 0, bytes.next_multiple_of(4));
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            let _ = sender.send(result);
        });
        self.wait()?;
        let failed = |e: String| GpuError::Readback(e);
        self.answer(&receiver)?.map_err(|e| failed(e.to_string()))?;
        let mapped = staging.get_mapped_range(..).map_err(|e| failed(e.to_string()))?;
        let mut values = vec![T::zeroed(); count];
        bytemuck::cast_slice_mut::<T, u8>(&mut values).copy_from_slice(&mapped[..bytes as usize]);
        Ok(values)
    }

    /// As [`Gpu::read`], from the value numbered `first` on.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn read_at<T: bytemuck::Pod>(&self, source: &Buffer, first: usize, count: usize) -> Result<Vec<T>, GpuError> {
        let skipped = (first * size_of::<T>()) as u64;
        self.read(&Buffer { offset: source.offset + skipped, ..source.clone() }, count)
    }

    /// A buffer that the host can map for reading.
    pub(crate) fn staging(&self, bytes: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: bytes.max(4).next_multiple_of(4),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// The memory behind a float tensor primitive. Flushes burn's pending work, so that what we submit next follows it.
    pub fn bind(tensor: &CubeTensor) -> Bound {
        let client = &tensor.client;
        let guard =
            client.get_resource::<WgpuServer<AutoCompiler>>(tensor.handle.clone()).expect("a live tensor has memory");
        let resource = guard.resource();
        let view = Buffer { buffer: resource.buffer.clone(), offset: resource.offset, size: resource.size };
        Bound { view, _guard: Box::new(guard) }
    }

    /// An uninitialised float32 tensor; every value must be written before it is read. Its size must have passed
    /// [`Gpu::check_size`]: burn panics where memory cannot be had.
    pub fn empty_like_shape(&self, like: &CubeTensor, shape: &[usize]) -> CubeTensor {
        let values: usize = shape.iter().product();
        let handle = like.client.empty((values * size_of::<f32>()).max(16));
        CubeTensor::new_contiguous(
            like.client.clone(),
            like.device.clone(),
            Shape::from(shape.to_vec()),
            handle,
            DType::F32,
        )
    }
}

/// The contiguous primitive behind a float tensor outside autodiff.
///
/// # Panics
/// When the tensor lives on another backend: a bug of ours.
pub fn primitive<const D: usize>(tensor: Tensor<D>) -> CubeTensor {
    let cube = tensor.try_into_primitive::<CubeBackend>().expect("tensors live on the wgpu backend");
    burn_wgpu::into_contiguous(cube)
}

/// The tensor of a primitive.
pub fn from_primitive<const D: usize>(cube: CubeTensor) -> Tensor<D> {
    Tensor::from_primitive::<CubeBackend>(cube)
}
