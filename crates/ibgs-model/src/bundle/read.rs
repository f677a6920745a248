//! Bundles are read, as a whole or as far as their beginning goes.

use super::{
    Bundle, BundleError, CHUNKS, CLOUD, ENSEMBLE_FORMAT, HEADER, Header, NETWORK, OPTIONS, PLANES, SOG, TREE,
    member_part,
};
use crate::config::TrainConfig;
use crate::ensemble::Member;
use crate::exposure::{self, Exposure};
use crate::levels::{Levels, Tree};
use crate::output::{cameras, multi_view};
use crate::residual::weights;
use crate::scene::{Gaussians, packed, read_ply_from};
use crate::stored_zip::{self, StoredZip, add};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek};
use std::path::Path;
use std::sync::Arc;

impl Bundle {
    /// Reads a bundle.
    ///
    /// # Errors
    /// [`BundleError`] naming the file and the part that is missing or broken.
    pub fn read(path: &Path) -> Result<Self, BundleError> {
        let unreadable = |source| BundleError::Read { path: path.to_owned(), source };
        Self::read_from(BufReader::new(File::open(path).map_err(unreadable)?), path)
    }

    /// [`Bundle::read`] from anything seekable; `path` is for messages.
    ///
    /// # Errors
    /// As [`Bundle::read`].
    pub fn read_from<R: Read + Seek>(reader: R, path: &Path) -> Result<Self, BundleError> {
        let mut parts = Parts::open(reader, path)?;
        let header = parts.header()?;
        let bundle = parts.bundle(&header, |parts, header| parts.gaussians(header, 1))?;
        let further = 2..=bundle.config.ensemble() as usize;
        let members = further.map(|number| parts.member(&header, number)).collect::<Result<_, _>>()?;
        let photos = parts.photos(&bundle.cameras)?;
        Ok(Self { members, photos, ..bundle })
    }

    /// What the beginning of a bundle's bytes gives: the model without network and photos. Gaussians of a small bundle have
    /// their constant colours alone, and no planes. None where the beginning is too short, or no bundle.
    ///
    /// # Errors
    /// As [`Bundle::read`].
    pub fn read_start(start: &[u8], path: &Path) -> Result<Option<Self>, BundleError> {
        let Some(archive) = beginning(start).ok().flatten() else { return Ok(None) };
        let mut parts = Parts::open(Cursor::new(archive), path)?;
        let header = parts.header()?;
        let bundle = parts.bundle(&header, Parts::base_gaussians)?;
        Ok(Some(Self { network: None, ..bundle }))
    }
}

/// An archive of a bundle's first parts, up to what the base image needs of the Gaussians; none where that is not all there, as
/// in bundles of earlier versions, whose Gaussians come first.
fn beginning(start: &[u8]) -> io::Result<Option<Vec<u8>>> {
    let (mut out, mut has_options, mut is_long_enough) = (Cursor::new(Vec::new()), false, false);
    stored_zip::write(&mut out, |zip| {
        for part in stored_zip::first_parts(start) {
            let base = if part.name == SOG { packed::base_of(part.bytes) } else { None };
            match base {
                Some(base) => add(zip, part.name, &base)?,
                None if part.is_whole => add(zip, part.name, part.bytes)?,
                None => break,
            }
            has_options |= part.name == OPTIONS;
            if [SOG, CLOUD].contains(&part.name) {
                is_long_enough = has_options;
                break;
            }
        }
        Ok(())
    })?;
    Ok(is_long_enough.then(|| out.into_inner()))
}

/// The parts of an open bundle.
pub(super) struct Parts<'a, R> {
    path: &'a Path,
    pub(super) zip: StoredZip<R>,
}

impl<'a, R: Read + Seek> Parts<'a, R> {
    fn open(reader: R, path: &'a Path) -> Result<Self, BundleError> {
        let no_bundle = |reason: String| BundleError::NoBundle { path: path.to_owned(), reason };
        let zip = StoredZip::open(reader).map_err(no_bundle)?;
        match zip.has(HEADER) {
            true => Ok(Self { path, zip }),
            false => Err(no_bundle("it is a ZIP archive of something else".to_owned())),
        }
    }

    /// The Gaussians of a member, counted from 1.
    fn gaussians(&mut self, header: &Header, member: usize) -> Result<Gaussians, BundleError> {
        let [sog, planes] = [SOG, PLANES].map(|part| member_part(member, part));
        if !self.zip.has(&sog) {
            return self.cloud(member);
        }
        let has_planes = member == 1 || self.zip.has(&planes);
        let planes = has_planes.then(|| self.bytes(&planes)).transpose()?;
        let gaussians = self.parse(&sog, |bytes| packed::decode(bytes, planes.as_deref()))?;
        Ok(Gaussians { space: header.space(), ..gaussians })
    }

    /// The same, as far as the base image needs them.
    fn base_gaussians(&mut self, header: &Header) -> Result<Gaussians, BundleError> {
        if !self.zip.has(SOG) {
            return self.cloud(1);
        }
        Ok(Gaussians { space: header.space(), ..self.parse(SOG, packed::decode_base)? })
    }

    fn cloud(&mut self, member: usize) -> Result<Gaussians, BundleError> {
        let part = member_part(member, CLOUD);
        self.parse(&part, |bytes| read_ply_from(&mut Cursor::new(bytes), bytes.len() as u64, Path::new(&part)))
    }

    /// The levels of detail, whose numbers stay in the file.
    fn levels(&mut self) -> Result<Levels, BundleError> {
        let tree: Tree = self.parse(TREE, |bytes| serde_json::from_slice(bytes))?;
        let place = self.zip.place(CHUNKS).map_err(|reason| self.damaged(CHUNKS, reason))?;
        Levels::open(tree, self.path, place).map_err(|reason| self.damaged(CHUNKS, reason))
    }

    /// What the bundle is.
    fn header(&mut self) -> Result<Header, BundleError> {
        let header: Header = self.parse(HEADER, |bytes| serde_json::from_slice(bytes))?;
        if header.format > ENSEMBLE_FORMAT {
            return Err(BundleError::Newer { path: self.path.to_owned(), found: header.format });
        }
        Ok(header)
    }

    /// The bundle without its photos.
    fn bundle(
        &mut self,
        header: &Header,
        gaussians: fn(&mut Self, &Header) -> Result<Gaussians, BundleError>,
    ) -> Result<Bundle, BundleError> {
        let levels = self.zip.has(TREE).then(|| self.levels()).transpose()?.map(Arc::new);
        let gaussians = match &levels {
            Some(levels) => {
                levels.gaussians(std::iter::once(0)).map_err(|error| self.damaged(CHUNKS, error.to_string()))?
            }
            None => gaussians(self, header)?,
        };
        let has_network = self.zip.has(NETWORK);
        let network = has_network.then(|| self.bytes(NETWORK)).transpose()?;
        let exposure = self.exposures(exposure::FILE_NAME)?;
        let cameras = self.parse("cameras.json", |bytes| cameras::from_json(&String::from_utf8_lossy(bytes)))?;
        let sources = self.parse("multi_view.json", |bytes| multi_view::from_text(&String::from_utf8_lossy(bytes)))?;
        let config =
            self.parse(OPTIONS, |bytes| TrainConfig::from_text(&String::from_utf8_lossy(bytes), Path::new(OPTIONS)))?;
        let photos = Vec::new();
        Ok(Bundle {
            iteration: header.iteration,
            gaussians,
            members: Vec::new(),
            levels,
            network,
            exposure,
            cameras,
            config,
            photos,
            sources,
        })
    }

    /// The photos' exposures in a part; none where there is none.
    fn exposures(&mut self, part: &str) -> Result<Option<HashMap<String, Exposure>>, BundleError> {
        let parse = |bytes: &[u8]| exposure::from_json(&String::from_utf8_lossy(bytes));
        self.zip.has(part).then(|| self.parse(part, parse)).transpose()
    }

    /// A further member of an ensemble, counted from 2.
    fn member(&mut self, header: &Header, number: usize) -> Result<Member, BundleError> {
        let [network, exposure] = [NETWORK, exposure::FILE_NAME].map(|part| member_part(number, part));
        let gaussians = self.gaussians(header, number)?;
        let parse = |bytes: &[u8]| weights::from_bytes(bytes, Path::new(&network));
        let weights = self.zip.has(&network).then(|| self.parse(&network, parse)).transpose()?;
        Ok(Member { gaussians, network: weights, exposure: self.exposures(&exposure)? })
    }

    pub(super) fn damaged(&self, part: &str, reason: impl Into<String>) -> BundleError {
        BundleError::Damaged { path: self.path.to_owned(), part: part.to_owned(), reason: reason.into() }
    }

    pub(super) fn bytes(&mut self, part: &str) -> Result<Vec<u8>, BundleError> {
        self.zip.bytes(part).map_err(|reason| self.damaged(part, reason))
    }

    fn parse<T, E: ToString>(
        &mut self,
        part: &str,
        parse: impl FnOnce(&[u8]) -> Result<T, E>,
    ) -> Result<T, BundleError> {
        let bytes = self.bytes(part)?;
        parse(&bytes).map_err(|error| self.damaged(part, format!("makes no sense ({})", error.to_string())))
    }
}
