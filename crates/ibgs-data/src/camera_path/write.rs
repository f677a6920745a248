//! Writing nerfstudio's camera-path JSON, with the fields that its viewer writes.

use super::{CameraPathError, Keyframe, KeyframePath};
use crate::files::write_atomically;
use glam::DMat4;
use serde::Serialize;
use std::path::Path;

/// The file. nerfstudio's `default_fov` is left out: its viewer ignores a keyframe's field of view that equals it.
#[derive(Serialize)]
struct Film {
    camera_type: &'static str,
    render_height: u32,
    render_width: u32,
    fps: f64,
    seconds: f64,
    is_cycle: bool,
    smoothness_value: f64,
    /// Not of nerfstudio: the path begins and ends at rest.
    is_eased: bool,
    /// The viewer takes the duration from here.
    default_transition_sec: f64,
    keyframes: Vec<FilmKey>,
    camera_path: Vec<FilmFrame>,
}

#[derive(Serialize)]
struct FilmKey {
    matrix: [f64; 16],
    fov: f64,
    aspect: f64,
    override_transition_enabled: bool,
    override_transition_sec: Option<f64>,
}

#[derive(Serialize)]
struct FilmFrame {
    camera_to_world: [f64; 16],
    fov: f64,
    aspect: f64,
}

/// Writes keyframes and frames.
pub fn save(film: &KeyframePath, path: &Path) -> Result<(), CameraPathError> {
    let text = text(film).map_err(|reason| CameraPathError::Unsuitable { path: path.to_owned(), reason })?;
    Ok(write_atomically(path, |out| out.write_all(text.as_bytes()))?)
}

/// The file's text, or why there can be none.
pub fn text(film: &KeyframePath) -> Result<String, String> {
    film.check()?;
    let aspect = f64::from(film.width) / f64::from(film.height);
    let usual = film.seconds / film.segments().max(1) as f64;
    let key = |(key, way): (&Keyframe, Option<f64>)| {
        let own = way.filter(|way| (way - usual).abs() > 1e-9 * usual);
        FilmKey {
            matrix: rows(key),
            fov: key.fov.to_degrees(),
            aspect,
            override_transition_enabled: own.is_some(),
            override_transition_sec: own,
        }
    };
    let frame = |key: Keyframe| FilmFrame { camera_to_world: rows(&key), fov: key.fov.to_degrees(), aspect };
    let file = Film {
        camera_type: "perspective",
        render_height: film.height,
        render_width: film.width,
        fps: film.fps,
        seconds: film.seconds,
        is_cycle: film.cycle,
        smoothness_value: 0.0,
        is_eased: film.eased,
        default_transition_sec: usual,
        keyframes: film.keyframes.iter().zip(film.ways()).map(key).collect(),
        camera_path: film.film().map(frame).collect(),
    };
    serde_json::to_string(&file).map_err(|error| error.to_string())
}

/// The pose row by row, OpenGL axes: right, up, back.
fn rows(key: &Keyframe) -> [f64; 16] {
    let axes = key.world_from_view;
    let columns = [axes.x_axis, -axes.y_axis, -axes.z_axis].map(|axis| axis.extend(0.0));
    DMat4::from_cols(columns[0], columns[1], columns[2], key.position.extend(1.0)).transpose().to_cols_array()
}

#[cfg(test)]
pub mod tests {
    use super::super::CameraPath;
    use super::super::tests::{difference, path};
    use super::*;
    use glam::DVec3;
    use serde_json::{Value, json};

    pub fn assert_same(found: &KeyframePath, expected: &KeyframePath) {
        let plain = |path: &KeyframePath| (path.width, path.height, path.fps, path.seconds, path.cycle);
        assert_eq!(plain(found), plain(expected));
        assert_eq!(found.keyframes.len(), expected.keyframes.len());
        for (a, b) in found.keyframes.iter().zip(&expected.keyframes) {
            assert_eq!(a.position, b.position);
            assert!(a.world_from_view.abs_diff_eq(b.world_from_view, 1e-14) && (a.fov - b.fov).abs() < 1e-14);
        }
    }

    pub fn written(path: &KeyframePath) -> Value {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.json");
        path.save(&file).unwrap();
        serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()
    }

    #[test]
    fn saved_paths_load_again() {
        let folder = tempfile::tempdir().unwrap();
        for (cycle, count) in [(false, 5), (true, 5), (false, 1), (true, 1)] {
            let file = folder.path().join("new/path.json");
            let mut path = path(cycle);
            path.keyframes.truncate(count);
            path.save(&file).unwrap();
            let loaded = KeyframePath::load(&file).unwrap();
            assert_same(&loaded, &path);
            loaded.save(&file).unwrap();
            assert_same(&KeyframePath::load(&file).unwrap(), &path);
            let (frames, saved) = (path.frames(), CameraPath::load(&file).unwrap().cameras);
            assert_eq!((frames.len(), saved.len()), (168, 168));
            for (frame, saved) in frames.iter().zip(&saved) {
                assert!(difference(frame, saved) < 1e-12);
            }
        }
    }

    #[test]
    fn nerfstudio_finds_what_it_reads() {
        for cycle in [false, true] {
            let file = written(&path(cycle));
            // A camera that looks along +z with y down has its y and z axes turned round in OpenGL.
            let pose = path(cycle).keyframes[1];
            let matrix = &file["keyframes"][1]["matrix"];
            let entry = |row: usize, column: usize| matrix[4 * row + column].as_f64().unwrap();
            let column = |i: usize| DVec3::new(entry(0, i), entry(1, i), entry(2, i));
            let axes = pose.world_from_view;
            let expected = [axes.x_axis, -axes.y_axis, -axes.z_axis, pose.position];
            assert_eq!([0, 1, 2, 3].map(column), expected);
            assert_eq!([0, 1, 2, 3].map(|i| entry(3, i)), [0.0, 0.0, 0.0, 1.0]);
            for key in file["keyframes"].as_array().unwrap() {
                assert_eq!(key["aspect"], 64.0 / 48.0);
                assert!(key["fov"].is_f64() && key["override_transition_enabled"] == false);
                assert!(key["override_transition_sec"].is_null());
            }
            assert!((file["keyframes"][1]["fov"].as_f64().unwrap() - pose.fov.to_degrees()).abs() < 1e-12);
            assert!(file.get("default_fov").is_none());
            let transition = file["default_transition_sec"].as_f64().unwrap();
            assert!((transition * if cycle { 5.0 } else { 4.0 } - 7.0).abs() < 1e-12);
            assert_eq!((&file["render_width"], &file["render_height"]), (&json!(64), &json!(48)));
            assert_eq!((&file["fps"], &file["seconds"], &file["is_cycle"]), (&json!(24.0), &json!(7.0), &json!(cycle)));
            assert_eq!(file["camera_type"], "perspective");
        }
    }

    #[test]
    fn unsuitable_paths_are_not_saved() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.json");
        path(false).save(&file).unwrap();
        let before = std::fs::read(&file).unwrap();
        type Change = fn(&mut KeyframePath);
        let cases: [(Change, &str); 10] = [
            (|path| path.keyframes.clear(), "it has no keyframes"),
            (|path| path.width = 0, "`render_width` is 0"),
            (|path| path.height = 20_000, "`render_height` is 20000"),
            (|path| path.fps = f64::NAN, "`fps` is NaN"),
            (|path| path.seconds = f64::INFINITY, "`seconds` is inf"),
            (|path| path.seconds = 1e12, "makes 24000000000000 frames"),
            (|path| path.keyframes[1].position.x = f64::NAN, "keyframes[1]: the position is"),
            (|path| path.keyframes[2].world_from_view.x_axis.x = f64::NAN, "keyframes[2]: `world_from_view`"),
            (|path| path.keyframes[2].world_from_view *= -1.0, "keyframes[2]: `world_from_view` is no rotation"),
            (|path| path.keyframes[3].fov = 0.0, "keyframes[3]: `fov` is 0 degrees"),
        ];
        for (change, expected) in cases {
            let mut path = path(false);
            change(&mut path);
            let error = path.save(&file).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("cannot save the camera path"), "{error}");
            assert_eq!(std::fs::read(&file).unwrap(), before);
        }
        let error = path(false).save(&file.join("below")).unwrap_err();
        assert!(matches!(error, CameraPathError::Write(_)), "{error}");
    }
}
