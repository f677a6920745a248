//! The program itself, run as a user runs it: what it writes, what it says and how it ends.

mod bad_bytes;
mod bad_input;
mod bad_machine;
mod bad_model;
mod bench;
mod blocks;
mod bundle;
mod compare;
mod docs;
mod ensemble;
mod folder;
mod formats;
mod image_based;
mod inputs;
mod install;
#[cfg(unix)]
mod interrupt;
#[cfg(unix)]
mod mappers;
mod mesh;
#[cfg(unix)]
mod photos;
#[cfg(unix)]
mod poses;
pub(crate) mod prepare;
mod report;
mod resume;
mod round;
mod seeing;
mod suite;
mod units;
mod web;

use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::{self, Dataset, LoadOptions};
use ibgs_core::output::{Existing, OutputFolder};
use ibgs_core::scene::{PlyFlavor, from_points, write_ply};
use ibgs_testing::scene_files::write_file;
use ibgs_testing::tiny_demo;
use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A folder of its own that the program runs in, so that relative paths and default folders end up there.
pub(crate) struct Sandbox {
    work: tempfile::TempDir,
    /// Cache and runtime folder of the program; no part of what a test compares.
    home: tempfile::TempDir,
}

impl Sandbox {
    fn new() -> Self {
        Sandbox { work: tempfile::tempdir().unwrap(), home: tempfile::tempdir().unwrap() }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.work.path().join(name)
    }

    /// The tiny demo as a nerfstudio scene in `scene/`, without what the photos have of the points.
    fn with_scene() -> (Self, Dataset) {
        let sandbox = Self::new();
        let dataset = ibgs_demo::load(&tiny_demo(), Some(sandbox.home.path()), &()).unwrap();
        assert!(dataset.notes.is_empty(), "{:?}", dataset.notes);
        fs::rename(&dataset.path, sandbox.path("scene")).unwrap();
        fs::remove_dir_all(sandbox.path("scene/colmap")).unwrap();
        (sandbox, dataset)
    }

    /// A model folder `model/` of that scene at iteration 3, with the first Gaussians in place of trained ones.
    fn with_model() -> (Self, OutputFolder) {
        let (sandbox, _) = Self::with_scene();
        let eval = LoadOptions { eval: true, ..LoadOptions::default() };
        let dataset = dataset::load(&sandbox.path("scene"), &eval).unwrap();
        let folder = OutputFolder::create(&sandbox.path("model"), Existing::Keep).unwrap();
        let mut config = TrainConfig { iterations: Some(3), ..TrainConfig::default() };
        config.source = Some(sandbox.path("scene"));
        config.data.eval = true;
        folder.write_start(&config, &dataset).unwrap();
        let gaussians = from_points(&dataset.points, config.sh_degree(), config.start()[0]).unwrap();
        write_ply(&folder.point_cloud_path(3), &gaussians, PlyFlavor::Full).unwrap();
        (sandbox, folder)
    }

    /// The tiny demo in `scene/` and in `model/` what a default run of 30 iterations makes of it, trained once for all
    /// tests; with what the run told.
    fn with_trained() -> (Self, &'static str) {
        static TRAINED: OnceLock<(Snapshot, String)> = OnceLock::new();
        let (files, told) = TRAINED.get_or_init(|| {
            let (sandbox, _) = Self::with_scene();
            let told = sandbox.succeeds("train scene --iterations 30 --eval -m model").stderr;
            let relative = |path: PathBuf| path.strip_prefix(sandbox.work.path()).unwrap().to_owned();
            (snapshot(sandbox.work.path()).into_iter().map(|(path, content)| (relative(path), content)).collect(), told)
        });
        let sandbox = Self::new();
        for (path, content) in files.iter().filter_map(|(path, content)| Some((path, content.as_ref()?))) {
            write_file(&sandbox.work.path().join(path), content);
        }
        sandbox.set_source("model", &sandbox.path("scene"));
        (sandbox, told)
    }

    /// Makes a model's options name another scene folder.
    fn set_source(&self, model: &str, scene: &Path) {
        let config = self.path(model).join("config.toml");
        let mut options = TrainConfig::load(&config).unwrap();
        options.source = Some(scene.to_owned());
        options.save(&config).unwrap();
    }

    /// The program with arguments parted by spaces, on the adapter of the tests.
    fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ibgs"));
        command.args(arguments.split_whitespace()).current_dir(self.work.path()).stdin(Stdio::null());
        command.env("XDG_CACHE_HOME", self.home.path()).env("XDG_RUNTIME_DIR", self.home.path());
        // Compiled kernels of a software adapter may be shared between tests: starting is four times faster.
        command.env("MESA_SHADER_CACHE_DIR", env!("CARGO_TARGET_TMPDIR"));
        command.env_remove("RUST_BACKTRACE");
        let needs_none = ["info", "export", "serve", "prepare"].iter().any(|command| arguments.starts_with(command));
        let opens_gpu = !needs_none && !arguments.contains("--adapter");
        if let Some(adapter) = std::env::var_os("IBGS_TEST_ADAPTER").filter(|_| opens_gpu) {
            command.arg("--adapter").arg(adapter);
        }
        command
    }

    fn run(&self, arguments: &str) -> Outcome {
        Outcome::of(arguments, &mut self.command(arguments))
    }

    /// Runs it, asserts success, and returns what it printed.
    #[track_caller]
    fn succeeds(&self, arguments: &str) -> Outcome {
        let outcome = self.run(arguments);
        outcome.assert_success();
        outcome
    }

    /// Runs it and asserts that it fails with code 1 and one sentence that holds every fragment, and that no file or
    /// folder came, went or changed.
    #[track_caller]
    fn fails(&self, arguments: &str, fragments: &[&str]) {
        self.fails_as(&mut self.command(arguments), arguments, 1, fragments);
    }

    #[track_caller]
    fn fails_as(&self, command: &mut Command, arguments: &str, code: i32, fragments: &[&str]) {
        let before = snapshot(self.work.path());
        let outcome = Outcome::of(arguments, command);
        outcome.assert_failure(code, fragments);
        println!("ibgs {arguments}: {}", outcome.error_lines()[0]);
        let after = snapshot(self.work.path());
        let changed = |a: &Snapshot, b: &Snapshot| -> Vec<PathBuf> {
            a.iter().filter(|(path, content)| b.get(*path) != Some(*content)).map(|(path, _)| path.clone()).collect()
        };
        let differences = [changed(&before, &after), changed(&after, &before)].concat();
        assert!(differences.is_empty(), "`ibgs {arguments}` failed, but changed {differences:?}");
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_str(&self.text(name)).unwrap()
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        write_file(&self.path(name), bytes);
    }
}

/// Longest wait for one run of the program, on a slow machine.
const PATIENCE: Duration = Duration::from_secs(180);

/// Asks `what` again and again until it gives something.
fn wait_for<T>(patience: Duration, mut what: impl FnMut() -> Option<T>) -> Option<T> {
    let start = Instant::now();
    loop {
        let found = what();
        if found.is_some() || start.elapsed() > patience {
            return found;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Drains a pipe on a thread of its own, so that the child never waits for us.
fn reader(pipe: Option<impl Read + Send + 'static>) -> JoinHandle<Vec<u8>> {
    let mut pipe = pipe.unwrap();
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        pipe.read_to_end(&mut bytes).unwrap();
        bytes
    })
}

/// What a run of the program left.
struct Outcome {
    arguments: String,
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Outcome {
    /// Runs a command to its end.
    fn of(arguments: &str, command: &mut Command) -> Self {
        Self::of_child(arguments, command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
    }

    /// Waits for a child; one that does not end is ended, and fails the test.
    fn of_child(arguments: &str, mut child: Child) -> Self {
        let (stdout, stderr) = (reader(child.stdout.take()), reader(child.stderr.take()));
        let ended = wait_for(PATIENCE, || child.try_wait().unwrap());
        if ended.is_none() {
            child.kill().unwrap();
        }
        let [stdout, stderr] = [stdout, stderr].map(|thread| String::from_utf8(thread.join().unwrap()).unwrap());
        let code = ended.and_then(|status| status.code());
        let outcome = Outcome { arguments: arguments.to_owned(), code, stdout, stderr };
        assert!(ended.is_some(), "no end in {PATIENCE:?}: {outcome}");
        outcome
    }

    fn error_lines(&self) -> Vec<&str> {
        self.stderr.lines().filter(|line| line.to_lowercase().starts_with("error")).collect()
    }

    #[track_caller]
    fn assert_success(&self) {
        assert_eq!(self.code, Some(0), "{self}");
        assert!(self.error_lines().is_empty() && !self.stderr.contains("panicked"), "{self}");
    }

    /// Asserts an end by a signal: its exit code, and no error.
    #[track_caller]
    fn assert_stopped(&self, code: i32) {
        assert_eq!(self.code, Some(code), "{self}");
        assert!(self.error_lines().is_empty() && !self.stderr.contains("panicked"), "{self}");
    }

    #[track_caller]
    fn assert_failure(&self, code: i32, fragments: &[&str]) {
        assert_eq!(self.code, Some(code), "{self}");
        assert!(!self.stderr.contains("panicked") && !self.stderr.contains("RUST_BACKTRACE"), "{self}");
        let lines = self.error_lines();
        assert!(lines.len() == 1 && lines[0].starts_with("error: "), "{self}");
        for fragment in fragments {
            assert!(lines[0].contains(fragment), "`{fragment}` is not in the error\n{self}");
        }
        // A sentence is one line and the last one; the parser of the command line adds its usage.
        assert!(code == 2 || self.stderr.lines().last() == Some(lines[0]), "{self}");
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "`ibgs {}` ended with {:?}", self.arguments, self.code)?;
        write!(f, "--- stdout\n{}--- stderr\n{}", self.stdout, self.stderr)
    }
}

/// Every file below a folder with its content; folders stand with `None`.
type Snapshot = BTreeMap<PathBuf, Option<Vec<u8>>>;

fn snapshot(folder: &Path) -> Snapshot {
    let mut all = Snapshot::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let is_folder = path.is_dir();
            all.insert(path.clone(), (!is_folder).then(|| fs::read(&path).unwrap()));
            if is_folder {
                open.push(path);
            }
        }
    }
    all
}

/// Paths of all files below a folder, relative, in order, `/` as separator.
fn files_in(folder: &Path) -> Vec<String> {
    let relative = |path: &PathBuf| path.strip_prefix(folder).unwrap().to_str().unwrap().replace('\\', "/");
    snapshot(folder).iter().filter(|(_, content)| content.is_some()).map(|(path, _)| relative(path)).collect()
}
