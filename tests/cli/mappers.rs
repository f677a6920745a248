//! `ibgs prepare` with programs that stand in for COLMAP 4, which has a global mapper, and for GLOMAP.

use super::prepare::{COLMAP, make_program};
use super::{Outcome, PATIENCE, Sandbox, wait_for};
use ibgs_testing::scene_files::Model;
use std::fs;
use std::process::{Command, Stdio};

/// As COLMAP 4 does: help and messages go to standard error, and the global mapper reads a database that another command has
/// changed. `broken-global` makes the global mapper fail. The models are those of folders beside it.
const COLMAP_4: &str = r#"#!/bin/sh
here=$(dirname "$0")
echo "$@" >> "$here/calls"
database=$(echo "$@" | sed 's/.*--database_path \([^ ]*\).*/\1/')
out=$(echo "$@" | sed 's/.*--output_path //')
case "$1 $2" in
    "-h ") printf 'COLMAP 4.2.0 (Commit a on b without CUDA)\n  global_mapper\n  mapper\n  view_graph_calibrator\n' ;;
    "feature_extractor -h") echo "I1 a.cc:1] --FeatureExtraction.use_gpu arg (=1)" >&2 ;;
    "exhaustive_matcher -h") echo "I1 a.cc:1] --FeatureMatching.use_gpu arg (=1)" >&2 ;;
    feature_extractor*) echo features > "$database" ;;
    view_graph_calibrator*) echo calibrated >> "$database" ;;
    global_mapper*)
        if [ -e "$here/broken-global" ]; then echo "E1 a.cc:1] Failed to solve" >&2; exit 1; fi
        grep -q calibrated "$database" || exit 2
        echo "I1 a.cc:1] Running rotation averaging" >&2
        echo "I1 a.cc:1] Running iterative bundle adjustment" >&2
        cp -r "$here/global/." "$out"
        echo "[options]" > "$out/project.ini" ;;
    mapper*)
        if [ -e "$here/broken" ]; then exit 3; fi
        cp -r "$here/models/." "$out" ;;
    model_analyzer*) echo "I1 a.cc:1] Points: 1234" >&2; echo "I1 a.cc:1] Mean reprojection error: 0.61px" >&2 ;;
esac
"#;

/// As many as the global mapper is taken for.
const PHOTOS: usize = 100;

/// Photos, what the incremental mapper finds of them (all), and what the global one finds: a model of this many.
fn sandbox_4(global: usize) -> Sandbox {
    let sandbox = Sandbox::new();
    Model::small(PHOTOS)
        .images
        .iter()
        .for_each(|image| sandbox.write(&format!("photos/{}", image.name), "not looked at"));
    Model::small(PHOTOS).write_binary_to(&sandbox.path("models/0"));
    Model::small(global).write_binary_to(&sandbox.path("global/0"));
    make_program(&sandbox, "colmap4", COLMAP_4);
    sandbox
}

fn has_call(sandbox: &Sandbox, command: &str) -> bool {
    sandbox.text("calls").lines().any(|line| line.starts_with(&format!("{command} --")))
}

fn posed(outcome: &Outcome, count: usize) {
    assert!(outcome.stdout.contains(&format!("{count} of {PHOTOS} photos have a pose")), "{outcome}");
}

#[test]
fn the_global_mapper_is_used_where_it_is_there() {
    let sandbox = sandbox_4(PHOTOS);
    let outcome = sandbox.succeeds("prepare photos -o scene --colmap ./colmap4");
    posed(&outcome, PHOTOS);
    for line in [
        "poses by the global mapper of COLMAP 4.2",
        "global mapper, step 1 of 6: view graph calibration",
        "global mapper, step 2 of 6: rotation averaging",
        "global mapper, step 5 of 6: bundle adjustment",
    ] {
        assert!(outcome.stderr.contains(line), "{line}: {outcome}");
    }
    assert!(!has_call(&sandbox, "mapper"), "{}", sandbox.text("calls"));
    let calls = sandbox.text("calls");
    assert!(
        calls.contains("--FeatureExtraction.use_gpu 0") && calls.contains("--FeatureMatching.use_gpu 0"),
        "{calls}"
    );
    assert_eq!(sandbox.text("scene/database.db"), "features\n");
    assert!(!sandbox.path("scene/prepare-work").exists());
}

#[test]
fn the_scene_keeps_the_tracks_of_its_points() {
    let sandbox = sandbox_4(PHOTOS);
    for mapper in ["incremental", "global"] {
        // Not `global`: that folder is what the program copies from.
        sandbox.succeeds(&format!("prepare photos -o by-{mapper} --colmap ./colmap4 --mapper {mapper}"));
        let kept = |file: &str| fs::read(sandbox.path(&format!("by-{mapper}/sparse/0/{file}"))).unwrap();
        let model = Model::small(PHOTOS);
        assert!(model.images.iter().all(|image| !image.observations.is_empty()));
        assert!(model.points.iter().all(|point| !point.track.is_empty()));
        assert_eq!((kept("images.bin"), kept("points3D.bin")), (model.images_bin(), model.points_bin()), "{mapper}");
    }
}

#[test]
fn where_the_global_mapper_fails_the_incremental_one_runs() {
    let sandbox = sandbox_4(PHOTOS);
    sandbox.write("broken-global", "");
    let outcome = sandbox.succeeds("prepare photos -o scene --colmap ./colmap4");
    posed(&outcome, PHOTOS);
    let said = "the global mapper failed: ./colmap4 failed (exit status: 1): it says `E1 a.cc:1] Failed to solve`";
    assert!(outcome.stderr.contains(said) && outcome.stderr.contains("; now the incremental one"), "{outcome}");
    assert!(has_call(&sandbox, "mapper"));
    // Not where it is the only one that is wanted.
    fs::remove_file(sandbox.path("calls")).unwrap();
    let outcome = sandbox.run("prepare photos -o other --colmap ./colmap4 --mapper global");
    outcome.assert_failure(1, &["./colmap4 failed", "Failed to solve", "other/prepare.log"]);
    assert!(!has_call(&sandbox, "mapper"));
    // Both fail.
    sandbox.write("broken", "");
    let outcome = sandbox.run("prepare photos -o third --colmap ./colmap4");
    outcome.assert_failure(1, &["the poses could not be estimated", "third/prepare.log"]);
}

#[test]
fn stopping_a_mapper_begins_no_other_one_and_the_same_command_continues() {
    let sandbox = sandbox_4(PHOTOS);
    for (mapper, command) in [("auto", "global_mapper"), ("incremental", "mapper")] {
        let slow =
            COLMAP_4.replace(&format!("\n    {command}*)"), &format!("\n    {command}*) exec sleep 60 ;;\n    never)"));
        assert_ne!(slow, COLMAP_4);
        make_program(&sandbox, "colmap4", &slow);
        let arguments = format!("prepare photos -o {mapper} --colmap ./colmap4 --mapper {mapper}");
        let mut program = sandbox.command(&arguments);
        let mut child = program.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let begun = || sandbox.path("calls").exists() && has_call(&sandbox, command);
        wait_for(PATIENCE, || (begun() || child.try_wait().unwrap().is_some()).then_some(()));
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        let outcome = Outcome::of_child(&arguments, child);
        outcome.assert_stopped(130);
        assert!(outcome.stderr.ends_with("stopped; the same command continues from here\n"), "{outcome}");
        let calls = fs::read_to_string(sandbox.path("calls")).unwrap();
        assert!(calls.lines().last().unwrap().starts_with(command), "{calls}");
        fs::remove_file(sandbox.path("calls")).unwrap();
        make_program(&sandbox, "colmap4", COLMAP_4);
        posed(&sandbox.succeeds(&arguments), PHOTOS);
        assert!(has_call(&sandbox, command) && !has_call(&sandbox, "feature_extractor"));
        assert!(!sandbox.path(mapper).join("prepare-work").exists());
        fs::remove_file(sandbox.path("calls")).unwrap();
    }
}

#[test]
fn of_two_mappers_the_one_with_more_poses_stays() {
    let sandbox = sandbox_4(79);
    let outcome = sandbox.succeeds("prepare photos -o more --colmap ./colmap4");
    posed(&outcome, PHOTOS);
    let said = "the global mapper gives 79 of 100 photos a pose; now the incremental one";
    assert!(outcome.stderr.contains(said), "{outcome}");
    fs::remove_dir_all(sandbox.path("models")).unwrap();
    Model::small(1).write_binary_to(&sandbox.path("models/0"));
    let outcome = sandbox.succeeds("prepare photos -o fewer --colmap ./colmap4");
    posed(&outcome, 79);
    let said = "the incremental mapper gives 1 photo a pose, so the global one's poses stay";
    assert!(outcome.stderr.contains(said), "{outcome}");
    sandbox.write("broken", "");
    posed(&sandbox.succeeds("prepare photos -o none --colmap ./colmap4"), 79);
    for scene in ["more", "fewer", "none"] {
        assert!(!sandbox.path(scene).join("prepare-work").exists(), "{scene}");
    }
}

#[test]
fn the_mapper_can_be_chosen() {
    let sandbox = sandbox_4(PHOTOS);
    let outcome = sandbox.succeeds("prepare photos -o scene --colmap ./colmap4 --mapper incremental");
    assert!(outcome.stderr.contains("poses by COLMAP's incremental mapper, as asked for"), "{outcome}");
    assert!(has_call(&sandbox, "mapper") && !has_call(&sandbox, "global_mapper"));
    let outcome = sandbox.run("prepare photos -o scene --colmap ./colmap4 --mapper global");
    outcome.assert_failure(1, &["begun with other photos or options"]);
    // One photo less, and it takes the wish for the global one.
    fs::remove_file(sandbox.path("photos/a99.png")).unwrap();
    let outcome = sandbox.succeeds("prepare photos -o few --colmap ./colmap4");
    let why = "poses by COLMAP's incremental mapper, which is the surer one for fewer than 100 photos";
    assert!(outcome.stderr.contains(why) && !has_call(&sandbox, "global_mapper"), "{outcome}");
    sandbox.succeeds("prepare photos -o wanted --colmap ./colmap4 --mapper global");
    assert!(has_call(&sandbox, "global_mapper"));
}

#[test]
fn without_a_global_mapper_that_is_said_and_glomap_is_one() {
    let sandbox = sandbox_4(PHOTOS);
    make_program(
        &sandbox,
        "colmap",
        &COLMAP.replace("mapper*)", "feature_extractor*) : > scene/database.db ;;\n    mapper*)"),
    );
    let path = std::env::var("PATH").unwrap();
    let run = |arguments: &str, path: &str| Outcome::of(arguments, sandbox.command(arguments).env("PATH", path));
    // Where no other folder has it.
    let bare = "/usr/bin:/bin";
    let outcome = run("prepare photos -o scene --colmap ./colmap --mapper global", bare);
    outcome.assert_failure(1, &["COLMAP 3.8 has no global mapper", "`glomap` was not found", "COLMAP 4"]);
    assert!(!sandbox.path("scene").exists());
    let outcome = run("prepare photos -o scene --colmap ./colmap", bare);
    outcome.assert_success();
    let why = "poses by COLMAP's incremental mapper: COLMAP 3.8 has no global one (4.0 and newer have it)";
    assert!(outcome.stderr.contains(why), "{outcome}");
    let glomap = COLMAP_4.replace("COLMAP 4.2.0", "GLOMAP").replace("$here/models", "$here/../global");
    make_program(&sandbox, "bin/glomap", &glomap);
    let beside = format!("{}:{path}", sandbox.path("bin").display());
    let outcome = run("prepare photos -o scene --colmap ./colmap --overwrite", &beside);
    outcome.assert_success();
    posed(&outcome, PHOTOS);
    let why = "poses by the global mapper `glomap`, since COLMAP 3.8 has none of its own";
    assert!(outcome.stderr.contains(why), "{outcome}");
    let calls = sandbox.text("bin/calls");
    assert!(
        calls.contains("mapper --database_path scene/prepare-work/database.db --image_path scene/images"),
        "{calls}"
    );
}
