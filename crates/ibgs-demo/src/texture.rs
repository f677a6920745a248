//! Procedural surface colours in linear light. Coordinates are metres on the surface.

use super::numeric::{floor, fract, hash_cell, mix, noise, unit};
use glam::DVec3;

/// What a surface is painted with.
#[derive(Clone, Copy)]
pub(super) enum Texture {
    /// One colour.
    Plain(DVec3),
    /// The inner walls of the room.
    Room,
    /// The table: a chessboard on top, planks at the sides.
    Table,
    /// A cube with one coloured sign on each face.
    Cube,
    /// A ball of coloured patches.
    Ball,
    /// Dark wood.
    DarkWood,
}

/// Half extents of the room, needed to place its wall paintings.
pub(super) const ROOM_HALF: DVec3 = DVec3::new(2.2, 2.2, 1.3);

const CREAM: DVec3 = DVec3::new(0.78, 0.72, 0.58);
const INK: DVec3 = DVec3::new(0.035, 0.04, 0.07);
const TEAL: DVec3 = DVec3::new(0.03, 0.22, 0.24);
const PALETTE: [DVec3; 6] = [
    DVec3::new(0.62, 0.09, 0.05),
    DVec3::new(0.80, 0.42, 0.05),
    DVec3::new(0.04, 0.27, 0.30),
    DVec3::new(0.06, 0.12, 0.38),
    DVec3::new(0.75, 0.68, 0.52),
    DVec3::new(0.20, 0.36, 0.08),
];

/// Colour at a point given in the frame of the solid, `normal` being the outward normal there.
pub(super) fn albedo(texture: Texture, local: DVec3, normal: DVec3) -> DVec3 {
    match texture {
        Texture::Plain(color) => color,
        Texture::Room => room(local, normal),
        Texture::Table => table(local, normal),
        Texture::Cube => cube(local, normal),
        Texture::Ball => ball(normal),
        Texture::DarkWood => {
            let grain = noise(local.x * 9.0 + local.y * 40.0, local.z * 90.0, 41);
            DVec3::new(0.060, 0.032, 0.018) * (0.6 + 0.9 * grain)
        }
    }
}

fn room(local: DVec3, normal: DVec3) -> DVec3 {
    let height = local.z + ROOM_HALF.z;
    if normal.z > 0.5 {
        ceiling(local.x, local.y)
    } else if normal.z < -0.5 {
        planks(local.x, local.y)
    } else if height < 0.09 {
        // The same skirting board on every wall.
        CREAM * if height > 0.078 { 0.35 } else { 0.8 }
    } else if normal.y > 0.5 {
        gallery(local.x, height)
    } else if normal.y < -0.5 {
        lettering(local.x, height)
    } else if normal.x > 0.5 {
        quilt(local.y, height)
    } else {
        wallpaper(local.y, height)
    }
}

fn ceiling(x: f64, y: f64) -> DVec3 {
    let seam = fract(x / 0.55).min(fract(y / 0.55)) < 0.02;
    CREAM * if seam { 0.4 } else { 0.85 + 0.1 * noise(x * 6.0, y * 6.0, 3) }
}

/// Floor boards of 14 cm with staggered ends, a tint of their own and a fine grain.
fn planks(x: f64, y: f64) -> DVec3 {
    let row = floor(y / 0.14);
    let shifted = x / 0.9 + unit(hash_cell(row, 0, 11));
    let tint = unit(hash_cell(row, floor(shifted), 12));
    let (across, along) = (fract(y / 0.14), fract(shifted));
    if across < 0.03 || along < 0.006 {
        return DVec3::new(0.03, 0.018, 0.01);
    }
    wood(x, y + 7.0 * tint) * (0.65 + 0.7 * tint)
}

/// Grain that runs along `x`.
fn wood(x: f64, y: f64) -> DVec3 {
    let bend = noise(x * 1.7, y * 5.0, 21);
    let ring = fract(y * 16.0 + bend * 3.0);
    let fibre = noise(x * 14.0, y * 210.0, 22);
    let weight = 0.45 * (4.0 * ring * (1.0 - ring)) + 0.55 * fibre;
    mix(DVec3::new(0.20, 0.085, 0.030), DVec3::new(0.46, 0.25, 0.105), weight)
}

/// Brickwork with two pictures.
fn gallery(x: f64, z: f64) -> DVec3 {
    if let Some((u, v)) = panel(x, z, (-1.0, 1.45), (0.42, 0.42)) {
        return rings(u, v);
    }
    if let Some((u, v)) = panel(x, z, (0.85, 1.45), (0.62, 0.40)) {
        return mosaic(u, v);
    }
    bricks(x, z)
}

/// Position in units of the picture (`-1..1`) when inside it.
fn panel(x: f64, z: f64, center: (f64, f64), half: (f64, f64)) -> Option<(f64, f64)> {
    let (u, v) = ((x - center.0) / half.0, (z - center.1) / half.1);
    (u.abs() < 1.0 && v.abs() < 1.0).then_some((u, v))
}

fn rings(u: f64, v: f64) -> DVec3 {
    if u.abs().max(v.abs()) > 0.92 {
        return INK;
    }
    let (du, dv) = (u + 0.15, v - 0.1);
    let ring = floor((du * du + dv * dv).sqrt() * 7.0);
    let side = i64::from(du > 0.0) + 2 * i64::from(dv > 0.0);
    PALETTE[(hash_cell(ring, side, 31) % 6) as usize]
}

fn mosaic(u: f64, v: f64) -> DVec3 {
    if u.abs().max(v.abs()) > 0.94 {
        return DVec3::new(0.55, 0.42, 0.16);
    }
    // Triangles: each square is cut along one of its diagonals.
    let (cell_u, cell_v) = (u * 5.0, v * 3.5);
    let (i, j) = (floor(cell_u), floor(cell_v));
    let (mut fu, fv) = (fract(cell_u), fract(cell_v));
    if hash_cell(i, j, 33) & 1 == 1 {
        fu = 1.0 - fu;
    }
    let half = i64::from(fu > fv);
    PALETTE[(hash_cell(2 * i + half, j, 34) % 6) as usize] * 0.95
}

fn bricks(x: f64, z: f64) -> DVec3 {
    let row = floor(z / 0.105);
    let shifted = x / 0.25 + if row & 1 == 1 { 0.5 } else { 0.0 };
    let (along, up) = (fract(shifted) * 0.25, fract(z / 0.105) * 0.105);
    let speckle = noise(x * 70.0, z * 70.0, 51);
    if along < 0.013 || up < 0.013 {
        return DVec3::new(0.50, 0.46, 0.40) * (0.7 + 0.5 * speckle);
    }
    let tint = unit(hash_cell(floor(shifted), row, 52));
    mix(DVec3::new(0.34, 0.10, 0.06), DVec3::new(0.55, 0.24, 0.14), tint) * (0.6 + 0.7 * speckle)
}

/// A wall of writing: large coloured signs between rows of small print.
fn lettering(x: f64, z: f64) -> DVec3 {
    let paper = CREAM * (0.93 + 0.1 * noise(x * 25.0, z * 25.0, 61));
    let band = fract(z / 0.52);
    let row = floor(z / 0.52);
    if band < 0.56 {
        let column = floor(x / 0.27);
        let inside = sign(fract(x / 0.27), band / 0.56, hash_cell(column, row, 62));
        let color = PALETTE[(hash_cell(column, row, 63) % 4) as usize];
        return if inside { color } else { paper };
    }
    let line = floor((band - 0.56) / 0.11);
    let column = floor(x / 0.045);
    let key = hash_cell(column, line + 10 * row, 64);
    let inside = sign(fract(x / 0.045), fract((band - 0.56) / 0.11), key);
    if inside && !key.is_multiple_of(7) { INK } else { paper }
}

/// Whether a point of the unit cell is inked in the letter-like sign of `key`: five by seven dots with a margin,
/// the left half a mirror image of the right one.
fn sign(u: f64, v: f64, key: u64) -> bool {
    let (i, j) = (floor(u * 7.0) - 1, floor(v * 9.0) - 1);
    if !(0..5).contains(&i) || !(0..7).contains(&j) {
        return false;
    }
    let folded = if i > 2 { 4 - i } else { i };
    (key >> (3 * j + folded + 20)) & 1 == 1
}

/// Square tiles in hashed colours, every other one with an inset diamond.
fn quilt(y: f64, z: f64) -> DVec3 {
    let (i, j) = (floor(y / 0.275), floor(z / 0.275));
    let (u, v) = (fract(y / 0.275) - 0.5, fract(z / 0.275) - 0.5);
    if u.abs().max(v.abs()) > 0.475 {
        return CREAM * 0.55;
    }
    let color = PALETTE[(hash_cell(i, j, 71) % 6) as usize];
    if (i + j) & 1 == 0 {
        return if u.abs() + v.abs() < 0.33 { INK } else { CREAM };
    }
    if u.abs() + v.abs() < 0.22 { CREAM } else { color }
}

/// Vertical stripes of three widths over a panelled lower wall.
fn wallpaper(y: f64, z: f64) -> DVec3 {
    if z < 0.85 {
        let rail = z > 0.81 || fract(y / 0.4) < 0.03;
        return if rail { CREAM * 0.5 } else { TEAL * (0.8 + 0.3 * noise(y * 30.0, z * 4.0, 81)) };
    }
    let stripe = floor(y / 0.11).rem_euclid(4);
    let across = fract(y / 0.11);
    match stripe {
        0 => TEAL,
        1 if (0.42..0.58).contains(&across) => DVec3::new(0.62, 0.40, 0.08),
        2 => DVec3::new(0.42, 0.10, 0.07),
        _ => CREAM,
    }
}

fn table(local: DVec3, normal: DVec3) -> DVec3 {
    if normal.z.abs() < 0.5 {
        let along = if normal.x.abs() > 0.5 { local.y } else { local.x };
        return wood(along, local.z) * if local.z > 0.17 { 0.35 } else { 0.75 };
    }
    let (i, j) = (floor(local.x / 0.1), floor(local.y / 0.1));
    if local.x.abs() > 0.6 || local.y.abs() > 0.5 {
        return wood(local.x, local.y) * 0.4;
    }
    let grain = noise(local.x * 30.0, local.y * 160.0, 91);
    if (i + j) & 1 == 0 {
        DVec3::new(0.66, 0.50, 0.30) * (0.8 + 0.3 * grain)
    } else {
        DVec3::new(0.075, 0.038, 0.022) * (0.6 + 0.8 * grain)
    }
}

fn cube(local: DVec3, normal: DVec3) -> DVec3 {
    let (u, v, face) = if normal.x.abs() > 0.5 {
        (local.y, local.z, normal.x.signum() as i64)
    } else if normal.y.abs() > 0.5 {
        (local.x, local.z, 2 * normal.y.signum() as i64)
    } else {
        (local.x, local.y, 3 * normal.z.signum() as i64)
    };
    let ground = PALETTE[((face + 3) % 4) as usize];
    let (column, row) = (floor(u / 0.1), floor(v / 0.1));
    let key = hash_cell(column + 100 * face, row, 95);
    if sign(fract(u / 0.1), fract(v / 0.1), key) { CREAM } else { ground }
}

/// Patches of a cube projected on the ball.
fn ball(normal: DVec3) -> DVec3 {
    let a = normal.abs();
    let (u, v, face) = if a.x >= a.y && a.x >= a.z {
        (normal.y / a.x, normal.z / a.x, if normal.x > 0.0 { 1 } else { 2 })
    } else if a.y >= a.z {
        (normal.x / a.y, normal.z / a.y, if normal.y > 0.0 { 3 } else { 4 })
    } else {
        (normal.x / a.z, normal.y / a.z, if normal.z > 0.0 { 5 } else { 6 })
    };
    let (i, j) = (floor(u * 2.0), floor(v * 2.0));
    if (i + j) & 1 == 0 {
        return CREAM;
    }
    PALETTE[((hash_cell(i + 10 * face, j, 97) % 3) + 1) as usize]
}
