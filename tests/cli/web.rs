//! A model as a folder for browsers, and the server of such folders.

#![expect(clippy::disallowed_types, reason = "a test is the server's client")]

use super::Sandbox;
use ibgs_testing::TINY;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};

/// A program that ends with its test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A folder that stands for the viewer's module.
fn with_module() -> Sandbox {
    let (sandbox, _) = Sandbox::with_trained();
    fs::create_dir(sandbox.path("module")).unwrap();
    for name in ["ibgs_web.js", "ibgs_web_bg.wasm"] {
        fs::write(sandbox.path("module").join(name), name).unwrap();
    }
    sandbox
}

#[test]
fn a_model_becomes_a_folder_for_browsers() {
    let sandbox = with_module();
    sandbox.fails("export model --web page", &["ibgs_web.js is missing", "crates/ibgs-web/build.sh", "--module"]);
    assert!(!sandbox.path("page").exists());
    sandbox.succeeds("export model --web page --module module");
    sandbox.succeeds("export model -o small.ibgs --quality 90");
    let read = |name: &str| fs::read(sandbox.path(name)).unwrap();
    assert!(read("page/scene.ibgs") == read("small.ibgs"));
    assert_eq!(read("page/pkg/ibgs_web_bg.wasm"), b"ibgs_web_bg.wasm");
    let page = String::from_utf8(read("page/index.html")).unwrap();
    assert!(page.contains("<title>model</title>"), "{page}");
    assert!(page.contains("<ibgs-viewer src=\"scene.ibgs\" poster=\"poster.jpg\" linked>"), "{page}");
    let poster = image::load_from_memory(&read("page/poster.jpg")).unwrap();
    assert_eq!([poster.width(), poster.height()], TINY);
    sandbox.succeeds("export model -o usual.ibgs");
    sandbox.succeeds("export usual.ibgs --web other --module module --quality lossless");
    assert!(read("other/scene.ibgs") == read("usual.ibgs"));
    sandbox.succeeds("export model -o tiny.ibgs --quality 50 --photo-size 24");
    let sizes = ["tiny", "small", "usual"].map(|name| read(&format!("{name}.ibgs")).len());
    assert!(sizes.is_sorted_by(|a, b| a < b), "{sizes:?}");
    sandbox.succeeds("render tiny.ibgs");
    sandbox.fails("export model -o a.ply --quality 90", &["are for bundles"]);
    let wrong = "export model -o a.ibgs --quality 0";
    sandbox.fails_as(&mut sandbox.command(wrong), wrong, 2, &["neither a whole number from 1 to 100"]);
    sandbox.fails("export model --web page --module module", &["page is not empty", "`--overwrite`"]);
    sandbox.succeeds("export model --web page --module module --overwrite");
    let both = "export model --web page -o model.ply";
    sandbox.fails_as(&mut sandbox.command(both), both, 2, &["cannot be used with"]);
}

#[test]
fn a_folder_is_served_and_nothing_else() {
    let sandbox = with_module();
    sandbox.fails("serve model", &["model has no index.html", "`ibgs export --web`"]);
    sandbox.succeeds("export model --web page --module module");
    let mut server = Running(sandbox.command("serve page --port 0").stdout(Stdio::piped()).spawn().unwrap());
    let mut line = String::new();
    BufReader::new(server.0.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
    let address = line.strip_prefix("http://").and_then(|line| line.split('/').next()).unwrap().to_owned();
    let answer = |request: &str| {
        let mut stream = TcpStream::connect(&address).unwrap();
        write!(stream, "{request} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n").unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap() + 4;
        (String::from_utf8(bytes[..end].to_vec()).unwrap(), bytes[end..].to_vec())
    };
    let (head, page) = answer("GET /");
    assert!(head.starts_with("HTTP/1.1 200") && head.contains("text/html"), "{head}");
    assert!(page == fs::read(sandbox.path("page/index.html")).unwrap());
    let (head, bundle) = answer("GET /scene.ibgs?again");
    let length = fs::metadata(sandbox.path("page/scene.ibgs")).unwrap().len();
    assert!(head.contains("application/octet-stream") && head.contains(&format!("Content-Length: {length}")), "{head}");
    assert!(bundle == fs::read(sandbox.path("page/scene.ibgs")).unwrap());
    let (head, _) = answer("GET /pkg/ibgs_web_bg.wasm");
    assert!(head.contains("application/wasm"), "{head}");
    for other in [
        "GET /no.html",
        "GET /pkg",
        "GET /../model/config.toml",
        "GET //etc/passwd",
        "GET /pkg/../../model/config.toml",
    ] {
        assert!(answer(other).0.starts_with("HTTP/1.1 404"), "{other}");
    }
    assert!(answer("POST /").0.starts_with("HTTP/1.1 405"));
    let taken = address.rsplit(':').next().unwrap();
    sandbox.fails(&format!("serve page --port {taken}"), &["cannot listen at 127.0.0.1", "`--port`"]);
}
