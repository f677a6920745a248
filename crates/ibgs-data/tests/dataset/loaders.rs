//! A format that a program adds.

use glam::{DMat3, DVec2, DVec3};
use ibgs_data::camera::Camera;
use ibgs_data::dataset::{self, DatasetError, LoadOptions, Loader, Loaders, PosedPhoto, Scene, SceneKind};
use ibgs_testing::scene_files::write_photo;
use std::path::Path;

/// A folder with `row.txt`: names of photos from cameras side by side.
#[derive(Debug)]
struct Row;

impl Loader for Row {
    fn shown_by(&self) -> &str {
        "row.txt"
    }

    fn is_scene(&self, path: &Path) -> bool {
        path.join("row.txt").is_file()
    }

    fn read(&self, path: &Path, _options: &LoadOptions) -> Result<Scene, DatasetError> {
        let listing = path.join("row.txt");
        let text = std::fs::read_to_string(&listing).unwrap();
        let posed = |(index, name): (usize, &str)| PosedPhoto {
            name: name.to_owned(),
            file: path.join(name),
            camera: Camera {
                width: 8,
                height: 6,
                focal: DVec2::splat(8.0),
                principal: DVec2::new(4.0, 3.0),
                view_from_world: DMat3::IDENTITY,
                translation: DVec3::new(-(index as f64), 0.0, 0.0),
            },
        };
        let photos = text.lines().enumerate().map(posed).collect();
        Scene::of_photos(SceneKind::new("row", "a row"), listing, photos, Vec::new())
    }
}

#[test]
fn a_program_adds_a_format() {
    let folder = tempfile::tempdir().unwrap();
    let options = LoadOptions { random_points: 4, ..LoadOptions::default() };
    let load = || Loaders::default().with(&Row).load(folder.path(), &options, &());
    let refused = load().unwrap_err().to_string();
    assert!(refused.contains("it has no row.txt, no sparse/0/cameras.bin"), "{refused}");
    assert!(refused.contains("no cameras_sphere.npz (NeuS)"), "{refused}");
    std::fs::write(folder.path().join("row.txt"), "b.png\na.png\n").unwrap();
    for name in ["a.png", "b.png"] {
        write_photo(&folder.path().join(name), 8, 6, |x, y| [20 * x as u8, 20 * y as u8, 90, 255]);
    }
    let dataset = load().unwrap();
    let views: Vec<(&str, f64)> =
        dataset.views.iter().map(|view| (view.name.as_str(), view.camera.center().x)).collect();
    assert_eq!(views, [("a.png", 1.0), ("b.png", 0.0)]);
    assert!(dataset::load(folder.path(), &options).unwrap_err().to_string().contains("is not a scene"));
    std::fs::write(folder.path().join("row.txt"), "../a.png\nb.png\n").unwrap();
    assert!(load().unwrap_err().to_string().contains("image name `../a.png`"));
}

#[test]
fn the_documentation_has_every_file() {
    let text = include_str!("../../../../docs/scenes.md");
    for file in Loaders::default().files() {
        let stem = Path::new(file.name).file_stem().unwrap().to_str().unwrap();
        assert!(text.contains(stem), "docs/scenes.md does not name {}", file.name);
    }
}
