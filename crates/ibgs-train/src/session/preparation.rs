//! What is known right before the first iteration.

use crate::memory::Need;
use ibgs_core::counted;
use ibgs_core::gpu::Bytes;
use std::fmt;
use std::path::PathBuf;

/// A training that is about to begin.
#[derive(Clone, Debug)]
pub struct Preparation {
    /// Number of training views.
    pub training_views: usize,
    /// Number of held-out views.
    pub test_views: usize,
    /// Number of points that it begins with.
    pub points: usize,
    /// Of these, how many a training view shows.
    pub shown: usize,
    /// The file or model whose Gaussians it begins with, in place of the points.
    pub init: Option<PathBuf>,
    /// Iterations of the whole run.
    pub iterations: u32,
    /// Where it writes; none: nowhere.
    pub folder: Option<PathBuf>,
    /// Device memory that it needs at its start.
    pub at_start: Need,
    /// Device memory that it needs with the most Gaussians; none where their number stays.
    pub at_most: Option<Need>,
}

impl fmt::Display for Preparation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { training_views, test_views, points, shown, init, iterations, folder, at_start, at_most } = self;
        write!(f, "{}, {}, ", counted(*training_views, "training view"), counted(*test_views, "test view"))?;
        match init {
            Some(init) => write!(f, "{} Gaussians of {} to begin with, ", at_start.gaussians, init.display())?,
            None => write!(f, "{} ({shown} within the training views), ", counted(*points, "initial point"))?,
        }
        write!(f, "{}; ", counted(*iterations, "iteration"))?;
        match folder {
            Some(folder) => write!(f, "writing to {}", folder.display())?,
            None => f.write_str("writing nothing")?,
        }
        write!(f, "\nmemory: needs about {} at {} Gaussians", Bytes(at_start.bytes), at_start.gaussians)?;
        match at_most {
            Some(most) => write!(f, ", {} at {}", Bytes(most.bytes), most.gaussians),
            None => Ok(()),
        }
    }
}
