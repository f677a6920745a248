//! The device and everything that outlives a single pass.

pub use super::error::GpuError;

use super::adapter::{IMMEDIATES, Use, require};
use super::bind_groups::BindGroups;
use super::buffer::Transients;
use super::launch::flush;
use super::matrix::matrix_units;
use super::pipeline::Pipelines;
use super::profile::Profiler;
use super::subgroups::subgroup_lanes;
use super::uniforms::Uniforms;
use ibgs_shaders::MatrixUnits;
use serde::{Deserialize, Serialize};
use std::any::Any;
use std::collections::BTreeMap;
use std::pin::pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex, OnceLock};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

/// What a future gives that is over at once, as all of the core's are where a program can wait for the GPU.
///
/// # Errors
/// Those of the future; in a browser, that there is no waiting.
pub(crate) fn at_once<T>(future: impl Future<Output = Result<T, GpuError>>) -> Result<T, GpuError> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(result) => result,
        Poll::Pending => Err(GpuError::no_waiting()),
    }
}

/// Device memory as wgpu's allocator counts it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MemoryReport {
    /// Bytes taken from the driver: what is allocated, and what the allocator keeps for later.
    pub reserved_bytes: u64,
    /// Bytes of all buffers.
    pub allocated_bytes: u64,
    /// The buffers by kind, the largest first.
    pub kinds: Vec<MemoryKind>,
}

/// Buffers of one label.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MemoryKind {
    /// Label of the buffers; wgpu's own name where another library on the same device gave none.
    pub name: String,
    /// Bytes of them all.
    pub bytes: u64,
    /// How many there are.
    pub buffers: u64,
}

/// The shared device with everything that outlives a single pass.
pub struct Gpu {
    /// Where the adapter was found; windows need it.
    pub instance: wgpu::Instance,
    /// The adapter of the device.
    pub adapter: wgpu::Adapter,
    /// The device.
    pub device: wgpu::Device,
    /// Its only queue.
    pub queue: wgpu::Queue,
    /// What the adapter is.
    pub info: wgpu::AdapterInfo,
    /// Limits of the device: all that the adapter offers.
    pub limits: wgpu::Limits,
    /// Its matrix units for products of halves; none where the adapter has none that fit our kernels.
    pub matrix_units: Option<MatrixUnits>,
    /// Lanes of a subgroup; none where their number is not fixed or not one that fits our kernels, or where a test finds that the
    /// driver gets them wrong.
    pub subgroup_lanes: Option<u32>,
    /// Whether it was opened here, with all features of the adapter.
    pub(super) is_own: bool,
    /// What a library that shares the device keeps with it.
    attached: OnceLock<Box<dyn Any + Send + Sync>>,
    pub(super) transients: Arc<Transients>,
    pub(super) bind_groups: BindGroups,
    /// What the test of the matrix units came to.
    pub(crate) matrix_units_pay: OnceLock<bool>,
    /// Where kernels find their immediate data on a device that has none.
    pub(super) uniforms: Option<Uniforms>,
    pub(super) pipelines: Pipelines,
    pub(super) profiler: Mutex<Option<Profiler>>,
    /// Nanoseconds spent in waiting for the device.
    waited: AtomicU64,
    /// What went wrong first, once something has.
    fault: Arc<OnceLock<String>>,
}

/// Interval between two checks for a lost device, while waiting for it.
const PATIENCE: Duration = Duration::from_millis(200);

/// The end of some work on the device.
#[derive(Clone, Debug)]
pub struct Mark(pub(super) wgpu::SubmissionIndex);

impl std::fmt::Debug for Gpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Gpu({})", self.info.name)
    }
}

impl Gpu {
    /// The device of another program, asked for by [`device_descriptor`](super::device_descriptor). Its callbacks stay. If
    /// they do not end the program, the next wait reports a lost device.
    ///
    /// # Errors
    /// The device lacks a limit that rendering needs, or it failed.
    pub fn from_wgpu(
        instance: wgpu::Instance,
        adapter: wgpu::Adapter,
        device: wgpu::Device,
        queue: wgpu::Queue,
    ) -> Result<Arc<Gpu>, GpuError> {
        Self::untested(instance, adapter, device, queue)?.with_right_subgroups()
    }

    pub(super) fn untested(
        instance: wgpu::Instance,
        adapter: wgpu::Adapter,
        device: wgpu::Device,
        queue: wgpu::Queue,
    ) -> Result<Gpu, GpuError> {
        let info = adapter.get_info();
        let (limits, features) = (device.limits(), device.features());
        require(&info, &limits, Use::Rendering)?;
        let experimental = features.contains(wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX);
        let immediates = features.contains(wgpu::Features::IMMEDIATES) && limits.max_immediate_size >= IMMEDIATES;
        Ok(Gpu {
            // Kernels for matrix units have immediate data.
            matrix_units: matrix_units(&adapter).filter(|_| experimental && immediates),
            subgroup_lanes: subgroup_lanes(&info, features).filter(|_| immediates),
            uniforms: (!immediates).then(|| Uniforms::new(&device)),
            limits,
            instance,
            adapter,
            device,
            queue,
            info,
            is_own: false,
            attached: OnceLock::new(),
            transients: Arc::default(),
            bind_groups: BindGroups::default(),
            waited: AtomicU64::default(),
            matrix_units_pay: OnceLock::new(),
            pipelines: Pipelines::default(),
            profiler: Mutex::default(),
            fault: Arc::default(),
        })
    }

    /// Sets the callbacks that record errors of the device, in place of those of another library.
    pub fn watch(&self) {
        let (first, also) = (self.fault.clone(), self.fault.clone());
        self.device.set_device_lost_callback(move |reason, text| {
            let _ = first.set(format!("the device is lost ({reason:?}) {text}").trim_end().to_owned());
        });
        self.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let text = error.to_string();
            if !is_of_window(&text) {
                // The next wait for the device returns it.
                let _ = also.set(text.split_whitespace().collect::<Vec<_>>().join(" "));
            }
        }));
    }

    /// What a library that shares the device keeps with it; none yet.
    ///
    /// # Panics
    /// When another type is kept: there is one such library, ours for training.
    pub fn attached<T: Any + Send + Sync>(&self) -> Option<&T> {
        self.attached.get().map(|kept| kept.downcast_ref().expect("one type of attachment"))
    }

    /// Keeps a value with the device unless there is one already; returns the one that is kept.
    ///
    /// # Panics
    /// As [`Gpu::attached`].
    pub fn attach<T: Any + Send + Sync>(&self, attached: T) -> &T {
        self.attached.get_or_init(|| Box::new(attached)).downcast_ref().expect("one type of attachment")
    }

    /// True on a software adapter.
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// Name, backend and driver in one line, for reports.
    pub fn describe(&self) -> String {
        format!("{} ({:?}, {} {})", self.info.name, self.info.backend, self.info.driver, self.info.driver_info)
    }

    /// Use of device memory now; none where the driver does not report it.
    pub fn memory_report(&self) -> Option<MemoryReport> {
        let report = self.device.generate_allocator_report()?;
        let mut kinds: BTreeMap<String, MemoryKind> = BTreeMap::new();
        for allocation in &report.allocations {
            let kind = kinds.entry(allocation.name.clone()).or_insert_with(|| MemoryKind {
                name: allocation.name.clone(),
                bytes: 0,
                buffers: 0,
            });
            kind.bytes += allocation.size;
            kind.buffers += 1;
        }
        let mut kinds: Vec<_> = kinds.into_values().collect();
        kinds.sort_by_key(|kind| std::cmp::Reverse(kind.bytes));
        Some(MemoryReport {
            reserved_bytes: report.total_reserved_bytes,
            allocated_bytes: report.total_allocated_bytes,
            kinds,
        })
    }

    /// Gives memory back that is kept for reuse.
    pub fn release_unused(&self) {
        self.bind_groups.clear();
        self.transients.clear();
    }

    /// Waits until everything submitted so far is done.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.wait_until(None)
    }

    fn wait_until(&self, mark: Option<wgpu::SubmissionIndex>) -> Result<(), GpuError> {
        flush();
        // A browser does not wait, and has no such clock.
        let start = cfg!(not(target_arch = "wasm32")).then(Instant::now);
        let poll = self.device.poll(wgpu::PollType::Wait { submission_index: mark, timeout: None });
        let waited = start.map_or(0, |start| start.elapsed().as_nanos() as u64);
        self.waited.fetch_add(waited, Ordering::Relaxed);
        if poll.is_err() {
            // A lost device has not taken the marked work; that it is lost comes to light with another wait.
            let _ = self.device.poll(wgpu::PollType::wait_indefinitely());
        }
        self.check()?;
        poll.map(|_| ()).map_err(|e| GpuError::Readback(e.to_string()))
    }

    /// How long this program has waited for the device so far.
    pub fn waited(&self) -> Duration {
        Duration::from_nanos(self.waited.load(Ordering::Relaxed))
    }

    /// Waits for the value that a callback of the device sends.
    ///
    /// # Errors
    /// When the device is lost, and in a browser, which does not let a program wait.
    pub fn answer<T>(&self, receiver: &Receiver<T>) -> Result<T, GpuError> {
        if cfg!(target_arch = "wasm32") {
            return receiver.try_recv().map_err(|_| GpuError::no_waiting());
        }
        loop {
            match receiver.recv_timeout(PATIENCE) {
                Ok(value) => return Ok(value),
                Err(RecvTimeoutError::Timeout) => {
                    let _ = self.device.poll(wgpu::PollType::Poll);
                    self.check()?;
                }
                Err(RecvTimeoutError::Disconnected) => return Err(GpuError::Readback("no answer".to_owned())),
            }
        }
    }

    /// Fails once the device is lost or has refused some work: its results are no longer valid.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn check(&self) -> Result<(), GpuError> {
        self.fault.get().map_or(Ok(()), |fault| Err(GpuError::Failed(fault.clone())))
    }

    /// Marks the work that has been handed to the device so far.
    pub fn mark(&self) -> Mark {
        flush();
        Mark(self.queue.submit([]))
    }

    /// Waits until marked work is done; what came after it may still run.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn wait_for(&self, mark: Mark) -> Result<(), GpuError> {
        self.wait_until(Some(mark.0))
    }
}

/// Whether an error costs a window one frame and the device nothing: a surface that could not be set up in time, as a software
/// adapter was busy, is set up again; until then a window that was made larger paints beyond it.
fn is_of_window(error: &str) -> bool {
    ["Surface::configure", "set_scissor_rect"].iter().any(|cause| error.contains(cause))
}
