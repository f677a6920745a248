//! Images and warped colours in a photo's exposure, as burn autodiff operations.

use super::{Exposure, PhotoExposures, ROW_BYTES};
use crate::fuse::{MAX_SOURCES, Seen};
use crate::gpu::buffer::{from_primitive, primitive};
use crate::gpu::pool::{Lease, Pool};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::raster::Forward;
use burn::backend::Autodiff;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::tensor::Tensor;
use burn_cubecl::tensor::CubeTensor;
use burn_wgpu::CubeBackend;
use bytemuck::{bytes_of, cast_slice};
use ibgs_shaders::types::{ExposeParams, SlotsParams};
use ibgs_shaders::{EXPOSE, EXPOSE_BACKWARD, EXPOSE_TOTAL, EXPOSE_WARPED, EXPOSE_WARPED_BACKWARD, EXPOSURE_GROUPS};
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
    /// `[1 + M, 8]` f32.
    rows: Buffer,
    partials: Buffer,
    /// Gradient by the target's.
    v_target: Buffer,
}

/// Brings exposures to the device; owns their memory.
#[derive(Debug)]
pub struct Exposer {
    gpu: Arc<Gpu>,
    pool: Arc<Pool<Room>>,
}

#[derive(Debug)]
struct ExposeBackward;

#[derive(Clone, Debug)]
struct Saved {
    exposures: Exposures,
    forward: Forward,
    params: ExposeParams,
}

impl Backward<CubeBackend, 1> for ExposeBackward {
    type State = Saved;

    fn backward(self, ops: Ops<Saved, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_exposed = burn_wgpu::into_contiguous(grads.consume::<CubeBackend>(&ops.node));
        let [Some(parent)] = ops.parents else { return };
        let Saved { exposures: Exposures { gpu, room }, forward, params } = ops.state;
        let v_image = gpu.empty_like_shape(&forward.image, forward.image.meta.shape());
        let [image, v_exposed, out] = [&forward.image, &v_exposed, &v_image].map(Gpu::bind);
        let mut pass = Pass::new(&gpu, "exposure backward");
        let t = &forward.workspace.final_t;
        let buffers: [&Buffer; 6] = [&room.rows, &image, t, &v_exposed, &out, &room.partials];
        pass.groups(&EXPOSE_BACKWARD, &buffers, bytes_of(&params), EXPOSURE_GROUPS as usize);
        pass.groups(&EXPOSE_TOTAL, &[&room.rows, &room.partials, &room.v_target], &[], 1);
        pass.submit();
        grads.register::<CubeBackend>(parent.id, v_image);
    }
}

#[derive(Debug)]
struct WarpedBackward;

#[derive(Clone, Debug)]
struct SavedWarped {
    exposures: Exposures,
    seen: Arc<Lease<Seen>>,
    params: SlotsParams,
}

impl Backward<CubeBackend, 1> for WarpedBackward {
    type State = SavedWarped;

    fn backward(self, ops: Ops<SavedWarped, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let v_shifted = burn_wgpu::into_contiguous(grads.consume::<CubeBackend>(&ops.node));
        let [Some(parent)] = ops.parents else { return };
        let SavedWarped { exposures: Exposures { gpu, room }, seen, params } = ops.state;
        let v_warped = gpu.empty_like_shape(&v_shifted, v_shifted.meta.shape());
        let [v, out] = [&v_shifted, &v_warped].map(Gpu::bind);
        let mut pass = Pass::new(&gpu, "exposure backward");
        let buffers: [&Buffer; 4] = [&room.rows, &seen.slots, &v, &out];
        pass.linear(&EXPOSE_WARPED_BACKWARD, &buffers, bytes_of(&params), params.pixels as usize);
        pass.submit();
        grads.register::<CubeBackend>(parent.id, v_warped);
    }
}

const LABEL: &str = "exposure";

impl Exposer {
    /// Without any memory yet.
    pub fn new(gpu: Arc<Gpu>) -> Self {
        Self { gpu, pool: Arc::default() }
    }

    fn room(&self) -> Result<Lease<Room>, GpuError> {
        let made = || {
            Ok(Room {
                rows: self.gpu.allocate("exposures", ROW_BYTES * (1 + MAX_SOURCES as u64))?,
                partials: self.gpu.allocate("exposure sums", ROW_BYTES * u64::from(EXPOSURE_GROUPS))?,
                v_target: self.gpu.allocate("gradient of the exposure", ROW_BYTES)?,
            })
        };
        Ok(self.pool.lease(self.pool.take().map_or_else(made, Ok)?))
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
        let rows: Vec<_> = std::iter::once(target).chain(sources).map(Exposure::row).collect();
        self.gpu.queue.write_buffer(&room.rows.buffer, room.rows.offset, cast_slice(rows.as_flattened()));
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
        for (&photo, row) in std::iter::once(&target).chain(sources).zip(0..) {
            pass.copy(&photos.row(photo), &room.rows, row * ROW_BYTES, ROW_BYTES);
        }
        pass.submit();
        Ok(self.exposures(room))
    }

    fn exposures(&self, room: Lease<Room>) -> Exposures {
        Exposures { gpu: self.gpu.clone(), room: Arc::new(room) }
    }
}

impl Exposures {
    /// `[8]` f32: gradient by the target's (log gains, 0, offsets, 0), there once the backward pass of [`Exposures::tracked`] is
    /// submitted; with that of half the squares of its numbers times [`EXPOSURE_PULL`](ibgs_shaders::EXPOSURE_PULL).
    pub fn v_target(&self) -> &Buffer {
        &self.room.v_target
    }

    fn saved(&self, forward: &Forward) -> Saved {
        let background = forward.frame.background;
        let [width, height] = forward.frame.size;
        let params = ExposeParams { background, pixels: width * height };
        Saved { exposures: self.clone(), forward: forward.clone(), params }
    }

    fn expose(&self, pass: &mut Pass, saved: &Saved) -> CubeTensor {
        let Saved { forward, params, .. } = saved;
        let out = self.gpu.empty_like_shape(&forward.image, forward.image.meta.shape());
        let [image, bound] = [&forward.image, &out].map(Gpu::bind);
        let buffers: [&Buffer; 4] = [&self.room.rows, &image, &forward.workspace.final_t, &bound];
        pass.linear(&EXPOSE, &buffers, bytes_of(params), params.pixels as usize);
        out
    }

    /// Records the image of a pass in the target's exposure, `[H, W, 3]`. What shines through of the background keeps its
    /// colour.
    pub(crate) fn record(&self, pass: &mut Pass, forward: &Forward) -> Tensor<3> {
        pass.relabel(LABEL);
        let saved = self.saved(forward);
        let out = self.expose(pass, &saved);
        pass.keep(saved);
        from_primitive(out)
    }

    /// The tracked image of a pass in the target's exposure, on the autodiff graph. The gradient by the exposure itself is
    /// [`Exposures::v_target`]; none flows through the transmittance.
    ///
    /// # Panics
    /// When the image is not on the autodiff graph: a bug of ours.
    pub fn tracked(&self, image: &Tensor<3>, forward: &Forward) -> Tensor<3> {
        type Ad = Autodiff<CubeBackend>;
        let image = image.clone().try_into_primitive::<Ad>().expect("the image is on the autodiff graph");
        let saved = self.saved(forward);
        let mut pass = Pass::new(&self.gpu, LABEL);
        let out = self.expose(&mut pass, &saved);
        pass.submit();
        let output = match ExposeBackward.prepare::<NoCheckpointing>([image.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish(saved, out),
            OpsKind::UnTracked(prep) => prep.finish(out),
        };
        Tensor::from_primitive::<Ad>(output)
    }

    fn shift(&self, pass: &mut Pass, warped: &CubeTensor, saved: &SavedWarped) -> CubeTensor {
        let out = self.gpu.empty_like_shape(warped, warped.meta.shape());
        let [bound, shifted] = [warped, &out].map(Gpu::bind);
        let buffers: [&Buffer; 4] = [&self.room.rows, &bound, &saved.seen.slots, &shifted];
        pass.linear(&EXPOSE_WARPED, &buffers, bytes_of(&saved.params), saved.params.pixels as usize);
        out
    }

    fn saved_warped(&self, warped: &CubeTensor, seen: &Arc<Lease<Seen>>) -> SavedWarped {
        let shape = warped.meta.shape();
        let params = SlotsParams { pixels: shape[1] as u32, slots: shape[0] as u32 };
        SavedWarped { exposures: self.clone(), seen: seen.clone(), params }
    }

    /// Records the warped colours `[V, P, 4]` in the target's exposure.
    pub(crate) fn record_warped(&self, pass: &mut Pass, warped: Tensor<3>, seen: &Arc<Lease<Seen>>) -> Tensor<3> {
        pass.relabel(LABEL);
        let warped = primitive(warped);
        let saved = self.saved_warped(&warped, seen);
        let out = self.shift(pass, &warped, &saved);
        pass.keep((saved, warped));
        from_primitive(out)
    }

    /// Tracked warped colours `[V, P, 4]` in the target's exposure, on the autodiff graph; the exposures are constants.
    ///
    /// # Panics
    /// When the colours are not on the autodiff graph: a bug of ours.
    pub fn tracked_warped(&self, warped: Tensor<3>, seen: &Arc<Lease<Seen>>) -> Tensor<3> {
        type Ad = Autodiff<CubeBackend>;
        let warped = warped.try_into_primitive::<Ad>().expect("the colours are on the autodiff graph");
        let node = warped.node();
        let warped = warped.into_primitive();
        let saved = self.saved_warped(&warped, seen);
        let mut pass = Pass::new(&self.gpu, LABEL);
        let out = self.shift(&mut pass, &warped, &saved);
        pass.submit();
        let output = match WarpedBackward.prepare::<NoCheckpointing>([node]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish(saved, out),
            OpsKind::UnTracked(prep) => prep.finish(out),
        };
        Tensor::from_primitive::<Ad>(output)
    }
}
