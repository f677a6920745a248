//! Other looks of the Gaussians than their own.

use crate::IN_BROWSER;
use ibgs_core::camera::Camera;
use ibgs_core::gpu::GpuError;
use ibgs_core::render::{Frame, Renderer};
use std::sync::Arc;

/// How Gaussians can look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// As opaque points.
    Points,
    /// As opaque ellipsoids.
    Ellipsoids,
}

impl Look {
    /// All of them.
    pub const ALL: [Look; 2] = [Look::Points, Look::Ellipsoids];

    /// A renderer of the same Gaussians in this look.
    ///
    /// # Errors
    /// Not enough memory.
    pub fn of(self, renderer: &Renderer) -> Result<Renderer, GpuError> {
        match self {
            Look::Points => renderer.of_points(),
            Look::Ellipsoids => Ok(renderer.of_ellipsoids()),
        }
    }
}

/// Renders a frame and waits for it, in a browser without stopping the page.
///
/// # Errors
/// Not enough memory, the device is lost, or what `then` finds.
pub async fn rendered(
    renderer: &Renderer,
    camera: &Camera,
    then: impl FnMut(&Frame) -> Result<(), GpuError>,
) -> Result<Frame, GpuError> {
    if IN_BROWSER { renderer.render_async(camera, then).await } else { renderer.render_and(camera, then) }
}

/// The renderers of a model's looks, made when they are first asked for.
#[derive(Default)]
pub struct Looks([Option<Renderer>; Look::ALL.len()]);

impl Looks {
    /// The looks that are asked for, each handed to `then`.
    ///
    /// # Errors
    /// Not enough memory, the device is lost, or what `then` finds.
    pub async fn frames(
        &mut self,
        renderer: &Renderer,
        camera: &Camera,
        asked_for: [bool; Look::ALL.len()],
        mut then: impl FnMut(&Frame, Look) -> Result<(), GpuError>,
    ) -> Result<[Option<Arc<Frame>>; Look::ALL.len()], GpuError> {
        let background = renderer.background();
        let mut frames = [const { None }; Look::ALL.len()];
        for look in Look::ALL.into_iter().filter(|&look| asked_for[look as usize]) {
            let made = match self.0[look as usize].take() {
                Some(made) => made,
                None => look.of(renderer)?,
            };
            made.set_background(background);
            let frame = rendered(&made, camera, |frame| then(frame, look)).await?;
            frames[look as usize] = Some(Arc::new(frame));
            self.0[look as usize] = Some(made);
        }
        Ok(frames)
    }
}
