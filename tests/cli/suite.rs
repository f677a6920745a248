//! `ibgs suite`: trains what is there, goes on where it stopped, and sets the figures beside published ones.

use super::Sandbox;
use std::fs;

const CONFIG: &str = r#"
title = "Two ways"
note = "A test."
options = { iterations = 4, residual = { factor = 0.25 } }

[[scenes]]
name = "scene"

[[scenes]]
name = "elsewhere"

[[runs]]
name = "ibgs"

[[runs]]
name = "base alone"
options = { method = "3dgs" }

[[published]]
method = "another"
on = "scene"
psnr = 99.0
ssim = 0.5
fps = 7
"#;

#[test]
fn a_suite_trains_goes_on_and_summarises() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.write("two.toml", CONFIG);
    let first = sandbox.succeeds("suite two.toml --shard 2/2");
    assert!(first.stderr.contains("has no scene `elsewhere`"), "{first}");
    assert!(first.stdout.contains("Not measured yet: scene, ibgs."), "{first}");
    assert!(sandbox.path("output/two/base alone/scene/results_renders.json").exists());
    assert!(!sandbox.path("output/two/ibgs").exists());
    // A half-done run starts again.
    fs::create_dir_all(sandbox.path("output/two/ibgs/scene/point_cloud")).unwrap();
    let second = sandbox.succeeds("suite two.toml");
    assert!(second.stderr.contains("1 of 2 runs are there already"), "{second}");
    assert!(second.stderr.contains("1/1 scene, ibgs: training"), "{second}");
    assert!(!second.stdout.contains("Not measured yet"), "{second}");
    for words in [
        "# Two ways",
        "A test.",
        "## scene",
        "another (published) | 99.00 |            - | 0.5000",
        " F1 | Chamfer |",
        "## elsewhere",
        "Not there.",
    ] {
        assert!(second.stdout.contains(words), "`{words}` is not in {second}");
    }
    let summary = sandbox.json("output/two/summary.json");
    let measured = summary["measured"].as_array().unwrap();
    assert_eq!(measured.len(), 2);
    for job in measured {
        let figures = &job["figures"];
        for name in ["PSNR", "SSIM", "base_PSNR", "gaussians_m", "FPS", "storage_mb", "minutes"] {
            assert!(figures[name].as_f64().is_some_and(|value| value > 0.0), "{name}: {figures}");
        }
    }
    assert_eq!(sandbox.text("output/two/summary.md").trim(), second.stdout.trim());
    let third = sandbox.succeeds("suite two.toml --summary-only --runs ibgs");
    assert!(!third.stdout.contains("base alone") && !third.stderr.contains("training"), "{third}");
}

#[test]
fn a_suite_that_cannot_be_run_says_why() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.write("two.toml", CONFIG);
    sandbox.fails("suite none.toml", &["cannot read the configuration none.toml"]);
    sandbox.fails("suite two.toml --data scene", &["scene has none of the scenes of two.toml"]);
    sandbox.fails("suite two.toml --scenes other", &["no scene `other`; it has scene, elsewhere"]);
    sandbox.fails("suite two.toml --runs other", &["no run `other`; it has ibgs, base alone"]);
    sandbox.write("bad.toml", CONFIG.replace("method = \"3dgs\"", "method = \"4dgs\""));
    sandbox.fails("suite bad.toml", &["bad.toml is no configuration", "run `base alone`", "4dgs"]);
    // A broken scene fails alone, and the log says why.
    sandbox.write("scene/transforms.json", "{");
    let outcome = sandbox.run("suite two.toml");
    outcome.assert_failure(1, &["2 of 2 runs failed", ".log"]);
    assert!(sandbox.text("output/two/ibgs/scene.log").contains("transforms.json"), "{outcome}");
}

/// Ctrl-C, which a terminal sends to all processes, and SIGTERM for the suite alone: its processes end with it, and the same
/// command goes on.
#[cfg(unix)]
#[test]
fn a_stopped_suite_goes_on() {
    use super::{Outcome, PATIENCE, wait_for};
    use std::os::unix::process::CommandExt;
    use std::process::{Command, Stdio};
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.write("two.toml", CONFIG.replace("iterations = 4", "iterations = 40, save-iterations = [2]"));
    for (signal, to, code) in [("-INT", "-", 130), ("-TERM", "", 143)] {
        let folder = format!("out{code}");
        let arguments = &format!("suite two.toml -o {folder}");
        let mut command = sandbox.command(arguments);
        let mut suite = command.process_group(0).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let saved = sandbox.path(&format!("{folder}/ibgs/scene/point_cloud/iteration_2/point_cloud.ply"));
        wait_for(PATIENCE, || (saved.is_file() || suite.try_wait().unwrap().is_some()).then_some(()));
        let target = format!("{to}{}", suite.id());
        assert!(Command::new("kill").args([signal, "--", &target]).status().unwrap().success());
        let outcome = Outcome::of_child(arguments, suite);
        outcome.assert_stopped(code);
        assert!(outcome.stderr.contains("stopped; the same command continues with what is left"), "{outcome}");
        assert!(!sandbox.path(&format!("{folder}/base alone/scene.log")).exists(), "{outcome}");
        let log = sandbox.text(&format!("{folder}/ibgs/scene.log"));
        assert!(log.contains("stopped at iteration") && !log.contains("FPS"), "not measured yet, but saved: {log}");
        let again = sandbox.succeeds(arguments);
        assert!(!again.stdout.contains("Not measured yet"), "{again}");
        let log = sandbox.text(&format!("{folder}/ibgs/scene.log"));
        assert!(log.contains("resuming from iteration"), "{again}\n{log}");
    }
}

/// What is wanted later is measured without training again.
#[test]
fn a_suite_measures_meshes_and_lpips() {
    let (sandbox, _) = Sandbox::with_scene();
    let scene = "name = \"scene\"";
    let mesh = format!("{scene}\nmesh = {{ compare = \"truth.ply\", threshold = 0.5 }}");
    let config = CONFIG.replacen(scene, &mesh, 1).replace("iterations = 4", "iterations = 30");
    sandbox.write("mesh.toml", &config);
    let command = "suite mesh.toml --scenes scene --runs ibgs";
    let first = sandbox.succeeds(command);
    assert!(first.stderr.contains("scene `scene` has no true surface"), "{first}");
    assert!(!first.stdout.contains("Not measured yet"), "{first}");
    let model = sandbox.path("output/mesh/ibgs/scene");
    fs::copy(model.join("input.ply"), sandbox.path("scene/truth.ply")).unwrap();
    let trained = fs::metadata(model.join("result_training.json")).unwrap().modified().unwrap();
    fs::remove_file(model.join("result_fps_mem.json")).unwrap();
    let second = sandbox.succeeds(command);
    assert!(second.stderr.contains("1/1 scene, ibgs"), "{second}");
    assert!(!second.stdout.contains("Not measured yet"), "{second}");
    assert_eq!(fs::metadata(model.join("result_training.json")).unwrap().modified().unwrap(), trained);
    let figures = &sandbox.json("output/mesh/summary.json")["measured"][0]["figures"];
    for name in ["F1", "chamfer"] {
        assert!(figures[name].as_f64().is_some_and(|value| value > 0.0), "{name}: {figures}");
    }
    // The weights reach the measurement.
    let outcome = sandbox.run(&format!("{command} --lpips-weights none.pth --lpips-range published"));
    outcome.assert_failure(1, &["1 of 1 runs failed"]);
    assert!(sandbox.text("output/mesh/ibgs/scene.log").contains("none.pth"), "{outcome}");
    sandbox.write("mesh.toml", config.replace("threshold", "thresold"));
    sandbox.fails(command, &["unknown field `thresold`"]);
}
