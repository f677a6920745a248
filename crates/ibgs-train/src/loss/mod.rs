//! Losses (method.md section 7): the image loss of base and final image, and those that are added to it.
//!
//! One of the latter is a file with a [`Loss`] and the tests of its kernels, and its line in [`losses`]; a program of its own
//! gives a training more ([`SessionBuilder::loss`](crate::session::SessionBuilder::loss)).

mod image;
mod normal;
mod photometric;

pub use image::{ImageLoss, ImageStats, LossScratch};
pub use normal::{NormalLoss, SurfaceBuffers};
pub use photometric::PhotometricLoss;

use burn::tensor::Tensor;
use ibgs_core::config::TrainConfig;
use ibgs_core::config::schedule::Schedule;
use ibgs_core::gpu::{Buffer, Gpu, GpuError};
use ibgs_core::raster::{CameraGradients, Surface};
use ibgs_core::sources::DevicePhoto;
use std::fmt::Debug;
use std::sync::Arc;

/// The sources of a view, warped to it.
#[derive(Clone, Debug)]
pub struct WarpedSources {
    /// `[V, P, 4]` on the graph: colour in the photo's exposure, and cosine.
    pub colors: Tensor<3>,
    /// `[P]` u32: byte m is the number of visible source m, 255 where there is none.
    pub visible: Buffer<u32>,
}

/// What a loss may read of an iteration. The tensors are nodes of burn's graph.
#[derive(Clone, Copy)]
pub struct LossInputs<'a> {
    /// The iteration, from 1.
    pub iteration: u32,
    /// The run's milestones.
    pub schedule: &'a Schedule,
    /// The photo.
    pub target: &'a DevicePhoto,
    /// The base image `[H, W, 3]` as it was rendered.
    pub image: &'a Tensor<3>,
    /// The base image in the photo's exposure.
    pub shown: &'a Tensor<3>,
    /// The surface, from two epochs before the surface losses on.
    pub surface: Option<&'a Surface>,
    /// Gradients by cameras, to which a loss that reads a camera adds its own; none where nobody asks for them.
    pub cameras: Option<&'a CameraGradients>,
    /// The sources, where a loss or the final image reads them.
    pub warped: Option<&'a WarpedSources>,
    /// The final image `[h, W, 3]`, once the residual has begun, and its photo: of the view, or of a band of its rows.
    pub final_image: Option<(&'a Tensor<3>, &'a DevicePhoto)>,
}

/// A part of the loss beside the image loss.
pub trait Loss: Debug + Send {
    /// Whether it reads the warped sources in this iteration. They are there from the first iteration of the surface losses on.
    fn reads_sources(&self, _iteration: u32, _schedule: &Schedule) -> bool {
        false
    }

    /// Whether it has operations of burn's own. They know no [batch](ibgs_core::gpu::Batch), so the passes of an iteration are
    /// then submitted one by one.
    fn uses_burn(&self) -> bool {
        true
    }

    /// The loss `[1]` times its weight, on the graph of what it reads; none where it has no part in the iteration.
    ///
    /// # Errors
    /// Not enough memory.
    fn of(&self, inputs: &LossInputs<'_>) -> Result<Option<Tensor<1>>, GpuError>;
}

/// Those of a run, in the order in which they are summed.
pub fn losses(gpu: &Arc<Gpu>, config: &TrainConfig) -> Vec<Box<dyn Loss>> {
    let surface = &config.surface;
    let photometric_weight = surface.photometric_weight * f64::from(surface.photometric_every);
    let photometric = PhotometricLoss::new(gpu.clone(), photometric_weight as f32);
    vec![
        Box::new(NormalLoss::new(gpu.clone(), surface.normal_weight as f32)),
        Box::new(photometric.every(surface.photometric_every)),
    ]
}
