//! `ibgs bench`

mod compare;
mod lists;
mod tables;

use super::open_gpu;
use anyhow::{Context, Result, bail};
use clap::Args as ClapArgs;
use ibgs_core::camera::Camera;
use ibgs_core::config::TrainConfig;
use ibgs_core::gpu::Use;
use ibgs_core::model::{self, Model, ModelOptions};
use ibgs_core::scene::{Gaussians, MAX_SH_DEGREE};
use ibgs_train::bench::{self, DeviceReport, LEAST_RUNS, Rates, Report, Setting};
use std::path::{Path, PathBuf};

/// Default number of Gaussians of the synthetic scene, and its image size.
const USUAL: (usize, [u32; 2]) = (100_000, [960, 540]);
/// The same of the configurations of `--submit`, which are measured alike everywhere.
const SUBMITTED: [(usize, [u32; 2]); 2] = [USUAL, (1_000_000, [1920, 1080])];
/// The one of software adapters.
const SUBMITTED_SOFTWARE: [(usize, [u32; 2]); 1] = [(10_000, [160, 120])];

const EXAMPLES: &str = "\
Options that take several values, separated by commas, make a table with one row per configuration: the first values \
together, then each other value of one option with the first values of the others.

Examples:
  ibgs bench output/my-scene
  ibgs bench --gaussians 100k,1M --size 540p,1080p --json bench.json
  ibgs bench --submit my-card.json";

/// Options of `ibgs bench`.
#[derive(ClapArgs)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Model folders or `.ibgs` bundles [default: a synthetic scene].
    models: Vec<PathBuf>,
    /// Numbers of Gaussians of the synthetic scene, such as `100k,1M` [default: 100k].
    #[arg(long, conflicts_with = "models")]
    gaussians: Option<String>,
    /// Image sizes: WIDTHxHEIGHT, `540p`, `720p`, `1080p`, `1440p` or `4k` [default: the model's own; synthetic scene
    /// 540p].
    #[arg(long)]
    size: Option<String>,
    /// Numbers of sources per view [default: the model's own; synthetic scene 4].
    #[arg(long, value_delimiter = ',')]
    sources: Option<Vec<u32>>,
    /// Numbers of median intersections per pixel [default: the model's own; synthetic scene 4].
    #[arg(long, value_delimiter = ',')]
    intersections: Option<Vec<u32>>,
    /// Degree of the spherical harmonics of the synthetic scene, 0 to 3.
    #[arg(long, default_value_t = 2)]
    sh_degree: u32,
    /// Precision of the residual network, in frames and in training: `full` (float32) or `auto` (half precision on matrix
    /// units that pass a test, else activations of frames alone).
    #[arg(long, default_value = "auto", value_parser = super::word::<ibgs_core::residual::Precision>())]
    precision: ibgs_core::residual::Precision,
    /// Runs for each median, at least 5, after as many for warm-up.
    #[arg(long, default_value_t = 20)]
    iterations: u32,
    /// Also write all figures to a JSON file.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Also print the times of an earlier run, from its file of `--json`, beside those of this one.
    #[arg(long, value_name = "FILE")]
    compare: Option<PathBuf>,
    /// Measure what docs/benchmarks.md compares adapters by, write it to this file, and print the row of its table.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["models", "gaussians", "size", "sources", "intersections",
        "sh_degree", "precision", "json"])]
    submit: Option<PathBuf>,
    /// Adapter by number or part of its name; `ibgs info` lists them [default: the most capable].
    #[arg(long)]
    adapter: Option<String>,
}

/// A model with a camera and its options.
struct Scene {
    name: String,
    gaussians: Gaussians,
    /// The other bases of its ensemble.
    members: Vec<Gaussians>,
    camera: Camera,
    config: TrainConfig,
}

/// What a row of the table changes.
#[derive(Clone, Copy, Default)]
struct Change {
    gaussians: Option<usize>,
    size: Option<[u32; 2]>,
    sources: Option<u32>,
    intersections: Option<u32>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    check(args)?;
    let mut changes = args.changes()?;
    // Models are read before the device is opened: errors that need no device come first.
    let models = args.models.iter().map(|path| load(path)).collect::<Result<Vec<_>>>()?;
    for change in &changes {
        change.apply(&mut TrainConfig::default()).validate()?;
    }
    let before = args.compare.as_ref().map(|path| Ok::<_, anyhow::Error>((path, compare::read(path)?))).transpose()?;
    let gpu = open_gpu(args.adapter.as_ref(), Use::Training)?;
    if args.submit.is_some() {
        let all: &[_] = if gpu.is_software() { &SUBMITTED_SOFTWARE } else { &SUBMITTED };
        let change = |&(count, size)| Change { gaussians: Some(count), size: Some(size), ..Change::default() };
        changes = all.iter().map(change).collect();
    }
    let rates = Rates::measure(&gpu)?;
    tables::print_rates(&rates);
    let version = env!("CARGO_PKG_VERSION").to_owned();
    let device = DeviceReport::new(&gpu);
    let mut report = Report { version, device, rates, runs: args.iterations, configurations: Vec::new() };
    let scenes: Vec<Option<Scene>> = match models.is_empty() {
        true => vec![None],
        false => models.into_iter().map(Some).collect(),
    };
    for mut scene in scenes {
        let first = report.configurations.len();
        for change in &changes {
            let mut made = None;
            let scene = match &mut scene {
                Some(model) => model,
                None => made.insert(synthetic(change, args.sh_degree)),
            };
            let mut config = scene.config.clone();
            config.residual.precision = args.precision;
            let size = change.size.unwrap_or([scene.camera.width, scene.camera.height]);
            let setting = Setting {
                gaussians: &scene.gaussians,
                members: &scene.members,
                camera: scene.camera.resized(size[0], size[1]),
                config: change.apply(&mut config),
            };
            let measured = bench::measure(&gpu, &rates, &scene.name, &setting, args.iterations)?;
            if report.configurations.len() == first {
                tables::print_stages(&measured);
            }
            report.configurations.push(measured);
        }
        tables::print_growth(&report.configurations[first..]);
    }
    if let Some(path) = args.json.as_ref().or(args.submit.as_ref()) {
        ibgs_core::files::write_atomically(path, |out| serde_json::to_writer_pretty(out, &report).map_err(Into::into))?;
    }
    if let Some(path) = &args.submit {
        tables::print_rows(&report, path);
    }
    if let Some((path, before)) = before {
        compare::check(&before, &report, path)?;
        compare::print(&before, &report);
    }
    Ok(())
}

fn check(args: &Args) -> Result<()> {
    if args.iterations < LEAST_RUNS {
        bail!("option `--iterations` is {}; it must be at least {LEAST_RUNS}", args.iterations);
    }
    if args.sh_degree > MAX_SH_DEGREE {
        bail!("option `--sh-degree` is {}; it must be 0, 1, 2 or 3", args.sh_degree);
    }
    Ok(())
}

impl Args {
    /// The first value of each list, then each other value of one list at a time.
    fn changes(&self) -> Result<Vec<Change>> {
        let counts = self.gaussians.as_deref().map(lists::counts).transpose()?.unwrap_or_default();
        let sizes = self.size.as_deref().map(lists::sizes).transpose()?.unwrap_or_default();
        let sources = self.sources.as_deref().unwrap_or_default();
        let intersections = self.intersections.as_deref().unwrap_or_default();
        let usual = Change {
            gaussians: counts.first().copied(),
            size: sizes.first().copied(),
            sources: sources.first().copied(),
            intersections: intersections.first().copied(),
        };
        let mut all = vec![usual];
        all.extend(counts.iter().skip(1).map(|&n| Change { gaussians: Some(n), ..usual }));
        all.extend(sizes.iter().skip(1).map(|&size| Change { size: Some(size), ..usual }));
        all.extend(sources.iter().skip(1).map(|&m| Change { sources: Some(m), ..usual }));
        all.extend(intersections.iter().skip(1).map(|&k| Change { intersections: Some(k), ..usual }));
        Ok(all)
    }
}

impl Change {
    fn apply<'a>(&self, config: &'a mut TrainConfig) -> &'a TrainConfig {
        if let Some(sources) = self.sources {
            config.sources.used = sources;
        }
        if let Some(intersections) = self.intersections {
            config.surface.intersections = intersections;
        }
        config
    }
}

fn synthetic(change: &Change, sh_degree: u32) -> Scene {
    let (count, [width, height]) = (change.gaussians.unwrap_or(USUAL.0), change.size.unwrap_or(USUAL.1));
    let (gaussians, camera) = bench::synthetic(count, sh_degree, width, height);
    Scene { name: "synthetic".to_owned(), gaussians, members: Vec::new(), camera, config: TrainConfig::default() }
}

fn load(path: &Path) -> Result<Scene> {
    let name = path.display().to_string();
    let Model { config, gaussians, levels, members, cameras, .. } = Model::open(path, &ModelOptions::default())?;
    let gaussians = levels.map_or(Ok(gaussians), |levels| levels.whole())?;
    let camera = cameras.first().context("the model has no cameras")?.camera;
    let space = model::space(&cameras, &gaussians, config.data.extent);
    let members = members.into_iter().map(|member| member.gaussians.into_space(space)).collect();
    Ok(Scene { name, gaussians: gaussians.into_space(space), members, camera, config })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn lists_are_varied_one_at_a_time() {
        let line = "bench --gaussians 1k,2k --size 8x6,9x7 --sources 4,2,1 --intersections 4,2";
        let changes = Line::parse_from(line.split(' ')).args.changes().unwrap();
        let rows: Vec<_> = changes.iter().map(|c| (c.gaussians, c.size, c.sources, c.intersections)).collect();
        let row = |n, size, m, k| (Some(n), Some(size), Some(m), Some(k));
        let expected = [
            row(1000, [8, 6], 4, 4),
            row(2000, [8, 6], 4, 4),
            row(1000, [9, 7], 4, 4),
            row(1000, [8, 6], 2, 4),
            row(1000, [8, 6], 1, 4),
            row(1000, [8, 6], 4, 2),
        ];
        assert_eq!(rows, expected);
        assert_eq!(Line::parse_from(["bench", "model"]).args.changes().unwrap().len(), 1);
    }
}
