//! Time and memory of each stage of a training.

use ibgs_core::config::schedule::Schedule;
use ibgs_core::gpu::Bytes;
use ibgs_core::gpu::Gpu;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::time::Duration;

/// Iterations between two readings of the memory in use.
const EVERY: u32 = 50;

/// What one stage has taken so far.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
struct Taken {
    name: String,
    iterations: u32,
    time: Duration,
    /// Most device memory that was reserved at a look; none where the driver does not report it.
    peak_bytes: Option<u64>,
}

/// Follows a training from stage to stage.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Watch {
    stages: Vec<Taken>,
}

/// Name of an iteration's stage.
pub fn stage(schedule: &Schedule, iteration: u32) -> &'static str {
    match (schedule.residual_at(iteration), schedule.surface_loss_at(iteration)) {
        (true, _) => "residual",
        (false, true) => "surface",
        (false, false) => "base",
    }
}

/// Whether the next iteration belongs to another stage; the measurements so far then belong to this one.
pub fn stage_ends(schedule: &Schedule, iteration: u32) -> bool {
    stage(schedule, iteration) != stage(schedule, iteration + 1)
}

impl Watch {
    /// Counts an iteration, and looks at the memory now and then.
    pub fn count(&mut self, schedule: &Schedule, iteration: u32, gpu: &Gpu) {
        let name = stage(schedule, iteration);
        if self.stages.last().is_none_or(|taken| taken.name != name) {
            self.stages.push(Taken { name: name.to_owned(), ..Taken::default() });
        }
        let Some(taken) = self.stages.last_mut() else { return };
        taken.iterations += 1;
        if taken.iterations % EVERY == 1 {
            let now = gpu.memory_report().map(|report| report.reserved_bytes);
            taken.peak_bytes = taken.peak_bytes.max(now);
        }
    }

    /// Adds time to the stage of the last iteration.
    pub fn spent(&mut self, time: Duration) {
        if let Some(taken) = self.stages.last_mut() {
            taken.time += time;
        }
    }

    /// Time spent in iterations alone.
    pub fn total(&self) -> Duration {
        self.stages.iter().map(|taken| taken.time).sum()
    }

    /// For `result_training.json`.
    pub fn json(&self) -> Value {
        let one = |taken: &Taken| {
            let value = json!({
                "iterations": taken.iterations,
                "seconds": taken.time.as_secs_f64(),
                "peak_reserved_bytes": taken.peak_bytes,
            });
            (taken.name.clone(), value)
        };
        Value::Object(self.stages.iter().map(one).collect::<Map<_, _>>())
    }

    /// `base 2333 x 1.60 ms (peak 900 MiB), residual 6667 x 10.2 ms (peak 1.6 GiB)`.
    pub fn sentence(&self) -> String {
        let one = |taken: &Taken| {
            let ms = 1e3 * taken.time.as_secs_f64() / f64::from(taken.iterations.max(1));
            let peak = taken.peak_bytes.map(|bytes| format!(" (peak {})", Bytes(bytes))).unwrap_or_default();
            format!("{} {} x {ms:.2} ms{peak}", taken.name, taken.iterations)
        };
        self.stages.iter().map(one).collect::<Vec<_>>().join(", ")
    }
}
