//! `ibgs split`, `train --block`, `merge`: a scene in blocks, on one machine and by Slurm.

use super::{Outcome, PATIENCE, Sandbox, wait_for};
use ibgs_core::blocks::PlanFolder;
use ibgs_core::output::OutputFolder;
use ibgs_core::scene::read_ply;
use ibgs_testing::tiny_demo;
use std::process::{Command, Stdio};

/// Cuts the tiny demo into three blocks.
fn cut(sandbox: &Sandbox, options: &str) -> PlanFolder {
    let told = sandbox.succeeds(&format!("split scene -o plan --blocks 3 -- --eval {options}"));
    assert!(told.stdout.contains("photos, test") && told.stdout.contains("`ibgs suite plan`"), "{told}");
    PlanFolder::at(&sandbox.path("plan"))
}

fn has_model(plan: &PlanFolder, block: u32) -> bool {
    OutputFolder::at(&plan.block_path(block)).latest_iteration().unwrap().is_some()
}

#[test]
fn three_blocks_are_trained_merged_and_measured() {
    let (sandbox, dataset) = Sandbox::with_scene();
    let plan = cut(&sandbox, "--iterations 12 --eval-iterations 12 --save-iterations 3");
    let cores = plan.read().unwrap().blocks;
    // A block is killed, and trained on by the same command.
    let arguments = "train plan --block 1 --checkpoint-every 0.0001";
    let mut child = sandbox.command(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let folder = OutputFolder::at(&plan.block_path(1));
    let stopped = wait_for(PATIENCE, || {
        (!folder.checkpoints().unwrap().is_empty() || child.try_wait().unwrap().is_some()).then_some(())
    });
    child.kill().unwrap();
    let killed = !child.wait().unwrap().success();
    assert!(stopped.is_some() && killed, "it ended before it was killed");
    let info = sandbox.succeeds("info plan");
    let stopped = |line: &str| line.trim_start().starts_with("1 |") && line.contains(" at ");
    assert!(info.stdout.contains("a plan of blocks for") && info.stdout.lines().any(stopped), "{info}");
    let resumed = sandbox.succeeds("train plan --block 1");
    assert!(resumed.stderr.contains("resuming from iteration"), "{resumed}");
    let again = sandbox.succeeds("train plan --block 1");
    assert!(again.stderr.contains("block 1 is trained") && !again.stderr.contains("resuming"), "{again}");
    assert!(!has_model(&plan, 0));
    sandbox.fails("merge plan", &["block 0 is not trained yet", "`ibgs train plan --block 0`"]);

    // One part, then the rest, the merging and the evaluation.
    let part = sandbox.succeeds("suite plan --shard 1/3");
    assert!(part.stderr.contains("without `--shard`") && has_model(&plan, 0), "{part}");
    let whole = sandbox.succeeds("suite plan");
    assert!(whole.stderr.contains("2 of 3 runs are there already") && whole.stderr.contains("merging"), "{whole}");
    let model = OutputFolder::open(&plan.model_path()).unwrap();
    assert_eq!(model.latest_iteration().unwrap(), Some(12));
    let joined = read_ply(&plan.joined_path()).unwrap();
    let mut inside = 0;
    for (number, block) in (0..).zip(&cores) {
        let folder = OutputFolder::at(&plan.block_path(number));
        let trained = read_ply(&folder.point_cloud_path(12)).unwrap();
        inside += trained.positions().filter(|&mean| block.core.contains(mean)).count();
        // It has its own photos only, in the split of the scene.
        let cameras = folder.read_cameras().unwrap();
        assert_eq!(cameras.len(), block.train.len() + block.test.len());
        assert!(cameras.iter().all(|camera| block.train.contains(&camera.name) || block.test.contains(&camera.name)));
    }
    assert_eq!(joined.len(), inside);
    let scores = sandbox.json("plan/model/results_renders_aggregate.json");
    assert_eq!(scores["ours_12"]["views"], dataset.test.len(), "{scores}");
    assert!(sandbox.path("plan/model/report.html").is_file());
    let info = sandbox.succeeds("info plan");
    assert_eq!(info.stdout.matches("| trained").count(), 3, "{info}");
    // Everything is there.
    let nothing = sandbox.succeeds("suite plan");
    assert!(!nothing.stderr.contains("merging (log"), "{nothing}");
    let merged = sandbox.succeeds("merge plan");
    assert!(merged.stderr.contains("the blocks are merged"), "{merged}");
    // The same in another folder, and not in one that is taken.
    sandbox.fails("merge plan -o plan", &["plan is the plan itself"]);
    sandbox.fails("suite plan -o plan", &["plan is the plan itself"]);
    sandbox.fails("merge plan -o plan/blocks/0 --iterations 0", &["plan/blocks/0", "model"]);
    // The same without a training.
    sandbox.succeeds("merge plan -o as-it-is --iterations 0");
    let as_it_is = OutputFolder::open(&sandbox.path("as-it-is")).unwrap();
    assert_eq!(read_ply(&as_it_is.point_cloud_path(12)).unwrap().len(), inside);
    let rendered = sandbox.succeeds("render as-it-is --outputs final");
    assert!(rendered.stderr.contains("as-it-is"), "{rendered}");
    let again = sandbox.succeeds("merge plan -o as-it-is --iterations 0");
    assert!(again.stderr.contains("merged without a training"), "{again}");
    sandbox.fails("merge plan -o as-it-is --iterations 5", &["as-it-is is a merge with 0 iterations, not 5"]);
    // So it is where the memory does not suffice for a training, unless one is asked for.
    let tight = sandbox.succeeds("merge plan -o tight --gpu-memory 1MiB");
    assert!(tight.stderr.contains("1 MiB is there (`--gpu-memory`)"), "{tight}");
    assert!(tight.stderr.contains("so the blocks are merged without a training"), "{tight}");
    let tight = OutputFolder::open(&sandbox.path("tight")).unwrap();
    assert_eq!(read_ply(&tight.point_cloud_path(12)).unwrap().len(), inside);
    sandbox.fails("merge plan -o tighter --iterations 5 --gpu-memory 1MiB", &["needs about", "--iterations 0"]);
    assert!(!sandbox.path("tighter").exists());
    // A plan may move; its blocks are models all the same.
    std::fs::rename(sandbox.path("plan"), sandbox.path("moved")).unwrap();
    let merged = sandbox.succeeds("merge moved");
    assert!(merged.stderr.contains("the blocks are merged"), "{merged}");
    sandbox.succeeds("eval moved/blocks/0");
    let trained = sandbox.succeeds("train moved --block 2");
    assert!(trained.stderr.contains("block 2 is trained"), "{trained}");
}

/// The tiny demo in `off/`, with what its photos have of the points, and training cameras that are turned by three degrees.
fn turned_scene(sandbox: &Sandbox) {
    let traced = ibgs_demo::load(&tiny_demo(), Some(&sandbox.path("traced")), &()).unwrap();
    std::fs::rename(&traced.path, sandbox.path("off")).unwrap();
    let mut listing = sandbox.json("off/transforms.json");
    for &view in &traced.train {
        let angle = 3_f64.to_radians();
        let (s, c) = if view % 2 == 0 { (angle.sin(), angle.cos()) } else { (-angle.sin(), angle.cos()) };
        // About the x or the y axis of the camera.
        let turn = if view % 3 == 0 {
            [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]
        } else {
            [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
        };
        let matrix = &mut listing["frames"][view]["transform_matrix"];
        let rows: [[f64; 4]; 4] = serde_json::from_value(matrix.take()).unwrap();
        let turned = rows.map(|row| {
            let [x, y, z] = [0, 1, 2].map(|column| (0..3).map(|k| row[k] * turn[k][column]).sum::<f64>());
            [x, y, z, row[3]]
        });
        *matrix = serde_json::json!(turned);
    }
    sandbox.write("off/transforms.json", listing.to_string());
}

#[test]
fn all_blocks_begin_with_cameras_that_were_adjusted_before() {
    let (sandbox, _) = Sandbox::with_scene();
    turned_scene(&sandbox);
    let options = "--eval --method 3dgs --iterations 4 --refine-poses auto";
    let told = sandbox.succeeds(&format!("split off -o plan --blocks 2 -- {options}"));
    assert!(told.stderr.contains("cameras: adjusted to "), "{told}");
    sandbox.fails("train plan --block 0 --refine-poses auto", &["share their cameras"]);
    sandbox.succeeds("train plan --block 0");
    sandbox.succeeds("train plan --block 1");
    sandbox.succeeds("merge plan -o joined --iterations 0");
    sandbox.succeeds("merge plan -o trained --iterations 2");
    let cameras = |folder: &str| OutputFolder::at(&sandbox.path(folder)).read_cameras().unwrap();
    let shared = cameras("plan");
    let camera = |name: &str| shared.iter().find(|record| record.name == name).unwrap().camera;
    for model in ["plan/blocks/0", "plan/blocks/1", "joined", "trained"] {
        assert!(cameras(model).iter().all(|record| record.camera == camera(&record.name)), "{model}");
    }
    // Moved, the plan and its models are as good.
    std::fs::rename(sandbox.path("plan"), sandbox.path("moved")).unwrap();
    sandbox.succeeds("merge moved --iterations 0");
    for model in ["joined", "moved/blocks/0", "moved/model"] {
        let outcome = sandbox.succeeds(&format!("eval {model} --true-cameras scene"));
        let scores = sandbox.json(&format!("{model}/results_true_cameras.json"));
        let degrees = scores["ours_4"]["training_cameras"]["degrees"].as_f64().unwrap();
        assert!(degrees < 0.8, "{degrees} of 3 degrees are left: {outcome}");
    }
    // Cameras that are right stay, and blocks read the scene's own.
    sandbox.succeeds(&format!("split scene -o still --blocks 2 -- {options}"));
    assert!(!sandbox.path("still/cameras.json").exists());
    assert!(!sandbox.text("still/options.toml").contains("refine = \"auto\""));
}

#[test]
fn what_cannot_be_split_or_trained_says_why() {
    let (sandbox, _) = Sandbox::with_scene();
    sandbox.fails("split scene -o plan --blocks 9", &["the scene has 300 points, too few for 9 blocks"]);
    sandbox.fails("split scene -o scene", &["scene exists already"]);
    sandbox.fails("split scene -o plan -- --resume -m x", &["`--resume`"]);
    sandbox.fails("split scene -o plan -- --refine-poses on", &["share their cameras", "`--refine-poses auto`"]);
    sandbox.fails("split scene -o plan -- --nonsense", &["not those of `ibgs train`", "--nonsense"]);
    sandbox.fails("split scene -o plan --gpu-memory 1MiB", &["1 MiB"]);
    sandbox.fails("split nowhere -o plan", &["nowhere"]);
    sandbox.fails("train scene --block 0", &["scene is no plan of blocks", "`ibgs split` makes one"]);
    sandbox.fails("merge scene", &["scene is no plan of blocks"]);
    sandbox.fails("suite scene", &["scene is no plan of blocks"]);
    sandbox.write("start.toml", "init = \"start.ply\"\n");
    sandbox.fails("split scene -o plan -- --config start.toml", &["leave the option `init` out"]);
    let plan = cut(&sandbox, "");
    sandbox.fails("train plan", &["plan is a plan of blocks", "`--block 0`"]);
    sandbox.fails("train plan --block 0 --refine-poses auto", &["block 0 of plan", "share their cameras"]);
    sandbox.write("log.jsonl", "kept\n");
    sandbox.fails("train plan --block 0 --log-json log.jsonl", &["log.jsonl is there already"]);
    sandbox.fails("train plan --block 3", &["has no block 3", "0 to 2"]);
    sandbox.fails("suite plan --iterations 5", &["`--iterations` does not apply to a plan"]);
    sandbox.fails("split scene -o plan", &["plan exists already"]);
    // A block that fails names itself.
    std::fs::rename(sandbox.path("scene"), sandbox.path("gone")).unwrap();
    let failed = sandbox.run("train plan --block 2");
    failed.assert_failure(1, &["block 2 of plan", "scene"]);
    let suite = sandbox.run("suite plan");
    suite.assert_failure(1, &["3 of 3 blocks failed", "0.log"]);
    assert!(suite.stderr.contains("2/3 block 1: training: failed: "), "{suite}");
    assert!(!has_model(&plan, 0));
}

#[test]
fn a_scene_with_a_split_of_its_own_is_measured_by_it() {
    let (sandbox, dataset) = Sandbox::with_scene();
    let names: Vec<String> = dataset.views.iter().map(|view| format!("images/{}", view.name)).collect();
    let train = names[3..].iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
    sandbox.write("scene/split.json", format!("{{\"train\": [{train}], \"test\": [\"{}\"]}}", names[0]));
    let told = sandbox.succeeds("split scene -o plan --blocks 2");
    assert!(told.stdout.contains("merges and measures"), "{told}");
    let plan = PlanFolder::at(&sandbox.path("plan")).read().unwrap();
    let mut named = plan.blocks.iter().flat_map(|block| block.train.iter().chain(&block.test));
    assert!(named.all(|name| !names[1..3].contains(name)), "{plan:?}");
    assert!(sandbox.text("plan/slurm.sh").contains("submit evaluate"));
}

/// A stand-in for Slurm's `sbatch`: it writes down how it was called, and answers with the number of a job.
const SBATCH: &str = r#"#!/bin/sh
calls=$(dirname "$0")/calls
for word in "$@"; do printf '%s\n' "$word" >> "$calls"; done
echo -- >> "$calls"
echo "$((100 + $(grep -c '^--$' "$calls")));cluster"
"#;

#[cfg(unix)]
#[test]
fn a_plan_is_handed_to_slurm() {
    use std::os::unix::fs::PermissionsExt;
    let (sandbox, _) = Sandbox::with_scene();
    let plan = cut(&sandbox, "--iterations 4");
    sandbox.write("bin/sbatch", SBATCH);
    let program = sandbox.path("bin/sbatch");
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let paths = format!("{}:{}", sandbox.path("bin").display(), std::env::var("PATH").unwrap());
    let mut shell = Command::new("sh");
    shell.arg(plan.root().join("slurm.sh")).args(["--partition=gpu", "--time=1:00:00"]).env("PATH", paths);
    shell.env("IBGS", env!("CARGO_BIN_EXE_ibgs")).current_dir(sandbox.path("bin"));
    let outcome = Outcome::of("slurm.sh", &mut shell);
    outcome.assert_success();
    assert_eq!(outcome.stdout.trim(), "103;cluster");
    let calls = sandbox.text("bin/calls");
    let calls: Vec<Vec<&str>> = calls.split("--\n").map(|call| call.lines().collect()).collect();
    assert_eq!(calls.len(), 4, "three calls and what comes after the last: {calls:?}");
    for call in &calls[..3] {
        assert!(call.contains(&"--partition=gpu") && call.contains(&"--time=1:00:00"), "{call:?}");
    }
    assert!(calls[0].contains(&"--array=0-2") && !calls[0].iter().any(|word| word.contains("dependency")));
    assert!(calls[1].contains(&"--dependency=afterok:101") && calls[2].contains(&"--dependency=afterok:102"));
    // What Slurm would run, run by a shell.
    let wrapped = |call: &[&str]| call.iter().find_map(|word| word.strip_prefix("--wrap=")).unwrap().to_owned();
    let run = |text: &str, block: &str| {
        let mut shell = sandbox.command("");
        let environment: Vec<_> = shell.get_envs().map(|(k, v)| (k.to_owned(), v.map(ToOwned::to_owned))).collect();
        shell = Command::new("sh");
        shell.args(["-c", text]).env("SLURM_ARRAY_TASK_ID", block).current_dir(sandbox.path("bin"));
        for (name, value) in environment {
            _ = match value {
                Some(value) => shell.env(name, value),
                None => shell.env_remove(name),
            };
        }
        Outcome::of(text, &mut shell).assert_success();
    };
    for block in ["0", "1", "2"] {
        run(&wrapped(&calls[0]), block);
    }
    assert!((0..3).all(|block| has_model(&plan, block)));
    assert!(wrapped(&calls[1]).contains(" merge '") && wrapped(&calls[2]).contains("/model'"));
}
