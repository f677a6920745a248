//! What a pass rasterizes besides the Gaussians: camera, background, how Gaussians look.

use super::dropout::Dropout;
use super::surface::SurfaceOptions;
use crate::camera::Camera;
use crate::scene::Splats;
use ibgs_shaders::types::ViewUniforms;

/// What to rasterize besides the Gaussians.
#[derive(Clone, Copy, Debug)]
pub struct RasterView {
    /// The target camera.
    pub camera: Camera,
    /// Colour behind everything.
    pub background: [f32; 3],
    /// Active spherical-harmonics degree; the stored one is the upper bound.
    pub sh_degree: u32,
    /// Half side of the box that a Gaussian is cut by, in standard deviations; 0: none, a Gaussian reaches every pixel where its
    /// alpha is 1/255 or more. Published: 3, where alpha may still be 0.011 times the opacity.
    pub box_sigma: f32,
    /// Clamp of x/z and y/z in the projection's Jacobian, in tan(half field of view) (method.md: 1.3).
    pub tangent_limit: f32,
    /// Normal map, median intersections and median depth beside the colour; none: colour alone.
    pub surface: Option<SurfaceOptions>,
    /// Gaussians to leave out.
    pub dropout: Dropout,
    /// How Gaussians look.
    pub shape: Shape,
}

/// How Gaussians look in an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shape {
    /// Blended, as they are.
    #[default]
    Gaussians,
    /// As opaque ellipsoids with hard edges, without surface and gradients.
    Ellipsoids,
}

impl RasterView {
    /// Black background, the constants of method.md section 2.
    pub fn new(camera: Camera, sh_degree: u32) -> Self {
        Self {
            camera,
            background: [0.0; 3],
            sh_degree,
            box_sigma: 0.0,
            tangent_limit: 1.3,
            surface: None,
            dropout: Dropout::default(),
            shape: Shape::default(),
        }
    }

    pub(super) fn frame(&self, splats: &Splats, capacity: usize) -> ViewUniforms {
        let c = &self.camera;
        let r = c.view_from_world.transpose();
        let row = |axis: glam::DVec3, t: f64| axis.extend(t).as_vec4().to_array();
        ViewUniforms {
            row0: row(r.x_axis, c.translation.x),
            row1: row(r.y_axis, c.translation.y),
            row2: row(r.z_axis, c.translation.z),
            focal: c.focal.as_vec2().to_array(),
            principal: (c.principal - 0.5).as_vec2().to_array(),
            center: c.center().as_vec3().to_array(),
            count: splats.count as u32,
            size: [c.width, c.height],
            dropout_below: self.dropout.below,
            dropout_seed: self.dropout.seed,
            background: self.background,
            sh_degree: self.sh_degree.min(splats.sh_degree()),
            sh_coefficients: splats.coefficients as u32,
            capacity: capacity as u32,
            box_sigma: self.box_sigma,
            tangent_limit: self.tangent_limit,
        }
    }
}
