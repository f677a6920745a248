//! `ibgs split`

mod slurm;

use super::train;
use super::train::block::is_trained;
use crate::progress::Bars;
use crate::{stderr, stdout};
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::blocks::{BlockPlan, CutOptions, Cutter, PlanFolder};
use ibgs_core::camera::Camera;
use ibgs_core::config::{Method, PoseSwitch, TrainConfig};
use ibgs_core::dataset::{PointsFrom, PosedScene, load_poses};
use ibgs_core::gpu::Bytes;
use ibgs_core::model::load_scene;
use ibgs_core::output::OutputFolder;
use ibgs_core::output::cameras::{CameraRecord, records};
use ibgs_core::sources::memory::MemoryBudget;
use ibgs_train::memory::Needs;
use ibgs_train::session::adjust_cameras;
use std::collections::HashMap;
use std::ffi::OsString;
use std::path::PathBuf;

/// Number of blocks where neither it nor a limit is given.
const USUAL_BLOCKS: u32 = 4;
/// Most blocks that a limit on the memory leads to.
const MOST_BLOCKS: u32 = 256;

const EXAMPLES: &str = "\
Examples:
  ibgs split city -o plan --gpu-memory 8GiB -- --eval    # as many blocks as that memory asks for
  ibgs suite plan --adapters 0,1                         # train the blocks on two GPUs, merge, evaluate
  sh plan/slurm.sh --partition=gpu                       # the same as Slurm jobs";

/// Options of `ibgs split`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Scene folder or a .zip of one; it must have points.
    scene: PathBuf,
    /// Folder for the plan and the blocks; a new or empty one.
    #[arg(short, long)]
    output: PathBuf,
    /// Number of blocks [default: 4; with `--gpu-memory` as few as that allows].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    blocks: Option<u32>,
    /// Device memory that the training of a block may take, such as `8GiB`.
    #[arg(long, value_name = "SIZE")]
    gpu_memory: Option<MemoryBudget>,
    /// Enlarge each block by this part of its size on every side, for the choice of its photos.
    #[arg(long, default_value_t = CutOptions::default().overlap, value_parser = part)]
    overlap: f64,
    /// A photo belongs to a block if at least this part of it shows the enlarged block.
    #[arg(long, default_value_t = CutOptions::default().least_share, value_parser = part)]
    least_share: f64,
    /// Options of `ibgs train` for all blocks, such as `-- --eval --resolution 2`.
    #[arg(last = true, value_name = "TRAIN OPTIONS")]
    options: Vec<OsString>,
}

/// Parses a number from 0 to 1.
fn part(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(part) if (0.0..=1.0).contains(&part) => Ok(part),
        _ => Err("give a number from 0 to 1".to_owned()),
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let folder = PlanFolder::at(&args.output);
    if args.output.exists() && args.output.read_dir().map_or(true, |mut entries| entries.next().is_some()) {
        bail!("{} exists already; give `--output` a new folder", args.output.display());
    }
    let options = train::Args::parse(&args.options).map_err(|error| {
        let text = error.render().to_string();
        let first = text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned();
        anyhow::anyhow!("the options after `--` are not those of `ibgs train`: {first}")
    })?;
    let mut config = options.shared_config()?;
    if config.ensemble.is_some_and(|bases| bases != 1) {
        bail!("blocks have one base: leave `--ensemble` out");
    }
    config.ensemble = Some(1);
    // One size of the network for all, whichever adapter trains a block.
    config.residual.factor.get_or_insert(1.0);
    config.source = Some(std::path::absolute(&args.scene)?);
    let mut scene = load_poses(&args.scene, &config.load_options())?;
    if scene.points.is_empty() {
        bail!("{} has no points, by which blocks are cut; use a model with points", args.scene.display());
    }
    let budget = match args.gpu_memory {
        Some(MemoryBudget::Bytes(bytes)) => Some(bytes),
        Some(_) => bail!("give `--gpu-memory` a size, such as `8GiB`"),
        None => None,
    };
    let cameras = if config.poses.change() { adjusted(&config, &mut scene)? } else { None };
    config.poses.refine = PoseSwitch::Off;
    let planner = Planner { args, scene: &scene, cutter: Cutter::new(&scene), config: &config };
    let plan = match (args.blocks, budget) {
        (None, Some(budget)) => planner.as_few_as_fit(budget)?,
        (blocks, budget) => planner.planned(blocks.unwrap_or(USUAL_BLOCKS), budget)?,
    };
    let plan = BlockPlan { memory_limit: budget, ..plan };
    if let Some(cameras) = &cameras {
        folder.write_cameras(cameras)?;
    }
    folder.write(&plan, &config)?;
    slurm::write(&folder, &plan)?;
    print(&folder, &plan)?;
    let path = args.output.display();
    let measures = if plan.holds_out() { ", merges and measures" } else { " and merges" };
    stdout!("\nNext: `ibgs suite {path}` trains{measures} the blocks; so does `sh {path}/slurm.sh` with Slurm.");
    Ok(())
}

/// The scene's cameras, those that the options name or adjusted to what all of its photos have in common, and its points moved
/// along, where they then fit clearly better; none where they stay.
fn adjusted(config: &TrainConfig, scene: &mut PosedScene) -> Result<Option<Vec<CameraRecord>>> {
    let source = config.source.as_ref().context("a plan has a scene")?;
    let mut dataset = load_scene(config, source, &Bars::default())?;
    let known = dataset.notes.len();
    adjust_cameras(&mut dataset, &mut config.clone(), &Bars::default())?;
    dataset.notes[known..].iter().for_each(|note| stderr!("note: {note}"));
    if dataset.loaded_checksum.is_none() {
        return Ok(None);
    }
    let cameras: HashMap<&str, Camera> = dataset.views.iter().map(|view| (&*view.name, view.camera)).collect();
    for (name, camera) in &mut scene.views {
        *camera = cameras.get(name.as_str()).copied().unwrap_or(*camera);
    }
    let listed = records(&dataset);
    if dataset.points_from == PointsFrom::Scene {
        scene.points = dataset.points;
    }
    scene.points.retain(|point| point.position.is_finite());
    Ok(Some(listed))
}

/// Makes plans of a scene.
struct Planner<'a> {
    args: &'a Args,
    scene: &'a PosedScene,
    cutter: Cutter<'a>,
    config: &'a TrainConfig,
}

impl Planner<'_> {
    /// The plan of the fewest blocks that fit into the memory with all their Gaussians.
    fn as_few_as_fit(&self, budget: u64) -> Result<BlockPlan> {
        let mut most = 0;
        for blocks in 1..=MOST_BLOCKS {
            let plan = match self.planned(blocks, None) {
                Ok(plan) => plan,
                Err(error) if blocks == 1 => return Err(error),
                Err(error) => return Err(error.context(too_large(blocks - 1, most, budget))),
            };
            most = plan.blocks.iter().map(|block| block.memory).max().unwrap_or(0);
            if most <= budget {
                return Ok(plan);
            }
        }
        bail!(too_large(MOST_BLOCKS, most, budget))
    }

    /// The plan with its estimates.
    fn planned(&self, blocks: u32, budget: Option<u64>) -> Result<BlockPlan> {
        let Self { args, scene, cutter, config } = self;
        let options = CutOptions { blocks: blocks as usize, overlap: args.overlap, least_share: args.least_share };
        let mut plan = cutter.cut(&options)?;
        let cameras: HashMap<&str, Camera> =
            scene.views.iter().map(|(name, camera)| (name.as_str(), *camera)).collect();
        for (number, block) in plan.blocks.iter_mut().enumerate() {
            let training: Vec<Camera> = block.train.iter().map(|name| cameras[name.as_str()]).collect();
            let pixels: u64 = training.iter().map(|camera| camera.pixels() as u64).sum();
            let mut config = (*config).clone();
            config.adapt_to_photos(training.len(), pixels);
            let mean_pixels = pixels as f64 / training.len() as f64;
            let needs = Needs::planned(&config, training, block.start_points, !block.test.is_empty());
            let most = match budget {
                None => needs.at_most(),
                Some(budget) => needs.within(budget).with_context(|| {
                    let (least, limit) = (Bytes(needs.at_start().bytes), Bytes(budget));
                    format!(
                        "block {number} of {blocks} does not fit into {limit}, it needs at least {least}; cut the scene into more blocks"
                    )
                })?,
            };
            (block.gaussians, block.memory) = (most.gaussians, most.bytes);
            block.iterations = config.iterations();
            block.minutes = f64::from(block.iterations) * milliseconds(config.method, mean_pixels) / 60_000.0;
        }
        Ok(plan)
    }
}

fn too_large(blocks: u32, most: u64, budget: u64) -> String {
    format!(
        "not within {} with up to {blocks} blocks: the largest one then needs {}; give `--blocks` to train with fewer Gaussians",
        Bytes(budget),
        Bytes(most)
    )
}

/// Milliseconds of an iteration on an NVIDIA H100, the mean over a whole run: a line through the times of five scenes of
/// 0.3 to 0.8 megapixels with up to 400,000 Gaussians (docs/benchmarks.md).
fn milliseconds(method: Method, pixels: f64) -> f64 {
    match method {
        Method::Ibgs => 2.2 + 7.5e-6 * pixels,
        Method::Gs3 => 1.0 + 2.2e-6 * pixels,
    }
}

/// Prints the blocks of a plan and how far each of them is.
pub fn print(folder: &PlanFolder, plan: &BlockPlan) -> Result<()> {
    let headings = ["block", "points", "photos, test", "Gaussians", "iterations", "memory", "H100", "state"];
    let mut rows = vec![headings.map(str::to_owned)];
    for (number, block) in (0..).zip(&plan.blocks) {
        rows.push([
            number.to_string(),
            block.points.to_string(),
            format!("{}, {}", block.train.len(), block.test.len()),
            block.gaussians.to_string(),
            block.iterations.to_string(),
            Bytes(block.memory).to_string(),
            format!("{:.1} min", block.minutes),
            state(&OutputFolder::at(&folder.block_path(number)))?,
        ]);
    }
    for row in &rows {
        let width = |column: usize| rows.iter().map(|row| row[column].len()).max().unwrap_or(0);
        let cells: Vec<String> =
            row.iter().enumerate().map(|(column, cell)| format!("{cell:>width$}", width = width(column))).collect();
        stdout!("{}", cells.join(" | "));
    }
    stdout!("Gaussians: at most. Memory: the device's at that number, estimated. H100: time on such a GPU, roughly.");
    Ok(())
}

/// How far the training of a block is.
fn state(folder: &OutputFolder) -> Result<String> {
    Ok(match folder.checkpoints()?.first() {
        Some((iteration, _)) => format!("at {iteration}"),
        None if is_trained(folder)? => "trained".to_owned(),
        None => "to train".to_owned(),
    })
}
