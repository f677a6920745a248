//! Solids that rays hit: nearest intersection, outward normal and signed distance. Lengths in metres.

use glam::{DMat3, DVec3};

/// A ray with a unit direction.
#[derive(Clone, Copy)]
pub(super) struct Ray {
    /// Start point in world space.
    pub origin: DVec3,
    /// Unit direction in world space.
    pub direction: DVec3,
}

impl Ray {
    /// The point `t` metres along the ray.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }

    /// The ray in the frame of a placed solid (a rigid motion, so lengths stay).
    fn local(&self, center: DVec3, world_from_local: &DMat3) -> Ray {
        let local_from_world = world_from_local.transpose();
        Ray { origin: local_from_world * (self.origin - center), direction: local_from_world * self.direction }
    }
}

/// Where a ray enters a solid.
#[derive(Clone, Copy)]
pub(super) struct Entry {
    /// Distance along the ray.
    pub t: f64,
    /// Unit outward normal in the frame of the solid.
    pub normal: DVec3,
    /// Hit point in the frame of the solid.
    pub local: DVec3,
}

/// The form of a solid in its own frame, centred at the origin.
#[derive(Clone, Copy)]
pub(super) enum Form {
    /// A box with these half extents.
    Cuboid(DVec3),
    /// A sphere of this radius.
    Sphere(f64),
    /// A ring around the local z axis.
    Torus {
        /// Distance of the tube's centre line from the axis.
        major: f64,
        /// Radius of the tube.
        minor: f64,
    },
}

/// A form placed in the world.
#[derive(Clone, Copy)]
pub(super) struct Solid {
    /// The form in its own frame.
    pub form: Form,
    /// Centre in world space.
    pub center: DVec3,
    /// Rotation of the frame.
    pub world_from_local: DMat3,
}

impl Solid {
    /// Nearest entry, closer than `reach`, of a ray that starts outside.
    pub fn enter(&self, ray: &Ray, reach: f64) -> Option<Entry> {
        let offset = self.center - ray.origin;
        let along = offset.dot(ray.direction);
        let (aside, bound) = (offset.length_squared() - along * along, self.bound_squared());
        let before = along.max(0.0) - reach;
        if aside > bound * 1.000_001 || (along < 0.0 && offset.length_squared() > bound) {
            return None;
        }
        if before > 0.0 && before * before > bound {
            return None;
        }
        self.enter_exactly(ray).filter(|entry| entry.t < reach)
    }

    fn enter_exactly(&self, ray: &Ray) -> Option<Entry> {
        let ray = ray.local(self.center, &self.world_from_local);
        match self.form {
            Form::Cuboid(half) => enter_cuboid(&ray, half),
            Form::Sphere(radius) => {
                let (t, _) = sphere_span(&ray, radius)?;
                let local = ray.at(t);
                (t > 0.0).then(|| Entry { t, normal: local / radius, local })
            }
            Form::Torus { major, minor } => enter_torus(&ray, major, minor),
        }
    }

    /// Signed distance of a world point to the surface, negative inside.
    pub fn distance(&self, world: DVec3) -> f64 {
        let p = self.world_from_local.transpose() * (world - self.center);
        match self.form {
            Form::Cuboid(half) => {
                let q = p.abs() - half;
                q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
            }
            Form::Sphere(radius) => p.length() - radius,
            Form::Torus { major, minor } => torus_distance(p, major, minor),
        }
    }

    /// Squared radius of the sphere around the centre that holds the solid.
    pub fn bound_squared(&self) -> f64 {
        match self.form {
            Form::Cuboid(half) => half.length_squared(),
            Form::Sphere(radius) => radius * radius,
            Form::Torus { major, minor } => (major + minor) * (major + minor),
        }
    }

    /// Half extents of the axis-aligned world box around the solid.
    pub fn world_half(&self) -> DVec3 {
        let half = match self.form {
            Form::Cuboid(half) => half,
            Form::Sphere(radius) => return DVec3::splat(radius),
            Form::Torus { major, minor } => DVec3::new(major + minor, major + minor, minor),
        };
        let m = self.world_from_local;
        m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z
    }
}

/// Distances at which a ray enters and leaves an origin-centred box; `None` when it misses.
pub(super) fn box_span(ray: &Ray, half: DVec3) -> Option<(f64, f64)> {
    let inverse = ray.direction.recip();
    let (a, b) = ((-half - ray.origin) * inverse, (half - ray.origin) * inverse);
    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
    (enter <= leave && leave > 0.0).then_some((enter, leave))
}

/// The axis on which a point of a box surface lies, as an outward unit vector.
pub(super) fn box_normal(local: DVec3, half: DVec3) -> DVec3 {
    let q = (local / half).abs();
    if q.x >= q.y && q.x >= q.z {
        DVec3::X * local.x.signum()
    } else if q.y >= q.z {
        DVec3::Y * local.y.signum()
    } else {
        DVec3::Z * local.z.signum()
    }
}

fn enter_cuboid(ray: &Ray, half: DVec3) -> Option<Entry> {
    let (t, _) = box_span(ray, half)?;
    let local = ray.at(t);
    (t > 0.0).then(|| Entry { t, normal: box_normal(local, half), local })
}

/// Distances at which a ray enters and leaves an origin-centred sphere.
pub(super) fn sphere_span(ray: &Ray, radius: f64) -> Option<(f64, f64)> {
    let b = ray.origin.dot(ray.direction);
    let discriminant = b * b - ray.origin.length_squared() + radius * radius;
    if discriminant < 0.0 {
        return None;
    }
    let root = discriminant.sqrt();
    Some((-b - root, -b + root))
}

fn torus_distance(p: DVec3, major: f64, minor: f64) -> f64 {
    let q = (p.x * p.x + p.y * p.y).sqrt() - major;
    (q * q + p.z * p.z).sqrt() - minor
}

fn torus_normal(p: DVec3, major: f64) -> DVec3 {
    let axis_distance = (p.x * p.x + p.y * p.y).sqrt().max(1e-12);
    let ring = DVec3::new(p.x, p.y, 0.0) * (major / axis_distance);
    (p - ring).normalize()
}

/// Sphere tracing down to a tenth of a millimetre, then Newton steps to the exact surface.
fn enter_torus(ray: &Ray, major: f64, minor: f64) -> Option<Entry> {
    const CLOSE: f64 = 1e-4;
    let (start, end) = sphere_span(ray, major + minor)?;
    let mut t = start.max(0.0);
    for _ in 0..256 {
        if t > end {
            return None;
        }
        let distance = torus_distance(ray.at(t), major, minor);
        if distance < CLOSE
            && let Some(entry) = polish_torus(ray, t, major, minor)
        {
            return Some(entry);
        }
        t += distance.max(CLOSE);
    }
    None
}

fn polish_torus(ray: &Ray, mut t: f64, major: f64, minor: f64) -> Option<Entry> {
    for _ in 0..6 {
        let local = ray.at(t);
        let normal = torus_normal(local, major);
        let slope = normal.dot(ray.direction);
        let distance = torus_distance(local, major, minor);
        if slope >= -1e-6 {
            return None;
        }
        if distance.abs() < 1e-11 {
            return (t > 0.0).then_some(Entry { t, normal, local });
        }
        t -= distance / slope;
    }
    None
}
