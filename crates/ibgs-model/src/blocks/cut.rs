//! Cutting space into cores, and choosing the photos of each.

use super::{Block, BlockPlan, Core, PlanError};
use crate::camera::Camera;
use crate::dataset::{PosedScene, shown};
use glam::DVec3;
use rayon::prelude::*;

/// Most points that are looked at: evenly chosen from more.
const MOST_POINTS: usize = 300_000;
/// Least points of a block, on average.
const LEAST_POINTS: usize = 50;
/// Part of the points, at either end of an axis, that may be stray.
const STRAY: f64 = 0.02;

/// How a scene is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutOptions {
    /// Number of blocks.
    pub blocks: usize,
    /// Length by which a core is enlarged on every finite face, relative to its size there.
    pub overlap: f64,
    /// A photo belongs to a block if at least this part of what it shows lies in the enlarged core, by area.
    pub least_share: f64,
}

impl Default for CutOptions {
    fn default() -> Self {
        Self { blocks: 4, overlap: 0.1, least_share: 0.1 }
    }
}

/// A point and what it counts.
#[derive(Clone, Copy)]
struct Weighted {
    position: DVec3,
    weight: f64,
}

/// A scene with what its photos show, to be cut.
pub struct Cutter<'a> {
    scene: &'a PosedScene,
    /// Points that are looked at, one of so many.
    points: Vec<DVec3>,
    step: usize,
    /// Cells and points that the views show, by cell.
    shown: Vec<Vec<(u32, u32)>>,
}

impl<'a> Cutter<'a> {
    /// Looks at the points through all photos.
    pub fn new(scene: &'a PosedScene) -> Self {
        let step = scene.points.len().div_ceil(MOST_POINTS).max(1);
        let all = scene.points.iter().map(|point| point.position);
        let points: Vec<DVec3> = all.filter(|position| position.is_finite()).step_by(step).collect();
        let by_cell = |camera: &Camera| {
            let mut shown = shown(camera, &points);
            shown.sort_unstable();
            shown
        };
        let shown = scene.views.par_iter().map(|(_, camera)| by_cell(camera)).collect();
        Self { scene, points, step, shown }
    }

    /// Cuts the scene.
    ///
    /// # Errors
    /// [`PlanError::Points`] where the scene has too few points, [`PlanError::Photos`] where a block has too few photos.
    pub fn cut(&self, options: &CutOptions) -> Result<BlockPlan, PlanError> {
        let Self { scene, points, shown, .. } = self;
        let too_few = || PlanError::Points { points: scene.points.len(), blocks: options.blocks };
        if options.blocks == 0 || points.len() / LEAST_POINTS < options.blocks {
            return Err(too_few());
        }
        let mut seen = vec![0_u32; points.len()];
        for &view in &scene.train {
            shown[view].iter().for_each(|(_, point)| seen[*point as usize] += 1);
        }
        let all_seen = seen.iter().map(|&count| f64::from(count)).sum::<f64>().max(1.0);
        let weight = |count: u32| 1.0 / points.len() as f64 + f64::from(count) / all_seen;
        let mut weighted: Vec<Weighted> =
            points.iter().zip(&seen).map(|(&position, &count)| Weighted { position, weight: weight(count) }).collect();
        let mut cores = Vec::with_capacity(options.blocks);
        divide(&mut weighted, options.blocks, Core::default(), &mut cores).ok_or_else(too_few)?;
        let blocks = cores.into_par_iter().enumerate().map(|(index, Part { core, extent, points: inside })| {
            let large = core.enlarged(extent * options.overlap);
            let chosen = |views: &[usize]| -> Vec<usize> {
                let belongs = |&&view: &&usize| {
                    let (_, camera) = &scene.views[view];
                    belongs(&large, camera, &shown[view], points, options.least_share)
                };
                views.iter().filter(belongs).copied().collect()
            };
            let (train, test) = (chosen(&scene.train), chosen(&scene.test));
            if train.len() < 2 {
                return Err(PlanError::Photos { block: index, photos: train.len(), blocks: options.blocks });
            }
            let mut starts = vec![false; points.len()];
            train.iter().flat_map(|&view| &shown[view]).for_each(|(_, point)| starts[*point as usize] = true);
            let start_points = self.step * starts.into_iter().filter(|&starts| starts).count();
            let names = |views: Vec<usize>| views.into_iter().map(|view| scene.views[view].0.clone()).collect();
            let (train, test) = (names(train), names(test));
            Ok(Block { core, points: self.step * inside, start_points, train, test, ..Block::default() })
        });
        // Of several errors the first block's.
        let blocks: Vec<Result<Block, PlanError>> = blocks.collect();
        Ok(BlockPlan { blocks: blocks.into_iter().collect::<Result<_, _>>()?, memory_limit: None })
    }
}

/// Whether a photo shows enough of a block, or was taken in it; what it shows comes by cell.
fn belongs(core: &Core, camera: &Camera, shown: &[(u32, u32)], points: &[DVec3], least: f64) -> bool {
    let (mut cells, mut inside) = (0, 0);
    for cell in shown.chunk_by(|a, b| a.0 == b.0) {
        cells += 1;
        inside += usize::from(cell.iter().any(|(_, point)| core.contains(points[*point as usize])));
    }
    core.contains(camera.center()) || inside > 0 && inside as f64 >= least * f64::from(cells)
}

/// A core with the lengths of its points along the axes, and how many of those that are looked at it has.
struct Part {
    core: Core,
    extent: DVec3,
    points: usize,
}

/// Divides a core by planes across its longest axes until there are `count`; none where points coincide.
fn divide(points: &mut [Weighted], count: usize, core: Core, cores: &mut Vec<Part>) -> Option<()> {
    let extent = extent(points)?;
    if count == 1 {
        cores.push(Part { core, extent, points: points.len() });
        return Some(());
    }
    let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b]))?;
    points.sort_by(|a, b| a.position[axis].total_cmp(&b.position[axis]));
    let (first, all) = (count / 2, points.iter().map(|point| point.weight).sum::<f64>());
    let mut sum = 0.0;
    let reached = |point: &Weighted| {
        sum += point.weight;
        sum > all * first as f64 / count as f64
    };
    // Points of one place stay together.
    let face = points[points.iter().position(reached)?].position[axis];
    let middle = points.partition_point(|point| point.position[axis] < face);
    let (mut lower, mut upper) = (core, core);
    (lower.max[axis], upper.min[axis]) = (Some(face), Some(face));
    let (below, above) = points.split_at_mut(middle);
    divide(below, first, lower, cores)?;
    divide(above, count - first, upper, cores)
}

/// Lengths of a cloud along the axes, without stray points; none without points.
fn extent(points: &[Weighted]) -> Option<DVec3> {
    let last = points.len().checked_sub(1)?;
    let stray = (last as f64 * STRAY) as usize;
    let length = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|point| point.position[axis]).collect();
        values.sort_by(f64::total_cmp);
        values[last - stray] - values[stray]
    };
    Some(DVec3::from_array([0, 1, 2].map(length)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Point;
    use glam::{DMat3, DVec2};

    /// A wall of points along x, from 0 to 8, and a camera in front of each metre of it.
    fn wall() -> PosedScene {
        let color = [0; 3];
        let place = |n: u32| DVec3::new(f64::from(n) / 100.0, f64::from(n % 7) / 10.0 - 0.3, 0.0);
        let points = (0..800).map(|n| Point { position: place(n), color }).collect();
        let camera = |x: f64| Camera {
            width: 64,
            height: 64,
            focal: DVec2::splat(64.0),
            principal: DVec2::splat(32.0),
            view_from_world: DMat3::IDENTITY,
            translation: DVec3::new(-x, 0.0, 1.0),
        };
        let views = (0..16).map(|n| (format!("{n:02}.png"), camera(0.25 + 0.5 * f64::from(n)))).collect();
        let (test, train) = (0..16).partition(|n| n % 4 == 0);
        PosedScene { views, train, test, points }
    }

    #[test]
    fn blocks_share_space_points_and_photos_evenly() {
        let scene = wall();
        let plan = Cutter::new(&scene).cut(&CutOptions { blocks: 4, ..CutOptions::default() }).unwrap();
        for point in &scene.points {
            let owners = plan.blocks.iter().filter(|block| block.core.contains(point.position)).count();
            assert_eq!(owners, 1);
        }
        assert_eq!(plan.blocks.iter().map(|block| block.points).sum::<usize>(), 800);
        for (index, block) in plan.blocks.iter().enumerate() {
            assert!((170..=230).contains(&block.points), "{index}: {} points", block.points);
            assert!((3..=6).contains(&block.train.len()), "{index}: {:?}", block.train);
            // Photos are chosen by what they show: those of a block's own two metres and the next ones.
            let (own, far) = (format!("{:02}.png", 4 * index + 2), format!("{:02}.png", (4 * index + 10) % 16));
            assert!(block.train.contains(&own) && !block.train.contains(&far), "{index}: {:?}", block.train);
            assert!(block.test.contains(&format!("{:02}.png", 4 * index)));
            // It begins with what its photos show: beyond its core too, but for the ends of the wall, where one is held out.
            let least = if index == 0 { block.points - 40 } else { block.points };
            assert!((least..600).contains(&block.start_points), "{index}: {} points", block.start_points);
        }
        let (first, last) = (plan.blocks[0].core, plan.blocks[3].core);
        assert_eq!((first.min, last.max), ([None; 3], [None; 3]));
        assert!(first.contains(DVec3::new(-1e9, 5.0, 5.0)) && last.contains(DVec3::splat(1e9)));
        // A larger overlap takes more photos.
        let wide = Cutter::new(&scene).cut(&CutOptions { overlap: 0.8, ..CutOptions::default() }).unwrap();
        assert!(wide.blocks[1].train.len() > plan.blocks[1].train.len());
    }

    #[test]
    fn what_cannot_be_cut_is_refused() {
        let mut scene = wall();
        let options = |blocks| CutOptions { blocks, ..CutOptions::default() };
        assert!(matches!(Cutter::new(&scene).cut(&options(17)), Err(PlanError::Points { points: 800, blocks: 17 })));
        assert!(matches!(Cutter::new(&scene).cut(&options(0)), Err(PlanError::Points { .. })));
        assert!(matches!(Cutter::new(&scene).cut(&options(16)), Err(PlanError::Photos { .. })));
        scene.points.iter_mut().for_each(|point| point.position = DVec3::ONE);
        assert!(matches!(Cutter::new(&scene).cut(&options(2)), Err(PlanError::Points { .. })));
    }
}
