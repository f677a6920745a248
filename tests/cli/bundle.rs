//! A model in one file.

use super::{Sandbox, files_in};
use glam::{DMat3, DVec3};
use ibgs_core::bundle::Packing;
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::similarity::Similarity;
use std::fs;

/// Pictures and results of `test` below a folder, as far as they do not tell the time.
fn shown(sandbox: &Sandbox, folder: &str) -> Vec<(String, Vec<u8>)> {
    let names = files_in(&sandbox.path(folder)).into_iter();
    let names = names.filter(|name| name.starts_with("test/ours_30/") || name.contains("_renders"));
    names.map(|name| (name.clone(), fs::read(sandbox.path(folder).join(name)).unwrap())).collect()
}

/// A bundle shows and measures what its folder does, and renders where there is no scene.
#[test]
fn a_bundle_is_the_model() {
    let (sandbox, _) = Sandbox::with_trained();
    // The first evaluation is no part of a bundle.
    sandbox.succeeds("export model -o small.ibgs");
    fs::remove_dir_all(sandbox.path("model/test")).unwrap();
    for name in files_in(&sandbox.path("model")).into_iter().filter(|name| name.contains("_renders")) {
        fs::remove_file(sandbox.path("model").join(name)).unwrap();
    }
    let tables = ["model", "small.ibgs"].map(|model| {
        let stdout = sandbox.succeeds(&format!("eval {model} --precision full")).stdout;
        stdout.lines().take_while(|line| !line.is_empty()).map(str::to_owned).collect::<Vec<_>>()
    });
    assert_eq!(tables[0], tables[1]);
    let folder = shown(&sandbox, "model");
    assert_eq!(folder.len(), 6 + 4, "{:?}", folder.iter().map(|(name, _)| name).collect::<Vec<_>>());
    assert!(shown(&sandbox, "small") == folder, "folder and bundle differ");
    let report = &sandbox.json("small/result_fps_mem.json")["ours_30"];
    let bytes = fs::metadata(sandbox.path("small.ibgs")).unwrap().len();
    assert_eq!((&report["storage_bytes"]["bundle"], report["FPS_cold"].is_f64()), (&bytes.into(), true), "{report}");

    // The same again from the folder: the same file, but never over another without being asked.
    sandbox.fails("export model -o small.ibgs", &["small.ibgs", "is there already"]);
    let first = fs::read(sandbox.path("small.ibgs")).unwrap();
    sandbox.succeeds("export model -o small.ibgs --overwrite");
    assert!(fs::read(sandbox.path("small.ibgs")).unwrap() == first, "another export gave another file");
    without_its_scene(&sandbox, &folder);
}

/// One with levels of detail shows what its folder does, and gives the same Gaussians back.
#[test]
fn a_bundle_with_levels_is_the_model_too() {
    let (sandbox, _) = Sandbox::with_trained();
    let folder = shown(&sandbox, "model");
    sandbox.succeeds("export model -o chunks.ibgs --levels");
    sandbox.succeeds("eval chunks.ibgs --gpu-memory 2GiB");
    let pictures =
        |all: Vec<(String, Vec<u8>)>| all.into_iter().filter(|(name, _)| name.starts_with("test/")).collect();
    let [expected, found]: [Vec<(String, Vec<u8>)>; 2] = [folder, shown(&sandbox, "chunks")].map(pictures);
    assert_eq!(found.len(), expected.len());
    let info = sandbox.succeeds("info chunks.ibgs");
    assert!(info.stdout.contains("levels of detail"), "{info}");
    let whole = sandbox.succeeds("info model").stdout;
    let count = |text: &str| text.lines().find(|line| line.contains("Gaussians  ")).map(str::to_owned);
    assert_eq!(count(&info.stdout), count(&whole));
    sandbox.succeeds("export chunks.ibgs -o back.ply");
    sandbox.succeeds("export model -o first.ply");
    let size = |name: &str| fs::metadata(sandbox.path(name)).unwrap().len();
    assert_eq!(size("back.ply"), size("first.ply"));
    sandbox.fails("export model -o other.ply --levels", &["--levels", "`.ibgs`"]);
    sandbox.fails("render chunks.ibgs --gpu-memory 1KiB", &["--gpu-memory"]);
}

/// The scene of a bundle that was turned, scaled and moved follows it: held-out photos are compared with views from there.
#[test]
fn a_moved_bundle_is_measured_where_it_stands() {
    let (sandbox, _) = Sandbox::with_trained();
    sandbox.succeeds("export model -o small.ibgs");
    let open = |name: &str| Model::open(&sandbox.path(name), &ModelOptions::default()).unwrap();
    let by = Similarity { scale: 2.0, rotation: DMat3::from_rotation_y(0.7), translation: DVec3::new(5.0, -1.0, 3.0) };
    let mut model = open("small.ibgs");
    model.place(&by);
    model.into_bundle(&()).unwrap().write(&sandbox.path("moved.ibgs"), Packing::Lossless).unwrap();
    fs::rename(sandbox.path("scene"), sandbox.path("elsewhere")).unwrap();
    let [psnr, moved] = ["small", "moved"].map(|name| {
        sandbox.succeeds(&format!("eval {name}.ibgs -s elsewhere"));
        sandbox.json(&format!("{name}/results_renders.json"))["ours_30"]["PSNR"].as_f64().unwrap()
    });
    assert!((psnr - moved).abs() < 0.05, "{psnr} dB, moved {moved} dB");
    fs::rename(sandbox.path("elsewhere"), sandbox.path("scene")).unwrap();
    let [mut model, mut moved] = ["small.ibgs", "moved.ibgs"].map(open);
    let [from, to] = [&mut model, &mut moved].map(|model| model.dataset(&()).unwrap().points.clone());
    assert!(!from.is_empty() && from.len() == to.len());
    let own: Vec<_> = moved.cameras.iter().map(|record| record.camera).collect();
    assert!(moved.dataset(&()).unwrap().views.iter().map(|view| view.camera).eq(own));
    for (from, to) in from.iter().zip(&to) {
        let place = by.point(from.position);
        assert!(place.distance(to.position) < 1e-6, "{} is not {place}", to.position);
    }
}

fn without_its_scene(sandbox: &Sandbox, expected: &[(String, Vec<u8>)]) {
    fs::rename(sandbox.path("scene"), sandbox.path("moved")).unwrap();
    fs::remove_dir_all(sandbox.path("small/test")).unwrap();
    // As precisely as the evaluation.
    sandbox.succeeds("render small.ibgs --precision full");
    let rendered =
        shown(sandbox, "small").into_iter().filter(|(name, _)| name.starts_with("test/")).collect::<Vec<_>>();
    assert_eq!(rendered.len(), 4);
    assert!(
        rendered.iter().all(|picture| expected.contains(picture)),
        "without its scene the bundle shows another view"
    );
    let info = sandbox.succeeds("info small.ibgs");
    for fragment in
        ["bundle of iteration 30 of 30", "the 8 training views are in the bundle", " weights", ", spherical harmonics"]
    {
        assert!(info.stdout.contains(fragment), "{info}");
    }
    assert!(sandbox.succeeds("bench small.ibgs --iterations 5 --size 8x6").stdout.contains(" 8 x 6"));
    sandbox.fails("eval small.ibgs", &["scene"]);
    sandbox.fails("export model -o other.ibgs", &["scene"]);
    // What a bundle holds is enough for another one.
    sandbox.succeeds("export small.ibgs -o again.ibgs");
    assert!(fs::read(sandbox.path("again.ibgs")).unwrap() == fs::read(sandbox.path("small.ibgs")).unwrap());
    // Gaussians alone need neither scene nor GPU, and come from both alike.
    sandbox.succeeds("export model -o folder.ply");
    sandbox.succeeds("export small.ibgs -o bundle.ply");
    sandbox.succeeds("export small.ibgs -o plain.ply --plain");
    let file = |name: &str| fs::read(sandbox.path(name)).unwrap();
    assert!(file("folder.ply") == file("bundle.ply"));
    assert!(file("folder.ply") == file("model/point_cloud/iteration_30/point_cloud.ply"));
    let has_offset = |name: &str| file(name).windows(9).any(|window| window == b" float nd".as_slice());
    assert!(has_offset("folder.ply") && !has_offset("plain.ply"));
    let info =
        ["folder.ply", "plain.ply"].map(|name| sandbox.succeeds(&format!("info {name}")).stdout.replace(name, ""));
    assert_eq!(info[0], info[1]);
}

#[test]
fn bundles_that_cannot_be_used() {
    let (sandbox, _) = Sandbox::with_trained();
    sandbox.succeeds("export model -o a.ibgs");
    let whole = fs::read(sandbox.path("a.ibgs")).unwrap();
    let all_fail = |name: &str, fragments: &[&str]| {
        let fragments = [&[name], fragments].concat();
        for command in [
            "render NAME",
            "eval NAME",
            "export NAME -o other.ibgs",
            "export NAME -o other.ply",
            "info NAME",
            "bench NAME",
        ] {
            sandbox.fails(&command.replace("NAME", name), &fragments);
        }
    };
    all_fail("nowhere.ibgs", &["check the path"]);
    sandbox.write("some.ply", "ply");
    sandbox.fails("render some.ply", &["some.ply is no model", "a bundle in `.ibgs`"]);
    sandbox.fails("render nowhere.ibgs", &["cannot read the bundle nowhere.ibgs"]);
    sandbox.write("b.ibgs", &whole[..whole.len() / 2]);
    all_fail("b.ibgs", &["is no whole `.ibgs` bundle"]);
    sandbox.write("b.ibgs", b"");
    all_fail("b.ibgs", &["is no whole `.ibgs` bundle"]);
    let flipped_behind = |mark: &[u8], distance: usize| {
        let at = whole.windows(mark.len()).position(|window| window == mark).unwrap();
        let mut damaged = whole.clone();
        damaged[at + mark.len() + distance] ^= 16;
        sandbox.write("b.ibgs", damaged);
    };
    for part in ["point_cloud.ply", "network.bin", "photos/images/view_001.png.png"] {
        flipped_behind(part.as_bytes(), 700);
        all_fail("b.ibgs", &["is damaged", part]);
    }
    // A photo is read as a photo, and a bundle is one model.
    sandbox.fails("render scene/images/view_001.png", &["view_001.png"]);
    sandbox.fails("render a.ibgs --iteration 7", &["a.ibgs", "iteration 30", "--iteration"]);
    sandbox.fails("render a.ibgs --resolution 2", &["a.ibgs", "--resolution"]);
    sandbox.fails("render model --resolution 2", &["model", "--resolution"]);
    sandbox.fails("export model -o model.zip", &["model.zip", "`.ibgs` or one of `.compressed.ply`, `.ply`, `.spz`"]);
    sandbox.fails("export model -o b.ibgs --overwrite --plain", &["--plain"]);
    sandbox.fails("export a.ibgs -o scene/transforms.json/b.ply", &["transforms.json"]);
    sandbox.succeeds("render a.ibgs --iteration 30 --outputs base");
}
