//! Placing a model: its size by a known length, its ground, and what is saved of it.

use super::edit::{click_on, command, editing, open, pick, write_bundle};
use super::*;
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use ibgs_core::camera::Camera;
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::similarity::Similarity;

const AT: Pos2 = Pos2::new(430.0, 430.0);

fn placing(opened: Opened) -> Window {
    let mut window = editing(opened);
    pick(&mut window, "Place and size");
    for _ in 0..3 {
        window.get_by_label("Measure").scroll_to_me();
        window.run_steps(10);
    }
    window
}

fn placement(window: &Window) -> Similarity {
    *window.state().placement().unwrap().0
}

fn length(window: &Window) -> Option<f64> {
    window.state().placement().unwrap().1
}

#[test]
fn a_measured_length_and_the_ground_place_the_saved_bundle() {
    let folder = tempfile::tempdir().unwrap();
    let (path, saved) = (folder.path().join("model.ibgs"), folder.path().join("model-edited.ibgs"));
    // Planes of a trained model: they turn with it.
    let mut gaussians = from_points(&many_points().points, 0, 0.6).unwrap();
    let turned = |i: usize| DVec3::new((i as f64).sin(), (1.7 * i as f64).cos(), 0.5).normalize();
    gaussians.normals = (0..gaussians.len()).map(|i| turned(i).as_vec3().to_array()).collect();
    write_bundle(&path, gaussians, Vec::new());
    let mut window = placing(open(&path));
    pick(&mut window, "Measure");
    click_on(&mut window, AT);
    assert_eq!(length(&window), None, "one point has no length");
    click_on(&mut window, AT + Vec2::new(80.0, 20.0));
    let measured = length(&window).unwrap();
    assert!(measured > 0.0);
    window.state_mut().set_true_length(3.0 * measured);
    pick(&mut window, "Set scale");
    assert!((length(&window).unwrap() - 3.0 * measured).abs() < 1e-9 * measured);
    assert!((placement(&window).scale - 3.0).abs() < 1e-9);
    // Three points of the ground, and orbits about its up axis.
    let up = window.state().navigator().up;
    pick(&mut window, "Ground");
    for way in [Vec2::ZERO, Vec2::new(90.0, 10.0), Vec2::new(20.0, 80.0)] {
        click_on(&mut window, AT + way);
    }
    let placed = placement(&window);
    assert!((placed.scale - 3.0).abs() < 1e-9 && placed.translation.length() > 0.0, "{placed:?}");
    assert_ne!(window.state().navigator().up, up);
    command(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!(placement(&window), Similarity { scale: placed.scale, ..Similarity::IDENTITY });
    command(&mut window, Modifiers::COMMAND, Key::Y);
    assert_eq!((placement(&window), window.state().error()), (placed, None));
    // What is saved stands there, with its cameras, and looks as before.
    window.get_by_label("Save model").scroll_to_me();
    window.run_steps(10);
    pick(&mut window, "Save model");
    assert!(window.state().message().unwrap().contains("model-edited.ibgs"), "{:?}", window.state().error());
    let options = ModelOptions::default();
    let [mut before, mut after] = [&path, &saved].map(|path| Model::open(path, &options).unwrap());
    let own = before.cameras[0].camera;
    let moved = placed.camera(&own);
    assert!(after.cameras[0].camera.center().distance(moved.center()) < 1e-6 * moved.center().length().max(1.0));
    // Beside the orbit, where no two photos are equally near: rounding would choose between them.
    let camera = Camera { translation: own.translation + DVec3::new(0.1, 0.03, 0.0), ..own };
    let moved = placed.camera(&camera);
    let image =
        |model: &mut Model, camera| model.renderer(&gpu()).unwrap().render(&camera).unwrap().image().unwrap().unwrap();
    let [from, to] = [image(&mut before, camera).to_rgb8(), image(&mut after, moved).to_rgb8()];
    let differ = from.iter().zip(&to).filter(|(a, b)| a.abs_diff(**b) > 3).count();
    assert!(differ * 100 < from.len(), "{differ} of {} values differ", from.len());
    assert!(from.iter().any(|&value| value > 30));
}

#[test]
fn a_model_that_was_moved_is_unsaved_until_it_is_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = placing(plain(folder.path()));
    pick(&mut window, "Measure");
    click_on(&mut window, AT);
    click_on(&mut window, AT + Vec2::new(80.0, 20.0));
    window.state_mut().set_true_length(1.0);
    pick(&mut window, "Set scale");
    window.get_by_label("not saved yet");
    window.get_by_label("As it was").scroll_to_me();
    window.run_steps(10);
    pick(&mut window, "As it was");
    assert_eq!(placement(&window), Similarity::IDENTITY);
    assert!(window.query_by_label("not saved yet").is_none());
}

#[test]
fn the_gizmo_moves_turns_and_scales_over_the_ground() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = placing(plain(folder.path()));
    pick(&mut window, "Gizmo");
    // Where the camera stands in the coordinates of the file, whose ground stands still.
    let stands = |window: &Window| placement(window).camera(&window.state().navigator().camera(300, 200));
    let still = |window: &Window, before: &Camera| {
        let now = stands(window);
        let is_turned = !now.view_from_world.abs_diff_eq(before.view_from_world, 1e-9);
        !is_turned && now.center().distance(before.center()) < 1e-9 * before.center().length()
    };
    assert_eq!(window.state().on_view(), None, "the model moves away from its photos");
    let (scene, file) = (*window.state().navigator(), stands(&window));
    // Where a picture of the window shows the handles: the tip of the arrow along z, the middle, and the ring about z.
    let middle = Pos2::new(446.0, 413.0);
    drag(&mut window, PointerButton::Primary, middle - Vec2::new(0.0, 60.0), Vec2::new(10.0, -40.0));
    let moved = placement(&window);
    assert!(moved.translation.z.abs() > 0.01 && moved.translation.truncate() == glam::DVec2::ZERO, "{moved:?}");
    assert_eq!((moved.scale, moved.rotation), (1.0, Similarity::IDENTITY.rotation));
    assert!(window.state().inspection().is_none());
    assert!(still(&window, &file) && *window.state().navigator() != scene, "the model moves over the ground");
    // A drag is one step.
    command(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!(placement(&window), Similarity::IDENTITY);
    assert!(window.state().navigator().position.distance(scene.position) < 1e-9 && still(&window, &file));
    command(&mut window, Modifiers::COMMAND, Key::Y);
    assert_eq!(placement(&window), moved);
    pick(&mut window, "As it was");
    drag(&mut window, PointerButton::Primary, middle, Vec2::new(40.0, 0.0));
    let scaled = placement(&window);
    assert!(scaled.scale > 1.1 && scaled.rotation == moved.rotation && still(&window, &file), "{scaled:?}");
    pick(&mut window, "As it was");
    drag(&mut window, PointerButton::Primary, middle + RING, Vec2::new(20.0, 0.0));
    let turned = placement(&window);
    assert!((turned.scale - 1.0).abs() < 1e-12 && still(&window, &file), "{turned:?}");
    assert!(turned.rotation.z_axis.distance(DVec3::Z) < 1e-9 && turned.rotation.x_axis.distance(DVec3::X) > 0.05);
    // Beside the handles the pointer is the camera's.
    drag(&mut window, PointerButton::Primary, middle + Vec2::new(-150.0, 120.0), Vec2::new(30.0, 0.0));
    assert!(placement(&window) == turned && !still(&window, &file));
    // What was dragged but not let go is a step too.
    button(&mut window, middle, PointerButton::Primary, true);
    window.event(Event::PointerMoved(middle + Vec2::new(30.0, 0.0)));
    window.step();
    press(&mut window, Key::Escape);
    assert!(placement(&window).scale > 1.05);
    button(&mut window, middle, PointerButton::Primary, false);
    command(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!((placement(&window), window.state().error()), (turned, None));
    // An arrow that takes the gizmo out of the picture is let go there as well.
    pick(&mut window, "Gizmo");
    drag(&mut window, PointerButton::Primary, middle - Vec2::new(0.0, 60.0), Vec2::new(0.0, -900.0));
    let (away, file) = (placement(&window), stands(&window));
    assert!(away.translation.z.abs() > 0.01, "{away:?}");
    drag(&mut window, PointerButton::Primary, middle + Vec2::new(-150.0, 20.0), Vec2::new(30.0, 0.0));
    assert!(placement(&window) == away && !still(&window, &file), "the pointer is the camera's again");
}

/// From the middle of the gizmo to the ring about z, in points.
const RING: Vec2 = Vec2::new(0.0, 17.0);

#[test]
fn a_gizmo_outside_of_the_picture_is_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = placing(plain(folder.path()));
    pick(&mut window, "Gizmo");
    assert!(window.query_by_label("Look at it").is_none());
    drag(&mut window, PointerButton::Secondary, AT, Vec2::new(-400.0, 0.0));
    let away = window.state().navigator().pivot();
    pick(&mut window, "Look at it");
    assert!(window.query_by_label("Look at it").is_none());
    let back = *window.state().navigator();
    assert!(back.pivot().distance(away) > 0.1 * back.distance, "it looks at {}", back.pivot());
}
