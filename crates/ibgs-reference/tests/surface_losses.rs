//! The losses of the image-based stage against finite differences.

use ibgs_reference::exposure::{Exposure, Image};
use ibgs_reference::finite::assert_gradient;
use ibgs_reference::image_loss::Map;
use ibgs_reference::normal_loss::{Surface, normal_loss, normal_loss_backward};
use ibgs_reference::photometric_loss::{Masked, photometric_loss, photometric_loss_backward};
use ibgs_reference::random_scene::{random_camera, random_image};

const TOLERANCE: f64 = 1e-6;

#[test]
fn normal_loss_gradients_agree_with_finite_differences() {
    let camera = random_camera(11, 7, 3);
    let mut depth: Vec<f64> = random_image(11, 7, 2.0, 3.0, 1).iter().map(|v| v[0]).collect();
    let normal = random_image(11, 7, -1.0, 1.0, 2);
    let valid: Vec<bool> = (0..depth.len()).map(|i| i % 7 != 3).collect();
    let seen = Surface { camera: &camera, valid: &valid };
    let (v_depth, v_normal) = normal_loss_backward(seen, &depth, &normal, 0.7);
    let by_depth = assert_gradient("depth", &depth, &v_depth, TOLERANCE, |z| normal_loss(seen, z, &normal, 0.7));
    let by_normal = assert_gradient("normal", normal.as_flattened(), v_normal.as_flattened(), TOLERANCE, |n| {
        normal_loss(seen, &depth, n.as_chunks().0, 0.7)
    });
    println!("by depth {by_depth:.1e}, by normal {by_normal:.1e}");
    // Two pairs without depth: no normal, no gradient.
    for at in [5 * 11 + 4, 5 * 11 + 6, 2 * 11 + 2, 4 * 11 + 2] {
        depth[at] = 0.0;
    }
    let (v_depth, _) = normal_loss_backward(seen, &depth, &normal, 0.7);
    assert!(v_depth.iter().all(|v| v.is_finite()));
}

#[test]
fn photometric_loss_gradient_agrees_with_finite_differences() {
    let (width, height) = (15, 13);
    let photo = random_image(15, 13, 0.0, 1.0, 4);
    let valid: Vec<bool> = (0..photo.len()).map(|i| i % 9 != 4).collect();
    let target = Masked { photo: &photo, valid: &valid, width, height };
    let level = random_image(15, 13, 0.0, 1.0, 5);
    let visible = [0.3, 0.7].map(|limit| level.iter().map(|v| v[0] > limit).collect::<Vec<bool>>());
    let warped = [random_image(15, 13, 0.0, 1.0, 6), random_image(15, 13, 0.0, 1.0, 7)];
    let split = |v: &[f64]| -> Vec<Map> { v.as_chunks().0.chunks(width * height).map(<[_]>::to_vec).collect() };
    let flat: Vec<f64> = warped.concat().into_flattened();
    let v = photometric_loss_backward(&target, &warped, &visible, 0.3).concat().into_flattened();
    let worst =
        assert_gradient("warped", &flat, &v, TOLERANCE, |at| photometric_loss(&target, &split(at), &visible, 0.3));
    println!("photometric {worst:.1e}");
}

#[test]
fn exposed_image_gradients_agree_with_finite_differences() {
    let colors = random_image(13, 11, 0.0, 1.0, 8);
    let transmittance = random_image(13, 11, 0.0, 1.0, 9).iter().map(|v| v[0]).collect();
    let v = random_image(13, 11, -1.0, 1.0, 10);
    let image = Image { colors, transmittance, background: [0.9, 0.1, 0.4] };
    let own = Exposure { log_gain: [0.2, -0.3, 0.1], offset: [0.02, -0.05, 0.1] };
    let along = |map: &Map| -> f64 { map.as_flattened().iter().zip(v.as_flattened()).map(|(x, v)| x * v).sum() };
    let (v_image, v_numbers) = image.exposed_backward(&own, &v);
    let by_image = assert_gradient("image", image.colors.as_flattened(), v_image.as_flattened(), TOLERANCE, |x| {
        along(&Image { colors: x.as_chunks().0.to_vec(), ..image.clone() }.exposed(&own))
    });
    let by_numbers = assert_gradient("exposure", &own.numbers(), &v_numbers, TOLERANCE, |x| {
        along(&image.exposed(&Exposure::from_numbers(x.try_into().unwrap())))
    });
    println!("by image {by_image:.1e}, by exposure {by_numbers:.1e}");
}
