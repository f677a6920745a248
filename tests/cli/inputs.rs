//! Every form of scene trains through the program, and the model finds it again.

use super::{Outcome, Sandbox, files_in};
use exr::prelude::write_rgba_file;
use glam::DVec2;
use ibgs_core::camera::Camera;
use ibgs_core::config::{ExposureSwitch, Strategy, TrainConfig};
use ibgs_core::dataset::Dataset;
use ibgs_core::sources::find::Draw;
use ibgs_testing::TINY;
use ibgs_testing::scene_files::{Model, write_photo, zip_of_folder};
use image::{Rgba, RgbaImage};
use std::fs;
use std::path::Path;

/// A PNG photo as the program wrote it.
fn picture(sandbox: &Sandbox, name: &str) -> image::RgbImage {
    image::open(sandbox.path(name)).unwrap_or_else(|error| panic!("{name}: {error}")).into_rgb8()
}

/// PSNR of the base image as a results file has it.
fn psnr(sandbox: &Sandbox, model: &str, iteration: u32) -> f64 {
    let results = sandbox.json(&format!("{model}/results_renders.json"));
    results[format!("ours_{iteration}")]["PSNR"].as_f64().unwrap()
}

#[test]
fn a_zipped_scene_trains_and_is_found_again() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.write("far/away.zip", zip_of_folder(&sandbox.path("scene"), "tiny demo/"));
    let plain = sandbox.succeeds("train scene --eval --iterations 6 -m plain").stderr;
    assert!(plain.contains("8 training views, 2 test views, 300 initial points"), "{plain}");
    fs::remove_dir_all(sandbox.path("scene")).unwrap();
    // Unpacked files are gone when the program ends.
    let with_temporary = |arguments: &str| {
        let temporary = tempfile::tempdir().unwrap();
        let outcome = Outcome::of(arguments, sandbox.command(arguments).env("TMPDIR", temporary.path()));
        outcome.assert_success();
        let left: Vec<String> = files_in(temporary.path()).into_iter().filter(|f| f.contains("ibgs-scene-")).collect();
        assert!(left.is_empty(), "`ibgs {arguments}` left {left:?}");
        outcome
    };
    let told = with_temporary("train far/away.zip --eval --iterations 6");
    assert!(told.stderr.contains("8 training views, 2 test views, 300 initial points"), "{told}");
    let config = sandbox.text("output/away/config.toml");
    assert!(config.contains("far/away.zip"), "{config}");
    // The same scene gives the same model.
    let ply = "point_cloud/iteration_6/point_cloud.ply";
    let [a, b] = ["plain", "output/away"].map(|model| fs::read(sandbox.path(&format!("{model}/{ply}"))).unwrap());
    assert!(a == b, "the archive gave another model");
    fs::remove_dir_all(sandbox.path("output/away/test")).unwrap();
    with_temporary("eval output/away");
    assert_eq!(psnr(&sandbox, "output/away", 6), psnr(&sandbox, "plain", 6));
    with_temporary("render output/away --outputs final");
    let info = with_temporary("info far/away.zip").stdout;
    assert!(info.contains("away.zip") && info.contains("10 photos, 300 points"), "{info}");
    sandbox.write("far/away.zip", "nothing");
    sandbox.fails("train far/away.zip -m out", &["away.zip", "no whole ZIP archive"]);
    sandbox.fails("eval output/away", &["away.zip", "no whole ZIP archive"]);
}

#[test]
fn a_preset_is_where_the_options_begin() {
    let (sandbox, _) = Sandbox::with_scene();
    let config = |more: &str, model: &str| {
        let told = sandbox.succeeds(&format!("train scene --iterations 3 --method 3dgs {more} -m {model}"));
        assert!(told.stderr.contains(", 3 iterations; writing to"), "{told}");
        TrainConfig::load(&sandbox.path(&format!("{model}/config.toml"))).unwrap()
    };
    let published = config("--preset published --max-splats 2.5k --exposure on", "a");
    assert_eq!((published.densify.strategy, published.sources.draw), (Strategy::Published, Draw::Nearest));
    assert_eq!((published.iterations, published.densify.max_splats), (Some(3), Some(2_500)));
    assert_eq!(published.exposure.enabled, ExposureSwitch::On);
    assert_eq!(config("--preset fast", "b").densify.strategy, Strategy::Default);
}

/// The demo's photos, transparent in their upper third.
fn write_blender_scene(sandbox: &Sandbox, dataset: &Dataset) {
    let camera = &dataset.views[0].camera;
    let angle = 2.0 * (0.5 * f64::from(camera.width) / camera.focal.x).atan();
    for (file, views) in [("train", &dataset.train), ("test", &dataset.test)] {
        let frames: Vec<String> = views
            .iter()
            .map(|&index| {
                let view = &dataset.views[index];
                let photo = RgbaImage::from_fn(TINY[0], TINY[1], |x, y| {
                    let at = 4 * (y * TINY[0] + x) as usize;
                    let [r, g, b] = [0, 1, 2].map(|c| view.photo.pixels().unwrap().rgba[at + c]);
                    Rgba([r, g, b, if y < TINY[1] / 3 { 0 } else { 255 }])
                });
                let name = format!("{file}/r_{index}");
                fs::create_dir_all(sandbox.path(&format!("blender/{file}"))).unwrap();
                photo.save(sandbox.path(&format!("blender/{name}.png"))).unwrap();
                format!(r#"{{"file_path": "./{name}", "transform_matrix": {}}}"#, opengl(&view.camera))
            })
            .collect();
        let json = format!(r#"{{"camera_angle_x": {angle}, "frames": [{}]}}"#, frames.join(","));
        sandbox.write(&format!("blender/transforms_{file}.json"), json);
    }
}

/// Rows of the camera-to-world matrix with OpenGL axes.
fn opengl(camera: &Camera) -> String {
    let world = camera.view_from_world.transpose();
    let (x, y, z, c) = (world.x_axis, -world.y_axis, -world.z_axis, camera.center());
    let row = |i: usize| format!("[{:?},{:?},{:?},{:?}]", x[i], y[i], z[i], c[i]);
    format!("[{},{},{},[0,0,0,1]]", row(0), row(1), row(2))
}

#[test]
fn blender_scenes_train_and_are_measured_over_their_background() {
    let (sandbox, dataset) = Sandbox::with_scene();
    write_blender_scene(&sandbox, &dataset);
    let test = dataset.test[0];
    sandbox.write("few.toml", "[data]\nrandom-points = 1500\n");
    let mut means = Vec::new();
    for (option, corner) in [("--background black", [0; 3]), ("", [255; 3])] {
        let model = format!("out{}", corner[0]);
        let train = "train blender --config few.toml --eval --iterations 20 --method 3dgs";
        let outcome = sandbox.succeeds(&format!("{train} -m {model} {option}"));
        // At most 150 for each photo.
        assert!(outcome.stderr.contains("8 training views, 2 test views, 1200 initial points"), "{outcome}");
        assert!(outcome.stderr.contains("the scene has no initial points"), "{outcome}");
        let truth = picture(&sandbox, &format!("{model}/test/ours_20/gt/test/r_{test}.png"));
        assert_eq!(truth.get_pixel(3, 3).0, corner);
        let trained = psnr(&sandbox, &model, 20);
        fs::remove_dir_all(sandbox.path(&format!("{model}/test"))).unwrap();
        sandbox.succeeds(&format!("eval {model}"));
        // Files hold single precision in the scene's coordinates, the training in local ones.
        let reopened = psnr(&sandbox, &model, 20);
        assert!((reopened - trained).abs() < 1e-4, "{reopened} dB, {trained} dB when it was trained");
        let truth = picture(&sandbox, &format!("{model}/test/ours_20/gt/test/r_{test}.png"));
        assert_eq!(truth.get_pixel(3, 3).0, corner);
        // The model's own background is the photo's.
        let render = picture(&sandbox, &format!("{model}/test/ours_20/renders/test/r_{test}.png"));
        let sum: u32 = render.rows().take(5).flatten().flat_map(|p| p.0).map(u32::from).sum();
        means.push(f64::from(sum) / f64::from(3 * TINY[0] * 5));
    }
    println!("mean level where nothing is: {:.0} on black, {:.0} on white", means[0], means[1]);
    assert!(means[1] > means[0] + 30.0, "{means:?}");
    let masked =
        sandbox.succeeds("train blender --config few.toml --alpha mask --iterations 2 --method 3dgs -m masked");
    assert!(!masked.stderr.contains("background colour"), "{masked}");
    assert!(sandbox.text("masked/config.toml").contains("alpha = \"mask\""));
}

/// As above, with the transparent part as emptiness in place of a picture of the background.
#[test]
fn objects_are_measured_over_the_background() {
    let (sandbox, dataset) = Sandbox::with_scene();
    write_blender_scene(&sandbox, &dataset);
    let test = dataset.test[0];
    sandbox.write("few.toml", "[data]\nrandom-points = 1500\n");
    for (option, corner, background) in [("--background black", [0; 3], "black"), ("", [255; 3], "white")] {
        let model = format!("out{}", corner[0]);
        let train = "train blender --config few.toml --eval --iterations 20 --masks object";
        let outcome = sandbox.succeeds(&format!("{train} -m {model} {option}"));
        assert!(outcome.stderr.contains("10 photos of an object"), "{outcome}");
        assert!(sandbox.text(&format!("{model}/config.toml")).contains("masks = \"object\""));
        let trained = psnr(&sandbox, &model, 20);
        for file in ["results_renders.json", "results_renders_aggregate.json"] {
            let results = sandbox.json(&format!("{model}/{file}"));
            let masks = results["ours_20"]["protocol"]["masks"].as_str().unwrap().to_owned();
            assert_eq!(masks, format!("object, photos over {background}"));
        }
        fs::remove_dir_all(sandbox.path(&format!("{model}/test"))).unwrap();
        let told = sandbox.succeeds(&format!("eval {model} --precision full"));
        // The model of the training itself was not yet rounded to the units of the point cloud's file: a pixel may differ by one.
        assert!((psnr(&sandbox, &model, 20) - trained).abs() < 1e-4, "{trained}: {told}");
        let truth = picture(&sandbox, &format!("{model}/test/ours_20/gt/test/r_{test}.png"));
        assert_eq!(truth.get_pixel(3, 3).0, corner);
        assert!(sandbox.text(&format!("{model}/report.html")).contains("masks object"));
    }
    sandbox.fails("train blender --masks object --alpha composite -m x", &["--alpha", "`--masks` is `object`"]);
    sandbox.fails("train --masks object -m x", &["--masks", "demo scene"]);
}

#[test]
fn photos_of_linear_light_train_as_those_of_srgb() {
    let (sandbox, _) = Sandbox::with_scene();
    let options = "--eval --iterations 4 --method 3dgs";
    sandbox.succeeds(&format!("train scene {options} -m png"));
    let folder = sandbox.path("scene/images");
    for name in files_in(&folder) {
        let path = folder.join(&name);
        let photo = image::open(&path).unwrap().into_rgb8();
        let linear = |level: u8| {
            let v = f32::from(level) / 255.0;
            if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        };
        let pixel = |x: usize, y: usize| {
            let [r, g, b] = photo.get_pixel(x as u32, y as u32).0.map(linear);
            (r, g, b, 1.0_f32)
        };
        write_rgba_file(path.with_extension("exr"), photo.width() as usize, photo.height() as usize, pixel).unwrap();
        fs::remove_file(path).unwrap();
    }
    sandbox.succeeds(&format!("train scene {options} -m exr"));
    let ply = "point_cloud/iteration_4/point_cloud.ply";
    let [a, b] = ["png", "exr"].map(|model| fs::read(sandbox.path(&format!("{model}/{ply}"))).unwrap());
    assert!(a == b, "photos of the same colours gave other models");
    sandbox.succeeds(&format!("train scene {options} --color-space srgb -m raw"));
    let mean = |model: &str| {
        let truth = picture(&sandbox, &format!("{model}/test/ours_4/gt/images/view_000.png"));
        truth.as_raw().iter().map(|v| f64::from(*v)).sum::<f64>() / truth.as_raw().len() as f64
    };
    assert!(mean("raw") < 0.8 * mean("exr"), "{} {}", mean("raw"), mean("exr"));
    assert!(sandbox.text("raw/config.toml").contains("color-space = \"srgb\""));
}

/// Photos of the demo scene through its pinholes, and as equidistant fisheyes of the same focal length see it. Both are
/// means over each pixel: single rays would be full of steps.
fn write_photos(pinhole: &Path, fisheye: &Path, dataset: &Dataset) {
    const PARTS: u32 = 4;
    for view in &dataset.views {
        let camera = &view.camera;
        let photo = ibgs_demo::render_photo(camera, PARTS);
        let photo = RgbaImage::from_raw(photo.width, photo.height, photo.rgba).unwrap();
        photo.save(pinhole.join(&view.name)).unwrap();
        // Twice the view, twice as fine.
        let wide = camera.resized(4 * camera.width, 4 * camera.height);
        let wide = Camera { focal: camera.focal * 2.0, ..wide };
        let seen = ibgs_demo::render_photo(&wide, 2);
        let part = |x: f64, y: f64| {
            let q = (DVec2::new(x, y) - camera.principal) / camera.focal;
            let p = q * if q.length() > 0.0 { q.length().tan() / q.length() } else { 1.0 };
            let at = (p * wide.focal + wide.principal).clamp(DVec2::ZERO, DVec2::new(191.0, 143.0)).as_uvec2();
            let from = 4 * (at.y * wide.width + at.x) as usize;
            [0, 1, 2].map(|c| u32::from(seen.rgba[from + c]))
        };
        let mean = |x: u32, y: u32| {
            let offsets = (0..PARTS * PARTS).map(|i| [x * PARTS + i % PARTS, y * PARTS + i / PARTS]);
            let parts = offsets.map(|at| at.map(|v| (f64::from(v) + 0.5) / f64::from(PARTS)));
            let sum = parts.map(|[x, y]| part(x, y)).fold([0; 3], |sum, p| [0, 1, 2].map(|c| sum[c] + p[c]));
            let [r, g, b] = sum.map(|v| (v / (PARTS * PARTS)) as u8);
            Rgba([r, g, b, 255])
        };
        RgbaImage::from_fn(camera.width, camera.height, mean).save(fisheye.join(&view.name)).unwrap();
    }
}

#[test]
fn fisheye_photos_train_and_show_what_a_pinhole_would() {
    let (sandbox, dataset) = Sandbox::with_scene();
    let options = "--eval --iterations 4 --method 3dgs";
    fs::create_dir(sandbox.path("pinhole")).unwrap();
    write_photos(&sandbox.path("pinhole"), &sandbox.path("scene/images"), &dataset);
    let json = sandbox.text("scene/transforms.json");
    assert!(json.contains("\"OPENCV\""), "{json}");
    sandbox.write("scene/transforms.json", json.replace("\"OPENCV\"", "\"OPENCV_FISHEYE\""));
    let outcome = sandbox.succeeds(&format!("train scene {options} -m fisheye"));
    assert!(outcome.stderr.contains("10 photos through a fisheye"), "{outcome}");
    // Means of 4 x 4 pixels: single ones of this size are full of steps.
    let coarse = |name: &str| image::imageops::thumbnail(&picture(&sandbox, name), 12, 9).into_raw();
    let pinhole = coarse("pinhole/view_000.png");
    let mean = |other: Vec<u8>| {
        let errors = pinhole.iter().zip(&other).map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs());
        errors.sum::<f64>() / pinhole.len() as f64
    };
    let as_taken = mean(coarse("scene/images/view_000.png"));
    let undistorted = mean(coarse("fisheye/test/ours_4/gt/images/view_000.png"));
    println!("mean difference from the pinhole's photo: {undistorted:.2} levels, {as_taken:.2} as taken");
    assert!(undistorted < 4.0 && as_taken > 1.5 * undistorted, "{undistorted} {as_taken}");
    let info = sandbox.succeeds("info scene").stdout;
    assert!(info.contains("OPENCV_FISHEYE") && info.contains("undistorted on load"), "{info}");
}

#[test]
fn unreliable_points_are_left_out_when_asked() {
    let sandbox = Sandbox::new();
    let mut model = Model::small(4);
    let point = model.points[0].clone();
    model.points = (0..12).map(|_| point.clone()).collect();
    for (i, point) in model.points.iter_mut().enumerate() {
        point.xyz[0] = 0.1 * i as f64;
        point.track = if i < 7 { vec![(1, 0), (2, 0), (3, 0)] } else { vec![(1, 0), (2, 0)] };
    }
    model.write_photos(&sandbox.path("scene"));
    model.write_binary(&sandbox.path("scene"));
    let run = |options: &str| sandbox.succeeds(&format!("train scene --iterations 2 --method 3dgs {options}")).stderr;
    assert!(run("-m all").contains("12 initial points"));
    let told = run("-m some --filter-points");
    assert!(told.contains("5 of 12 points left out") && told.contains("7 initial points"), "{told}");
    assert!(sandbox.text("some/config.toml").contains("filter-points = true"));
}

#[test]
fn info_shows_the_layout_poses_sizes_and_split_of_a_scene() {
    let sandbox = Sandbox::new();
    let scene = sandbox.path("scene");
    let mut part = Model::small(9);
    part.write_photos(&scene);
    part.images.truncate(2);
    part.write_binary_to(&scene.join("sparse/0"));
    let mut main = Model::small(8);
    main.images[0].name = "gone.png".to_owned();
    main.write_binary_to(&scene.join("sparse/1"));
    for mask in ["masks/a5_mask.png", "images/a6.png.mask.png", "masks/a5-mask.png"] {
        write_photo(&scene.join(mask), 12, 8, |_, _| [255; 4]);
    }
    let shown = sandbox.succeeds("info scene").stdout;
    for line in [
        "scene: COLMAP, binary scene, 8 photos, 2 points",
        "   read from sparse/1/images.bin",
        "   2 COLMAP models that do not connect, the first is used: sparse/1 with 8 photos, sparse/0 with 2 photos",
        "   7 photos with a pose, 2 without, for instance images/a0.png",
        "   1 photo not found, for instance gone.png",
        "   7 photos of 12 x 8",
        "   masks of 2 of 7 photos",
        "   note: 1 of 2 files in masks belong to no photo with a pose and are not used: masks/a5-mask.png",
        "   with `--eval` 6 train and 1 are held out: every 8th photo by name",
        "   camera 1: PINHOLE 12 x 8",
    ] {
        assert!(shown.lines().any(|shown| shown.starts_with(line)), "`{line}` is not in:\n{shown}");
    }
    // Nothing is promised that a training refuses.
    main.cameras[0].model = (11, "RAD_TAN_THIN_PRISM_FISHEYE");
    main.cameras[0].params = vec![10.0; 16];
    main.write_binary_to(&scene.join("sparse/1"));
    let shown = sandbox.succeeds("info scene").stdout;
    assert!(shown.contains("8 photos, not supported"), "{shown}");
    assert!(shown.contains("`ibgs train` refuses it: ") && shown.contains("undistort the photos first"), "{shown}");
    assert!(!shown.contains("undistorted on load") && !shown.contains("held out"), "{shown}");
}
