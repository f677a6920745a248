//! Settings, keys of the window, and what it says where it cannot show what was asked for.

use super::edit::{counts, editing, pick};
use super::open::Stored;
use super::*;
use eframe::egui::{Role, Theme, ViewportCommand};
use eframe::{APP_KEY, App};
use egui_kittest::kittest::Queryable;
use glam::{DMat3, DQuat, DVec3};
use ibgs_core::picture::{MOST_VISIBLE, visibility_color};
use ibgs_core::scene::{PlyFlavor, write_ply};
use ibgs_viewer::Mode;

/// A window on a model with these settings kept from before.
fn with(settings: &str, opened: Opened) -> Window {
    let stored = Stored([(APP_KEY.to_owned(), settings.to_owned())].into());
    let first = Some(Outcome::Opened(Box::new(opened)));
    let stored: &'static dyn Storage = Box::leak(Box::new(stored));
    let mut window = window_with(&gpu(), Opener::default(), first, Vec2::new(760.0, 420.0), Some(stored), 0.5);
    window.state_mut().show_figures(false);
    window
}

/// Looks along the up axis from this many extents above: no photo was taken that way.
fn look_up(window: &mut Window, above: f64) {
    let navigator = *window.state().navigator();
    let right = navigator.up.any_orthonormal_vector();
    let axes = DMat3::from_cols(right, navigator.up.cross(right), navigator.up);
    let turn = DQuat::from_mat3(&axes);
    let DVec3 { x, y, z } = navigator.position + navigator.up * above * navigator.distance;
    let DQuat { x: i, y: j, z: k, w } = turn;
    window.state_mut().follow_link(&format!("mode=final&at={x},{y},{z}&turn={w},{i},{j},{k}&distance=1&fov=0.9"));
    settle(window);
}

/// A part of the picture, without the pointer.
fn canvas(window: &mut Window) -> Vec<[u8; 4]> {
    window.event(Event::PointerGone);
    window.run_steps(2);
    part(window, Vec2::new(0.5, 0.5), Vec2::new(0.75, 0.75))
}

#[test]
fn the_background_is_the_chosen_one_after_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = with("()", plain(folder.path()));
    look_up(&mut window, 1e4);
    assert!(canvas(&mut window).iter().all(|pixel| *pixel == [0, 0, 0, 255]), "its own background is black");
    pick(&mut window, "Settings");
    window.get_by_role_and_label(Role::ComboBox, "Background").click();
    window.run_steps(3);
    pick(&mut window, "white");
    window.state_mut().show_settings(false);
    settle(&mut window);
    for mode in [Key::Num2, Key::Num9] {
        press(&mut window, mode);
        assert!(canvas(&mut window).iter().all(|pixel| *pixel == [255; 4]), "{:?}", window.state().mode());
    }
    let mut stored = Stored::default();
    window.state_mut().save(&mut stored);
    let kept = stored.0[APP_KEY].clone();
    assert!(kept.contains("White"), "{kept}");
    let colored = kept.replace("White", "Color").replace("(128,128,128)", "(10,200,30)");
    for (settings, color) in [(&kept, [255; 4]), (&colored, [10, 200, 30, 255])] {
        let mut window = with(settings, plain(folder.path()));
        look_up(&mut window, 1e4);
        assert!(canvas(&mut window).iter().all(|pixel| *pixel == color), "{settings}");
    }
}

#[test]
fn speed_and_view_angle_are_those_of_the_settings() {
    let folder = tempfile::tempdir().unwrap();
    let flown = |settings: &str| {
        let mut window = with(settings, plain(folder.path()));
        let before = *window.state().navigator();
        window.key_down(Key::W);
        window.run_steps(5);
        window.key_up(Key::W);
        settle(&mut window);
        let after = *window.state().navigator();
        (after.position.distance(before.position), before.fov, after.fov)
    };
    let (usual, own, same) = flown("()");
    let (fast, on_view, angle) = flown("(speed:4.0,own_angle:true,angle:30.0)");
    assert!((fast / usual - 4.0).abs() < 1e-6, "{fast} is not four times {usual}");
    assert!(own == same && own == on_view, "a view has its own angle, and leaving it changes none");
    assert!((angle.to_degrees() - 30.0).abs() < 1e-9, "{angle}");
}

#[test]
fn a_grid_lies_on_the_ground() {
    let folder = tempfile::tempdir().unwrap();
    let picture = |settings: &str| canvas(&mut with(settings, plain(folder.path())));
    assert!(picture("()") == picture("()"));
    assert!(picture("()") != picture("(shows_ground:true)"));
}

fn settings_picture(name: &str, theme: Theme, size: Vec2) {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window_on(&gpu(), Some(plain(folder.path())), size);
    window.ctx.set_theme(theme);
    window.state_mut().show_figures(false);
    window.state_mut().show_settings(true);
    window.run_steps(20);
    settle(&mut window);
    snapshot(&mut window, name, 300);
}

#[test]
fn the_settings_look_as_they_should() {
    settings_picture("settings dark", Theme::Dark, Vec2::new(1280.0, 800.0));
}

#[test]
fn the_settings_fit_into_a_small_window() {
    settings_picture("settings in a small window", Theme::Light, Vec2::new(620.0, 420.0));
}

/// Escape closes them, and what else covers the picture, before it does anything else.
#[test]
fn escape_closes_the_settings_first() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(plain(folder.path()));
    click(&mut window, CANVAS);
    until(&mut window, "inspected", |viewer| viewer.inspection().is_some());
    press(&mut window, Key::F1);
    window.get_by_label("left drag");
    pick(&mut window, "Settings");
    window.run_steps(20);
    window.get_by_label("Always sharp");
    assert!(window.query_by_label("left drag").is_none(), "one takes the place of the other");
    press(&mut window, Key::Escape);
    window.run_steps(20);
    assert!(window.query_by_label("Always sharp").is_none() && window.query_by_label("left drag").is_none());
    assert!(window.state().inspection().is_some());
    press(&mut window, Key::Escape);
    assert!(window.state().inspection().is_none());
}

#[test]
fn escape_closes_the_settings_on_the_start_page_too() {
    let mut window = window(None);
    pick(&mut window, "Settings");
    // A menu in them closes first.
    window.get_by_role_and_label(Role::ComboBox, "Background").click();
    window.run_steps(3);
    window.get_by_label("white");
    for label in ["white", "Always sharp"] {
        window.get_by_label("Always sharp");
        press(&mut window, Key::Escape);
        window.run_steps(20);
        assert!(window.query_by_label(label).is_none(), "{label}");
    }
}

#[test]
fn ctrl_o_opens_and_without_a_file_dialog_the_path_is_typed() {
    let folder = tempfile::tempdir().unwrap();
    let (renderer, _) = small_model();
    let file = folder.path().join("model.ply");
    write_ply(&file, &renderer.splats().download(renderer.gpu()).unwrap(), PlyFlavor::Full).unwrap();
    let opened = |window: &Window| window.state().scene().and_then(|scene| scene.path.clone());
    let mut window = window(None);
    let chosen = file.clone();
    window.state_mut().set_file_dialog(move || Some(chosen.clone()));
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    until(&mut window, "opened", |viewer| viewer.scene().is_some());
    settle(&mut window);
    assert_eq!(opened(&window), Some(file.clone()));
    window.state_mut().set_file_dialog(|| None);
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    until(&mut window, "refused", |viewer| viewer.error().is_some());
    assert_eq!(window.state().error(), Some("no file dialog here; type the path"));
    window.run_steps(3);
    // The field waits for the path, so keys are text.
    window.event(Event::Text(file.display().to_string()));
    window.run_steps(2);
    window.key_press(Key::Enter);
    settle(&mut window);
    assert_eq!((opened(&window), window.state().error()), (Some(file), None));
    window.get_by_label("Edit");
}

#[test]
fn f11_and_ctrl_s_do_what_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = editing(plain(folder.path()));
    let (key, modifiers) = (Key::F11, Modifiers::NONE);
    window.event(Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers });
    window.step();
    let commands = || window.output().viewport_output.values().flat_map(|viewport| viewport.commands.clone());
    assert!(commands().any(|command| command == ViewportCommand::Fullscreen(true)));
    // Where nothing can be deleted, all stays.
    let file = folder.path().join("edited.ply");
    window.state_mut().set_model_file(&file);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(&mut window);
    let message = window.state().message().map(str::to_owned);
    assert!(message.as_ref().is_some_and(|text| text.contains("edited.ply")), "{message:?}");
    assert!(file.exists() && counts(&window)[0] > 0);
    // A file that is there is kept, and that it was is told until it is closed.
    let written = std::fs::read(&file).unwrap();
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    settle(&mut window);
    assert!(window.state().error().unwrap().contains("is there already"));
    assert!(std::fs::read(&file).unwrap() == written);
}

#[test]
fn where_no_photo_is_near_the_window_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(small(folder.path()));
    assert!(!window.state().lacks_sources());
    look_up(&mut window, 0.0);
    assert!(window.state().lacks_sources());
    let shown = canvas(&mut window);
    press(&mut window, Key::Num2);
    assert!(canvas(&mut window) == shown, "it is the base image");
}

#[test]
fn visible_sources_have_the_legend_of_the_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window(Some(small(folder.path())));
    window.state_mut().show_figures(false);
    press(&mut window, Key::Num6);
    assert_eq!(window.state().mode(), Mode::Visibility);
    let corner = part(&mut window, Vec2::new(0.1, 0.05), Vec2::new(0.95, 0.2));
    let counts = |corner: &[[u8; 4]]| {
        [0, 1, 2, 3].map(|count| {
            let [r, g, b] = visibility_color(count, MOST_VISIBLE);
            corner.iter().filter(|pixel| **pixel == [r, g, b, 255]).count()
        })
    };
    assert!(counts(&corner).into_iter().all(|pixels| pixels > 50), "{:?}", counts(&corner));
}

#[test]
fn a_mode_that_is_off_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window(Some(plain(folder.path())));
    window.set_size(Vec2::new(1000.0, 420.0));
    settle(&mut window);
    for mode in [Mode::Final, Mode::Residual] {
        assert!(!window.state().offers(mode));
        window.get_by_label(mode.name()).hover();
        window.run_steps(60);
        window.get_by_label_contains("This model has no residual network");
        window.event(Event::PointerGone);
        window.run_steps(10);
    }
}

#[test]
fn buttons_leave_the_keys_to_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(plain(folder.path()));
    window.set_size(Vec2::new(1200.0, 600.0));
    settle(&mut window);
    let focused = |window: &Window| window.ctx.memory(|memory| memory.focused());
    // Clicked, and chosen by Tab.
    window.get_by_label("Depth").click();
    settle(&mut window);
    window.key_press(Key::Tab);
    window.run_steps(2);
    assert!(focused(&window).is_some() && !window.ctx.text_edit_focused());
    press(&mut window, Key::Num2);
    assert_eq!(window.state().mode(), Mode::Base);
    let stood = window.state().navigator().position;
    window.key_down(Key::W);
    window.run_steps(3);
    window.key_up(Key::W);
    settle(&mut window);
    assert_ne!(window.state().navigator().position, stood);
    // What presses and moves it stays the button's.
    let (view, shown) = (window.state().on_view(), focused(&window));
    press(&mut window, Key::ArrowRight);
    assert_eq!(window.state().on_view(), view);
    assert_ne!(focused(&window), shown, "the arrow goes to another button");
    // An open menu and a text field keep all keys.
    let depth = Mode::Depth.key().unwrap();
    window.get_by_label("Camera").click();
    window.run_steps(3);
    press(&mut window, depth);
    assert_eq!(window.state().mode(), Mode::Base);
    press(&mut window, Key::Escape);
    press(&mut window, depth);
    assert_eq!(window.state().mode(), Mode::Depth);
    press(&mut window, Key::X);
    until(&mut window, "edited", |viewer| viewer.edited().is_some());
    window.get_by_role(Role::TextInput).scroll_to_me();
    window.run_steps(10);
    window.get_by_role(Role::TextInput).click();
    window.run_steps(3);
    press(&mut window, Key::Num2);
    assert!(window.ctx.text_edit_focused() && window.state().mode() == Mode::Depth);
    click(&mut window, CANVAS);
    press(&mut window, Key::Num2);
    assert_eq!((window.state().mode(), window.state().error()), (Mode::Base, None));
}
