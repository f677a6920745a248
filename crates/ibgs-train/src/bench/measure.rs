//! Runs frames and iterations and times them.

use super::floor::Load;
use super::median;
use super::rates::Rates;
use super::report::{Configuration, StageTiming, Timing};
use super::scene::{Setting, options, views};
use super::stage::{Stage, Work, stage_of};
use crate::memory::{Demand, Estimate};
use crate::{TrainError, Trainer};
use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::gpu::{Gpu, MemoryReport};
use ibgs_core::raster::{RasterView, Rasterizer};
use ibgs_core::render::Renderer;
use ibgs_core::residual::Factor;
use ibgs_core::scene::{Gaussians, Harmonics, MAX_SH_DEGREE, Splats};
use ibgs_shaders::TILE;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Iterations until the degree of the spherical harmonics is the model's.
const SETTLING: u32 = MAX_SH_DEGREE + 1;

/// Least time for which a work runs before it is timed.
const WARM_UP: Duration = Duration::from_millis(250);

/// Something to run again and again.
type Run<'a> = &'a mut dyn FnMut() -> Result<(), TrainError>;

/// Times runs on one device.
struct Clock<'a> {
    gpu: &'a Gpu,
    rates: &'a Rates,
    load: Load,
    runs: u32,
}

impl Clock<'_> {
    /// Milliseconds of `count` runs together, the GPU's work included.
    fn elapsed(&self, count: u32, run: Run) -> Result<f64, TrainError> {
        Ok(self.host_and_all(count, run)?[1])
    }

    /// Milliseconds in which the host hands over `count` runs, without those in which it waits for the GPU, and until the GPU
    /// has done them.
    fn host_and_all(&self, count: u32, run: Run) -> Result<[f64; 2], TrainError> {
        self.gpu.wait()?;
        let (start, waited) = (Instant::now(), self.gpu.waited());
        for _ in 0..count {
            run()?;
        }
        let host = start.elapsed().saturating_sub(self.gpu.waited() - waited);
        self.gpu.wait()?;
        Ok([host, start.elapsed()].map(|time| 1e3 * time.as_secs_f64()))
    }

    fn timing(&self, work: Work, run: Run) -> Result<Timing, TrainError> {
        // An idle device takes a while to reach its clock rate.
        let start = Instant::now();
        while {
            self.elapsed(2, run)?;
            start.elapsed() < WARM_UP
        } {}
        // Also the warm-up of the single runs.
        let [host_ms, in_a_row_ms] = self.host_and_all(self.runs, run)?.map(|ms| ms / f64::from(self.runs));
        let single = (0..self.runs).map(|_| self.elapsed(1, run)).collect::<Result<Vec<_>, _>>()?;
        let stages = self.stages(work, run)?;
        let fastest_ms = single.iter().copied().fold(f64::INFINITY, f64::min);
        let floor_ms = stages.iter().filter_map(|stage| stage.floor_ms).sum();
        Ok(Timing { work, ms: median(single), fastest_ms, in_a_row_ms, host_ms, floor_ms, stages })
    }

    /// Every stage of the work, and the kernels outside of them that ran in most runs.
    fn stages(&self, work: Work, run: Run) -> Result<Vec<StageTiming>, TrainError> {
        // Kernels of no stage by their own names.
        let known = |stage: Stage| (stage, stage.name(), Vec::new());
        let mut stages: Vec<(Stage, &'static str, Vec<f64>)> = work.stages().into_iter().map(known).collect();
        let timestamps = self.gpu.start_profile();
        for number in 0..if timestamps { self.runs as usize } else { 0 } {
            self.elapsed(1, run)?;
            for measured in self.gpu.take_profile() {
                let stage = stage_of(measured.pass, measured.kernel);
                let name = if stage == Stage::Other { measured.kernel.name } else { stage.name() };
                let at = stages.iter().position(|(_, known, _)| *known == name).unwrap_or_else(|| {
                    stages.push((stage, name, Vec::new()));
                    stages.len() - 1
                });
                let by_run = &mut stages[at].2;
                by_run.resize(number + 1, 0.0);
                by_run[number] += measured.ms;
            }
        }
        self.gpu.finish_profile();
        let timing = |(stage, name, mut by_run): (Stage, &str, Vec<f64>)| {
            by_run.resize(self.runs as usize, 0.0);
            let floor = self.load.floor(work, stage);
            StageTiming {
                stage: name.to_owned(),
                ms: timestamps.then(|| median(by_run)),
                floor_ms: floor.map(|floor| floor.ms(self.rates)),
                floor,
            }
        };
        Ok(stages.into_iter().map(timing).filter(|s| s.floor.is_some() || s.ms > Some(0.0)).collect())
    }
}

/// What a view's stages have to do, read back from a pass over it.
fn load(gpu: &Gpu, raster: &Rasterizer, splats: &Splats, setting: &Setting) -> Result<Load, TrainError> {
    let Setting { gaussians, camera, config, .. } = setting;
    let forward = raster.surface(splats, &RasterView::new(splats.space.camera(camera), gaussians.sh_degree))?;
    let pixels = camera.width as usize * camera.height as usize;
    let last = gpu.read(&forward.workspace.last_entry, pixels)?;
    let counts = gpu.read(&forward.workspace.tile_counts, gaussians.len())?;
    Ok(Load {
        gaussians: gaussians.len() as u64,
        gaussians_in_view: counts.iter().filter(|&&count| count > 0).count() as u64,
        coefficients: gaussians.sh_coefficients() as u64,
        moments: config.adam.moments,
        intersections: forward.intersections(gpu)?,
        tiles: u64::from(camera.width.div_ceil(TILE)) * u64::from(camera.height.div_ceil(TILE)),
        pixels: pixels as u64,
        pairs: last.iter().map(|&count| u64::from(count)).sum(),
        sources: u64::from(config.sources.used),
        visible: u64::from(config.sources.visible),
        most_visible: 0,
        medians: u64::from(config.surface.intersections),
        network_size: Factor::of(config.residual.factor()).size([camera.width, camera.height]),
    })
}

/// Most visible sources of any pixel.
fn most_visible(renderer: &Renderer, setting: &Setting) -> Result<u64, TrainError> {
    let counts = renderer.render(&setting.camera)?.visibility()?.unwrap_or_default();
    Ok(counts.into_iter().max().unwrap_or(0).into())
}

/// What training and frames of the image-based method gave.
struct ImageBased {
    clock_load: Load,
    timings: Vec<Timing>,
    memory: Option<MemoryReport>,
    estimated_bytes: u64,
}

fn image_based(
    raster: &Arc<Rasterizer>,
    setting: &Setting,
    config: &TrainConfig,
    rates: &Rates,
    runs: u32,
) -> Result<ImageBased, TrainError> {
    let gpu = &**raster.gpu();
    let splats = Splats::upload(setting.gaussians, gpu)?;
    let dataset = views(raster, &splats, &setting.camera, config.sources.used)?;
    let mut load = load(gpu, raster, &splats, setting)?;
    drop(splats);
    let mut trainer = Trainer::from_gaussians(raster.clone(), &dataset, config, setting.gaussians)?;
    // The first iterations make depth maps and lift the degree of the spherical harmonics.
    for _ in 0..SETTLING {
        trainer.step()?;
    }
    load.most_visible = most_visible(&trainer.renderer()?, setting)?;
    let clock = Clock { gpu, rates, load, runs };
    let iteration = clock.timing(Work::FinalIteration, &mut || trainer.step())?;
    let memory = gpu.memory_report();
    let cameras: Vec<_> = dataset.views.iter().map(|view| view.camera).collect();
    let demand = Demand {
        config,
        sh_degree: setting.gaussians.sh_degree,
        cameras: &cameras,
        gaussians: setting.gaussians.len() as u64,
        room: raster.capacity(),
        photo_budget: gpu.bytes_of(config.sources.memory),
        grows: false,
        evaluates: false,
    };
    let estimated_bytes = Estimate::new(&demand).total();
    let renderer = frames(raster, setting, &trainer)?;
    renderer.render(&setting.camera)?;
    let warm = clock.timing(Work::WarmFrame, &mut || Ok(renderer.render_unchecked(&setting.camera).map(drop)?))?;
    let cold = clock.timing(Work::ColdFrame, &mut || {
        renderer.forget_depths();
        Ok(renderer.render_unchecked(&setting.camera).map(drop)?)
    })?;
    Ok(ImageBased { clock_load: load, timings: vec![warm, cold, iteration], memory, estimated_bytes })
}

/// Renders with the Gaussians as `ibgs render` keeps them on the device, those of an ensemble with their networks.
fn frames(raster: &Arc<Rasterizer>, setting: &Setting, trainer: &Trainer) -> Result<Renderer, TrainError> {
    let upload = |gaussians: &Gaussians| {
        Splats::upload_in(&gaussians.in_space(trainer.splats().space), raster.gpu(), Harmonics::Half)
    };
    let whole = |gaussians: &Gaussians| Ok::<_, TrainError>(trainer.renderer()?.with_splats(upload(gaussians)?));
    let member = |(gaussians, number): (&Gaussians, u32)| {
        if number <= setting.config.residual.networks {
            return whole(gaussians);
        }
        Ok(Renderer::new(raster.clone(), upload(gaussians)?, trainer.background(), None))
    };
    let members = setting.members.iter().zip(2..).map(member).collect::<Result<_, _>>()?;
    Ok(whole(setting.gaussians)?.with_members(members, setting.config.weighted_as_the_first()))
}

/// The base's frame and iteration.
fn base(
    raster: &Arc<Rasterizer>,
    setting: &Setting,
    load: Load,
    rates: &Rates,
    runs: u32,
) -> Result<[Timing; 2], TrainError> {
    let gpu = &**raster.gpu();
    let splats = Splats::upload(setting.gaussians, gpu)?;
    let dataset = views(raster, &splats, &setting.camera, 1)?;
    drop(splats);
    let config = options(Method::Gs3, setting.config);
    let mut trainer = Trainer::from_gaussians(raster.clone(), &dataset, &config, setting.gaussians)?;
    let clock = Clock { gpu, rates, load, runs };
    for _ in 0..SETTLING {
        trainer.step()?;
    }
    let iteration = clock.timing(Work::BaseIteration, &mut || trainer.step())?;
    let renderer = frames(raster, setting, &trainer)?;
    renderer.render(&setting.camera)?;
    let frame = clock.timing(Work::BaseFrame, &mut || Ok(renderer.render_unchecked(&setting.camera).map(drop)?))?;
    Ok([frame, iteration])
}

/// Measures frames and training iterations of a setting: each a median of `runs` after as many for warm-up. The photos
/// are the model's own pictures, so the model hardly moves. `scene` is what the report calls it.
///
/// # Errors
/// Not enough memory, or the device is lost.
pub fn measure(
    gpu: &Arc<Gpu>,
    rates: &Rates,
    scene: &str,
    setting: &Setting,
    runs: u32,
) -> Result<Configuration, TrainError> {
    // What an earlier setting left would count as this one's memory.
    gpu.wait()?;
    gpu.release_unused();
    gpu.wait()?;
    let raster = Arc::new(Rasterizer::new(gpu.clone()));
    let config = options(Method::Ibgs, setting.config);
    let ImageBased { clock_load, mut timings, memory, estimated_bytes } =
        image_based(&raster, setting, &config, rates, runs)?;
    timings.extend(base(&raster, setting, clock_load, rates, runs)?);
    timings.sort_by_key(|timing| Work::ALL.iter().position(|work| *work == timing.work));
    let (width, height) = (setting.camera.width, setting.camera.height);
    Ok(Configuration { scene: scene.to_owned(), width, height, load: clock_load, timings, memory, estimated_bytes })
}
