//! Images and warped colours in a photo's exposure, and the gradients by them.

use super::{Exposure, PhotoExposures, ROWS};
use crate::gpu::pool::{Lease, Pool};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::raster::Forward;
use crate::sources::{MAX_SOURCES, Warped};
use ibgs_shaders::EXPOSURE_GROUPS;
use ibgs_shaders::bindings::{
    ExposeBackwardBindings, ExposeBindings, ExposeTotalBindings, ExposeWarpedBackwardBindings, ExposeWarpedBindings,
};
use ibgs_shaders::types::ExposeParams;
use std::sync::Arc;

/// The exposures of a target view and of its sources on the device, in this order.
#[derive(Clone, Debug)]
pub struct Exposures {
    gpu: Arc<Gpu>,
    room: Arc<Lease<Room>>,
}

/// Memory of the same size for every image.
#[derive(Debug)]
struct Room {
    /// `[1 + M, 2]`.
    rows: Buffer<[f32; 4]>,
    partials: Buffer<[f32; 4]>,
    /// Gradient by the target's.
    v_target: Buffer<[f32; 4]>,
}

/// Brings exposures to the device; owns their memory.
#[derive(Debug)]
pub struct ExposurePass {
    gpu: Arc<Gpu>,
    pool: Arc<Pool<Room>>,
}

const LABEL: &str = "exposure";

impl ExposurePass {
    /// Without any memory yet.
    pub fn new(gpu: Arc<Gpu>) -> Self {
        Self { gpu, pool: Arc::default() }
    }

    fn room(&self) -> Result<Lease<Room>, GpuError> {
        let made = || {
            Ok(Room {
                rows: self.gpu.allocate("exposures", ROWS * (1 + MAX_SOURCES))?,
                partials: self.gpu.allocate("exposure sums", ROWS * EXPOSURE_GROUPS as usize)?,
                v_target: self.gpu.allocate("gradient of the exposure", ROWS)?,
            })
        };
        self.pool.lease_or(|_| true, made)
    }

    /// Exposures of a target and its sources, on the host.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// With more sources than there can be: a bug of ours.
    pub fn upload(&self, target: &Exposure, sources: &[Exposure]) -> Result<Exposures, GpuError> {
        assert!(sources.len() <= MAX_SOURCES, "{} sources", sources.len());
        let room = self.room()?;
        let rows: Vec<_> = std::iter::once(target).chain(sources).map(Exposure::rows).collect();
        self.gpu.write(&room.rows, 0, rows.as_flattened());
        Ok(self.exposures(room))
    }

    /// Exposures of training photos, as they are learned, the first that of the target.
    ///
    /// # Errors
    /// Not enough memory.
    ///
    /// # Panics
    /// With more sources than there can be: a bug of ours.
    pub fn gather(&self, photos: &PhotoExposures, target: usize, sources: &[usize]) -> Result<Exposures, GpuError> {
        assert!(sources.len() <= MAX_SOURCES, "{} sources", sources.len());
        let room = self.room()?;
        let mut pass = Pass::new(&self.gpu, LABEL);
        for (&photo, place) in std::iter::once(&target).chain(sources).zip(0..) {
            pass.copy(&photos.rows(photo), &room.rows, place * ROWS, ROWS);
        }
        pass.submit();
        Ok(self.exposures(room))
    }

    fn exposures(&self, room: Lease<Room>) -> Exposures {
        Exposures { gpu: self.gpu.clone(), room: Arc::new(room) }
    }
}

impl Exposures {
    /// `[2]`: gradient by the target's (log gains, 0), (offsets, 0), there once [`Exposures::backward`] is
    /// submitted; with that of half the squares of its numbers times [`EXPOSURE_PULL`](ibgs_shaders::EXPOSURE_PULL).
    pub fn v_target(&self) -> &Buffer<[f32; 4]> {
        &self.room.v_target
    }

    /// The GPU it works on.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    fn params(forward: &Forward) -> ExposeParams {
        let (_, transmittance) = forward.transmittance();
        ExposeParams {
            background: forward.frame.background,
            pixels: forward.pixels(),
            transmittance,
            ..Default::default()
        }
    }

    /// Records the image of a pass in the target's exposure into `exposed`, `[H, W, 3]`. What shines through of the background
    /// keeps its colour.
    pub fn record(&self, pass: &mut Pass, forward: &Forward, exposed: &Buffer<f32>) {
        pass.relabel(LABEL);
        let params = Self::params(forward);
        let (exposures, image, transmittance) = (&self.room.rows, &forward.image, forward.transmittance().0);
        let bindings = ExposeBindings { exposures, image, transmittance, exposed };
        pass.linear(&bindings, &params, params.pixels as usize);
        pass.keep((self.clone(), forward.clone()));
    }

    /// The gradient by the image of a pass into `v_image` from that by the exposed one, `[H, W, 3]`, and that by the exposure
    /// itself into [`Exposures::v_target`]; none flows through the transmittance.
    pub fn backward(&self, forward: &Forward, v_exposed: &Buffer<f32>, v_image: &Buffer<f32>) {
        let params = Self::params(forward);
        let mut pass = Pass::new(&self.gpu, "exposure backward");
        let Room { rows: exposures, partials, v_target: v_exposure } = &**self.room;
        let (image, transmittance) = (&forward.image, forward.transmittance().0);
        let bindings = ExposeBackwardBindings { exposures, image, transmittance, v_exposed, v_image, partials };
        pass.groups(&bindings, &params, EXPOSURE_GROUPS as usize);
        pass.groups(&ExposeTotalBindings { exposures, partials, v_exposure }, &(), 1);
        pass.submit();
    }

    /// Records warped colours, `[V, P, 4]`, in the target's exposure into `exposed`.
    pub fn record_warped(&self, pass: &mut Pass, warped: &Warped, exposed: &Buffer<[f32; 4]>) {
        pass.relabel(LABEL);
        let params = warped.per_visible();
        let bindings = ExposeWarpedBindings {
            exposures: &self.room.rows,
            warped: &warped.colors,
            seen: &warped.seen.visible,
            shifted: exposed,
        };
        pass.linear(&bindings, &params, params.pixels as usize);
        pass.keep((self.clone(), warped.clone()));
    }

    /// The gradient by warped colours into `v_colors` from that by the exposed ones, `[V, P, 4]`; the exposures are constants.
    pub fn warped_backward(&self, warped: &Warped, v_exposed: &Buffer<[f32; 4]>, v_colors: &Buffer<[f32; 4]>) {
        let params = warped.per_visible();
        let mut pass = Pass::new(&self.gpu, "exposure backward");
        let bindings = ExposeWarpedBackwardBindings {
            exposures: &self.room.rows,
            seen: &warped.seen.visible,
            v_shifted: v_exposed,
            v_warped: v_colors,
        };
        pass.linear(&bindings, &params, params.pixels as usize);
        pass.submit();
    }
}
