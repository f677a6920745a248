//! Reading of streamed SOG (developer.playcanvas.com, "Streamed SOG"): a `lod-meta.json` has a tree of regions, each with
//! several levels of detail, which are parts of SOG files in folders beside it. Level 0 is the model itself.

use super::super::Gaussians;
use super::sog_parts::{MOST_META, inside, unreadable};
use super::sog_read;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// How names of files with the tree end.
const STREAMED: &str = "lod-meta.json";
/// The key of the level with full detail.
const FULL: &str = "0";

#[derive(Deserialize)]
struct Meta {
    version: Option<u32>,
    filenames: Vec<String>,
    /// A file that is shown at any level.
    environment: Option<String>,
    tree: Region,
}

#[derive(Deserialize)]
struct Region {
    #[serde(default)]
    children: Vec<Region>,
    #[serde(default)]
    lods: BTreeMap<String, Part>,
}

#[derive(Deserialize)]
struct Part {
    file: usize,
}

impl Region {
    /// The files of level 0.
    fn files(&self, found: &mut BTreeSet<usize>) {
        found.extend(self.lods.get(FULL).map(|part| part.file));
        self.children.iter().for_each(|child| child.files(found));
    }
}

/// Reads a `meta.json` at `path` and the pictures beside it; a `lod-meta.json` in full detail.
///
/// # Errors
/// What is wrong.
pub(super) fn read_folder(text: &[u8], path: &Path) -> Result<Gaussians, String> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    match name.ends_with(STREAMED) {
        true => streamed(text, path.parent().unwrap_or(Path::new(""))),
        false => sog_read::read_folder(text, path),
    }
}

fn streamed(text: &[u8], folder: &Path) -> Result<Gaussians, String> {
    let meta: Meta = serde_json::from_slice(text).map_err(|error| format!("its text is wrong: {error}"))?;
    if let Some(version) = meta.version.filter(|version| *version != 1) {
        return Err(format!("it has version {version} of the format; version 1 is read"));
    }
    let mut places = BTreeSet::new();
    meta.tree.files(&mut places);
    // Each once, however it is written.
    let mut names: BTreeSet<String> = meta.environment.iter().map(|name| inside(name)).collect::<Result<_, _>>()?;
    for place in places {
        let missing = || format!("its tree has the file {place} of {}", meta.filenames.len());
        names.insert(inside(meta.filenames.get(place).ok_or_else(missing)?)?);
    }
    let parts: Vec<Gaussians> = names.iter().map(|name| part(name, folder)).collect::<Result<_, _>>()?;
    match parts.is_empty() {
        true => Err("its tree has no files of level 0".to_owned()),
        false => Ok(Gaussians::joined(parts)),
    }
}

/// One of the files, an archive or the `meta.json` of a folder.
fn part(name: &str, folder: &Path) -> Result<Gaussians, String> {
    let path = folder.join(name);
    let mut bytes = Vec::new();
    let is_archive = name.to_ascii_lowercase().ends_with(".sog");
    let most = if is_archive { u64::MAX } else { MOST_META };
    let read = File::open(&path).and_then(|file| file.take(most).read_to_end(&mut bytes));
    read.map_err(|error| unreadable(name, &error))?;
    let found = if is_archive { sog_read::read(&bytes) } else { sog_read::read_folder(&bytes, &path) };
    found.map_err(|reason| format!("in its `{name}`: {reason}"))
}
