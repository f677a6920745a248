//! Values in another order.

use crate::common::gpu;
use bytemuck::bytes_of;
use ibgs_core::gpu::Pass;
use ibgs_shaders::GATHER;
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[test]
fn values_come_in_the_order_of_the_list() {
    let gpu = gpu();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for n in [1, 255, 256, 257, 70_001] {
        let values: Vec<u32> = (0..n).map(|_| rng.random()).collect();
        let mut order: Vec<u32> = (0..n).collect();
        order.shuffle(&mut rng);
        let lists = [&values, &order].map(|list| gpu.upload("list", list).unwrap());
        // One more, which is not written.
        let gathered = gpu.upload("gathered", &vec![7u32; n as usize + 1]).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        pass.linear(&GATHER, &[&lists[0], &lists[1], &gathered], bytes_of(&n), n as usize);
        pass.submit();
        let mut expected: Vec<u32> = order.iter().map(|&i| values[i as usize]).collect();
        expected.push(7);
        assert_eq!(gpu.read::<u32>(&gathered, n as usize + 1).unwrap(), expected, "{n} values");
    }
}
