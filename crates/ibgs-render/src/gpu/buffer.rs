//! Storage buffers and what keeps their memory.

use super::launch::flush;
use super::{Gpu, GpuError};
use ibgs_shaders::UntypedBuffer;
use std::any::Any;
use std::fmt;
use std::future::poll_fn;
use std::marker::PhantomData;
use std::sync::{Arc, Mutex, Weak, mpsc};
use std::task::{Poll, Waker};

/// A storage buffer, or a part of one, whatever its rows are: what a kernel binds. Clones share the memory.
#[derive(Clone, Debug)]
pub struct RawBuffer {
    /// The wgpu buffer.
    pub buffer: wgpu::Buffer,
    /// First byte.
    pub offset: u64,
    /// Bytes.
    pub size: u64,
    /// Owner of the memory, such as a tensor of another library or a pool, which does not reuse the memory while this
    /// lives. None: the wgpu buffer is used by this one alone.
    _owner: Option<Arc<dyn Any + Send + Sync>>,
}

impl UntypedBuffer for RawBuffer {
    type Of<T> = Buffer<T>;

    fn untyped<T>(buffer: &Buffer<T>) -> &Self {
        &buffer.raw
    }
}

/// A [`RawBuffer`] whose rows are of type `T`, as kernels declare them. Clones share the memory.
pub struct Buffer<T> {
    raw: RawBuffer,
    rows: PhantomData<fn() -> T>,
}

impl<T> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        Self::of(self.raw.clone())
    }
}

impl<T> fmt::Debug for Buffer<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.raw.fmt(f)
    }
}

impl<T> Buffer<T> {
    fn of(raw: RawBuffer) -> Self {
        Self { raw, rows: PhantomData }
    }

    /// Memory that belongs to `owner`, as long as a clone of this lives.
    pub fn owned_by(buffer: wgpu::Buffer, offset: u64, size: u64, owner: impl Any + Send + Sync) -> Self {
        Self::of(RawBuffer { buffer, offset, size, _owner: Some(Arc::new(owner)) })
    }

    /// A whole wgpu buffer.
    pub fn whole(buffer: wgpu::Buffer) -> Self {
        let size = buffer.size();
        Self::of(RawBuffer { buffer, offset: 0, size, _owner: None })
    }

    /// `count` rows of it from row `first` on.
    pub fn part(&self, first: usize, count: usize) -> Self {
        let raw = self.raw.clone();
        Self::of(RawBuffer { offset: raw.offset + bytes::<T>(first), size: bytes::<T>(count), ..raw })
    }

    /// The same memory as rows of another type: for kernels that declare the same data in two forms, and for bits that are
    /// moved or looked at as what they are not. Nothing checks that the contents make sense so.
    pub fn cast<U>(&self) -> Buffer<U> {
        Buffer::of(self.raw.clone())
    }

    /// Whole rows that it holds: as many as were asked for, or some more.
    pub fn rows(&self) -> usize {
        (self.raw.size / size_of::<T>() as u64) as usize
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> u64 {
        self.raw.size
    }

    /// The buffer without the type of its rows.
    pub fn raw(&self) -> &RawBuffer {
        &self.raw
    }
}

/// Bytes of so many rows.
fn bytes<T>(rows: usize) -> u64 {
    rows as u64 * size_of::<T>() as u64
}

/// Memory that came back, by what it is for and its bytes; the oldest first.
#[derive(Debug, Default)]
pub(super) struct Transients(Mutex<Vec<(&'static str, wgpu::Buffer)>>);

/// Most buffers that wait to be used again.
const MOST_TRANSIENTS: usize = 16;

impl Transients {
    fn take(&self, what: &'static str, size: u64) -> Option<wgpu::Buffer> {
        let mut free = self.0.lock().expect("transient memory");
        let at = free.iter().position(|(kind, buffer)| *kind == what && buffer.size() == size)?;
        Some(free.remove(at).1)
    }

    fn give_back(&self, what: &'static str, buffer: wgpu::Buffer) {
        let mut free = self.0.lock().expect("transient memory");
        free.push((what, buffer));
        if free.len() > MOST_TRANSIENTS {
            free.remove(0);
        }
    }

    pub fn clear(&self) {
        self.0.lock().expect("transient memory").clear();
    }
}

/// A transient buffer in use.
struct InUse {
    what: &'static str,
    buffer: wgpu::Buffer,
    home: Weak<Transients>,
}

impl Drop for InUse {
    fn drop(&mut self) {
        if let Some(home) = self.home.upgrade() {
            home.give_back(self.what, self.buffer.clone());
        }
    }
}

/// Bytes of a buffer that holds at least `bytes`.
fn rounded(bytes: u64) -> u64 {
    bytes.max(16).next_multiple_of(16)
}

/// Refuses more bytes than a limit allows.
fn fits(what: &'static str, bytes: u64, limit: u64) -> Result<(), GpuError> {
    if bytes > limit { Err(GpuError::TooLarge { what, bytes, limit }) } else { Ok(()) }
}

impl Gpu {
    /// A new storage buffer of so many rows, contents zero.
    ///
    /// # Errors
    /// When the device cannot bind that much at once, or has no memory left.
    pub fn allocate<T>(&self, what: &'static str, rows: usize) -> Result<Buffer<T>, GpuError> {
        Ok(Buffer::whole(self.create(what, bytes::<T>(rows), self.binding_limit())?))
    }

    /// A new wgpu buffer of at least `bytes`, which may be as many as `limit`.
    fn create(&self, what: &'static str, bytes: u64, limit: u64) -> Result<wgpu::Buffer, GpuError> {
        self.check()?;
        fits(what, bytes, limit)?;
        let size = rounded(bytes);
        self.bind_groups.clear();
        let create = || {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(what),
                size,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        // A browser answers later; a full memory then reaches the next check.
        if cfg!(target_arch = "wasm32") {
            return Ok(create());
        }
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let buffer = create();
        match pollster::block_on(scope.pop()) {
            None => Ok(buffer),
            Some(_) => Err(GpuError::OutOfMemory { what, bytes: size }),
        }
    }

    /// Memory for one frame, which goes back to a pool with its last clone; contents undefined. Keep a clone until the work
    /// that uses it is submitted: the memory may become another frame's afterwards.
    ///
    /// # Errors
    /// As [`Gpu::allocate`].
    pub fn transient<T>(&self, what: &'static str, rows: usize) -> Result<Buffer<T>, GpuError> {
        let bytes = bytes::<T>(rows);
        let size = rounded(bytes);
        let buffer = match self.transients.take(what, size) {
            Some(buffer) => buffer,
            None => self.create(what, bytes, self.binding_limit())?,
        };
        let home = Arc::downgrade(&self.transients);
        Ok(Buffer::owned_by(buffer.clone(), 0, size, InUse { what, buffer, home }))
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
        fits(what, bytes, self.binding_limit())
    }

    /// A new storage buffer with the given contents.
    ///
    /// # Errors
    /// As [`Gpu::allocate`].
    pub fn upload<T: bytemuck::Pod>(&self, what: &'static str, rows: &[T]) -> Result<Buffer<T>, GpuError> {
        let buffer = self.allocate(what, rows.len())?;
        self.write(&buffer, 0, rows);
        Ok(buffer)
    }

    /// As [`Gpu::upload`], for what kernels bind in parts: it may be larger than what the device binds at once.
    ///
    /// # Errors
    /// When the device has no buffer of that size, or no memory left.
    pub fn upload_for_parts<T: bytemuck::Pod>(&self, what: &'static str, rows: &[T]) -> Result<Buffer<T>, GpuError> {
        let buffer = Buffer::whole(self.create(what, bytes::<T>(rows.len()), self.limits.max_buffer_size)?);
        self.write(&buffer, 0, rows);
        Ok(buffer)
    }

    /// Writes rows into a buffer, from row `first` on, before all work that is submitted later.
    pub fn write<T: bytemuck::Pod>(&self, target: &Buffer<T>, first: usize, rows: &[T]) {
        let RawBuffer { buffer, offset, .. } = target.raw();
        self.queue.write_buffer(buffer, offset + bytes::<T>(first), bytemuck::cast_slice(rows));
    }

    /// Reads `count` rows from the start of a buffer; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn read<T: bytemuck::Pod>(&self, source: &Buffer<T>, count: usize) -> Result<Vec<T>, GpuError> {
        self.map(&self.copied(&[source.raw()], bytes::<T>(count)), count)
    }

    fn map<T: bytemuck::Pod>(&self, staging: &wgpu::Buffer, count: usize) -> Result<Vec<T>, GpuError> {
        let (sender, receiver) = mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            let _ = sender.send(result);
        });
        self.wait()?;
        self.answer(&receiver)?.map_err(|e| GpuError::Readback(e.to_string()))?;
        values(staging, count)
    }

    /// As [`Gpu::read`], for browsers, which give a program the results only when it returns to them. Elsewhere it waits.
    ///
    /// # Errors
    /// When the device is lost.
    pub async fn read_async<T: bytemuck::Pod>(&self, source: &Buffer<T>, count: usize) -> Result<Vec<T>, GpuError> {
        self.map_async(self.copied(&[source.raw()], bytes::<T>(count)), count).await
    }

    /// The first word of each of some buffers, for which it waits once.
    ///
    /// # Errors
    /// When the device is lost.
    pub async fn read_firsts_async(&self, sources: &[&Buffer<u32>]) -> Result<Vec<u32>, GpuError> {
        let raw: Vec<_> = sources.iter().map(|source| source.raw()).collect();
        self.map_async(self.copied(&raw, bytes::<u32>(1)), sources.len()).await
    }

    async fn map_async<T: bytemuck::Pod>(&self, staging: wgpu::Buffer, count: usize) -> Result<Vec<T>, GpuError> {
        if cfg!(not(target_arch = "wasm32")) {
            return self.map(&staging, count);
        }
        let answer = Arc::new(Mutex::new((None, None::<Waker>)));
        let mapped = answer.clone();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            let (answer, waker) = &mut *mapped.lock().expect("answer");
            *answer = Some(result);
            if let Some(waker) = waker.take() {
                waker.wake();
            }
        });
        let result = poll_fn(|context| {
            let (answer, waker) = &mut *answer.lock().expect("answer");
            *waker = Some(context.waker().clone());
            answer.take().map_or(Poll::Pending, Poll::Ready)
        });
        let mapped = result.await;
        let found = mapped.map_err(|e| GpuError::Readback(e.to_string())).and_then(|()| values(&staging, count));
        // A browser keeps a buffer until its garbage is collected.
        staging.destroy();
        self.check()?;
        found
    }

    /// The first `bytes` of each buffer, one after the other, in one that the host can map.
    fn copied(&self, sources: &[&RawBuffer], bytes: u64) -> wgpu::Buffer {
        let bytes = bytes.next_multiple_of(4);
        let staging = self.staging(bytes * sources.len() as u64);
        flush();
        let mut encoder = self.device.create_command_encoder(&Default::default());
        for (place, source) in (0..).zip(sources) {
            encoder.copy_buffer_to_buffer(&source.buffer, source.offset, &staging, bytes * place, bytes);
        }
        self.queue.submit([encoder.finish()]);
        staging
    }

    /// As [`Gpu::read_async`], from row `first` on.
    ///
    /// # Errors
    /// When the device is lost.
    pub async fn read_at_async<T: bytemuck::Pod>(
        &self,
        source: &Buffer<T>,
        first: usize,
        count: usize,
    ) -> Result<Vec<T>, GpuError> {
        self.read_async(&source.part(first, count), count).await
    }

    /// A buffer that the host can map for reading.
    pub fn staging(&self, bytes: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: bytes.max(4).next_multiple_of(4),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }
}

/// What a mapped buffer holds.
fn values<T: bytemuck::Pod>(staging: &wgpu::Buffer, count: usize) -> Result<Vec<T>, GpuError> {
    let mapped = staging.get_mapped_range(..).map_err(|e| GpuError::Readback(e.to_string()))?;
    let mut values = vec![T::zeroed(); count];
    let bytes = bytemuck::cast_slice_mut::<T, u8>(&mut values);
    bytes.copy_from_slice(&mapped[..bytes.len()]);
    Ok(values)
}
