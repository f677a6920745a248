//! The furniture of the demo room. World axes: z up, floor at z = 0, photos are taken from -y. Lengths in metres.

use super::figure::Figure;
use super::numeric::sin_cos;
use super::shape::{Entry, Form, Ray, Solid, box_normal, box_span};
use super::texture::{ROOM_HALF, Texture};
use glam::{DMat3, DVec3};
use std::sync::LazyLock;

/// Object id of the room's walls, floor and ceiling.
pub const ROOM: u8 = 0;
/// Object id of the table (matt).
pub const TABLE: u8 = 1;
/// Object id of the lacquered sphere: a coloured surface under a sharp clear coat.
pub const GLOSSY_SPHERE: u8 = 2;
/// Object id of the mirror ball.
pub const MIRROR: u8 = 3;
/// Object id of the mirror ball's wooden stand (matt).
pub const STAND: u8 = 4;
/// Object id of the golden ring: a tinted mirror.
pub const RING: u8 = 5;
/// Object id of the cube with signs (matt).
pub const CUBE: u8 = 6;
/// Object id of the patched ball (matt).
pub const BALL: u8 = 7;
/// Object id of the lamps, which shine.
pub const LAMP: u8 = 8;
/// Object id of a walker, who stands in single photos and is no part of the scene.
pub(super) const WALKER: u8 = 9;

/// Whether the colour of an object depends on where it is seen from: the glossy and mirror-like ones.
pub fn is_view_dependent(object: u8) -> bool {
    matches!(object, GLOSSY_SPHERE | MIRROR | RING)
}

/// Centre of the room.
const ROOM_CENTER: DVec3 = DVec3::new(0.0, 0.0, ROOM_HALF.z);
/// Distance of the rooms of a street, which lie side by side along x without walls between them.
pub(super) const ROOM_PITCH: f64 = 2.0 * ROOM_HALF.x;
/// Lamps of a room light up so many rooms on either side of it.
const LIT_ROOMS: usize = 2;
/// Height of the table top.
pub(super) const TABLE_TOP: f64 = 0.42;

/// How a surface answers to light.
#[derive(Clone, Copy)]
pub(super) struct Material {
    /// Colour of the matt part.
    pub texture: Texture,
    /// Mirror reflectance seen from straight above; zero for matt surfaces.
    pub reflectance: DVec3,
    /// Strength of the blurred highlight around the mirror image of a lamp.
    pub sheen: f64,
}

/// A solid with an id and a material.
pub(super) struct Object {
    /// One of the id constants.
    pub id: u8,
    /// Its shape and place.
    pub solid: Solid,
    /// Its surface.
    pub material: Material,
}

/// A small round lamp.
pub(super) struct Lamp {
    /// Its ball.
    pub solid: Solid,
    /// Radius of the ball.
    pub radius: f64,
    /// Radiant intensity (linear, arbitrary unit).
    pub intensity: DVec3,
}

/// Everything a ray can hit.
pub(super) struct Scene {
    /// Number of rooms, each with the same furniture and lamps.
    rooms: usize,
    /// Solids on and including the table, of the first room.
    pub objects: Vec<Object>,
    /// The lights of the first room.
    pub lamps: Vec<Lamp>,
    /// Somebody in the first room, in one photo.
    pub walker: Option<Figure>,
    /// Box around all objects: centre and half extents.
    cluster: (DVec3, DVec3),
}

/// What a ray meets first.
#[derive(Clone, Copy)]
pub(super) struct Hit {
    /// Object id.
    pub id: u8,
    /// Index into the lamps, the objects or the walker's parts (0 for the room).
    pub index: usize,
    /// Distance along the ray.
    pub t: f64,
    /// Unit normal in world space, facing the ray's origin.
    pub normal: DVec3,
    /// Hit point and outward normal in the frame of the solid.
    pub local: (DVec3, DVec3),
}

/// Radius of every lamp.
const LAMP_RADIUS: f64 = 0.09;

const MATT: DVec3 = DVec3::ZERO;

/// The one scene.
pub(super) fn scene() -> &'static Scene {
    static SCENE: LazyLock<Scene> = LazyLock::new(|| Scene::street(1));
    &SCENE
}

/// Rotation by `turn` about z after `tilt` about x, both in degrees.
fn rotation(turn: f64, tilt: f64) -> DMat3 {
    let ((s, c), (ts, tc)) = (sin_cos(turn.to_radians()), sin_cos(tilt.to_radians()));
    let about_z = DMat3::from_cols(DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0), DVec3::Z);
    let about_x = DMat3::from_cols(DVec3::X, DVec3::new(0.0, tc, ts), DVec3::new(0.0, -ts, tc));
    about_z * about_x
}

fn object(
    id: u8,
    form: Form,
    center: DVec3,
    pose: (f64, f64),
    texture: Texture,
    reflectance: DVec3,
    sheen: f64,
) -> Object {
    Object {
        id,
        solid: Solid { form, center, world_from_local: rotation(pose.0, pose.1) },
        material: Material { texture, reflectance, sheen },
    }
}

impl Scene {
    /// Rooms side by side; one of them is the demo scene.
    pub fn street(rooms: usize) -> Scene {
        let objects = furniture();
        let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
        for Object { solid, .. } in &objects {
            low = low.min(solid.center - solid.world_half());
            high = high.max(solid.center + solid.world_half());
        }
        let lamp = |x: f64, y: f64, z: f64, r: f64, g: f64, b: f64| Lamp {
            solid: Solid {
                form: Form::Sphere(LAMP_RADIUS),
                center: DVec3::new(x, y, z),
                world_from_local: DMat3::IDENTITY,
            },
            radius: LAMP_RADIUS,
            intensity: DVec3::new(r, g, b),
        };
        Scene {
            rooms,
            objects,
            lamps: vec![
                lamp(-1.15, -1.05, 2.25, 1.95, 1.64, 1.25),
                lamp(1.25, -0.75, 2.30, 1.56, 1.56, 1.64),
                lamp(0.10, 1.20, 2.20, 1.69, 1.37, 1.04),
            ],
            walker: None,
            cluster: ((low + high) / 2.0, (high - low) / 2.0 + DVec3::splat(1e-6)),
        }
    }

    /// The one scene with somebody in it.
    pub fn with(walker: Figure) -> Scene {
        Scene { walker: Some(walker), ..Scene::street(1) }
    }

    /// Centre of all rooms.
    pub fn center(&self) -> DVec3 {
        ROOM_CENTER + DVec3::X * (ROOM_PITCH / 2.0 * (self.rooms - 1) as f64)
    }

    /// Half extents of all rooms.
    pub fn half(&self) -> DVec3 {
        ROOM_HALF * DVec3::new(self.rooms as f64, 1.0, 1.0)
    }

    /// The room of a point.
    fn room_of(&self, point: DVec3) -> usize {
        ((point.x / ROOM_PITCH).round().max(0.0) as usize).min(self.rooms - 1)
    }

    /// The rooms that a ray crosses up to distance `reach`, in its order; every object lies inside its room.
    fn rooms_along(&self, ray: &Ray, reach: f64) -> impl Iterator<Item = usize> + use<> {
        let (first, last) = (self.room_of(ray.origin), self.room_of(ray.at(reach)));
        (0..=first.abs_diff(last)).map(move |step| if last > first { first + step } else { first - step })
    }

    /// The lamps that light up a point: each with the offset of its room.
    pub fn lamps_near(&self, point: DVec3) -> impl Iterator<Item = (&Lamp, DVec3)> {
        let room = self.room_of(point);
        let rooms = room.saturating_sub(LIT_ROOMS)..=(room + LIT_ROOMS).min(self.rooms - 1);
        rooms.flat_map(|room| self.lamps.iter().map(move |lamp| (lamp, room_offset(room))))
    }

    /// The first surface along a ray that starts inside the room.
    pub fn nearest(&self, ray: &Ray) -> Hit {
        let mut hit = self.room_hit(ray);
        let first = self.room_of(ray.origin);
        for room in self.rooms_along(ray, hit.t) {
            // What was met lies in a room before this one.
            if first.abs_diff(room) > first.abs_diff(self.room_of(ray.at(hit.t))) {
                break;
            }
            let ray = in_room(ray, room);
            let mut offer = |id: u8, index: usize, solid: &Solid| {
                if let Some(Entry { t, normal, local }) = solid.enter(&ray, hit.t) {
                    let facing = solid.world_from_local * normal;
                    hit = Hit { id, index, t, normal: facing, local: (local, normal) };
                }
            };
            if self.meets_cluster(&ray) {
                for (index, object) in self.objects.iter().enumerate() {
                    offer(object.id, index, &object.solid);
                }
            }
            for (index, lamp) in self.lamps.iter().enumerate() {
                offer(LAMP, index, &lamp.solid);
            }
        }
        if let Some((index, Entry { t, normal, local })) = self.meets_walker(ray, hit.t) {
            hit = Hit { id: WALKER, index, t, normal, local: (local, normal) };
        }
        hit
    }

    /// Whether an object or a walker (not a lamp, not a wall) is on the ray before distance `reach`.
    pub fn blocked(&self, ray: &Ray, reach: f64) -> bool {
        let mut rooms = self.rooms_along(ray, reach).map(|room| in_room(ray, room));
        self.meets_walker(ray, reach).is_some()
            || rooms.any(|ray| {
                self.meets_cluster(&ray) && self.objects.iter().any(|object| object.solid.enter(&ray, reach).is_some())
            })
    }

    /// Whether a ray meets a walker first.
    pub fn shows_walker(&self, ray: &Ray) -> bool {
        self.meets_walker(ray, f64::MAX).is_some() && self.nearest(ray).id == WALKER
    }

    /// The part of the walker, if there is one, that a ray enters first before distance `reach`.
    fn meets_walker(&self, ray: &Ray, reach: f64) -> Option<(usize, Entry)> {
        self.walker.as_ref()?.enter(ray, reach)
    }

    /// Distance in metres from a point inside the room to the nearest surface, lamps included.
    pub fn distance(&self, point: DVec3) -> f64 {
        let walls = self.room_clearance(point).abs();
        let point = point - room_offset(self.room_of(point));
        let lamps = self.lamps.iter().map(|lamp| lamp.solid.distance(point).abs());
        let objects = self.objects.iter().map(|object| object.solid.distance(point).abs());
        lamps.chain(objects).fold(walls, f64::min)
    }

    /// Distance of a point to the nearest wall, positive inside the room.
    fn room_clearance(&self, point: DVec3) -> f64 {
        (self.half() - (point - self.center()).abs()).min_element()
    }

    /// The wall a ray from inside the room ends at.
    fn room_hit(&self, ray: &Ray) -> Hit {
        let (center, half) = (self.center(), self.half());
        let shifted = Ray { origin: ray.origin - center, ..*ray };
        let t = box_span(&shifted, half).map_or(0.0, |(_, leave)| leave);
        let at = shifted.at(t);
        let outward = box_normal(at, half);
        // Every room has the same walls.
        let along = center.x - room_offset(self.room_of(at + center)).x;
        let local = DVec3::new(at.x + along, at.y, at.z);
        Hit { id: ROOM, index: 0, t, normal: -outward, local: (local, outward) }
    }

    /// Signed distance to the walls, a walker and, near the table, the objects: what dims ambient light.
    pub fn clearance(&self, point: DVec3) -> f64 {
        let mut nearest = self.room_clearance(point);
        if let Some(walker) = &self.walker {
            nearest = walker.distance(point, nearest);
        }
        let point = point - room_offset(self.room_of(point));
        let margin = (point - self.cluster.0).abs() - self.cluster.1;
        if margin.max_element() < nearest {
            for object in &self.objects {
                nearest = nearest.min(object.solid.distance(point));
            }
        }
        nearest
    }

    fn meets_cluster(&self, ray: &Ray) -> bool {
        let shifted = Ray { origin: ray.origin - self.cluster.0, ..*ray };
        box_span(&shifted, self.cluster.1).is_some()
    }
}

fn furniture() -> Vec<Object> {
    let mut objects = matt_objects();
    objects.extend(shiny_objects());
    objects
}

/// A point above the table's centre, `z` from its top.
fn on_table(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, TABLE_TOP + z)
}

fn cuboid(x: f64, y: f64, z: f64) -> Form {
    Form::Cuboid(DVec3::new(x, y, z))
}

fn matt_objects() -> Vec<Object> {
    let upright = (0.0, 0.0);
    vec![
        object(TABLE, cuboid(0.66, 0.56, 0.21), on_table(0.0, 0.0, -0.21), upright, Texture::Table, MATT, 0.0),
        object(STAND, cuboid(0.14, 0.14, 0.05), on_table(0.10, 0.24, 0.05), upright, Texture::DarkWood, MATT, 0.0),
        object(CUBE, cuboid(0.1, 0.1, 0.1), on_table(0.46, -0.02, 0.1), (27.0, 0.0), Texture::Cube, MATT, 0.0),
        object(BALL, Form::Sphere(0.085), on_table(-0.07, -0.36, 0.085), (20.0, 25.0), Texture::Ball, MATT, 0.0),
    ]
}

fn shiny_objects() -> Vec<Object> {
    let plain = Texture::Plain;
    vec![
        object(
            GLOSSY_SPHERE,
            Form::Sphere(0.21),
            on_table(-0.30, -0.10, 0.21),
            (0.0, 0.0),
            plain(DVec3::new(0.40, 0.012, 0.016)),
            DVec3::splat(0.085),
            14.0,
        ),
        object(
            MIRROR,
            Form::Sphere(0.24),
            on_table(0.10, 0.24, 0.34),
            (0.0, 0.0),
            plain(DVec3::splat(0.01)),
            DVec3::new(0.86, 0.89, 0.90),
            0.0,
        ),
        object(
            RING,
            Form::Torus { major: 0.125, minor: 0.042 },
            on_table(0.17, -0.26, 0.167),
            (38.0, 90.0),
            plain(DVec3::new(0.02, 0.014, 0.004)),
            DVec3::new(0.88, 0.62, 0.24),
            3.0,
        ),
    ]
}

/// Where a room of a street lies.
pub(super) fn room_offset(room: usize) -> DVec3 {
    DVec3::X * (ROOM_PITCH * room as f64)
}

/// A ray in the coordinates of a room.
fn in_room(ray: &Ray, room: usize) -> Ray {
    Ray { origin: ray.origin - room_offset(room), ..*ray }
}
