//! The built-in demo scene: determinism, agreement of its truths, view dependence.

use super::{assert_same, load, tiny};
use glam::{DVec2, DVec3, Vec3};
use ibgs_data::camera::Camera;
use ibgs_demo::{self as demo, DemoOptions};
use std::path::Path;

fn sample_cameras() -> Vec<Camera> {
    demo::cameras(&DemoOptions { width: 48, height: 36, views: 12, ..tiny() })
}

/// World points behind all pixels of a camera.
fn surface(camera: &Camera, truth: &demo::Truth) -> Vec<DVec3> {
    let point = |index: usize| {
        let (x, y) = (index % camera.width as usize, index / camera.width as usize);
        let direction = camera.ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        let t = f64::from(truth.depth[index]) / direction.dot(camera.forward());
        camera.center() + direction * t
    };
    (0..truth.depth.len()).map(point).collect()
}

#[test]
fn same_bytes_in_every_thread_pool() {
    let pool = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        let cache = tempfile::tempdir().expect("folder");
        pool.install(|| load(&tiny(), cache.path()))
    };
    let alone = pool(1);
    assert_same(&alone, &pool(1));
    let three = pool(3);
    assert_same(&alone, &three);
    assert_eq!(alone.made_tracks, three.made_tracks);
    let other = load(&DemoOptions { seed: 4, ..tiny() }, tempfile::tempdir().expect("folder").path());
    assert_ne!(alone.views[1].camera, other.views[1].camera, "the seed moves the cameras");
}

#[test]
fn split_sizes_and_names() {
    let cache = tempfile::tempdir().expect("folder");
    let set = load(&tiny(), cache.path());
    assert_eq!(set.test, vec![0, 8]);
    assert_eq!(set.train, vec![1, 2, 3, 4, 5, 6, 7, 9]);
    assert_eq!(set.views[7].name, "view_007.png");
    assert_eq!(set.points.len(), 500);
    for view in &set.views {
        assert_eq!(view.photo.size(), [40, 30]);
        assert_eq!((view.camera.width, view.camera.height), (40, 30));
        assert_eq!(view.photo.pixels().unwrap().rgba.len(), 40 * 30 * 4);
        assert!(view.photo.pixels().unwrap().rgba.chunks_exact(4).all(|pixel| pixel[3] == 255));
    }
}

#[test]
fn neighbouring_cameras_are_close_and_far_enough_from_things() {
    for options in [DemoOptions::small(), DemoOptions::large()] {
        let cameras = demo::cameras(&options);
        for (index, camera) in cameras.iter().enumerate() {
            let clearance = demo::distance_to_surface(camera.center());
            assert!(clearance > 0.4, "camera {index} is {clearance} m from a surface");
            let nearest = cameras
                .iter()
                .enumerate()
                .filter(|(other, _)| *other != index)
                .map(|(_, other)| camera.forward().angle_between(other.forward()).to_degrees())
                .fold(f64::MAX, f64::min);
            assert!(nearest < 20.0, "camera {index} has no neighbour within {nearest} degrees");
        }
    }
}

#[test]
fn depth_lies_on_surfaces_and_reprojects_between_views() {
    let cameras = sample_cameras();
    let truths: Vec<_> = cameras.iter().map(demo::truth).collect();
    for (camera, truth) in cameras.iter().zip(&truths) {
        for point in surface(camera, truth) {
            assert!(demo::distance_to_surface(point) < 1e-5, "{point} is off the surface");
        }
    }
    // What one view sees, another one sees there or something in front of it.
    let (mut agree, mut total) = (0, 0);
    let (camera, truth) = (&cameras[5], &truths[5]);
    for point in surface(&cameras[4], &truths[4]) {
        let (pixel, depth) = camera.project(point);
        if depth <= 0.0 || pixel.min_element() < 0.0 || pixel.x >= 48.0 || pixel.y >= 36.0 {
            continue;
        }
        let one = one_pixel_camera(camera.center(), point);
        let seen = demo::truth(&one);
        let reach = f64::from(seen.depth[0]);
        let distance = point.distance(camera.center());
        assert!(reach < distance + 1e-4, "the ray went through the surface at {point}");
        total += 1;
        agree += usize::from(reach > distance - 1e-4);
        let index = pixel.y as usize * 48 + pixel.x as usize;
        assert!(truth.depth[index] > 0.0);
    }
    assert!(total > 500 && agree * 10 > total * 6, "{agree} of {total} points are seen twice");
}

#[test]
fn depth_agrees_with_rays_against_the_mesh() {
    let mesh = demo::mesh(24);
    let vertex = |i: u32| Vec3::from(mesh.vertices[i as usize]).as_dvec3();
    let camera = sample_cameras()[7];
    let truth = demo::truth(&camera);
    let mut close = 0;
    let picks: Vec<usize> = (0..truth.depth.len()).step_by(23).collect();
    for &index in &picks {
        let uv = DVec2::new((index % 48) as f64 + 0.5, (index / 48) as f64 + 0.5);
        let direction = camera.ray(uv);
        let nearest = mesh
            .triangles
            .iter()
            .filter_map(|t| ray_triangle(camera.center(), direction, t.map(vertex)))
            .fold(f64::MAX, f64::min);
        let depth = nearest * direction.dot(camera.forward());
        // Flat triangles cut a little off the round things; a ray may slip past their edge.
        close += usize::from((depth - f64::from(truth.depth[index])).abs() < 0.004);
    }
    assert!(close + 1 >= picks.len(), "{close} of {} rays agree", picks.len());
}

fn ray_triangle(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let determinant = e1.dot(p);
    if determinant.abs() < 1e-15 {
        return None;
    }
    let s = origin - a;
    let u = s.dot(p) / determinant;
    let q = s.cross(e1);
    let v = direction.dot(q) / determinant;
    let t = e2.dot(q) / determinant;
    // A margin keeps rays from slipping through the shared edges.
    (u >= -1e-9 && v >= -1e-9 && u + v <= 1.0 + 1e-9 && t > 0.0).then_some(t)
}

#[test]
fn normals_are_unit_and_face_the_camera() {
    for camera in sample_cameras() {
        let truth = demo::truth(&camera);
        for (index, normal) in truth.normal.iter().enumerate() {
            let normal = Vec3::from(*normal).as_dvec3();
            let uv = DVec2::new((index % 48) as f64 + 0.5, (index / 48) as f64 + 0.5);
            assert!((normal.length() - 1.0).abs() < 1e-6);
            assert!(normal.dot(camera.ray(uv)) < 0.0, "normal of pixel {index} faces away");
        }
    }
}

#[test]
fn mesh_lies_on_the_surfaces_and_faces_free_space() {
    let mesh = demo::mesh(5);
    for vertex in &mesh.vertices {
        let distance = demo::distance_to_surface(Vec3::from(*vertex).as_dvec3());
        assert!(distance < 1e-6, "{vertex:?} is {distance} m off the surface");
    }
    let cameras = sample_cameras();
    let seen = mesh.visible_from(&cameras);
    assert!(!seen.triangles.is_empty() && seen.triangles.len() < mesh.triangles.len());
    assert!(seen.vertices.len() < mesh.vertices.len());
    // Any visible part faces some camera, so wrong winding would lose walls and balls alike.
    assert!(seen.triangles.len() * 3 > mesh.triangles.len(), "{}", seen.triangles.len());
    let highest = seen.triangles.iter().flatten().max().copied();
    assert_eq!(highest.map(|index| index as usize + 1), Some(seen.vertices.len()));
}

#[test]
fn points_hug_the_surfaces_except_a_few() {
    let cache = tempfile::tempdir().expect("folder");
    let set = load(&DemoOptions { points: 4000, ..tiny() }, cache.path());
    let far = set.points.iter().filter(|p| demo::distance_to_surface(p.position) > 0.045).count();
    assert!((20..=120).contains(&far), "{far} of 4000 points are outliers");
    let mean = set.points.iter().map(|p| demo::distance_to_surface(p.position)).sum::<f64>() / 4000.0;
    assert!((0.003..0.03).contains(&mean), "mean distance {mean} m");
    let mirrored = set.points.iter().filter(|p| p.position.abs().max_element() > 2.7).count();
    assert_eq!(mirrored, 0, "points lie in the mirrored room");
}

#[test]
fn mirrors_show_in_most_views() {
    let cameras = demo::cameras(&DemoOptions { width: 48, height: 36, ..DemoOptions::small() });
    let share = |camera: &Camera| {
        let truth = demo::truth(camera);
        let shiny = truth.object.iter().filter(|&&id| demo::is_view_dependent(id)).count();
        shiny as f64 / truth.object.len() as f64
    };
    let shares: Vec<f64> = cameras.iter().map(share).collect();
    assert!(shares.iter().all(|&share| share > 0.02), "{shares:?}");
    assert!(shares.iter().filter(|&&share| share > 0.08).count() * 4 > shares.len() * 3);
}

/// A camera of one pixel, a millimetre wide on the things, that looks straight at a point.
fn one_pixel_camera(eye: DVec3, target: DVec3) -> Camera {
    Camera { focal: DVec2::splat(1500.0), ..demo::look_at(1, 1, eye, target) }
}

#[test]
fn mirrors_change_with_the_view_and_matt_things_do_not() {
    let cameras = sample_cameras();
    let (camera, other) = (&cameras[3], &cameras[2]);
    let truth = demo::truth(camera);
    let (mut shiny, mut matt) = (Vec::new(), Vec::new());
    for (point, id) in surface(camera, &truth).into_iter().zip(&truth.object) {
        let views = [camera, other].map(|c| one_pixel_camera(c.center(), point));
        let reach = f64::from(demo::truth(&views[1]).depth[0]);
        if *id == demo::LAMP || (reach - point.distance(other.center())).abs() > 1e-4 {
            continue;
        }
        let [a, b] = views.map(|view| demo::render_photo(&view, 3).rgba);
        let change = (0..3).map(|k| f64::from(a[k].abs_diff(b[k]))).sum::<f64>() / 3.0;
        match *id {
            demo::MIRROR | demo::RING => shiny.push(change),
            demo::GLOSSY_SPHERE => {}
            _ => matt.push(change),
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    assert!(shiny.len() > 30 && matt.len() > 200, "{} {}", shiny.len(), matt.len());
    assert!(mean(&shiny) > 30.0, "mirrors change by {} of 255", mean(&shiny));
    assert!(mean(&matt) < 3.0, "matt things change by {} of 255", mean(&matt));
}

#[test]
fn options_out_of_range_name_the_field() {
    let wrong = DemoOptions { views: 1, ..tiny() };
    let error = demo::load(&wrong, Some(Path::new("unused")), &()).expect_err("one view is too few");
    let text = error.to_string();
    assert!(text.contains("`views` is 1") && text.contains("2 to 1000"), "{text}");
}
