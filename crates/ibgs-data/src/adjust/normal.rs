//! Steps of Levenberg and Marquardt: the points are eliminated (Schur), the cameras solved for.

use super::anchor::Anchor;
use super::reprojection::{FAR, NUMBERS, Reprojection, error};
use super::{Seen, moved};
use crate::camera::Camera;
use crate::cholesky::Symmetric;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Numbers of a pose.
const POSE: usize = 6;
/// Parts of the tracks whose sums are made side by side: always as many, so that sums have one order.
const PARTS: usize = 4;
/// Damping of the first step and its bounds.
const DAMPING: [f64; 3] = [1e-4, 1e-9, 1e9];
/// Part of the cost that a step must save for another one to follow.
const LEAST_GAIN: f64 = 1e-8;

/// What is adjusted: cameras, and points where they are known.
#[derive(Clone, Debug)]
pub(super) struct State {
    pub cameras: Vec<Camera>,
    pub points: Vec<Option<DVec3>>,
}

/// Tracks whose errors are to be small, with Cauchy's loss of this scale in pixels.
pub(super) struct Problem<'a> {
    pub tracks: &'a [&'a [Seen]],
    pub lens_of: &'a [usize],
    pub lenses: usize,
    pub scale: f64,
    /// Holds the cameras.
    pub anchor: Option<Anchor<'a>>,
}

/// One observation's part of the equations.
struct Row {
    places: [usize; NUMBERS],
    /// Weighted: camera by camera, and camera by point.
    square: [[f64; NUMBERS]; NUMBERS],
    mixed: [DVec3; NUMBERS],
    /// Down the gradient.
    right: [f64; NUMBERS],
}

/// One track's part of them.
struct Block {
    rows: Vec<Row>,
    inverse: DMat3,
    right: DVec3,
}

impl Problem<'_> {
    /// Sum of the losses.
    pub fn cost(&self, state: &State) -> f64 {
        let square = self.scale * self.scale;
        let one = |(track, point): (&&[Seen], &Option<DVec3>)| -> f64 {
            let Some(point) = *point else { return 0.0 };
            let loss = |seen: &Seen| {
                let error = error(&state.cameras[seen.view], point, seen.pixel);
                (error.map_or(FAR * FAR, |e| e.length_squared()) / square).ln_1p() * square / 2.0
            };
            track.iter().map(loss).sum()
        };
        let costs: Vec<f64> = self.tracks.par_iter().zip(&state.points).map(one).collect();
        costs.iter().sum::<f64>() + self.anchor.as_ref().map_or(0.0, |anchor| anchor.cost(&state.cameras))
    }

    /// Steps down from a state, at most as many.
    pub fn descend(&self, state: &mut State, most: usize) {
        let [mut damping, least, worst] = DAMPING;
        let mut cost = self.cost(state);
        for _ in 0..most {
            let mut gain = None;
            while gain.is_none() && damping < worst {
                let next = self.stepped(state, damping).map(|next| (self.cost(&next), next));
                match next {
                    Some((lower, next)) if lower < cost => {
                        gain = Some((cost - lower) / cost);
                        (cost, *state) = (lower, next);
                        damping = (damping / 10.0).max(least);
                    }
                    _ => damping *= 10.0,
                }
            }
            if gain.is_none_or(|gain| gain < LEAST_GAIN) {
                return;
            }
        }
    }

    /// Where an observation's numbers lie among all.
    fn places(&self, view: usize) -> [usize; NUMBERS] {
        let lens = POSE * self.lens_of.len() + 2 * self.lens_of[view];
        std::array::from_fn(|i| if i < POSE { POSE * view + i } else { lens + i - POSE })
    }

    fn block(&self, state: &State, track: &[Seen], point: DVec3, damping: f64) -> Option<Block> {
        let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
        let mut rows = Vec::with_capacity(track.len());
        for seen in track {
            let Some(one) = Reprojection::of(&state.cameras[seen.view], point, seen.pixel) else { continue };
            let weight = 1.0 / (1.0 + one.error.length_squared() / (self.scale * self.scale));
            let [a, b] = one.by_camera;
            let [p, q] = one.by_point;
            matrix += DMat3::from_cols(p * p.x, p * p.y, p * p.z) * weight;
            matrix += DMat3::from_cols(q * q.x, q * q.y, q * q.z) * weight;
            right -= (p * one.error.x + q * one.error.y) * weight;
            rows.push(Row {
                places: self.places(seen.view),
                square: std::array::from_fn(|i| std::array::from_fn(|j| weight * (a[i] * a[j] + b[i] * b[j]))),
                mixed: std::array::from_fn(|i| (p * a[i] + q * b[i]) * weight),
                right: std::array::from_fn(|i| -weight * (a[i] * one.error.x + b[i] * one.error.y)),
            });
        }
        let diagonal = DVec3::new(matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z);
        let inverse = (matrix + DMat3::from_diagonal(diagonal * damping)).inverse();
        inverse.is_finite().then_some(Block { rows, inverse, right })
    }

    /// The state after a step; none where the equations have no solution.
    fn stepped(&self, state: &State, damping: f64) -> Option<State> {
        let size = POSE * self.lens_of.len() + 2 * self.lenses;
        let each = self.tracks.len().div_ceil(PARTS).max(1);
        let parts = self.tracks.par_chunks(each).zip(state.points.par_chunks(each));
        let sums: Vec<Sums> = parts
            .map(|(tracks, points)| {
                let mut sums = Sums::zero(size);
                for (track, point) in tracks.iter().zip(points) {
                    if let Some(block) = point.and_then(|point| self.block(state, track, point, damping)) {
                        sums.add(&block);
                    }
                }
                sums
            })
            .collect();
        let mut sums = sums.into_iter();
        let mut all = sums.next()?;
        sums.for_each(|other| all.add_all(&other));
        if let Some(anchor) = &self.anchor {
            anchor.add(&state.cameras, |view| self.places(view), &mut all);
        }
        let step = all.solve(damping)?;
        let cameras = state.cameras.iter().enumerate();
        let cameras = cameras.map(|(view, camera)| moved(camera, self.places(view).map(|place| step[place]))).collect();
        let back = |(track, point): (&&[Seen], &Option<DVec3>)| {
            let point = (*point)?;
            let Some(Block { rows, inverse, mut right }) = self.block(state, track, point, damping) else {
                return Some(point);
            };
            for row in &rows {
                row.places.iter().zip(&row.mixed).for_each(|(place, mixed)| right -= *mixed * step[*place]);
            }
            Some(point + inverse * right)
        };
        let points = self.tracks.par_iter().zip(&state.points).map(back).collect();
        Some(State { cameras, points })
    }
}

/// The equations of the cameras.
pub(super) struct Sums {
    matrix: Symmetric,
    /// Of the matrix before the points were eliminated.
    diagonal: Vec<f64>,
    right: Vec<f64>,
}

impl Sums {
    pub fn zero(size: usize) -> Self {
        Self { matrix: Symmetric::zero(size), diagonal: vec![0.0; size], right: vec![0.0; size] }
    }

    fn add(&mut self, block: &Block) {
        let point = block.inverse * block.right;
        for row in &block.rows {
            for (i, &place) in row.places.iter().enumerate() {
                self.diagonal[place] += row.square[i][i];
                self.right[place] += row.right[i] - row.mixed[i].dot(point);
                row.places.iter().zip(&row.square[i]).for_each(|(other, value)| self.matrix.add(place, *other, *value));
                let across = block.inverse * row.mixed[i];
                for other in &block.rows {
                    for (column, mixed) in other.places.iter().zip(&other.mixed) {
                        self.matrix.add(place, *column, -across.dot(*mixed));
                    }
                }
            }
        }
    }

    /// Down the gradient.
    #[cfg(test)]
    pub fn right(&self) -> &[f64] {
        &self.right
    }

    /// Adds a part that no other number has to do with.
    pub fn add_own(&mut self, place: usize, square: f64, right: f64) {
        self.diagonal[place] += square;
        self.right[place] += right;
        self.matrix.add(place, place, square);
    }

    fn add_all(&mut self, other: &Self) {
        self.matrix.add_all(&other.matrix);
        self.diagonal.iter_mut().zip(&other.diagonal).for_each(|(sum, v)| *sum += v);
        self.right.iter_mut().zip(&other.right).for_each(|(sum, v)| *sum += v);
    }

    /// A number that nothing depends on stays.
    fn solve(mut self, damping: f64) -> Option<Vec<f64>> {
        for (i, value) in self.diagonal.iter().enumerate() {
            self.matrix.add(i, i, if *value > 0.0 { value * damping } else { 1.0 });
        }
        self.matrix.solve(self.right)
    }
}
