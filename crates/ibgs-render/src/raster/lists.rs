//! What every pass begins with: the projection and the tiles' lists.

use super::tile_grid;
use super::workspace::Workspace;
use crate::gpu::{Buffer, Pass};
use crate::scene::{Harmonics, PerGaussian, Splats};
use ibgs_shaders::bindings::{
    ProjectBindings, ProjectHalfBindings, TileEmitBindings, TilePlaceBindings, TileSortBindings, TileStartsBindings,
};
use ibgs_shaders::types::ViewUniforms;

/// Records the projection, in parts where the device cannot bind all colours at once.
fn record_project(pass: &mut Pass, ws: &Workspace, splats: &Splats, frame: &ViewUniforms) {
    let (n, most) = (frame.count as usize, splats.at_once(pass.gpu()));
    if n <= most {
        return record_part(pass, (&ws.projected, &ws.tile_counts), splats, frame);
    }
    let rows = splats.harmonics.rows(splats.coefficients);
    for first in (0..n).step_by(most) {
        let count = most.min(n - first);
        let parameters = splats.parameters.as_ref().zip(rows).map(|(all, row)| all.part(row * first, row * count));
        let splats = Splats { parameters, count, ..splats.clone() };
        let results = (&ws.projected.part(3 * first, 3 * count), &ws.tile_counts.part(first, count));
        record_part(pass, results, &splats, &ViewUniforms { count: count as u32, ..*frame });
    }
}

fn record_part(
    pass: &mut Pass,
    (projected, tile_counts): (&Buffer<[f32; 4]>, &Buffer<u32>),
    splats: &Splats,
    frame: &ViewUniforms,
) {
    let PerGaussian { means, log_scales, opacity_logits, sh, .. } = &splats.parameters;
    let rotations = &splats.rotations();
    let n = frame.count as usize;
    match splats.harmonics {
        Harmonics::Full => {
            let buffers = ProjectBindings { means, rotations, log_scales, opacity_logits, sh, projected, tile_counts };
            pass.linear(&buffers, frame, n);
        }
        Harmonics::Half => {
            let buffers = ProjectHalfBindings {
                means,
                rotations,
                log_scales,
                opacity_logits,
                sh: &splats.half_sh(),
                projected,
                tile_counts,
            };
            pass.linear(&buffers, frame, n);
        }
    }
}

/// Records everything up to the tile lists.
pub(super) fn record_lists(pass: &mut Pass, ws: &Workspace, splats: &Splats, frame: &ViewUniforms) {
    let n = frame.count as usize;
    let Workspace {
        projected, offsets, total, tile_counts, tile_ranges, list_lengths, isect_to_gaussian, list, ..
    } = ws;
    record_project(pass, ws, splats, frame);
    ws.scan.record(pass, tile_counts, offsets, total, n);
    // What the sort writes are the tiles and places before.
    let [isect_tiles, isect_places] = [&ws.sorted_gaussians, &ws.sorted_isects];
    let emit = TileEmitBindings {
        projected,
        offsets,
        count: total,
        isect_tiles,
        isect_places,
        isect_to_gaussian,
        list_lengths,
        tile_counts,
    };
    pass.linear(&emit, frame, ws.capacity);
    pass.grid(&TileStartsBindings { list_lengths, tile_ranges }, frame, [1, 1, 1]);
    let place =
        TilePlaceBindings { projected, count: total, isect_tiles, isect_places, isect_to_gaussian, tile_ranges, list };
    pass.linear(&place, frame, ws.capacity);
    let (sorted_gaussians, sorted_isects) = (isect_tiles, isect_places);
    let sort = TileSortBindings { tile_ranges, isect_to_gaussian, list, sorted_gaussians, sorted_isects };
    pass.grid(&sort, frame, tile_grid(frame));
}
