//! Learned masks of what moves, against the demo's true ones.

use crate::small::{model, plain, run, trainer};
use ibgs_core::config::{Method, TrainConfig, TransientSwitch};
use ibgs_core::dataset::{CellMask, Dataset, Photo};
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::output::{Existing, OutputFolder};
use ibgs_core::progress::Progress;
use ibgs_demo::{DemoOptions, Walked, WalkerMask, WalkerOptions, WalkerPixel};
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_train::checkpoint::Checkpoint;
use ibgs_train::session::{Event, Observer, Output};
use ibgs_train::{Oddity, Session, Trainer};
use serde_json::Value;
use std::error::Error;
use std::sync::Arc;

const SIZE: [u32; 2] = [80, 60];
const ITERATIONS: u32 = 400;

/// The demo with walkers in so many percent of 28 training photos.
fn walked(percent: u32) -> Walked {
    let cache = tempfile::tempdir().unwrap();
    let [width, height] = SIZE;
    let scene = DemoOptions { width, height, views: 32, samples: 1, points: 1_500, seed: 0 };
    ibgs_demo::walkers(&WalkerOptions { scene, percent }, Some(cache.path()), &()).unwrap()
}

fn config(mask: TransientSwitch) -> TrainConfig {
    let mut config = TrainConfig { method: Method::Gs3, ..plain(ITERATIONS) };
    config.transients.mask = mask;
    config.transients.from = Some(56);
    config
}

/// Precision of the masks, the parts of walkers and of shadows that they hide, and the part of all photos.
fn quality(masks: &[Arc<CellMask>], walked: &Walked) -> [f64; 4] {
    let (mut hidden, mut all) = ([0.0; 3], [0.0; 3]);
    for (mask, &view) in masks.iter().zip(&walked.dataset.train) {
        for p in 0..SIZE[0] * SIZE[1] {
            let pixel = |truth: &WalkerMask| truth.pixels[p as usize];
            let kind = match walked.masks[view].as_ref().map_or(WalkerPixel::Same, pixel) {
                WalkerPixel::Same => 0,
                WalkerPixel::Shadow => 1,
                WalkerPixel::Figure => 2,
            };
            all[kind] += 1.0;
            hidden[kind] += f64::from(u8::from(mask.hides(p % SIZE[0], p / SIZE[0])));
        }
    }
    let sum: f64 = hidden.iter().sum();
    [(hidden[1] + hidden[2]) / sum, hidden[2] / all[2], hidden[1] / all[1], sum / all.iter().sum::<f64>()]
}

fn trained(dataset: &Dataset, mask: TransientSwitch) -> Trainer {
    let mut training = trainer(dataset, &config(mask));
    run(&mut training, ITERATIONS);
    training
}

/// The last words of a training.
#[derive(Default)]
struct Words(String);

impl Observer for Words {
    fn event(&mut self, event: &Event) {
        if let Event::Finished(summary) = event {
            self.0 = summary.to_string();
        }
    }
}

fn scene(_width: u32, _: &TrainConfig, _: &dyn Progress) -> Result<Dataset, Box<dyn Error + Send + Sync>> {
    Ok(walked(25).dataset)
}

/// Masks hide the walkers, are in the model folder, and whatever opens that reads its photos without what they hide.
#[test]
fn masks_hide_walkers_and_are_a_part_of_the_model() {
    let (walked, folder) = (walked(25), tempfile::tempdir().unwrap());
    let output = Output::at(folder.path()).existing(Existing::Replace);
    let mut loaded = Session::builder(config(TransientSwitch::Auto)).output(output).load(&mut ()).unwrap();
    loaded.set_dataset(walked.dataset.clone());
    let mut words = Words::default();
    loaded.build(&gpu(), &mut ()).unwrap().run(&mut words).unwrap();
    assert!(words.0.contains("what moves: hidden in "), "{}", words.0);

    let names = walked.dataset.train.iter().map(|&view| &walked.dataset.views[view].name);
    let saved = OutputFolder::open(folder.path()).unwrap();
    let read = |name: &String| saved.read_transients(ITERATIONS, name, SIZE).unwrap();
    let nothing = || CellMask::new(SIZE, vec![false; 300]).unwrap();
    let masks: Vec<_> = names.map(|name| Arc::new(read(name).unwrap_or_else(nothing))).collect();
    let [precision, figures, shadows, share] = quality(&masks, &walked);
    println!("precision {precision:.3}, figures {figures:.3}, shadows {shadows:.3}, {:.2} % hidden", 100.0 * share);
    assert!(precision > 0.6 && figures > 0.6, "precision {precision:.3}, recall of figures {figures:.3}");

    let options = ModelOptions { make_scene: Some(scene), ..ModelOptions::default() };
    let mut model = Model::open(folder.path(), &options).unwrap();
    model.dataset(&()).unwrap();
    for (mask, photo) in masks.iter().zip(model.training_photos().unwrap()) {
        let pixels = photo.pixels().unwrap();
        let alphas = pixels.rgba.iter().skip(3).step_by(4);
        for (p, &alpha) in (0..).zip(alphas) {
            assert_eq!(alpha < 128, mask.hides(p % SIZE[0], p / SIZE[0]), "pixel {p}");
        }
    }
}

#[test]
fn where_nothing_moves_hardly_anything_is_hidden() {
    let clean = walked(0);
    let [.., on] = quality(&trained(&clean.dataset, TransientSwitch::On).masks().unwrap(), &clean);
    let [.., auto] = quality(&trained(&clean.dataset, TransientSwitch::Auto).masks().unwrap(), &clean);
    println!("{:.3} % hidden, {:.3} % by auto", 100.0 * on, 100.0 * auto);
    assert!(on < 0.01 && auto == 0.0, "{on}, {auto}");
}

/// A photo with every pixel the mean of those up to `radius` away.
fn blurred(photo: &Photo, radius: i32) -> Photo {
    let (width, height) = (photo.width as i32, photo.height as i32);
    let mut out = photo.clone();
    for (p, pixel) in (0..).zip(out.rgba.as_chunks_mut::<4>().0) {
        let around = |at: i32, end: i32| (at - radius).max(0)..(at + radius + 1).min(end);
        let (xs, ys) = (around(p % width, width), around(p / width, height));
        let count = (xs.len() * ys.len()) as u32;
        for (c, level) in pixel[..3].iter_mut().enumerate() {
            let at = |x: i32, y: i32| u32::from(photo.rgba[4 * (y * width + x) as usize + c]);
            let sum: u32 = ys.clone().flat_map(|y| xs.clone().map(move |x| (x, y))).map(|(x, y)| at(x, y)).sum();
            *level = (sum / count) as u8;
        }
    }
    out
}

#[test]
fn photos_that_disagree_as_a_whole_are_named() {
    let mut dataset = walked(0).dataset;
    let mut change = |index: usize, change: &dyn Fn(&Photo) -> Photo| {
        let photo = &mut dataset.views[dataset.train[index]].photo;
        *photo = change(&photo.pixels().unwrap()).into();
    };
    change(3, &|photo| blurred(photo, 2));
    change(9, &|photo| {
        let darker = |(i, level): (usize, &u8)| if i % 4 == 3 { *level } else { (f32::from(*level) * 0.7) as u8 };
        Photo { rgba: photo.rgba.iter().enumerate().map(darker).collect(), ..*photo }
    });
    let training = trained(&dataset, TransientSwitch::On);
    let odd: Vec<(usize, Oddity)> = training
        .oddities()
        .unwrap()
        .into_iter()
        .enumerate()
        .filter_map(|(index, oddity)| Some((index, oddity?)))
        .collect();
    assert_eq!(odd, [(3, Oddity::Blurred), (9, Oddity::Brightness)]);
    assert!(training.masks().unwrap()[9].is_empty(), "a photo's own brightness is not hidden");
}

#[test]
fn a_resumed_training_has_the_masks_of_the_uninterrupted_one() {
    let walked = walked(25);
    let config = TrainConfig { deterministic: true, ..config(TransientSwitch::On) };
    let until = 56 * 5 + 20;
    let mut whole = trainer(&walked.dataset, &config);
    run(&mut whole, until);
    assert!(whole.masks().unwrap().iter().any(|mask| !mask.is_empty()));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("1.ibgs");
    let mut training = trainer(&walked.dataset, &config);
    for at in [40, 56 * 3, 56 * 4 + 11] {
        run(&mut training, at);
        training.checkpoint(Value::Null).unwrap().write(&path).unwrap();
        let checkpoint = Checkpoint::read(&path).unwrap();
        training = Trainer::resume(Arc::new(rasterizer()), &walked.dataset, &checkpoint).unwrap();
    }
    run(&mut training, until);
    assert_eq!(training.masks(), whole.masks());
    assert!(model(&training) == model(&whole), "another model");
}
