//! A training as lines of JSON, one record each, for programs that plot or watch it.

use super::{Event, Observer};
use ibgs_core::eval::Score;
use ibgs_core::gpu::Gpu;
use ibgs_core::output::log::TrainingProgress;
use ibgs_core::output::results::{ViewScore, means};
use serde_json::{Value, json};
use std::io::{self, Write};
use std::ops::ControlFlow;
use std::sync::Arc;

/// Writes a record to `W` when figures have come back from the GPU, and at each event. A record is written at once, so that
/// others can follow the file. One that cannot be written ends the log with a warning, and not the training.
#[derive(Debug)]
pub struct JsonLines<W> {
    /// None after a failure.
    out: Option<W>,
    gpu: Arc<Gpu>,
    /// Loss and PSNR of the last record.
    last: Option<[f32; 2]>,
}

impl<W: Write> JsonLines<W> {
    /// A log of a training on this GPU.
    pub fn new(out: W, gpu: Arc<Gpu>) -> Self {
        Self { out: Some(out), gpu, last: None }
    }

    /// Writes that the training starts or is resumed; records of later iterations before this one no longer hold.
    pub fn start(&mut self, progress: &TrainingProgress) {
        let TrainingProgress { iteration, iterations, gaussians, seconds, .. } = *progress;
        self.write(&json!({
            "event": "start",
            "iteration": iteration,
            "iterations": iterations,
            "seconds": seconds,
            "gaussians": gaussians,
            "device": self.gpu.describe(),
        }));
    }

    fn write(&mut self, record: &Value) {
        let Some(out) = &mut self.out else { return };
        let written: io::Result<()> = (|| {
            out.write_all(format!("{record}\n").as_bytes())?;
            out.flush()
        })();
        if let Err(error) = written {
            log::warn!("the log of the training cannot be written ({error}); the training continues without");
            self.out = None;
        }
    }

    fn memory(&self) -> Option<u64> {
        self.gpu.memory_report().map(|report| report.reserved_bytes)
    }
}

impl<W: Write> Observer for JsonLines<W> {
    fn iteration(&mut self, progress: &TrainingProgress) -> ControlFlow<()> {
        let TrainingProgress { iteration, stage, loss, l1, ssim, psnr, gaussians, seconds, .. } = *progress;
        let figures = loss.zip(psnr).map(|(loss, psnr)| [loss, psnr]);
        if figures.is_some() && figures != self.last {
            self.last = figures;
            self.write(&json!({
                "event": "progress",
                "iteration": iteration,
                "seconds": seconds,
                "stage": stage,
                "loss": loss,
                "l1": l1,
                "ssim": ssim,
                "psnr": psnr,
                "gaussians": gaussians,
                "memory_bytes": self.memory(),
            }));
        }
        ControlFlow::Continue(())
    }

    fn event(&mut self, event: &Event) {
        let record = match event {
            Event::Evaluated { iteration, gaussians, scores, .. } => json!({
                "event": "evaluation",
                "iteration": iteration,
                "gaussians": gaussians,
                "views": scores.base.len(),
                "base": mean(&scores.base),
                "final": mean(&scores.image),
            }),
            Event::RolledBack { error, iteration, rates } => json!({
                "event": "rolled-back",
                "iteration": iteration,
                "rates": rates,
                "error": ibgs_core::sentence(*error),
            }),
            Event::Finished(summary) => json!({
                "event": "end",
                "iteration": summary.iteration,
                "seconds": summary.training.as_secs_f64(),
                "gaussians": summary.gaussians,
                "memory_bytes": self.memory(),
            }),
            _ => return,
        };
        self.write(&record);
    }
}

/// Mean scores; null without any, and where a mean is infinite.
fn mean(scores: &[ViewScore]) -> Value {
    if scores.is_empty() {
        return Value::Null;
    }
    let Score { psnr, aligned_psnr, ssim, .. } = means(scores);
    json!({ "psnr": psnr, "aligned_psnr": aligned_psnr, "ssim": ssim })
}
