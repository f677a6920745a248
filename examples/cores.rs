//! Measures the blocks of a trained plan (`ibgs split`) and the merged model inside the blocks' cores: on each block's held-out
//! photos, the pixels whose point of the merged model lies in the core.
//!
//! ```sh
//! cargo run --release --example cores -- plan plan/model pictures
//! ```
//!
//! Of the photos that two blocks share most evenly, photo and merged final image are written side by side.

#![expect(clippy::print_stdout, reason = "an example")]

use glam::DVec2;
use ibgs_core::blocks::{Core, PlanFolder};
use ibgs_core::camera::Camera;
use ibgs_core::dataset::{HostPhoto, Photo};
use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::render::{Frame, Renderer};
use image::RgbImage;
use std::collections::{HashMap, HashSet};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Pictures of photos that two blocks share.
const PICTURES: usize = 6;

/// Squared errors of base and final image, and the number of values.
#[derive(Clone, Copy, Default)]
struct Sum {
    errors: [f64; 2],
    values: f64,
}

impl Sum {
    fn psnr(&self) -> [f64; 2] {
        self.errors.map(|sum| -10.0 * (sum / self.values.max(1.0)).max(1e-12).log10())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [plan, merged, pictures] = &words[..] else { return Err("give a plan, a merged model, a folder".into()) };
    let plan = PlanFolder::at(plan);
    let blocks = plan.read()?.blocks;
    let gpu = Gpu::open(&AdapterChoice::Best, Use::Rendering)?;
    println!("{}", gpu.describe());
    let (mut whole, merged) = open(merged, &gpu)?;
    let photos = photos(&mut whole)?;
    let views: HashMap<&str, &Camera> =
        whole.cameras.iter().map(|record| (record.name.as_str(), &record.camera)).collect();
    let (mut all, mut shared) = ([Sum::default(); 2], Vec::new());
    println!("block: pixels; base, final of the block; base, final of the whole");
    for (number, block) in (0..).zip(&blocks) {
        let (_, own) = open(&plan.block_path(number), &gpu)?;
        let mut sums = [Sum::default(); 2];
        for name in &block.test {
            let (camera, photo) = (views[name.as_str()], &photos[name.as_str()].pixels()?);
            let frame = merged.render(camera)?;
            let inside = inside(&block.core, camera, &frame)?;
            add(&mut sums[0], &own.render(camera)?, photo, &inside)?;
            add(&mut sums[1], &frame, photo, &inside)?;
            let share = inside.iter().filter(|inside| **inside).count() as f64 / inside.len() as f64;
            shared.push(((share - 0.5).abs(), name.clone()));
        }
        for (all, sum) in all.iter_mut().zip(sums) {
            all.errors = [0, 1].map(|i| all.errors[i] + sum.errors[i]);
            all.values += sum.values;
        }
        line(&number.to_string(), &sums);
    }
    line("all", &all);
    std::fs::create_dir_all(pictures)?;
    shared.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut shown = HashSet::new();
    shared.retain(|(_, name)| shown.insert(name.clone()));
    for (number, (_, name)) in shared.iter().take(PICTURES).enumerate() {
        let frame = merged.render(views[name.as_str()])?;
        let image = frame.image()?.map_or_else(|| frame.base(), Ok)?.to_rgb8();
        let photo = photos[name.as_str()].pixels()?;
        side_by_side(&photo, &image).save(pictures.join(format!("{number}.png")))?;
    }
    Ok(())
}

fn line(name: &str, [own, whole]: &[Sum; 2]) {
    let [a, b] = [own, whole].map(|sum| sum.psnr().map(|psnr| format!("{psnr:.3}")).join(", "));
    println!("{name}: {:.0}; {a}; {b}", own.values / 3.0);
}

fn open(path: &Path, gpu: &Arc<Gpu>) -> Result<(Model, Renderer), Box<dyn Error>> {
    let mut model = Model::open(path, &ModelOptions::default())?;
    model.load_photos(&())?;
    let renderer = model.renderer(gpu)?.showing_surface();
    Ok((model, renderer))
}

fn photos(model: &mut Model) -> Result<HashMap<String, HostPhoto>, Box<dyn Error>> {
    let dataset = model.dataset(&())?;
    Ok(dataset.views.iter().map(|view| (view.name.clone(), view.photo.clone())).collect())
}

/// Which pixels show a point in a core.
fn inside(core: &Core, camera: &Camera, frame: &Frame) -> Result<Vec<bool>, Box<dyn Error>> {
    let depth = frame.depth()?.ok_or("a surface was asked for")?;
    let width = camera.width as usize;
    let pixel = |(index, &z): (usize, &f32)| {
        let uv = DVec2::new((index % width) as f64, (index / width) as f64) + 0.5;
        z > 0.0 && core.contains(camera.unproject(uv, f64::from(z)))
    };
    Ok(depth.iter().enumerate().map(pixel).collect())
}

fn add(sum: &mut Sum, frame: &Frame, photo: &Photo, inside: &[bool]) -> Result<(), Box<dyn Error>> {
    let base = frame.base()?.to_rgb8();
    let image = frame.image()?.map_or_else(|| base.clone(), |image| image.to_rgb8());
    for (pixel, _) in inside.iter().enumerate().filter(|(_, inside)| **inside) {
        for c in 0..3 {
            let truth = f64::from(photo.rgba[4 * pixel + c]);
            for (error, rgb) in sum.errors.iter_mut().zip([&base, &image]) {
                *error += ((f64::from(rgb[3 * pixel + c]) - truth) / 255.0).powi(2);
            }
        }
        sum.values += 3.0;
    }
    Ok(())
}

fn side_by_side(photo: &Photo, image: &[u8]) -> RgbImage {
    RgbImage::from_fn(2 * photo.width, photo.height, |x, y| {
        let at = (y * photo.width + x % photo.width) as usize;
        let from = if x < photo.width { &photo.rgba[4 * at..] } else { &image[3 * at..] };
        image::Rgb([from[0], from[1], from[2]])
    })
}
