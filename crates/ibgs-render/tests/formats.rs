//! What a file of another format does to the picture.

use ibgs_data::scene::{Format, Gaussians};
use ibgs_reference::gpu::{gaussians, gpu, pixels, rasterizer};
use ibgs_reference::psnr;
use ibgs_reference::random_scene::{random_camera, random_params};
use ibgs_render::raster::RasterView;
use ibgs_render::scene::Splats;
use ibgs_testing::{bytes_of, read};
use std::f64::consts::PI;

fn pictures(g: &Gaussians) -> Vec<f64> {
    let splats = Splats::upload(g, &gpu()).unwrap();
    let raster = rasterizer();
    let picture = |seed: u64| {
        let view = RasterView::new(random_camera(96, 72, seed), g.sh_degree);
        pixels(&raster.render(&splats, &view).unwrap(), &view.camera)
    };
    (0..3).flat_map(picture).collect()
}

/// PSNR of colours whose coefficients of each degree are off by up to half a step, evenly: a basis of degree l has
/// (2 l + 1) / (4 pi) as its mean sum of squares.
fn noise_floor(steps: [f64; 4]) -> f64 {
    let variance = |(l, step): (usize, &f64)| (2 * l + 1) as f64 / (4.0 * PI) * step * step / 12.0;
    -10.0 * steps.iter().enumerate().map(variance).sum::<f64>().log10()
}

/// PSNR of Gaussians that are turned: a component of the quaternion off by half of 1/128 turns one by up to 0.0135. The
/// longest here are ten times as long as wide: their ends move by a seventh of their width, and alpha by up to 8 %, a quarter
/// of that in the root of the mean square.
fn turn_floor(step: f64) -> f64 {
    -20.0 * (0.02 * 128.0 * step).log10()
}

/// The model up to a degree.
fn up_to(g: &Gaussians, degree: u32) -> Gaussians {
    let [row, kept] = [g.sh_degree, degree].map(|degree| 3 * (degree as usize + 1).pow(2));
    let sh = g.sh.chunks_exact(row).flat_map(|sh| &sh[..kept]).copied().collect();
    Gaussians { sh, sh_degree: degree, ..g.clone() }
}

/// Pixels mix many Gaussians, whose errors cancel in part, so the picture of a round trip is no worse than the colours of a
/// lone Gaussian, or than its quaternions make it where colours are nearly exact.
#[test]
fn pictures_after_a_round_trip() {
    let g = gaussians(&random_params(500, 3, 7));
    // Twenty pixels of 20,736 on the other side of the cut at 1/255.
    let rounding = -10.0 * (20.0 / 20_736.0 / 255.0_f64.powi(2)).log10();
    for format in Format::written() {
        let model = up_to(&g, g.sh_degree.min(format.max_sh_degree()));
        let steps = format.steps();
        let least = match format {
            Format::Ply => f64::INFINITY,
            _ => rounding.min(noise_floor(steps.sh)).min(turn_floor(steps.rotation)),
        };
        let bytes = bytes_of(&model, format);
        let name = format!("a{}", format.ending());
        let found = psnr(&pictures(&model), &pictures(&read(&bytes, &name).unwrap()));
        println!("{format:?}: {found:.1} dB, at least {least:.1}; {:.1} bytes a Gaussian", bytes.len() as f64 / 500.0);
        assert!(found >= least, "{format:?}: {found} dB < {least} dB");
    }
}
