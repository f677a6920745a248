//! Ctrl-C ends a training well.

use super::{Outcome, PATIENCE, Sandbox, wait_for};
use std::path::Path;
use std::process::{Command, Stdio};

/// Iterations of which the folder holds a model.
fn saved(model: &Path) -> Vec<u32> {
    let entries = std::fs::read_dir(model.join("point_cloud")).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut found: Vec<u32> = names.map(|name| name.strip_prefix("iteration_").unwrap().parse().unwrap()).collect();
    found.sort_unstable();
    found
}

#[test]
fn an_interrupted_training_saves_and_evaluates() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.write("run.toml", "[surface]\nstart = 1\n[residual]\nstart = 2\n");
    let arguments = "train scene --config run.toml --iterations 1000000 --eval -m model --save-iterations 3";
    let mut command = sandbox.command(arguments);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let first = sandbox.path("model/point_cloud/iteration_3/point_cloud.ply");
    wait_for(PATIENCE, || (first.is_file() || child.try_wait().unwrap().is_some()).then_some(()));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let outcome = Outcome::of_child(arguments, child);
    outcome.assert_success();
    assert!(outcome.stderr.contains("stopped at iteration"), "{outcome}");

    let iterations = saved(&sandbox.path("model"));
    let last = *iterations.last().unwrap();
    assert!(iterations[0] == 3 && last < 1_000_000, "{iterations:?}");
    for name in ["renders", "renders_aggregate"] {
        let results = sandbox.json(&format!("model/results_{name}.json"));
        assert_eq!(results[format!("ours_{last}")]["views"], 2, "{results}");
    }
    assert_eq!(sandbox.json("model/result_training.json")[format!("ours_{last}")]["iterations"], last);
    for iteration in [3, last] {
        let folder = sandbox.path(&format!("model/point_cloud/iteration_{iteration}"));
        assert!(folder.join("residual_network.safetensors").is_file(), "{iteration}");
    }
    let info = sandbox.succeeds("info model");
    assert!(info.stdout.contains(&format!("latest iteration {last}")), "{info}");
    sandbox.succeeds("render model --outputs final");
}
