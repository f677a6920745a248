//! The backward pass.

use super::workspace::Workspace;
use super::{Forward, Surface, tile_grid};
use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use crate::scene::{Harmonics, PerGaussian, Splats};
use ibgs_shaders::CAMERA_GROUPS;
use ibgs_shaders::bindings::{
    CameraPlanesBindings, CameraProjectBindings, CameraSurfaceBindings, DensifyObserveBindings, PlanesBackwardBindings,
    ProjectBackwardBindings, RasterizeBackwardBindings, RasterizeSurfaceBackwardBindings, SumRowsBindings,
    SumRowsSurfaceBindings,
};
use ibgs_shaders::types::ObserveParams;

/// Where the gradients of one backward pass by the raw parameters go, float32, in rows of [`PerGaussian::gradient_rows`]; contents
/// before are overwritten. Those of the planes are there where the pass has a surface.
pub type RasterGradients = PerGaussian<Option<Buffer<f32>>>;

/// Densification statistics, to which a backward pass adds its view (`densify_observe`).
#[derive(Clone, Debug)]
pub struct ScreenStatistics {
    /// Four numbers a Gaussian.
    pub values: Buffer<[f32; 4]>,
    /// The largest norm over the views, in place of sums.
    pub largest: bool,
    /// Gradients of Gaussians nearer than this view depth count less in the sums.
    pub near_depth: f32,
}

impl Forward {
    /// Gradients from that of the image, `[H, W, 3]`, and, with a surface, from those that were added to it
    /// ([`Surface::v`](super::Surface::v)). That by the camera is added to [`Forward::cameras`], the view to
    /// [`Forward::statistics`].
    ///
    /// # Panics
    /// When the pass did not keep what its gradients need, `v` lacks some or has too many, or the spherical harmonics are halves: bugs of
    /// ours.
    pub fn backward(&self, gpu: &Gpu, splats: &Splats, v_image: &Buffer<f32>, v: &RasterGradients) {
        let needed = PerGaussian::with_gradients(self.surface.is_some());
        assert_eq!(v.as_ref().map(Option::is_some), needed, "gradients that the pass makes");
        assert_eq!(splats.harmonics, Harmonics::Full, "precision of what learns");
        let mut pass = Pass::new(gpu, "rasterize backward");
        self.record_blend(&mut pass, v_image);
        self.record_project(&mut pass, splats, v);
        pass.submit();
    }

    /// The pixels' values `[H, W, 3]`, weighted by the blending weights of each Gaussian and summed over the pixels: the gradient of
    /// the colours. The last of the four numbers means nothing.
    ///
    /// # Errors
    /// Not enough memory, or the device is lost.
    ///
    /// # Panics
    /// When the pass did not keep what its gradients need, or has a surface: bugs of ours.
    pub fn weighted(&self, gpu: &Gpu, count: usize, values: &Buffer<f32>) -> Result<Vec<[f32; 4]>, GpuError> {
        assert!(self.surface.is_none(), "a surface has more gradients");
        // Zero for those that are not seen.
        let sums = gpu.allocate("sums of Gaussians", count)?;
        let sum = |what, row: usize| gpu.transient(what, row * count);
        let (screen, heights, covariances) =
            (sum("screen sums", 3)?, sum("screen sums of heights", 1)?, sum("covariance sums", 3)?);
        let mut pass = Pass::new(gpu, "weighted sums");
        self.record_blend(&mut pass, values);
        self.record_row_sums(&mut pass, count, &sums, [&screen, &heights, &covariances]);
        pass.submit();
        gpu.read(&sums, count)
    }

    fn record_blend(&self, pass: &mut Pass, v_image: &Buffer<f32>) {
        let ws = &self.workspace;
        let frame = &self.frame;
        let grid = tile_grid(frame);
        let Workspace { projected, sorted_gaussians, sorted_isects, tile_ranges, final_t, last_entry, .. } = &***ws;
        match &self.surface {
            None => {
                let [v_isect_color, v_isect_xy, v_isect_cov] = [0, 1, 2].map(|i| &ws.rows[i]);
                let blend = RasterizeBackwardBindings {
                    projected,
                    sorted_gaussians,
                    sorted_isects,
                    tile_ranges,
                    final_t,
                    last_entry,
                    v_image,
                    v_isect_color,
                    v_isect_xy,
                    v_isect_cov,
                };
                pass.grid(&blend, frame, grid);
            }
            Some(s) => {
                let v = s.v.as_ref().expect("a tracked surface has gradients");
                let [v_isect_color, v_isect_xy, v_isect_cov, v_isect_plane] = [0, 1, 2, 3].map(|i| &ws.rows[i]);
                let blend = RasterizeSurfaceBackwardBindings {
                    projected,
                    planes: &s.planes,
                    sorted_gaussians,
                    sorted_isects,
                    tile_ranges,
                    final_t,
                    last_entry,
                    median_depth: &s.median_depth,
                    intersections: &s.intersections,
                    intersection_entries: &v.entries,
                    v_image,
                    v_normal_map: &v.normal_map,
                    v_median_depth: &v.median_depth,
                    v_intersections: &v.intersections,
                    v_isect_color,
                    v_isect_xy,
                    v_isect_cov,
                    v_isect_plane,
                };
                pass.grid(&blend, &s.frame, grid);
                self.record_lens(pass, s);
            }
        }
    }

    /// What the surface's rays say of the lens.
    fn record_lens(&self, pass: &mut Pass, surface: &Surface) {
        let (Some(cameras), Some(v)) = (&self.cameras, &surface.v) else { return };
        let bindings = CameraSurfaceBindings {
            planes: &surface.planes,
            sorted_gaussians: &self.workspace.sorted_gaussians,
            tile_ranges: &self.workspace.tile_ranges,
            intersections: &surface.intersections,
            intersection_entries: &v.entries,
            v_median_depth: &v.median_depth,
            v_intersections: &v.intersections,
            partials: cameras.partials(),
        };
        pass.groups(&bindings, &surface.frame, CAMERA_GROUPS as usize);
        cameras.record_target(pass);
    }

    /// What the sums by Gaussian say of the camera; before they become gradients of the parameters.
    fn record_camera(&self, pass: &mut Pass, splats: &Splats, base: Base, planes: Option<[&Buffer<f32>; 2]>) {
        let Some(cameras) = &self.cameras else { return };
        let PerGaussian { means, log_scales, sh, normals, offsets: plane_offsets, .. } = &splats.parameters;
        let Workspace { tile_counts, total, projected, .. } = &**self.workspace;
        let partials = cameras.partials();
        let Base { v_means, v_rotations, v_log_scales, .. } = base;
        let project = CameraProjectBindings {
            means,
            rotations: &splats.rotations(),
            log_scales,
            sh,
            projected,
            tile_counts,
            total,
            v_rotations,
            v_log_scales,
            v_means,
            partials,
        };
        pass.groups(&project, &self.frame, CAMERA_GROUPS as usize);
        cameras.record_target(pass);
        if let Some((s, [v_normals, v_plane_offsets])) = self.surface.as_ref().zip(planes) {
            let planes = CameraPlanesBindings {
                means,
                normals,
                plane_offsets,
                planes: &s.planes,
                tile_counts,
                total,
                v_normals,
                v_plane_offsets,
                partials,
            };
            pass.groups(&planes, &self.frame, CAMERA_GROUPS as usize);
            cameras.record_target(pass);
        }
    }

    /// What the sums by Gaussian say for densification; before they become gradients of the parameters.
    fn record_statistics(&self, pass: &mut Pass, count: usize, base: Base) {
        let Some(ScreenStatistics { values: statistics, largest, near_depth }) = &self.statistics else { return };
        let params = ObserveParams {
            size: self.frame.size,
            count: self.frame.count,
            near_depth: *near_depth,
            largest: u32::from(*largest),
            capacity: self.frame.capacity,
        };
        let Workspace { tile_counts, total, projected, .. } = &**self.workspace;
        let Base { v_means, v_opacity_logits, .. } = base;
        let observe = DensifyObserveBindings { projected, tile_counts, total, v_means, v_opacity_logits, statistics };
        pass.linear(&observe, &params, count);
    }

    /// Sums the rows of the tile intersections of a pass without a surface by Gaussian.
    fn record_row_sums(
        &self,
        pass: &mut Pass,
        count: usize,
        v_rotations: &Buffer<[f32; 4]>,
        [v_means, v_opacity_logits, v_log_scales]: [&Buffer<f32>; 3],
    ) {
        let Workspace { offsets, tile_counts, total, rows, .. } = &**self.workspace;
        let [v_isect_color, v_isect_xy, v_isect_cov] = [0, 1, 2].map(|i| &rows[i]);
        let sums = SumRowsBindings {
            offsets,
            tile_counts,
            total,
            v_isect_color,
            v_isect_xy,
            v_isect_cov,
            v_rotations,
            v_means,
            v_opacity_logits,
            v_log_scales,
        };
        pass.linear(&sums, &self.frame, count);
    }

    /// Sums the rows of the tile intersections by Gaussian.
    fn record_sums(&self, pass: &mut Pass, count: usize, base: Base, planes: Option<[&Buffer<f32>; 2]>) {
        let Workspace { offsets, tile_counts, total, rows, .. } = &**self.workspace;
        let [v_isect_color, v_isect_xy, v_isect_cov] = [0, 1, 2].map(|i| &rows[i]);
        let Base { v_means, v_rotations, v_log_scales, v_opacity_logits, .. } = base;
        match planes {
            None => self.record_row_sums(pass, count, v_rotations, [v_means, v_opacity_logits, v_log_scales]),
            Some([v_normals, v_plane_offsets]) => {
                let sums = SumRowsSurfaceBindings {
                    offsets,
                    tile_counts,
                    total,
                    v_isect_color,
                    v_isect_xy,
                    v_isect_cov,
                    v_rotations,
                    v_means,
                    v_opacity_logits,
                    v_log_scales,
                    v_isect_plane: &rows[3],
                    v_normals,
                    v_plane_offsets,
                };
                pass.linear(&sums, &self.frame, count);
            }
        }
    }

    fn record_project(&self, pass: &mut Pass, splats: &Splats, v: &RasterGradients) {
        let PerGaussian { means, log_scales, sh, normals, offsets: plane_offsets, .. } = &splats.parameters;
        let Workspace { tile_counts, total, projected, .. } = &**self.workspace;
        let v_rotations = v.rotations.as_ref().expect("the base has gradients").cast();
        let base = Base::of(v, &v_rotations);
        let surface = self.surface.as_ref().zip(v.normals.as_ref().zip(v.offsets.as_ref()));
        let planes = surface.map(|(_, (normals, offsets))| [normals, offsets]);
        self.record_sums(pass, splats.count, base, planes);
        self.record_camera(pass, splats, base, planes);
        self.record_statistics(pass, splats.count, base);
        let Base { v_means, v_rotations, v_log_scales, v_opacity_logits, v_colors } = base;
        let project = ProjectBackwardBindings {
            means,
            rotations: &splats.rotations(),
            log_scales,
            sh,
            projected,
            tile_counts,
            total,
            v_means,
            v_rotations,
            v_log_scales,
            v_opacity_logits,
            v_colors,
        };
        pass.linear(&project, &self.frame, splats.count);
        if let Some((s, (v_normals, v_plane_offsets))) = surface {
            let planes = &s.planes;
            let gradients = PlanesBackwardBindings {
                means,
                normals,
                plane_offsets,
                planes,
                tile_counts,
                total,
                v_means,
                v_normals,
                v_plane_offsets,
            };
            pass.linear(&gradients, &self.frame, splats.count);
        }
    }
}

/// The gradients that every pass makes.
#[derive(Clone, Copy)]
struct Base<'a> {
    v_means: &'a Buffer<f32>,
    v_rotations: &'a Buffer<[f32; 4]>,
    v_log_scales: &'a Buffer<f32>,
    v_opacity_logits: &'a Buffer<f32>,
    v_colors: &'a Buffer<f32>,
}

impl<'a> Base<'a> {
    fn of(v: &'a RasterGradients, v_rotations: &'a Buffer<[f32; 4]>) -> Self {
        let PerGaussian {
            means: Some(v_means),
            log_scales: Some(v_log_scales),
            opacity_logits: Some(v_opacity_logits),
            sh: Some(v_colors),
            ..
        } = v
        else {
            unreachable!("the base has gradients")
        };
        Self { v_means, v_rotations, v_log_scales, v_opacity_logits, v_colors }
    }
}
