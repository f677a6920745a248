//! What the bench found, as it is written to JSON.

use super::floor::{Floor, Load};
use super::rates::Rates;
use super::stage::Work;
use ibgs_core::gpu::{Gpu, MemoryReport};
use serde::{Deserialize, Serialize};

/// Everything that one benchmark measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Version of ibgs.
    pub version: String,
    /// The device.
    pub device: DeviceReport,
    /// Its rates, measured at the start.
    pub rates: Rates,
    /// Runs that each median is of, after as many for warm-up.
    pub runs: u32,
    /// One entry a row of the growth table; the first of each scene is the one that the others vary.
    pub configurations: Vec<Configuration>,
}

/// The device that was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceReport {
    /// Its name.
    pub name: String,
    /// Backend of wgpu: `vulkan`, `metal` or `dx12`.
    pub backend: String,
    /// The driver with its version.
    pub driver: String,
    /// Kind of device, such as `DiscreteGpu` or `Cpu`.
    pub kind: String,
    /// Whether stages can be timed.
    pub timestamps: bool,
    /// The limits that decide what can run and how large.
    pub limits: Limits,
}

/// Limits of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Limits {
    /// Bytes that one storage binding can reach.
    pub max_storage_buffer_binding_size: u64,
    /// Bytes of one buffer.
    pub max_buffer_size: u64,
    /// Storage buffers that a kernel can bind.
    pub max_storage_buffers_per_shader_stage: u32,
    /// Bytes of workgroup memory.
    pub max_compute_workgroup_storage_size: u32,
    /// Threads of a workgroup.
    pub max_compute_invocations_per_workgroup: u32,
    /// Workgroups in one direction of a dispatch.
    pub max_compute_workgroups_per_dimension: u32,
}

impl DeviceReport {
    /// What a device says of itself.
    pub fn new(gpu: &Gpu) -> Self {
        let (info, limits) = (&gpu.info, &gpu.limits);
        Self {
            name: info.name.clone(),
            backend: info.backend.to_str().to_owned(),
            driver: format!("{} {}", info.driver, info.driver_info),
            kind: format!("{:?}", info.device_type),
            timestamps: gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY),
            limits: Limits {
                max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
                max_buffer_size: limits.max_buffer_size,
                max_storage_buffers_per_shader_stage: limits.max_storage_buffers_per_shader_stage,
                max_compute_workgroup_storage_size: limits.max_compute_workgroup_storage_size,
                max_compute_invocations_per_workgroup: limits.max_compute_invocations_per_workgroup,
                max_compute_workgroups_per_dimension: limits.max_compute_workgroups_per_dimension,
            },
        }
    }
}

/// One model, view and set of options.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Configuration {
    /// Path of the model, or `synthetic`.
    pub scene: String,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// What the stages have to do.
    pub load: Load,
    /// Frames and iterations.
    pub timings: Vec<Timing>,
    /// Device memory at the end of the training with every stage at work; none where the driver does not report it.
    pub memory: Option<MemoryReport>,
    /// Bytes that the estimate before a training gives for it.
    pub estimated_bytes: u64,
}

impl Configuration {
    /// The timing of one kind of work.
    pub fn timing(&self, work: Work) -> Option<&Timing> {
        self.timings.iter().find(|timing| timing.work == work)
    }
}

/// Milliseconds of a frame or an iteration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Which.
    pub work: Work,
    /// Median by the clock, from the first command to the GPU's last.
    pub ms: f64,
    /// The fastest run.
    pub fastest_ms: f64,
    /// Mean of runs that follow each other without waiting for the GPU, as a training or a viewer runs.
    pub in_a_row_ms: f64,
    /// The host's part of that: recording and handing over, without its waits for results.
    pub host_ms: f64,
    /// Sum of the stages' floors.
    pub floor_ms: f64,
    /// Its stages in order, then kernels that belong to none.
    pub stages: Vec<StageTiming>,
}

impl Timing {
    /// Milliseconds of all kernels together; none where the device has no timestamps.
    pub fn kernels_ms(&self) -> Option<f64> {
        let timed = self.stages.iter().filter_map(|stage| stage.ms);
        timed.reduce(|a, b| a + b)
    }

    /// Share of the time of runs in a row in which the GPU has a kernel to run, at most 1.
    pub fn busy(&self) -> Option<f64> {
        self.kernels_ms().map(|ms| (ms / self.in_a_row_ms).min(1.0))
    }
}

/// Milliseconds of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageTiming {
    /// Its name.
    pub stage: String,
    /// Median by timestamps; none where the device has none.
    pub ms: Option<f64>,
    /// Its floor at the measured rates; none for kernels that belong to no stage.
    pub floor_ms: Option<f64>,
    /// What the floor is made of.
    pub floor: Option<Floor>,
}

impl StageTiming {
    /// How many times its floor it took.
    pub fn ratio(&self) -> Option<f64> {
        self.ms.zip(self.floor_ms).filter(|(_, floor)| *floor > 0.0).map(|(ms, floor)| ms / floor)
    }
}
