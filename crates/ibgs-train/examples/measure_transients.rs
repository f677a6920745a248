//! Measures learned masks against the true ones of the demo scene's walkers, and what they do for held-out photos.
//!
//! `measure_transients [NAME=VALUE ...]`, where NAME is one of [`Run`]'s fields or of [`MaskRules`]:
//! `measure_transients scene=large walkers=15 mask=on iterations=7000 every=1000 sure=5`

#![allow(clippy::print_stdout)]

use ibgs_core::config::{ExposureSwitch, Method, TrainConfig, TransientSwitch};
use ibgs_core::dataset::{CellMask, Photo};
use ibgs_core::eval::scores::score_test_views;
use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
use ibgs_core::raster::Rasterizer;
use ibgs_demo::{DemoOptions, Walked, WalkerOptions, WalkerPixel};
use ibgs_testing::blurred;
use ibgs_train::{MaskRules, Trainer};
use std::error::Error;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Instant;

type Outcome<T> = Result<T, Box<dyn Error>>;

/// What is measured.
struct Run {
    /// `small` or `large`.
    scene: DemoOptions,
    /// Percent of the training photos with a walker.
    walkers: u32,
    /// Photos that are spoiled, from the fourth in steps of seven: words of `blur`, `dark`, `other` with commas.
    spoil: Vec<String>,
    /// Folder for scenes that are traced; unset: the program's.
    cache: Option<PathBuf>,
    /// Iterations between two lines.
    every: u32,
    rules: MaskRules,
    config: TrainConfig,
}

impl Default for Run {
    fn default() -> Self {
        let mut config = TrainConfig { method: Method::Gs3, iterations: Some(1_000), ..TrainConfig::default() };
        config.ensemble = Some(1);
        config.exposure.enabled = ExposureSwitch::Off;
        config.transients.mask = TransientSwitch::On;
        Self {
            scene: DemoOptions::small(),
            walkers: 15,
            spoil: Vec::new(),
            cache: None,
            every: 250,
            rules: MaskRules::default(),
            config,
        }
    }
}

fn parsed<T: FromStr>(word: &str) -> Outcome<T>
where
    T::Err: Error + 'static,
{
    Ok(word.parse()?)
}

/// A word of an option, as files have it.
fn worded<T: serde::de::DeserializeOwned>(word: &str) -> Outcome<T> {
    Ok(serde_json::from_value(word.into())?)
}

impl Run {
    /// Takes `NAME=VALUE`.
    fn set(&mut self, argument: &str) -> Outcome<()> {
        let (name, value) = argument.split_once('=').ok_or("every argument is NAME=VALUE")?;
        let (config, rules) = (&mut self.config, &mut self.rules);
        match name {
            "scene" if value == "small" => self.scene = DemoOptions::small(),
            "scene" if value == "large" => self.scene = DemoOptions::large(),
            "walkers" => self.walkers = parsed(value)?,
            "spoil" => self.spoil = value.split(',').map(str::to_owned).collect(),
            "cache" => self.cache = Some(value.into()),
            "every" => self.every = parsed::<u32>(value)?.max(1),
            "method" => config.method = worded(value)?,
            "mask" => config.transients.mask = worded(value)?,
            "exposure" => config.exposure.enabled = worded(value)?,
            "iterations" => config.iterations = Some(parsed(value)?),
            "from" => config.transients.from = Some(parsed(value)?),
            "seed" => config.seed = parsed(value)?,
            "gaussians" => config.densify.max_splats = Some(parsed(value)?),
            "factor" => config.residual.factor = Some(parsed(value)?),
            "rate" => rules.rate = parsed(value)?,
            "usual" => rules.usual = parsed(value)?,
            "sure" => rules.sure = parsed(value)?,
            "alone" => rules.alone = parsed(value)?,
            "between" => rules.between = parsed(value)?,
            "sure-again" => rules.sure_again = parsed(value)?,
            "likely" => rules.likely = parsed(value)?,
            "least" => rules.least = parsed(value)?,
            "fewest" => rules.fewest = parsed(value)?,
            "limit" => rules.limit = parsed(value)?,
            "worth" => rules.worth = parsed(value)?,
            "odd-weight" => rules.odd_weight = parsed(value)?,
            "blurred" => rules.blurred = parsed(value)?,
            "brightness" => rules.brightness = parsed(value)?,
            "times" => rules.times = parsed(value)?,
            _ => return Err("no such name or value".into()),
        }
        Ok(())
    }
}

fn main() -> Outcome<()> {
    let mut run = Run::default();
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    for argument in &arguments {
        run.set(argument).map_err(|error| format!("{argument}: {error}"))?;
    }
    println!("{}", arguments.join(" "));
    let scene = WalkerOptions { scene: run.scene.clone(), percent: run.walkers };
    let mut walked = ibgs_demo::walkers(&scene, run.cache.as_deref(), &())?;
    spoil(&mut walked, &run.spoil)?;
    run.config.validate()?;
    let gpu = Gpu::open(&AdapterChoice::Best, Use::Training)?;
    println!("{}", gpu.describe());
    let start = Instant::now();
    let mut training = Trainer::new(Arc::new(Rasterizer::new(gpu)), &walked.dataset, &run.config)?;
    training.set_mask_rules(run.rules);
    let last = run.config.iterations();
    while training.iteration() < last {
        let next = (training.iteration() / run.every + 1) * run.every;
        while training.iteration() < next.min(last) {
            training.step()?;
        }
        if let Some(masks) = training.masks() {
            println!("iteration {}: {}", training.iteration(), quality(&masks, &walked));
        }
    }
    let odd = training.oddities().unwrap_or_default();
    for (index, oddity) in odd.iter().enumerate() {
        oddity.iter().for_each(|oddity| println!("training photo {index}: {oddity}"));
    }
    println!("{} Gaussians in {:.1} s", training.splats().len(), start.elapsed().as_secs_f64());
    let renderer = training.renderer()?;
    let scores = score_test_views(&renderer, &walked.dataset, &run.config, None, None, &mut |_, _| {})?;
    println!("held-out photos: {}", scores.sentence());
    Ok(())
}

/// How well masks hide what is to be hidden.
fn quality(masks: &[Arc<CellMask>], walked: &Walked) -> String {
    let (mut hidden, mut all) = ([0u32; 3], [0u32; 3]);
    for (mask, &view) in masks.iter().zip(&walked.dataset.train) {
        let [width, height] = mask.size();
        for p in 0..width * height {
            let truth = walked.masks[view].as_ref().map_or(WalkerPixel::Same, |truth| truth.pixels[p as usize]);
            let kind = match truth {
                WalkerPixel::Same => 0,
                WalkerPixel::Shadow => 1,
                WalkerPixel::Figure => 2,
            };
            all[kind] += 1;
            hidden[kind] += u32::from(mask.hides(p % width, p / width));
        }
    }
    let part = |of: u32, whole: u32| f64::from(of) / f64::from(whole.max(1));
    let sum: u32 = hidden.iter().sum();
    format!(
        "hidden {:.2} % of all, precision {:.3} (walkers alone {:.3}), recall of walkers {:.3}, of shadows {:.3}, of the rest {:.5}",
        100.0 * part(sum, all.iter().sum()),
        part(hidden[1] + hidden[2], sum),
        part(hidden[2], sum),
        part(hidden[2], all[2]),
        part(hidden[1], all[1]),
        part(hidden[0], all[0]),
    )
}

fn spoil(walked: &mut Walked, words: &[String]) -> Outcome<()> {
    for (number, word) in words.iter().enumerate() {
        let index = 3 + 7 * number;
        let &view = walked.dataset.train.get(index).ok_or("more words than photos that can be spoiled")?;
        let view = &mut walked.dataset.views[view];
        let photo = view.photo.pixels()?;
        let spoiled = match word.as_str() {
            "blur" => blurred(&photo, photo.width as i32 / 80),
            "dark" => {
                let darker =
                    |(i, level): (usize, &u8)| if i % 4 == 3 { *level } else { (u32::from(*level) * 3 / 4) as u8 };
                Photo { rgba: photo.rgba.iter().enumerate().map(darker).collect(), ..*photo }
            }
            "other" => {
                let mut rgba = photo.rgba.clone();
                rgba.rotate_left(4 * (photo.width * (photo.height / 3)) as usize);
                Photo { rgba, ..*photo }
            }
            _ => return Err(format!("spoil: `{word}` is none of blur, dark, other").into()),
        };
        view.photo = spoiled.into();
        println!("training photo {index} is spoiled: {word}");
    }
    Ok(())
}
