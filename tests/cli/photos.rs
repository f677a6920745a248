//! `ibgs train` on photos without poses, and `--prepare`.

use super::prepare::{COLMAP, make_program};
use super::{Outcome, Sandbox};
use ibgs_testing::scene_files::Model;
use std::fs;

/// Photos, and a program `bin/colmap` that knows their poses.
fn sandbox() -> Sandbox {
    let sandbox = Sandbox::new();
    let model = Model::small(4);
    model.write_photos(&sandbox.path("shot"));
    fs::rename(sandbox.path("shot/images"), sandbox.path("photos")).unwrap();
    model.write_binary_to(&sandbox.path("bin/models/0"));
    make_program(&sandbox, "bin/colmap", COLMAP);
    sandbox
}

/// The path with the folder of that program first.
fn path(sandbox: &Sandbox) -> String {
    format!("{}:{}", sandbox.path("bin").display(), std::env::var("PATH").unwrap())
}

fn run(sandbox: &Sandbox, arguments: &str) -> Outcome {
    Outcome::of(arguments, sandbox.command(arguments).env("PATH", path(sandbox)))
}

#[test]
fn photos_without_poses_are_named_with_the_command() {
    let sandbox = sandbox();
    sandbox.write("walk.mp4", "a video");
    let command = format!("no camera poses; `ibgs train {} --prepare`", sandbox.path("photos").display());
    sandbox.fails("train photos", &["photos has photos but", &command, "it has no sparse/0"]);
    sandbox.fails("train walk.mp4", &["walk.mp4 is a video without camera poses", "walk.mp4 --prepare`"]);
    sandbox.fails("train shot", &["shot is not a scene"]);
}

#[test]
fn photos_are_prepared_and_trained_on() {
    let sandbox = sandbox();
    let short = "--prepare --method 3dgs --iterations 3 --initial-points scene";
    let outcome = run(&sandbox, &format!("train photos {short} -m first"));
    outcome.assert_success();
    assert!(outcome.stdout.contains("4 of 4 photos have a pose"), "{outcome}");
    assert!(sandbox.path("first/point_cloud/iteration_3/point_cloud.ply").exists(), "{outcome}");
    assert!(sandbox.text("first/config.toml").contains("photos-scene"));
    // The scene is used again, without COLMAP.
    fs::remove_file(sandbox.path("bin/colmap")).unwrap();
    let outcome = sandbox.succeeds(&format!("train photos/../photos {short} -m second"));
    assert!(outcome.stderr.contains("-scene was made of these photos and is used"), "{outcome}");
    assert!(sandbox.path("second/point_cloud/iteration_3/point_cloud.ply").exists());
    make_program(&sandbox, "bin/colmap", COLMAP);
    fs::remove_file(sandbox.path("bin/calls")).unwrap();
    fs::copy(sandbox.path("photos/a0.png"), sandbox.path("photos/a9.png")).unwrap();
    let outcome = run(&sandbox, &format!("train photos {short} -m third"));
    outcome
        .assert_failure(1, &["photos-scene was begun with other photos or options", "`--overwrite` to `ibgs prepare`"]);
    // As the error says.
    let outcome = run(&sandbox, "prepare photos --overwrite");
    outcome.assert_success();
    assert!(
        outcome.stdout.contains("4 of 5 photos have a pose") && sandbox.path("photos-scene/images/a9.png").exists()
    );
    let outcome = run(&sandbox, &format!("train photos-scene {short} -m third"));
    outcome.assert_success();
    assert!(outcome.stderr.contains("4 training views"), "{outcome}");
}

#[test]
fn what_cannot_be_prepared_is_said_first() {
    let sandbox = sandbox();
    sandbox.write("empty/read.me", "");
    sandbox.write("walk.mp4", "a video");
    sandbox.write("notes.txt", "no video");
    sandbox.write("model/point_cloud/iteration_3/point_cloud.ply", "a model");
    // One that does not note its calls, which would be a change.
    make_program(&sandbox, "bin/colmap", &COLMAP.replace("echo \"$@\" >> \"$here/calls\"", ""));
    for (arguments, code, fragments) in [
        ("--prepare", 1, &["`--prepare` needs a folder of photos or a video"][..]),
        ("empty --prepare", 1, &["empty has 0 photos", "at least 3"]),
        ("nowhere --prepare", 1, &["nowhere"]),
        ("notes.txt --prepare", 1, &["notes.txt is neither a folder of photos nor a video"]),
        ("photos --prepare -m model", 1, &["model", "--overwrite"]),
        ("photos --prepare --iterations 0", 1, &["iterations"]),
        ("photos --prepare --resume -m model", 2, &["--prepare"]),
    ] {
        let arguments = format!("train {arguments}");
        sandbox.fails_as(sandbox.command(&arguments).env("PATH", path(&sandbox)), &arguments, code, fragments);
    }
    let without = |arguments: &str, fragments: &[&str]| {
        sandbox.fails_as(sandbox.command(arguments).env("PATH", "/nowhere"), arguments, 1, fragments);
    };
    without("train photos --prepare", &["colmap was not found", "./setup.sh --photos", "apt install colmap"]);
    without("train walk.mp4 --prepare", &["colmap was not found"]);
    // Without a display the way goes through the terminal.
    let mut look = sandbox.command("view photos");
    for name in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        look.env_remove(name);
    }
    sandbox.fails_as(&mut look, "view photos", 1, &["no display", "`ibgs train photos --prepare` finds the poses"]);
    // A scene of the same name that is another's.
    Model::small(3).write_binary_to(&sandbox.path("photos-scene/sparse/0"));
    let outcome = run(&sandbox, "train photos --prepare");
    outcome.assert_failure(1, &["photos-scene has camera poses already", "choose another folder"]);
}

#[test]
fn the_scene_lies_beside_the_photos() {
    let sandbox = sandbox();
    fs::create_dir(sandbox.path("trip")).unwrap();
    fs::rename(sandbox.path("photos"), sandbox.path("trip/images")).unwrap();
    for (photos, scene) in [("trip/images", "trip-scene"), ("trip/images/", "trip-scene")] {
        let outcome = run(&sandbox, &format!("prepare {photos}"));
        outcome.assert_success();
        assert!(outcome.stdout.contains(&format!("train on it: ibgs train {scene} --eval")), "{outcome}");
        assert!(sandbox.path(scene).join("sparse/0/images.bin").exists());
    }
    // From within, by a path without a name.
    let mut within = sandbox.command("prepare .");
    let outcome = Outcome::of("prepare .", within.current_dir(sandbox.path("trip/images")).env("PATH", path(&sandbox)));
    outcome.assert_success();
    assert!(outcome.stdout.contains("/trip-scene --eval") && !sandbox.path("trip/images-scene").exists(), "{outcome}");
}
