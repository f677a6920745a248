//! The body of a walker, made of capsules. Lengths in metres.

use super::numeric::{Stream, sin_cos};
use super::shape::{Entry, Ray, sphere_span};
use glam::{DVec2, DVec3};

/// Colours that nothing else in the room has, in linear light.
const COLORS: [DVec3; 6] = [
    DVec3::new(0.75, 0.02, 0.50),
    DVec3::new(0.30, 0.80, 0.02),
    DVec3::new(0.01, 0.55, 0.80),
    DVec3::new(0.28, 0.03, 0.70),
    DVec3::new(0.90, 0.75, 0.02),
    DVec3::new(0.90, 0.10, 0.30),
];

/// All points that are no farther than `radius` from a line between two ends.
struct Capsule {
    ends: [DVec3; 2],
    radius: f64,
    /// Matt colour.
    color: DVec3,
}

impl Capsule {
    /// The point of the line between the ends that is nearest to a point.
    fn nearest_of_axis(&self, point: DVec3) -> DVec3 {
        let [from, to] = self.ends;
        let along = to - from;
        let share = (point - from).dot(along) / along.length_squared().max(1e-12);
        from + along * share.clamp(0.0, 1.0)
    }

    /// Signed distance of a point to the surface, negative inside.
    fn distance(&self, point: DVec3) -> f64 {
        point.distance(self.nearest_of_axis(point)) - self.radius
    }

    /// Where a ray that starts outside enters: into one of the balls at the ends, or through the wall between them.
    fn enter(&self, ray: &Ray) -> Option<f64> {
        let balls = self.ends.map(|end| {
            let (enter, _) = sphere_span(&Ray { origin: ray.origin - end, ..*ray }, self.radius)?;
            Some(enter)
        });
        balls.into_iter().chain([self.enter_wall(ray)]).flatten().filter(|&t| t > 0.0).min_by(f64::total_cmp)
    }

    fn enter_wall(&self, ray: &Ray) -> Option<f64> {
        let along = self.ends[1] - self.ends[0];
        let length = along.length();
        if length < 1e-6 {
            return None;
        }
        // The ray without its part along the axis meets a circle.
        let axis = along / length;
        let offset = ray.origin - self.ends[0];
        let (across, direction) = (offset - axis * offset.dot(axis), ray.direction - axis * ray.direction.dot(axis));
        let (a, b) = (direction.length_squared(), direction.dot(across));
        let discriminant = b * b - a * (across.length_squared() - self.radius * self.radius);
        if a < 1e-12 || discriminant < 0.0 {
            return None;
        }
        let t = (-b - discriminant.sqrt()) / a;
        let height = (offset + ray.direction * t).dot(axis);
        (0.0..=length).contains(&height).then_some(t)
    }
}

/// A walker in a pose.
pub(super) struct Figure {
    parts: Vec<Capsule>,
    /// A ball around all parts: centre and radius.
    bound: (DVec3, f64),
}

impl Figure {
    /// Somebody of this height who stands on the floor at `place` and walks somewhere; the stream decides where to and how.
    pub fn walking(place: DVec2, height: f64, random: &mut Stream) -> Self {
        let (sin, cos) = sin_cos(std::f64::consts::PI * random.signed());
        let at = |ahead: f64, left: f64, up: f64| {
            let floor = DVec2::new(cos, sin) * ahead + DVec2::new(-sin, cos) * left;
            (place + floor * height).extend(up * height)
        };
        let first = random.below(COLORS.len());
        let second = (first + 1 + random.below(COLORS.len() - 1)) % COLORS.len();
        let [above, below] = [COLORS[first], COLORS[second]];
        let stride = 0.06 + 0.11 * random.uniform();
        let (swing, lean) = (stride * (0.6 + 0.6 * random.uniform()), 0.04 * random.uniform());
        let waves = random.uniform() < 0.4;
        let mut parts = Vec::new();
        let mut part = |color: DVec3, ends: [DVec3; 2], radius: f64| {
            parts.push(Capsule { ends, radius: radius * height, color });
        };
        for (side, ahead) in [(1.0, stride), (-1.0, -stride)] {
            let knee = at(0.55 * ahead + 0.035, 0.056 * side, 0.28);
            let heel = at(ahead, 0.058 * side, 0.045);
            part(below, [at(0.0, 0.055 * side, 0.52), knee], 0.056);
            part(below, [knee, heel], 0.042);
            part(below, [at(ahead, 0.058 * side, 0.032), at(ahead + 0.085, 0.068 * side, 0.032)], 0.03);
            let shoulder = at(lean, 0.125 * side, 0.785);
            let (elbow, hand) = if waves && side > 0.0 {
                (at(lean + 0.05, 0.26, 0.84), at(lean + 0.08, 0.25, 0.99))
            } else {
                (
                    at(lean - 0.5 * ahead.signum() * swing, 0.165 * side, 0.635),
                    at(-ahead.signum() * swing, 0.16 * side, 0.49),
                )
            };
            part(above, [shoulder, elbow], 0.038);
            part(above, [elbow, hand], 0.032);
        }
        part(above, [at(0.0, 0.0, 0.56), at(lean, 0.0, 0.74)], 0.095);
        part(above, [at(lean, -0.085, 0.785), at(lean, 0.085, 0.785)], 0.052);
        part(below, [at(lean, 0.0, 0.8), at(lean + 0.01, 0.0, 0.9)], 0.035);
        part(below, [at(lean + 0.012, 0.0, 0.915), at(lean + 0.012, 0.0, 0.925)], 0.072);
        let center = place.extend(0.5 * height);
        let reach = |part: &Capsule| part.ends.map(|end| end.distance(center) + part.radius);
        let radius = parts.iter().flat_map(reach).fold(0.0, f64::max);
        Figure { parts, bound: (center, radius) }
    }

    /// Nearest entry, closer than `reach`, of a ray that starts outside: the part, and where. Positions stay in world space.
    pub fn enter(&self, ray: &Ray, reach: f64) -> Option<(usize, Entry)> {
        let offset = self.bound.0 - ray.origin;
        let along = offset.dot(ray.direction).max(0.0);
        if offset.distance_squared(ray.direction * along) > self.bound.1 * self.bound.1 {
            return None;
        }
        let entries = self.parts.iter().enumerate().filter_map(|(index, part)| Some((index, part.enter(ray)?)));
        let (index, t) = entries.filter(|&(_, t)| t < reach).min_by(|a, b| a.1.total_cmp(&b.1))?;
        let local = ray.at(t);
        let normal = (local - self.parts[index].nearest_of_axis(local)).normalize();
        Some((index, Entry { t, normal, local }))
    }

    /// Matt colour of a part.
    pub fn color(&self, part: usize) -> DVec3 {
        self.parts[part].color
    }

    /// Signed distance of a point to the nearest part, or `most` where that is less.
    pub fn distance(&self, point: DVec3, most: f64) -> f64 {
        if point.distance(self.bound.0) - self.bound.1 >= most {
            return most;
        }
        self.parts.iter().map(|part| part.distance(point)).fold(most, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_enter_where_the_distance_is_zero() {
        let mut random = Stream::new(5, 9, 0);
        let figure = Figure::walking(DVec2::new(0.4, -0.3), 1.3, &mut random);
        let mut met = 0;
        for _ in 0..2_000 {
            let mut place = || DVec3::new(random.signed(), random.signed(), random.uniform());
            let (origin, target) = (place() * 4.0, place() * DVec3::new(0.4, 0.3, 1.3) + DVec3::new(0.4, -0.3, 0.0));
            if figure.distance(origin, 9.0) <= 0.0 {
                continue;
            }
            let ray = Ray { origin, direction: (target - origin).normalize() };
            // Steps as long as the distance never pass the surface.
            let mut reached = 0.0;
            for _ in 0..4_000 {
                reached += figure.distance(ray.at(reached), 9.0);
            }
            match figure.enter(&ray, 20.0) {
                Some((_, entry)) => {
                    met += 1;
                    assert!(figure.distance(entry.local, 9.0).abs() < 1e-9);
                    assert!((entry.t - reached).abs() < 1e-3, "entry at {}, surface at {reached}", entry.t);
                    assert!((entry.normal.length() - 1.0).abs() < 1e-12 && entry.normal.dot(ray.direction) < 1e-9);
                    assert!(figure.enter(&ray, 0.999 * entry.t).is_none());
                }
                None => assert!(reached > 20.0, "the ray meets the surface at {reached}"),
            }
        }
        assert!(met > 500, "{met} rays meet the walker");
    }
}
