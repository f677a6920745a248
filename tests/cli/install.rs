//! What an installed program tells of itself: version, completions, manual pages; and permissions of what it writes.

use super::{Outcome, Sandbox, files_in};
use std::process::Command;

const COMMANDS: [&str; 16] = [
    "prepare",
    "train",
    "render",
    "serve",
    "eval",
    "compare",
    "suite",
    "split",
    "merge",
    "view",
    "mesh",
    "export",
    "info",
    "bench",
    "completions",
    "man",
];

/// Runs the program without an adapter option.
fn told(sandbox: &Sandbox, arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ibgs"));
    let outcome = Outcome::of(&arguments.join(" "), command.args(arguments).current_dir(sandbox.work.path()));
    outcome.assert_success();
    outcome.stdout
}

#[test]
fn version_tells_commit_and_backends() {
    let sandbox = Sandbox::new();
    let short = told(&sandbox, &["-V"]);
    let start = concat!("ibgs ", env!("CARGO_PKG_VERSION"));
    let rest = short.strip_prefix(start).and_then(|rest| rest.strip_suffix('\n')).expect(&short);
    let commit = rest.strip_prefix(" (").and_then(|rest| rest.strip_suffix(')'));
    let is_commit = |text: &str| {
        let (hash, day) = text.split_once(", ").unwrap_or_default();
        hash.len() >= 7 && hash.bytes().all(|b| b.is_ascii_hexdigit()) && day.len() == 10 && day.starts_with("20")
    };
    // A source archive has no commit.
    assert!(rest.is_empty() || commit.is_some_and(is_commit), "{short}");
    let long = told(&sandbox, &["--version"]);
    let lines: Vec<&str> = long.lines().collect();
    assert_eq!((lines.len(), lines[0]), (4, short.trim_end()), "{long}");
    let backends = match () {
        () if cfg!(target_vendor = "apple") => "Metal",
        () if cfg!(windows) => "Vulkan, DirectX 12",
        () => "Vulkan",
    };
    assert_eq!(lines[1], format!("backends: {backends}"));
    assert!(lines[2].starts_with("target: ") && lines[2].contains(std::env::consts::ARCH), "{long}");
    assert!(matches!(lines[3], "profile: debug" | "profile: release"), "{long}");
}

#[test]
fn completions_know_every_command() {
    let sandbox = Sandbox::new();
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = told(&sandbox, &["completions", shell]);
        let missing: Vec<_> = COMMANDS.iter().filter(|command| !script.contains(*command)).collect();
        assert!(missing.is_empty() && script.contains("source-memory"), "{shell}: {missing:?}\n{script}");
    }
    sandbox.fails_as(&mut sandbox.command("completions tcsh"), "completions tcsh", 2, &["tcsh"]);
    assert!(files_in(sandbox.work.path()).is_empty());
}

#[test]
fn every_command_has_a_manual_page() {
    let sandbox = Sandbox::new();
    let printed = told(&sandbox, &["man"]);
    told(&sandbox, &["man", "share/man1"]);
    let mut expected: Vec<_> = COMMANDS.iter().map(|command| format!("share/man1/ibgs-{command}.1")).collect();
    expected.push("share/man1/ibgs.1".to_owned());
    expected.sort();
    assert_eq!(files_in(sandbox.work.path()), expected);
    assert_eq!(sandbox.text("share/man1/ibgs.1"), printed);
    for command in COMMANDS {
        assert!(printed.contains(&format!("ibgs\\-{command}")), "{command}\n{printed}");
        let page = sandbox.text(&format!("share/man1/ibgs-{command}.1"));
        assert!(page.contains(".TH") && page.contains(".SH SYNOPSIS"), "{page}");
    }
    assert!(sandbox.text("share/man1/ibgs-train.1").contains("source\\-memory"));
    sandbox.write("file", "x");
    sandbox.fails_as(&mut sandbox.command("man file"), "man file", 1, &["cannot write", "choose another path"]);
}

/// Files and folders get what the umask leaves, and a file that is replaced keeps its permissions.
#[cfg(unix)]
#[test]
fn permissions_follow_the_umask() {
    use std::fs;
    use std::os::unix::fs::PermissionsExt;
    let (sandbox, _) = Sandbox::with_model();
    let mode = |name: &str| fs::metadata(sandbox.path(name)).unwrap().permissions().mode() & 0o777;
    let under = |umask: &str, arguments: &str| {
        let script = format!("umask {umask} && exec \"$0\" {arguments}");
        let mut command = Command::new("sh");
        command.args(["-c", &script, env!("CARGO_BIN_EXE_ibgs")]).current_dir(sandbox.work.path());
        Outcome::of(&script, &mut command).assert_success();
    };
    for (umask, file, folder) in [("022", 0o644, 0o755), ("077", 0o600, 0o700), ("002", 0o664, 0o775)] {
        under(umask, &format!("man {umask}/pages"));
        under(umask, &format!("export model -o {umask}/model.ply"));
        let written = [format!("{umask}/pages/ibgs.1"), format!("{umask}/model.ply")].map(|path| mode(&path));
        assert_eq!(written.map(|mode| format!("{mode:o}")), [format!("{file:o}"), format!("{file:o}")]);
        assert_eq!(mode(umask), folder, "umask {umask}");
    }
    fs::set_permissions(sandbox.path("022/model.ply"), fs::Permissions::from_mode(0o640)).unwrap();
    under("022", "export model -o 022/model.ply --overwrite");
    assert_eq!(mode("022/model.ply"), 0o640);
}
