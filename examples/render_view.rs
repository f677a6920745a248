//! Opens a trained model and renders its first held-out view to a PNG.
//!
//! ```sh
//! cargo run --release --example render_view -- output/my-scene view.png
//! ```

#![expect(clippy::print_stdout, reason = "an example")]

use ibgs_core::gpu::{AdapterChoice, Gpu, Use};
use ibgs_core::image_io::write_png;
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::output::cameras::Split;
use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let paths: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [model, picture] = &paths[..] else { return Err("give a model folder (or bundle) and a PNG".into()) };
    let gpu = Gpu::open(&AdapterChoice::Best, Use::Rendering)?;
    let mut model = Model::open(model, &ModelOptions::default())?;
    let renderer = model.renderer(&gpu)?;
    let held_out = model.cameras.iter().find(|view| view.split == Some(Split::Test));
    let view = held_out.or(model.cameras.first()).ok_or("the model has no views")?;
    let frame = renderer.render(&view.camera)?;
    // The final image where the model has a residual network, else the base image.
    let image = match frame.image()? {
        Some(image) => image,
        None => frame.base()?,
    };
    write_png(picture, image.width, image.height, &image.to_rgb8())?;
    println!("{} in {}", view.name, picture.display());
    Ok(())
}
