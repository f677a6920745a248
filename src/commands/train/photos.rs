//! `ibgs train --prepare`: photos or a video in place of a scene.

use super::Args;
use crate::commands::prepare::scene_of;
use crate::prepare::inputs_in;
use anyhow::{Result, bail};
use ibgs_core::dataset::{self, DatasetError};

/// The options with a scene that is made of the photos; a scene that has poses stays as it is.
///
/// # Errors
/// An option that the training would refuse; what a preparation cannot begin with, or fails with.
pub fn prepared(args: &Args) -> Result<Args> {
    let Some(path) = args.scene.as_ref().or(args.source.as_ref()) else {
        bail!("`--prepare` needs a folder of photos or a video: `ibgs train PHOTOS --prepare`");
    };
    let Err(DatasetError::NotAScene { .. }) = dataset::inspect(path) else { return Ok(args.clone()) };
    args.check()?;
    let input = inputs_in(path).unwrap_or_else(|| path.clone());
    Ok(Args { scene: Some(scene_of(input)?), source: None, ..args.clone() })
}
