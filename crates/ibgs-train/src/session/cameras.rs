//! The cameras that a training has refined, in the session's data set and in the model folder.

use super::Session;
use ibgs_core::camera::Camera;
use ibgs_core::dataset::Dataset;
use ibgs_core::output::OutputError;
use ibgs_core::similarity::Similarity;
use ibgs_core::{first_of, median};
use std::fmt;

/// A camera that has moved by more than this, in radians and parts of the distance, and by as many times the median of all is named.
const FAR: f64 = 0.01;
const FAR_TIMES: f64 = 5.0;
/// Most photos that a sentence names.
const NAMED: usize = 5;

/// How far refined cameras have moved, each apart from the common frame.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraSummary {
    /// The mean angle in radians, and the mean distance as a part of that to what a photo shows.
    pub moved: [f64; 2],
    /// Photos whose cameras have moved much farther than the others: they may fit nothing.
    pub astray: Vec<String>,
}

impl CameraSummary {
    fn new(moved: &[[f64; 2]], names: &[&str]) -> Self {
        let count = moved.len().max(1) as f64;
        let mean = moved.iter().fold([0.0; 2], |[a, b], [angle, distance]| [a + angle / count, b + distance / count]);
        let lengths: Vec<f64> = moved.iter().map(|[angle, distance]| angle + distance).collect();
        let least = median(lengths.clone()).map_or(FAR, |median| FAR.max(FAR_TIMES * median));
        let far = lengths.iter().zip(names).filter(|(length, _)| **length > least);
        Self { moved: mean, astray: far.map(|(_, name)| (*name).to_owned()).collect() }
    }
}

impl fmt::Display for CameraSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (angle, distance) = (self.moved[0].to_degrees(), 100.0 * self.moved[1]);
        write!(f, "cameras: refined by {angle:.3} degrees and {distance:.3} % of their distance, on average")?;
        match &self.astray[..] {
            [] => Ok(()),
            astray => write!(f, "; {} moved much farther and may fit nothing: {}", astray.len(), some(astray)),
        }
    }
}

/// The first names of photos.
pub(super) fn some(names: &[impl AsRef<str>]) -> String {
    first_of(names, NAMED)
}

impl Session {
    /// What became of the cameras, where they were refined.
    pub(super) fn camera_summary(&self) -> Option<CameraSummary> {
        let names: Vec<&str> = self.dataset.train.iter().map(|&view| &*self.dataset.views[view].name).collect();
        self.trainer.moved_cameras().map(|moved| CameraSummary::new(&moved, &names))
    }

    /// The cameras of all views as they were loaded, where those of the training views are refined.
    pub(super) fn refined_from(dataset: &Dataset, refines: bool) -> Option<Vec<Camera>> {
        refines.then(|| dataset.views.iter().map(|view| view.camera).collect())
    }

    /// Gives the views the cameras that the training has now, and writes them.
    pub(super) fn adopt_cameras(&mut self) -> Result<(), OutputError> {
        let Some(loaded) = &self.loaded_cameras else { return Ok(()) };
        let cameras = adopted(loaded, &self.dataset.train, self.trainer.scene_cameras());
        self.dataset.views.iter_mut().zip(cameras).for_each(|(view, camera)| view.camera = camera);
        match &self.folder {
            Some(folder) => folder.write_cameras(&self.dataset),
            None => Ok(()),
        }
    }
}

/// The cameras of all views after a training has refined those of `train`. No other learns from its photo: it moves with the common
/// frame, by the similarity that fits the refined cameras to the loaded ones, and has its lens where it is that of a training view.
pub(super) fn adopted(loaded: &[Camera], train: &[usize], refined: &[Camera]) -> Vec<Camera> {
    let pairs: Vec<(Camera, Camera)> = train.iter().map(|&view| loaded[view]).zip(refined.iter().copied()).collect();
    let frame = Similarity::fit(&pairs);
    let moved = |camera: &Camera| {
        let lens = pairs.iter().find(|(from, _)| from.has_lens_of(camera)).map_or(*camera, |(_, to)| *to);
        Camera { focal: lens.focal, principal: lens.principal, ..frame.camera(camera) }
    };
    let mut cameras: Vec<Camera> = loaded.iter().map(moved).collect();
    train.iter().zip(refined).for_each(|(&view, camera)| cameras[view] = *camera);
    cameras
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2, DVec3};

    #[test]
    fn cameras_that_move_much_farther_than_the_others_are_named() {
        let names = ["a", "b", "c", "d", "e", "f", "g", "h"];
        let mut moved = [[0.001, 0.003]; 8];
        let said = CameraSummary::new(&moved, &names).to_string();
        assert_eq!(said, "cameras: refined by 0.057 degrees and 0.300 % of their distance, on average");
        moved[3] = [0.019, 0.0];
        assert!(CameraSummary::new(&moved, &names).astray.is_empty(), "not five times the median");
        (moved[3], moved[6]) = ([0.021, 0.0], [0.0, 0.5]);
        let said = CameraSummary::new(&moved, &names).to_string();
        assert!(said.ends_with("; 2 moved much farther and may fit nothing: d, g"), "{said}");
        let near = [[1e-4, 0.0], [1e-4, 0.0], [9e-3, 0.0]];
        assert!(CameraSummary::new(&near, &names[..3]).astray.is_empty(), "nearer than is worth a word");
        assert!(CameraSummary::new(&[], &[]).astray.is_empty());
        assert_eq!(some(&names), "a, b, c, d, e, ...");
    }

    #[test]
    fn held_out_cameras_move_with_the_common_frame_and_have_the_lens_of_their_photos() {
        let camera = |i: u32| Camera {
            width: 40,
            height: 30,
            focal: DVec2::splat(30.0),
            principal: DVec2::new(20.0, 15.0),
            view_from_world: DMat3::from_rotation_y(0.3 * f64::from(i)),
            translation: DVec3::new(0.0, 0.2 * f64::from(i), 4.0),
        };
        let mut loaded: Vec<Camera> = (0..9).map(camera).collect();
        loaded[8].focal = DVec2::splat(50.0);
        let frame =
            Similarity { scale: 1.1, rotation: DMat3::from_rotation_x(0.2), translation: DVec3::new(0.5, 0.0, 0.0) };
        let lens = |camera: Camera| Camera { focal: DVec2::splat(31.0), ..camera };
        let train = [0, 1, 2, 4, 5, 7];
        let refined: Vec<Camera> = train.iter().map(|&view| lens(frame.camera(&loaded[view]))).collect();
        let cameras = adopted(&loaded, &train, &refined);
        for (view, camera) in cameras.iter().enumerate() {
            let expected = frame.camera(&loaded[view]);
            assert!(camera.translation.abs_diff_eq(expected.translation, 1e-12), "view {view}");
            assert!(camera.view_from_world.abs_diff_eq(expected.view_from_world, 1e-12), "view {view}");
            assert_eq!(camera.focal.x, if view == 8 { 50.0 } else { 31.0 }, "view {view}");
        }
    }
}
