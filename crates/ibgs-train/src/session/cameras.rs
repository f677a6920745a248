//! The cameras that a training has refined, in the session's data set and in the model folder.

use super::Session;
use ibgs_core::camera::Camera;
use ibgs_core::dataset::Dataset;
use ibgs_core::output::OutputError;
use ibgs_core::similarity::Similarity;

impl Session {
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
