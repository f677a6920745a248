//! The panels beside the picture, and the tabs that fold them.

use super::edit::editing;
use super::*;
use egui_kittest::kittest::Queryable;

/// Width and height of the picture, in shares of the window.
fn shares(window: &Window, size: Vec2) -> [f32; 2] {
    let [width, height] = window.state().image_size().unwrap();
    [2.0 * width as f32 / size.x, 2.0 * height as f32 / size.y]
}

fn click_on(window: &mut Window, label: &str) {
    window.get_by_label(label).click();
    settle(window);
}

#[test]
fn panels_leave_the_picture_most_of_a_small_window() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(plain(folder.path()));
    window.state_mut().show_only_frame(false);
    window.state_mut().show_path(true);
    for size in [[620.0, 420.0], [620.0, 800.0], [390.0, 620.0], [880.0, 500.0]].map(Vec2::from) {
        window.set_size(size);
        settle(&mut window);
        let [width, height] = shares(&window, size);
        assert!(width >= 0.6 && height > 0.3, "{size}: {width} x {height}");
        click_on(&mut window, "Fold the panel");
        let [wide, high] = shares(&window, size);
        let is_tall = size.y > size.x;
        assert!(if is_tall { high > height + 0.1 } else { wide >= 0.6 }, "{size}: {wide} x {high}");
        click_on(&mut window, "Show the panel");
        assert_eq!(shares(&window, size), [width, height], "{size}");
    }
    assert_eq!(window.state().error(), None);
}

/// Right of the picture in windows of two widths, below it, and back: what is open stays open.
#[test]
fn sections_stay_open_where_the_panel_changes_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = editing(plain(folder.path()));
    click_on(&mut window, "Floaters");
    for size in [[1300.0, 700.0], [760.0, 700.0], [620.0, 900.0], [1300.0, 700.0]].map(Vec2::from) {
        window.set_size(size);
        settle(&mut window);
        assert!(window.query_by_label("Preview").is_some(), "{size}: Floaters is folded");
        assert!(window.query_by_label("Gizmo").is_none(), "{size}: Place and size is open");
    }
}

/// Where there is no room for both, views and facts take turns.
#[test]
fn views_and_facts_take_turns_in_a_small_window() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(plain(folder.path()));
    window.get_by_label("view_000.png");
    window.state_mut().show_path(true);
    settle(&mut window);
    assert!(window.query_by_label("view_000.png").is_none());
    click_on(&mut window, "Show the views");
    window.get_by_label("view_000.png");
    assert!(window.query_by_label("Turntable").is_none());
    // What is opened anew is shown.
    window.state_mut().show_editor(true);
    settle(&mut window);
    window.get_by_label("Turntable");
    assert!(window.query_by_label("view_000.png").is_none());
    // A large window has both, until one is folded.
    window.set_size(Vec2::new(1300.0, 500.0));
    settle(&mut window);
    window.get_by_label("view_000.png");
    click_on(&mut window, "Fold the views");
    assert!(window.query_by_label("view_000.png").is_none());
    window.get_by_label("Turntable");
}
