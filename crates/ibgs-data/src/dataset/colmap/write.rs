//! Cameras as a COLMAP model in text.

use crate::camera::Camera;
use glam::DQuat;
use std::fmt::Write;

/// The files of a COLMAP model, by name, with the poses of these photos: a pinhole camera for each lens, no points and no
/// observations. Numbers keep all digits.
pub fn text_model<'a>(photos: impl Iterator<Item = (&'a str, &'a Camera)>) -> [(&'static str, String); 3] {
    let mut lenses: Vec<&Camera> = Vec::new();
    let mut cameras = "# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY\n".to_owned();
    let mut images = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of observations\n".to_owned();
    for ((name, camera), number) in photos.zip(1..) {
        let lens = lenses.iter().position(|lens| lens.has_lens_of(camera)).unwrap_or_else(|| {
            let Camera { width, height, focal, principal, .. } = camera;
            lenses.push(camera);
            let _ = writeln!(
                cameras,
                "{} PINHOLE {width} {height} {} {} {} {}",
                lenses.len(),
                focal.x,
                focal.y,
                principal.x,
                principal.y
            );
            lenses.len() - 1
        });
        let DQuat { x, y, z, w } = DQuat::from_mat3(&camera.view_from_world).normalize();
        let t = camera.translation;
        let _ = writeln!(images, "{number} {w} {x} {y} {z} {} {} {} {} {name}\n", t.x, t.y, t.z, lens + 1);
    }
    let points = "# POINT3D_ID X Y Z R G B ERROR TRACK\n".to_owned();
    [("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", points)]
}

#[cfg(test)]
mod tests {
    use super::super::text;
    use super::*;
    use glam::{DMat3, DVec2, DVec3};
    use std::path::Path;

    #[test]
    fn what_is_written_is_read_again() {
        let camera = Camera {
            width: 40,
            height: 30,
            focal: DVec2::new(31.25, 32.1),
            principal: DVec2::new(20.0, 14.5),
            view_from_world: DMat3::from_rotation_y(2.0) * DMat3::from_rotation_x(-0.3),
            translation: DVec3::new(0.1, -2.0 / 3.0, 1e-9),
        };
        let other = Camera { focal: camera.focal * 2.0, ..camera };
        let photos = [("a b.jpg", &camera), ("c/d.png", &other), ("e.png", &camera)];
        let [(_, cameras), (_, images), _] = text_model(photos.into_iter());
        let lenses = text::cameras(Path::new("cameras.txt"), cameras.as_bytes()).unwrap();
        let found = super::super::models::records(text::images(Path::new("images.txt"), images.as_bytes()).unwrap());
        assert_eq!((lenses.len(), found.len()), (2, 3));
        for ((name, camera), image) in photos.into_iter().zip(found) {
            let lens = &lenses[&image.camera];
            let numbers = [camera.focal.x, camera.focal.y, camera.principal.x, camera.principal.y];
            assert_eq!((image.name.as_str(), lens.model, &lens.params[..]), (name, "PINHOLE", &numbers[..]));
            assert_eq!(image.translation, camera.translation.to_array());
            let [w, x, y, z] = image.quaternion;
            let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
            assert!(rotation.abs_diff_eq(camera.view_from_world, 1e-15));
        }
    }
}
