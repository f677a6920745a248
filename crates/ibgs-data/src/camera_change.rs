//! Small changes of cameras, as the refinement of poses makes them.

use crate::camera::Camera;
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::ops::Add;

/// A change of a camera, or a gradient by one: of its pose in the tangent space of SE(3), taken in view space, and of its lens.
///
/// The changed camera has the pose `[exp(rotation) R | exp(rotation) t + translation]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CameraChange {
    /// What is added to the translation, in units of the scene.
    pub translation: DVec3,
    /// Rotation vector, in radians.
    pub rotation: DVec3,
    /// What is added to the focal lengths, in pixels.
    pub focal: DVec2,
    /// What is added to the principal point, in pixels.
    pub principal: DVec2,
}

impl CameraChange {
    /// Numbers of a change.
    pub const NUMBERS: usize = 10;

    /// Its numbers: translation, rotation, focal lengths, principal point.
    pub fn to_array(self) -> [f64; Self::NUMBERS] {
        let Self { translation: t, rotation: r, focal: f, principal: p } = self;
        [t.x, t.y, t.z, r.x, r.y, r.z, f.x, f.y, p.x, p.y]
    }

    /// From its numbers, in the order of [`CameraChange::to_array`].
    pub fn from_array([a, b, c, d, e, f, g, h, i, j]: [f64; Self::NUMBERS]) -> Self {
        Self {
            translation: DVec3::new(a, b, c),
            rotation: DVec3::new(d, e, f),
            focal: DVec2::new(g, h),
            principal: DVec2::new(i, j),
        }
    }
}

impl Add for CameraChange {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            translation: self.translation + other.translation,
            rotation: self.rotation + other.rotation,
            focal: self.focal + other.focal,
            principal: self.principal + other.principal,
        }
    }
}

impl Camera {
    /// What the pose has moved by from another one, in this camera's view space: turn, as a rotation vector, and shift of the centre.
    pub fn movement_from(&self, from: &Camera) -> [DVec3; 2] {
        let turn = DQuat::from_mat3(&(self.view_from_world * from.view_from_world.transpose()));
        // The shorter way round.
        let turn = if turn.w < 0.0 { -turn } else { turn };
        [turn.to_scaled_axis(), self.view_from_world * (self.center() - from.center())]
    }

    /// The camera after a change.
    pub fn changed(&self, by: &CameraChange) -> Camera {
        let turn = DQuat::from_scaled_axis(by.rotation);
        let rotation = (turn * DQuat::from_mat3(&self.view_from_world)).normalize();
        Camera {
            view_from_world: DMat3::from_quat(rotation),
            translation: turn * self.translation + by.translation,
            focal: self.focal + by.focal,
            principal: self.principal + by.principal,
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_moves_points_in_view_space() {
        let camera = Camera {
            width: 40,
            height: 30,
            focal: DVec2::new(30.0, 31.0),
            principal: DVec2::new(20.0, 14.0),
            view_from_world: DMat3::from_rotation_y(0.4) * DMat3::from_rotation_x(-0.9),
            translation: DVec3::new(0.3, -0.7, 2.0),
        };
        let by = CameraChange::from_array([0.1, -0.2, 0.3, 0.02, 0.05, -0.04, 1.0, -2.0, 0.5, 0.25]);
        assert_eq!(CameraChange::from_array(by.to_array()), by);
        let changed = camera.changed(&by);
        let world = DVec3::new(0.7, 0.2, -0.4);
        let turned = DQuat::from_scaled_axis(by.rotation) * camera.to_view(world);
        assert!((changed.to_view(world) - turned - by.translation).length() < 1e-12);
        assert_eq!((changed.focal, changed.principal), (DVec2::new(31.0, 29.0), DVec2::new(20.5, 14.25)));
        let orthonormal = changed.view_from_world * changed.view_from_world.transpose();
        assert!(orthonormal.abs_diff_eq(DMat3::IDENTITY, 1e-14));
        assert_eq!((by + by).to_array(), by.to_array().map(|v| 2.0 * v));
    }
}
