//! What a rendered view is written as.

use super::OutputFolder;
use super::cameras::Split;
use crate::camera::Camera;
use crate::dataset::{CellMask, Photo};
use crate::files::WriteError;
use crate::gpu::GpuError;
use crate::picture::{MOST_VISIBLE, Picture, exr};
use crate::render::{Frame, Renderer};
use std::path::{Path, PathBuf};

/// Why a frame was not written.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// One picture of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// The final image.
    Final,
    /// The base image.
    Base,
    /// Final minus base image, around grey.
    Residual,
    /// Median depth, with a scale.
    Depth,
    /// Normal map.
    Normal,
    /// Number of photos used at each pixel.
    Visibility,
    /// What the learned mask of a training photo hides, black.
    Mask,
}

/// Folder of the photos beside the pictures.
pub const PHOTO_FOLDER: &str = "gt";

/// What an output needs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Needs {
    Nothing,
    /// A model with a residual network.
    Network,
    /// The surface.
    Surface,
    /// A model with learned masks; a frame does not have it.
    Mask,
}

/// All that is known of an output.
struct Row {
    output: Output,
    name: &'static str,
    about: &'static str,
    /// Named as the published code has it where it has one.
    folder: &'static str,
    needs: Needs,
}

const fn row(output: Output, name: &'static str, about: &'static str, folder: &'static str, needs: Needs) -> Row {
    Row { output, name, about, folder, needs }
}

/// The outputs in their order.
static TABLE: [Row; 7] = [
    row(Output::Final, "final", "The final image", "renders_aggregate", Needs::Network),
    row(Output::Base, "base", "The base image", "renders", Needs::Nothing),
    row(Output::Residual, "residual", "Final minus base image, around grey", "predicted_residual", Needs::Network),
    row(Output::Depth, "depth", "Median depth, with a scale", "renders_depth", Needs::Surface),
    row(Output::Normal, "normal", "Normal map", "renders_normal", Needs::Surface),
    row(Output::Visibility, "visibility", "Number of photos used at each pixel", "visibility", Needs::Network),
    row(Output::Mask, "mask", "What the learned mask of a training photo hides, black", "masks", Needs::Mask),
];

impl Output {
    /// All of them.
    pub const ALL: [Output; TABLE.len()] = {
        let mut all = [Output::Final; TABLE.len()];
        let mut i = 0;
        while i < TABLE.len() {
            all[i] = TABLE[i].output;
            assert!(all[i] as usize == i, "the table has the order of the enum");
            i += 1;
        }
        all
    };

    fn row(self) -> &'static Row {
        &TABLE[self as usize]
    }

    /// Its name, as options give it.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// What it shows, in a few words.
    pub fn about(self) -> &'static str {
        self.row().about
    }

    /// Name of the folder of such pictures.
    pub fn folder(self) -> &'static str {
        self.row().folder
    }

    /// Whether only a model with a residual network has it.
    pub fn needs_network(self) -> bool {
        self.row().needs == Needs::Network
    }

    /// Whether only a training photo of a model with learned masks has it.
    pub fn needs_mask(self) -> bool {
        self.row().needs == Needs::Mask
    }

    /// Whether it shows the surface.
    pub fn needs_surface(self) -> bool {
        self.row().needs == Needs::Surface
    }

    /// The default outputs: the images that the model has.
    pub fn of(renderer: &Renderer) -> Vec<Output> {
        match renderer.part() {
            Some(_) => vec![Output::Base, Output::Final],
            None => vec![Output::Base],
        }
    }
}

/// Everything that a frame shows, on the host.
struct Shown {
    size: [u32; 2],
    base: Vec<f32>,
    image: Option<Vec<f32>>,
    depth: Option<Vec<f32>>,
    normals: Option<Vec<f32>>,
    visibility: Option<Vec<u32>>,
}

impl Shown {
    fn of(frame: &Frame, outputs: &[Output]) -> Result<Self, GpuError> {
        let wants = |output| outputs.contains(&output);
        let base = frame.base()?;
        Ok(Self {
            size: [base.width, base.height],
            base: base.rgb,
            image: frame.image()?.map(|image| image.rgb),
            depth: if wants(Output::Depth) { frame.depth()? } else { None },
            normals: if wants(Output::Normal) { frame.normals()? } else { None },
            visibility: if wants(Output::Visibility) { frame.visibility()? } else { None },
        })
    }

    fn residual(&self) -> Option<Vec<f32>> {
        self.image.as_ref().map(|image| image.iter().zip(&self.base).map(|(a, b)| a - b).collect())
    }

    fn picture(&self, output: Output) -> Option<Picture> {
        let [w, h] = self.size;
        match output {
            Output::Final => self.image.as_ref().map(|v| Picture::colors(w, h, v)),
            Output::Base => Some(Picture::colors(w, h, &self.base)),
            Output::Residual => self.residual().map(|v| Picture::residual(w, h, &v)),
            Output::Depth => self.depth.as_ref().map(|v| Picture::depth(w, h, v, None)),
            Output::Normal => self.normals.as_ref().map(|v| Picture::normals(w, h, v)),
            Output::Visibility => self.visibility.as_ref().map(|v| Picture::visibility(w, h, v, MOST_VISIBLE)),
            Output::Mask => None,
        }
    }
}

/// Writes the wanted pictures of a frame, each to the path that `path` gives.
///
/// # Errors
/// The device is lost, or a file cannot be written.
pub fn write_pictures(frame: &Frame, outputs: &[Output], path: impl Fn(Output) -> PathBuf) -> Result<(), RenderError> {
    let shown = Shown::of(frame, outputs)?;
    for &output in outputs {
        if let Some(picture) = shown.picture(output) {
            picture.write(&path(output))?;
        }
    }
    Ok(())
}

/// Writes the wanted outputs of a frame as one EXR file with their true values.
///
/// # Errors
/// The device is lost, or the file cannot be written.
pub fn write_exr(frame: &Frame, camera: &Camera, outputs: &[Output], path: &Path) -> Result<(), RenderError> {
    let shown = Shown::of(frame, outputs)?;
    let residual = shown.residual();
    let wants = |output| outputs.contains(&output);
    let layers = exr::Layers {
        image: shown.image.as_deref().filter(|_| wants(Output::Final)),
        base: Some(shown.base.as_slice()).filter(|_| wants(Output::Base)),
        residual: residual.as_deref().filter(|_| wants(Output::Residual)),
        depth: shown.depth.as_deref(),
        normal: shown.normals.as_deref(),
        visibility: shown.visibility.as_deref(),
    };
    Ok(exr::write(path, camera, frame.near_depth(), &layers)?)
}

/// Where a view's pictures belong in a model folder.
pub struct Place<'a> {
    /// The model folder.
    pub folder: &'a OutputFolder,
    /// Side of the split.
    pub split: Split,
    /// Iteration of the model.
    pub iteration: u32,
    /// Name of the view.
    pub name: &'a str,
}

impl Place<'_> {
    fn path(&self, folder: &str) -> PathBuf {
        self.folder.picture_path(self.split, self.iteration, folder, self.name)
    }

    /// Writes the wanted pictures of a frame.
    ///
    /// # Errors
    /// The device is lost, or a file cannot be written.
    pub fn write_outputs(&self, frame: &Frame, outputs: &[Output]) -> Result<(), RenderError> {
        write_pictures(frame, outputs, |output| self.path(output.folder()))
    }

    /// Writes the view's photo beside them.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_photo(&self, photo: &Photo) -> Result<(), WriteError> {
        Picture::photo(photo).write(&self.path(PHOTO_FOLDER))
    }

    /// Writes what a learned mask hides of the view's photo of this width and height; none: nothing.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_mask(&self, mask: Option<&CellMask>, [width, height]: [u32; 2]) -> Result<(), WriteError> {
        let hides = |x, y| mask.is_some_and(|mask| mask.hides(x, y));
        let level = |x, y| [if hides(x, y) { 0 } else { u8::MAX }; 3];
        let rgb = (0..height).flat_map(|y| (0..width).flat_map(move |x| level(x, y))).collect();
        Picture { width, height, rgb }.write(&self.path(Output::Mask.folder()))
    }

    /// Path of the view's EXR file.
    pub fn exr_path(&self) -> PathBuf {
        self.path("exr").with_extension("exr")
    }
}
