//! `ibgs render`

use super::{Model, write_pictures};
use anyhow::{Result, bail};
use clap::{Args as ClapArgs, ValueEnum};
use ibgs_core::camera::Camera;
use ibgs_core::camera_path::CameraPath;
use ibgs_core::image_io::write_png;
use ibgs_core::render::render_view;
use ibgs_core::train::output::cameras::Split;
use std::path::PathBuf;

/// Which of the scene's views to render.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Views {
    /// The held-out views (all views when none were held out).
    Test,
    /// The training views.
    Train,
    /// Every view.
    All,
}

/// Options of `ibgs render`.
#[derive(ClapArgs)]
pub struct Args {
    /// Model folder, as `ibgs train` writes it.
    model: PathBuf,
    /// Iteration to render; left out: the latest.
    #[arg(long)]
    iteration: Option<u32>,
    /// Which views of the scene to render into the model folder.
    #[arg(long, value_enum, default_value = "test")]
    views: Views,
    /// Render a camera path (nerfstudio's JSON) in place of the scene's views.
    #[arg(long)]
    camera_path: Option<PathBuf>,
    /// Folder for the frames of a camera path [default: MODEL/path/ours_N].
    #[arg(short, long, requires = "camera_path")]
    output: Option<PathBuf>,
    /// Adapter by number or part of its name; `ibgs info` lists them.
    #[arg(long)]
    adapter: Option<String>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let path = args.camera_path.as_deref().map(CameraPath::load).transpose()?;
    let model = Model::open(&args.model, args.iteration, args.adapter.as_ref())?;
    match path {
        Some(path) => render_path(&model, &path.cameras, args.output.clone()),
        None => render_views(&model, args.views),
    }
}

fn render_path(model: &Model, cameras: &[Camera], output: Option<PathBuf>) -> Result<()> {
    let default = || model.folder.root().join("path").join(format!("ours_{}", model.iteration));
    let folder = output.unwrap_or_else(default);
    let bar = indicatif::ProgressBar::new(cameras.len() as u64);
    for (index, camera) in cameras.iter().enumerate() {
        let image = render_view(&model.raster, &model.splats, camera, model.background())?;
        write_png(&folder.join(format!("{index:05}.png")), image.width, image.height, &image.to_rgb8())?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    eprintln!("{} frames in {}", cameras.len(), folder.display());
    Ok(())
}

fn render_views(model: &Model, views: Views) -> Result<()> {
    let records = model.folder.read_cameras()?;
    let any_test = records.iter().any(|r| r.split == Some(Split::Test));
    let wanted = |split: Option<Split>| match views {
        Views::All => true,
        Views::Test => split == Some(Split::Test) || !any_test,
        Views::Train => split != Some(Split::Test),
    };
    let mut count = 0;
    for record in records.iter().filter(|r| wanted(r.split)) {
        let image = render_view(&model.raster, &model.splats, &record.camera, model.background())?;
        let split = record.split.unwrap_or(Split::Train);
        write_pictures(&model.folder, split, model.iteration, &record.name, &image, None)?;
        count += 1;
    }
    if count == 0 {
        bail!("{} has no such view; choose another `--views`", model.folder.root().display());
    }
    eprintln!("{count} views rendered below {}", model.folder.root().display());
    Ok(())
}
