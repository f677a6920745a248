//! Cameras, and points with their observations, as a COLMAP model in text.

use crate::adjust::Seen;
use crate::camera::Camera;
use crate::dataset::Point;
use glam::DQuat;
use std::collections::BTreeMap;
use std::fmt::Write;

/// The files of a COLMAP model, by name, with the poses of these photos, and with points that the photos of these numbers have: a
/// pinhole camera for each lens. Numbers keep all digits.
pub fn text_model<'a>(
    photos: impl Iterator<Item = (&'a str, &'a Camera)>,
    points: &[(Point, Vec<Seen>)],
) -> [(&'static str, String); 3] {
    let mut lenses: Vec<&Camera> = Vec::new();
    let mut cameras = "# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY\n".to_owned();
    let (listed, mut observed) = listed_points(points);
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
        let own = observed.remove(&(number - 1)).unwrap_or_default().line;
        let _ = writeln!(images, "{number} {w} {x} {y} {z} {} {} {} {} {name}\n{own}", t.x, t.y, t.z, lens + 1);
    }
    [("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", listed)]
}

/// What a photo has of the points: `X Y POINT3D_ID` each, and how many.
#[derive(Default)]
struct Observed {
    line: String,
    count: usize,
}

/// The file of the points, and the observations of each photo by its number.
fn listed_points(points: &[(Point, Vec<Seen>)]) -> (String, BTreeMap<usize, Observed>) {
    let mut listed = "# POINT3D_ID X Y Z R G B ERROR TRACK\n".to_owned();
    let mut observed: BTreeMap<usize, Observed> = BTreeMap::new();
    for ((Point { position: p, color: [r, g, b] }, seen), number) in points.iter().zip(1..) {
        let _ = write!(listed, "{number} {} {} {} {r} {g} {b} 0", p.x, p.y, p.z);
        for Seen { view, pixel } in seen {
            let Observed { line, count } = observed.entry(*view).or_default();
            let _ = write!(listed, " {} {count}", view + 1);
            let _ = write!(line, "{}{} {} {number}", if *count > 0 { " " } else { "" }, pixel.x, pixel.y);
            *count += 1;
        }
        listed.push('\n');
    }
    (listed, observed)
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
        let seen = |view: usize, x: f64| Seen { view, pixel: DVec2::new(x, 1.0 / 3.0) };
        let point = |x: f64| Point { position: DVec3::new(x, 0.1, -2.5), color: [1, 2, 255] };
        let points = [(point(0.7), vec![seen(0, 7.25), seen(2, 39.5)]), (point(-1e-7), vec![seen(2, 0.1)])];
        let [(_, cameras), (_, images), (_, listed)] = text_model(photos.into_iter(), &points);
        let lenses = text::cameras(Path::new("cameras.txt"), cameras.as_bytes()).unwrap();
        let path = Path::new("images.txt");
        let found = text::images(path, images.as_bytes()).unwrap();
        let observed = found.iter().map(|(_, raw)| text::observations(path, *raw).unwrap());
        let at = |x: f64| DVec2::new(x, 1.0 / 3.0);
        assert_eq!(observed.collect::<Vec<_>>(), [vec![(1, at(7.25))], vec![], vec![(1, at(39.5)), (2, at(0.1))]]);
        let read = text::points(Path::new("points3D.txt"), listed.as_bytes()).unwrap();
        let places = read.iter().map(|sparse| (sparse.id, sparse.point.position, sparse.point.color));
        let written = points.iter().zip(1..).map(|((point, _), id)| (id, point.position, point.color));
        assert!(places.eq(written), "{listed}");
        let found = super::super::models::records(found);
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
