//! The image-based part of a model, and how it makes the final image of a view.

use super::Removed;
use super::frame::{FinalImage, FrameSource};
use crate::camera::Camera;
use crate::dataset::HostPhoto;
use crate::exposure::Exposures;
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::raster::{Forward, Keep, SurfaceOptions};
use crate::residual::mix::SourceMix;
use crate::residual::network::ResidualNetwork;
use crate::residual::{Aggregation, Precision, Residual, ResidualInputs, ResidualTask, Variant};
use crate::sources::depth_cache::DepthCache;
use crate::sources::find::{SourceFinder, SourceOptions};
use crate::sources::source_store::SourceStore;
use crate::sources::{SourceView, WarpOptions, Warper};
use std::sync::{Arc, Mutex};

/// How the photos of neighbouring views are used (method.md sections 3 to 6).
#[derive(Clone, Debug, PartialEq)]
pub struct ImageOptions {
    /// Which views are the sources, and how they are read.
    pub sources: SourceOptions,
    /// Median intersections.
    pub surface: SurfaceOptions,
    /// Variant of the residual network.
    pub variant: Variant,
    /// How precisely it computes.
    pub precision: Precision,
    /// Most weight of the sources' mean colour in the final image.
    pub source_share: f32,
}

impl ImageOptions {
    /// How photos are warped.
    pub fn warp(&self) -> WarpOptions {
        WarpOptions {
            visible: self.sources.visible,
            agreement: self.sources.depth_agreement as f32,
            reach: if self.variant.aggregation == Aggregation::Soft { WarpOptions::SOFT_REACH } else { 1.0 },
        }
    }
}

/// What a model has besides its Gaussians.
#[derive(Clone, Debug)]
pub struct ImagePart {
    /// Cameras of the training views, which are the sources, in the scene's coordinates.
    pub cameras: Arc<[Camera]>,
    /// Their photos.
    pub photos: Arc<SourceStore>,
    /// The residual network.
    pub network: ResidualNetwork,
    /// How they are used.
    pub options: ImageOptions,
}

/// The image-based part on the device.
#[derive(Debug)]
pub(super) struct ImageStage {
    pub part: ImagePart,
    pub finder: SourceFinder,
    pub warper: Warper,
    pub residual: Residual,
    /// Median depths of the sources, valid as long as the Gaussians do not change.
    pub depths: Mutex<DepthCache>,
    /// What the photos show and the Gaussians do not, of an edited model.
    pub removed: Option<Arc<Removed>>,
}

impl ImageStage {
    pub fn new(gpu: &Arc<Gpu>, part: ImagePart, residual: Residual) -> Self {
        Self {
            finder: SourceFinder::new(&part.cameras, &part.options.sources),
            warper: Warper::new(gpu.clone(), part.options.warp()),
            residual,
            depths: Mutex::new(DepthCache::new(gpu.bytes_of(part.options.sources.memory))),
            removed: None,
            part,
        }
    }
}

/// The sources of a frame: which training views, and what the pass reads of them.
pub(super) struct Sources {
    pub indices: Vec<usize>,
    pub views: Vec<SourceView>,
    /// Their photos on the host.
    pub photos: Vec<HostPhoto>,
}

/// Records the final image of a view, whose base image stands as it is without sources.
pub(super) fn record_final(
    pass: &mut Pass,
    (gpu, stage): (&Gpu, &ImageStage),
    camera: &Camera,
    forward: &Forward,
    (base, exposures): (Buffer<f32>, Option<&Exposures>),
    sources: &Sources,
) -> Result<FinalImage, GpuError> {
    let options = stage.warper.options;
    if sources.views.is_empty() {
        return Ok(FinalImage { image: base, seen: None, sources: Vec::new(), options });
    }
    let warper = &stage.warper;
    let warped = warper.record(pass, forward, &sources.views, warper.memory(camera)?)?;
    let colors = match exposures {
        Some(exposures) => {
            let exposed = gpu.transient("exposed warped colours", warped.colors.rows())?;
            exposures.record_warped(pass, &warped, &exposed);
            exposed
        }
        None => warped.colors.clone(),
    };
    let task = ResidualTask { camera: *camera, seen: warped.seen.clone(), gain: 1.0 };
    let weights = stage.part.network.weights.clone();
    let inputs = ResidualInputs { base, warped: colors.clone(), visible: warped.visible, weights };
    let image = gpu.transient("final image", forward.image.rows())?;
    let residual = stage.residual.record(pass, &task, inputs, Keep::Image, image)?;
    let mix = SourceMix::new(camera.pixels() as u32, warped.visible, stage.part.options.source_share);
    mix.record(pass, &colors, &warped.seen.visible, &residual.image);
    // The photos on the device are not kept: the store could not reuse their memory.
    let keep = |((&view, source), photo): ((&usize, &SourceView), &HostPhoto)| FrameSource {
        view,
        camera: source.camera,
        photo: photo.clone(),
        depth: source.depth.clone(),
    };
    let sources = sources.indices.iter().zip(&sources.views).zip(&sources.photos).map(keep).collect();
    let image = residual.image.clone();
    pass.keep(residual);
    Ok(FinalImage { image, seen: Some(warped.seen), sources, options })
}
