//! Whether a scene is the one that a model was trained on, by the names and places of its cameras.

use super::ModelError;
use crate::camera::scene_extent;
use crate::dataset::Dataset;
use crate::output::cameras::CameraRecord;
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Largest median distance of the cameras from those of the model, in extents of the scene.
const TOLERANCE: f64 = 0.05;

/// The forms in which programs keep the name of a photo: whole, without extension, and the same without folders. 3DGS cuts
/// names at their first point.
fn forms(name: &str) -> [&str; 5] {
    let stem = |name: &'_ str| name.rfind('.').filter(|&at| at > 0).unwrap_or(name.len());
    let file = name.rsplit('/').next().unwrap_or(name);
    let whole = &name[..name.len() - file.len() + stem(file)];
    [name, whole, file, &file[..stem(file)], file.split('.').next().unwrap_or(file)]
}

/// The views of a scene by all forms of their names.
fn by_name(scene: &Dataset) -> HashMap<&str, Vec<usize>> {
    let mut views: HashMap<&str, Vec<usize>> = HashMap::new();
    for (index, view) in scene.views.iter().enumerate() {
        for form in HashSet::from(forms(&view.name)) {
            views.entry(form).or_default().push(index);
        }
    }
    views
}

/// The cameras that were trained or measured; all where the file does not say.
fn used(listed: &[CameraRecord]) -> Vec<&CameraRecord> {
    let says = listed.iter().any(|record| record.split.is_some());
    listed.iter().filter(|record| !says || record.split.is_some()).collect()
}

/// Compares a scene with the cameras that a model lists.
///
/// # Errors
/// [`ModelError::OtherScene`], [`ModelError::OtherPoses`].
pub(super) fn check(listed: &[CameraRecord], scene: &Dataset, source: &Path) -> Result<(), ModelError> {
    let views = by_name(scene);
    let (used, mut missing, mut distances) = (used(listed), Vec::new(), Vec::new());
    for record in &used {
        match views.get(record.name.as_str()).map(Vec::as_slice) {
            None => missing.push(&record.name),
            Some(&[view]) => {
                let distance = scene.views[view].camera.center().distance(record.camera.center());
                distances.push((distance, &record.name));
            }
            // Several photos have this name in different folders.
            Some(_) => {}
        }
    }
    let path = || source.to_owned();
    if let Some(&name) = missing.first() {
        let (missing, count) = (missing.len(), used.len());
        return Err(ModelError::OtherScene { path: path(), missing, count, name: name.clone() });
    }
    distances.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (_, extent) = scene_extent(scene.views.iter().map(|view| &view.camera));
    match distances.get(distances.len() / 2) {
        Some(&(distance, name)) if distance > TOLERANCE * extent && extent > 0.0 => {
            Err(ModelError::OtherPoses { path: path(), name: name.clone(), distance })
        }
        _ => Ok(()),
    }
}

/// Says in the log that a scene has photos that the model does not list: it may divide them in another way.
pub(super) fn say_unlisted(listed: &[CameraRecord], scene: &Dataset, source: &Path) {
    let names: HashSet<&str> = listed.iter().map(|record| record.name.as_str()).collect();
    let is_unlisted = |name: &&str| !forms(name).iter().any(|form| names.contains(form));
    let mut unlisted = scene.views.iter().map(|view| view.name.as_str()).filter(is_unlisted);
    if let (Some(first), false) = (unlisted.next(), listed.is_empty()) {
        log::warn!(
            "the model's cameras.json does not list {} of the {} photos of {}, such as `{first}`: which views are held out may \
             differ from the training",
            unlisted.count() + 1,
            scene.views.len(),
            source.display()
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use glam::DVec3;
    use ibgs_demo::DemoOptions;

    fn scene() -> (tempfile::TempDir, Dataset) {
        let cache = tempfile::tempdir().unwrap();
        let options = DemoOptions { width: 16, height: 12, views: 6, samples: 1, points: 20, seed: 0 };
        let scene = ibgs_demo::load(&options, Some(cache.path()), &()).unwrap();
        (cache, scene)
    }

    fn listed(scene: &Dataset, name: impl Fn(&str) -> String, moved: DVec3) -> Vec<CameraRecord> {
        let record = |view: &crate::dataset::View| {
            let camera =
                Camera { translation: view.camera.translation + view.camera.view_from_world * moved, ..view.camera };
            CameraRecord { name: name(&view.name), camera, split: None }
        };
        scene.views.iter().map(record).collect()
    }

    #[test]
    fn names_have_several_forms() {
        assert_eq!(forms("a/b.c.png"), ["a/b.c.png", "a/b.c", "b.c.png", "b.c", "b"]);
        assert_eq!(forms("b"), ["b"; 5]);
        assert_eq!(forms(".b"), [".b", ".b", ".b", ".b", ""]);
    }

    #[test]
    fn other_scenes_are_told_by_names_and_places() {
        let (_cache, scene) = scene();
        let source = Path::new("there");
        let check = |listed: &[CameraRecord]| check(listed, &scene, source);
        let whole = |name: &str| name.to_owned();
        let stem = |name: &str| name.rsplit_once('.').unwrap().0.to_owned();
        for names in [&whole as &dyn Fn(&str) -> String, &stem] {
            check(&listed(&scene, names, DVec3::ZERO)).unwrap();
        }
        check(&[]).unwrap();
        let text = check(&listed(&scene, |name| format!("other_{name}"), DVec3::ZERO)).unwrap_err().to_string();
        assert!(text.contains("there") && text.contains("6 of the 6 photos") && text.contains("other_"), "{text}");
        let mut one = listed(&scene, whole, DVec3::ZERO);
        one[3].name = "gone.png".to_owned();
        let text = check(&one).unwrap_err().to_string();
        assert!(text.contains("1 of the 6 photos") && text.contains("`gone.png`"), "{text}");
        let text = check(&listed(&scene, whole, DVec3::new(3.0, 0.0, 4.0))).unwrap_err().to_string();
        assert!(text.contains("stand elsewhere") && text.contains("5.000 units"), "{text}");
    }
}
