//! The backward pass.

use super::{Forward, tile_grid};
use crate::gpu::{Buffer, Gpu, Pass};
use crate::scene::{Harmonics, PerGaussian, Splats};
use bytemuck::bytes_of;
use ibgs_shaders::{
    PLANES_BACKWARD, PROJECT_BACKWARD, RASTERIZE_BACKWARD, RASTERIZE_SURFACE_BACKWARD, SUM_ROWS, SUM_ROWS_SURFACE,
};

/// Where the gradients of one backward pass go, float32; contents before are overwritten.
#[derive(Clone, Debug)]
pub struct RasterGradients {
    /// By the means, `[N, 3]`.
    pub means: Buffer,
    /// By the raw quaternions, `[N, 4]`.
    pub rotations: Buffer,
    /// By the logarithms of the scales, `[N, 3]`.
    pub log_scales: Buffer,
    /// By the opacity logits, `[N]`.
    pub opacity_logits: Buffer,
    /// By the spherical-harmonics coefficients, `[N, coefficients, 3]`.
    pub sh: Buffer,
    /// (x, y, |x|, |y|) by the projected mean in pixels, summed over pixels, `[N, 4]`.
    pub screen: Buffer,
    /// By the planes' raw normals, `[N, 3]`, and offsets, `[N]`: needed where the pass has a surface.
    pub planes: Option<[Buffer; 2]>,
}

impl Forward {
    /// Gradients from that of the image, `[H, W, 3]`, and, with a surface, from those that were added to it
    /// ([`Surface::v`](super::Surface::v)).
    ///
    /// # Panics
    /// When the pass did not keep what its gradients need, `v` lacks the planes, or the spherical harmonics are halves: bugs of
    /// ours.
    pub fn backward(&self, gpu: &Gpu, splats: &Splats, v_image: &Buffer, v: &RasterGradients) {
        assert_eq!(self.surface.is_some(), v.planes.is_some(), "gradients of the planes");
        assert_eq!(splats.harmonics, Harmonics::Full, "precision of what learns");
        let mut pass = Pass::new(gpu, "rasterize backward");
        self.record_blend(&mut pass, v_image);
        self.record_project(&mut pass, splats, v);
        pass.submit();
    }

    fn record_blend(&self, pass: &mut Pass, v_image: &Buffer) {
        let ws = &self.workspace;
        let frame = &self.frame;
        let grid = tile_grid(frame);
        let (list, isects) = (&ws.sorted_gaussians, &ws.sorted_isects);
        match &self.surface {
            None => {
                let [v_color, v_xy, v_cov] = [0, 1, 2].map(|i| &ws.rows[i]);
                let blend: [&Buffer; 10] = [
                    &ws.projected,
                    list,
                    isects,
                    &ws.tile_ranges,
                    &ws.final_t,
                    &ws.last_entry,
                    v_image,
                    v_color,
                    v_xy,
                    v_cov,
                ];
                pass.grid(&RASTERIZE_BACKWARD, &blend, bytes_of(frame), grid);
            }
            Some(s) => {
                let v = s.v.as_ref().expect("a tracked surface has gradients");
                let [v_color, v_xy, v_cov, v_plane] = [0, 1, 2, 3].map(|i| &ws.rows[i]);
                let blend: [&Buffer; 18] = [
                    &ws.projected,
                    &s.planes,
                    list,
                    isects,
                    &ws.tile_ranges,
                    &ws.final_t,
                    &ws.last_entry,
                    &s.median_depth,
                    &s.intersections,
                    &v.entries,
                    v_image,
                    &v.normal_map,
                    &v.median_depth,
                    &v.intersections,
                    v_color,
                    v_xy,
                    v_cov,
                    v_plane,
                ];
                pass.grid(&RASTERIZE_SURFACE_BACKWARD, &blend, bytes_of(&s.frame), grid);
            }
        }
    }

    fn record_project(&self, pass: &mut Pass, splats: &Splats, v: &RasterGradients) {
        let PerGaussian { means, rotations, log_scales, sh, normals, offsets, .. } = &splats.parameters;
        let ws = &self.workspace;
        let frame = bytes_of(&self.frame);
        let mut rows: Vec<&Buffer> = vec![&ws.offsets, &ws.tile_counts, &ws.total];
        rows.extend(&ws.rows[..3]);
        rows.extend([&v.rotations, &v.screen, &v.log_scales]);
        let surface = self.surface.as_ref().zip(v.planes.as_ref());
        match surface {
            None => pass.linear(&SUM_ROWS, &rows, frame, splats.count),
            Some((_, [v_normals, v_offsets])) => {
                rows.extend([&ws.rows[3], v_normals, v_offsets]);
                pass.linear(&SUM_ROWS_SURFACE, &rows, frame, splats.count);
            }
        }
        let project: [&Buffer; 14] = [
            means,
            rotations,
            log_scales,
            sh,
            &ws.projected,
            &ws.tile_counts,
            &ws.total,
            &v.means,
            &v.rotations,
            &v.log_scales,
            &v.opacity_logits,
            &v.sh,
            &v.screen,
            &splats.filters,
        ];
        pass.linear(&PROJECT_BACKWARD, &project, frame, splats.count);
        if let Some((s, [v_normals, v_offsets])) = surface {
            let planes: [&Buffer; 9] =
                [means, normals, offsets, &s.planes, &ws.tile_counts, &ws.total, &v.means, v_normals, v_offsets];
            pass.linear(&PLANES_BACKWARD, &planes, frame, splats.count);
        }
    }
}
