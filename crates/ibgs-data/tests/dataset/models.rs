//! Scenes with several COLMAP models, in several places, and photos that are in none of them.

use super::{assert_note, load_plain};
use ibgs_data::dataset;
use ibgs_testing::fails;
use ibgs_testing::scene_files::{Model, write_file, write_photo};
use std::fs;

/// The images of a model from `first` on.
fn part(count: usize, first: usize) -> Model {
    let mut model = Model::small(count);
    model.images.drain(..first);
    model
}

#[test]
fn the_model_with_the_most_photos_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path();
    Model::small(9).write_photos(scene);
    part(9, 7).write_binary_to(&scene.join("sparse/0"));
    part(7, 3).write_binary_to(&scene.join("sparse/2"));
    part(3, 0).write_text_to(&scene.join("sparse/10"));
    write_file(&scene.join("sparse/notes/cameras.bin"), "no model");
    let dataset = load_plain(scene);
    let names: Vec<&str> = dataset.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["a3.png", "a4.png", "a5.png", "a6.png"]);
    assert_note(&dataset, "3 COLMAP models that do not connect: sparse/2 with 4 photos is used");
    assert_note(&dataset, "not sparse/10 with 3, sparse/0 with 2");
    assert_note(&dataset, "5 photos have no pose and are not used: images/a0.png, images/a1.png, images/a2.png, ...");
    let info = dataset::inspect(scene).unwrap();
    let models: Vec<_> = info.models.iter().map(|model| (model.folder.as_str(), model.images)).collect();
    assert_eq!(models, [("sparse/2", 4), ("sparse/10", 3), ("sparse/0", 2)]);
    assert_eq!(info.listing.to_str(), Some("sparse/2/images.bin"));
    assert_eq!((info.images, info.unposed.len(), info.missing.len()), (4, 5, 0));
    // Of equal models the first.
    part(7, 3).write_binary_to(&scene.join("sparse/1"));
    assert_eq!(dataset::inspect(scene).unwrap().models[0].folder, "sparse/1");
    // It could be the largest.
    let path = scene.join("sparse/0/images.bin");
    let whole = fs::read(&path).unwrap();
    write_file(&path, &whole[..whole.len() - 1]);
    fails(scene, &["sparse/0/images.bin", "claims 2 observations"]);
}

#[test]
fn layouts_of_nerfstudio() {
    for place in ["colmap/sparse/0", "colmap/sparse", "sparse"] {
        let folder = tempfile::tempdir().unwrap();
        let model = Model::small(3);
        model.write_photos(folder.path());
        model.write_binary_to(&folder.path().join(place));
        let dataset = load_plain(folder.path());
        assert_eq!((dataset.views.len(), dataset.notes.len()), (3, 0), "{place}: {:?}", dataset.notes);
        assert_eq!(dataset::inspect(folder.path()).unwrap().models[0].folder, place);
    }
    // A transforms.json beside nerfstudio's model is the scene, as it is for nerfstudio.
    let folder = tempfile::tempdir().unwrap();
    let model = Model::small(3);
    model.write_photos(folder.path());
    model.write_binary_to(&folder.path().join("colmap/sparse/0"));
    let frames = super::transforms(r#""fl_x": 9,"#, &[("images/a0.png", ""), ("images/a1.png", "")]);
    write_file(&folder.path().join("transforms.json"), frames);
    assert_eq!(dataset::inspect(folder.path()).unwrap().images, 2);
}

/// RealityCapture exports model and photos into one folder.
#[test]
fn a_model_beside_its_photos() {
    for text in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path();
        let model = Model::small(3);
        if text {
            model.write_text_to(scene)
        } else {
            model.write_binary_to(scene)
        }
        for image in &model.images {
            write_photo(&scene.join(&image.name), 12, 8, |_, _| [90, 120, 150, 255]);
        }
        write_photo(&scene.join("b.png"), 12, 8, |_, _| [90, 120, 150, 255]);
        write_photo(&scene.join("a1.png.mask.png"), 12, 8, |_, _| [255; 4]);
        let dataset = load_plain(scene);
        assert_eq!((dataset.views.len(), dataset.points.len()), (3, 2));
        assert_eq!(dataset.notes, ["1 photo has no pose and is not used: b.png", "1 photo masked"]);
        let info = dataset::inspect(scene).unwrap();
        let listing = if text { "images.txt" } else { "images.bin" };
        assert_eq!((info.listing.to_str(), info.models[0].folder.as_str()), (Some(listing), "."));
        assert_eq!((info.images, info.points, info.masks), (3, 2, 1));
        // A model in its usual place is the scene.
        Model::small(2).write_binary(scene);
        assert_eq!(load_plain(scene).views.len(), 2);
    }
}

#[test]
fn photos_without_a_pose_are_counted() {
    let folder = Model::small(2).scene();
    let scene = folder.path();
    assert!(load_plain(scene).notes.is_empty());
    // A second file of a posed photo, hidden files and other files are no photos without a pose.
    for other in ["images/a0.heic", "images/.a9.png", "images/read.me", "masks/x.txt", "images_2/a5.png"] {
        write_file(&scene.join(other), "something");
    }
    assert!(load_plain(scene).notes.is_empty());
    write_photo(&scene.join("images/left/b.JPG"), 5, 7, |_, _| [1, 2, 3, 255]);
    assert_note(&load_plain(scene), "1 photo has no pose and is not used: images/left/b.JPG");
    write_file(&scene.join("images/c.heic"), "");
    let info = dataset::inspect(scene).unwrap();
    assert_eq!(info.unposed, ["images/c.heic", "images/left/b.JPG"]);
    assert_eq!((info.sizes.len(), info.sizes[0].width, info.sizes[0].photos), (1, 12, 2));
    assert_eq!((info.split.train, info.split.test, info.split.by.as_str()), (1, 1, "every 8th photo by name"));
    write_file(&scene.join("images/a1.png"), "not a photo");
    assert_eq!(dataset::inspect(scene).unwrap().unreadable, ["images/a1.png"]);
}
