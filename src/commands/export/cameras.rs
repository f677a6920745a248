//! The cameras of a model for other programs.

use super::{Args, refuse_taken};
use anyhow::Result;
use ibgs_core::counted;
use ibgs_core::dataset::colmap_text;
use ibgs_core::files::write_atomically;
use std::path::Path;

/// Writes them as a COLMAP model in text, and says so.
pub fn write(args: &Args, folder: &Path) -> Result<String> {
    refuse_taken(folder, args.overwrite)?;
    let model = args.model.read()?;
    let photos = model.cameras.iter().map(|record| (record.name.as_str(), &record.camera));
    for (name, text) in colmap_text(photos, &[]) {
        write_atomically(&folder.join(name), |out| out.write_all(text.as_bytes()))?;
    }
    Ok(format!("{} written, cameras of {}", folder.display(), counted(model.cameras.len(), "photo")))
}
