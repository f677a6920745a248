//! Cameras on arcs around the table, looking inwards.

use super::DemoOptions;
use super::numeric::{Stream, sin_cos};
use super::scene::TABLE_TOP;
use glam::{DMat3, DVec2, DVec3};
use ibgs_data::camera::Camera;

/// Horizontal field of view in degrees.
const FIELD_OF_VIEW: f64 = 55.0;
/// The arcs span this angle, centred on the -y side, in degrees. Photos stand so close together that the reflections in
/// the curved surfaces move by a few pixels from one to the next.
const SWEEP: f64 = 100.0;
/// Distance of the cameras from the z axis in metres.
const RADIUS: f64 = 1.5;

/// Poses of all photos in the order of their names: arc by arc, each from left to right.
pub fn cameras(options: &DemoOptions) -> Vec<Camera> {
    let heights: &[f64] = match options.views {
        0..=9 => &[1.05],
        10..=59 => &[0.85, 1.35],
        _ => &[0.78, 1.12, 1.5],
    };
    (0..options.views)
        .map(|view| {
            let arc = view * heights.len() / options.views;
            let first = (arc * options.views).div_ceil(heights.len());
            let next = ((arc + 1) * options.views).div_ceil(heights.len());
            // Neighbouring arcs are shifted by half a step against each other.
            let stagger = if arc.is_multiple_of(2) { 0.35 } else { 0.65 };
            let place = (view - first) as f64 + stagger;
            let count = (next - first) as f64;
            pose(options, view, place / count, count, heights[arc])
        })
        .collect()
}

fn pose(options: &DemoOptions, view: usize, along: f64, count: f64, height: f64) -> Camera {
    let mut random = Stream::new(options.seed, 1, view as u64);
    let wobble = 0.12 * random.signed() / count;
    let (sin, cos) = sin_cos(((along + wobble - 0.5) * SWEEP).to_radians());
    let radius = RADIUS + 0.05 * random.signed();
    let eye = DVec3::new(radius * sin, -radius * cos, height + 0.03 * random.signed());
    let mut shift = || 0.03 * random.signed();
    let target = DVec3::new(shift(), 0.05 + shift(), TABLE_TOP + 0.22 + shift());
    look_at(options.width, options.height, eye, target)
}

/// A camera of the demo's field of view at `eye` (metres) that looks at `target`, with z up.
pub fn look_at(width: u32, height: u32, eye: DVec3, target: DVec3) -> Camera {
    let forward = (target - eye).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let view_from_world = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let (sin, cos) = sin_cos((FIELD_OF_VIEW / 2.0).to_radians());
    Camera {
        width,
        height,
        focal: DVec2::splat(f64::from(width) / 2.0 * cos / sin),
        principal: DVec2::new(f64::from(width), f64::from(height)) / 2.0,
        view_from_world,
        translation: -(view_from_world * eye),
    }
}
