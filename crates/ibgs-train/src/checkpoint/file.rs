//! The file of a checkpoint.

use super::{Checkpoint, CheckpointError, FORMAT, TrainingState, VERSION};
use ibgs_core::config::TrainConfig;
use ibgs_core::ensemble;
use ibgs_core::files::write_seekable_atomically;
use ibgs_core::scene::MAX_SH_DEGREE;
use ibgs_core::stored_zip::{self, StoredZip};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, Write};
use std::path::Path;
use zip::ZipWriter;

#[derive(Serialize, Deserialize)]
struct Header {
    format: u32,
    /// Of the program.
    version: String,
    /// Checksum of the scene.
    scene: u32,
}

const HEADER: &str = "checkpoint.json";
const CONFIG: &str = "config.toml";
const STATE: &str = "state.json";
const RUN: &str = "run.json";

impl Checkpoint {
    /// Writes the checkpoint in one atomic step: a ZIP archive without compression, whose checksums show damage.
    ///
    /// ```text
    /// checkpoint.json   {"format": 9, "version": "0.1.0", "scene": checksum of cameras, names and photos}
    /// config.toml       the options
    /// state.json        iteration, random state, order of the views, exposures ...
    /// run.json          times, curves and measurements so far
    /// tensors/NAME      float32, little endian: parameters, statistics, network, depth maps, what moves; moments also as words
    /// member_2/...      all of this but the first of a further member of an ensemble
    /// ```
    ///
    /// # Errors
    /// [`CheckpointError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), CheckpointError> {
        Ok(write_seekable_atomically(path, |out| stored_zip::write(out, |zip| self.write_all(zip)))?)
    }

    fn write_all<W: Write + Seek>(&self, zip: &mut ZipWriter<W>) -> io::Result<()> {
        let header = Header { format: FORMAT, version: VERSION.to_owned(), scene: self.scene };
        stored_zip::add(zip, HEADER, &serde_json::to_vec(&header)?)?;
        self.write_parts(zip, "")?;
        let mut members = self.members.iter().zip(2..);
        members.try_for_each(|(member, number)| member.write_parts(zip, &prefix(number)))
    }

    fn write_parts<W: Write + Seek>(&self, zip: &mut ZipWriter<W>, prefix: &str) -> io::Result<()> {
        let mut add = |part: &str, bytes: &[u8]| stored_zip::add(zip, &format!("{prefix}{part}"), bytes);
        add(CONFIG, self.config.to_text().map_err(io::Error::other)?.as_bytes())?;
        add(STATE, &serde_json::to_vec(&self.state)?)?;
        add(RUN, &serde_json::to_vec(&self.run)?)?;
        let tensors = self.tensors().into_iter().map(|(name, values)| (name, bytemuck::cast_slice(values)));
        for (name, words) in tensors.chain(self.moments()) {
            let little: Vec<u32>;
            let bytes = match cfg!(target_endian = "little") {
                true => bytemuck::cast_slice(words),
                false => {
                    little = words.iter().map(|word: &u32| word.to_le()).collect();
                    bytemuck::cast_slice(&little)
                }
            };
            add(&format!("tensors/{name}"), bytes)?;
        }
        Ok(())
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// [`CheckpointError::Read`], [`CheckpointError::Damaged`] naming the part, [`CheckpointError::Version`].
    pub fn read(path: &Path) -> Result<Self, CheckpointError> {
        let unread = |source| CheckpointError::Read { path: path.to_owned(), source };
        Self::read_from(BufReader::new(File::open(path).map_err(unread)?), path)
    }

    /// [`Checkpoint::read`] from anything seekable; `path` is for messages.
    ///
    /// # Errors
    /// As [`Checkpoint::read`].
    pub fn read_from<R: Read + Seek>(reader: R, path: &Path) -> Result<Self, CheckpointError> {
        let damaged = |reason: String| CheckpointError::Damaged { path: path.to_owned(), reason };
        let mut zip = StoredZip::open(reader).map_err(damaged)?;
        let header: Header = json(&mut zip, HEADER).map_err(damaged)?;
        if header.format != FORMAT || header.version != VERSION {
            let found = format!("{} (format {})", header.version, header.format);
            return Err(CheckpointError::Version { path: path.to_owned(), found });
        }
        let mut first = Self::read_parts(&mut zip, header.scene, "").map_err(damaged)?;
        for number in 2..=first.config.ensemble() as usize {
            let member = Self::read_parts(&mut zip, header.scene, &prefix(number)).map_err(damaged)?;
            first.members.push(member);
        }
        Ok(first)
    }

    fn read_parts<R: Read + Seek>(zip: &mut StoredZip<R>, scene: u32, prefix: &str) -> Result<Self, String> {
        let part = |name: &str| format!("{prefix}{name}");
        let config = bytes(zip, &part(CONFIG))?;
        let config = TrainConfig::from_text(&String::from_utf8_lossy(&config), Path::new(CONFIG))
            .map_err(|error| error.to_string())?;
        let state: TrainingState = json(zip, &part(STATE))?;
        let run = json(zip, &part(RUN))?;
        // Every value takes four bytes of the file.
        if state.gaussians as u64 > zip.length() || state.sh_degree > MAX_SH_DEGREE {
            return Err(format!("its `{STATE}` lists more than the file holds"));
        }
        Self::assemble((config, scene, run, state), |name, count| tensor(zip, &part(&format!("tensors/{name}")), count))
    }
}

/// What the parts of a further member of an ensemble begin with.
fn prefix(number: usize) -> String {
    format!("{}/", ensemble::folder(number))
}

/// A part, or what is wrong.
fn bytes<R: Read + Seek>(zip: &mut StoredZip<R>, part: &str) -> Result<Vec<u8>, String> {
    zip.bytes(part).map_err(|reason| format!("its `{part}` {reason}"))
}

fn json<R: Read + Seek, T: DeserializeOwned>(zip: &mut StoredZip<R>, part: &str) -> Result<T, String> {
    let bytes = bytes(zip, part)?;
    serde_json::from_slice(&bytes).map_err(|error| format!("its `{part}` makes no sense ({error})"))
}

fn tensor<R: Read + Seek>(zip: &mut StoredZip<R>, part: &str, count: usize) -> Result<Vec<f32>, String> {
    let bytes = bytes(zip, part)?;
    if Some(bytes.len()) != count.checked_mul(4) {
        return Err(format!("its `{part}` has {} bytes in place of {count} values", bytes.len()));
    }
    Ok(bytes.as_chunks().0.iter().map(|&value| f32::from_le_bytes(value)).collect())
}
