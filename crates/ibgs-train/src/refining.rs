//! The cameras of the training views in a training: they learn from the gradients of all that reads them.
//!
//! Each view gathers the gradients by its pose, as the target of an iteration and as a source of others, and takes a step of Adam
//! when it has been the target. Views of one lens gather those by its focal lengths and take a step together, once each has been the
//! target. A step is taken some iterations after its gradients were made, always as many, so that nothing waits and runs repeat.
//! After each round of steps, one for each view on average, what all cameras have moved by alike is taken back.

mod levelling;

use crate::readback::Readback;
use glam::DVec2;
use ibgs_core::camera::{Camera, lenses};
use ibgs_core::camera_change::CameraChange;
use ibgs_core::config::{PoseSwitch, TrainConfig};
use ibgs_core::gpu::{Gpu, GpuError, Mark, Pass};
use ibgs_core::local_space::LocalSpace;
use ibgs_core::raster::CameraGradients;
use ibgs_core::similarity::Similarity;
use ibgs_core::sources::MAX_SOURCES;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::Arc;

/// Iterations from the gradients to the step.
const DELAY: usize = 3;
/// Numbers of a camera's gradient on the device.
const ROW: usize = 12;
/// Adam's decays, and what is added to the root of the second moment.
const BETA: [f64; 2] = [0.9, 0.99];
const EPSILON: f64 = 1e-15;
/// Numbers of a pose.
const POSE: usize = 6;

/// A step of Adam in the making, of a pose or of a lens, which has two numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Moments {
    first: [f64; POSE],
    second: [f64; POSE],
    steps: i32,
    gathered: [f64; POSE],
    /// Targets that have been gathered.
    targets: usize,
}

impl Moments {
    fn gather(&mut self, gradient: [f64; POSE], is_target: bool) {
        self.gathered.iter_mut().zip(gradient).for_each(|(sum, v)| *sum += v);
        self.targets += usize::from(is_target);
    }

    /// The step by what has been gathered, in units of the numbers; times the agreement to the power of `strictness`.
    fn step(&mut self, rate: f64, strictness: f64) -> [f64; POSE] {
        let gradient = std::mem::take(&mut self.gathered);
        self.targets = 0;
        self.steps += 1;
        for (i, v) in gradient.into_iter().enumerate() {
            self.first[i] = BETA[0] * self.first[i] + (1.0 - BETA[0]) * v;
            self.second[i] = BETA[1] * self.second[i] + (1.0 - BETA[1]) * v.powi(2);
        }
        let rate = rate * self.agreement().powf(strictness);
        let [left1, left2] = self.unbiased();
        std::array::from_fn(|i| -rate * (self.first[i] / left1) / ((self.second[i] / left2).sqrt() + EPSILON))
    }

    /// What Adam's moments are divided by.
    fn unbiased(&self) -> [f64; 2] {
        BETA.map(|beta| 1.0 - beta.powi(self.steps))
    }

    /// How far the gradients of the last visits agree, from 0 to 1: the length of their mean beside the root of their mean square, less
    /// what it is by chance. One visit agrees with nothing.
    fn agreement(&self) -> f64 {
        let [left1, left2] = self.unbiased();
        let mean: f64 = self.first.iter().map(|v| (v / left1).powi(2)).sum();
        let square: f64 = self.second.iter().map(|v| v / left2).sum();
        if self.steps < 2 || square <= 0.0 {
            return 0.0;
        }
        // The mean square of the weighted mean of gradients that are all chance, as a part of theirs.
        let chance = (1.0 - BETA[0]) / (1.0 + BETA[0]) * (2.0 - left1) / left1;
        ((mean / square - chance) / (1.0 - chance)).clamp(0.0, 1.0).sqrt()
    }

    fn is_finite(&self) -> bool {
        [self.first, self.second, self.gathered].as_flattened().iter().all(|v| v.is_finite())
    }
}

/// Takes the mean first moment back, which would move all cameras alike again.
fn level_moments(poses: &mut [Moments]) {
    let count = poses.len().max(1) as f64;
    for i in 0..POSE {
        let mean = poses.iter().map(|moments| moments.first[i]).sum::<f64>() / count;
        poses.iter_mut().for_each(|moments| moments.first[i] -= mean);
    }
}

/// Gradients on their way, of these views: the target first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Arrived {
    views: Vec<usize>,
    values: Vec<f32>,
}

#[derive(Debug)]
enum Flight {
    Coming { views: Vec<usize>, staging: wgpu::Buffer, readback: Readback },
    Here(Arrived),
}

/// Cameras that learn, on the host.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefinementState {
    /// In local coordinates.
    cameras: Vec<Camera>,
    poses: Vec<Moments>,
    lenses: Vec<Moments>,
    flights: Vec<Arrived>,
}

impl RefinementState {
    /// Whether a training of as many views can resume from it.
    pub fn is_sound(&self, views: usize) -> bool {
        let flies = |flight: &Arrived| {
            flight.values.len() == ROW * flight.views.len() && flight.views.iter().all(|view| *view < views)
        };
        self.cameras.len() == views
            && self.poses.len() == views
            && self.lenses.len() <= views
            && self.flights.len() <= DELAY
            && self.flights.iter().all(flies)
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let cameras = self.cameras.iter().all(|camera| camera.translation.is_finite() && camera.focal.is_finite());
        cameras && self.poses.iter().all(Moments::is_finite) && self.lenses.iter().all(Moments::is_finite)
    }
}

/// The cameras of the training views as they are learned.
pub(super) struct Refining {
    gpu: Arc<Gpu>,
    gradients: CameraGradients,
    space: LocalSpace,
    /// In local coordinates, as the training began and as they are.
    first: Arc<[Camera]>,
    cameras: Vec<Camera>,
    /// Length, in local units, that moves what a view shows as far as a radian does.
    lengths: Vec<f64>,
    /// Lens of each view, and how many views have it.
    lens_of: Vec<usize>,
    views_of: Vec<usize>,
    poses: Vec<Moments>,
    lenses: Vec<Moments>,
    /// Power of the agreement that steps are scaled by.
    strictness: f64,
    flights: VecDeque<Flight>,
    free: Vec<wgpu::Buffer>,
}

impl Refining {
    /// None where they are not refined. The training cameras come in local coordinates, with the median depth of the points that
    /// each shows.
    pub fn new(
        gpu: &Arc<Gpu>,
        (cameras, space): (&Arc<[Camera]>, LocalSpace),
        depths: impl FnOnce() -> Vec<f64>,
        config: &TrainConfig,
    ) -> Result<Option<Self>, GpuError> {
        if config.poses.refine != PoseSwitch::On {
            return Ok(None);
        }
        let (lens_of, views_of) = lenses(cameras);
        Ok(Some(Self {
            gradients: CameraGradients::new(gpu, MAX_SOURCES)?,
            gpu: gpu.clone(),
            space,
            first: cameras.clone(),
            cameras: cameras.to_vec(),
            lengths: depths(),
            poses: vec![Moments::default(); lens_of.len()],
            lenses: vec![Moments::default(); views_of.len()],
            lens_of,
            views_of,
            strictness: config.poses.agreement,
            flights: VecDeque::new(),
            free: Vec::new(),
        }))
    }

    /// Where the gradients of an iteration are gathered, zeroed.
    pub fn cleared(&self) -> &CameraGradients {
        let mut pass = Pass::new(&self.gpu, "gradients of cameras");
        self.gradients.record_clear(&mut pass);
        pass.submit();
        &self.gradients
    }

    /// Records the copy of an iteration's gradients to the host; returns where they go.
    pub fn record_copy(&mut self, pass: &mut Pass) -> wgpu::Buffer {
        let bytes = ((1 + MAX_SOURCES) * ROW * size_of::<f32>()) as u64;
        let staging = self.free.pop().unwrap_or_else(|| self.gpu.staging(bytes));
        pass.copy_out(self.gradients.rows(), &staging, 0, bytes);
        staging
    }

    /// The gradients of a target and its sources are on their way.
    pub fn sent(&mut self, target: usize, sources: &[usize], staging: wgpu::Buffer, end: Mark) {
        let views = std::iter::once(target).chain(sources.iter().copied()).collect();
        let readback = Readback::new(&staging, end);
        self.flights.push_back(Flight::Coming { views, staging, readback });
    }

    fn landed(&mut self, flight: Flight) -> Result<Arrived, GpuError> {
        match flight {
            Flight::Here(arrived) => Ok(arrived),
            Flight::Coming { views, staging, readback } => {
                let mut values: Vec<f32> = readback.words(&self.gpu, &staging)?;
                values.truncate(ROW * views.len());
                self.free.push(staging);
                Ok(Arrived { views, values })
            }
        }
    }

    /// Takes the steps that are due before an iteration with this learning rate, in radians; true where a camera has changed.
    pub fn step(&mut self, rate: f64) -> Result<bool, GpuError> {
        if self.flights.len() < DELAY {
            return Ok(false);
        }
        let Some(flight) = self.flights.pop_front() else { return Ok(false) };
        let arrived = self.landed(flight)?;
        if arrived.values.iter().any(|v| !v.is_finite()) {
            return Ok(false);
        }
        let gradients = CameraGradients::gradients(arrived.values.as_chunks().0);
        for (place, (&view, gradient)) in arrived.views.iter().zip(&gradients).enumerate() {
            self.gather(view, gradient, place == 0);
        }
        let Some(&target) = arrived.views.first() else { return Ok(false) };
        self.step_pose(target, rate);
        self.step_lens(self.lens_of[target], rate);
        if self.ends_round() {
            levelling::level(&self.first, &mut self.cameras);
            level_moments(&mut self.poses);
        }
        Ok(true)
    }

    /// In units that move the picture equally far.
    fn gather(&mut self, view: usize, gradient: &CameraChange, is_target: bool) {
        let [a, b, c, d, e, f, ..] = gradient.to_array();
        let length = self.lengths[view];
        self.poses[view].gather([a * length, b * length, c * length, d, e, f], is_target);
        let focal = gradient.focal * self.cameras[view].focal;
        self.lenses[self.lens_of[view]].gather([focal.x, focal.y, 0.0, 0.0, 0.0, 0.0], is_target);
    }

    fn step_pose(&mut self, view: usize, rate: f64) {
        let [a, b, c, d, e, f] = self.poses[view].step(rate, self.strictness);
        let length = self.lengths[view];
        let change = CameraChange::from_array([a * length, b * length, c * length, d, e, f, 0.0, 0.0, 0.0, 0.0]);
        self.cameras[view] = self.cameras[view].changed(&change);
    }

    fn step_lens(&mut self, lens: usize, rate: f64) {
        if self.lenses[lens].targets < self.views_of[lens] {
            return;
        }
        let [x, y, ..] = self.lenses[lens].step(rate, self.strictness);
        for (camera, _) in self.cameras.iter_mut().zip(&self.lens_of).filter(|(_, of)| **of == lens) {
            camera.focal *= DVec2::new(x.exp(), y.exp());
        }
    }

    /// Whether as many steps have been taken as there are poses, or a multiple.
    fn ends_round(&self) -> bool {
        let steps: usize = self.poses.iter().map(|moments| moments.steps as usize).sum();
        steps.is_multiple_of(self.poses.len())
    }

    /// The cameras as they are, in the scene's coordinates and in local ones.
    pub fn cameras(&self) -> [Arc<[Camera]>; 2] {
        let scene = self.cameras.iter().map(|camera| self.space.scene_camera(camera)).collect();
        [scene, self.cameras.as_slice().into()]
    }

    /// The mean angle and distance (as a part of the distance to what a view shows) that they have moved by, apart from what they
    /// have moved by together.
    pub fn moved(&self) -> [f64; 2] {
        let count = self.cameras.len().max(1) as f64;
        let mut sums = [0.0; 2];
        let pairs: Vec<_> = self.first.iter().copied().zip(self.cameras.iter().copied()).collect();
        let frame = Similarity::fit(&pairs);
        for ((first, now), length) in pairs.iter().zip(&self.lengths) {
            let (angle, distance) = frame.residual(first, now);
            sums[0] += angle / count;
            sums[1] += distance / length / count;
        }
        sums
    }

    /// Everything on the host; waits for the GPU.
    pub fn state(&mut self) -> Result<RefinementState, GpuError> {
        let flights = std::mem::take(&mut self.flights);
        let flights = flights.into_iter().map(|flight| self.landed(flight)).collect::<Result<Vec<_>, _>>()?;
        self.flights = flights.iter().cloned().map(Flight::Here).collect();
        let (cameras, poses, lenses) = (self.cameras.clone(), self.poses.clone(), self.lenses.clone());
        Ok(RefinementState { cameras, poses, lenses, flights })
    }

    /// Goes on from there.
    pub fn restore(&mut self, state: &RefinementState) {
        self.cameras.clone_from(&state.cameras);
        self.poses.clone_from(&state.poses);
        self.lenses.clone_from(&state.lenses);
        self.flights = state.flights.iter().cloned().map(Flight::Here).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera's visits with these gradients; the last step of a rate of one.
    fn stepped(gradients: impl Iterator<Item = [f64; POSE]>, strictness: f64) -> [f64; POSE] {
        let mut moments = Moments::default();
        let mut last = [0.0; POSE];
        for gradient in gradients {
            moments.gather(gradient, true);
            last = moments.step(1.0, strictness);
        }
        last
    }

    #[test]
    fn steps_are_as_long_as_gradients_agree() {
        let same = |_| [3.0, -2.0, 0.0, 1.0, 0.5, -4.0];
        let length = |step: [f64; POSE]| step.iter().map(|v| v * v).sum::<f64>().sqrt();
        // Gradients that agree step as Adam does, from the second visit on.
        let [plain, scaled] = [0.0, 1.0].map(|strictness| stepped((0..30).map(same), strictness));
        assert!(plain.iter().zip(scaled).all(|(a, b)| (a - b).abs() < 1e-9), "{plain:?} {scaled:?}");
        assert!((plain[0] + 1.0).abs() < 1e-9 && (plain[1] - 1.0).abs() < 1e-9, "{plain:?}");
        assert_eq!(stepped((0..1).map(same), 1.0), [0.0; POSE]);
        assert!((length(stepped((0..2).map(same), 1.0)) - 5_f64.sqrt()).abs() < 1e-9);
        // Gradients of changing signs do not; the stricter, the less.
        let other = |i: i32| if i % 2 == 0 { same(i) } else { same(i).map(|v| -v) };
        let [plain, scaled] = [0.0, 1.0].map(|strictness| length(stepped((0..30).map(other), strictness)));
        assert!(plain > 0.05 && scaled == 0.0, "{plain} {scaled}");
        let mostly = |i: i32| if i % 4 == 0 { same(i).map(|v| -v) } else { same(i) };
        let lengths = [0.0, 1.0, 2.0].map(|strictness| length(stepped((0..30).map(mostly), strictness)));
        assert!(lengths[0] > 1.2 * lengths[1] && lengths[1] > 1.2 * lengths[2] && lengths[2] > 0.0, "{lengths:?}");
        assert_eq!(stepped((0..9).map(|_| [0.0; POSE]), 1.0), [0.0; POSE]);
    }

    /// Over many series of pure chance what is left after what they have by chance is small.
    #[test]
    fn gradients_of_chance_agree_little() {
        use rand::{Rng, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        for visits in [2, 3, 10, 40] {
            let mut square = 0.0;
            for _ in 0..400 {
                let mut moments = Moments::default();
                for _ in 0..visits {
                    moments.gather([0; POSE].map(|_| rng.random_range(-1.0..1.0)), true);
                    moments.step(1.0, 1.0);
                }
                let [left1, left2] = moments.unbiased();
                let mean: f64 = moments.first.iter().map(|v| (v / left1).powi(2)).sum();
                square += mean / moments.second.iter().map(|v| v / left2).sum::<f64>() / 400.0;
            }
            let chance = [(2, 0.501), (3, 0.335), (10, 0.109), (40, 0.0542)].iter().find(|c| c.0 == visits).unwrap().1;
            assert!((square / chance - 1.0).abs() < 0.15, "{visits} visits: {square}, of {chance}");
        }
    }

    #[test]
    fn levelled_moments_have_no_mean_and_the_same_differences() {
        let one = |i: i32| Moments {
            first: [0.5 * f64::from(i), 2.0, -1.0, 0.0, 1.5, f64::from(i * i)],
            ..Moments::default()
        };
        let given: Vec<Moments> = (0..4).map(one).collect();
        let mut levelled = given.clone();
        level_moments(&mut levelled);
        for i in 0..POSE {
            let sum: f64 = levelled.iter().map(|moments| moments.first[i]).sum();
            assert!(sum.abs() < 1e-14, "{sum}");
            let apart = |of: &[Moments]| of[3].first[i] - of[0].first[i];
            assert!((apart(&levelled) - apart(&given)).abs() < 1e-14);
        }
        assert!(levelled[0].first[0] < -0.7 && levelled[3].first[0] > 0.7, "{levelled:?}");
        level_moments(&mut []);
    }
}
