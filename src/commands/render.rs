//! `ibgs render`

use super::model::{ModelArgs, OpenModel, Photos};
use crate::progress::bar;
use crate::stderr;
use anyhow::{Error, Result, bail};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{ArgGroup, Args as ClapArgs, ValueEnum};
use ibgs_core::camera_path::turntable::Axis;
use ibgs_core::camera_path::{CameraPath, KeyframePath};
use ibgs_core::counted;
use ibgs_core::files::is_same;
use ibgs_core::model::ModelError;
use ibgs_core::output::OutputFolder;
use ibgs_core::output::cameras::Split;
use ibgs_core::output::pictures::{Output, Place, write_exr, write_pictures};
use ibgs_core::scene::Harmonics;
use ibgs_core::video::{self, frame_name};
use std::path::{Path, PathBuf};

/// Which of the scene's views to render.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Views {
    /// The held-out views (all views if none were held out).
    Test,
    /// The training views.
    Train,
    /// Every view.
    All,
}

const EXAMPLES: &str = "\
Examples:
  ibgs render output/my-scene --outputs final,base,depth
  ibgs render output/my-scene --turntable 12 --video";

/// Frames a second of a turntable.
const TURNTABLE_FPS: f64 = 30.0;
/// Longest turntable, in seconds.
const LONGEST_TURN: f64 = 3600.0;

/// Options of `ibgs render`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
#[command(group(ArgGroup::new("frames").args(["camera_path", "turntable"])))]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// Views of the scene to render.
    #[arg(long, value_enum, default_value = "test")]
    views: Views,
    /// Render a camera path (nerfstudio's JSON) instead of the scene's views.
    #[arg(long)]
    camera_path: Option<PathBuf>,
    /// Render a turn of this many seconds around what the photos show, 30 frames a second, instead of the scene's views;
    /// to and fro where they show it from one side.
    #[arg(long, value_name = "SECONDS", value_parser = turn_seconds)]
    turntable: Option<f64>,
    /// Folder for the pictures [default: the model folder; for a camera path MODEL/path/ours_N, for a turntable
    /// MODEL/turntable/ours_N].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Outputs to write of each view, separated by commas [default: final, if the model has it, and base].
    #[arg(long, value_parser = outputs_parser(), value_delimiter = ',')]
    outputs: Vec<Output>,
    /// Write EXR files with the exact values (32-bit floats) instead of pictures.
    #[arg(long)]
    exr: bool,
    /// Also encode the frames of a camera path or turntable as a video, with ffmpeg.
    #[arg(long, requires = "frames", conflicts_with = "exr")]
    video: bool,
}

/// Parses the name of an output.
fn outputs_parser() -> impl TypedValueParser<Value = Output> {
    let value = |output: Output| PossibleValue::new(output.name()).help(output.about());
    PossibleValuesParser::new(Output::ALL.map(value)).map(|name| {
        let named = Output::ALL.into_iter().find(|output| output.name() == name);
        named.expect("one of the possible values")
    })
}

/// Parses the length of a turn.
fn turn_seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| "it must be a number of seconds".to_owned())?;
    let possible = seconds > 0.0 && seconds <= LONGEST_TURN;
    possible.then_some(seconds).ok_or_else(|| format!("it must lie above 0 and at most at {LONGEST_TURN} seconds"))
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let path = args.camera_path.as_deref().map(CameraPath::load).transpose()?;
    if let Some(output) = &args.output {
        spare_other_models(output, &args.model.files.model)?;
    }
    // EXR files have the exact values.
    let harmonics = if args.exr { Harmonics::Full } else { args.model.precision.of_colors() };
    let photos = match &args.outputs[..] {
        [] => Photos::Needed,
        outputs if outputs.iter().any(|output| output.needs_network()) => Photos::Needed,
        // The surface is found as with the network, where that is there.
        outputs if outputs.iter().any(|output| output.needs_surface()) => Photos::IfThere,
        _ => Photos::Unused,
    };
    let opened = ModelArgs { harmonics, photos, ..args.model.clone() }.open();
    let mut model = if photos == Photos::Needed { opened.map_err(with_way_out)? } else { opened? };
    let outputs = if args.outputs.is_empty() { Output::of(&model.renderer) } else { args.outputs.clone() };
    if let Some(output) = outputs.iter().find(|o| o.needs_network() && model.renderer.part().is_none()) {
        let name = output.name();
        bail!(
            "{} has no residual network, so no `{name}`; leave it out of `--outputs`",
            args.model.files.model.display()
        );
    }
    if let Some(output) = outputs.iter().find(|output| output.needs_mask()) {
        let name = output.name();
        if args.exr || path.is_some() || args.turntable.is_some() {
            bail!(
                "`{name}` is a picture of a training photo, and neither of a camera path nor EXR; leave it out of `--outputs`"
            );
        }
        if !model.has_learned_masks() {
            bail!(
                "{} has no learned masks, so no `{name}`; leave it out of `--outputs`",
                args.model.files.model.display()
            );
        }
    }
    if outputs.iter().any(|output| output.needs_surface()) {
        model = model.showing_surface();
    }
    match (path, args.turntable) {
        (Some(path), _) => render_path(&model, &path, args, &outputs),
        (None, Some(seconds)) => render_path(&model, &turntable(&model, seconds)?, args, &outputs),
        (None, None) => render_views(&model, args, &outputs),
    }
}

/// Where photos are missing, what can be rendered without them.
fn with_way_out(error: Error) -> Error {
    match error.downcast_ref() {
        Some(ModelError::SceneGone { .. } | ModelError::PhotosGone { .. } | ModelError::Scene(_)) => {
            error.context("the final image needs the photos of the training (`--outputs base` renders without them)")
        }
        _ => error,
    }
}

/// Refuses the folder of a model that is not the rendered one: its own pictures have the same names.
fn spare_other_models(output: &Path, model: &Path) -> Result<()> {
    if OutputFolder::at(output).config_path().exists() && !is_same(output, model) {
        bail!(
            "{} is the folder of another model, whose pictures would be replaced; choose another `--output`",
            output.display()
        );
    }
    Ok(())
}

/// A turn around what the model's photos show, on the sides that they show, in the size of its first view.
fn turntable(model: &OpenModel, seconds: f64) -> Result<CameraPath> {
    let cameras = || model.cameras.iter().map(|record| &record.camera);
    let turn = Axis::of(cameras()).and_then(|axis| Some((axis.start(cameras())?, axis)));
    let (Some((start, axis)), Some(first)) = (turn, cameras().next()) else {
        bail!(
            "the photos of {} look at no common point, so there is nothing to turn around; use `--camera-path`",
            model.folder.root().display()
        );
    };
    let keyframes = axis.turn(&start, cameras());
    let (width, height, fps) = (first.width, first.height, TURNTABLE_FPS);
    let path = KeyframePath { keyframes, width, height, fps, seconds, cycle: true, eased: false };
    Ok(CameraPath { cameras: path.frames(), fps })
}

fn render_path(model: &OpenModel, path: &CameraPath, args: &Args, outputs: &[Output]) -> Result<()> {
    let cameras = &path.cameras;
    let (what, name) = if args.turntable.is_some() { ("turntable", "turntable") } else { ("camera path", "path") };
    let default = || model.folder.root().join(name).join(format!("ours_{}", model.iteration));
    let folder = args.output.clone().unwrap_or_else(default);
    let names: Vec<&str> = outputs.iter().map(|output| output.name()).collect();
    stderr!("rendering {} of the {what}: {}", counted(cameras.len(), "frame"), names.join(", "));
    let bar = bar("rendering", cameras.len());
    for (index, camera) in cameras.iter().enumerate() {
        let frame = model.renderer.render(camera)?;
        match (args.exr, outputs) {
            (true, _) => write_exr(&frame, camera, outputs, &folder.join(format!("{index:05}.exr")))?,
            // With one output all frames are in one folder; with more, each output has its own.
            (false, [_]) => write_pictures(&frame, outputs, |_| folder.join(frame_name(index)))?,
            (false, _) => {
                write_pictures(&frame, outputs, |output| folder.join(output.folder()).join(frame_name(index)))?
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    stderr!("{} in {}", counted(cameras.len(), "frame"), folder.display());
    if args.video {
        let folders = match outputs {
            [_] => vec![folder],
            _ => outputs.iter().map(|output| folder.join(output.folder())).collect(),
        };
        for folder in folders {
            stderr!("video: {}", video::encode(&folder, cameras.len(), path.fps, None)?.display());
        }
    }
    Ok(())
}

fn render_views(model: &OpenModel, args: &Args, outputs: &[Output]) -> Result<()> {
    let any_test = model.cameras.iter().any(|r| r.split == Some(Split::Test));
    let wanted = |split: Option<Split>| match args.views {
        Views::All => true,
        Views::Test => split == Some(Split::Test) || !any_test,
        Views::Train => split != Some(Split::Test),
    };
    let records: Vec<_> = model.cameras.iter().filter(|record| wanted(record.split)).collect();
    let masks = outputs.iter().any(|output| output.needs_mask());
    if records.is_empty() {
        bail!("{} has no such view; choose another `--views`", model.folder.root().display());
    }
    if masks && records.iter().all(|record| record.split == Some(Split::Test)) {
        bail!("held-out photos have no learned masks; use `--views train` or `--views all`");
    }
    let set = match (args.views, any_test) {
        (Views::Test, true) => "held-out ",
        (Views::Train, true) => "training ",
        _ => "",
    };
    let names: Vec<&str> = outputs.iter().map(|output| output.name()).collect();
    stderr!("rendering {} {set}views of {}: {}", records.len(), model.cameras.len(), names.join(", "));
    let target = args.output.as_deref().map(OutputFolder::at);
    let target = target.as_ref().unwrap_or(&model.folder);
    let bar = bar("rendering", records.len());
    for record in &records {
        let frame = model.renderer.render(&record.camera)?;
        let split = record.split.unwrap_or(Split::Train);
        let place = Place { folder: target, split, iteration: model.iteration, name: &record.name };
        match args.exr {
            true => write_exr(&frame, &record.camera, outputs, &place.exr_path())?,
            false => place.write_outputs(&frame, outputs)?,
        }
        if masks && split == Split::Train {
            let size = [record.camera.width, record.camera.height];
            place.write_mask(model.learned_mask(record)?.as_ref(), size)?;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let mut folders: Vec<_> = records.iter().map(|record| record.split.unwrap_or(Split::Train).folder()).collect();
    folders.sort_unstable();
    folders.dedup();
    let at = |split: &str| target.root().join(split).join(format!("ours_{}", model.iteration));
    let folders: Vec<String> = folders.into_iter().map(|split| at(split).display().to_string()).collect();
    let within = |output: &Output| format!("{} in {}", output.name(), output.folder());
    let kinds = match args.exr {
        true => "exr".to_owned(),
        false => outputs.iter().map(within).collect::<Vec<_>>().join(", "),
    };
    stderr!("{} in {}: {kinds}", counted(records.len(), "view"), folders.join(" and "));
    Ok(())
}
