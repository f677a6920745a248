//! The backward pass.

use super::workspace::Workspace;
use super::{Forward, tile_grid};
use crate::gpu::{Buffer, Gpu, Pass};
use crate::scene::{Harmonics, PerGaussian, Splats};
use ibgs_shaders::bindings::{
    PlanesBackwardBindings, ProjectBackwardBindings, RasterizeBackwardBindings, RasterizeSurfaceBackwardBindings,
    SumRowsBindings, SumRowsSurfaceBindings,
};

/// Where the gradients of one backward pass go, float32; contents before are overwritten.
#[derive(Clone, Debug)]
pub struct RasterGradients {
    /// By the means, `[N, 3]`.
    pub means: Buffer<f32>,
    /// By the raw quaternions, `[N, 4]`.
    pub rotations: Buffer<[f32; 4]>,
    /// By the logarithms of the scales, `[N, 3]`.
    pub log_scales: Buffer<f32>,
    /// By the opacity logits, `[N]`.
    pub opacity_logits: Buffer<f32>,
    /// By the spherical-harmonics coefficients, `[N, coefficients, 3]`.
    pub sh: Buffer<f32>,
    /// (x, y, |x|, |y|) by the projected mean in pixels, summed over pixels, `[N, 4]`.
    pub screen: Buffer<[f32; 4]>,
    /// By the planes' raw normals, `[N, 3]`, and offsets, `[N]`: needed where the pass has a surface.
    pub planes: Option<[Buffer<f32>; 2]>,
}

impl Forward {
    /// Gradients from that of the image, `[H, W, 3]`, and, with a surface, from those that were added to it
    /// ([`Surface::v`](super::Surface::v)).
    ///
    /// # Panics
    /// When the pass did not keep what its gradients need, `v` lacks the planes, or the spherical harmonics are halves: bugs of
    /// ours.
    pub fn backward(&self, gpu: &Gpu, splats: &Splats, v_image: &Buffer<f32>, v: &RasterGradients) {
        assert_eq!(self.surface.is_some(), v.planes.is_some(), "gradients of the planes");
        assert_eq!(splats.harmonics, Harmonics::Full, "precision of what learns");
        let mut pass = Pass::new(gpu, "rasterize backward");
        self.record_blend(&mut pass, v_image);
        self.record_project(&mut pass, splats, v);
        pass.submit();
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
            }
        }
    }

    fn record_project(&self, pass: &mut Pass, splats: &Splats, v: &RasterGradients) {
        let PerGaussian { means, log_scales, sh, normals, offsets: plane_offsets, .. } = &splats.parameters;
        let Workspace { offsets, tile_counts, total, projected, rows, .. } = &**self.workspace;
        let (frame, count) = (&self.frame, splats.count);
        let [v_isect_color, v_isect_xy, v_isect_cov] = [0, 1, 2].map(|i| &rows[i]);
        let RasterGradients { rotations: v_rotations, log_scales: v_log_scales, screen: v_screen, .. } = v;
        let surface = self.surface.as_ref().zip(v.planes.as_ref());
        match surface {
            None => {
                let sums = SumRowsBindings {
                    offsets,
                    tile_counts,
                    total,
                    v_isect_color,
                    v_isect_xy,
                    v_isect_cov,
                    v_rotations,
                    v_screen,
                    v_log_scales,
                };
                pass.linear(&sums, frame, count);
            }
            Some((_, [v_normals, v_plane_offsets])) => {
                let sums = SumRowsSurfaceBindings {
                    offsets,
                    tile_counts,
                    total,
                    v_isect_color,
                    v_isect_xy,
                    v_isect_cov,
                    v_rotations,
                    v_screen,
                    v_log_scales,
                    v_isect_plane: &rows[3],
                    v_normals,
                    v_plane_offsets,
                };
                pass.linear(&sums, frame, count);
            }
        }
        let project = ProjectBackwardBindings {
            means,
            rotations: &splats.rotations(),
            log_scales,
            sh,
            projected,
            tile_counts,
            total,
            v_means: &v.means,
            v_rotations,
            v_log_scales,
            v_opacity_logits: &v.opacity_logits,
            v_sh: &v.sh,
            v_screen,
            filters: &splats.filters,
        };
        pass.linear(&project, frame, count);
        if let Some((s, [v_normals, v_plane_offsets])) = surface {
            let (planes, v_means) = (&s.planes, &v.means);
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
            pass.linear(&gradients, frame, count);
        }
    }
}
