//! The start page, what is dropped into the window, and what cannot be opened.

use super::*;
use eframe::egui::DroppedFile;
use egui_kittest::kittest::Queryable;
use ibgs_core::scene::{PlyFlavor, write_ply};
use ibgs_viewer::Wanted;
use std::path::PathBuf;

#[derive(Debug)]
struct Dropped(PathBuf);

impl DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|error| error.to_string())
    }
}

fn drop_into(window: &mut Window, path: &Path) {
    window.input_mut().dropped_files.push(Arc::new(Dropped(path.to_owned())));
    settle(window);
}

#[test]
fn the_start_page_opens_what_is_typed() {
    let folder = tempfile::tempdir().unwrap();
    let (renderer, _) = small_model();
    let file = folder.path().join("model.ply");
    write_ply(&file, &renderer.splats().download(renderer.gpu()).unwrap(), PlyFlavor::Full).unwrap();
    let mut window = window(None);
    snapshot(&mut window, "start page", 100);
    assert!(window.state().scene().is_none());
    window.get_by_role(eframe::egui::accesskit::Role::TextInput).focus();
    window.run_steps(2);
    window.event(Event::Text(file.display().to_string()));
    window.run_steps(2);
    window.get_by_label("Open").click();
    settle(&mut window);
    assert_eq!(window.state().error(), None);
    let scene = window.state().scene().unwrap();
    assert!(scene.views.is_empty() && !scene.points.is_empty());
}

#[test]
fn what_cannot_be_opened_is_told_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window(Some(small(folder.path())));
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    let cases = [
        (folder.path().join("missing"), "missing"),
        (write("notes.txt", b"hello"), "notes.txt"),
        (write("cut.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 9\n"), "cut.ply"),
        (write("noise.ibgs", &[7; 99]), "noise.ibgs"),
        (empty, "empty"),
    ];
    for (path, named) in cases {
        drop_into(&mut window, &path);
        let error = window.state().error().unwrap_or_else(|| panic!("{named} was opened")).to_owned();
        assert!(error.contains(named) && !error.contains('\n'), "{error}");
        assert_eq!(window.state().scene().unwrap().title, "small", "what was open stays open");
        window.get_by_label("Close").click();
        window.run_steps(2);
        assert_eq!(window.state().error(), None);
    }
    window.state_mut().open(Wanted::Path(folder.path().join("notes.txt")));
    settle(&mut window);
    window.run_steps(5);
    window.state_mut().show_figures(false);
    window.run_steps(20);
    assert!(window.state().error().is_some());
}
