//! From a scene folder to a model, pictures, figures, and back in with every other command.

use super::{Sandbox, Snapshot, files_in, snapshot};
use glam::DVec3;
use ibgs_core::camera::Camera;
use ibgs_core::output::OutputFolder;
use ibgs_testing::TINY;
use serde_json::{Value, json};
use std::fs;

const PLY: &str = "point_cloud/iteration_30/point_cloud.ply";
const NETWORK: &str = "point_cloud/iteration_30/residual_network.safetensors";

/// The results files: base and final image, means and single views.
const RESULTS: [&str; 4] = [
    "results_renders.json",
    "per_view_renders.json",
    "results_renders_aggregate.json",
    "per_view_renders_aggregate.json",
];

#[test]
fn a_scene_becomes_a_model_that_every_command_reads() {
    let (sandbox, told) = Sandbox::with_trained();
    assert!(told.contains("8 training views, 2 test views, 300 initial points"), "{told}");
    assert!(told.contains("trained 30 iterations"), "{told}");
    assert!(told.contains("memory: needs about ") && told.contains(" at 300 Gaussians, "), "{told}");
    // No residual at the first evaluation, base and final image at the last.
    assert!(told.contains("iteration 7: test PSNR "), "{told}");
    assert!(told.contains("iteration 30: test final PSNR ") && told.contains(", base PSNR "), "{told}");
    check_model_folder(&sandbox);
    check_results(&sandbox);
    info(&sandbox);
    render(&sandbox);
    let cameras = OutputFolder::open(&sandbox.path("model")).unwrap().read_cameras().unwrap();
    render_camera_path(&sandbox, &cameras[0].camera);
    render_turntable(&sandbox);
    evaluate(&sandbox);
    bench(&sandbox);
}

/// Exactly the files that a run of 30 iterations leaves, and what is in them.
fn check_model_folder(sandbox: &Sandbox) {
    let pictures = |n: u32, kinds: &[&str]| -> Vec<String> {
        let names =
            kinds.iter().map(|kind| ["000", "008"].map(|v| format!("test/ours_{n}/{kind}/images/view_{v}.png")));
        names.flatten().collect()
    };
    let mut expected: Vec<String> = [
        "cameras.json",
        "config.toml",
        "input.ply",
        "multi_view.json",
        "per_view_renders.json",
        "per_view_renders_aggregate.json",
        "result_training.json",
        "results_renders.json",
        "results_renders_aggregate.json",
        "split.json",
        "training_log.json",
        PLY,
        NETWORK,
        // The first save and evaluation: 7,000 of 30,000 iterations, scaled. The residual begins after 10,000.
        "point_cloud/iteration_7/point_cloud.ply",
    ]
    .map(String::from)
    .into();
    expected.extend(pictures(30, &["gt", "renders", "renders_aggregate"]));
    expected.extend(pictures(7, &["gt", "renders"]));
    expected.sort();
    let mut found = files_in(&sandbox.path("model"));
    found.sort();
    assert_eq!(found, expected);

    let config = sandbox.text("model/config.toml");
    assert!(config.contains("iterations = 30\n") && config.contains("eval = true"), "{config}");
    assert!(config.contains("method = \"ibgs\"\n"), "{config}");
    let cameras = sandbox.json("model/cameras.json");
    assert_eq!((cameras.as_array().unwrap().len(), &cameras[0]["width"]), (10, &json!(TINY[0])));
    let split = sandbox.json("model/split.json");
    assert_eq!(split["test"], json!(["images/view_000.png", "images/view_008.png"]));
    assert_eq!(split["train"].as_array().unwrap().len(), 8);
    let training_views = split["train"].as_array().unwrap();
    let text = sandbox.text("model/multi_view.json");
    let views: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let sources = views.iter().map(|view| view["nearest_name"].as_array().unwrap());
    assert!(views.len() == 10 && sources.clone().flatten().all(|source| training_views.contains(source)), "{text}");
    assert!(views.iter().zip(sources.clone()).all(|(view, sources)| !sources.contains(&view["ref_name"])), "{text}");
    // One view of this small scene looks where no other one does.
    assert!(sources.filter(|sources| !sources.is_empty()).count() >= 8, "{text}");
    let training = &sandbox.json("model/result_training.json")["ours_30"];
    assert!(training["iterations"] == 30 && training["seconds"].as_f64().unwrap() > 0.0, "{training}");
    let stages: Vec<&Value> = training["stages"].as_object().unwrap().values().collect();
    let sum = |field: &str| stages.iter().map(|stage| stage[field].as_f64().unwrap()).sum::<f64>();
    assert!(stages.len() == 3 && sum("iterations") == 30.0, "{training}");
    assert!((sum("seconds") - training["seconds"].as_f64().unwrap()).abs() < 1e-6, "{training}");
    assert!(stages.iter().all(|stage| stage["peak_reserved_bytes"].as_u64().is_none_or(|peak| peak > 0)), "{training}");
}

/// Figures and pictures of the last evaluation, of base and final image.
fn check_results(sandbox: &Sandbox) {
    let mut means = Vec::new();
    for kind in ["renders", "renders_aggregate"] {
        let results = &sandbox.json(&format!("model/results_{kind}.json"))["ours_30"];
        let per_view = &sandbox.json(&format!("model/per_view_{kind}.json"))["ours_30"]["PSNR"];
        let of = |view: &str| per_view[format!("images/view_{view}.png")].as_f64().unwrap();
        let psnr = results["PSNR"].as_f64().unwrap();
        assert!((psnr - (of("000") + of("008")) / 2.0).abs() < 1e-9 && psnr > 5.0, "{results}");
        assert!(results["SSIM"].as_f64().unwrap() > 0.0 && results["LPIPS"].is_null(), "{results}");
        assert_eq!(results["protocol"]["split"], "2 of 10 views, listed in split.json");
        means.push(psnr);
    }
    assert_ne!(means[0], means[1], "the residual changes nothing");
    let aggregate = sandbox.json("model/results_renders_aggregate.json");
    assert!(aggregate["ours_7"].is_null() && !sandbox.json("model/results_renders.json")["ours_7"].is_null());
    for (kind, name) in [("gt", "view_000"), ("renders", "view_008"), ("renders_aggregate", "view_008")] {
        let picture = image::open(sandbox.path(&format!("model/test/ours_30/{kind}/images/{name}.png"))).unwrap();
        assert_eq!([picture.width(), picture.height()], TINY);
    }
    let photo = |path: &str| image::open(sandbox.path(path)).unwrap().into_rgb8();
    assert_eq!(photo("model/test/ours_30/gt/images/view_000.png"), photo("scene/images/view_000.png"));
}

fn info(sandbox: &Sandbox) {
    let scene = sandbox.succeeds("info scene");
    assert!(scene.stdout.contains("10 photos, 300 points") && scene.stdout.contains("32 x 24"), "{scene}");
    let model = sandbox.succeeds("info model");
    for words in [
        "model: model of iteration 30 of 30",
        "10: 8 for training, 2 held out; the first 32 x 24 pixels",
        " weights",
        "final image",
        "base image",
        "ibgs train scene",
        "iterations 7, 30",
        "point cloud 0.",
        "iterations = 30",
    ] {
        assert!(model.stdout.contains(words), "`{words}` is not in {model}");
    }
    let row = |name: &str| model.stdout.lines().find(|line| line.trim_start().starts_with(name)).unwrap().to_owned();
    assert!(row("Gaussians").ends_with(", spherical harmonics of degree 2"), "{model}");
    // How a model is opened is no option of its training.
    assert!(!model.stdout.contains(['{', '}']) && !model.stdout.contains("residual.precision"), "{model}");
    let ply = sandbox.succeeds(&format!("info model/{PLY}"));
    assert!(ply.stdout.contains(" Gaussians, spherical harmonics of degree 2"), "{ply}");
    let adapters = sandbox.succeeds("info");
    assert!(adapters.stdout.starts_with("0: ") && adapters.stdout.contains("usable             yes"), "{adapters}");
    assert!(adapters.stdout.contains("storage binding"), "{adapters}");
    let tested = adapters.stdout.lines().find(|line| line.trim_start().starts_with("self-test")).unwrap();
    assert!(tested.contains("subgroups") && tested.contains("matrix units") && !tested.contains("wrong"), "{adapters}");
    if cfg!(target_os = "linux") {
        kept_tests(sandbox, &adapters.stdout);
    }
}

/// What tests of the adapters came to is kept, and not believed where the file is damaged.
fn kept_tests(sandbox: &Sandbox, told: &str) {
    let folder = sandbox.home.path().join("ibgs/adapters");
    let mut files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let file = files.find(|path| path.to_string_lossy().contains("self-test")).unwrap();
    let kept = fs::read_to_string(&file).unwrap();
    fs::write(&file, kept.replace("matrix units", "units as kept")).unwrap();
    assert!(sandbox.succeeds("info").stdout.contains("units as kept"));
    fs::write(&file, &kept[..kept.len() / 2]).unwrap();
    assert_eq!(sandbox.succeeds("info").stdout, told);
    assert_eq!(fs::read_to_string(&file).unwrap(), kept);
}

/// Rendering from the saved model gives the very pictures of the training's evaluation.
fn render(sandbox: &Sandbox) {
    let before = snapshot(&sandbox.path("model"));
    for kind in ["renders", "renders_aggregate"] {
        fs::remove_file(sandbox.path(&format!("model/test/ours_30/{kind}/images/view_000.png"))).unwrap();
    }
    let outcome = sandbox.succeeds("render model");
    assert!(outcome.stderr.contains("rendering 2 held-out views of 10: base, final"), "{outcome}");
    assert!(
        outcome.stderr.contains("2 views in model/test/ours_30: base in renders, final in renders_aggregate"),
        "{outcome}"
    );
    assert_agree(&snapshot(&sandbox.path("model")), &before);
    let before = snapshot(&sandbox.path("model"));
    sandbox.succeeds("render model");
    assert!(snapshot(&sandbox.path("model")) == before, "the pictures of two commands differ");
    sandbox.succeeds("render model --views train");
    for kind in ["renders", "renders_aggregate"] {
        assert_eq!(files_in(&sandbox.path("model/train/ours_30").join(kind)).len(), 8);
    }
    sandbox.succeeds("render model --views all --iteration 7");
    assert_eq!(files_in(&sandbox.path("model/train/ours_7")).len(), 8, "no residual yet, so base images alone");
}

/// The same files, pictures apart byte for byte. A picture of a saved model may differ from that of the training by one of 255, as the
/// file holds positions and sizes rounded in the scene's units.
fn assert_agree(after: &Snapshot, before: &Snapshot) {
    assert_eq!(after.keys().collect::<Vec<_>>(), before.keys().collect::<Vec<_>>());
    for (path, content) in after {
        let expected = &before[path];
        if content == expected || path.extension().is_none_or(|extension| extension != "png") {
            assert!(content == expected, "{}", path.display());
            continue;
        }
        let [found, expected] =
            [content, expected].map(|png| image::load_from_memory(png.as_ref().unwrap()).unwrap().into_rgb8());
        assert_eq!(found.dimensions(), expected.dimensions(), "{}", path.display());
        let difference = |(a, b): (&u8, &u8)| a.abs_diff(*b);
        let most = found.as_raw().iter().zip(expected.as_raw()).map(difference).max();
        assert!(most <= Some(1), "{}: {most:?}", path.display());
    }
}

/// A frame at the pose of a view shows what the view shows.
fn render_camera_path(sandbox: &Sandbox, camera: &Camera) {
    let mut moved = *camera;
    moved.translation += DVec3::new(0.2, 0.0, 0.0);
    let keys = [camera, &moved].map(|c| {
        let axes = c.view_from_world.transpose();
        let (x, y, z, center) = (axes.x_axis, -axes.y_axis, -axes.z_axis, c.center());
        let rows = [0, 1, 2].map(|i| [x[i], y[i], z[i], center[i]]).concat();
        let matrix = [rows, vec![0.0, 0.0, 0.0, 1.0]].concat();
        let fov = 2.0 * (0.5 * f64::from(c.height) / c.focal.y).atan().to_degrees();
        json!({"camera_to_world": matrix, "fov": fov, "aspect": 4.0 / 3.0})
    });
    let file =
        json!({"camera_path": keys, "render_width": TINY[0], "render_height": TINY[1], "fps": 24, "seconds": 1.0});
    sandbox.write("path.json", file.to_string());
    sandbox.succeeds("render model --camera-path path.json");
    sandbox.succeeds("render model --camera-path path.json --outputs base -o frames");
    assert_eq!(files_in(&sandbox.path("frames")), ["00000.png", "00001.png"]);
    #[cfg(unix)]
    make_video(sandbox);
    let picture = |path: &str| image::open(sandbox.path(path)).unwrap().into_rgb8();
    assert_eq!(picture("frames/00000.png"), picture("model/path/ours_30/renders/00000.png"));
    sandbox.write("another/config.toml", "");
    sandbox.fails("render model -o another", &["another is the folder of another model", "--output"]);
    assert_eq!(files_in(&sandbox.path("another")), ["config.toml"]);
    sandbox.succeeds("render model -o apart");
    for kind in ["renders", "renders_aggregate"] {
        let place = format!("test/ours_30/{kind}/images/view_000.png");
        assert_eq!(picture(&format!("apart/{place}")), picture(&format!("model/{place}")));
        let frame = picture(&format!("model/path/ours_30/{kind}/00000.png"));
        assert_ne!(frame, picture(&format!("model/path/ours_30/{kind}/00001.png")));
        let view = picture(&format!("model/test/ours_30/{kind}/images/view_000.png"));
        let largest = frame.iter().zip(view.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(largest <= 2, "frame and view of {kind} differ by {largest} of 255");
    }
}

/// Frames of a turn around the middle; the model's cameras stand around it.
fn render_turntable(sandbox: &Sandbox) {
    let outcome = sandbox.succeeds("render model --turntable 0.1 --outputs base");
    assert!(outcome.stderr.contains("rendering 3 frames of the turntable: base"), "{outcome}");
    let frames = sandbox.path("model/turntable/ours_30");
    assert_eq!(files_in(&frames), ["00000.png", "00001.png", "00002.png"]);
    let picture = |name: &str| image::open(frames.join(name)).unwrap().into_rgb8();
    assert_eq!(picture("00000.png").dimensions(), TINY.into());
    assert_ne!(picture("00000.png"), picture("00001.png"));
    for wrong in ["0", "-1", "NaN", "4000", "long"] {
        let arguments = format!("render model --turntable={wrong}");
        super::Outcome::of(&arguments, &mut sandbox.command(&arguments)).assert_failure(2, &["--turntable"]);
    }
    for (wrong, words) in [
        ("render model --turntable 1 --camera-path path.json", "cannot be used with"),
        ("render model --video", "required arguments"),
    ] {
        super::Outcome::of(wrong, &mut sandbox.command(wrong)).assert_failure(2, &[words]);
    }
}

/// A video is what the machine's ffmpeg makes of the frames; without one the frames are there, and a sentence.
#[cfg(unix)]
fn make_video(sandbox: &Sandbox) {
    use std::os::unix::fs::PermissionsExt;
    let arguments = "render model --camera-path path.json --outputs base,final -o film --video";
    sandbox.write("bin/none", "");
    let run = || super::Outcome::of(arguments, sandbox.command(arguments).env("PATH", sandbox.path("bin")));
    run().assert_failure(1, &["there is no `ffmpeg`"]);
    assert_eq!(files_in(&sandbox.path("film/renders")), ["00000.png", "00001.png"]);
    // In its place something that tells what it was asked for.
    sandbox.write("bin/ffmpeg", "#!/bin/sh\nfor last; do :; done\necho \"$@\" > \"$last\"\n");
    std::fs::set_permissions(sandbox.path("bin/ffmpeg"), std::fs::Permissions::from_mode(0o755)).unwrap();
    run().assert_success();
    for kind in ["renders", "renders_aggregate"] {
        let asked = sandbox.text(&format!("film/{kind}/film.mp4"));
        // Frames that a longer film left there are no part of it.
        assert!(asked.contains("-frames:v 2 "), "{asked}");
        assert!(asked.contains("-framerate 24 ") && asked.contains(&format!("film/{kind}/%05d.png")), "{asked}");
    }
}

/// Measuring the saved model repeats the figures of the training, from any folder.
fn evaluate(sandbox: &Sandbox) {
    let results = || RESULTS.map(|name| sandbox.json(&format!("model/{name}")));
    let trained = results();
    let outcome = sandbox.succeeds("eval model");
    let measured = results();
    let line = |start: &str| outcome.stdout.lines().find(|line| line.starts_with(start)).unwrap().to_owned();
    let columns = line("mean").split_whitespace().skip(1).map(str::to_owned).collect::<Vec<_>>();
    let (base, image) = (&measured[0]["ours_30"], &measured[2]["ours_30"]);
    let [psnr, ssim] = ["PSNR", "SSIM"].map(|name| [base, image].map(|scores| scores[name].as_f64().unwrap()));
    let expected = [0, 1].map(|i| [format!("{:.3}", psnr[i]), format!("{:.4}", ssim[i])]).concat();
    assert_eq!(columns, expected, "{outcome}");
    // The saved model is the trained one, rounded.
    for (name, now, then) in [("base", base, &trained[0]["ours_30"]), ("final", image, &trained[2]["ours_30"])] {
        let change = |score: &str| (now[score].as_f64().unwrap() - then[score].as_f64().unwrap()).abs();
        assert!(change("PSNR") < 2e-3 && change("SSIM") < 1e-4, "{name}: {now} after {then}");
    }
    let header = line("view ");
    assert!(header.contains("base PSNR") && header.contains("final PSNR"), "{outcome}");
    assert_eq!(line("images/view_008.png").split_whitespace().count(), 5, "{outcome}");
    check_report(sandbox, &outcome.stdout);

    fs::create_dir(sandbox.path("elsewhere")).unwrap();
    let mut command = sandbox.command("eval ../model --iteration 7");
    let outcome = super::Outcome::of("eval ../model", command.current_dir(sandbox.path("elsewhere")));
    outcome.assert_success();
    assert!(!outcome.stdout.contains("final") && !outcome.stdout.contains("FPS_cold"), "{outcome}");
    let report = sandbox.json("model/result_fps_mem.json");
    assert!(report["ours_7"]["FPS_warm"].is_f64() && report["ours_30"]["FPS_warm"].is_f64(), "{report}");
    fs::rename(sandbox.path("scene"), sandbox.path("moved")).unwrap();
    sandbox.fails("eval model", &["scene", "say where it is (`-s SCENE`)"]);
    // The sources are photos.
    sandbox.fails("render model", &["scene", "say where it is (`-s SCENE`)"]);
    sandbox.succeeds("eval model --source moved");
    fs::rename(sandbox.path("moved"), sandbox.path("scene")).unwrap();
}

/// The report of `eval`, printed and in its file.
fn check_report(sandbox: &Sandbox, stdout: &str) {
    let report = &sandbox.json("model/result_fps_mem.json")["ours_30"];
    assert!(!stdout.contains(['{', '}']), "a table has no JSON: {stdout}");
    for name in ["Frames a second, depth maps kept", "Storage: network", "Rendered on", "Training: residual"] {
        assert!(stdout.contains(name), "`{name}` is not in {stdout}");
    }
    for name in ["FPS_cold", "FPS_warm"] {
        assert!(report[name].as_f64().unwrap() > 0.0, "{report}");
    }
    let size = |name: &str| fs::metadata(sandbox.path(name)).unwrap().len();
    let photos = files_in(&sandbox.path("scene/images"))
        .into_iter()
        .filter(|name| !name.contains("_000") && !name.contains("_008"));
    let storage = json!({
        "gaussians": size(&format!("model/{PLY}")),
        "network": size(&format!("model/{NETWORK}")),
        "poses": size("model/cameras.json"),
        "photos": photos.map(|name| size(&format!("scene/images/{name}"))).sum::<u64>(),
        "bundle": null,
    });
    assert_eq!(report["storage_bytes"], storage);
    assert_eq!(report["training"]["iterations"], 30);
}

fn bench(sandbox: &Sandbox) {
    // A model is measured as it computes, and nothing in its folder changes.
    let config = sandbox.text("model/config.toml");
    sandbox.write("model/config.toml", config.replace("used = 4", "used = 2"));
    let before = snapshot(&sandbox.path("model"));
    let outcome = sandbox.succeeds("bench model --iterations 5 --size 24x18");
    assert!(outcome.stdout.contains("24 x 18") && outcome.stdout.contains(", 2 sources"), "{outcome}");
    assert!(snapshot(&sandbox.path("model")) == before);
}

#[test]
fn the_written_options_repeat_the_run_bit_for_bit() {
    let (sandbox, _) = Sandbox::with_scene();
    // The residual begins after 4 iterations; Gaussians are densified after 6 and 9.
    let options = "--iterations 12 --densify-start 3 --densify-interval 3 --densify-end 11 \
        --opacity-reset-interval 1000 --sh-degree 1 --seed 5 --white-background --save-iterations 2,12";
    sandbox.succeeds(&format!("train scene -m first {options}"));
    let model = |folder: &str| {
        let file = |name: &str| fs::read(sandbox.path(&format!("{folder}/point_cloud/iteration_12/{name}"))).unwrap();
        [file("point_cloud.ply"), file("residual_network.safetensors")]
    };
    assert!(sandbox.path("first/point_cloud/iteration_2/point_cloud.ply").is_file());
    assert!(!sandbox.path("first/test").exists() && !sandbox.path("first/results_renders.json").exists());
    sandbox.succeeds("train --config first/config.toml -m second");
    assert!(model("first") == model("second"), "the same options gave another model");
    assert_eq!(sandbox.text("first/config.toml"), sandbox.text("second/config.toml"));
    sandbox.succeeds("train --config first/config.toml -m third --seed 6");
    let other = model("third");
    assert!(model("first").iter().zip(&other).all(|(a, b)| a != b), "another seed gave the same model");
}
