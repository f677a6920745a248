//! Reading nerfstudio's camera-path JSON: `camera_path` has every frame, `keyframes` what the frames were made from.
//!
//! Poses are 16 numbers, row by row, or rows of four. A frame without a field of view has the file's `default_fov`.

use super::{CameraPath, CameraPathError, Keyframe, KeyframePath, MAX_FRAMES, check_side, rotation};
use crate::files::without_mark;
use glam::{DMat3, DMat4, DQuat, DVec4};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::path::Path;

/// Frames a second where the file does not say, as in nerfstudio's viewer.
const USUAL_FPS: f64 = 30.0;
/// Seconds from keyframe to keyframe where the file does not say, as in nerfstudio's viewer.
const USUAL_TRANSITION: f64 = 2.0;

/// Degrees: a narrower view has no focal length in single precision.
const MIN_FOV: f64 = 1e-6;

/// What all readers need.
#[derive(Deserialize)]
struct Head {
    /// Vertical, degrees: of frames and keyframes without their own.
    default_fov: Option<f64>,
    /// A whole number; nerfstudio may write it as `1080.0`.
    render_width: f64,
    render_height: f64,
    camera_type: Option<String>,
}

#[derive(Deserialize)]
struct PathJson {
    camera_path: Vec<FrameJson>,
}

#[derive(Deserialize)]
struct FrameJson {
    /// Row by row, OpenGL axes.
    camera_to_world: Value,
    /// Vertical, degrees.
    #[serde(default)]
    fov: Value,
}

/// Of frames that need no rate to be rendered.
#[derive(Deserialize)]
struct Rate {
    fps: Option<Value>,
}

/// What the editor needs beyond the frames.
#[derive(Deserialize)]
struct Plan {
    keyframes: Option<Vec<Value>>,
    fps: Option<f64>,
    seconds: Option<f64>,
    is_cycle: Option<bool>,
    is_eased: Option<bool>,
    default_transition_sec: Option<f64>,
}

/// Reads a file with one of the parsers below.
pub fn load<T>(path: &Path, parse: impl Fn(&str) -> Result<T, String>) -> Result<T, CameraPathError> {
    let text =
        std::fs::read_to_string(path).map_err(|source| CameraPathError::Read { path: path.to_owned(), source })?;
    parse(&text).map_err(|reason| CameraPathError::Invalid { path: path.to_owned(), reason })
}

/// The frames as they stand in the file.
pub fn parse_frames(text: &str) -> Result<CameraPath, String> {
    let head = Head::read(text)?;
    let (width, height) = head.size()?;
    let cameras = frames(text, &head)?.iter().map(|frame| frame.camera(width, height)).collect();
    let fps = read::<Rate>(text)?.fps.and_then(|fps| fps.as_f64()).unwrap_or(USUAL_FPS);
    if !(fps > 0.0 && fps.is_finite()) {
        return Err(format!("`fps` is {fps}; it must be a finite number above 0"));
    }
    Ok(CameraPath { cameras, fps })
}

/// The keyframes, or the frames where the file has no keyframes.
pub fn parse_keyframes(text: &str) -> Result<KeyframePath, String> {
    let head = Head::read(text)?;
    let (width, height) = head.size()?;
    let plan: Plan = read(text)?;
    let fps = plan.fps.unwrap_or(USUAL_FPS);
    let cycle = plan.is_cycle.unwrap_or(false);
    // Other programs write the list without poses, or with nothing in it.
    let records = plan.keyframes.unwrap_or_default();
    let (mut keyframes, usual_seconds) = if records.iter().any(|record| record.get("matrix").is_some()) {
        let keyframes = records.iter().enumerate();
        let keyframes =
            keyframes.map(|(i, key)| keyframe(key, &head).map_err(|what| format!("keyframes[{i}]: {what}")));
        let usual = plan.default_transition_sec.unwrap_or(USUAL_TRANSITION);
        let mut keyframes = keyframes.collect::<Result<Vec<_>, _>>()?;
        for (key, record) in keyframes.iter_mut().zip(&records) {
            let is_own = record["override_transition_enabled"] == true;
            key.way = record["override_transition_sec"].as_f64().filter(|_| is_own).unwrap_or(usual);
        }
        let ways = keyframes.iter().skip(usize::from(!cycle)).map(|key| key.way).sum();
        (keyframes, if ways > 0.0 { ways } else { USUAL_TRANSITION })
    } else {
        let frames = frames(text, &head)?;
        let seconds = frames.len() as f64 / fps;
        (frames, seconds)
    };
    for key in &mut keyframes {
        key.world_from_view = DMat3::from_quat(DQuat::from_mat3(&key.world_from_view).normalize());
    }
    let seconds = plan.seconds.unwrap_or(usual_seconds);
    let eased = plan.is_eased.unwrap_or(false);
    let path = KeyframePath { keyframes, width, height, fps, seconds, cycle, eased };
    path.check().map(|()| path)
}

fn read<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_slice(without_mark(text.as_bytes())).map_err(|error| error.to_string())
}

impl Head {
    fn read(text: &str) -> Result<Self, String> {
        read(text)
    }

    fn size(&self) -> Result<(u32, u32), String> {
        match &self.camera_type {
            Some(kind) if !kind.eq_ignore_ascii_case("perspective") => {
                Err(format!("`camera_type` is `{kind}`; only `perspective` can be rendered"))
            }
            _ => Ok((check_side("render_width", self.render_width)?, check_side("render_height", self.render_height)?)),
        }
    }

    /// The field of view of a frame in degrees, or the usual one where the frame has none.
    fn fov(&self, of_frame: &Value) -> Result<f64, String> {
        match (of_frame, self.default_fov) {
            (Value::Null, Some(usual)) => Ok(usual),
            (Value::Null, None) => {
                Err("`fov` must be a number of degrees, as the file has no `default_fov` either".to_owned())
            }
            _ => of_frame.as_f64().ok_or_else(|| "`fov` must be a number of degrees".to_owned()),
        }
    }
}

/// The 16 numbers of a pose in their order: one list, or four rows of four. Of three rows the last one is that of every pose.
fn numbers(matrix: &Value) -> Option<[f64; 16]> {
    let rows = matrix.as_array()?;
    let flat: Option<Vec<f64>> = match rows.first()?.is_array() {
        true if rows.iter().all(|row| row.as_array().is_some_and(|row| row.len() == 4)) => {
            rows.iter().filter_map(Value::as_array).flatten().map(Value::as_f64).collect()
        }
        _ => rows.iter().map(Value::as_f64).collect(),
    };
    let mut flat = flat?;
    if flat.len() == 12 && rows.len() == 3 {
        flat.extend([0.0, 0.0, 0.0, 1.0]);
    }
    flat.try_into().ok()
}

fn frames(text: &str, head: &Head) -> Result<Vec<Keyframe>, String> {
    let PathJson { camera_path: frames } = read(text)?;
    match frames.len() {
        0 => return Err("`camera_path` is empty".to_owned()),
        count if count > MAX_FRAMES as usize => {
            return Err(format!("`camera_path` has {count} frames; there must be at most {MAX_FRAMES}"));
        }
        _ => {}
    }
    let frames = frames.iter().enumerate().map(|(i, frame)| {
        let matrix = numbers(&frame.camera_to_world).ok_or("`camera_to_world` must be 16 numbers, or 4 rows of 4");
        let frame = matrix.map_err(str::to_owned).and_then(|matrix| {
            pose("camera_to_world", &DMat4::from_cols_array(&matrix).transpose(), head.fov(&frame.fov)?)
        });
        frame.map_err(|what| format!("camera_path[{i}]: {what}"))
    });
    frames.collect()
}

/// A keyframe. nerfstudio's viewer writes `matrix` as numbers row by row; the one before it, and the add-on for Blender,
/// as text with the numbers column by column.
fn keyframe(record: &Value, head: &Head) -> Result<Keyframe, String> {
    let matrix = match &record["matrix"] {
        Value::String(text) => serde_json::from_str(text).ok().as_ref().and_then(numbers),
        value => numbers(value),
    };
    let matrix = matrix.ok_or("`matrix` must be 16 numbers, or 4 rows of 4")?;
    let columns = DMat4::from_cols_array(&matrix);
    let mut orders = [columns.transpose(), columns];
    if record["matrix"].is_string() {
        orders.reverse();
    }
    // Some programs mix up the orders; a last row that cannot be one shows it.
    let matrix = orders.into_iter().find(|matrix| matrix.row(3).abs_diff_eq(DVec4::W, 1e-6));
    let matrix = matrix.ok_or("`matrix` is no pose: its last row must be 0 0 0 1")?;
    pose("matrix", &matrix, head.fov(&record["fov"])?)
}

/// A pose with OpenGL axes and a vertical field of view in degrees.
fn pose(name: &str, matrix: &DMat4, fov: f64) -> Result<Keyframe, String> {
    if !matrix.is_finite() {
        return Err(format!("`{name}` holds a number that is not finite"));
    }
    if !(fov > MIN_FOV && fov < 180.0) {
        return Err(format!("`fov` is {fov}; it must lie between 0 and 180 degrees"));
    }
    let [right, up, back] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(DVec4::truncate);
    let world_from_view = rotation(DMat3::from_cols(right, -up, -back));
    let world_from_view = world_from_view.ok_or_else(|| format!("`{name}` is no rotation"))?;
    let keyframe = Keyframe { position: matrix.w_axis.truncate(), world_from_view, fov: fov.to_radians(), way: 1.0 };
    keyframe.check().map(|()| keyframe)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{difference, path};
    use super::super::write::tests::{assert_same, written};
    use super::*;
    use serde_json::json;

    #[test]
    fn keyframes_of_older_files_load() {
        let expected = path(true);
        let mut file = written(&expected);
        // Sizes as numbers with a point, keyframes as text column by column, unreadable frames.
        file["render_width"] = json!(64.0);
        file["render_height"] = json!(48.0);
        file["camera_path"] = json!(["nothing"]);
        for key in file["keyframes"].as_array_mut().unwrap() {
            let rows = <[f64; 16]>::deserialize(&key["matrix"]).unwrap();
            let columns = DMat4::from_cols_array(&rows).transpose().to_cols_array();
            let properties = r#"[["FOV",50],["NAME","Camera 0"],["TIME",0]]"#;
            *key = json!({"matrix": json!(columns).to_string(), "fov": key["fov"], "properties": properties});
        }
        assert_same(&parse_keyframes(&file.to_string()).unwrap(), &expected);
        // The wrong order of either form is seen by the last row.
        let mut mixed = written(&expected);
        let columns = file["keyframes"][1]["matrix"].as_str().unwrap();
        mixed["keyframes"][1]["matrix"] = serde_json::from_str(columns).unwrap();
        mixed["keyframes"][2]["matrix"] = mixed["keyframes"][2]["matrix"].to_string().into();
        assert_same(&parse_keyframes(&mixed.to_string()).unwrap(), &expected);
    }

    #[test]
    fn frames_stand_in_for_missing_keyframes() {
        for cycle in [false, true] {
            let mut path = path(cycle);
            (path.fps, path.seconds) = (10.0, 2.0);
            for keyframes in [json!(null), json!([]), json!([{"camera_to_world": []}, 3])] {
                let mut file = written(&path);
                file["keyframes"] = keyframes;
                let loaded = parse_keyframes(&file.to_string()).unwrap();
                assert_eq!((loaded.keyframes.len(), loaded.fps, loaded.seconds), (20, 10.0, 2.0));
                for (a, b) in loaded.frames().iter().zip(&path.frames()) {
                    assert!(difference(a, b) < 1e-12, "the film is another one after loading");
                }
            }
        }
    }

    #[test]
    fn missing_times_have_usual_values() {
        let mut file = written(&path(false));
        for name in ["fps", "seconds", "is_cycle"] {
            file.as_object_mut().unwrap().remove(name);
        }
        let times = |file: &Value| parse_keyframes(&file.to_string()).map(|path| (path.fps, path.seconds, path.cycle));
        assert_eq!(times(&file), Ok((30.0, 7.0, false)), "four transitions of the file's own time");
        file.as_object_mut().unwrap().remove("default_transition_sec");
        assert_eq!(times(&file), Ok((30.0, 8.0, false)));
        file["is_cycle"] = json!(true);
        assert_eq!(times(&file), Ok((30.0, 10.0, true)));
        file.as_object_mut().unwrap().remove("keyframes");
        assert_eq!(times(&file), Ok((30.0, 168.0 / 30.0, true)));
    }

    #[test]
    fn rows_of_rows_a_mark_and_absent_fields_of_view() {
        let expected = path(false);
        let mut file = written(&expected);
        let nest = |rows: &Value, count: usize| -> Value {
            let flat = <[f64; 16]>::deserialize(rows).unwrap();
            json!(flat.chunks(4).take(count).collect::<Vec<_>>())
        };
        for (i, key) in file["keyframes"].as_array_mut().unwrap().iter_mut().enumerate() {
            key["matrix"] = nest(&key["matrix"], 4 - i % 2);
        }
        for (i, frame) in file["camera_path"].as_array_mut().unwrap().iter_mut().enumerate() {
            frame["camera_to_world"] = nest(&frame["camera_to_world"], 4 - i % 2);
        }
        let text = format!("\u{feff}{file}");
        assert_same(&parse_keyframes(&text).unwrap(), &expected);
        let usual = parse_frames(&written(&expected).to_string()).unwrap().cameras;
        assert_eq!(parse_frames(&text).unwrap().cameras, usual);
        // The fields of view of all frames are absent in one way or the other.
        file["default_fov"] = json!(50.0);
        for list in ["keyframes", "camera_path"] {
            for (i, frame) in file[list].as_array_mut().unwrap().iter_mut().enumerate() {
                frame["fov"] = json!(null);
                if i % 2 == 0 {
                    frame.as_object_mut().unwrap().remove("fov");
                }
            }
        }
        let degrees = |focal: f64| (24.0 / focal).atan().to_degrees() * 2.0;
        let cameras = parse_frames(&file.to_string()).unwrap().cameras;
        assert!(cameras.iter().all(|camera| (degrees(camera.focal.y) - 50.0).abs() < 1e-9));
        let keys = parse_keyframes(&file.to_string()).unwrap().keyframes;
        assert!(keys.iter().all(|key| (key.fov - 50_f64.to_radians()).abs() < 1e-12));
        file.as_object_mut().unwrap().remove("default_fov");
        assert!(parse_frames(&file.to_string()).unwrap_err().contains("camera_path[0]: `fov` must be a number"));
        for bad in
            [json!([[1, 0, 0, 0], [0, 1, 0], [0, 0, 1, 0, 0], [0, 0, 0, 1]]), json!([1, 2, 3]), json!("16"), json!([])]
        {
            file["camera_path"][0]["camera_to_world"] = bad;
            let error = parse_frames(&file.to_string()).unwrap_err();
            assert!(error.contains("camera_path[0]: `camera_to_world` must be 16 numbers"), "{error}");
        }
    }

    /// The file with one value changed, by its JSON pointer.
    fn with(pointer: &str, value: Value) -> String {
        let mut file = written(&path(false));
        *file.pointer_mut(pointer).unwrap() = value;
        file.to_string()
    }

    #[test]
    fn mistakes_are_named() {
        let sixteen = |value: &str| format!("[{value}{}]", ",0".repeat(15));
        let cases = [
            ("/render_width", json!(0), "`render_width` is 0; it must be a whole number between 1 and 16384"),
            ("/render_height", json!(-4), "`render_height` is -4;"),
            ("/render_height", json!(16_385), "`render_height` is 16385;"),
            ("/render_width", json!(64.5), "`render_width` is 64.5;"),
            ("/render_width", json!("wide"), "line 1"),
            ("/camera_type", json!("equirectangular"), "`camera_type` is `equirectangular`; only `perspective`"),
            ("/fps", json!(0), "`fps` is 0; it must be a number above 0"),
            ("/fps", json!("many"), "line 1"),
            ("/fps", json!(1e9), "`fps` x `seconds` makes 7000000000 frames; it must be at most 1000000"),
            ("/seconds", json!(-1), "`seconds` is -1;"),
            ("/seconds", json!(1e308), "`fps` x `seconds` makes inf frames"),
            ("/is_cycle", json!(3), "line 1"),
            ("/keyframes/3/matrix", json!([1, 0, 0]), "keyframes[3]: `matrix` must be 16 numbers"),
            ("/keyframes/3/matrix", json!("[1, 0, 0]"), "keyframes[3]: `matrix` must be 16 numbers"),
            ("/keyframes/3/matrix", json!(sixteen("NaN")), "keyframes[3]: `matrix` must be 16 numbers"),
            ("/keyframes/3/matrix", json!(sixteen("1e999")), "keyframes[3]: `matrix` must be 16 numbers"),
            ("/keyframes/3/matrix", json!(sixteen("1")), "keyframes[3]: `matrix` is no pose: its last row"),
            ("/keyframes/3/matrix/0", json!(9), "keyframes[3]: `matrix` is no rotation"),
            ("/keyframes/3/matrix/3", json!(1e13), "keyframes[3]: the position is"),
            ("/keyframes/3", json!({"fov": 50}), "keyframes[3]: `matrix` must be 16 numbers"),
            ("/keyframes/2/fov", json!(null), "keyframes[2]: `fov` must be a number of degrees"),
            ("/keyframes/2/fov", json!(180), "keyframes[2]: `fov` is 180; it must lie between 0 and 180 degrees"),
        ];
        for (pointer, value, expected) in cases {
            let error = parse_keyframes(&with(pointer, value)).unwrap_err();
            assert!(error.contains(expected), "{pointer}: {error}");
        }
        let cases = [
            ("/camera_path", json!([]), "`camera_path` is empty"),
            ("/camera_path/7/fov", json!(-1), "camera_path[7]: `fov` is -1; it must lie between 0 and 180 degrees"),
            ("/camera_path/7/camera_to_world/0", json!(9), "camera_path[7]: `camera_to_world` is no rotation"),
            ("/camera_path/7", json!({"fov": 50}), "missing field `camera_to_world` at line 1"),
        ];
        for (pointer, value, expected) in cases {
            let text = with(pointer, value).replace("\"keyframes\"", "\"other\"");
            for error in [parse_keyframes(&text).unwrap_err(), parse_frames(&text).unwrap_err()] {
                assert!(error.contains(expected), "{pointer}: {error}");
            }
        }
        for (text, expected) in [("[", "line 1"), ("", "line 1"), ("{\"render_width\": 1e999}", "out of range")] {
            for error in [parse_keyframes(text).unwrap_err(), parse_frames(text).unwrap_err()] {
                assert!(error.contains(expected), "{text}: {error}");
            }
        }
        let missing = KeyframePath::load(Path::new("nowhere/path.json")).unwrap_err().to_string();
        assert!(missing.contains("nowhere/path.json") && missing.contains("check the path"), "{missing}");
    }

    #[test]
    fn frames_load_whatever_the_keyframes_are() {
        let expected = parse_frames(&written(&path(false)).to_string()).unwrap().cameras;
        for (pointer, value) in [("/keyframes", json!(3)), ("/fps", json!("many")), ("/seconds", json!(0))] {
            assert_eq!(parse_frames(&with(pointer, value)).unwrap().cameras, expected);
        }
    }
}
