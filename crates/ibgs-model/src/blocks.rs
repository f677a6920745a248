//! A scene cut into blocks that are trained apart and joined again.
//!
//! [`Cutter::cut`] divides space by planes across the axes, so that the points, and the photos that show them, are about
//! equally many on both sides. The *cores* of the blocks fill all of space without overlap, the outer ones without end. A block
//! is trained on the photos that show enough of its core, enlarged by an overlap; what they show beyond it is trained too, so
//! that nothing inside has to stand for it. [`Joiner`] keeps of each block the Gaussians inside its core. This is the way of Lin et
//! al., "VastGaussian" (CVPR 2024), with points in place of projected boxes to tell what a photo shows.

mod cut;
mod plan;

pub use cut::{CutOptions, Cutter};
pub use plan::{Block, BlockPlan, PlanError, PlanFolder};

use crate::edit::Mask;
use crate::scene::Gaussians;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A box with faces across the axes, in the scene's coordinates; the lower faces belong to it. A face that is none lies at
/// infinity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Core {
    /// Lower faces, by axis.
    pub min: [Option<f64>; 3],
    /// Upper faces, by axis.
    pub max: [Option<f64>; 3],
}

impl Core {
    /// Whether a point lies in it.
    pub fn contains(&self, point: DVec3) -> bool {
        let inside = |axis: usize, value: f64| {
            self.min[axis].is_none_or(|face| value >= face) && self.max[axis].is_none_or(|face| value < face)
        };
        point.to_array().into_iter().enumerate().all(|(axis, value)| inside(axis, value))
    }

    /// The same with its finite faces moved outwards by these lengths, in scene units.
    pub fn enlarged(&self, by: DVec3) -> Self {
        let moved = |faces: [Option<f64>; 3], by: DVec3| {
            let mut by = by.to_array().into_iter();
            faces.map(|face| face.zip(by.next()).map(|(face, by)| face + by))
        };
        Self { min: moved(self.min, -by), max: moved(self.max, by) }
    }
}

/// Joins the Gaussians of blocks, each from the block in whose core its mean lies, in the local space of the first block.
#[derive(Default)]
pub struct Joiner {
    joined: Option<Gaussians>,
    given: usize,
}

impl Joiner {
    /// Adds those of a block that lie in its core.
    ///
    /// # Errors
    /// Spherical harmonics of another degree than those of the blocks before it: its degree and theirs.
    pub fn add(&mut self, core: &Core, block: Gaussians) -> Result<(), [u32; 2]> {
        self.given += block.len();
        let empty = || Gaussians { space: block.space, ..Gaussians::with_capacity(0, block.sh_degree) };
        let joined = self.joined.get_or_insert_with(empty);
        if joined.sh_degree != block.sh_degree {
            return Err([block.sh_degree, joined.sh_degree]);
        }
        let block = block.into_space(joined.space);
        let inside: Vec<bool> = block.positions().map(|mean| core.contains(mean)).collect();
        joined.append(Mask::of(inside.len(), |index| inside[index]).of_model(&block));
        Ok(())
    }

    /// Number of all Gaussians that were given.
    pub fn given(&self) -> usize {
        self.given
    }

    /// Those in the cores.
    pub fn joined(self) -> Gaussians {
        self.joined.unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::local_space::LocalSpace;

    #[test]
    fn a_core_has_its_lower_faces_only() {
        let core = Core { min: [Some(-1.0), None, None], max: [Some(1.0), Some(0.0), None] };
        let inside = |x: f64, y: f64| core.contains(DVec3::new(x, y, 1e9));
        assert!(inside(-1.0, -1e9) && inside(0.99, -0.1));
        assert!(!inside(1.0, -1.0) && !inside(-1.01, -1.0) && !inside(0.0, 0.0) && !inside(f64::NAN, -1.0));
        let larger = core.enlarged(DVec3::new(0.5, 1.0, 2.0));
        assert_eq!(larger, Core { min: [Some(-1.5), None, None], max: [Some(1.5), Some(1.0), None] });
    }

    #[test]
    fn joined_blocks_keep_what_lies_in_their_cores() {
        let part = |space: LocalSpace, positions: [f64; 2], opacity: f32| Gaussians {
            space,
            means: positions.map(|x| space.to_local(DVec3::new(x, 2.0, 3.0)).as_vec3().to_array()).to_vec(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            log_scales: vec![[0.0; 3]; 2],
            opacity_logits: vec![opacity, opacity + 0.5],
            sh: (0..24).map(|v| v as f32 + opacity).collect(),
            sh_degree: 1,
            normals: vec![[0.0, 0.0, 1.0]; 2],
            offsets: vec![0.25; 2],
            antialiased: false,
        };
        let left = Core { max: [Some(0.0), None, None], ..Core::default() };
        let right = Core { min: [Some(0.0), None, None], ..Core::default() };
        let spaces = [LocalSpace::at(DVec3::ONE), LocalSpace { origin: DVec3::ZERO, scale: 2.0 }];
        let mut joiner = Joiner::default();
        joiner.add(&left, part(spaces[0], [-1.0, 0.5], 1.0)).unwrap();
        joiner.add(&right, part(spaces[1], [-1.0, 0.0], 10.0)).unwrap();
        assert_eq!(joiner.add(&right, Gaussians::with_capacity(0, 3)), Err([3, 1]));
        assert_eq!(joiner.given(), 4);
        let joined = joiner.joined();
        joined.validate().unwrap();
        assert_eq!(joined.space, spaces[0]);
        assert_eq!(joined.positions().collect::<Vec<_>>(), [DVec3::new(-1.0, 2.0, 3.0), DVec3::new(0.0, 2.0, 3.0)]);
        assert_eq!(joined.opacity_logits, [1.0, 10.5]);
        // The second one of the second block, in units of the first.
        assert_eq!(joined.log_scales, [[0.0; 3], [2.0_f32.ln(); 3]]);
        assert_eq!(joined.offsets, [0.25, 0.5]);
        assert_eq!((joined.sh[11], joined.sh[12]), (12.0, 22.0));
        assert!(Joiner::default().joined().is_empty());
    }
}
