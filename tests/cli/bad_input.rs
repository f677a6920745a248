//! Scenes and options that cannot be trained on: one sentence, nothing written.

use super::Sandbox;
use ibgs_testing::scene_files::{Model, write_file};
use std::fs;

/// The small COLMAP scene after a change, in `scene/`.
fn changed(count: usize, change: impl Fn(&mut Model)) -> Sandbox {
    let sandbox = Sandbox::new();
    let mut model = Model::small(count);
    model.write_photos(&sandbox.path("scene"));
    change(&mut model);
    model.write_binary(&sandbox.path("scene"));
    sandbox
}

/// Training on `scene/` and describing it fail in the same way.
#[track_caller]
fn train_and_info_fail(sandbox: &Sandbox, fragments: &[&str]) {
    sandbox.fails("train scene --iterations 2 -m out", fragments);
    sandbox.fails("train scene --iterations 2", fragments);
    sandbox.fails("info scene", fragments);
}

#[test]
fn folders_that_are_no_scene() {
    let sandbox = Sandbox::new();
    sandbox.fails("train nowhere -m out", &["nowhere"]);
    sandbox.fails("train -s nowhere/at/all", &["nowhere/at/all"]);
    sandbox.fails("info nowhere", &["nowhere", "does not exist"]);
    fs::create_dir(sandbox.path("scene")).unwrap();
    train_and_info_fail(&sandbox, &["scene", "is not a scene"]);
    sandbox.write("scene/notes.txt", "nothing");
    train_and_info_fail(&sandbox, &["scene", "is not a scene"]);
    sandbox.fails("train scene/notes.txt", &["notes.txt"]);
}

#[test]
fn scenes_with_damage() {
    changed(1, |_| {}).fails("train scene -m out", &["scene", "has 1 view, at least 2"]);
    // One photo without a pose is left out, all of them are none.
    let sandbox = changed(3, |m| m.images.iter_mut().for_each(|image| image.q[2] = f64::NAN));
    sandbox.fails("train scene -m out", &["images.bin", "image `a0.png`", "not finite"]);
    let sandbox = changed(3, |m| m.cameras[0].model = (77, "WARPED"));
    sandbox.fails("train scene -m out", &["cameras.bin", "camera 1", "is not supported"]);

    let sandbox = changed(3, |_| {});
    let path = sandbox.path("scene/sparse/0/images.bin");
    let whole = fs::read(&path).unwrap();
    write_file(&path, &whole[..whole.len() - 30]);
    train_and_info_fail(&sandbox, &["images.bin", "is damaged"]);
    write_file(&path, &whole);
    sandbox.write("scene/images/a2.png", b"not a photo");
    sandbox.fails("train scene -m out", &["a2.png does not decode"]);
    fs::remove_dir_all(sandbox.path("scene/images")).unwrap();
    sandbox.fails("train scene -m out", &["photo folder", "images", "does not exist", "`--images`"]);
    fs::create_dir(sandbox.path("scene/images")).unwrap();
    sandbox.fails("train scene -m out", &["none of the 3 photos", "`--images`"]);
}

#[test]
fn transforms_with_damage() {
    let (sandbox, _) = Sandbox::with_scene();
    let whole = sandbox.text("scene/transforms.json");
    sandbox.write("scene/transforms.json", &whole[..whole.len() / 2]);
    train_and_info_fail(&sandbox, &["transforms.json", "line"]);
    sandbox.write("scene/transforms.json", whole.replacen("\"OPENCV\"", "\"EQUIRECTANGULAR\"", 1));
    sandbox.fails("train scene -m out", &["transforms.json", "EQUIRECTANGULAR"]);
    sandbox.write("scene/transforms.json", whole);
    sandbox.write("scene/points3D.ply", "ply\nformat");
    sandbox.fails("train scene -m out", &["points3D.ply"]);
}

#[test]
fn options_that_make_no_sense() {
    let (sandbox, _) = Sandbox::with_scene();
    let train = |options: &str, fragments: &[&str]| {
        sandbox.fails(&format!("train scene -m out {options}"), fragments);
        // Nor on the built-in scene.
        sandbox.fails(&format!("train -m out {options}"), &fragments[..1]);
    };
    train("--sh-degree 9", &["command line: option `sh-degree` is 9"]);
    train("--iterations 0", &["`iterations` is 0"]);
    train("--densify-interval 0", &["`densify.interval` is 0"]);
    train("--eval-split-every 1", &["eval-split-every", "at least 2"]);
    // What no number can be is wrong use, for all options alike.
    for (options, fragments) in [
        ("-r abc", ["--resolution", "`abc`", "1, 2, 4 or 8"]),
        ("-r 0", ["--resolution", "`0`", "1, 2, 4 or 8"]),
        ("--resampler box", ["--resampler", "'box'", ""]),
        ("--masks thing", ["--masks", "'thing'", ""]),
        ("--densify much", ["--densify", "'much'", ""]),
        ("--method 4dgs", ["--method", "'4dgs'", ""]),
    ] {
        let line = format!("train scene -m out {options}");
        sandbox.fails_as(&mut sandbox.command(&line), &line, 2, &fragments);
    }
    // The width of the published code is a number too.
    sandbox.fails("train nowhere -m out -r -1", &["nowhere"]);
    train("--max-resolution 0", &["max-resolution", "0"]);
    train("--config nowhere.toml", &["nowhere.toml"]);
    sandbox.write("bad.toml", "seed = 1\n[data]\nresolution = \"3\"");
    train("--config bad.toml", &["bad.toml, line 3: option `data.resolution`: `3` is not allowed"]);
    let both = "--masks object --alpha composite";
    sandbox.fails(&format!("train scene -m out {both}"), &["`--alpha`", "composite", "`--masks` is `object`"]);
    sandbox.fails("train scene -m out --images ../x", &["`--images`", "../x"]);
    train("--sources 9", &["`sources.used` is 9", "1 and 8"]);
    train("--visible-sources 0", &["`sources.visible` is 0", "1 and 4"]);
    train("--source-angle 0", &["`sources.max-angle-deg` is 0"]);
    train("--intersections 3", &["`surface.intersections` is 3", "2, 4, 6 or 8"]);
    train("--residual-factor 0.3", &["`residual.factor` is 0.3", "1, 0.5 or 0.25"]);
    train("--init nowhere.ply", &["nowhere.ply"]);
    sandbox.fails("train scene -m out --images nowhere", &["nowhere"]);
    sandbox.fails("bench --iterations 0", &["--iterations", "at least 5"]);
    sandbox.fails("bench --gaussians 1k,many", &["--gaussians", "`many`", "100k"]);
    sandbox.fails("bench --size 4k,480q", &["--size", "`480q`", "1080p"]);
    sandbox.fails("bench --sources 4,9", &["`sources.used` is 9", "1 and 8"]);
    sandbox.fails("bench --intersections 3", &["`surface.intersections` is 3", "2, 4, 6 or 8"]);
    sandbox.fails("bench --size 64", &["--size", "`64`", "WIDTHxHEIGHT"]);
    sandbox.fails("bench --size 0x5", &["--size", "0x5"]);
    sandbox.fails("bench --size 99999x5", &["--size", "99999x5", "16384"]);
    sandbox.fails("bench --size 64xabc", &["--size", "64xabc"]);
    sandbox.fails("bench --size 12x4xabc", &["--size", "12x4xabc"]);
    sandbox.fails("bench --sh-degree 9", &["--sh-degree"]);
}

#[test]
fn options_of_a_scene_on_disk_do_not_pass_silently_for_the_built_in_one() {
    let sandbox = Sandbox::new();
    for option in [
        "-r 2",
        "--alpha composite",
        "--color-space linear",
        "--filter-points",
        "--images images_2",
        "--max-resolution 100",
        "--principal-point centred",
        "--eval-split-every 4",
    ] {
        sandbox.fails(&format!("train --iterations 1 -m out {option}"), &["built-in demo scene"]);
    }
}

#[test]
fn option_files_with_mistakes() {
    let (sandbox, _) = Sandbox::with_scene();
    let cases: [(&str, &[&str]); 12] = [
        ("seed = 1\nsead = 2\n", &["run.toml, line 2", "`sead`"]),
        ("[densify]\nintervall = 5\n", &["run.toml, line 2", "`intervall`"]),
        ("iterations = \"many\"\n", &["run.toml, line 1"]),
        ("iterations = \n", &["run.toml, line 1"]),
        ("[data]\nalpha = \"half\"\n", &["run.toml, line 2", "`half`", "composite"]),
        ("[data]\ncolor-space = \"xyz\"\n", &["run.toml, line 2", "`xyz`"]),
        ("sh-degree = 9\n", &["run.toml", "`sh-degree` is 9"]),
        ("demo-walkers = 101\n", &["run.toml", "`demo-walkers` is 101", "between 0 and 100"]),
        ("demo-walkers = -1\n", &["run.toml, line 1"]),
        // Constants of the method, no options.
        ("[exposure]\nmin-pixels = 64\n", &["run.toml, line 2", "`min-pixels`"]),
        ("[exposure]\nmax-dissimilarity = 0.5\n", &["run.toml, line 2", "`max-dissimilarity`"]),
        ("[residual]\nburn-in-gain = 1.5\n", &["run.toml", "`residual.burn-in-gain` is 1.5"]),
    ];
    for (text, fragments) in cases {
        sandbox.write("run.toml", text);
        sandbox.fails("train scene --config run.toml -m out", fragments);
    }
    sandbox.write("run.toml", b"\xff\xfe");
    sandbox.fails("train scene --config run.toml -m out", &["run.toml"]);
}

#[test]
fn wrong_usage_ends_with_2() {
    let sandbox = Sandbox::new();
    let wrong = |arguments: &str, fragments: &[&str]| {
        sandbox.fails_as(&mut sandbox.command(arguments), arguments, 2, fragments);
    };
    wrong("train --no-such-option", &["--no-such-option"]);
    wrong("train scene --iterations many", &["many", "--iterations"]);
    wrong("train scene --init model.ply --sh-degree 3", &["--sh-degree", "--init"]);
    wrong("train scene --iterations -5", &["-5"]);
    wrong("train scene --method other", &["other", "--method"]);
    wrong("train scene -s scene", &["cannot be used with"]);
    wrong("train scene --principal-point middle", &["middle"]);
    wrong("train scene --preset fast --config run.toml", &["--preset", "--config"]);
    wrong("train scene --preset fast --resume -m model", &["--preset", "--resume"]);
    for count in ["many", "0.5", "0"] {
        wrong(&format!("train scene --max-splats {count}"), &["--max-splats", "1.5M"]);
    }
    // The values that there are stand on the line below the error.
    let wrong_value = |option: &str, value: &str, possible: &str| {
        let arguments = format!("train scene {option} {value}");
        wrong(&arguments, &[option, &format!("'{value}'")]);
        let outcome = sandbox.run(&arguments);
        assert!(outcome.stderr.contains(&format!("[possible values: {possible}]")), "{outcome}");
    };
    wrong_value("--alpha", "half", "mask, composite, keyed");
    wrong_value("--preset", "quick", "default, best, fast, published");
    wrong_value("--masks", "thing", "ignore, object");
    wrong_value("--color-space", "xyz", "srgb, linear");
    wrong("train scene --seed 1.5", &["1.5"]);
    wrong("render", &["required"]);
    wrong("train scene --source-memory much", &["much", "512MiB"]);
    wrong("train scene --source-distance far", &["far", "adaptive"]);
    wrong("render model --views some", &["some"]);
    wrong("render model --outputs base,colour", &["colour"]);
    wrong("render model --source-memory -1", &["-1"]);
    wrong("export model", &["required"]);
    wrong("mesh model --texture --texture-size 9", &["9 is not in 64..=16384"]);
    wrong("mesh model --texture-size 500", &["required"]);
    wrong("paint", &["paint"]);
    assert_eq!(sandbox.run("").code, Some(2));
    assert!(!sandbox.succeeds("--version").stdout.is_empty());
    for page in ["", "train", "render", "eval", "export", "info", "bench"] {
        assert!(!sandbox.succeeds(&format!("{page} --help")).stdout.is_empty(), "{page}");
    }
}
