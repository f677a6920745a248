//! Rendering a camera path to frames and a video.

use crate::mode::{Mode, Style};
use anyhow::{Result, bail};
use ibgs_core::camera::Camera;
use ibgs_core::counted;
use ibgs_core::gpu::Gpu;
use ibgs_core::image_io::write_png;
use ibgs_core::present::Presenter;
use ibgs_core::render::Renderer;
use ibgs_core::video;
use std::path::PathBuf;
use std::sync::Arc;

/// How much a film's video is compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FilmQuality {
    Small,
    #[default]
    Usual,
    High,
}

impl FilmQuality {
    pub const ALL: [Self; 3] = [Self::Small, Self::Usual, Self::High];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Small => "small file",
            Self::Usual => "usual quality",
            Self::High => "high quality",
        }
    }

    /// The constant rate factor of its video; none: the encoder's own.
    pub fn rate_factor(self) -> Option<u32> {
        match self {
            Self::Small => Some(30),
            Self::Usual => None,
            Self::High => Some(16),
        }
    }
}

/// A film that is asked for.
#[derive(Clone, Debug)]
pub struct Film {
    /// One camera a frame.
    pub cameras: Vec<Camera>,
    /// Frames a second.
    pub fps: f64,
    /// What is shown.
    pub mode: Mode,
    /// How it is shown.
    pub style: Style,
    /// How much its video is compressed.
    pub quality: FilmQuality,
    /// Where it goes.
    pub target: FilmTarget,
}

/// A picture of a model, RGB, as it is shown in a film.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn picture(
    renderer: &Renderer,
    presenter: &mut Presenter,
    camera: &Camera,
    (mode, style): (Mode, &Style),
) -> Result<Vec<u8>> {
    renderer.complete(camera)?;
    let look = mode.look().map(|look| look.of(renderer)).transpose()?;
    let frame = look.as_ref().unwrap_or(renderer).render(camera)?;
    Ok(presenter.picture(&frame, &mode.shown(style, None))?)
}

/// Where a film goes.
#[derive(Clone, Debug)]
pub enum FilmTarget {
    /// Frames and video in an empty or missing folder.
    Frames(PathBuf),
    /// Its only frame in a file.
    Still(PathBuf),
}

impl FilmTarget {
    /// Where a frame goes.
    fn frame(&self, index: usize) -> PathBuf {
        match self {
            Self::Frames(folder) => folder.join(video::frame_name(index)),
            Self::Still(path) => path.clone(),
        }
    }
}

/// A film in work.
pub struct Shoot {
    film: Film,
    presenter: Presenter,
    done: usize,
}

impl Shoot {
    /// Begins a film.
    ///
    /// # Errors
    /// A folder that already holds something, or not enough memory.
    pub fn begin(gpu: &Arc<Gpu>, film: Film) -> Result<Self> {
        if let FilmTarget::Frames(folder) = &film.target
            && folder.read_dir().is_ok_and(|mut entries| entries.next().is_some())
        {
            bail!("{} is not empty; choose another folder for the film", folder.display());
        }
        Ok(Self { presenter: Presenter::new(gpu.clone())?, film, done: 0 })
    }

    /// Frames that are done.
    pub fn done(&self) -> usize {
        self.done
    }

    /// Frames in all.
    fn count(&self) -> usize {
        self.film.cameras.len()
    }

    /// Renders a frame; after the last one makes the video and says what was written.
    ///
    /// # Errors
    /// The device failed, or a file cannot be written.
    pub fn next(&mut self, renderer: &Renderer) -> Result<Option<String>> {
        if let Some(camera) = self.film.cameras.get(self.done) {
            let rgb = picture(renderer, &mut self.presenter, camera, (self.film.mode, &self.film.style))?;
            write_png(&self.film.target.frame(self.done), camera.width, camera.height, &rgb)?;
            self.done += 1;
        }
        if self.done < self.count() {
            return Ok(None);
        }
        let folder = match &self.film.target {
            FilmTarget::Frames(folder) => folder,
            FilmTarget::Still(path) => return Ok(Some(format!("still: {}", path.display()))),
        };
        let frames = format!("{} in {}", counted(self.count(), "frame"), folder.display());
        Ok(Some(match video::encode(folder, self.count(), self.film.fps, self.film.quality.rate_factor()) {
            Ok(path) => format!("{frames}; video: {}", path.display()),
            Err(error) => format!("{frames}; {error}"),
        }))
    }

    /// What there is of a film that was cancelled.
    pub fn cancelled(&self) -> String {
        let (FilmTarget::Frames(place) | FilmTarget::Still(place)) = &self.film.target;
        format!("cancelled after {} of {} frames in {}", self.done, self.count(), place.display())
    }
}
