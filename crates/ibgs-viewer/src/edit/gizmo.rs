//! The gizmo: handles at the middle of the model that move, turn and scale it along and about the axes of the file. Draws nothing.

use super::{Edit, Tool};
use glam::{DMat3, DVec2, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::similarity::Similarity;
use std::f64::consts::TAU;

/// Length of an arrow, in heights of the image.
const ARROW: f64 = 0.2;
/// Radius of a ring over the length of an arrow.
const RING: f64 = 0.75;
/// Where an arrow begins, over its length.
const BEGIN: f64 = 0.15;
/// Corners of a ring.
const CORNERS: u32 = 48;
/// Parts of a ring that lie farther behind its middle than this share of its radius are hidden.
const BEHIND: f64 = 0.1;
/// An arrow that points to the camera, or away from it, nearer than by an angle of this sine has no way to go.
const LEAST_SINE: f64 = 0.15;
/// A drag over the height of the image scales by 2 to the power of this.
const SCALE: f64 = 4.0;

/// A part of the gizmo; axes are 0 for x, 1 for y, 2 for z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    /// An arrow, which moves along an axis.
    Move(usize),
    /// A ring, which turns about an axis.
    Turn(usize),
    /// The middle, which scales.
    Scale,
}

impl Handle {
    /// All of them; the first ones are grabbed before the others.
    pub const ALL: [Self; 7] =
        [Self::Scale, Self::Move(0), Self::Move(1), Self::Move(2), Self::Turn(0), Self::Turn(1), Self::Turn(2)];
}

/// The gizmo as a camera sees it, all in the coordinates of the file.
#[derive(Clone, Copy, Debug)]
pub struct Gizmo {
    /// The camera.
    pub camera: Camera,
    middle: DVec3,
    /// Length of an arrow.
    length: f64,
}

impl Gizmo {
    /// The gizmo around a point of the scene, for a camera of the scene; none where the camera does not see that point.
    pub fn of(placement: &Similarity, camera: &Camera, center: DVec3) -> Option<Self> {
        camera.seen(center)?;
        let (camera, middle) = (placement.camera(camera), placement.point(center));
        let length = ARROW * f64::from(camera.height) / camera.focal.y * camera.to_view(middle).z;
        Some(Self { camera, middle, length })
    }

    /// The lines of a handle; none where it cannot be used from here.
    pub fn lines(&self, handle: Handle) -> Vec<[DVec3; 2]> {
        let out = (self.camera.center() - self.middle).normalize();
        match handle {
            Handle::Move(axis) => {
                let way = DVec3::AXES[axis];
                let ends = [BEGIN, 1.0].map(|part| self.middle + part * self.length * way);
                if out.cross(way).length() < LEAST_SINE { Vec::new() } else { vec![ends] }
            }
            Handle::Turn(axis) => {
                let (x, y) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
                let corner = |i: u32| {
                    let angle = TAU * f64::from(i) / f64::from(CORNERS);
                    angle.cos() * x + angle.sin() * y
                };
                let sides = (0..CORNERS).map(|i| [corner(i), corner(i + 1)]);
                let seen = sides.filter(|side| side.iter().all(|corner| corner.dot(out) > -BEHIND));
                seen.map(|side| side.map(|corner| self.middle + RING * self.length * corner)).collect()
            }
            Handle::Scale => vec![[self.middle; 2]],
        }
    }

    /// What a place of the image, 0 to 1 in both directions, means to a handle: the length along its axis, the angle about it, or
    /// the logarithm of the scale. None where the place says nothing.
    fn value(&self, handle: Handle, at: DVec2) -> Option<f64> {
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        let (ray, offset) = (self.camera.ray(at * size), self.middle - self.camera.center());
        match handle {
            Handle::Move(axis) => {
                // The point of the axis that is nearest to the ray.
                let cosine = ray[axis];
                let along = (cosine * offset.dot(ray) - offset[axis]) / (1.0 - cosine * cosine);
                let is_ahead = offset.dot(ray) + along * cosine > 0.0;
                (is_ahead && along.is_finite()).then_some(along)
            }
            Handle::Turn(axis) => {
                // Where the ray meets a ball, or passes nearest to it.
                let nearest = ray * offset.dot(ray) - offset;
                let inside = (RING * self.length).powi(2) - nearest.length_squared();
                let on_ball = nearest - ray * inside.max(0.0).sqrt();
                let (x, y) = (on_ball[(axis + 1) % 3], on_ball[(axis + 2) % 3]);
                (x.hypot(y) > 1e-3 * self.length).then(|| y.atan2(x))
            }
            Handle::Scale => Some(SCALE * ((at.x * size.x - at.y * size.y) / size.y)),
        }
    }
}

/// A handle that the pointer holds.
#[derive(Clone, Copy, Debug)]
pub struct Held {
    /// Which one.
    pub handle: Handle,
    /// Where the model stood, and the middle of the gizmo.
    from: Similarity,
    middle: DVec3,
    /// What the place meant where it was grabbed.
    first: f64,
}

impl Held {
    /// Where the model stands when the pointer is at a place of the image.
    fn placement(&self, gizmo: &Gizmo, at: DVec2) -> Option<Similarity> {
        let change = gizmo.value(self.handle, at)? - self.first;
        let about = |scale: f64, rotation: DMat3| Similarity {
            scale,
            rotation,
            translation: self.middle - scale * (rotation * self.middle),
        };
        let by = match self.handle {
            Handle::Move(axis) => Similarity { translation: change * DVec3::AXES[axis], ..Similarity::IDENTITY },
            Handle::Turn(axis) => about(1.0, DMat3::from_axis_angle(DVec3::AXES[axis], change)),
            Handle::Scale => about(change.exp2(), DMat3::IDENTITY),
        };
        Some(self.from.then(&by))
    }
}

impl Edit {
    /// Whether the gizmo is taken up.
    pub fn uses_gizmo(&self) -> bool {
        self.shown && self.tool == Some(Tool::Gizmo)
    }

    /// The gizmo, where it is taken up and seen.
    pub fn gizmo(&self, camera: &Camera, center: DVec3) -> Option<Gizmo> {
        let editor = self.editor.as_ref().filter(|_| self.uses_gizmo())?;
        Gizmo::of(editor.placement(), camera, center)
    }

    /// The handle that the pointer holds.
    pub fn held(&self) -> Option<Handle> {
        self.held.as_ref().map(|held| held.handle)
    }

    /// The pointer grabs a handle at a place of the image, which begins a step.
    pub fn hold(&mut self, handle: Handle, gizmo: &Gizmo, at: DVec2) {
        self.lift();
        if let (Some(editor), Some(first)) = (&mut self.editor, gizmo.value(handle, at)) {
            self.held = Some(Held { handle, from: *editor.placement(), middle: gizmo.middle, first });
            editor.begin();
        }
    }

    /// It drags the handle to another place.
    pub fn drag(&mut self, gizmo: &Gizmo, at: DVec2) {
        if let (Some(editor), Some(held)) = (&mut self.editor, &self.held)
            && let Some(placement) = held.placement(gizmo, at)
        {
            editor.change_placement(placement);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigator::Navigator;

    const CENTER: DVec3 = DVec3::new(1.0, 2.0, 3.0);

    fn camera() -> Camera {
        let mut navigator = Navigator::facing(CENTER, 4.0);
        navigator.orbit(0.5, -0.4);
        navigator.camera(600, 400)
    }

    fn placement() -> Similarity {
        let rotation = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(0.4);
        Similarity { scale: 2.0, rotation, translation: DVec3::new(5.0, -1.0, 0.5) }
    }

    fn share(gizmo: &Gizmo, point: DVec3) -> DVec2 {
        gizmo.camera.project(point).0 / DVec2::new(600.0, 400.0)
    }

    /// Drags a handle from the place of one point to that of another one.
    fn dragged(handle: Handle, from: DVec3, to: DVec3) -> Similarity {
        let gizmo = Gizmo::of(&placement(), &camera(), CENTER).unwrap();
        let first = gizmo.value(handle, share(&gizmo, from)).unwrap();
        let held = Held { handle, from: placement(), middle: gizmo.middle, first };
        held.placement(&gizmo, share(&gizmo, to)).unwrap()
    }

    #[test]
    fn an_arrow_moves_what_is_grabbed_under_the_pointer() {
        let gizmo = Gizmo::of(&placement(), &camera(), CENTER).unwrap();
        assert!(gizmo.middle.abs_diff_eq(placement().point(CENTER), 1e-12));
        for axis in 0..3 {
            let [[_, tip]] = gizmo.lines(Handle::Move(axis))[..] else { panic!("axis {axis} has no arrow") };
            let length = share(&gizmo, tip).distance(share(&gizmo, gizmo.middle));
            assert!((0.02..0.3).contains(&length), "{length}");
            for way in [0.7, -1.1] {
                let after = dragged(Handle::Move(axis), tip, tip + way * DVec3::AXES[axis]);
                let wanted = Similarity { translation: way * DVec3::AXES[axis], ..Similarity::IDENTITY };
                assert!(after.point(CENTER).abs_diff_eq(placement().then(&wanted).point(CENTER), 1e-9), "{after:?}");
                assert_eq!((after.scale, after.rotation), (placement().scale, placement().rotation));
            }
        }
    }

    #[test]
    fn a_ring_turns_about_the_middle() {
        let gizmo = Gizmo::of(&placement(), &camera(), CENTER).unwrap();
        for axis in 0..3 {
            let sides = gizmo.lines(Handle::Turn(axis));
            assert!(sides.len() > 20, "{}", sides.len());
            // Of the part that no other part of the ball hides.
            let out = gizmo.camera.center() - gizmo.middle;
            let horizon = (RING * gizmo.length).powi(2);
            let faces = |side: &&[DVec3; 2]| side.iter().all(|corner| (*corner - gizmo.middle).dot(out) > horizon);
            assert!(sides.iter().filter(faces).count() > 15);
            for [from, to] in sides.iter().filter(faces) {
                let after = dragged(Handle::Turn(axis), *from, *to);
                let wanted = DMat3::from_axis_angle(DVec3::AXES[axis], TAU / f64::from(CORNERS)) * placement().rotation;
                assert!(after.rotation.abs_diff_eq(wanted, 1e-9), "{after:?}");
                assert!(after.point(CENTER).abs_diff_eq(gizmo.middle, 1e-9) && after.scale == placement().scale);
            }
        }
    }

    #[test]
    fn the_middle_scales_about_itself() {
        let gizmo = Gizmo::of(&placement(), &camera(), CENTER).unwrap();
        let pressed = DVec2::splat(0.5);
        let first = gizmo.value(Handle::Scale, pressed).unwrap();
        let held = Held { handle: Handle::Scale, from: placement(), middle: gizmo.middle, first };
        for (way, factor) in [(DVec2::new(0.0, -0.25), 2.0), (DVec2::new(-1.0 / 6.0, 0.0), 0.5)] {
            let after = held.placement(&gizmo, pressed + way).unwrap();
            assert!((after.scale - factor * placement().scale).abs() < 1e-9, "{after:?}");
            assert!(after.point(CENTER).abs_diff_eq(gizmo.middle, 1e-9));
            assert_eq!(after.rotation, placement().rotation);
        }
    }

    #[test]
    fn what_cannot_be_dragged_is_not_offered() {
        let facing = Navigator::facing(CENTER, 4.0).camera(600, 400);
        let gizmo = Gizmo::of(&Similarity::IDENTITY, &facing, CENTER).unwrap();
        assert!(gizmo.lines(Handle::Move(2)).is_empty(), "an arrow that points away");
        assert_eq!(gizmo.value(Handle::Move(2), DVec2::splat(0.5)), None);
        assert_eq!(gizmo.value(Handle::Turn(2), DVec2::splat(0.5)), None, "the axis itself has no angle");
        // A ring that is seen edge on turns by a drag across it.
        let angle = |x: f64| gizmo.value(Handle::Turn(1), DVec2::new(0.5 + x, 0.5)).unwrap();
        let turned = (angle(0.04) - angle(-0.04)).rem_euclid(TAU);
        assert!(turned > 0.5 && turned < 2.0 || turned > TAU - 2.0 && turned < TAU - 0.5, "{turned}");
        // Behind the camera, and beside the image.
        assert!(Gizmo::of(&Similarity::IDENTITY, &facing, CENTER - 9.0 * DVec3::Z).is_none());
        assert!(Gizmo::of(&Similarity::IDENTITY, &facing, CENTER + 9.0 * DVec3::X).is_none());
    }
}
