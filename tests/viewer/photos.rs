//! Photos without poses in the window, with a program that stands in for COLMAP.

use super::open::drop_into;
use super::*;
use crate::cli::Sandbox;
use crate::cli::prepare::{COLMAP, make_program, sandbox};
use eframe::egui::Role;
use egui_kittest::kittest::Queryable;
use ibgs::commands::prepare::Programs;
use std::path::PathBuf;

/// A window whose preparations run this program.
fn window_with_colmap(colmap: PathBuf, first: Option<Outcome>) -> Window {
    let opener = Opener::default().with_programs(Programs { colmap, ..Programs::default() });
    window_with(&gpu(), opener, first, Vec2::new(1280.0, 800.0), None, 1.0)
}

/// COLMAP that takes its time with features while there is a file `slow`.
fn slow(sandbox: &Sandbox) {
    let wait = "    \"feature_extractor --database_path\") while [ -e \"$here/slow\" ]; do sleep 0.05; done ;;\n    model_analyzer*)";
    make_program(sandbox, "colmap", &COLMAP.replacen("    model_analyzer*)", wait, 1));
    sandbox.write("slow", "");
}

/// Whether a field of the page has this path.
fn holds(window: &Window, path: &Path) -> bool {
    window.query_all_by_value(&path.display().to_string()).next().is_some()
}

#[test]
fn dropped_photos_become_a_scene_to_train_on() {
    let sandbox = sandbox();
    let mut window = window_with_colmap(sandbox.path("colmap"), None);
    let photos = sandbox.path("photos");
    drop_into(&mut window, &photos);
    assert!(holds(&window, &photos));
    assert_eq!(window.state().error(), None);
    window.get_by_label_contains(ibgs_viewer::NEXT_OF_PHOTOS);
    assert!(!sandbox.path("photos-scene").exists(), "nothing begins before it is asked for");
    window.get_by_label("Find poses").click();
    settle(&mut window);
    assert_eq!(window.state().error(), None);
    window.get_by_label_contains("3 of 3 photos have a pose");
    window.get_by_label_contains("2 parts that do not connect");
    // The form for a training has the scene.
    assert!(holds(&window, &sandbox.path("photos-scene")));
    assert!(sandbox.path("photos-scene/sparse/0/images.bin").exists());
    // The same photos again: nothing is done twice.
    std::fs::remove_file(sandbox.path("calls")).unwrap();
    window.get_by_label("Find poses").click();
    settle(&mut window);
    window.get_by_label_contains("was made of these photos and is used");
    assert!(!sandbox.path("calls").exists());
}

#[test]
fn a_path_can_be_typed() {
    let mut window = window_with_colmap(PathBuf::from("colmap"), None);
    window.get_by_role_and_label(Role::TextInput, "Photos or video").focus();
    window.run_steps(3);
    for letter in ["/", "a", "b"] {
        window.event(Event::Text(letter.to_owned()));
        window.run_steps(3);
    }
    assert!(holds(&window, Path::new("/ab")), "what appears while one types takes the keyboard away");
}

#[test]
fn a_preparation_can_be_stopped_and_continued() {
    let sandbox = sandbox();
    slow(&sandbox);
    let first = Some(Outcome::Photos(sandbox.path("photos")));
    let mut window = window_with_colmap(sandbox.path("colmap"), first);
    let begun = |window: &mut Window| {
        window.get_by_label("Find poses").click();
        let start = Instant::now();
        while window.query_by_label_contains("features: ").is_none() {
            assert!(start.elapsed() < Duration::from_secs(60));
            window.step();
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    begun(&mut window);
    window.get_by_label("Stop").click();
    settle(&mut window);
    window.get_by_label_contains("Stopped.");
    assert_eq!(window.state().error(), None);
    // A window that is closed does not wait for COLMAP.
    begun(&mut window);
    let closed = Instant::now();
    drop(window);
    assert!(closed.elapsed() < Duration::from_secs(20));
    std::fs::remove_file(sandbox.path("slow")).unwrap();
    let first = Some(Outcome::Photos(sandbox.path("photos")));
    let mut window = window_with_colmap(sandbox.path("colmap"), first);
    window.get_by_label("Find poses").click();
    settle(&mut window);
    window.get_by_label_contains("3 of 3 photos have a pose");
}

#[test]
fn what_hinders_a_preparation_is_said_in_the_page() {
    let sandbox = sandbox();
    let mut window = window_with_colmap("no-such-colmap".into(), None);
    window.get_by_label("Find poses").click();
    window.run_steps(3);
    window.get_by_label_contains("choose a folder of photos or a video");
    drop_into(&mut window, &sandbox.path("photos"));
    window.get_by_label("Find poses").click();
    settle(&mut window);
    let error = window.state().error().unwrap();
    assert!(error.contains("no-such-colmap was not found; install COLMAP"), "{error}");
    // A folder without photos is no scene and no photos.
    std::fs::create_dir(sandbox.path("empty")).unwrap();
    drop_into(&mut window, &sandbox.path("empty"));
    assert!(window.state().error().unwrap().contains("empty"));
}
