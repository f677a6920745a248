//! The radix sort against its twin.

use crate::common::gpu;
use crate::reference::sort::stable_sort;
use ibgs_core::gpu::Pass;
use ibgs_core::gpu::sort::Sort;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub(super) const SIZES: [usize; 12] = [0, 1, 2, 255, 256, 257, 2047, 2048, 2049, 65_537, 600_001, 1 << 20];

fn check_sort(keys: &[u32], live: usize, bits: u32) {
    let gpu = gpu();
    let sort = Sort::new(&gpu, keys.len()).unwrap();
    gpu.queue.write_buffer(&sort.keys[0].buffer, 0, bytemuck::cast_slice(keys));
    let count = gpu.upload("count", &[live as u32]).unwrap();
    let mut pass = Pass::new(&gpu, "test");
    let result = sort.record(&mut pass, &count, bits);
    pass.submit();
    let live = live.min(keys.len());
    let mask = if bits >= 32 { u32::MAX } else { (1u32 << bits.next_multiple_of(8)) - 1 };
    let masked: Vec<u32> = keys[..live].iter().map(|k| k & mask).collect();
    let positions: Vec<u32> = (0..live as u32).collect();
    let (_, order) = stable_sort(&masked, &positions);
    let ours: Vec<u32> = gpu.read(&sort.values[result], live).unwrap();
    assert!(ours == order, "{live} keys, {bits} bits: order");
    let sorted: Vec<u32> = gpu.read(&sort.keys[result], live).unwrap();
    assert!(sorted.iter().zip(&order).all(|(k, i)| *k == keys[*i as usize]), "{live} keys, {bits} bits: keys");
}

#[test]
fn sorts_of_every_size_are_stable() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for n in SIZES {
        let keys: Vec<u32> = (0..n).map(|_| rng.random()).collect();
        check_sort(&keys, n, 32);
        // Many equal keys: only a stable sort gives this order.
        let few: Vec<u32> = (0..n).map(|_| rng.random_range(0..5)).collect();
        check_sort(&few, n, 8);
        let tiles: Vec<u32> = (0..n).map(|_| rng.random_range(0..2041)).collect();
        check_sort(&tiles, n, 11);
    }
}

#[test]
fn sort_obeys_a_count_on_the_gpu() {
    let keys: Vec<u32> = (0..10_000u32).rev().collect();
    for live in [0, 1, 2048, 9_999, 10_000, 20_000] {
        check_sort(&keys, live, 32);
    }
    // Keys that are all the same, and depth keys with culled entries at the end.
    check_sort(&vec![0xffff_ffff; 5_000], 5_000, 32);
    let mixed: Vec<u32> =
        (0..5_000).map(|i| if i % 3 == 0 { u32::MAX } else { (1.0f32 + i as f32).to_bits() }).collect();
    check_sort(&mixed, 5_000, 32);
}
