//! Bundles are written.

use super::photos::{BATCH, encode};
use super::{
    Bundle, BundleError, CHUNKS, CLOUD, ENSEMBLE_FORMAT, FORMAT, HEADER, Header, LEVELS_FORMAT, NETWORK, OPTIONS,
    PLANES, Packing, SMALL_FORMAT, SOG, TREE, member_part,
};
use crate::dataset::HostPhoto;
use crate::exposure::{self, Exposure};
use crate::files::write_seekable_atomically;
use crate::levels::{self, Tree};
use crate::local_space::LocalSpace;
use crate::output::{cameras, multi_view};
use crate::residual::weights;
use crate::scene::{Gaussians, PlyFlavor, SceneError, packed, write_ply_to};
use crate::stored_zip::{self, add};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::io::{self, Seek, Write};
use std::path::Path;
use zip::ZipWriter;

impl Bundle {
    /// Writes the bundle, in one atomic step. Of one that was read with levels of detail only the coarsest would be written:
    /// [`Model::expand`](crate::model::Model::expand) comes first.
    ///
    /// # Errors
    /// [`BundleError::Scene`] for Gaussians that are not valid, [`BundleError::Write`].
    pub fn write(&self, path: &Path, packing: Packing) -> Result<(), BundleError> {
        if self.gaussians.is_empty() && packing == Packing::Levels {
            return Err(SceneError::NoGaussians.into());
        }
        let members = self.members.iter().map(|member| &member.gaussians);
        std::iter::once(&self.gaussians).chain(members).try_for_each(Gaussians::validate)?;
        write_seekable_atomically(path, |out| stored_zip::write(out, |zip| self.write_parts(zip, packing)))?;
        Ok(())
    }

    fn write_parts<W: Write + Seek>(&self, zip: &mut ZipWriter<W>, packing: Packing) -> io::Result<()> {
        let (format, offset) = match packing {
            Packing::Lossless => (FORMAT, None),
            Packing::Levels => (LEVELS_FORMAT, None),
            Packing::Small { .. } => (SMALL_FORMAT, self.gaussians.space.file_offset()),
        };
        let members = if packing == Packing::Levels { &[] } else { &self.members[..] };
        let format = if members.is_empty() { format } else { ENSEMBLE_FORMAT };
        let place = LocalSpace::at(offset.unwrap_or_default());
        add(zip, HEADER, &serde_json::to_vec(&Header { format, iteration: self.iteration, offset })?)?;
        add_exposures(zip, exposure::FILE_NAME, self.exposure.as_ref())?;
        add(zip, "cameras.json", &serde_json::to_vec(&cameras::to_json(&self.cameras))?)?;
        add(zip, "multi_view.json", multi_view::to_text(&self.sources)?.as_bytes())?;
        let config = if members.len() < self.members.len() { &self.config.single() } else { &self.config };
        add(zip, OPTIONS, config.to_text().map_err(io::Error::other)?.as_bytes())?;
        if packing == Packing::Levels {
            // In the coordinates in which it is rendered.
            let space = cameras::space(&self.cameras, &self.gaussians, self.config.data.extent);
            let chunks = levels::build(self.gaussians.clone().into_space(space), levels::CHUNK);
            let tree = Tree::of(space, self.gaussians.sh_degree, &chunks);
            add(zip, TREE, &serde_json::to_vec(&tree)?)?;
            stored_zip::add_large(zip, CHUNKS, tree.bytes(), |out| levels::write(&chunks, out))?;
        } else {
            add_gaussians(zip, 1, (&self.gaussians, PlyFlavor::Full), (packing, place))?;
        }
        if let Some(network) = &self.network {
            add(zip, NETWORK, network)?;
        }
        for (member, number) in members.iter().zip(2..) {
            // Without a network nothing reads its planes.
            let flavor = if member.network.is_some() { PlyFlavor::Full } else { PlyFlavor::Plain };
            add_gaussians(zip, number, (&member.gaussians, flavor), (packing, place))?;
            add_exposures(zip, &member_part(number, exposure::FILE_NAME), member.exposure.as_ref())?;
            if let Some(network) = &member.network {
                let bytes = weights::to_bytes(network).map_err(io::Error::other)?;
                add(zip, &member_part(number, NETWORK), &bytes)?;
            }
        }
        for photos in self.photos.chunks(BATCH) {
            let encode = |(name, photo): &(String, HostPhoto)| {
                let pixels = photo.pixels().map_err(io::Error::other)?;
                encode(name, &pixels, packing)
            };
            for (part, bytes) in photos.par_iter().map(encode).collect::<io::Result<Vec<_>>>()? {
                add(zip, &part, &bytes)?;
            }
        }
        Ok(())
    }
}

/// Adds the Gaussians of a member, counted from 1; those of a small bundle lie at a place in the scene.
fn add_gaussians<W: Write + Seek>(
    zip: &mut ZipWriter<W>,
    member: usize,
    (gaussians, flavor): (&Gaussians, PlyFlavor),
    (packing, place): (Packing, LocalSpace),
) -> io::Result<()> {
    // A SOG file holds at least one.
    if packing == Packing::Lossless || gaussians.is_empty() {
        let mut ply = Vec::new();
        write_ply_to(&mut ply, gaussians, flavor)?;
        return add(zip, &member_part(member, CLOUD), &ply);
    }
    let [sog, planes] = packed::encode(&gaussians.in_space(place)).map_err(io::Error::other)?;
    add(zip, &member_part(member, SOG), &sog)?;
    match flavor {
        PlyFlavor::Full => add(zip, &member_part(member, PLANES), &planes),
        PlyFlavor::Plain => Ok(()),
    }
}

/// Adds a part of the photos' exposures, where they were corrected.
fn add_exposures<W: Write + Seek>(
    zip: &mut ZipWriter<W>,
    part: &str,
    exposures: Option<&HashMap<String, Exposure>>,
) -> io::Result<()> {
    let Some(exposures) = exposures else { return Ok(()) };
    // In the order of their names, so that equal bundles have equal bytes.
    let photos: BTreeMap<_, _> = exposures.iter().collect();
    let value = exposure::to_json(photos.into_iter().map(|(name, photo)| (name.as_str(), photo)));
    add(zip, part, &serde_json::to_vec(&value)?)
}
