//! Any unit, any place: the program on a scene in map coordinates, against the same scene as it is.

use super::Sandbox;
use glam::DVec3;
use ibgs_core::camera_path::{Keyframe, KeyframePath};
use ibgs_core::dataset::parse_points_ply;
use ibgs_core::scene::read_ply;
use ibgs_testing::scene_files::copy_scene;
use std::fs;
use std::path::Path;

const SCALE: f64 = 30.0;
const SHIFT: DVec3 = DVec3::new(5e6, -4e6, 100.0);

/// A place of the demo in map coordinates.
fn moved(place: [f64; 3]) -> DVec3 {
    DVec3::from(place) * SCALE + SHIFT
}

fn header(path: &Path) -> String {
    let bytes = fs::read(path).unwrap();
    String::from_utf8_lossy(&bytes).split("end_header").next().unwrap().to_owned()
}

#[test]
fn a_scene_in_map_coordinates_goes_the_whole_way() {
    let (sandbox, dataset) = Sandbox::with_scene();
    copy_scene(&sandbox.path("scene"), &sandbox.path("map"), SCALE, SHIFT);
    for (scene, model) in [("scene", "model"), ("map", "far")] {
        sandbox.succeeds(&format!("train {scene} --iterations 30 --eval --residual-factor 0.25 -m {model}"));
    }
    let psnr = |model: &str, file: &str| {
        sandbox.json(&format!("{model}/results_{file}.json"))["ours_30"]["PSNR"].as_f64().unwrap()
    };
    for file in ["renders", "renders_aggregate"] {
        let (here, there) = (psnr("model", file), psnr("far", file));
        assert!((here - there).abs() < 0.05, "{file}: {here:.3} dB, moved {there:.3} dB");
    }
    files_are_in_scene_coordinates(&sandbox);

    // What was written is read back: the same scores, from the folder and from a bundle.
    let trained = psnr("far", "renders_aggregate");
    sandbox.succeeds("eval far");
    assert!((psnr("far", "renders_aggregate") - trained).abs() < 0.005);
    sandbox.succeeds("export far -o far.ibgs");
    sandbox.succeeds("export far.ibgs -o again.ply");
    assert!(fs::read(sandbox.path("again.ply")).unwrap() == fs::read(sandbox.path(PLY)).unwrap());

    // Its Gaussians are a start in the same scene.
    sandbox.succeeds("train map --iterations 5 --residual-factor 0.25 --init again.ply -m warm");
    let info = sandbox.succeeds("info again.ply").stdout;
    assert!(info.contains("kept around the offset [5000"), "{info}");

    let view = &dataset.views[dataset.test[0]].camera;
    let keyframe =
        |position| Keyframe { position, world_from_view: view.view_from_world.transpose(), fov: 0.9, way: 1.0 };
    for (name, position) in [("here", view.center()), ("there", moved(view.center().to_array()))] {
        let keyframes = vec![keyframe(position)];
        let path =
            KeyframePath { keyframes, width: 48, height: 36, fps: 1.0, seconds: 1.0, cycle: false, eased: false };
        path.save(&sandbox.path(&format!("{name}.json"))).unwrap();
    }
    sandbox.succeeds("render model --camera-path here.json --outputs base -o here");
    sandbox.succeeds("render far --camera-path there.json --outputs base -o there");
    let [here, there] = ["here", "there"].map(|name| {
        let image = image::open(sandbox.path(&format!("{name}/00000.png"))).unwrap();
        image.into_rgb8().into_raw()
    });
    let apart: u64 = here.iter().zip(&there).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    assert!(here.iter().any(|&v| v > 50) && apart < here.len() as u64, "{apart} levels over {} values", here.len());
    mesh_is_in_scene_coordinates(&sandbox);
}

const PLY: &str = "far/point_cloud/iteration_30/point_cloud.ply";

fn files_are_in_scene_coordinates(sandbox: &Sandbox) {
    for name in [PLY, "far/input.ply"] {
        assert!(header(&sandbox.path(name)).contains("\ncomment offset 5000"), "{name}");
        let near = name.replace("far", "model");
        assert!(!header(&sandbox.path(&near)).contains("comment"), "{near}");
    }
    // The same Gaussians are in both, within what so short a training may drift.
    let [near, far] = [PLY.replace("far", "model"), PLY.to_owned()].map(|name| read_ply(&sandbox.path(&name)).unwrap());
    let apart = near.positions().zip(far.positions()).map(|(a, b)| moved(a.to_array()).distance(b) / SCALE);
    let apart: Vec<f64> = apart.collect();
    assert!(apart.iter().sum::<f64>() / (apart.len() as f64) < 0.01, "{:?}", &apart[..5]);
    let points = |name: &str| parse_points_ply(Path::new(name), &fs::read(sandbox.path(name)).unwrap()).unwrap();
    for (a, b) in points("model/input.ply").iter().zip(points("far/input.ply")) {
        assert!(moved(a.position.to_array()).distance(b.position) < 1e-4);
    }
    let cameras = sandbox.json("far/cameras.json");
    let place: Vec<f64> = serde_json::from_value(cameras[0]["position"].clone()).unwrap();
    assert!((DVec3::from_slice(&place) - SHIFT).length() < 10.0 * SCALE);
}

fn mesh_is_in_scene_coordinates(sandbox: &Sandbox) {
    let place = |v: [f64; 3]| moved(v).to_array().map(|v| v.to_string()).join(",");
    let bounds = format!("{},{}", place([-0.8, -0.8, 0.0]), place([0.8, 0.8, 1.2]));
    let options = "--clusters 0 --width 40 --voxel-size";
    sandbox.succeeds(&format!("mesh model {options} 0.1 --bounds -0.8,-0.8,0,0.8,0.8,1.2 -o near.obj"));
    for name in ["far.ply", "far.obj"] {
        sandbox.succeeds(&format!("mesh far {options} 3 --bounds {bounds} -o {name}"));
    }
    assert!(header(&sandbox.path("far.ply")).contains("\ncomment offset 5000"));
    let vertices = |name: &str| -> Vec<DVec3> {
        let text = sandbox.text(name);
        let rows = text.lines().filter_map(|line| line.strip_prefix("v "));
        rows.map(|row| {
            let v: Vec<f64> = row.split(' ').take(3).map(|word| word.parse().unwrap()).collect();
            DVec3::from_slice(&v)
        })
        .collect()
    };
    let (near, far) = (vertices("near.obj"), vertices("far.obj"));
    assert!((near.len() as f64 / far.len() as f64 - 1.0).abs() < 0.2, "{} and {} vertices", near.len(), far.len());
    assert!(far.iter().all(|v| ((*v - SHIFT) / SCALE).abs().max_element() < 1.5));
    // Compared with itself, through its offset, and with a truth that lies a voxel away.
    let compare = format!("mesh far {options} 3 --bounds {bounds} --threshold 0.1 --compare far.ply -o again.ply");
    let told = sandbox.succeeds(&compare).stdout;
    assert!(told.contains("F1 1.0000"), "{told}");
}
