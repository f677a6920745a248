//! What a run tells while it works: lines in log files, records, and nothing of drivers.

use super::Sandbox;
use ibgs_testing::TINY;
use serde_json::Value;
use std::fs;

#[cfg(unix)]
fn records(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))).collect()
}

#[cfg(unix)]
fn of<'a>(records: &'a [Value], event: &str) -> Vec<&'a Value> {
    records.iter().filter(|record| record["event"] == event).collect()
}

#[test]
fn a_training_tells_how_far_it_is_where_no_bar_shows() {
    let (sandbox, told) = Sandbox::with_trained();
    let is_progress = |line: &&str| line.starts_with("iteration ") && line.contains(" of 30 (");
    let lines: Vec<&str> = told.lines().filter(is_progress).collect();
    // Every second iteration is a twentieth, rounded up; on a slow machine half a minute is less.
    assert!((10..30).contains(&lines.len()), "{told}");
    // The time left is known after half a second.
    let is_whole =
        |line: &&str| line.ends_with(" Gaussians") || line.contains(" Gaussians, about ") && line.ends_with(" left");
    assert!(lines.iter().all(is_whole), "{told}");
    assert!(!told.contains("iteration 30 of 30"), "the end has its own report: {told}");
    assert!(!sandbox.path("log.jsonl").exists());
}

/// Stopped and resumed, the file has one record after the other.
#[cfg(unix)]
#[test]
fn records_are_appended_when_a_training_is_resumed() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.write("run.toml", "iterations = 100000\nmethod = \"3dgs\"\n");
    let first = "train scene --config run.toml --eval -m model --log-json logs/a.jsonl --checkpoint-every 0.000001";
    super::resume::killed(&sandbox, first, "-TERM", 100).assert_stopped(143);
    let stopped = records(&sandbox.text("logs/a.jsonl"));
    assert_eq!((stopped[0]["event"].as_str(), stopped[0]["iteration"].as_u64()), (Some("start"), Some(0)));
    let end = stopped.last().unwrap();
    let last = end["iteration"].as_u64().unwrap();
    assert!(end["event"] == "end" && (100..100_000).contains(&last), "{end}");
    let progress = of(&stopped, "progress");
    // The first figures are back after 40 iterations, the next 32 later each time.
    assert!(progress.len() >= 2 && progress[0]["iteration"] == 40 && progress[1]["iteration"] == 72, "{progress:?}");
    for record in &progress {
        for name in ["loss", "l1", "ssim", "psnr", "seconds", "gaussians"] {
            assert!(record[name].as_f64().is_some_and(|value| value > 0.0), "{name}: {record}");
        }
        assert!(record["stage"] == "base" && record.get("memory_bytes").is_some(), "{record}");
    }

    // What a killed one leaves half written.
    let text = sandbox.text("logs/a.jsonl");
    sandbox.write("logs/a.jsonl", format!("{text}{{\"event\": \"pro"));
    let again = "train --resume -m model --log-json logs/a.jsonl --checkpoint-every 0.000001";
    super::resume::killed(&sandbox, again, "-TERM", u32::try_from(last).unwrap()).assert_stopped(143);
    let whole = sandbox.text("logs/a.jsonl");
    let more = whole.strip_prefix(&format!("{text}{{\"event\": \"pro\n")).expect("the records before stay");
    let resumed = records(more);
    assert!(resumed[0]["event"] == "start" && resumed[0]["iteration"] == last, "{}", resumed[0]);
    let evaluation = *of(&resumed, "evaluation").last().unwrap();
    let last = resumed.last().unwrap()["iteration"].as_u64().unwrap();
    let results = &sandbox.json("model/results_renders.json")[format!("ours_{last}")];
    assert_eq!((&evaluation["base"]["psnr"], &evaluation["views"]), (&results["PSNR"], &results["views"]));
    assert!(evaluation["final"].is_null() && evaluation["iteration"] == last, "{more}");
    let commands = &sandbox.json("model/result_training.json")[format!("ours_{last}")]["commands"];
    let commands: Vec<&str> = commands.as_array().unwrap().iter().map(|line| line.as_str().unwrap()).collect();
    assert!(commands[0].starts_with("ibgs train scene --config run.toml --eval -m model"), "{commands:?}");
    assert!(commands.len() == 2 && commands[1].starts_with("ibgs train --resume -m model"), "{commands:?}");

    // Another training needs another file, or leave.
    let again = "train scene --method 3dgs --iterations 2 --log-json logs/a.jsonl";
    sandbox.fails(&format!("{again} -m other"), &["logs/a.jsonl is there already", "`--log-json`", "`--overwrite`"]);
    sandbox.fails("train scene --iterations 2 -m other --log-json scene", &["the folder scene", "`--log-json`"]);
    sandbox.succeeds(&format!("{again} -m other --overwrite"));
    assert_eq!(records(&sandbox.text("logs/a.jsonl")).len(), 2, "start and end");
}

/// Neither figures nor an endless score come from a photo that is masked as a whole.
#[test]
fn a_wholly_masked_view_enters_no_mean() {
    let (sandbox, _) = Sandbox::with_model();
    let before = sandbox.succeeds("eval model");
    assert!(!before.stdout.contains("mask"), "{before}");
    let per_view = sandbox.json("model/per_view_renders.json")["ours_3"]["PSNR"].clone();
    fs::create_dir_all(sandbox.path("scene/masks")).unwrap();
    image::GrayImage::new(TINY[0], TINY[1]).save(sandbox.path("scene/masks/view_000.png")).unwrap();
    let outcome = sandbox.succeeds("eval model");
    assert!(outcome.stdout.contains("a held-out view has no score, as its photo is masked as a whole"), "{outcome}");
    assert!(
        outcome.stdout.contains("masked pixels and blank edges of undistorted photos do not count; 1 of 2 photos have"),
        "{outcome}"
    );
    let results = &sandbox.json("model/results_renders.json")["ours_3"];
    assert_eq!((&results["PSNR"], &results["views"]), (&per_view["images/view_008.png"], &Value::from(1)), "{outcome}");
    let scored = sandbox.json("model/per_view_renders.json")["ours_3"]["PSNR"].clone();
    assert_eq!(scored.as_object().unwrap().keys().collect::<Vec<_>>(), ["images/view_008.png"]);
    assert!(sandbox.text("model/report.html").contains("masked as a whole"));
    let trained = sandbox.succeeds("train scene --method 3dgs --iterations 2 --eval -m out");
    assert!(trained.stderr.contains("over 1 view;") && trained.stderr.contains("masked as a whole"), "{trained}");

    // Without any view that counts there is no mean.
    image::GrayImage::new(TINY[0], TINY[1]).save(sandbox.path("scene/masks/view_008.png")).unwrap();
    let outcome = sandbox.succeeds("eval model");
    assert!(outcome.stdout.contains("2 held-out views have no score") && !outcome.stdout.contains("NaN"), "{outcome}");
    assert!(sandbox.json("model/results_renders.json")["ours_3"]["PSNR"].is_null());
}

/// Mesa's layer looks for a desktop that a server does not have.
#[cfg(target_os = "linux")]
#[test]
fn drivers_tell_nothing_of_a_desktop_that_is_not_there() {
    let sandbox = Sandbox::new();
    for arguments in ["info", "bench --gaussians 9 --size 16x16 --iterations 5"] {
        let mut command = sandbox.command(arguments);
        for name in ["XDG_RUNTIME_DIR", "WAYLAND_DISPLAY", "WAYLAND_SOCKET", "DISPLAY"] {
            command.env_remove(name);
        }
        let outcome = super::Outcome::of(arguments, &mut command);
        outcome.assert_success();
        assert!(!outcome.stderr.contains("XDG_RUNTIME_DIR"), "{outcome}");
    }
}
