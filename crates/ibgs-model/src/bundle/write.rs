//! Bundles are written.

use super::photos::{BATCH, encode};
use super::{
    Bundle, BundleError, CHUNKS, CLOUD, ENSEMBLE_FORMAT, FORMAT, Header, LEVELS_FORMAT, OPTIONS, Packing, SMALL_FORMAT,
    SOG, TREE, member_parts,
};
use crate::dataset::HostPhoto;
use crate::exposure::{self, Exposure};
use crate::files::write_seekable_atomically;
use crate::levels::{self, Tree};
use crate::local_space::LocalSpace;
use crate::output::{cameras, multi_view};
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
        if !self.members.is_empty() && packing == Packing::Levels {
            return Err(BundleError::Ensemble(self.members.len() + 1));
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
        let format = if self.members.is_empty() { format } else { ENSEMBLE_FORMAT };
        add(zip, "ibgs.json", &serde_json::to_vec(&Header { format, iteration: self.iteration, offset })?)?;
        add_exposures(zip, exposure::FILE_NAME, self.exposure.as_ref())?;
        add(zip, "cameras.json", &serde_json::to_vec(&cameras::to_json(&self.cameras))?)?;
        add(zip, "multi_view.json", multi_view::to_text(&self.sources)?.as_bytes())?;
        add(zip, OPTIONS, self.config.to_text().map_err(io::Error::other)?.as_bytes())?;
        if packing == Packing::Levels {
            // In the coordinates in which it is rendered.
            let space = cameras::space(&self.cameras, &self.gaussians, self.config.data.extent);
            let chunks = levels::build(self.gaussians.clone().into_space(space), levels::CHUNK);
            let tree = Tree::of(space, self.gaussians.sh_degree, &chunks);
            add(zip, TREE, &serde_json::to_vec(&tree)?)?;
            stored_zip::add_large(zip, CHUNKS, tree.bytes(), |out| levels::write(&chunks, out))?;
        } else if packing == Packing::Lossless {
            let mut ply = Vec::new();
            write_ply_to(&mut ply, &self.gaussians, PlyFlavor::Full)?;
            add(zip, CLOUD, &ply)?;
        } else {
            let place = LocalSpace::at(offset.unwrap_or_default());
            let [sog, planes] = packed::encode(&self.gaussians.in_space(place)).map_err(io::Error::other)?;
            add(zip, SOG, &sog)?;
            add(zip, "planes.bin", &planes)?;
        }
        if let Some(network) = &self.network {
            add(zip, "network.bin", network)?;
        }
        for (member, number) in self.members.iter().zip(2..) {
            let [cloud, exposure] = member_parts(number);
            let mut ply = Vec::new();
            write_ply_to(&mut ply, &member.gaussians, PlyFlavor::Plain)?;
            add(zip, &cloud, &ply)?;
            add_exposures(zip, &exposure, member.exposure.as_ref())?;
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
