//! EXR files with everything that a view shows, exactly as it was computed.
//!
//! Channels, all 32-bit floats: `R G B` the final image, `base.R ..`, `residual.R ..`, `depth.Z` (along the optical axis),
//! `normal.X normal.Y normal.Z` (camera space), `visibility.N` (sources that see the pixel's point). Colours are the photos'
//! sRGB values as they are, not linear light; the attribute `ibgs.colorSpace` says so.
//!
//! The camera goes into OpenEXR's standard attributes, in its axes: camera space is x right, y up, z backwards, vectors are
//! rows (`v' = v M`). `worldToCamera` is that rotation and translation. `worldToNDC` gives, after division by w, x in
//! -1..1 from the left to the right edge, y in -1..1 from the lower to the upper edge of the picture, z = 1 - 2 near /
//! depth. The world is the scene's own. Normals and depth keep the axes of COLMAP (x right, y down, z forward). Full precision
//! stands in `ibgs.focal`, `ibgs.principal` (pixels, the upper left corner is 0, 0) and `ibgs.viewFromWorld` (rows of
//! `[R | t]`, COLMAP axes).

use crate::camera::Camera;
use crate::files::{WriteError, write_atomically};
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes, Text,
    Vec2, WritableImage,
};
use glam::{DMat4, DVec3, DVec4};
use std::io;
use std::path::Path;

/// What a view shows; what is not there is left out of the file. Row by row, colours and normals `[H, W, 3]`, the others
/// `[H, W]`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Layers<'a> {
    /// The final image.
    pub image: Option<&'a [f32]>,
    /// The base image.
    pub base: Option<&'a [f32]>,
    /// The residual.
    pub residual: Option<&'a [f32]>,
    /// View depths in scene units.
    pub depth: Option<&'a [f32]>,
    /// Camera-space normals.
    pub normal: Option<&'a [f32]>,
    /// Number of sources.
    pub visibility: Option<&'a [u32]>,
}

/// `worldToCamera` and `worldToNDC` as OpenEXR wants them: row after row, for row vectors.
///
/// `near` is the near plane in scene units: the depth up to which Gaussians are culled (method.md section 2).
pub fn world_matrices(camera: &Camera, near: f64) -> [[f32; 16]; 2] {
    let mut view = DMat4::from_mat3(camera.view_from_world);
    view.w_axis = camera.translation.extend(1.0);
    let flipped = DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0)) * view;
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let (f, p) = (camera.focal, camera.principal);
    // Rows of the projection from COLMAP's view space; the last one divides by the depth.
    let clip = DMat4::from_cols(
        DVec4::new(2.0 * f.x / w, 0.0, 2.0 * p.x / w - 1.0, 0.0),
        DVec4::new(0.0, -2.0 * f.y / h, 1.0 - 2.0 * p.y / h, 0.0),
        DVec4::new(0.0, 0.0, 1.0, -2.0 * near),
        DVec4::new(0.0, 0.0, 1.0, 0.0),
    )
    .transpose();
    // The columns of a matrix for column vectors are the rows of the one for row vectors.
    [flipped, clip * view].map(|m| m.to_cols_array().map(|v| v as f32))
}

fn attributes(camera: &Camera, near: f64) -> LayerAttributes {
    let [world_to_camera, world_to_ndc] = world_matrices(camera, near);
    let fov = |size: u32, focal: f64| (2.0 * (0.5 * f64::from(size) / focal).atan()) as f32;
    let mut attributes = LayerAttributes {
        world_to_camera: Some(world_to_camera),
        world_to_normalized_device: Some(world_to_ndc),
        horizontal_field_of_view: Some(fov(camera.width, camera.focal.x)),
        vertical_field_of_view: Some(fov(camera.height, camera.focal.y)),
        near_clip_plane: Some(near as f32),
        software_name: Some("ibgs".into()),
        ..LayerAttributes::default()
    };
    let numbers = |values: &[f64]| {
        let texts: Vec<String> = values.iter().map(ToString::to_string).collect();
        AttributeValue::Text(texts.join(" ").as_str().into())
    };
    let rotation = camera.view_from_world.transpose().to_cols_array();
    let t = camera.translation;
    let rows: Vec<f64> = (0..3).flat_map(|i| [&rotation[3 * i..3 * i + 3], &[t[i]]].concat()).collect();
    attributes.other.extend([
        (Text::from("ibgs.focal"), numbers(&camera.focal.to_array())),
        (Text::from("ibgs.principal"), numbers(&camera.principal.to_array())),
        (Text::from("ibgs.viewFromWorld"), numbers(&rows)),
        (Text::from("ibgs.colorSpace"), AttributeValue::Text("sRGB, as stored in the photos".into())),
    ]);
    attributes
}

/// One channel a letter of `letters`, out of interleaved values.
fn channels(prefix: &str, letters: &[&str], values: &[f32]) -> Vec<AnyChannel<FlatSamples>> {
    let channel = |(at, letter): (usize, &&str)| {
        let plane = values.iter().skip(at).step_by(letters.len()).copied().collect();
        AnyChannel::new(format!("{prefix}{letter}").as_str(), FlatSamples::F32(plane))
    };
    letters.iter().enumerate().map(channel).collect()
}

/// Name of a layer, its channels, and its values where it is wanted.
type NamedLayer<'a> = (&'a str, &'a [&'a str], Option<&'a [f32]>);

/// Writes an EXR file in one atomic step, folders included. `near` is the near plane in scene units.
///
/// # Errors
/// When the file cannot be written.
///
/// # Panics
/// When a layer has another size than the camera's image: a bug of ours.
pub fn write(path: &Path, camera: &Camera, near: f64, layers: &Layers<'_>) -> Result<(), WriteError> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let visibility: Option<Vec<f32>> = layers.visibility.map(|counts| counts.iter().map(|&n| n as f32).collect());
    let named: [NamedLayer<'_>; 6] = [
        ("", &["R", "G", "B"], layers.image),
        ("base.", &["R", "G", "B"], layers.base),
        ("residual.", &["R", "G", "B"], layers.residual),
        ("depth.", &["Z"], layers.depth),
        ("normal.", &["X", "Y", "Z"], layers.normal),
        ("visibility.", &["N"], visibility.as_deref()),
    ];
    let mut list = Vec::new();
    for (prefix, letters, values) in named {
        let Some(values) = values else {
            continue;
        };
        assert_eq!(values.len(), width * height * letters.len(), "layer `{prefix}` and camera differ in size");
        list.extend(channels(prefix, letters, values));
    }
    let size = Vec2(width, height);
    let layer =
        Layer::new(size, attributes(camera, near), Encoding::SMALL_FAST_LOSSLESS, AnyChannels::sort(list.into()));
    let mut image = Image::from_layer(layer);
    image.attributes.display_window = IntegerBounds::from_dimensions(size);
    let mut bytes = io::Cursor::new(Vec::new());
    let written = image.write().to_buffered(&mut bytes);
    let written = written.map_err(|error| match error {
        exr::error::Error::Io(error) => error,
        error => io::Error::other(error),
    });
    write_atomically(path, |out| written.and_then(|()| out.write_all(bytes.get_ref())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{ReadChannels, ReadLayers, read};
    use glam::{DMat3, DQuat, DVec2};

    const NEAR: f64 = 0.2;

    fn camera() -> Camera {
        Camera {
            width: 7,
            height: 5,
            focal: DVec2::new(6.1, 5.9),
            principal: DVec2::new(3.2, 2.7),
            view_from_world: DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7)),
            translation: DVec3::new(0.3, -1.2, 4.0),
        }
    }

    /// A point by OpenEXR's rule: the row vector times the matrix, divided by w.
    fn transformed(point: DVec3, m: &[f32; 16]) -> DVec3 {
        let p = point.extend(1.0).to_array();
        let out = [0, 1, 2, 3].map(|j| (0..4).map(|i| p[i] * f64::from(m[4 * i + j])).sum::<f64>());
        DVec3::new(out[0], out[1], out[2]) / out[3]
    }

    #[test]
    fn matrices_follow_openexr() {
        let camera = camera();
        let [to_camera, to_ndc] = world_matrices(&camera, NEAR);
        for point in [DVec3::new(0.1, 0.2, 0.3), DVec3::new(-1.0, 0.5, 2.0)] {
            let view = camera.to_view(point);
            assert!(transformed(point, &to_camera).distance(view * DVec3::new(1.0, -1.0, -1.0)) < 1e-6);
            let (uv, depth) = camera.project(point);
            let ndc = DVec3::new(uv.x / 3.5 - 1.0, 1.0 - uv.y / 2.5, 1.0 - 2.0 * NEAR / depth);
            assert!(transformed(point, &to_ndc).distance(ndc) < 1e-6);
        }
    }

    #[test]
    fn every_value_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/view.exr");
        let ramp = |count: usize, from: f32| -> Vec<f32> { (0..count).map(|i| from + 0.1 * i as f32).collect() };
        let (image, base, residual, normal) = (ramp(105, -3.0), ramp(105, 1e-20), ramp(105, 0.7), ramp(105, 1e6));
        let (depth, visibility) = (ramp(35, 1.0 / 3.0), (0..35).map(|i| i % 4).collect::<Vec<u32>>());
        let layers = Layers {
            image: Some(&image),
            base: Some(&base),
            residual: Some(&residual),
            depth: Some(&depth),
            normal: Some(&normal),
            visibility: Some(&visibility),
        };
        write(&path, &camera(), NEAR, &layers).unwrap();
        let file = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
        let layer = file.from_file(&path).unwrap().layer_data;
        assert_eq!(layer.size, Vec2(7, 5));
        let plane = |name: &str| -> Vec<f32> {
            let channel = layer.channel_data.list.iter().find(|channel| channel.name.eq(name));
            channel.unwrap_or_else(|| panic!("no channel {name}")).sample_data.values_as_f32().collect()
        };
        assert_eq!(layer.channel_data.list.len(), 14);
        for (prefix, letters, values) in
            [("", "RGB", &image), ("base.", "RGB", &base), ("residual.", "RGB", &residual), ("normal.", "XYZ", &normal)]
        {
            for (c, letter) in letters.chars().enumerate() {
                let expected: Vec<f32> = values.iter().skip(c).step_by(3).copied().collect();
                assert_eq!(plane(&format!("{prefix}{letter}")), expected, "{prefix}{letter}");
            }
        }
        assert_eq!(plane("depth.Z"), depth);
        assert_eq!(plane("visibility.N"), visibility.iter().map(|&n| n as f32).collect::<Vec<_>>());
        let [to_camera, to_ndc] = world_matrices(&camera(), NEAR);
        assert_eq!(layer.attributes.world_to_camera, Some(to_camera));
        assert_eq!(layer.attributes.world_to_normalized_device, Some(to_ndc));
        let text = |name: &str| match &layer.attributes.other[&Text::from(name)] {
            AttributeValue::Text(text) => text.to_string(),
            other => panic!("{name} is {other:?}"),
        };
        assert_eq!(text("ibgs.focal"), "6.1 5.9");
        let rows: Vec<f64> = text("ibgs.viewFromWorld").split(' ').map(|v| v.parse().unwrap()).collect();
        assert_eq!((rows.len(), rows[7], rows[11]), (12, -1.2, 4.0));
        assert_eq!(rows[1], camera().view_from_world.y_axis.x);
    }
}
