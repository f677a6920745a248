//! Which texels a triangle covers.

use glam::{DVec2, Vec2, Vec3};

/// Calls `visit` with column, row and barycentric weights of each texel whose centre (at +0.5) lies in a triangle, in either
/// direction. A centre on the edge of two triangles belongs to one of them.
pub fn covered(corners: [Vec2; 3], mut visit: impl FnMut(i32, i32, Vec3)) {
    let points = corners.map(Vec2::as_dvec2);
    let area = edge(points[0], points[1], points[2]);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let (low, high) = (points[0].min(points[1]).min(points[2]), points[0].max(points[1]).max(points[2]));
    let (first, last) = ((low - 0.5).ceil().as_ivec2(), (high - 0.5).floor().as_ivec2());
    let sides = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| (points[i], points[j]));
    for y in first.y..=last.y {
        for x in first.x..=last.x {
            let at = DVec2::new(x.into(), y.into()) + 0.5;
            let signed = sides.map(|(a, b)| (edge(a, b, at) * area.signum(), (b - a) * area.signum()));
            let is_in = |(side, along): (f64, DVec2)| {
                side > 0.0 || (side == 0.0 && (along.y > 0.0 || (along.y == 0.0 && along.x > 0.0)))
            };
            if signed.into_iter().all(is_in) {
                let weights = signed.map(|(side, _)| (side / area.abs()) as f32);
                visit(x, y, weights.into());
            }
        }
    }
}

/// Twice the signed area of a triangle, with exactly the other sign where `a` and `b` change places.
fn edge(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let ordered = |a: DVec2, b: DVec2| (b - a).perp_dot(c - a);
    if (a.x, a.y) < (b.x, b.y) { ordered(a, b) } else { -ordered(b, a) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    #[test]
    fn a_fan_covers_each_texel_once() {
        // Corners and a centre on centres of texels, so that edges run through others.
        let ring: [Vec2; 6] = [(0.5, 0.5), (6.5, 0.5), (9.5, 4.5), (6.5, 8.5), (0.5, 8.5), (-2.5, 4.5)].map(Into::into);
        for middle in [Vec2::new(3.5, 4.5), Vec2::new(2.9, 4.1)] {
            let mut count: HashMap<(i32, i32), usize> = HashMap::new();
            for i in 0..6 {
                let mut corners = [middle, ring[i], ring[(i + 1) % 6]];
                if i % 2 == 1 {
                    corners.swap(1, 2);
                }
                covered(corners, |x, y, weights| {
                    *count.entry((x, y)).or_default() += 1;
                    let point = corners[0] * weights.x + corners[1] * weights.y + corners[2] * weights.z;
                    let centre = Vec2::new(x as f32, y as f32) + 0.5;
                    assert!(
                        (weights.element_sum() - 1.0).abs() < 1e-6 && point.distance(centre) < 1e-5,
                        "{point} {centre}"
                    );
                });
            }
            assert!(count.values().all(|&n| n == 1), "{count:?}");
            // The area is 72; half of the centres on its outline belong to it.
            assert!((68..=76).contains(&count.len()), "{}", count.len());
        }
    }

    #[test]
    fn triangles_without_area_cover_nothing() {
        let nowhere = |_, _, _| panic!("covered");
        covered([Vec2::ZERO, Vec2::splat(4.0), Vec2::splat(9.0)], nowhere);
        covered([Vec2::ZERO, Vec2::NAN, Vec2::X], nowhere);
    }
}
