//! What goes beyond plain splatting: outputs of the residual and the surface, photos as sources, networks.

use super::{Sandbox, files_in};
use exr::prelude::{ReadChannels, ReadLayers, read};
use ibgs_testing::TINY;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;

const LAST: &str = "model/point_cloud/iteration_30";
const NETWORK: &str = "model/point_cloud/iteration_30/residual_network.safetensors";

/// Channels of an EXR file of a view by name.
fn channels(sandbox: &Sandbox, path: &str) -> BTreeMap<String, Vec<f32>> {
    let file = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
    let layer = file.from_file(sandbox.path(path)).unwrap().layer_data;
    assert_eq!([layer.size.0, layer.size.1].map(|n| n as u32), TINY);
    let values = |channel: &exr::prelude::AnyChannel<exr::prelude::FlatSamples>| {
        (channel.name.to_string(), channel.sample_data.values_as_f32().collect())
    };
    layer.channel_data.list.iter().map(values).collect()
}

/// Interleaved values of three channels.
fn triples(channels: &BTreeMap<String, Vec<f32>>, prefix: &str) -> Vec<f32> {
    let planes = ["R", "G", "B"].map(|letter| &channels[&format!("{prefix}{letter}")]);
    (0..planes[0].len()).flat_map(|i| planes.map(|plane| plane[i])).collect()
}

fn bytes(values: impl IntoIterator<Item = f32>) -> Vec<u8> {
    values.into_iter().map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect()
}

#[test]
fn every_output_as_picture_and_as_values() {
    let (sandbox, _) = Sandbox::with_trained();
    let all = "--outputs final,base,residual,depth,normal,visibility";
    fs::remove_dir_all(sandbox.path("model/test/ours_30")).unwrap();
    // Colours of values are float32, and those of pictures halves unless they are asked for the same.
    sandbox.succeeds(&format!("render model {all} --precision full"));
    sandbox.succeeds(&format!("render model {all} --precision full --exr"));
    let kinds = ["predicted_residual", "renders", "renders_aggregate", "renders_depth", "renders_normal", "visibility"];
    let mut expected: Vec<String> =
        kinds.iter().flat_map(|kind| ["000", "008"].map(|v| format!("{kind}/images/view_{v}.png"))).collect();
    expected.extend(["000", "008"].map(|v| format!("exr/images/view_{v}.exr")));
    expected.sort();
    assert_eq!(files_in(&sandbox.path("model/test/ours_30")), expected);

    let c = channels(&sandbox, "model/test/ours_30/exr/images/view_008.exr");
    assert_eq!(c.len(), 14, "{:?}", c.keys());
    let picture = |kind: &str| {
        let picture = image::open(sandbox.path(&format!("model/test/ours_30/{kind}/images/view_008.png"))).unwrap();
        picture.into_rgb8()
    };
    let (image, base, residual) = (triples(&c, ""), triples(&c, "base."), triples(&c, "residual."));
    assert!(image.iter().zip(&base).zip(&residual).all(|((i, b), r)| i - b == *r));
    assert!(residual.iter().any(|&r| r.abs() > 1e-3), "no residual");
    assert_eq!(picture("renders_aggregate").into_raw(), bytes(image));
    assert_eq!(picture("renders").into_raw(), bytes(base));
    assert_eq!(picture("predicted_residual").into_raw(), bytes(residual.into_iter().map(|r| 0.5 + r)));
    let seen = |&n: &f32| (0.0..=3.0).contains(&n) && n.fract() == 0.0;
    let counts = &c["visibility.N"];
    assert!(counts.iter().all(seen) && counts.iter().any(|&n| n > 0.0), "{counts:?}");
    let black = |kind: &str| {
        picture(kind).pixels().map(|p| p.0 == [0; 3]).take((TINY[0] * TINY[1]) as usize).collect::<Vec<_>>()
    };
    assert!(black("visibility").iter().zip(counts).all(|(black, &n)| *black == (n == 0.0)));
    let depth = &c["depth.Z"];
    assert!(depth.iter().all(|z| z.is_finite() && *z >= 0.0) && depth.iter().any(|&z| z > 0.0));
    assert!(black("renders_depth").iter().zip(depth).all(|(black, &z)| *black == (z == 0.0)));
    // The scale stands below.
    assert_eq!(picture("renders_depth").dimensions(), (TINY[0], TINY[1] + 14));
    assert!(c["normal.Z"].iter().any(|&z| z < 0.0), "no surface faces the camera");
    assert_eq!(picture("renders_normal").dimensions(), TINY.into());

    // What is left out is not there.
    sandbox.succeeds("render model --exr --views all");
    let c = channels(&sandbox, "model/train/ours_30/exr/images/view_001.exr");
    assert_eq!(c.keys().collect::<Vec<_>>(), ["B", "G", "R", "base.B", "base.G", "base.R"]);
}

/// Photos that come and go, on the GPU and on the host, and a base run of the same model, give the same images. (Those of the training itself may differ in the
/// last bit: its model was not yet rounded to the units of the point cloud's file.)
#[test]
fn source_memory_changes_no_picture() {
    let (sandbox, _) = Sandbox::with_trained();
    let pictures = || super::snapshot(&sandbox.path("model/test"));
    sandbox.succeeds("render model");
    let before = pictures();
    fs::remove_dir_all(sandbox.path("model/test/ours_30/renders_aggregate")).unwrap();
    sandbox.succeeds("render model --source-memory 1KiB");
    assert!(pictures() == before, "fewer photos on the GPU gave other pictures");
    fs::remove_dir_all(sandbox.path("model/test/ours_30/renders_aggregate")).unwrap();
    sandbox.succeeds("render model --source-memory 1KiB --host-memory 0");
    assert!(pictures() == before, "fewer photos on the host gave other pictures");
    sandbox.fails("render model --source-memory 1KiB --adapter nosuch", &["nosuch"]);
}

#[test]
fn a_finished_model_is_trained_on() {
    let (sandbox, _) = Sandbox::with_trained();
    let start = format!("{LAST}/point_cloud.ply");
    let outcome = sandbox.succeeds(&format!("train scene --init {start} --iterations 7 --eval -m warm"));
    assert!(outcome.stderr.contains("iteration 7: test final PSNR "), "{outcome}");
    let begins = format!("Gaussians of {} to begin with, 7 iterations", sandbox.path(&start).display());
    assert!(outcome.stderr.contains(&begins), "{begins}\n{outcome}");
    let folder = sandbox.path("warm/point_cloud/iteration_7");
    assert!(folder.join("residual_network.safetensors").is_file());
    let count = |path: &str| {
        let info = sandbox.succeeds(&format!("info {path}")).stdout;
        info.split(": ").nth(1).unwrap().split(' ').next().unwrap().parse::<u32>().unwrap()
    };
    assert_eq!(count("warm/point_cloud/iteration_7/point_cloud.ply"), count(&start), "nothing is densified");
    // The options name the start by a path that holds from everywhere.
    fs::create_dir(sandbox.path("elsewhere")).unwrap();
    let mut command = sandbox.command("train --config ../warm/config.toml -m again");
    let again =
        super::Outcome::of("train --config ../warm/config.toml", command.current_dir(sandbox.path("elsewhere")));
    again.assert_success();
    for name in ["point_cloud.ply", "residual_network.safetensors"] {
        let file = |folder: &str| fs::read(sandbox.path(&format!("{folder}/point_cloud/iteration_7/{name}"))).unwrap();
        assert!(file("warm") == file("elsewhere/again"), "{name} differs");
    }
    sandbox.fails("train scene --init nowhere.ply -m out", &["nowhere.ply"]);
    sandbox.fails("train scene --init scene/points3D.ply -m out", &["points3D.ply", "plain point cloud"]);
}

#[test]
fn plain_splatting_has_no_network() {
    let (sandbox, _) = Sandbox::with_scene();
    let outcome = sandbox.succeeds("train scene --method 3dgs --iterations 12 --eval -m model");
    assert!(outcome.stderr.contains("iteration 12: test PSNR "), "{outcome}");
    let files = files_in(&sandbox.path("model"));
    let beyond = |name: &&String| ["residual", "aggregate", "multi_view"].iter().any(|part| name.contains(part));
    assert_eq!(files.iter().find(beyond), None);
    let ply = fs::read(sandbox.path("model/point_cloud/iteration_12/point_cloud.ply")).unwrap();
    assert!(!ply.windows(9).any(|window| window == b" float nd".as_slice()), "other programs do not know `nd`");
    let outcome = sandbox.succeeds("eval model");
    assert!(!outcome.stdout.contains("final") && !outcome.stdout.contains("FPS_cold"), "{outcome}");
    for output in ["final", "residual", "visibility"] {
        let fragments = ["model", "no residual network", &format!("`{output}`")];
        sandbox.fails(&format!("render model --outputs base,{output}"), &fragments);
    }
    sandbox.fails("render model --views train --outputs base,mask", &["model", "no learned masks", "`mask`"]);
    // The base image needs no photo, and neither does the surface.
    fs::remove_dir_all(sandbox.path("scene")).unwrap();
    fs::remove_dir_all(sandbox.path("model/test/ours_12")).unwrap();
    sandbox.succeeds("render model");
    assert_eq!(files_in(&sandbox.path("model/test/ours_12")).len(), 2);
    sandbox.succeeds("render model --outputs depth,normal --exr");
    let c = channels(&sandbox, "model/test/ours_12/exr/images/view_000.exr");
    assert_eq!(c.keys().collect::<Vec<_>>(), ["depth.Z", "normal.X", "normal.Y", "normal.Z"]);
    assert!(c["depth.Z"].iter().any(|&z| z > 0.0));
    sandbox.fails("eval model", &["scene"]);
}

#[test]
fn networks_and_photos_that_cannot_be_used() {
    let (sandbox, _) = Sandbox::with_trained();
    let all_fail = |fragments: &[&str]| {
        for command in ["render model", "render model --outputs base", "eval model", "export model -o a.ibgs"] {
            sandbox.fails(command, fragments);
        }
    };
    let whole = fs::read(sandbox.path(NETWORK)).unwrap();
    for length in [0, 100, whole.len() - 4] {
        sandbox.write(NETWORK, &whole[..length]);
        all_fail(&[NETWORK, "is not a usable file of network weights"]);
    }
    let mut damaged = whole.clone();
    let last = damaged.len() - 4;
    damaged[last..].copy_from_slice(&f32::NAN.to_le_bytes());
    sandbox.write(NETWORK, damaged);
    all_fail(&[NETWORK, "not a finite number"]);
    // Without its file the model is one of Gaussians alone.
    fs::remove_file(sandbox.path(NETWORK)).unwrap();
    sandbox.fails("render model --outputs final", &["model", "no residual network"]);
    let outcome = sandbox.succeeds("render model --outputs base");
    assert!(outcome.stderr.contains("residual_network.safetensors is missing"), "{outcome}");
    sandbox.write(NETWORK, whole);
    assert!(!sandbox.succeeds("render model --outputs base").stderr.contains("missing"));

    let photo = "scene/images/view_003.png";
    image::RgbImage::new(24, 18).save(sandbox.path(photo)).unwrap();
    for command in ["render model", "eval model", "export model -o a.ibgs"] {
        sandbox.fails(command, &["view_003.png", "size"]);
    }
}

/// Without its photos a model has its base image left.
#[test]
fn photos_that_are_gone() {
    let (sandbox, _) = Sandbox::with_trained();
    let base = |folder: &str| fs::read(sandbox.path(folder).join("test/ours_30/renders/images/view_000.png")).unwrap();
    sandbox.succeeds("render model -o whole");
    assert!(sandbox.succeeds("info model").stdout.contains("those of the 8 training views are in the scene"));
    let lacks = |what: &[&str]| {
        let ways = ["final image needs the photos", "`--outputs base`", "`-s SCENE`"];
        sandbox.fails("render model", &[&ways, what].concat());
        sandbox.fails("render model --outputs base,residual", &[&ways, what].concat());
        for command in ["eval model", "export model -o a.ibgs"] {
            sandbox.fails(command, &[&["`-s SCENE`"], what].concat());
        }
        sandbox.succeeds("render model --outputs base,depth -o alone");
        assert!(base("alone") == base("whole"), "the base image needs no photo");
        fs::remove_dir_all(sandbox.path("alone")).unwrap();
        let info = sandbox.succeeds("info model").stdout;
        let viewed = sandbox.succeeds("view model --measure").stderr;
        for what in what {
            assert!(info.contains(what), "{what}\n{info}");
            assert!(viewed.contains(what), "{what}\n{viewed}");
        }
        assert!(viewed.contains("note: the base image is shown") && viewed.contains("`-s SCENE`"), "{viewed}");
    };
    for photo in ["view_003.png", "view_008.png"] {
        fs::remove_file(sandbox.path("scene/images").join(photo)).unwrap();
    }
    lacks(&["2 of the 10 photos of the model", "images/view_003.png, images/view_008.png"]);
    fs::rename(sandbox.path("scene"), sandbox.path("moved")).unwrap();
    lacks(&["scene", "is not there any more"]);
    // A scene that is named wrongly is an error, not a way to do without.
    sandbox.fails("view model --measure -s moved", &["moved", "view_003.png"]);
    sandbox.fails("render model -s nowhere", &["nowhere"]);
}

/// Folders of the published code name neither their options nor their scene.
#[test]
fn folders_of_the_published_code() {
    let (sandbox, _) = Sandbox::with_trained();
    let ply = fs::read(sandbox.path(LAST).join("point_cloud.ply")).unwrap();
    sandbox.write("published/point_cloud/iteration_30/point_cloud.ply", ply);
    sandbox.fails("eval published", &["cameras.json"]);
    fs::copy(sandbox.path("model/cameras.json"), sandbox.path("published/cameras.json")).unwrap();
    sandbox.fails("eval published", &["published", "config.toml", "--source"]);
    fs::remove_file(sandbox.path("published/cameras.json")).unwrap();
    let told = sandbox.succeeds("eval published --source scene").stderr;
    assert!(told.contains("note: published does not say at which size it saw its photos"), "{told}");
    assert!(!sandbox.succeeds("eval published --source scene -r 1").stderr.contains("does not say"));
    let base = sandbox.json("published/results_renders.json");
    assert_eq!(base["ours_30"]["views"], 2, "{base}");
    assert!(!sandbox.path("published/results_renders_aggregate.json").exists());

    let network = concat!(env!("CARGO_MANIFEST_DIR"), "/crates/ibgs-render/tests/color_aggregation_network.pth");
    fs::copy(network, sandbox.path("published/color_aggregation_network.pth")).unwrap();
    for command in ["render published", "export published -o a.ibgs"] {
        sandbox.fails(command, &["cameras.json"]);
    }
    let outcome = sandbox.succeeds("eval published --source scene");
    assert!(outcome.stdout.contains("final PSNR"), "{outcome}");
    let image = sandbox.json("published/results_renders_aggregate.json");
    let psnr = |results: &Value| results["ours_30"]["PSNR"].as_f64().unwrap();
    assert!(psnr(&image) > 5.0 && psnr(&image) != psnr(&base), "{image}");
    assert_eq!(image["ours_30"]["protocol"]["principal_point"], "centred");
    assert_eq!(sandbox.json("published/results_renders.json"), base, "the network changes no base image");
    let storage = &sandbox.json("published/result_fps_mem.json")["ours_30"]["storage_bytes"];
    let size = fs::metadata(sandbox.path("published/color_aggregation_network.pth")).unwrap().len();
    assert_eq!(storage["network"], size, "{storage}");
    sandbox.succeeds("render published --source scene --views all");
    assert_eq!(files_in(&sandbox.path("published/train/ours_30/renders_aggregate")).len(), 8);
    // In a bundle the network is ours.
    sandbox.succeeds("export published --source scene -o a.ibgs");
    let mine = |folder: &str| fs::read(sandbox.path(folder).join("test/ours_30/renders_aggregate/images/view_000.png"));
    sandbox.succeeds("render a.ibgs");
    assert_eq!(mine("a").unwrap(), mine("published").unwrap());
    sandbox.write("published/color_aggregation_network.pth", b"PK\x03\x04 no more");
    sandbox.fails("eval published --source scene", &["color_aggregation_network.pth", "is not a usable file"]);
}
