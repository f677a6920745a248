//! Ensembles: several bases, whose images are averaged. The first member has the surface; it and the first of the others have a
//! network, whose residuals are averaged too, the rest are models of the base alone.

use crate::exposure::Exposure;
use crate::scene::Gaussians;
use std::collections::HashMap;

/// A member of an ensemble besides the first.
#[derive(Clone, Debug)]
pub struct Member {
    /// Its Gaussians, as the file has them.
    pub gaussians: Gaussians,
    /// Flat weights of its residual network, where it has one.
    pub network: Option<Vec<f32>>,
    /// What it learned of the training photos' exposures, by name; none where they were not corrected.
    pub exposure: Option<HashMap<String, Exposure>>,
}

/// The folder of a further member's files inside that of the first, by its number from 2.
pub fn folder(member: usize) -> String {
    format!("member_{member}")
}
