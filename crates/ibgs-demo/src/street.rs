//! A street of demo rooms: a scene of any size, to test and to measure scenes in blocks.

use super::cache::Cache;
use super::scene::{Scene, room_offset};
use super::{DemoError, DemoOptions, Traced, cameras};
use ibgs_data::camera::Camera;
use ibgs_data::dataset::Dataset;
use ibgs_data::progress::Progress;
use serde::Serialize;
use std::path::Path;

/// Size and richness of a street.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct StreetOptions {
    /// Number of rooms, side by side along x without walls between them: 4.4 metres each.
    pub rooms: usize,
    /// Photos and points of each room; the cameras of every room wobble in their own way.
    pub room: DemoOptions,
}

/// Traces a street, or reads it from the folder where it was traced before: a nerfstudio scene folder. `progress` receives the
/// photos that are traced.
///
/// # Errors
/// Options outside of their range, a folder that holds another scene. A folder that cannot be written is a note of the data set.
pub fn street(options: &StreetOptions, folder: &Path, progress: &dyn Progress) -> Result<Dataset, DemoError> {
    let StreetOptions { rooms, room } = options;
    room.validate()?;
    let (least, most) = (1, 1_000);
    if !(least..=most).contains(rooms) {
        let (value, least, most) = (*rooms as u64, least as u64, most as u64);
        return Err(DemoError::Option { field: "rooms", value, least, most });
    }
    let cache = Cache::at(folder);
    if !cache.is_for(options) {
        return Err(DemoError::OtherScene { path: folder.to_owned() });
    }
    let cameras_of = |number: usize| {
        let seed = room.seed.wrapping_add(number as u64);
        let moved = move |camera: Camera| {
            let translation = camera.translation - camera.view_from_world * room_offset(number);
            Camera { translation, ..camera }
        };
        cameras(&DemoOptions { seed, ..room.clone() }).into_iter().map(moved)
    };
    let traced = Traced {
        scene: &Scene::street(*rooms),
        cache,
        cameras: (0..*rooms).flat_map(cameras_of).collect(),
        samples: room.samples,
        points: (rooms * room.points, room.seed),
    };
    // First, so that a trace that was interrupted is told from another scene's; a failure becomes a note of the whole.
    let _ = traced.cache.list(options, &traced.cameras);
    Ok(traced.load(options, progress))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render_photo;

    #[test]
    fn rooms_lie_side_by_side_and_the_first_is_the_demo() {
        let room = DemoOptions { width: 48, height: 36, views: 4, samples: 1, points: 400, seed: 0 };
        let folder = tempfile::tempdir().unwrap();
        let trace = |rooms: usize| {
            let options = StreetOptions { rooms, room: room.clone() };
            street(&options, &folder.path().join(rooms.to_string()), &()).unwrap()
        };
        let (one, three) = (trace(1), trace(3));
        assert!(one.notes.is_empty(), "{:?}", one.notes);
        for (view, camera) in one.views.iter().zip(cameras(&room)) {
            assert_eq!(view.photo.pixels().unwrap().rgba, render_photo(&camera, 1).rgba);
        }
        assert_eq!((three.views.len(), three.points.len()), (12, 1_200));
        let offset = three.views[4].camera.center() - three.views[0].camera.center();
        // Seeds differ, so the cameras do by their wobble.
        assert!((offset.x - 4.4).abs() < 0.5 && offset.y.abs() < 0.5, "{offset}");
        // No wall where the rooms meet: the photos show farther than one room.
        assert!(three.points.iter().any(|point| point.position.x > 9.0));
        assert_ne!(one.views[0].photo.pixels().unwrap().rgba, three.views[0].photo.pixels().unwrap().rgba);
        // What was traced is read back as the scene folder that it is.
        let read = ibgs_data::dataset::load(&three.path, &ibgs_data::dataset::LoadOptions::default()).unwrap();
        assert_eq!((read.views.len(), read.points.len()), (12, 1_200));
        assert!(read.views[5].photo.pixels().unwrap().rgba == three.views[5].photo.pixels().unwrap().rgba);
        let other = StreetOptions { rooms: 2, room: room.clone() };
        let error = street(&other, &three.path, &()).unwrap_err().to_string();
        assert!(error.contains("holds another scene"), "{error}");
        // A trace that was interrupted goes on.
        std::fs::remove_file(three.path.join("images/view_005.png")).unwrap();
        std::fs::remove_file(three.path.join("points3D.ply")).unwrap();
        assert!(street(&StreetOptions { rooms: 3, room: room.clone() }, &three.path, &()).is_ok());
        let refused = StreetOptions { rooms: 0, room };
        assert!(street(&refused, folder.path(), &()).unwrap_err().to_string().contains("`rooms` is 0"));
    }
}
