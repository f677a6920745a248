//! Ray tracing: direct light with soft shadows, ambient light dimmed in corners, and mirror bounces.

use super::numeric::{hash, power_of_two, sin_cos, srgb_code};
use super::scene::{Hit, LAMP, Material, ROOM, Scene, WALKER, scene};
use super::shape::Ray;
use super::texture::{Texture, albedo};
use glam::{DVec2, DVec3};
use ibgs_data::camera::Camera;
use ibgs_data::dataset::Photo;
use rayon::prelude::*;
use std::sync::LazyLock;

/// Longest chain of mirror reflections.
const BOUNCES: usize = 4;
/// New rays start this far above a surface, in metres.
const LIFT: f64 = 1e-6;
/// Radiance of a lamp for its intensity: far beyond white, so that weak reflections still show it.
const LAMP_GLARE: f64 = 25.0;

/// Exact geometry behind each pixel, row by row, from one ray through each pixel centre.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// View-space z of the first surface, in metres.
    pub depth: Vec<f32>,
    /// Unit surface normal in world space, facing the camera.
    pub normal: Vec<[f32; 3]>,
    /// Object id, one of the constants of this module such as `MIRROR`.
    pub object: Vec<u8>,
}

/// Ray traces a photo from a camera inside the room: sRGB, opaque, `samples` x `samples` rays a pixel averaged in
/// linear light (0 counts as 1).
pub fn render_photo(camera: &Camera, samples: u32) -> Photo {
    render_in(scene(), camera, samples)
}

pub(super) fn render_in(scene: &Scene, camera: &Camera, samples: u32) -> Photo {
    let samples = samples.max(1);
    let mut rgba = vec![255u8; camera.width as usize * camera.height as usize * 4];
    let row_bytes = (camera.width as usize * 4).max(1);
    rgba.par_chunks_mut(row_bytes).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(4).enumerate() {
            let linear = pixel_color(scene, camera, x as f64, y as f64, samples);
            for channel in 0..3 {
                pixel[channel] = srgb_code(linear[channel]);
            }
        }
    });
    Photo { width: camera.width, height: camera.height, rgba }
}

/// Geometry seen by a camera inside the room, one ray at each pixel centre.
pub fn truth(camera: &Camera) -> Truth {
    let (width, forward) = (camera.width as usize, camera.forward());
    let hits: Vec<(f32, [f32; 3], u8)> = (0..width * camera.height as usize)
        .into_par_iter()
        .map(|pixel| {
            let (hit, ray) = hit_at(scene(), camera, (pixel % width) as f64, (pixel / width) as f64);
            let depth = hit.t * ray.direction.dot(forward);
            (depth as f32, hit.normal.as_vec3().to_array(), hit.id)
        })
        .collect();
    Truth {
        depth: hits.iter().map(|hit| hit.0).collect(),
        normal: hits.iter().map(|hit| hit.1).collect(),
        object: hits.iter().map(|hit| hit.2).collect(),
    }
}

/// What the centre of a pixel shows, and the ray that found it.
pub(super) fn hit_at(scene: &Scene, camera: &Camera, x: f64, y: f64) -> (Hit, Ray) {
    let direction = camera.ray(DVec2::new(x + 0.5, y + 0.5));
    let ray = Ray { origin: camera.center(), direction };
    (scene.nearest(&ray), ray)
}

/// Average over a grid of rays; each ray also looks at its own point of every lamp, which makes shadows soft.
fn pixel_color(scene: &Scene, camera: &Camera, x: f64, y: f64, samples: u32) -> DVec3 {
    static SPOTS: LazyLock<[DVec3; 16]> = LazyLock::new(lamp_spots);
    let mut sum = DVec3::ZERO;
    for (number, ray) in pixel_rays(camera, x, y, samples) {
        let spot = match samples {
            1 => DVec3::ZERO,
            2..=4 => SPOTS[(number * 7 % 16) as usize],
            _ => SPOTS[(hash(u64::from(number)) % 16) as usize],
        };
        sum += shoulder(radiance(scene, ray, spot));
    }
    sum / f64::from(samples * samples)
}

/// The grid of rays through a pixel, row by row, with their numbers.
fn pixel_rays(camera: &Camera, x: f64, y: f64, samples: u32) -> impl Iterator<Item = (u32, Ray)> {
    let (step, origin) = (1.0 / f64::from(samples), camera.center());
    (0..samples * samples).map(move |number| {
        let offset = DVec2::new(f64::from(number % samples) + 0.5, f64::from(number / samples) + 0.5) * step;
        (number, Ray { origin, direction: camera.ray(DVec2::new(x, y) + offset) })
    })
}

/// The pixels in which the walker of a scene is seen: those of which a ray meets it first.
pub(super) fn walker_pixels(scene: &Scene, camera: &Camera, samples: u32) -> Vec<bool> {
    let (width, samples) = (camera.width as usize, samples.max(1));
    (0..width * camera.height as usize)
        .into_par_iter()
        .map(|pixel| {
            let (x, y) = ((pixel % width) as f64, (pixel / width) as f64);
            pixel_rays(camera, x, y, samples).any(|(_, ray)| scene.shows_walker(&ray))
        })
        .collect()
}

/// Sixteen points spread over the unit sphere.
fn lamp_spots() -> [DVec3; 16] {
    std::array::from_fn(|k| {
        let z = (k as f64 + 0.5) / 8.0 - 1.0;
        let (sin, cos) = sin_cos(k as f64 * 2.399_963_229_728_653);
        let radius = (1.0 - z * z).sqrt();
        DVec3::new(radius * cos, radius * sin, z)
    })
}

/// Linear up to 0.75, then bends towards 1 so that bright spots keep their hue and edge.
fn shoulder(color: DVec3) -> DVec3 {
    const KNEE: f64 = 0.75;
    let over = (color - DVec3::splat(KNEE)).max(DVec3::ZERO) / (1.0 - KNEE);
    color.min(DVec3::splat(KNEE)) + over / (DVec3::ONE + over) * (1.0 - KNEE)
}

/// Light that arrives against a ray; `spot` picks a point of each lamp (in units of its radius).
pub(super) fn radiance(scene: &Scene, mut ray: Ray, spot: DVec3) -> DVec3 {
    let (mut sum, mut throughput) = (DVec3::ZERO, DVec3::ONE);
    for _ in 0..BOUNCES {
        let hit = scene.nearest(&ray);
        if hit.id == LAMP {
            return sum + throughput * scene.lamps[hit.index].intensity * LAMP_GLARE;
        }
        let material = material_of(scene, &hit);
        let facing = -hit.normal.dot(ray.direction);
        let reflected = fresnel(material.reflectance, facing);
        let color = albedo(material.texture, hit.local.0, hit.local.1) * (DVec3::ONE - reflected);
        let point = ray.at(hit.t) + hit.normal * LIFT;
        let (matt, highlight) = lamp_light(scene, point, hit.normal, ray.direction, spot, material.sheen);
        let ambient = ambient_light(scene, point, hit.normal);
        sum += throughput * (color * (matt + ambient) + reflected * highlight);
        throughput *= reflected;
        if throughput.max_element() < 0.003 {
            break;
        }
        ray = Ray { origin: point, direction: ray.direction + hit.normal * (2.0 * facing) };
    }
    sum
}

fn material_of(scene: &Scene, hit: &Hit) -> Material {
    let matt = |texture| Material { texture, reflectance: DVec3::ZERO, sheen: 0.0 };
    match (&scene.walker, hit.id) {
        (_, ROOM) => matt(Texture::Room),
        (Some(walker), WALKER) => matt(Texture::Plain(walker.color(hit.index))),
        _ => scene.objects[hit.index].material,
    }
}

/// Schlick's Fresnel term; zero stays zero (matt).
fn fresnel(reflectance: DVec3, facing: f64) -> DVec3 {
    if reflectance == DVec3::ZERO {
        return DVec3::ZERO;
    }
    let grazing = (1.0 - facing).clamp(0.0, 1.0);
    reflectance + (DVec3::ONE - reflectance) * (power_of_two(grazing, 2) * grazing)
}

/// Direct light of all lamps: the irradiance of a matt surface and the Blinn-Phong highlight.
fn lamp_light(scene: &Scene, point: DVec3, normal: DVec3, incoming: DVec3, spot: DVec3, sheen: f64) -> (DVec3, DVec3) {
    let (mut matt, mut highlight) = (DVec3::ZERO, DVec3::ZERO);
    for (lamp, offset) in scene.lamps_near(point) {
        let to_lamp = lamp.solid.center + spot * lamp.radius + offset - point;
        let squared = to_lamp.length_squared();
        let distance = squared.sqrt();
        let direction = to_lamp / distance;
        let cosine = normal.dot(direction);
        if cosine <= 0.0 || scene.blocked(&Ray { origin: point, direction }, distance) {
            continue;
        }
        // The lamps shine mostly downwards; the softened square keeps the ceiling from burning out.
        let shade = 0.16 + 0.84 * (0.5 + 1.5 * direction.z).clamp(0.0, 1.0);
        let light = lamp.intensity * (shade / (squared + 0.3));
        matt += light * cosine;
        if sheen > 0.0 {
            let half = (direction - incoming).normalize();
            highlight += light * (sheen * power_of_two(normal.dot(half).max(0.0), 8));
        }
    }
    (matt, highlight)
}

/// Sky-free ambient light, a little brighter from above, dimmed where other surfaces are close.
fn ambient_light(scene: &Scene, point: DVec3, normal: DVec3) -> DVec3 {
    let mut open = 1.0;
    for (reach, strength) in [(0.04, 0.35), (0.13, 0.35), (0.40, 0.30)] {
        let clearance = scene.clearance(point + normal * reach).max(0.0);
        open -= strength * (1.0 - clearance / reach).clamp(0.0, 1.0);
    }
    let tint = DVec3::new(0.36, 0.34, 0.33) + DVec3::new(0.05, 0.06, 0.08) * normal.z;
    tint * open.max(0.0)
}
