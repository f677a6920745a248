//! Stopped trainings go on: `--resume`.

use super::{Outcome, PATIENCE, Sandbox, files_in, wait_for};
use ibgs_core::output::OutputFolder;
use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

const OPTIONS: &str = "train scene --config run.toml --eval --deterministic";

fn options(iterations: u32) -> String {
    format!(
        "iterations = {iterations}\nsave-iterations = [3]\n[surface]\nstart = 4\n[residual]\nstart = 8\nfactor = 0.25\n\
         [poses]\nrefine = \"on\"\nfrom = 2\n"
    )
}

/// Begins a training and waits until it has a checkpoint of a later iteration, or has ended.
fn begun(sandbox: &Sandbox, arguments: &str, after: u32) -> Child {
    let mut command = sandbox.command(arguments);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let reached = || checkpoints(sandbox).last().is_some_and(|&last| last > after);
    wait_for(PATIENCE, || (reached() || child.try_wait().unwrap().is_some()).then_some(()));
    child
}

/// Ends a training with a signal once it has a checkpoint of a later iteration.
pub fn killed(sandbox: &Sandbox, arguments: &str, signal: &str, after: u32) -> Outcome {
    let child = begun(sandbox, arguments, after);
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    Outcome::of_child(arguments, child)
}

/// Whether this process, and so its children, ignore the end of the terminal.
fn ignores_hangup() -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    mask.is_some_and(|mask| mask & 1 == 1)
}

/// Iterations of the checkpoints, the latest last.
fn checkpoints(sandbox: &Sandbox) -> Vec<u32> {
    let Ok(entries) = fs::read_dir(sandbox.path("model/checkpoints")) else { return Vec::new() };
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    // Beside them lies what is being written.
    let mut found: Vec<u32> = names.filter_map(|name| name.strip_suffix(".ibgs")?.parse().ok()).collect();
    found.sort_unstable();
    found
}

fn checkpoint(sandbox: &Sandbox, iteration: u32) -> PathBuf {
    sandbox.path(&format!("model/checkpoints/{iteration}.ibgs"))
}

#[test]
fn a_killed_training_goes_on_to_the_same_model() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.write("run.toml", options(60));
    sandbox.succeeds(&format!("{OPTIONS} -m whole"));
    assert!(!sandbox.path("whole/checkpoints").exists(), "a finished run needs none");
    let outcome = killed(&sandbox, &format!("{OPTIONS} -m model --checkpoint-every 0.000001"), "-KILL", 0);
    assert_eq!(outcome.code, None, "{outcome}");
    let found = checkpoints(&sandbox);
    assert!(!found.is_empty() && found.len() <= 3 && found[0] < 60, "{found:?}");

    // What does not belong to the run is refused, and nothing is touched. So is a training that would remove the stopped one,
    // also before its first save.
    let saved = sandbox.path("model/point_cloud");
    if saved.exists() {
        fs::remove_dir_all(saved).unwrap();
    }
    // One that was killed before its first checkpoint has not ended.
    let config = sandbox.text("whole/config.toml");
    sandbox.write("whole/config.toml", config.replace("iterations = 60\n", "iterations = 90\n"));
    let words = ["no checkpoint to resume from", "iteration 60 of 90", "`--init", "`--overwrite`"];
    sandbox.fails("train --resume -m whole", &words);
    sandbox.write("whole/config.toml", config);
    sandbox.write("model/checkpoints/.ibgs-cut-off.tmp", "half a checkpoint");
    let before = files_in(&sandbox.path("model"));
    sandbox.run("train --resume").assert_failure(2, &["required arguments"]);
    sandbox.fails("train --resume -m nowhere", &["nowhere holds no checkpoint"]);
    sandbox
        .fails("train --resume -m whole", &["the training in whole has ended", "60 iterations", "nothing to resume"]);
    let words = ["model holds a training that stopped after iteration", "`ibgs train --resume -m model`"];
    sandbox.fails(&format!("{OPTIONS} -m model"), &words);
    sandbox.run("train --resume -m model --overwrite").assert_failure(2, &["--overwrite"]);
    let keeps = "a resumed run keeps its options";
    sandbox.fails("train --resume -m model --iterations 70", &["`iterations` at 60, not 70", keeps]);
    sandbox.fails("train --resume -m model --residual-factor 0.5", &["`residual.factor` at 0.25, not 0.5", keeps]);
    sandbox.fails("train --resume -m model --max-splats 5", &["`densify.max-splats` at 200000, not 5", keeps]);
    sandbox.fails("train --resume -m model --resolution 2", &["`data.resolution`", keeps]);
    assert_eq!(files_in(&sandbox.path("model")), before);

    // The scene has moved.
    fs::rename(sandbox.path("scene"), sandbox.path("moved")).unwrap();
    sandbox.fails("train --resume -m model", &["scene", "check that it exists"]);
    let resumed = sandbox.succeeds("train moved --resume -m model --iterations 60 --host-memory 1KiB");
    let last = found[found.len() - 1];
    assert!(resumed.stderr.contains(&format!("resuming from iteration {last} of 60")), "{resumed}");
    for file in ["point_cloud.ply", "residual_network.safetensors"] {
        let [whole, model] = ["whole", "model"]
            .map(|folder| fs::read(sandbox.path(&format!("{folder}/point_cloud/iteration_60/{file}"))).unwrap());
        assert!(whole == model, "{file} of the resumed run differs");
    }
    assert_eq!(sandbox.text("whole/cameras.json"), sandbox.text("model/cameras.json"), "refined cameras");
    assert!(!sandbox.path("model/checkpoints").exists());
    assert!(sandbox.text("model/config.toml").contains("moved"), "a later `render` must find the scene");
    assert_eq!(sandbox.json("model/result_training.json")["ours_60"]["iterations"], 60);
    let [whole, model] = ["whole", "model"].map(|folder| {
        let log = sandbox.json(&format!("{folder}/training_log.json"));
        let entries = log["entries"].as_array().unwrap().clone();
        entries.iter().map(|entry| (entry["iteration"].clone(), entry["loss"].clone())).collect::<Vec<_>>()
    });
    assert!(whole == model && !whole.is_empty(), "{whole:?} and {model:?}");
}

#[test]
fn an_interrupted_training_leaves_a_checkpoint_and_the_one_before_helps() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.write("run.toml", options(100_000));
    let outcome = killed(&sandbox, &format!("{OPTIONS} -m model --checkpoint-every 0.000001"), "-TERM", 0);
    outcome.assert_stopped(143);
    assert!(outcome.stderr.contains("`ibgs train --resume -m model` continues from here"), "{outcome}");
    assert!(!outcome.stderr.contains("shows it"), "{outcome}");
    let found = checkpoints(&sandbox);
    let &[before, last] = &found[..] else { panic!("two stay, not {found:?}") };

    // The newest is cut off: the one before does. None without a whole one.
    let bytes = fs::read(checkpoint(&sandbox, last)).unwrap();
    fs::write(checkpoint(&sandbox, last), &bytes[..bytes.len() / 2]).unwrap();
    // A closed terminal, unless `nohup` runs the tests.
    let (signal, code) = if ignores_hangup() { ("-INT", 130) } else { ("-HUP", 129) };
    let outcome = killed(&sandbox, "train --resume -m model --checkpoint-every 0.000001", signal, last);
    outcome.assert_stopped(code);
    assert!(outcome.stderr.contains(&format!("{last}.ibgs is damaged")), "{outcome}");
    assert!(outcome.stderr.contains("resuming from the one before"), "{outcome}");
    assert!(outcome.stderr.contains(&format!("resuming from iteration {before} of 100000")), "{outcome}");
    let left = checkpoints(&sandbox);
    assert!(left.len() == 2 && left[1] > last, "{left:?}");
    for iteration in left {
        fs::write(checkpoint(&sandbox, iteration), "PK").unwrap();
    }
    sandbox.fails("train --resume -m model", &[".ibgs is damaged"]);

    // Another scene in the place of the first.
    fs::write(checkpoint(&sandbox, last), &bytes).unwrap();
    let mut cameras: serde_json::Value = sandbox.json("scene/transforms.json");
    cameras["fl_x"] = (cameras["fl_x"].as_f64().unwrap() + 1.0).into();
    sandbox.write("scene/transforms.json", cameras.to_string());
    sandbox.fails("train --resume -m model", &["belongs to another scene"]);

    // A new training removes what is there.
    sandbox.write("run.toml", options(4));
    let outcome = sandbox.succeeds("train scene --config run.toml -m model --overwrite");
    assert!(outcome.stderr.contains("`ibgs view model` shows it"), "{outcome}");
    assert!(checkpoints(&sandbox).is_empty());
}

/// A disk that becomes read-only, and a photo that goes: each told in a sentence, and nothing lost.
#[cfg(target_os = "linux")]
#[test]
fn what_goes_away_while_training() {
    let (sandbox, _) = Sandbox::with_scene();
    let path = sandbox.path("model");
    let test = "cli::resume::what_goes_away_while_training";
    let Some(_disk) = super::bad_machine::Disk::mount(&path, "20m", test) else { return };
    let remount = |how: &str| {
        let options = format!("remount,{how}");
        // The disk is busy while a checkpoint is being written.
        let is_done = || Command::new("mount").args(["-o", &options]).arg(&path).status().unwrap().success();
        assert!(wait_for(PATIENCE, || is_done().then_some(())).is_some());
    };
    sandbox.write("run.toml", options(60));
    let arguments = format!("{OPTIONS} -m model --checkpoint-every 0.000001");
    let child = begun(&sandbox, &arguments, 4);
    remount("ro");
    let outcome = Outcome::of_child(&arguments, child);
    outcome.assert_failure(1, &["choose a folder you may write to"]);
    remount("rw");
    let left = *checkpoints(&sandbox).last().unwrap();

    let photo = fs::read_dir(sandbox.path("scene/images")).unwrap().next().unwrap().unwrap().path();
    let aside = sandbox.path("aside");
    fs::rename(&photo, &aside).unwrap();
    let refused = sandbox.run("train --resume -m model");
    refused.assert_failure(1, &[]);
    assert_eq!(checkpoints(&sandbox).last(), Some(&left), "{refused}");
    fs::rename(&aside, &photo).unwrap();
    let resumed = sandbox.succeeds("train --resume -m model");
    assert!(resumed.stderr.contains(&format!("resuming from iteration {left} of 60")), "{resumed}");
    assert!(sandbox.path("model/point_cloud/iteration_60/point_cloud.ply").is_file());
}

/// A full disk does not end the training: it continues without the checkpoint.
#[cfg(target_os = "linux")]
#[test]
fn a_disk_too_small_for_checkpoints() {
    let (sandbox, _) = Sandbox::with_scene();
    let path = sandbox.path("disk");
    let test = "cli::resume::a_disk_too_small_for_checkpoints";
    let Some(_disk) = super::bad_machine::Disk::mount(&path, "900k", test) else { return };
    sandbox.write("run.toml", options(30));
    let outcome = sandbox.succeeds("train scene --config run.toml -m disk/model --checkpoint-every 0.000001");
    assert!(outcome.stderr.contains("the training continues without this checkpoint"), "{outcome}");
    assert!(outcome.stderr.contains("free some disk space"), "{outcome}");
    assert!(sandbox.path("disk/model/point_cloud/iteration_30/point_cloud.ply").is_file(), "{outcome}");
}

#[test]
fn the_number_of_gaussians_stops_at_the_memory_given() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.fails(
        "train scene -m out --iterations 2 --gpu-memory 1MiB",
        &["needs about", "1 MiB is there (`--gpu-memory`)"],
    );
    assert!(!sandbox.path("out").exists());
    let outcome = sandbox.succeeds("train scene -m out --iterations 2 --gpu-memory 100MiB");
    assert!(outcome.stderr.contains("200000 Gaussians would need"), "{outcome}");
    let config = sandbox.text("out/config.toml");
    let most = config.lines().find_map(|line| line.strip_prefix("max-splats = ")).unwrap();
    assert!(outcome.stderr.contains(&format!("their number stops at {most}")), "{outcome}");
    assert!((1_000..100_000).contains(&most.parse::<u32>().unwrap()), "{most}");
    let outcome = sandbox.succeeds("train scene -m all --iterations 2 --gpu-memory none");
    assert!(!outcome.stderr.contains("warning"), "{outcome}");
}

/// A folder has one training at a time, which nothing removes while it runs.
#[cfg(unix)]
#[test]
fn a_folder_that_is_trained_into_is_refused() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.succeeds("train scene --method 3dgs --iterations 1 -m model");
    let before = files_in(&sandbox.path("model"));
    let lock = OutputFolder::at(&sandbox.path("model")).lock().unwrap();
    for options in ["", " --overwrite"] {
        let command = format!("train scene --method 3dgs --iterations 1 -m model{options}");
        sandbox.fails(&command, &["model is being trained into by another run"]);
    }
    assert_eq!(files_in(&sandbox.path("model")), before);
    drop(lock);
    sandbox.succeeds("train scene --method 3dgs --iterations 1 -m model --overwrite");
}

/// A model in its own scene would hide the scene's files.
#[test]
fn a_scene_is_no_output_folder() {
    let (sandbox, _) = Sandbox::with_scene();
    let before = files_in(&sandbox.path("scene"));
    for options in ["", " --overwrite"] {
        sandbox
            .fails(&format!("train scene --iterations 1 -m scene{options}"), &["scene is the scene itself", "--model"]);
    }
    assert_eq!(files_in(&sandbox.path("scene")), before);
}
