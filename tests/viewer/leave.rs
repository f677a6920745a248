//! Unsaved edits: the window asks before they are lost.

use super::edit::{counts, editing, open, pick};
use super::*;
use eframe::egui::accesskit::Role;
use eframe::egui::{ViewportCommand, ViewportEvent, ViewportId};
use egui_kittest::kittest::Queryable;
use ibgs_core::scene::{Format, read_gaussians, write_gaussians};
use ibgs_viewer::OpenRequest;
use std::sync::atomic::{AtomicUsize, Ordering};

const QUESTION: &str = "Save the edited model?";

/// A window on a file of Gaussians of which half were deleted.
fn edited(folder: &Path) -> Window {
    let path = folder.join("points.ply");
    write_gaussians(&path, &from_points(&many_points().points, 0, 0.6).unwrap(), Format::Ply).unwrap();
    let mut window = editing(open(&path));
    pick(&mut window, "Box");
    pick(&mut window, "Outside");
    press(&mut window, Key::Delete);
    window
}

/// What the window tells the system in its next step.
fn told(window: &mut Window) -> Vec<ViewportCommand> {
    window.step();
    window.output().viewport_output[&ViewportId::ROOT].commands.clone()
}

/// Asks the window to close, as its button and a signal do; true if it will.
fn close(window: &mut Window) -> bool {
    window.input_mut().viewports.entry(ViewportId::ROOT).or_default().events.push(ViewportEvent::Close);
    !told(window).contains(&ViewportCommand::CancelClose)
}

/// Clicks a button; text of the same name may stand elsewhere.
fn button_of(window: &mut Window, label: &str) {
    window.get_by_role_and_label(Role::Button, label).click();
}

/// Clicks a button of the question; whether the window then closes.
fn answer(window: &mut Window, label: &str) -> bool {
    window.step();
    button_of(window, label);
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(60) {
        if told(window).contains(&ViewportCommand::Close) {
            return close(window);
        }
        if !window.state().asks_to_leave() {
            return false;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("the question stays: {:?}", window.state().error());
}

#[test]
fn a_window_without_edits_closes() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = editing(plain(folder.path()));
    pick(&mut window, "All");
    assert!(close(&mut window), "a selection is nothing to save");
    assert!(window.query_by_label(QUESTION).is_none());
}

#[test]
fn closing_with_unsaved_edits_asks() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = edited(folder.path());
    let kept = Arc::new(AtomicUsize::new(0));
    let count = kept.clone();
    window.state_mut().when_kept_open(move || _ = count.fetch_add(1, Ordering::SeqCst));
    let left = counts(&window);
    let key = |pressed| {
        let (key, modifiers) = (Key::Q, Modifiers::COMMAND);
        Event::Key { key, physical_key: None, pressed, repeat: false, modifiers }
    };
    window.event(key(true));
    assert!(told(&mut window).contains(&ViewportCommand::Close), "as the window's button");
    window.event(key(false));
    assert!(!close(&mut window));
    settle(&mut window);
    window.get_by_label(QUESTION);
    // Keys do nothing behind the question, and Escape is a way to stay.
    press(&mut window, Key::X);
    assert!(window.state().asks_to_leave());
    press(&mut window, Key::Escape);
    assert!(!window.state().asks_to_leave());
    assert!(!close(&mut window) && !answer(&mut window, "Cancel"));
    assert_eq!((kept.load(Ordering::SeqCst), counts(&window)), (2, left));
    assert!(!close(&mut window) && answer(&mut window, "Discard"));
    assert!(!folder.path().join("points-edited.ply").exists());
}

#[test]
fn edits_are_saved_before_the_window_closes() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = edited(folder.path());
    let [left, _] = counts(&window);
    // A file that is there is not replaced; the question stays and says so.
    let saved = folder.path().join("points-edited.ply");
    std::fs::write(&saved, "mine").unwrap();
    assert!(!close(&mut window));
    settle(&mut window);
    // Where the folder of this run does not show.
    window.state_mut().set_model_file(Path::new("points-edited.ply"));
    window.run_steps(20);
    snapshot(&mut window, "unsaved edits", 600);
    window.state_mut().set_model_file(&saved);
    button_of(&mut window, "Save");
    until(&mut window, "refused", |viewer| viewer.error().is_some());
    assert!(window.state().asks_to_leave() && window.state().error().unwrap().contains("is there already"));
    // Once: the question has it, and nothing behind it.
    assert_eq!(window.query_all_by_label_contains("is there already").count(), 1);
    std::fs::remove_file(&saved).unwrap();
    assert!(answer(&mut window, "Save"));
    assert_eq!(read_gaussians(&saved).unwrap().len(), left);
}

#[test]
fn opening_another_model_over_edits_asks() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = edited(folder.path());
    let other = folder.path().join("other.ply");
    write_gaussians(&other, &from_points(&many_points().points[..50], 0, 0.6).unwrap(), Format::Ply).unwrap();
    let [left, _] = counts(&window);
    window.state_mut().open(OpenRequest::Path(other.clone()));
    settle(&mut window);
    pick(&mut window, "Cancel");
    assert_eq!((counts(&window)[0], window.state().error()), (left, None));
    window.state_mut().open(OpenRequest::Path(other.clone()));
    settle(&mut window);
    button_of(&mut window, "Save");
    until(&mut window, "opened", |viewer| viewer.scene().unwrap().path.as_deref() == Some(&other));
    assert_eq!(read_gaussians(&folder.path().join("points-edited.ply")).unwrap().len(), left);
}
