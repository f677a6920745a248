//! Tile intersections of each Gaussian, also where more were counted than there are.

use ibgs_reference::gpu::view;
use ibgs_reference::gpu::{gpu, rasterizer, splats};
use ibgs_reference::random_scene::{random_camera, random_params};
use ibgs_reference::sort::exclusive_scan;
use ibgs_render::gpu::{Gpu, Pass};
use ibgs_shaders::TILE;
use ibgs_shaders::bindings::TileEmitBindings;
use ibgs_shaders::types::ViewUniforms;

const UNTOUCHED: u32 = u32::MAX;

struct Emitted {
    tiles: Vec<u32>,
    places: Vec<u32>,
    gaussians: Vec<u32>,
    lengths: Vec<u32>,
    counts: Vec<u32>,
}

/// With room for `capacity` of them.
fn emit(gpu: &Gpu, frame: &ViewUniforms, projected: &[[f32; 4]], counts: &[u32], capacity: u32) -> Emitted {
    let (offsets, total) = exclusive_scan(counts);
    let frame = ViewUniforms { capacity, ..*frame };
    let [columns, rows] = frame.size.map(|side| side.div_ceil(TILE));
    let lists = (columns * rows + 1) as usize;
    let upload = |values: &[u32]| gpu.upload("test", values).unwrap();
    let out = [(); 3].map(|()| upload(&vec![UNTOUCHED; total as usize]));
    let (lengths, counted) = (upload(&vec![0; lists]), upload(counts));
    let mut pass = Pass::new(gpu, "test");
    let [isect_tiles, isect_places, isect_to_gaussian] = &out;
    let buffers = TileEmitBindings {
        projected: &gpu.upload("test", projected).unwrap(),
        offsets: &upload(&offsets),
        count: &upload(&[total]),
        isect_tiles,
        isect_places,
        isect_to_gaussian,
        list_lengths: &lengths,
        tile_counts: &counted,
    };
    pass.linear(&buffers, &frame, total as usize);
    pass.submit();
    let [tiles, places, gaussians] = out.map(|list| gpu.read(&list, total as usize).unwrap());
    let [lengths, counts] =
        [(&lengths, lists), (&counted, counts.len())].map(|(list, length)| gpu.read(list, length).unwrap());
    Emitted { tiles, places, gaussians, lengths, counts }
}

#[test]
fn what_was_counted_and_is_not_found_counts_no_more() {
    let gpu = gpu();
    let p = random_params(300, 0, 21);
    let forward = rasterizer().surface(&splats(&p), &view(random_camera(150, 90, 21), 0)).unwrap();
    let count = forward.frame.count as usize;
    let projected = gpu.read(&forward.workspace.projected, 3 * count).unwrap();
    let counts = gpu.read(&forward.workspace.tile_counts, count).unwrap();
    let total: u32 = counts.iter().sum();
    let right = emit(&gpu, &forward.frame, &projected, &counts, total);
    assert_eq!(right.counts, counts);
    assert_eq!(right.lengths.last(), Some(&0), "entries of the tile that does not exist");

    let mut wrong = counts.clone();
    let seen: Vec<usize> = (0..count).filter(|&g| counts[g] > 0).step_by(7).collect();
    assert!(seen.len() > 10, "{} Gaussians", seen.len());
    seen.iter().for_each(|&g| wrong[g] += 1 + g as u32 % 3);
    let found = emit(&gpu, &forward.frame, &projected, &wrong, wrong.iter().sum());
    assert_eq!(found.counts, counts);
    let nowhere = found.lengths.len() as u32 - 1;
    assert_eq!(found.lengths[nowhere as usize], wrong.iter().sum::<u32>() - total);
    assert_eq!(found.lengths[..nowhere as usize], right.lengths[..nowhere as usize]);
    // Without those, the lists are the same.
    let entries = |emitted: &Emitted| -> Vec<(u32, u32)> {
        let all = emitted.tiles.iter().copied().zip(emitted.gaussians.iter().copied());
        all.filter(|(tile, _)| *tile != nowhere).collect()
    };
    assert!(entries(&found) == entries(&right), "intersections");
    // The places in a list are its numbers, each once.
    let mut places: Vec<(u32, u32)> = found.tiles.iter().copied().zip(found.places.iter().copied()).collect();
    places.sort_unstable();
    let all: Vec<(u32, u32)> =
        (0u32..).zip(&found.lengths).flat_map(|(tile, &length)| (0..length).map(move |k| (tile, k))).collect();
    assert!(places == all, "places");

    // Too little room: the first ones, and nothing behind them.
    let room = total / 2;
    let cut = emit(&gpu, &forward.frame, &projected, &counts, room);
    assert_eq!(cut.counts, counts);
    assert_eq!(cut.lengths.iter().sum::<u32>(), room);
    let (kept, behind) = cut.tiles.split_at(room as usize);
    assert!(kept == &right.tiles[..room as usize] && behind.iter().all(|tile| *tile == UNTOUCHED), "tiles");
}
