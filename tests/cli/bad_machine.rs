//! Machines that refuse: no adapter, no permission, no space.

use super::Sandbox;
use ibgs_testing::skipped;
use std::fs;
use std::path::Path;
use std::process::Command;

#[test]
fn adapters_that_are_not_there() {
    let (sandbox, _) = Sandbox::with_model();
    let commands = ["train scene -m out --iterations 2", "train -m out", "render model", "eval model", "bench"];
    for command in commands {
        sandbox.fails(&format!("{command} --adapter nosuch"), &["--adapter nosuch", "this machine has: 0: "]);
    }
    sandbox.fails("bench --adapter 99", &["--adapter 99"]);
    if cfg!(target_os = "linux") {
        for command in commands.into_iter().chain(["info"]) {
            let mut process = sandbox.command(command);
            process.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
            let fragments = ["no GPU adapter was found", "apt install mesa-vulkan-drivers"];
            sandbox.fails_as(&mut process, command, 1, &fragments);
        }
        let mut process = sandbox.command("export model -o a.ibgs");
        process.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
        assert!(process.status().unwrap().success(), "an export needs no adapter");
    }
}

/// A camera path of one frame.
fn path_json(width: u32, height: u32) -> String {
    let matrix = "[1,0,0,0, 0,1,0,0, 0,0,1,2, 0,0,0,1]";
    format!(
        r#"{{"camera_path":[{{"camera_to_world":{matrix},"fov":50}}],"render_width":{width},"render_height":{height}}}"#
    )
}

#[test]
fn places_that_cannot_be_written() {
    let (sandbox, _) = Sandbox::with_model();
    sandbox.write("file", "a file");
    sandbox.write("path.json", path_json(48, 36));
    let advice = "choose another path";
    sandbox.fails("train scene --iterations 2 -m file", &["file", advice]);
    sandbox.fails("train scene --iterations 2 -m file --overwrite", &["file", advice]);
    sandbox.fails("train scene --iterations 2 -m file/below", &["file/below", advice]);
    sandbox.fails("render model --camera-path path.json -o file/below", &["file/below", advice]);
    sandbox.fails("bench --gaussians 9 --size 16x16 --iterations 5 --json file/below", &["file/below", advice]);
    sandbox.fails("bench --gaussians 9 --size 16x16 --iterations 5 --json model", &["model", advice]);
}

/// A capable adapter does it, another one says what does not fit.
#[test]
fn sizes_beyond_an_adapter() {
    let (sandbox, _) = Sandbox::with_model();
    sandbox.write("path.json", path_json(4000, 3000));
    let commands = [
        "render model --camera-path path.json -o frames",
        "bench --gaussians 9 --size 4000x3000 --iterations 5",
        "bench --gaussians 800000 --sh-degree 3 --size 16x16 --iterations 5",
    ];
    for command in commands {
        let outcome = sandbox.run(command);
        match outcome.code {
            Some(0) => outcome.assert_success(),
            _ => outcome.assert_failure(1, &["more than this device allows"]),
        }
    }
}

#[test]
fn a_cause_is_told_once() {
    let sandbox = Sandbox::new();
    sandbox.write("file", "a file");
    let once = |arguments: &str, cause: &str| {
        let outcome = sandbox.run(arguments);
        outcome.assert_failure(1, &[cause]);
        assert_eq!(outcome.stderr.matches(cause).count(), 1, "{outcome}");
    };
    if cfg!(unix) {
        once("train nowhere", "os error 2");
        once("train --config nowhere.toml", "os error 2");
        once("train -m file", "os error");
        once("render nowhere --camera-path nowhere.json", "os error 2");
    }
}

#[cfg(unix)]
#[test]
fn folders_without_permission() {
    use std::os::unix::fs::PermissionsExt;
    let (sandbox, _) = Sandbox::with_scene();
    let locked = sandbox.path("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o555)).unwrap();
    if fs::write(locked.join("probe"), "").is_ok() {
        skipped("cli::bad_machine::folders_without_permission", "permission bits do not bind this user");
        return;
    }
    sandbox.fails("train scene --iterations 2 -m locked", &["locked", "choose a folder you may write to"]);
    sandbox.fails("train scene --iterations 2 -m locked/model", &["locked/model", "choose a folder you may write to"]);
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o755)).unwrap();
}

/// A tiny disk; unmounted when dropped.
pub struct Disk<'a>(&'a Path);

impl Disk<'_> {
    /// Or none where mounting is not allowed, and the test of this name is skipped.
    pub fn mount<'a>(path: &'a Path, size: &str, test: &str) -> Option<Disk<'a>> {
        fs::create_dir_all(path).unwrap();
        let options = format!("size={size}");
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &options, "ibgs-test"]).arg(path);
        match mount.output() {
            Ok(output) if output.status.success() => Some(Disk(path)),
            _ => {
                skipped(test, &format!("a disk of {size} cannot be mounted here"));
                None
            }
        }
    }
}

impl Drop for Disk<'_> {
    fn drop(&mut self) {
        let unmounted = Command::new("umount").arg(self.0).status().is_ok_and(|status| status.success());
        assert!(unmounted || std::thread::panicking(), "{} stays mounted", self.0.display());
    }
}

#[cfg(target_os = "linux")]
#[test]
fn full_disks() {
    let (sandbox, _) = Sandbox::with_scene();
    let path = sandbox.path("disk");
    let advice = "free some disk space";
    let test = "cli::bad_machine::full_disks";
    // Too small for what is known before the training.
    let Some(disk) = Disk::mount(&path, "16k", test) else { return };
    sandbox.fails("train scene --iterations 2 -m disk/model", &["disk/model", advice]);
    drop(disk);
    // Room for that, but not for the model: the run goes on to its end and fails there, and no part of a model is left.
    let Some(disk) = Disk::mount(&path, "44k", test) else { return };
    let outcome = sandbox.run("train scene --iterations 2 -m disk/model");
    outcome.assert_failure(1, &["iteration_2", "residual_network.safetensors", advice]);
    let warning = "warning: cannot write disk/model/point_cloud/iteration_1/point_cloud.ply";
    assert!(outcome.stderr.contains(warning) && outcome.stderr.contains("saves again later"), "{outcome}");
    let mut expected =
        ["cameras.json", "config.toml", "input.ply", "multi_view.json", "split.json", "training_log.json"]
            .map(|name| format!("model/{name}"))
            .to_vec();
    assert_eq!(super::files_in(&path), expected);
    drop(disk);
    // Room for the Gaussians of the first iteration, but not for the network of the second: no model without its network.
    let Some(_disk) = Disk::mount(&path, "200k", test) else { return };
    let outcome = sandbox.run("train scene --iterations 2 -m disk/model");
    outcome.assert_failure(1, &["iteration_2", "residual_network.safetensors", advice]);
    expected.insert(4, "model/point_cloud/iteration_1/point_cloud.ply".to_owned());
    assert_eq!(super::files_in(&path), expected);
}
