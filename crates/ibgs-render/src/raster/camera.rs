//! Gradients by cameras.

use crate::gpu::{Buffer, Gpu, GpuError, Pass};
use glam::DVec3;
use ibgs_data::camera_change::CameraChange;
use ibgs_shaders::CAMERA_GROUPS;
use ibgs_shaders::bindings::CameraTotalBindings;
use ibgs_shaders::types::CameraTotalParams;

/// Rows of a camera's gradient on the device: (translation, focal x), (rotation, focal y), (principal point, 0, 0).
const ROWS: usize = 3;

/// Gradients by the cameras of a target view and of its sources, in this order: each backward pass of an iteration adds its own, in
/// a fixed order. Cloning shares them. The sources' depth maps and the directions that the network reads are constants.
#[derive(Clone, Debug)]
pub struct CameraGradients {
    rows: Buffer<[f32; 4]>,
    /// Sums of workgroups, of one kernel at a time: three rows each, of two cameras where it has both.
    partials: Buffer<[f32; 4]>,
    cameras: usize,
}

impl CameraGradients {
    /// Zeroed, for a target and as many sources.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn new(gpu: &Gpu, sources: usize) -> Result<Self, GpuError> {
        let cameras = 1 + sources;
        Ok(Self {
            rows: gpu.allocate("gradients of cameras", ROWS * cameras)?,
            partials: gpu.allocate("sums of cameras", 2 * ROWS * CAMERA_GROUPS as usize)?,
            cameras,
        })
    }

    /// Records that they are zero again.
    pub fn record_clear(&self, pass: &mut Pass) {
        pass.clear(&self.rows);
    }

    /// `[1 + M, 3]`: what has been gathered, see [`CameraGradients::gradients`].
    pub fn rows(&self) -> &Buffer<[f32; 4]> {
        &self.rows
    }

    /// The gradients that rows of the device say.
    pub fn gradients(rows: &[[f32; 4]]) -> Vec<CameraChange> {
        let of = |[a, b, c]: &[[f32; 4]; ROWS]| {
            let [a, b, c] = [a, b, c].map(|row| row.map(f64::from));
            CameraChange {
                translation: DVec3::new(a[0], a[1], a[2]),
                rotation: DVec3::new(b[0], b[1], b[2]),
                focal: [a[3], b[3]].into(),
                principal: [c[0], c[1]].into(),
            }
        };
        rows.as_chunks().0.iter().map(of).collect()
    }

    /// What has been gathered; waits for the GPU.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<CameraChange>, GpuError> {
        Ok(Self::gradients(&gpu.read(&self.rows, ROWS * self.cameras)?))
    }

    /// Where a kernel leaves the sums of its workgroups.
    pub fn partials(&self) -> &Buffer<[f32; 4]> {
        &self.partials
    }

    /// Records that the sums of a kernel are added to the target's gradient.
    pub fn record_target(&self, pass: &mut Pass) {
        self.record_total(pass, &CameraTotalParams { stride: ROWS as u32, ..CameraTotalParams::default() });
    }

    /// Records that the sums of a kernel are added to the gradients of the target and of a source.
    pub(crate) fn record_both(&self, pass: &mut Pass, source: u32) {
        let stride = 2 * ROWS as u32;
        self.record_total(pass, &CameraTotalParams { stride, ..CameraTotalParams::default() });
        self.record_total(pass, &CameraTotalParams { stride, first: ROWS as u32, camera: 1 + source, pad: 0 });
    }

    fn record_total(&self, pass: &mut Pass, params: &CameraTotalParams) {
        let bindings = CameraTotalBindings { partials: &self.partials, v_cameras: &self.rows };
        pass.groups(&bindings, params, 1);
    }
}
