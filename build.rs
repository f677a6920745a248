//! Gives the program the commit that it is built from, where this folder is a git repository.
#![allow(clippy::print_stdout, reason = "cargo reads it")]

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-env=IBGS_BUILD={}/{}", variable("TARGET"), variable("PROFILE"));
    let commit = commit().map(|commit| format!(" ({commit})")).unwrap_or_default();
    println!("cargo::rustc-env=IBGS_COMMIT={commit}");
}

fn variable(name: &str) -> String {
    std::env::var(name).unwrap_or_default()
}

/// `a1b2c3d, 2026-01-31`: the commit and its day; cargo learns which files change with it.
fn commit() -> Option<String> {
    // A source archive that lies in some other repository has no commit.
    let top = git(&["rev-parse", "--show-toplevel"])?;
    if Path::new(&top).canonicalize().ok()? != Path::new(".").canonicalize().ok()? {
        return None;
    }
    watch("HEAD");
    watch("packed-refs");
    if let Some(branch) = git(&["symbolic-ref", "--quiet", "HEAD"]) {
        // Packed away, the branch has no file; the next commit makes it, in this folder or above.
        Path::new(&branch).ancestors().find(|path| watch(&path.to_string_lossy()));
    }
    git(&["log", "-1", "--format=%h, %cs"]).filter(|commit| !commit.is_empty())
}

/// Has cargo look at a file of the repository, if it is there; in a work tree it lies elsewhere.
fn watch(name: &str) -> bool {
    let path = git(&["rev-parse", "--git-path", name]).filter(|path| Path::new(path).exists());
    if let Some(path) = &path {
        println!("cargo::rerun-if-changed={path}");
    }
    path.is_some()
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
