//! The lists of the tiles by depth, from intersections as `tile_emit` leaves them.

use ibgs_reference::gpu::gpu;
use ibgs_reference::gpu::without_subgroups;
use ibgs_reference::sort::stable_sort;
use ibgs_render::gpu::{Buffer, Gpu, Pass, RawBuffer};
use ibgs_shaders::bindings::{TilePlaceBindings, TileSortBindings, TileStartsBindings};
use ibgs_shaders::types::ViewUniforms;
use ibgs_shaders::{SORT_BLOCK, TILE};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const UNTOUCHED: u32 = 7;
const GAUSSIANS: u32 = 5000;

type Depth = fn(&mut ChaCha8Rng) -> f32;

fn equal(_: &mut ChaCha8Rng) -> f32 {
    0.2
}

fn of_a_few_values(rng: &mut ChaCha8Rng) -> f32 {
    0.2 + rng.random_range(0..5) as f32 / 1000.0
}

fn different(rng: &mut ChaCha8Rng) -> f32 {
    0.2 + rng.random_range(0..1_000_000) as f32 / 1000.0
}

/// So far apart that the words of the sort do not tell those beside each other from one another: 1/1024 is one of the last bits
/// of 9000.
fn near_and_far(rng: &mut ChaCha8Rng) -> f32 {
    [0.01, 9000.0][rng.random_range(0..2)] + rng.random_range(0..400) as f32 / 1024.0
}

/// Finds where the lists start, puts the intersections there and sorts them. What the sort writes are the tiles and
/// places before.
fn sort(gpu: &Gpu, frame: &ViewUniforms, list_lengths: &Buffer<u32>, place: &TilePlaceBindings<'_, RawBuffer>) {
    let TilePlaceBindings { isect_tiles, isect_places, isect_to_gaussian, tile_ranges, list, .. } = *place;
    let [columns, rows] = frame.size.map(|side| side / TILE);
    let mut pass = Pass::new(gpu, "test");
    pass.grid(&TileStartsBindings { list_lengths, tile_ranges }, frame, [1, 1, 1]);
    pass.linear(place, frame, frame.capacity as usize);
    let (sorted_gaussians, sorted_isects) = (isect_tiles, isect_places);
    let buffers = TileSortBindings { tile_ranges, isect_to_gaussian, list, sorted_gaussians, sorted_isects };
    pass.grid(&buffers, frame, [columns, rows, 1]);
    pass.submit();
}

/// Lists of these lengths, of which the last is that of the tile that does not exist, in an image of so many columns of tiles, filled
/// by chance, with depths by chance.
fn check(gpu: &Gpu, (lengths, columns): (&[u32], u32), depth: Depth, rng: &mut ChaCha8Rng) {
    let existing = lengths.len() as u32 - 1;
    let rows = existing / columns;
    assert_eq!(rows * columns, existing);
    let mut tiles: Vec<u32> = (0u32..).zip(lengths).flat_map(|(tile, &length)| vec![tile; length as usize]).collect();
    tiles.shuffle(rng);
    let total = tiles.len();
    // A place is by chance among those of the tile.
    let mut free: Vec<Vec<u32>> = lengths.iter().map(|&length| (0..length).collect()).collect();
    free.iter_mut().for_each(|places| places.shuffle(rng));
    let places: Vec<u32> = tiles.iter().map(|&tile| free[tile as usize].pop().unwrap()).collect();
    let mut gaussians: Vec<u32> = (0..total).map(|_| rng.random_range(0..GAUSSIANS)).collect();
    gaussians.sort_unstable();
    let depths: Vec<f32> = (0..GAUSSIANS).map(|_| depth(rng)).collect();
    let projected: Vec<[f32; 4]> =
        depths.iter().flat_map(|&depth| [[0.0; 4], [0.0, 0.0, depth, 0.0], [0.0; 4]]).collect();

    let upload = |values: &[u32]| gpu.upload("test", values).unwrap();
    let projected = gpu.upload("test", &projected).unwrap();
    let [tile_list, place_list, gaussian_list] =
        [&tiles, &places, &gaussians].map(|list| upload(&[&list[..], &[UNTOUCHED]].concat()));
    let list = gpu.upload("test", &vec![[UNTOUCHED; 2]; total + 1]).unwrap();
    let (list_lengths, ranges) = (upload(lengths), upload(&vec![UNTOUCHED; 3 * lengths.len()]));
    let count = upload(&[total as u32]);
    let frame = ViewUniforms {
        count: GAUSSIANS,
        capacity: total as u32,
        size: [columns * TILE, rows * TILE],
        ..ViewUniforms::default()
    };
    let place = TilePlaceBindings {
        projected: &projected,
        count: &count,
        isect_tiles: &tile_list,
        isect_places: &place_list,
        isect_to_gaussian: &gaussian_list,
        tile_ranges: &ranges,
        list: &list,
    };
    sort(gpu, &frame, &list_lengths, &place);

    assert_eq!(gpu.read(&list_lengths, lengths.len()).unwrap(), vec![0; lengths.len()], "lengths");
    let mut start = 0;
    let expected: Vec<u32> = lengths
        .iter()
        .flat_map(|length| {
            start += length;
            [start - length, start]
        })
        .collect();
    assert_eq!(gpu.read(&ranges, expected.len()).unwrap(), expected, "ranges of {lengths:?}");
    let ranges = gpu.read(&ranges, 3 * lengths.len()).unwrap();
    let (tiles_in_order, behind) = ranges[2 * lengths.len()..].split_at(existing as usize);
    assert_eq!(behind, [UNTOUCHED]);
    let mut all = tiles_in_order.to_vec();
    all.sort_unstable();
    assert_eq!(all, (0..existing).collect::<Vec<_>>(), "each tile once");
    let by_length: Vec<u32> = tiles_in_order.iter().map(|&tile| lengths[tile as usize].max(8)).collect();
    assert!(by_length.is_sorted_by(|a, b| a + a / 8 >= *b), "order of the tiles: {by_length:?}");
    let emitted: Vec<u32> = (0..total as u32).collect();
    let order: Vec<(u32, u32)> =
        tiles.iter().zip(&gaussians).map(|(&tile, &g)| (tile, depths[g as usize].to_bits())).collect();
    let (_, mut order) = stable_sort(&order, &emitted);
    // The list of the tile that does not exist is not sorted.
    let listed = total - lengths[existing as usize] as usize;
    order.truncate(listed);
    let found = gpu.read(&place_list, total + 1).unwrap();
    assert!(found[..listed] == order, "order of {lengths:?}");
    assert_eq!(found[total], UNTOUCHED);
    let found = gpu.read(&tile_list, listed).unwrap();
    let expected: Vec<u32> = order.iter().map(|&k| gaussians[k as usize]).collect();
    assert!(found == expected, "Gaussians of {lengths:?}");
}

#[test]
fn lists_of_every_length_are_sorted_by_depth_and_emission() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let block = SORT_BLOCK;
    let small = [0, 1, 2, 3, 7, 31, 32, 33, 255, 256, 257, 1000, 3];
    let whole = [block - 1, block, block + 1, 2 * block, 0, 0, 2 * block + 1, 3 * block - 1, 1, 4 * block, 5, 0, 0];
    let large = [0, 70_001, 3, 5 * block + 77, 0, 0, 0, 0, 0, 0, 0, 20_000, 2];
    for gpu in [gpu(), without_subgroups()] {
        for lengths in [&small, &whole, &large, &[0; 13]] {
            for depth in [equal, of_a_few_values, different, near_and_far] {
                check(&gpu, (lengths, 3), depth, &mut rng);
            }
        }
    }
}

/// More lists than `tile_starts` handles at once: one more, as many twice, and one more than that.
#[test]
fn many_lists_are_placed_and_ordered() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for [columns, rows] in [[32, 32], [89, 23], [64, 32]] {
        let lengths: Vec<u32> = (0..columns * rows + 1).map(|list| list * 7 % 40).collect();
        check(&gpu(), (&lengths, columns), different, &mut rng);
    }
}
