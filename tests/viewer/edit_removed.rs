//! An object is deleted whose photos still show it.

use super::edit::{canvas, click_on, command, counts, differs, editing, open, pick};
use super::*;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::{DMat3, DVec2, DVec3};
use ibgs_core::bundle::{Bundle, Packing};
use ibgs_core::camera::Camera;
use ibgs_core::dataset::{Photo, View as DatasetView};
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::output::{cameras, multi_view};
use ibgs_core::scene::Gaussians;
use std::process::Command;

/// The object is a square of this half width and depth, before a wall of that depth.
const OBJECT: (f64, f64) = (0.3, 2.0);
const WALL: f64 = 4.0;
/// Where the cameras stand, side by side; the first one before the middle of the object.
const PLACES: [f64; 5] = [0.0, -0.3, 0.3, -0.5, 0.5];
/// Colours of wall and object in the photos; the Gaussians are grey and blue.
const PHOTO: [[u8; 3]; 2] = [[0, 200, 0], [255, 0, 0]];

fn camera(x: f64) -> Camera {
    Camera {
        width: 96,
        height: 72,
        focal: DVec2::splat(60.0),
        principal: DVec2::new(48.0, 36.0),
        view_from_world: DMat3::IDENTITY,
        translation: DVec3::new(-x, 0.0, 0.0),
    }
}

/// How far the ray of a camera to a point of the wall passes inside of the object's edge; negative outside.
fn within_object(camera: &Camera, wall: DVec3) -> f64 {
    let at = camera.center().lerp(wall, OBJECT.1 / WALL);
    OBJECT.0 - at.x.abs().max(at.y.abs())
}

/// The point of the wall that a pixel sees past the object.
fn on_wall(camera: &Camera, pixel: usize) -> DVec3 {
    let [x, y] = [pixel % camera.width as usize, pixel / camera.width as usize].map(|n| n as f64 + 0.5);
    camera.unproject(DVec2::new(x, y), WALL)
}

/// Flat, opaque Gaussians on a grid that face the cameras.
fn add_layer(gaussians: &mut Gaussians, (half, depth): (f64, f64), step: f64, color: [f32; 3]) {
    let count = (half / step) as i32;
    for (x, y) in (-count..=count).flat_map(|x| (-count..=count).map(move |y| (x, y))) {
        gaussians.means.push([(f64::from(x) * step) as f32, (f64::from(y) * step) as f32, depth as f32]);
        gaussians.rotations.push([1.0, 0.0, 0.0, 0.0]);
        let scale = (0.6 * step).ln() as f32;
        gaussians.log_scales.push([scale, scale, scale - 3.0]);
        gaussians.opacity_logits.push(6.0);
        gaussians.sh.extend(color);
        gaussians.normals.push([0.0, 0.0, -1.0]);
        gaussians.offsets.push(0.0);
    }
}

/// A model whose final image is the mean of what its sources show, and the base image where there is none.
fn write(path: &Path) -> [usize; 2] {
    let mut gaussians = Gaussians::with_capacity(0, 0);
    add_layer(&mut gaussians, OBJECT, 0.02, [-0.5, -0.5, 1.0]);
    let object = gaussians.means.len();
    add_layer(&mut gaussians, (4.2, WALL), 0.1, [0.0; 3]);
    let view = |(number, &x): (usize, &f64)| {
        let camera = camera(x);
        let color = |pixel| PHOTO[usize::from(within_object(&camera, on_wall(&camera, pixel)) > 0.0)];
        let texel = |pixel| color(pixel).into_iter().chain([255]);
        let rgba = (0..camera.pixels()).flat_map(texel).collect();
        let photo = Photo { width: camera.width, height: camera.height, rgba }.into();
        DatasetView { name: format!("{number}.png"), camera, photo }
    };
    let views: Vec<_> = PLACES.iter().enumerate().map(view).collect();
    let photos = views.iter().map(|view| (view.name.clone(), view.photo.clone())).collect();
    let dataset = Dataset { train: (0..views.len()).collect(), test: Vec::new(), views, ..many_points().clone() };
    let mut config = mean_of_sources();
    config.residual.source_share = 1.0;
    let bundle = Bundle {
        iteration: 30,
        members: Vec::new(),
        levels: None,
        network: Some(weights::to_bytes(&vec![0.0; weights::random(0).len()]).unwrap()),
        exposure: None,
        cameras: cameras::records(&dataset),
        sources: multi_view::records(&dataset, &config.sources),
        photos,
        config,
        gaussians,
    };
    bundle.write(path, Packing::Lossless).unwrap();
    [object, bundle.gaussians.len()]
}

/// Pixels of a view of the wall that are green as the photos, and grey as the Gaussians. None is of another colour, and each is of the
/// one that it has to be: green where the object hides it from no source, grey where from all.
fn colors_of_the_wall(image: &[u8], target: &Camera) -> [usize; 2] {
    let mut counts = [0; 2];
    for (pixel, color) in image.as_chunks::<3>().0.iter().enumerate() {
        let wall = on_wall(target, pixel);
        // The first place is the target's own; a pixel of a photo is 0.033 wide on the object.
        let is_seen = PLACES[1..].iter().map(|&x| camera(x)).any(|source| {
            let (at, last) = (source.project(wall).0, DVec2::new(95.0, 71.0));
            at.cmpgt(DVec2::ONE).all() && at.cmplt(last).all() && within_object(&source, wall) < -0.08
        });
        let is_hidden = PLACES[1..].iter().all(|&x| within_object(&camera(x), wall) > 0.08);
        let [red, green, blue] = *color;
        let is_green = red < 40 && green > 180 && blue < 40;
        let is_grey = [red, green, blue].iter().all(|value| value.abs_diff(128) < 8);
        assert!(is_green || is_grey, "pixel {pixel} has the colour {color:?}");
        assert!(!is_seen || is_green, "a photo shows pixel {pixel}, which has the colour {color:?}");
        assert!(!is_hidden || is_grey, "no photo shows pixel {pixel}, which has the colour {color:?}");
        counts[usize::from(is_grey)] += 1;
    }
    counts
}

/// The saved model brings its photos, with what they hide: the error of the wall, which is grey where they are green, has no part of
/// the object.
fn compares_what_photos_show_of_the_wall(saved: &Path) {
    let wall = (2.0 * (0.5_f64).powi(2) + (200.0 / 255.0 - 0.5_f64).powi(2)) / 3.0;
    let object = 3.0 * (0.5_f64).powi(2) / 3.0;
    let mut opened = editing(open(saved));
    assert!(
        opened.state().scene().unwrap().views.iter().all(|view| view.photo.is_some()),
        "a bundle brings its photos"
    );
    pick(&mut opened, "By values");
    pick(&mut opened, "Error");
    until(&mut opened, "compared", |viewer| viewer.compares() == Some(false));
    opened.run_steps(2);
    let [low, high] = ["from ", "to "].map(|name| {
        let value = opened.get_by(|node| node.value().is_some_and(|value| value.starts_with(name)));
        value.accesskit_node().numeric_value().unwrap()
    });
    assert!((low - wall).abs() < 0.01 && high < 0.5 * (wall + object), "{low} to {high} of {wall}");
}

#[test]
fn a_deleted_object_leaves_no_ghost_in_the_final_image() {
    let folder = tempfile::tempdir().unwrap();
    let (path, saved) = (folder.path().join("model.ibgs"), folder.path().join("model-edited.ibgs"));
    let [object, all] = write(&path);
    let mut window = editing(open(&path));
    let before = canvas(&mut window);
    let is_red = |pixel: &&[u8; 4]| pixel[0] > 200 && pixel[1] < 60;
    assert!(before.iter().filter(is_red).count() > 1_000, "the photos' object is there");
    pick(&mut window, "Colour");
    click_on(&mut window, Pos2::new(430.0, 430.0));
    assert_eq!(counts(&window), [all, object], "{:?}", window.state().error());
    press(&mut window, Key::Delete);
    press(&mut window, Key::Escape);
    press(&mut window, Key::P);
    pick(&mut window, "Save model");
    assert!(window.state().message().unwrap().contains("model-edited.ibgs"), "{:?}", window.state().error());
    let shot = image::open(folder.path().join("model/screenshots/0001.png")).unwrap().into_rgb8();
    let target = camera(0.0).resized(shot.width(), shot.height());
    let [green, grey] = colors_of_the_wall(shot.as_raw(), &target);
    assert!(green > 10 * grey && grey > shot.len() / 3 / 200, "{green} green, {grey} grey of {:?}", shot.dimensions());

    // The saved model shows the same, by the command line too, and its photos hide the object and nothing else.
    let mut model = Model::open(&saved, &ModelOptions::default()).unwrap();
    let differs = differs(folder.path(), &model.renderer(&gpu()).unwrap(), &model);
    assert!(differs == 0.0, "{differs} of the values differ");
    let mut program = Command::new(env!("CARGO_BIN_EXE_ibgs"));
    let program = program.args(["render", "--views", "train", "--outputs", "final"]).arg(&saved).output().unwrap();
    assert!(program.status.success(), "{}", String::from_utf8_lossy(&program.stderr));
    let frame = folder.path().join("model-edited/train/ours_30/renders_aggregate/0.png");
    let frame = image::open(&frame).unwrap().into_rgb8();
    colors_of_the_wall(frame.as_raw(), &camera(0.0));
    let whole = Model::open(&path, &ModelOptions::default()).unwrap();
    let photos = whole.training_photos().unwrap().into_iter().zip(model.training_photos().unwrap());
    for ((before, after), x) in photos.zip(PLACES) {
        let [before, after] = [before, after].map(|photo| photo.pixels().unwrap());
        let texels = before.rgba.as_chunks::<4>().0.iter().zip(after.rgba.as_chunks::<4>().0);
        for (pixel, (before, after)) in texels.enumerate() {
            let inside = within_object(&camera(x), on_wall(&camera(x), pixel));
            assert_eq!(before[..3], after[..3]);
            assert!(inside.abs() < 0.04 || (after[3] == 0) == (inside > 0.0), "pixel {pixel} at {x}: {after:?}");
        }
    }

    compares_what_photos_show_of_the_wall(&saved);
    for _ in 0..2 {
        command(&mut window, Modifiers::COMMAND, Key::Z);
    }
    assert_eq!(counts(&window), [all, 0]);
    assert!(canvas(&mut window) == before, "undone, the picture is what it was");
    assert_eq!(window.state().error(), None);
}
