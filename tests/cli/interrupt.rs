//! Ctrl-C ends a training well, and readers that go do not end it.

use super::{Outcome, PATIENCE, Sandbox, wait_for};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

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
    // Twice, as `timeout` does and a shell with its process group: it is one signal all the same.
    for _ in 0..2 {
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        std::thread::sleep(Duration::from_millis(50));
    }
    let outcome = Outcome::of_child(arguments, child);
    // As shells have it: 128 and the signal's number.
    outcome.assert_stopped(130);
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
    assert!(info.stdout.contains(&format!("model of iteration {last} of 1000000")), "{info}");
    assert!(info.stdout.contains("`ibgs train --resume -m model` continues from it"), "{info}");
    sandbox.succeeds("render model --outputs final");
}

#[test]
fn nobody_need_read_what_is_told() {
    let (sandbox, _) = Sandbox::with_scene();
    for arguments in ["train scene --iterations 3 --eval -m model", "eval model", "info model", "completions bash"] {
        let mut child =
            sandbox.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program");
        drop((child.stdout.take(), child.stderr.take()));
        let status = wait_for(PATIENCE, || child.try_wait().unwrap());
        assert!(status.is_some_and(|status| status.success()), "`ibgs {arguments}`: {status:?}");
    }
    assert_eq!(saved(&sandbox.path("model")), [1, 3]);
    // What cannot be written is another matter.
    if cfg!(target_os = "linux") {
        let mut command = sandbox.command("info model");
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let child = command.stdout(full).stderr(Stdio::piped()).spawn().unwrap().wait_with_output().unwrap();
        let told = String::from_utf8(child.stderr).unwrap();
        assert_eq!(child.status.code(), Some(1), "{told}");
        assert!(told.starts_with("error: cannot write to standard output") && told.lines().count() == 1, "{told}");
    }
}

/// `nohup` has the end of the terminal ignored; SIGTERM still ends the training.
#[cfg(target_os = "linux")]
#[test]
fn an_ignored_end_of_the_terminal_stays_ignored() {
    let (sandbox, _) = Sandbox::with_scene();
    let arguments = "train scene --method 3dgs --iterations 1000000 -m model --save-iterations 3";
    let program = sandbox.command(arguments);
    let mut command = Command::new("sh");
    command.args(["-c", "trap '' HUP; exec \"$0\" \"$@\""]).arg(program.get_program()).args(program.get_args());
    command.current_dir(program.get_current_dir().unwrap());
    command.envs(program.get_envs().filter_map(|(name, value)| Some((name, value?))));
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let first = sandbox.path("model/point_cloud/iteration_3/point_cloud.ply");
    wait_for(PATIENCE, || (first.is_file() || child.try_wait().unwrap().is_some()).then_some(()));
    let send = |signal: &str| {
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    };
    send("-HUP");
    std::thread::sleep(Duration::from_millis(300));
    send("-TERM");
    Outcome::of_child(arguments, child).assert_stopped(143);
}
