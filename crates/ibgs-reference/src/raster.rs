//! Twin of the blending kernel (method.md section 2).

use ibgs_data::camera::Camera;
use ibgs_shaders::{ELLIPSOID_EDGE, ELLIPSOID_POWER};
use rayon::prelude::*;

use super::{Forward, MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, Model, Params, Projected, TILE, project::project_as};

/// One Gaussian's part in one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contribution {
    /// Entry in the tile's list.
    pub entry: usize,
    pub gaussian: usize,
    pub alpha: f64,
    /// Transmittance before it.
    pub transmittance: f64,
    /// exp(-1/2 d^T conic d).
    pub falloff: f64,
    /// Projected mean minus pixel.
    pub offset: [f64; 2],
}

/// Tiles along x and y.
pub fn tile_grid(camera: &Camera) -> [u32; 2] {
    [camera.width.div_ceil(TILE), camera.height.div_ceil(TILE)]
}

/// Pixels (x, y) of a tile that lie inside the image, row by row.
pub fn tile_pixels(camera: &Camera, tile: usize) -> impl Iterator<Item = (u32, u32)> + use<> {
    let columns = tile_grid(camera)[0];
    let (x0, y0) = (tile as u32 % columns * TILE, tile as u32 / columns * TILE);
    let (x1, y1) = ((x0 + TILE).min(camera.width), (y0 + TILE).min(camera.height));
    (y0..y1).flat_map(move |y| (x0..x1).map(move |x| (x, y)))
}

/// Per tile the visible Gaussians whose rectangle holds it, by f32 view depth, then by index.
pub fn tile_lists(projected: &[Projected], camera: &Camera) -> Vec<Vec<u32>> {
    let [columns, rows] = tile_grid(camera);
    let mut lists = vec![Vec::new(); (columns * rows) as usize];
    let mut sorted: Vec<u32> = (0..projected.len() as u32).filter(|i| projected[*i as usize].visible).collect();
    sorted.sort_by(|a, b| {
        let depth = |i: u32| projected[i as usize].depth as f32;
        depth(*a).total_cmp(&depth(*b)).then(a.cmp(b))
    });
    for i in sorted {
        let [x0, y0, x1, y1] = projected[i as usize].rect;
        for y in y0..y1 {
            for x in x0..x1 {
                lists[(y * columns + x) as usize].push(i);
            }
        }
    }
    lists
}

/// Contributions to the pixel (x, y) front to back, and the transmittance left behind the last.
pub fn contributions(projected: &[Projected], list: &[u32], x: u32, y: u32) -> (Vec<Contribution>, f64) {
    let mut out = Vec::new();
    let mut transmittance = 1.0;
    for (entry, gaussian) in list.iter().map(|g| *g as usize).enumerate() {
        let splat = &projected[gaussian];
        let offset = [splat.xy[0] - f64::from(x), splat.xy[1] - f64::from(y)];
        let [dx, dy] = offset;
        let [a, b, c] = splat.conic;
        let power = -0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy;
        if power.is_nan() || power > 0.0 {
            continue;
        }
        let falloff = power.exp();
        let alpha = (splat.opacity * falloff).min(MAX_ALPHA);
        if alpha < MIN_ALPHA {
            continue;
        }
        let next = transmittance * (1.0 - alpha);
        if next < MIN_TRANSMITTANCE {
            break;
        }
        out.push(Contribution { entry, gaussian, alpha, transmittance, falloff, offset });
        transmittance = next;
    }
    (out, transmittance)
}

/// Blends projected Gaussians front to back over `background`.
pub fn rasterize(projected: Vec<Projected>, camera: &Camera, background: [f64; 3], active_sh_degree: usize) -> Forward {
    let order = tile_lists(&projected, camera);
    let pixel = |(x, y): (u32, u32), list: &[u32]| {
        let (parts, final_t) = contributions(&projected, list, x, y);
        let mut color = background.map(|c| c * final_t);
        for part in &parts {
            let weight = part.alpha * part.transmittance;
            for (o, c) in color.iter_mut().zip(projected[part.gaussian].color) {
                *o += weight * c;
            }
        }
        let last = parts.last().map_or(0, |p| p.entry as u32 + 1);
        ((y * camera.width + x) as usize, color, final_t, last)
    };
    let tiles: Vec<Vec<_>> = order
        .par_iter()
        .enumerate()
        .map(|(tile, list)| tile_pixels(camera, tile).map(|at| pixel(at, list)).collect())
        .collect();

    let pixels = (camera.width * camera.height) as usize;
    let mut image = vec![[0.0; 3]; pixels];
    let mut final_t = vec![1.0; pixels];
    let mut last = vec![0; pixels];
    for (i, color, t, l) in tiles.into_iter().flatten() {
        (image[i], final_t[i], last[i]) = (color, t, l);
    }
    Forward { image, final_t, last, order, projected, active_sh_degree, model: Model::Outline }
}

/// The colours of opaque ellipsoids over `background`; none at pixels that lie on an edge within rounding.
pub fn ellipsoids(projected: &[Projected], camera: &Camera, background: [f64; 3]) -> Vec<Option<[f64; 3]>> {
    let (most, edge) = (f64::from(ELLIPSOID_POWER), f64::from(ELLIPSOID_EDGE));
    let mut image = vec![Some(background); camera.pixels()];
    for (tile, list) in tile_lists(projected, camera).iter().enumerate() {
        for (x, y) in tile_pixels(camera, tile) {
            let shown = list.iter().map(|&g| &projected[g as usize]).find_map(|splat| {
                let (dx, dy) = (splat.xy[0] - f64::from(x), splat.xy[1] - f64::from(y));
                let [a, b, c] = splat.conic;
                let power = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy;
                let reach = most.min((splat.opacity / MIN_ALPHA).ln());
                let shade = edge + (1.0 - edge) * (1.0 - power / most).max(0.0).sqrt();
                match power - reach {
                    apart if apart.abs() < 1e-3 => Some(None),
                    apart if apart < 0.0 => Some(Some(splat.color.map(|v| v * shade))),
                    _ => None,
                }
            });
            if let Some(color) = shown {
                image[(y * camera.width + x) as usize] = color;
            }
        }
    }
    image
}

/// Projects and blends.
pub fn render(p: &Params, camera: &Camera, background: [f64; 3], active_sh_degree: usize) -> Forward {
    render_as(p, camera, background, active_sh_degree, Model::Outline)
}

/// `render` with a choice of the model.
pub fn render_as(p: &Params, camera: &Camera, background: [f64; 3], active_sh_degree: usize, model: Model) -> Forward {
    let projected = project_as(p, camera, active_sh_degree, model);
    Forward { model, ..rasterize(projected, camera, background, active_sh_degree) }
}
