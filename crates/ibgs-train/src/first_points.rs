//! The points that a training begins with: those of the scene, and those found in its photos.

use ibgs_core::config::TrainConfig;
use ibgs_core::dataset::{Dataset, InitialPoints, PointsFrom};
use ibgs_core::gpu::{Gpu, GpuError};
use ibgs_core::progress::Progress;
use ibgs_core::sources::sweep;

/// Adds points found in the photos to the scene's own, or puts them in the place of random ones that stand in; a note says so. Not
/// to those of an object, whose plain parts give wrong ones; nor on a software adapter, where it takes long. The options are adapted
/// to the scene.
///
/// # Errors
/// Not enough memory, the device is lost, or a photo cannot be decoded again.
pub fn find_points(
    gpu: &Gpu,
    dataset: &mut Dataset,
    config: &TrainConfig,
    progress: &dyn Progress,
) -> Result<(), GpuError> {
    let adds = match (dataset.points_from, config.data.initial_points) {
        _ if config.init.is_some() => return Ok(()),
        (PointsFrom::Scene, InitialPoints::Auto) if !gpu.is_software() && !config.data.shows_object() => true,
        (PointsFrom::Chance, _) => false,
        _ => return Ok(()),
    };
    let found = sweep::points(gpu, dataset, config.data.random_points as usize, progress)?;
    let count = found.len();
    dataset.notes.push(match (adds, count) {
        (_, 0) => "too few points were found in the photos to begin with them".to_owned(),
        (true, _) => format!("{count} points found in the photos join the {} of the scene", dataset.points.len()),
        (false, _) => format!("{count} points found in the photos replace the random ones"),
    });
    if count > 0 {
        if !adds {
            dataset.points.clear();
        }
        dataset.points.extend(found);
        dataset.points_from = PointsFrom::Photos;
    }
    Ok(())
}
