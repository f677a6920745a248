//! What the photos have of the scene's points: the 2D observations of a reconstruction.

use super::archive::Unpacked;
use super::lens::Lens;
use super::{Dataset, DatasetError, LoadOptions, Loaders, is_archive};
use crate::adjust::{Seen, Track};
use crate::camera::Camera;
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;
use std::path::Path;

/// The observations of a photo, in pixels of its lens.
#[derive(Debug)]
pub(super) struct Observed {
    pub name: String,
    pub lens: Lens,
    /// Number of the point, and where it is.
    pub points: Vec<(u64, DVec2)>,
}

/// What a loader knows of observations.
#[derive(Debug, Default)]
pub struct Observations {
    pub(super) photos: Vec<Observed>,
    /// The points by number.
    pub(super) positions: BTreeMap<u64, DVec3>,
}

/// Where an observation is in the photo as it was loaded; none where that does not show it.
fn loaded(lens: &Lens, camera: &Camera, pixel: DVec2) -> Option<DVec2> {
    let ray = lens.distortion.undistort((pixel - lens.principal) / lens.focal)?;
    let size =
        [[camera.width, lens.width], [camera.height, lens.height]].map(|[to, from]| f64::from(to) / f64::from(from));
    let at = (ray * lens.focal + lens.principal) * DVec2::from_array(size);
    let within = (0.0..f64::from(camera.width)).contains(&at.x) && (0.0..f64::from(camera.height)).contains(&at.y);
    within.then_some(at)
}

impl Dataset {
    /// The tracks of the training photos, whose views have their numbers in `train`; none where the scene has no observations. Those
    /// of a scene that was not made are read anew from its files.
    ///
    /// # Errors
    /// A file is damaged, or no longer there.
    pub fn tracks(&self, options: &LoadOptions) -> Result<Vec<Track>, DatasetError> {
        if !self.made_tracks.is_empty() {
            return Ok(self.tracks_made());
        }
        if !is_archive(&self.path) {
            return self.tracks_in(&self.path, options);
        }
        let unpacked = Unpacked::new(&self.path)?;
        self.tracks_in(&unpacked.root(&Loaders::default()), options).map_err(|error| unpacked.error(error))
    }

    fn tracks_made(&self) -> Vec<Track> {
        let mut number = vec![None; self.views.len()];
        self.train.iter().zip(0..).for_each(|(&view, i)| number[view] = Some(i));
        let seen = |seen: &Seen| Some(Seen { view: number[seen.view]?, ..*seen });
        let track = |track: &Track| Track { seen: track.seen.iter().filter_map(seen).collect(), ..*track };
        self.made_tracks.iter().map(track).filter(|track| track.seen.len() > 1).collect()
    }

    fn tracks_in(&self, path: &Path, options: &LoadOptions) -> Result<Vec<Track>, DatasetError> {
        let Observations { photos, positions } = Loaders::default().of(path)?.observations(path, options)?;
        let number: BTreeMap<&str, usize> = (0..).zip(&self.train).map(|(i, &v)| (&*self.views[v].name, i)).collect();
        let mut tracks: BTreeMap<u64, Track> = BTreeMap::new();
        for Observed { name, lens, points } in &photos {
            let Some(&view) = number.get(&**name) else { continue };
            let camera = &self.views[self.train[view]].camera;
            for &(point, pixel) in points {
                let Some(pixel) = loaded(lens, camera, pixel) else { continue };
                let position = positions.get(&point).copied();
                let track = tracks.entry(point).or_insert_with(|| Track { position, seen: Vec::new() });
                if track.seen.iter().all(|seen| seen.view != view) {
                    track.seen.push(Seen { view, pixel });
                }
            }
        }
        Ok(tracks.into_values().filter(|track| track.seen.len() > 1).collect())
    }
}
