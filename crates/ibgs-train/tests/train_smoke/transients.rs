//! Learned masks of what moves: blocks of colour that one photo alone shows.

use super::dataset;
use crate::small::{model, plain, run, staged, trainer};
use ibgs_core::config::{TrainConfig, TransientSwitch};
use ibgs_core::dataset::{CellMask, Dataset, Photo};
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::output::cameras::Split;
use ibgs_core::output::pictures::Place;
use ibgs_core::output::{Existing, OutputFolder};
use ibgs_core::progress::Progress;
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_testing::{TINY as SIZE, blurred};
use ibgs_train::checkpoint::Checkpoint;
use ibgs_train::session::{Event, Observer, Output};
use ibgs_train::{MaskRules, Oddity, Session, Trainer};
use serde_json::Value;
use std::error::Error;
use std::ops::Range;
use std::sync::Arc;

const ITERATIONS: u32 = 96;
/// Columns and rows of pixels of a block: three cells each.
const BLOCK: [Range<u32>; 2] = [8..20, 8..20];
/// Training photos with a block, and its colour.
const PAINTED: [(usize, [u8; 3]); 2] = [(2, [255, 0, 255]), (5, [0, 255, 0])];

/// Makes another photo of a training photo.
fn change(dataset: &mut Dataset, index: usize, change: impl FnOnce(&Photo) -> Photo) {
    let photo = &mut dataset.views[dataset.train[index]].photo;
    *photo = change(&photo.pixels().unwrap()).into();
}

/// The tiny demo with blocks in two of eight training photos.
fn painted() -> Dataset {
    let mut dataset = dataset();
    for (index, color) in PAINTED {
        change(&mut dataset, index, |photo| {
            let mut photo = photo.clone();
            for (p, pixel) in (0..).zip(photo.rgba.as_chunks_mut::<4>().0) {
                if is_block(p) {
                    pixel[..3].copy_from_slice(&color);
                }
            }
            photo
        });
    }
    dataset
}

fn is_block(p: u32) -> bool {
    BLOCK[0].contains(&(p % SIZE[0])) && BLOCK[1].contains(&(p / SIZE[0]))
}

fn config(mask: TransientSwitch) -> TrainConfig {
    masking(plain(ITERATIONS), mask)
}

fn masking(mut config: TrainConfig, mask: TransientSwitch) -> TrainConfig {
    config.transients.mask = mask;
    config.transients.from = Some(16);
    config
}

fn trained(dataset: &Dataset, mask: TransientSwitch) -> Trainer {
    let mut training = trainer(dataset, &config(mask));
    run(&mut training, ITERATIONS);
    training
}

/// Rules for so short a training, which renders most of its few pixels badly.
fn short() -> MaskRules {
    MaskRules { usual: 0.8, alone: 1.0, between: 0.0, worth: 0.01, ..MaskRules::default() }
}

/// Parts of the blocks and of all else that masks hide.
fn hidden(masks: &[Arc<CellMask>]) -> [f64; 2] {
    let (mut hidden, mut all) = ([0.0; 2], [0.0; 2]);
    for (index, mask) in masks.iter().enumerate() {
        for p in 0..SIZE[0] * SIZE[1] {
            let other = usize::from(!(is_block(p) && PAINTED.iter().any(|(painted, _)| *painted == index)));
            all[other] += 1.0;
            hidden[other] += f64::from(u8::from(mask.hides(p % SIZE[0], p / SIZE[0])));
        }
    }
    [hidden[0] / all[0], hidden[1] / all[1]]
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
    Ok(painted())
}

/// Masks hide the blocks and little else, and are in the model folder; whatever opens that reads its photos without what they hide.
#[test]
fn masks_hide_blocks_and_are_a_part_of_the_model() {
    let (painted, folder) = (painted(), tempfile::tempdir().unwrap());
    let output = Output::at(folder.path()).existing(Existing::Replace);
    let mut loaded = Session::builder(config(TransientSwitch::Auto)).output(output).load(&mut ()).unwrap();
    loaded.set_dataset(painted.clone());
    let mut words = Words::default();
    let mut session = loaded.build(&gpu(), &mut ()).unwrap();
    session.set_mask_rules(short());
    session.run(&mut words).unwrap();
    assert!(words.0.contains("what moves: hidden in "), "{}", words.0);

    let names = painted.train.iter().map(|&view| &painted.views[view].name);
    let saved = OutputFolder::open(folder.path()).unwrap();
    let read = |name: &String| saved.read_transients(ITERATIONS, name, SIZE).unwrap();
    let nothing = || CellMask::new(SIZE, vec![false; 48]).unwrap();
    let masks: Vec<_> = names.map(|name| Arc::new(read(name).unwrap_or_else(nothing))).collect();
    let [blocks, others] = hidden(&masks);
    println!("hidden: {blocks:.3} of the blocks, {others:.4} of all else");
    assert!(blocks > 0.9 && others < 0.02, "hidden: {blocks:.3} of the blocks, {others:.4} of all else");

    let (index, _) = PAINTED[0];
    let name = &painted.views[painted.train[index]].name;
    let place = Place { folder: &saved, split: Split::Train, iteration: ITERATIONS, name };
    place.write_mask(Some(&masks[index]), SIZE).unwrap();
    let path = saved.picture_path(Split::Train, ITERATIONS, "masks", name);
    let written = image::open(path).unwrap().into_luma8();
    assert!(
        written.enumerate_pixels().all(|(x, y, level)| level.0[0] == if masks[index].hides(x, y) { 0 } else { 255 })
    );

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

/// What is hidden is neither learned nor warped: the colours there do not matter.
#[test]
fn hidden_pixels_are_not_read() {
    let [columns, rows] = CellMask::grid(SIZE);
    let cells = (0..columns * rows).map(|cell| is_block(cell / columns * 4 * SIZE[0] + cell % columns * 4)).collect();
    let mask = Arc::new(CellMask::new(SIZE, cells).unwrap());
    let models = [dataset(), painted()].map(|mut dataset| {
        let plain = dataset.clone();
        for (index, _) in PAINTED {
            let photo = &mut dataset.views[dataset.train[index]].photo;
            *photo = photo.clone().masked(mask.clone());
        }
        [plain, dataset].map(|dataset| {
            let mut training = trainer(&dataset, &staged(30));
            run(&mut training, 30);
            model(&training)
        })
    });
    assert!(models[0][0] != models[1][0], "blocks that are not hidden change the model");
    assert!(models[0][1] == models[1][1], "hidden blocks change the model");
}

#[test]
fn where_nothing_moves_hardly_anything_is_hidden() {
    let clean = dataset();
    let [on, auto] = [TransientSwitch::On, TransientSwitch::Auto].map(|mask| {
        let mut training = trainer(&clean, &config(mask));
        training.set_mask_rules(short());
        run(&mut training, ITERATIONS);
        let masks = training.masks().unwrap();
        let cells = || masks.iter().flat_map(|mask| mask.hidden());
        cells().filter(|hidden| **hidden).count() as f64 / cells().count() as f64
    });
    println!("hidden: {on:.4}, {auto:.4} by auto");
    assert!(on < 0.01 && auto == 0.0, "{on}, {auto}");
}

#[test]
fn photos_that_disagree_as_a_whole_are_named() {
    let mut dataset = dataset();
    change(&mut dataset, 1, |photo| blurred(photo, 2));
    change(&mut dataset, 6, |photo| {
        let lighter = |(i, level): (usize, &u8)| if i % 4 == 3 { *level } else { level.saturating_add(100) };
        Photo { rgba: photo.rgba.iter().enumerate().map(lighter).collect(), ..*photo }
    });
    let training = trained(&dataset, TransientSwitch::On);
    let oddities = training.oddities().unwrap().into_iter().enumerate();
    let odd: Vec<(usize, Oddity)> = oddities.filter_map(|(index, oddity)| Some((index, oddity?))).collect();
    assert_eq!(odd, [(1, Oddity::Blurred), (6, Oddity::Brightness)]);
    assert!(training.masks().unwrap()[6].is_empty(), "a photo's own brightness is not hidden");
}

/// With warped sources, stopped before, at and after masks are made.
#[test]
fn a_resumed_training_has_the_masks_of_the_uninterrupted_one() {
    let painted = painted();
    let config = TrainConfig { deterministic: true, ..masking(staged(60), TransientSwitch::On) };
    let rules = short();
    let mut whole = trainer(&painted, &config);
    whole.set_mask_rules(rules);
    run(&mut whole, 60);
    let masks = whole.masks().unwrap();
    assert!(masks.iter().any(|mask| !mask.is_empty()));
    let photos = whole.renderer().unwrap().part().unwrap().photos.clone();
    for (index, mask) in masks.iter().enumerate() {
        let there = photos.photo(index).unwrap();
        let texels = gpu().read(&there.texels, (SIZE[0] * SIZE[1]) as usize).unwrap();
        let shown = mask.applied(&painted.views[painted.train[index]].photo.pixels().unwrap());
        assert!(texels.iter().flat_map(|texel| texel.to_le_bytes()).eq(shown.rgba), "photo {index} on the device");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("1.ibgs");
    let mut training = trainer(&painted, &config);
    training.set_mask_rules(rules);
    for at in [25, 32, 41] {
        run(&mut training, at);
        training.checkpoint(Value::Null).unwrap().write(&path).unwrap();
        let checkpoint = Checkpoint::read(&path).unwrap();
        training = Trainer::resume(Arc::new(rasterizer()), &painted, &checkpoint).unwrap();
        training.set_mask_rules(rules);
    }
    run(&mut training, 60);
    assert_eq!(training.masks(), whole.masks());
    assert_eq!(training.oddities(), whole.oddities());
    assert!(model(&training) == model(&whole), "another model");
}
