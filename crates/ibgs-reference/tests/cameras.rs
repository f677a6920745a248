//! Gradients by the cameras of target and sources against finite differences.

use ibgs_data::camera_change::CameraChange;
use ibgs_reference::camera_gradient::camera_gradient;
use ibgs_reference::finite::assert_gradient;
use ibgs_reference::geometry_backward::Cotangents;
use ibgs_reference::random_scene::random_image;
use ibgs_reference::surface_scene::{GROUPS, Scene, only, wall};

use crate::geometry::loss;

fn cotangents(scene: &Scene, seed: u64) -> Cotangents {
    let image = |salt: u64| random_image(scene.camera.width, scene.camera.height, -1.0, 1.0, 20 * seed + salt);
    let scalars = |salt: u64| image(salt).into_iter().map(|v| v[0]);
    Cotangents {
        base: image(0),
        normal: image(1),
        depth: scalars(2).collect(),
        warped: (3..6).flat_map(image).collect(),
        cosine: (6..9).flat_map(scalars).collect(),
    }
}

/// What does not depend on what: the normal map knows no lens, nothing but warped colours and cosines knows the sources, and
/// the cosine knows where a source stands alone.
fn independent(group: &str, camera: usize, number: usize) -> bool {
    match (group, camera) {
        ("base" | "normal" | "depth", 1..) => true,
        ("cosine", 1..) => number >= 3,
        _ => false,
    }
}

#[test]
fn every_number_of_every_camera_agrees_with_finite_differences() {
    let mut worst = 0.0f64;
    for (seed, k) in [(1, 4), (2, 2)] {
        let scene = wall(seed, k);
        let (geometry, _) = scene.run();
        let start = scene.outputs();
        let all = cotangents(&scene, seed);
        for group in GROUPS {
            let v = only(&all, group);
            let (target, sources) =
                camera_gradient(&scene.params, &scene.camera, scene.background, &geometry, &scene.sources, &v);
            for (camera, gradient) in std::iter::once(target).chain(sources).enumerate() {
                let ours = gradient.to_array();
                let label = format!("seed {seed} {group}, camera {camera}");
                if independent(group, camera, 0) {
                    assert_eq!(ours, [0.0; CameraChange::NUMBERS], "{label}");
                    continue;
                }
                let counts = |number: &usize| !independent(group, camera, *number);
                let numbers: Vec<usize> = (0..CameraChange::NUMBERS).filter(counts).collect();
                let moved_loss = |values: &[f64]| {
                    let mut change = [0.0; CameraChange::NUMBERS];
                    numbers.iter().zip(values).for_each(|(number, value)| change[*number] = *value);
                    let change = CameraChange::from_array(change);
                    let mut moved = scene.clone();
                    match camera.checked_sub(1) {
                        None => moved.camera = moved.camera.changed(&change),
                        Some(source) => {
                            let camera = &mut moved.sources[source].camera;
                            *camera = camera.changed(&change);
                        }
                    }
                    loss(&moved.outputs(), &start, &v)
                };
                let ours: Vec<f64> = numbers.iter().map(|number| ours[*number]).collect();
                let error = assert_gradient(&label, &vec![0.0; numbers.len()], &ours, 1e-4, moved_loss);
                println!("{label}: worst relative error {error:.1e}");
                worst = worst.max(error);
            }
        }
    }
    println!("worst of all: {worst:.1e}");
}
