//! Traces a street of rooms, a synthetic scene of any size, into a scene folder.
//!
//! ```sh
//! cargo run --release --example street -- my-street --rooms 8 --photos 60 --width 640
//! cargo run --release -- split my-street -o plan --blocks 4 -- --eval
//! ```

#![expect(clippy::print_stdout, reason = "an example")]

use clap::Parser;
use ibgs::progress::Bars;
use ibgs_demo::{DemoOptions, StreetOptions, street};
use std::path::PathBuf;

#[derive(Parser)]
struct Args {
    /// Scene folder to write; photos that are there already are kept.
    folder: PathBuf,
    /// Number of rooms.
    #[arg(long, default_value_t = 4)]
    rooms: usize,
    /// Number of photos in each room, 2 to 1000.
    #[arg(long, default_value_t = 60)]
    photos: usize,
    /// Width of the photos in pixels; they are four thirds as wide as high.
    #[arg(long, default_value_t = 640)]
    width: u32,
    /// Rays a pixel along each of its sides.
    #[arg(long, default_value_t = 2)]
    samples: u32,
    /// Number of points in each room.
    #[arg(long, default_value_t = 20_000)]
    points: usize,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let Args { folder, rooms, photos, width, samples, points } = Args::parse();
    let room = DemoOptions { width, height: width * 3 / 4, views: photos, samples, points, seed: 0 };
    let dataset = street(&StreetOptions { rooms, room }, &folder, &Bars::default())?;
    if let Some(note) = dataset.notes.first() {
        return Err(note.clone().into());
    }
    println!("{} photos and {} points in {}", dataset.views.len(), dataset.points.len(), folder.display());
    Ok(())
}
