//! `ibgs serve`

use crate::{stderr, stdout};
use anyhow::{Context, Result, anyhow, bail};
use clap::Args as ClapArgs;
use std::fs::File;
use std::net::{IpAddr, SocketAddr};
use std::path::{Component, Path, PathBuf};
use tiny_http::{Header, Method, Request, Response, Server, StatusCode};

/// Requests that are answered at once.
const THREADS: usize = 4;

/// Options of `ibgs serve`.
#[derive(ClapArgs)]
#[command(after_help = "Example:\n  ibgs export output/my-scene --web my-page && ibgs serve my-page")]
pub struct Args {
    /// Folder that `ibgs export --web` wrote.
    folder: PathBuf,
    /// Port; 0: any that is free.
    #[arg(long, default_value_t = 8000)]
    port: u16,
    /// Address to listen at; the default is seen on this machine alone, `0.0.0.0` in the whole network. Browsers have
    /// WebGPU on pages of this machine and of `https:` addresses only.
    #[arg(long, default_value = "127.0.0.1")]
    address: IpAddr,
}

/// Runs the command, until it is interrupted.
pub fn run(args: &Args) -> Result<()> {
    let folder = &args.folder;
    if !folder.join("index.html").is_file() {
        bail!("{} has no index.html; name a folder that `ibgs export --web` wrote", folder.display());
    }
    let address = SocketAddr::new(args.address, args.port);
    let server = Server::http(address)
        .map_err(|error| anyhow!("cannot listen at {address} ({error}); choose another `--port` or `--address`"))?;
    let address = server.server_addr().to_ip().context("the server has an address")?;
    stdout!("http://{address}/ shows {}; Ctrl-C ends it", folder.display());
    std::thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| {
                for request in server.incoming_requests() {
                    answer(request, folder);
                }
            });
        }
    });
    Ok(())
}

/// Answers a request with a file of the folder.
fn answer(request: Request, folder: &Path) {
    let name = request.url().split(['?', '#']).next().unwrap_or_default().to_owned();
    let found = match request.method() {
        Method::Get | Method::Head => file(folder, &name).ok_or(StatusCode(404)),
        _ => Err(StatusCode(405)),
    };
    let sent = match found {
        Ok((path, file)) => {
            let kind = Header::from_bytes("Content-Type", kind(&path)).expect("a header");
            // With its length said before, so that a page can tell how much is still to come.
            request.respond(Response::from_file(file).with_chunked_threshold(usize::MAX).with_header(kind))
        }
        Err(status) => {
            let text = format!("{name}: {}", status.default_reason_phrase());
            request.respond(Response::from_string(text).with_status_code(status))
        }
    };
    if let Err(error) = sent {
        // A browser may leave a page before all of it has come.
        stderr!("note: {name} was not sent whole: {error}");
    }
}

/// The file of a name in an address, inside of the folder.
fn file(folder: &Path, name: &str) -> Option<(PathBuf, File)> {
    let name = name.trim_start_matches('/');
    let name = Path::new(if name.is_empty() { "index.html" } else { name });
    let inside = name.components().all(|part| matches!(part, Component::Normal(_)));
    let path = folder.join(name);
    (inside && path.is_file()).then(|| File::open(&path).ok().map(|file| (path, file))).flatten()
}

/// What a file is, by its ending.
fn kind(path: &Path) -> &'static str {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("wasm") => "application/wasm",
        Some("jpg") => "image/jpeg",
        _ => "application/octet-stream",
    }
}
