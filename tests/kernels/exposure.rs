//! Exposure correction against its twins.

use crate::common::gpu;
use crate::reference::exposure::{Affine, fit};
use crate::reference::image_loss::Map;
use crate::reference::random_scene::random_image;
use crate::reference::relative_error;
use glam::{DMat3, DVec3};
use ibgs_core::fuse::ExposureFit;
use ibgs_core::gpu::{Buffer, Gpu, Pass};

fn float(map: Map) -> Map {
    map.into_iter().map(|p| p.map(|v| f64::from(v as f32))).collect()
}

fn upload(gpu: &Gpu, map: &[[f64; 3]]) -> Buffer {
    let flat: Vec<f32> = map.as_flattened().iter().map(|v| *v as f32).collect();
    gpu.upload("map", &flat).unwrap()
}

fn read(gpu: &Gpu, buffer: &Buffer, count: usize) -> Vec<f64> {
    gpu.read::<f32>(buffer, count).unwrap().into_iter().map(f64::from).collect()
}

/// A known change of exposure with some mixing of the channels.
fn known() -> Affine {
    let rows = DMat3::from_cols_array(&[1.3, 0.05, -0.02, 0.04, 0.9, 0.03, -0.06, 0.01, 1.1]);
    Affine { linear: rows.transpose(), offset: DVec3::new(0.02, -0.05, 0.1) }
}

/// Fits on the GPU; what is not visible holds another source or nothing, and NaN.
fn on_gpu(base: &Map, warped: &Map, visible: &[bool], size: [u32; 2]) -> (ExposureFit, Vec<f64>) {
    let gpu = gpu();
    let seen = |(i, v): (usize, &bool)| if *v { 0x00ff_0200 } else { [0xffff_ff01, 0xffff_ffff][i % 2] };
    let seen: Vec<u32> = visible.iter().enumerate().map(seen).collect();
    let row = |(p, v): (&[f64; 3], &bool)| {
        let [r, g, b] = p.map(|v| v as f32);
        if *v { [r, g, b, 0.7] } else { [f32::NAN; 4] }
    };
    // A second slot behind the first.
    let mut flat: Vec<f32> = warped.iter().zip(visible).flat_map(row).collect();
    flat.resize(2 * flat.len(), f32::NAN);
    let (warped, seen) = (gpu.upload("warped", &flat).unwrap(), gpu.upload("seen", &seen).unwrap());
    let fit = ExposureFit::new(&gpu).unwrap();
    let mut pass = Pass::new(&gpu, "test");
    fit.record_fit(&mut pass, &upload(&gpu, base), &warped, &seen, size);
    pass.submit();
    let map = read(&gpu, &fit.map, 12);
    (fit, map)
}

fn visible(count: usize, seed: u64, share: f64) -> Vec<bool> {
    random_image(count as u32, 1, 0.0, 1.0, seed).iter().map(|v| v[0] < share).collect()
}

#[test]
fn the_fit_follows_the_twin_and_recovers_a_known_map() {
    for (seed, size) in (0..).zip([[13, 9], [33, 17], [70, 50], [300, 240]]) {
        let [width, height] = size;
        let base = float(random_image(width, height, 0.1, 0.8, seed));
        let noise = random_image(width, height, -0.05, 0.05, seed + 9);
        let seen = visible(base.len(), seed, 0.8);
        for level in [0.0, 1.0] {
            let exposed = |(x, n): (&[f64; 3], &[f64; 3])| {
                let y = known().apply(*x);
                std::array::from_fn(|c| y[c] + level * n[c])
            };
            let warped = float(base.iter().zip(&noise).map(exposed).collect());
            let (_, map) = on_gpu(&base, &warped, &seen, size);
            let twin = fit(&base, &warped, &seen);
            let error = relative_error(&map, &twin.rows());
            let known = relative_error(&map, &known().rows());
            println!("{width} x {height}, noise {level}: {error:.1e} from the twin, {known:.1e} from the truth");
            assert!(error <= 1e-5 && (level > 0.0 || known <= 1e-5), "{width} x {height}: {map:?} against {twin:?}");
        }
    }
}

/// Bright nearly flat colours are where uncentred moments cancel.
#[test]
fn nearly_flat_colours_keep_their_precision() {
    let base = float(random_image(64, 48, 0.90, 0.91, 20));
    let warped = float(base.iter().map(|x| known().apply(*x)).collect());
    let seen = visible(base.len(), 21, 0.5);
    let (_, map) = on_gpu(&base, &warped, &seen, [64, 48]);
    let error = relative_error(&map, &fit(&base, &warped, &seen).rows());
    println!("flat: {error:.1e}");
    assert!(error <= 1e-3, "{map:?}");
}

#[test]
fn without_enough_to_go_by_the_map_is_the_identity() {
    let base = float(random_image(20, 10, 0.0, 1.0, 30));
    let warped = float(base.iter().map(|x| known().apply(*x)).collect());
    let first = |n: usize| (0..base.len()).map(|i| i < n).collect::<Vec<_>>();
    let identity = Affine::IDENTITY.rows();
    let map_of = |base: &Map, seen: &[bool]| {
        let map = on_gpu(base, &warped, seen, [20, 10]).1;
        assert!(relative_error(&map, &fit(base, &warped, seen).rows()) <= 1e-5, "as the twin");
        map
    };
    assert_eq!(map_of(&base, &first(0)), identity, "no pixel");
    assert_eq!(map_of(&base, &first(63)), identity, "63 pixels");
    assert_ne!(map_of(&base, &first(64)), identity, "64 pixels are enough");
    let grey: Map = base.iter().map(|p| [p[0]; 3]).collect();
    assert_eq!(map_of(&grey, &first(200)), identity, "a grey picture");
    assert_eq!(map_of(&vec![[0.5, 0.25, 0.75]; 200], &first(200)), identity, "a flat picture");
    let same = on_gpu(&warped, &warped, &first(200), [20, 10]).1;
    assert!(relative_error(&same, &identity) < 1e-6, "equal exposure: {same:?}");
}

#[test]
fn the_map_is_applied_and_its_gradient_added() {
    let size = [33, 17];
    let base = float(random_image(33, 17, 0.1, 0.8, 40));
    let warped = float(base.iter().map(|x| known().apply(*x)).collect());
    let v_corrected = float(random_image(33, 17, -1.0, 1.0, 41));
    let before = float(random_image(33, 17, -1.0, 1.0, 42));
    let (exposure, _) = on_gpu(&base, &warped, &vec![true; base.len()], size);
    let gpu = gpu();
    let count = 3 * base.len();
    let corrected = gpu.allocate("corrected", 4 * count as u64).unwrap();
    let v_base = upload(&gpu, &before);
    let mut pass = Pass::new(&gpu, "test");
    exposure.record_apply(&mut pass, &upload(&gpu, &base), &corrected, size);
    exposure.record_apply_backward(&mut pass, &upload(&gpu, &v_corrected), &v_base, size);
    pass.submit();
    let twin = fit(&base, &warped, &vec![true; base.len()]);
    let applied: Map = base.iter().map(|x| twin.apply(*x)).collect();
    let error = relative_error(&read(&gpu, &corrected, count), applied.as_flattened());
    let add = |(b, v): (&[f64; 3], &[f64; 3])| -> [f64; 3] {
        let by_base = twin.backward(*v);
        std::array::from_fn(|c| b[c] + by_base[c])
    };
    let added: Map = before.iter().zip(&v_corrected).map(add).collect();
    let back = relative_error(&read(&gpu, &v_base, count), added.as_flattened());
    println!("applied {error:.1e}, backward {back:.1e}");
    assert!(error <= 1e-5 && back <= 1e-5, "{error:e}, {back:e}");
}
