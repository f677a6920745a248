//! Gaussians moved, turned and scaled with their scene.

use super::Gaussians;
use super::formats::turn_each;
use crate::local_space::LocalSpace;
use crate::similarity::Similarity;
use glam::{DMat3, DVec3};

impl Gaussians {
    /// The same Gaussians after a similarity of the scene: seen by a camera that is moved with them they look the same.
    #[must_use]
    pub fn moved(mut self, by: &Similarity) -> Self {
        // Place and size are those of the local coordinates, so only a turn changes the numbers.
        self.space = LocalSpace { origin: by.point(self.space.origin), scale: by.scale * self.space.scale };
        if by.rotation == DMat3::IDENTITY {
            return self;
        }
        let turn = |v: &mut [f32; 3]| *v = (by.rotation * DVec3::from(v.map(f64::from))).as_vec3().to_array();
        // Those of a format without planes stay known as such.
        if !self.lacks_planes() {
            self.normals.iter_mut().for_each(turn);
        }
        self.means.iter_mut().for_each(turn);
        turn_each(&mut self, by.rotation);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::super::formats::{basis, random};
    use super::*;
    use glam::DQuat;

    fn axes(g: &Gaussians, i: usize) -> DMat3 {
        let [w, x, y, z] = g.rotations[i].map(f64::from);
        DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize())
    }

    fn color(g: &Gaussians, i: usize, direction: DVec3) -> f64 {
        let sh = &g.sh[48 * i..48 * (i + 1)];
        basis(direction).iter().zip(sh.chunks_exact(3)).map(|(value, rgb)| value * f64::from(rgb[0])).sum()
    }

    #[test]
    fn all_of_a_gaussian_moves_with_the_scene() {
        let by = Similarity {
            scale: 2.5,
            rotation: DMat3::from_rotation_z(2.5) * DMat3::from_rotation_x(0.4),
            translation: DVec3::new(30.0, -1.0, 0.5),
        };
        let space = LocalSpace { origin: DVec3::new(4.0, 0.0, -2.0), scale: 0.5 };
        let random = random(20, 3, 1);
        let before =
            Gaussians { space, normals: random.means.clone(), offsets: random.opacity_logits.clone(), ..random };
        let after = before.clone().moved(&by);
        after.validate().unwrap();
        for (i, (from, to)) in before.positions().zip(after.positions()).enumerate() {
            assert!(by.point(from).abs_diff_eq(to, 1e-5));
            assert!(axes(&after, i).abs_diff_eq(by.rotation * axes(&before, i), 1e-6));
            let [from, to] = [&before, &after].map(|g| DVec3::from(g.normals[i].map(f64::from)));
            assert!((by.rotation * from).abs_diff_eq(to, 1e-5));
            for direction in [DVec3::X, DVec3::new(0.6, 0.0, -0.8)] {
                let [from, to] = [color(&before, i, direction), color(&after, i, by.rotation * direction)];
                assert!((from - to).abs() < 1e-4, "{from} {to}");
            }
        }
        // Sizes and offsets grow with the local unit.
        assert_eq!((&after.log_scales, &after.offsets), (&before.log_scales, &before.offsets));
        assert_eq!(after.space.scale, 1.25);
    }

    #[test]
    fn planes_of_a_format_without_them_stay_so() {
        let plain = random(3, 0, 1);
        assert!(plain.lacks_planes());
        let turn = Similarity { rotation: DMat3::from_rotation_x(1.0), ..Similarity::IDENTITY };
        assert!(plain.clone().moved(&turn).lacks_planes());
        assert_eq!(plain.clone().moved(&Similarity::IDENTITY), plain);
    }
}
