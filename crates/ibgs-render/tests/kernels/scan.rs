//! The prefix sum against its twin.

use ibgs_reference::gpu::gpu;
use ibgs_reference::sort::exclusive_scan;
use ibgs_render::gpu::Pass;
use ibgs_render::gpu::scan::Scan;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SIZES: [usize; 12] = [0, 1, 2, 255, 256, 257, 2047, 2048, 2049, 65_537, 600_001, 1 << 20];

#[test]
fn prefix_sums_of_every_size() {
    let gpu = gpu();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for n in SIZES {
        let values: Vec<u32> = (0..n).map(|_| rng.random_range(0..2000)).collect();
        let scan = Scan::new(&gpu, n).unwrap();
        let input = gpu.upload("values", &values).unwrap();
        let sums = gpu.upload("sums", &vec![0xdead_beefu32; n.max(1)]).unwrap();
        let total = gpu.upload("total", &[7u32]).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        scan.record(&mut pass, &input, &sums, &total, n);
        pass.submit();
        let (expected, sum) = exclusive_scan(&values);
        assert_eq!(gpu.read(&sums, n).unwrap(), expected, "{n} values");
        assert_eq!(gpu.read(&total, 1).unwrap()[0], sum, "{n} values");
    }
}
