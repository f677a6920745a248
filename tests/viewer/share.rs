//! *Share*: what is open, written for others.

use super::edit::{open, write_bundle};
use super::*;
use egui_kittest::kittest::Queryable;
use ibgs_core::scene::{Format, read_gaussians};

/// The panel of a bundle of untrained Gaussians.
fn sharing(folder: &Path) -> Window {
    let path = folder.join("room.ibgs");
    write_bundle(&path, from_points(&many_points().points, 0, 0.6).unwrap(), Vec::new());
    let mut window = coarse(open(&path));
    window.get_by_label("Share").click();
    window.run_steps(3);
    window
}

/// Chooses what is written.
fn choose(window: &mut Window, kind: &str) {
    window.get_by_label("Write as").click();
    window.run_steps(3);
    window.get_by_label(kind).click();
    window.run_steps(3);
}

fn write(window: &mut Window) {
    window.get_by_label("Write").click();
    settle(window);
}

#[test]
fn a_model_is_written_for_other_programs() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = sharing(folder.path());
    let target = folder.path().join("room.spz");
    choose(&mut window, Format::Spz.name());
    window.get_by_label_contains("Network, photos and further bases are left out");
    write(&mut window);
    assert_eq!(window.state().error(), None);
    window.get_by_label_contains("room.spz written, 0.");
    assert_eq!(read_gaussians(&target).unwrap().len(), many_points().points.len());
    // What is there stays, unless it may be replaced.
    write(&mut window);
    assert!(window.state().error().unwrap().contains("room.spz is there already"), "{:?}", window.state().error());
    window.get_by_label("replace what is there").click();
    write(&mut window);
    assert_eq!(window.state().error(), None);
    // A bundle keeps all, and is smaller on request.
    choose(&mut window, "Bundle (.ibgs)");
    window.get_by_label_contains("Nothing is lost");
    window.get_by_label("small").click();
    window.run_steps(2);
    write(&mut window);
    window.get_by_label_contains("room-shared.ibgs written");
    let Content::Model(renderer) = open(&folder.path().join("room-shared.ibgs")).content else { panic!("a model") };
    assert!(renderer.part().is_some());
}

#[test]
fn settings_and_keys_take_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = sharing(folder.path());
    window.get_by_label("Write as");
    for (opens, shown, gone) in [
        ("Settings", "Always sharp", "Write as"),
        ("Share", "Write as", "Always sharp"),
        ("?", "left drag", "Write as"),
        ("Share", "Write as", "left drag"),
    ] {
        window.get_by_label(opens).click();
        window.run_steps(20);
        window.get_by_label(shown);
        assert!(window.query_by_label(gone).is_none(), "{opens} leaves `{gone}`");
    }
}

#[test]
fn a_page_needs_the_module_for_browsers() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = sharing(folder.path());
    assert!(window.query_all_by_value(&folder.path().join("room-page").display().to_string()).next().is_some());
    write(&mut window);
    let error = window.state().error().unwrap();
    assert!(error.contains("ibgs_web.js is missing: the viewer's module for browsers"), "{error}");
    assert!(!folder.path().join("room-page").exists());
}
