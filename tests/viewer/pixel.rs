//! The pixel that was clicked.

use super::*;
use egui_kittest::kittest::Queryable;

#[test]
fn a_click_tells_why_a_pixel_looks_as_it_does() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window_on(&gpu(), Some(untrained(folder.path())), Vec2::new(1100.0, 640.0));
    window.state_mut().show_figures(false);
    click(&mut window, Pos2::new(620.0, 330.0));
    until(&mut window, "inspected", |viewer| viewer.inspection().is_some());
    let found = window.state().inspection().unwrap().clone();
    assert!(found.image.is_some() && found.median_depth.is_some(), "{found:?}");
    assert!(!found.intersections.is_empty() && !found.sources.is_empty(), "{found:?}");
    window.run_steps(30);
    settle(&mut window);
    snapshot(&mut window, "pixel", 1000);
    assert_eq!(window.state().on_view(), Some(0), "looking at a pixel moves no camera");
    // On a phone all of it stands below the image.
    window.set_size(Vec2::new(420.0, 640.0));
    window.run_steps(30);
    settle(&mut window);
    snapshot(&mut window, "pixel on a phone", 1000);
    window.set_size(Vec2::new(1100.0, 640.0));
    window.run_steps(30);
    settle(&mut window);
    // The next click tells of another pixel.
    click(&mut window, Pos2::new(600.0, 250.0));
    until(&mut window, "inspected again", |viewer| viewer.inspection().is_some_and(|other| other.pixel != found.pixel));
    press(&mut window, Key::Escape);
    assert!(window.state().inspection().is_none());
}

#[test]
fn a_click_that_closes_a_menu_explains_no_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(plain(folder.path()));
    window.get_by_label_contains("Camera").click();
    settle(&mut window);
    window.get_by_label("Reset");
    click(&mut window, CANVAS);
    let start = Instant::now();
    until(&mut window, "a second later", |_| start.elapsed() > Duration::from_secs(1));
    assert!(window.query_by_label("Reset").is_none() && window.state().inspection().is_none());
    click(&mut window, CANVAS);
    until(&mut window, "inspected", |viewer| viewer.inspection().is_some());
}

/// What a pixel's table needs, the editor beside the picture does not keep.
#[test]
fn the_panel_is_as_wide_as_before_once_the_pixel_is_closed() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(untrained(folder.path()));
    window.set_size(Vec2::new(1100.0, 640.0));
    window.state_mut().show_editor(true);
    settle(&mut window);
    let before = window.state().image_size().unwrap();
    click(&mut window, CANVAS);
    until(&mut window, "inspected", |viewer| viewer.inspection().is_some());
    window.run_steps(30);
    settle(&mut window);
    assert!(window.state().image_size().unwrap()[0] < before[0], "the pixel has a wide table");
    press(&mut window, Key::Escape);
    assert_eq!(window.state().image_size(), Some(before));
}

/// Frames of a software adapter come seconds apart.
#[test]
fn a_slow_click_is_a_click() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(plain(folder.path()));
    button(&mut window, CANVAS, PointerButton::Primary, true);
    window.run_steps(180);
    button(&mut window, CANVAS, PointerButton::Primary, false);
    until(&mut window, "inspected", |viewer| viewer.inspection().is_some());
}

#[test]
fn a_double_click_turns_to_the_surface() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window(Some(untrained(folder.path())));
    let at = CANVAS + Vec2::new(60.0, 40.0);
    click(&mut window, at);
    until(&mut window, "inspected", |viewer| viewer.inspection().is_some());
    let point = window.state().inspection().unwrap().point.unwrap();
    // Without the pixel's panels the canvas is again as it was.
    press(&mut window, Key::Escape);
    window.key_press(Key::F);
    until(&mut window, "focused", |viewer| viewer.on_view().is_none());
    let navigator = *window.state().navigator();
    assert!(navigator.pivot().distance(point) < 1e-3 * navigator.distance, "{navigator:?} does not look at {point}");
    // Two clicks do the same, and show no panels that would move the canvas in between.
    window.state_mut().reset();
    settle(&mut window);
    click(&mut window, at);
    click(&mut window, at);
    until(&mut window, "focused again", |viewer| viewer.on_view().is_none());
    let again = *window.state().navigator();
    assert!(again.pivot().distance(navigator.pivot()) < 1e-6, "{again:?}, before {navigator:?}");
    window.run_steps(60);
    assert!(window.state().inspection().is_none() && window.state().error().is_none());
}
