//! The weighted sum of two images against its twin.

use ibgs_reference::gpu::gpu;
use ibgs_reference::random_scene::random_image;
use ibgs_reference::relative_error;
use ibgs_render::ensemble::record_weighted_sum;
use ibgs_render::gpu::Pass;

#[test]
fn a_sum_follows_its_twin_and_ends_with_its_images() {
    let gpu = gpu();
    for [width, height] in [[1, 1], [33, 21], [16, 16]] {
        let values = 3 * (width * height) as usize;
        let image = |seed: u64| random_image(width, height, -0.5, 1.5, seed).into_flattened();
        let single = |image: &[f64]| image.iter().map(|v| *v as f32).collect::<Vec<f32>>();
        let (a, b) = (image(1), image(2));
        let [on_a, on_b] = [&a, &b].map(|image| gpu.upload("image", &single(image)).unwrap());
        for [first, second] in [[0.5, 0.5], [0.75, 0.25], [1.0, -1.0], [0.0, 1.0]] {
            let sum = gpu.upload("sum", &vec![7.0f32; values + 4]).unwrap();
            let mut pass = Pass::new(&gpu, "weighted sum");
            let images = [(first as f32, &on_a), (second as f32, &on_b)];
            record_weighted_sum(&mut pass, values, images, &sum);
            pass.submit();
            let found: Vec<f64> = gpu.read(&sum, values + 4).unwrap().into_iter().map(f64::from).collect();
            let twin: Vec<f64> = a.iter().zip(&b).map(|(a, b)| first * a + second * b).collect();
            let error = relative_error(&found[..values], &twin);
            assert!(error < 1e-6, "{width} x {height}, {first} and {second}: {error:.1e}");
            assert!(found[values..] == [7.0; 4], "nothing beyond the images is written");
        }
    }
}
