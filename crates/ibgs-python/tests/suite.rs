//! The package's own tests, by the Python of this machine, on the library that is built here.

use std::env;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

#[test]
fn the_package_passes_its_tests() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let program = env::current_exe().unwrap();
    let built = program.with_file_name(format!("{}_ibgs{}", env::consts::DLL_PREFIX, env::consts::DLL_SUFFIX));
    let folder = tempfile::tempdir().unwrap();
    let package = folder.path().join("ibgs");
    fs::create_dir(&package).unwrap();
    for file in fs::read_dir(root.join("python/ibgs")).unwrap().map(Result::unwrap) {
        if file.path().is_file() {
            fs::copy(file.path(), package.join(file.file_name())).unwrap();
        }
    }
    let ending = if cfg!(windows) { "pyd" } else { "abi3.so" };
    fs::copy(&built, package.join(format!("_ibgs.{ending}"))).unwrap();
    let mut tests = Command::new(python());
    tests.args(["-m", "pytest", "-q", "-p", "no:cacheprovider", "--durations=5"]).arg(root.join("tests"));
    tests.env("PYTHONPATH", folder.path()).env("PYTHONDONTWRITEBYTECODE", "1").current_dir(folder.path());
    let status = tests.status().unwrap();
    assert!(status.success(), "{status}");
}

/// The first Python that has what the tests need: another one may stand before the system's.
fn python() -> &'static str {
    let has_all = |python: &&str| {
        let mut probe = Command::new(python);
        probe.args(["-c", "import numpy, PIL, pytest"]).stderr(Stdio::null());
        probe.status().is_ok_and(|status| status.success())
    };
    let found = ["python3", "/usr/bin/python3", "python"].into_iter().find(has_all);
    found.expect("no Python has numpy, Pillow and pytest; `./setup.sh` installs them on Debian and Ubuntu")
}
