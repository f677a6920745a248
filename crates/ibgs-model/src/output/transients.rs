//! Learned masks of what moves, in the model folder: pictures with a pixel for each cell, black where it is hidden.

use super::{OutputError, OutputFolder, named_picture};
use crate::dataset::{CellMask, Dataset};
use crate::files::WriteError;
use crate::image_io;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Their folder, beside the point cloud.
const FOLDER: &str = "transients";

impl OutputFolder {
    /// Where the learned masks of an iteration are saved.
    pub fn transients_path(&self, iteration: u32) -> PathBuf {
        self.point_cloud_path(iteration).with_file_name(FOLDER)
    }

    /// Writes the masks of the training photos, in the order of the training views, in place of those that are there. A photo of which
    /// nothing is hidden has none.
    ///
    /// # Errors
    /// [`OutputError::Write`].
    pub fn write_transients<'a>(
        &self,
        iteration: u32,
        dataset: &Dataset,
        masks: impl IntoIterator<Item = &'a CellMask>,
    ) -> Result<(), OutputError> {
        let folder = self.transients_path(iteration);
        match fs::remove_dir_all(&folder) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(WriteError::new(&folder, error).into()),
            _ => {}
        }
        for (&view, mask) in dataset.train.iter().zip(masks).filter(|(_, mask)| !mask.is_empty()) {
            let path = named_picture(folder.clone(), &dataset.views[view].name);
            let [width, height] = CellMask::grid(mask.size());
            let level = |hidden: &bool| [if *hidden { 0 } else { u8::MAX }; 3];
            let rgb: Vec<u8> = mask.hidden().iter().flat_map(level).collect();
            image_io::write_png(&path, width, height, &rgb)?;
        }
        Ok(())
    }

    /// Reads the mask of the photo of this name, width and height at an iteration; none where nothing of it is hidden.
    ///
    /// # Errors
    /// [`OutputError::Read`], [`OutputError::Damaged`] naming the file.
    pub fn read_transients(&self, iteration: u32, name: &str, size: [u32; 2]) -> Result<Option<CellMask>, OutputError> {
        let path = named_picture(self.transients_path(iteration), name);
        match fs::read(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(OutputError::Read { path, source }),
            Ok(bytes) => parse(&path, &bytes, size).map(Some),
        }
    }
}

/// The mask in the contents of a picture; `path` is for messages.
fn parse(path: &Path, bytes: &[u8], size: [u32; 2]) -> Result<CellMask, OutputError> {
    let damaged = |reason: String| OutputError::Damaged { path: path.to_owned(), reason };
    let picture = image_io::decode(bytes).map_err(damaged)?.into_luma8();
    let (found, [width, height]) = (picture.dimensions(), CellMask::grid(size));
    let hidden = picture.into_raw().into_iter().map(|level| level < 128).collect();
    let mask = CellMask::new(size, hidden).filter(|_| found == (width, height));
    mask.ok_or_else(|| {
        let [w, h] = size;
        damaged(format!(
            "it has {} x {} pixels, and the cells of a photo of {w} x {h} are {width} x {height}",
            found.0, found.1
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_come_back_and_old_ones_go() {
        let place = tempfile::tempdir().unwrap();
        let folder = OutputFolder::at(place.path());
        let options = ibgs_demo::DemoOptions { width: 16, height: 12, views: 6, samples: 1, points: 20, seed: 0 };
        let mut scene = ibgs_demo::load(&options, Some(place.path()), &()).unwrap();
        let first = scene.train[0];
        scene.views[first].name = "left/view.one.jpg".to_owned();
        let mask =
            |hidden: [usize; 2]| CellMask::new([16, 12], (0..12).map(|cell| hidden.contains(&cell)).collect()).unwrap();
        let (empty, some, others) = (mask([99, 99]), mask([0, 5]), mask([3, 11]));
        let of = |name: &str| folder.read_transients(7, name, [16, 12]).unwrap();
        let second = scene.views[scene.train[1]].name.clone();
        folder.write_transients(7, &scene, [&some, &others, &empty]).unwrap();
        assert_eq!((of("left/view.one.jpg"), of(&second)), (Some(some), Some(others.clone())));
        folder.write_transients(7, &scene, [&empty, &others]).unwrap();
        assert_eq!((of("left/view.one.jpg"), of(&second)), (None, Some(others)));
        let error = folder.read_transients(7, &second, [17, 12]).unwrap_err().to_string();
        assert!(error.contains("4 x 3 pixels") && error.contains("5 x 3"), "{error}");
        let file = named_picture(folder.transients_path(7), &second);
        fs::write(&file, b"no picture").unwrap();
        let error = folder.read_transients(7, &second, [16, 12]).unwrap_err().to_string();
        assert!(error.contains(&*file.to_string_lossy()), "{error}");
    }
}
