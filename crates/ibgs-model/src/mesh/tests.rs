//! Fusion and marching cubes on surfaces known by formula.

use super::*;
use crate::camera::Camera;
use glam::{DVec2, DVec3, dvec3};
use ibgs_demo::look_at;
use std::collections::HashMap;

const RED: [f32; 3] = [1.0, 0.5, 0.0];

/// Cameras on a ball around the origin that look at it.
fn around(count: usize, distance: f64) -> Vec<Camera> {
    let camera = |i: usize| {
        // A spiral from pole to pole.
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
        let (sin, cos) = (2.4 * i as f64).sin_cos();
        let side = (1.0 - z * z).sqrt();
        Camera {
            focal: DVec2::splat(90.0),
            ..look_at(64, 48, distance * dvec3(side * cos, side * sin, z), DVec3::ZERO)
        }
    };
    (0..count).map(camera).collect()
}

/// The depth map of a camera, from a function that returns the distance to the surface along a unit ray.
fn map(camera: &Camera, reach: impl Fn(DVec3, DVec3) -> Option<f64>) -> DepthMap {
    let count = camera.width as usize * camera.height as usize;
    let depth = |i: usize| {
        let at = DVec2::new((i % camera.width as usize) as f64, (i / camera.width as usize) as f64) + 0.5;
        let ray = camera.ray(at);
        reach(camera.center(), ray).map_or(0.0, |t| (t * ray.dot(camera.forward())) as f32)
    };
    let depths: Vec<f32> = (0..count).map(depth).collect();
    DepthMap::new(*camera, &depths, None, &RED.repeat(count), 80.0)
}

fn sphere(radius: f64) -> impl Fn(DVec3, DVec3) -> Option<f64> {
    move |from: DVec3, ray: DVec3| {
        let (middle, squared) = (-from.dot(ray), from.length_squared() - radius * radius);
        let root = middle * middle - squared;
        (root > 0.0).then(|| middle - root.sqrt())
    }
}

/// A box around the origin.
fn cuboid(half: DVec3) -> impl Fn(DVec3, DVec3) -> Option<f64> {
    move |from: DVec3, ray: DVec3| {
        let (a, b) = ((-half - from) / ray, (half - from) / ray);
        let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
        (enter < leave && enter > 0.0).then_some(enter)
    }
}

fn plan(maps: &[DepthMap], voxel: f64) -> Plan {
    Plan::of(maps, &FusionOptions { voxel: Some(voxel), ..FusionOptions::default() }).unwrap()
}

fn meshed(maps: &[DepthMap], plan: &Plan) -> Mesh {
    let mut mesh = fuse(maps, plan, &()).unwrap().mesh().unwrap();
    mesh.keep_largest(0);
    mesh
}

/// How many triangles run along each directed edge.
fn edges(mesh: &Mesh) -> HashMap<[u32; 2], usize> {
    let mut count = HashMap::new();
    for [a, b, c] in mesh.triangles.iter().copied() {
        for edge in [[a, b], [b, c], [c, a]] {
            *count.entry(edge).or_default() += 1;
        }
    }
    count
}

fn assert_closed(mesh: &Mesh) {
    let edges = edges(mesh);
    for (&[a, b], &count) in &edges {
        assert!(count == 1 && edges.get(&[b, a]) == Some(&1), "edge {a} {b} is not between two triangles");
    }
}

fn points(mesh: &Mesh) -> impl Iterator<Item = DVec3> {
    mesh.positions.iter().map(|&p| glam::Vec3::from(p).as_dvec3())
}

#[test]
fn a_sphere_is_closed_and_looks_outward() {
    let (radius, voxel) = (0.5, 0.04);
    let maps: Vec<DepthMap> = around(24, 1.6).iter().map(|camera| map(camera, sphere(radius))).collect();
    let mut mesh = meshed(&maps, &plan(&maps, voxel));
    assert_closed(&mesh);
    // A closed surface without holes: V - E + F = 2.
    let (v, e, f) = (mesh.positions.len(), edges(&mesh).len() / 2, mesh.triangles.len());
    assert_eq!(v + f, e + 2, "{v} vertices, {e} edges, {f} triangles");
    let errors: Vec<f64> = points(&mesh).map(|p| (p.length() - radius).abs()).collect();
    let (largest, mean) =
        (errors.iter().copied().fold(0.0, f64::max), errors.iter().sum::<f64>() / errors.len() as f64);
    println!("sphere: {f} triangles, error mean {:.4}, largest {:.4} voxels", mean / voxel, largest / voxel);
    assert!(mean < 0.05 * voxel && largest < 0.3 * voxel, "mean {mean}, largest {largest}");
    for (normal, p) in mesh.normals.iter().zip(points(&mesh)) {
        assert!(glam::Vec3::from(*normal).as_dvec3().dot(p.normalize()) > 0.9, "{p}: {normal:?}");
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| glam::Vec3::from(mesh.positions[i as usize]));
        assert!((b - a).cross(c - a).dot(a + b + c) > 0.0, "a triangle looks inward");
    }
    assert!(mesh.colors.iter().all(|color| *color == [255, 128, 0]), "{:?}", mesh.colors[0]);
    assert_eq!(mesh.keep_largest(1), 1);
}

#[test]
fn a_box_has_flat_sides() {
    let (half, voxel) = (dvec3(0.43, 0.31, 0.37), 0.04);
    let maps: Vec<DepthMap> = around(40, 1.8).iter().map(|camera| map(camera, cuboid(half))).collect();
    let mesh = meshed(&maps, &plan(&maps, voxel));
    assert_closed(&mesh);
    // Within the truncation distance of an edge the other side contributes too.
    let mut errors = [Vec::new(), Vec::new()];
    for p in points(&mesh) {
        let beyond = p.abs() - half;
        let sides = beyond.to_array().into_iter().filter(|&d| d > -4.0 * voxel).count();
        errors[usize::from(sides > 1)].push(beyond.max_element().abs() / voxel);
    }
    for (errors, place, most) in [(&errors[0], "sides", [0.1, 0.02]), (&errors[1], "edges", [1.0, 0.25])] {
        let (largest, mean) =
            (errors.iter().copied().fold(0.0, f64::max), errors.iter().sum::<f64>() / errors.len() as f64);
        println!("box, {place}: {} vertices, error mean {mean:.4}, largest {largest:.4} voxels", errors.len());
        assert!(
            errors.len() > 200 && largest < most[0] && mean < most[1],
            "{place}: mean {mean}, largest {largest} voxels"
        );
    }
}

#[test]
fn a_slanted_plane_by_a_single_view_is_exact() {
    // Between pixels the depths are those of the plane, however coarse the image.
    let camera = Camera { focal: DVec2::splat(40.0), ..look_at(40, 30, DVec3::ZERO, DVec3::Y) };
    let (normal, offset) = (dvec3(0.5, -1.0, 0.3).normalize(), -2.0);
    let maps = [map(&camera, |from, ray| Some((offset - normal.dot(from)) / normal.dot(ray)).filter(|&t| t > 0.0))];
    let voxel = 0.03;
    let mesh = meshed(&maps, &plan(&maps, voxel));
    let largest = points(&mesh).map(|p| (normal.dot(p) - offset).abs()).fold(0.0, f64::max);
    println!("plane: {} vertices, error at most {:.5} voxels", mesh.positions.len(), largest / voxel);
    assert!(mesh.triangles.len() > 2000 && largest < 0.01 * voxel, "{} {largest}", mesh.triangles.len());
    assert!(mesh.normals.iter().all(|n| glam::Vec3::from(*n).as_dvec3().dot(normal) > 0.99));
}

#[test]
fn options_take_effect() {
    let cameras = around(24, 1.6);
    let maps: Vec<DepthMap> = cameras.iter().map(|camera| map(camera, sphere(0.5))).collect();
    let base = FusionOptions { voxel: Some(0.05), ..FusionOptions::default() };
    let bounds = [dvec3(-1.0, -1.0, 0.1), dvec3(1.0, 1.0, 0.4)];
    let cut = meshed(&maps, &Plan::of(&maps, &FusionOptions { bounds: Some(bounds), ..base }).unwrap());
    let (low, high) = points(&cut).fold((1.0_f64, -1.0_f64), |(low, high), p| (low.min(p.z), high.max(p.z)));
    assert!((0.1..0.16).contains(&low) && (0.34..0.4).contains(&high), "{low} {high}");
    let near = Plan::of(&maps, &FusionOptions { max_depth: Some(1.2), ..base }).unwrap();
    let whole = Plan::of(&maps, &base).unwrap();
    assert!(meshed(&maps[..1], &near).positions.len() < meshed(&maps[..1], &whole).positions.len());
    // Without a voxel size: a pixel on the surface is larger than a part of the extent here.
    let default = Plan::of(&maps, &FusionOptions::default()).unwrap();
    assert!((default.voxel - 1.2 / 90.0).abs() < 0.003, "{}", default.voxel);
    assert!((default.truncation - 4.0 * default.voxel).abs() < 1e-12 && (3.3..4.5).contains(&default.max_depth));
    // A coarse limit of the angle keeps the middle of the ball alone.
    let depths = vec![2.0; 64 * 48];
    let tilted = [0.0, -0.7, -1.0].repeat(64 * 48);
    let kept = |angle| {
        let map = DepthMap::new(cameras[0], &depths, Some(&tilted), &RED.repeat(64 * 48), angle);
        (0..map.pixels.len()).filter(|&i| map.point(i).is_some()).count()
    };
    assert!(kept(80.0) == 64 * 48 && kept(15.0) < 64 * 48 / 4, "{} {}", kept(80.0), kept(15.0));
}

#[test]
fn what_cannot_be_fused_says_why() {
    let maps: Vec<DepthMap> = around(4, 1.6).iter().map(|camera| map(camera, sphere(0.5))).collect();
    let base = FusionOptions { voxel: Some(0.05), ..FusionOptions::default() };
    let fused = |options: FusionOptions| {
        let plan = Plan::of(&maps, &options)?;
        fuse(&maps, &plan, &())?.mesh()
    };
    let tells = |options: FusionOptions, fragments: &[&str]| {
        let text = fused(options).unwrap_err().to_string();
        assert!(fragments.iter().all(|fragment| text.contains(fragment)), "{text}");
    };
    tells(FusionOptions { voxel: Some(-1.0), ..base }, &["the voxel size is -1", "a positive number"]);
    tells(FusionOptions { voxel: Some(1e-10), ..base }, &["the voxel size is 0.0000000001", "large enough"]);
    tells(FusionOptions { max_depth: Some(f64::NAN), ..base }, &["the largest depth is NaN"]);
    tells(FusionOptions { truncation: 0.5, ..base }, &["the truncation is 0.5", "from 1 to 32 voxels"]);
    tells(FusionOptions { bounds: Some([DVec3::ZERO; 2]), ..base }, &["bounds"]);
    tells(
        FusionOptions { bounds: Some([DVec3::splat(5.0), DVec3::splat(6.0)]), ..base },
        &["no surface within the bounds"],
    );
    tells(FusionOptions { max_depth: Some(0.1), ..base }, &["no surface within the bounds"]);
    tells(
        FusionOptions { memory: Some(150_000), ..base },
        &["voxels of 0.0500", "more memory than the limit of 0 MiB"],
    );
    // The size that it names is enough.
    let Err(MeshError::Voxels { enough, .. }) = fused(FusionOptions { memory: Some(300_000), ..base }) else {
        panic!()
    };
    fused(FusionOptions { voxel: Some(enough), memory: Some(300_000), ..base }).unwrap();
    let empty = [DepthMap::new(around(1, 1.0)[0], &[0.0; 64 * 48], None, &[0.0; 3 * 64 * 48], 80.0)];
    assert!(Plan::of(&empty, &base).unwrap_err().to_string().contains("no surface at all"));
}

#[test]
fn the_same_depths_give_the_same_mesh() {
    let maps: Vec<DepthMap> = around(8, 1.6).iter().map(|camera| map(camera, sphere(0.5))).collect();
    let plan = plan(&maps, 0.05);
    assert!(meshed(&maps, &plan) == meshed(&maps, &plan));
}
