//! The cameras of the training views in a training: they learn from the gradients of all that reads them.
//!
//! Each view gathers the gradients by its pose, as the target of an iteration and as a source of others, and takes a step of Adam
//! when it has been the target. Views of one lens gather those by its focal lengths and take a step together, once each has been the
//! target. A step is taken some iterations after its gradients were made, always as many, so that nothing waits and runs repeat.
//! After each round of steps, one for each view on average, what all cameras have moved by alike is taken back.

mod levelling;
mod moments;

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
use moments::Moments;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::Arc;

/// Iterations from the gradients to the step.
const DELAY: usize = 3;
/// Numbers of a camera's gradient on the device.
const ROW: usize = 12;
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
            moments::level(&mut self.poses);
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

    /// The angle and the distance (as a part of the distance to what a view shows) that each has moved by, apart from what they have
    /// moved by together.
    pub fn moved(&self) -> Vec<[f64; 2]> {
        let pairs: Vec<_> = self.first.iter().copied().zip(self.cameras.iter().copied()).collect();
        let frame = Similarity::fit(&pairs);
        let own = |((first, now), length): (&(Camera, Camera), &f64)| {
            let (angle, distance) = frame.residual(first, now);
            [angle, distance / length]
        };
        pairs.iter().zip(&self.lengths).map(own).collect()
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
