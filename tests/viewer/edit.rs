//! Selecting and deleting Gaussians, undo, and saving what is left.

use super::*;
use eframe::egui::Theme;
use egui_kittest::kittest::Queryable;
use ibgs_core::bundle::{Bundle, Packing};
use ibgs_core::edit::Mask;
use ibgs_core::ensemble::Member;
use ibgs_core::model::{Model, ModelOptions};
use ibgs_core::output::{cameras, multi_view};
use ibgs_core::residual::Output;
use ibgs_core::scene::{Format, Gaussians, read_gaussians, write_gaussians};
use ibgs_viewer::{Mode, Open, OpenRequest};
use std::path::PathBuf;
use std::process::Command;

/// A window with the editor open.
pub fn editing(opened: Opened) -> Window {
    let first = Some(Outcome::Opened(Box::new(opened)));
    let mut window = window_with(&gpu(), Opener::default(), first, Vec2::new(1000.0, 800.0), None, 0.5);
    window.state_mut().show_figures(false);
    press(&mut window, Key::X);
    until(&mut window, "edited", |viewer| viewer.edited().is_some());
    settle(&mut window);
    window
}

pub fn pick(window: &mut Window, label: &str) {
    window.get_by_label(label).click();
    settle(window);
}

/// Clicks and waits.
pub fn click_on(window: &mut Window, at: Pos2) {
    click(window, at);
    settle(window);
}

pub fn counts(window: &Window) -> [usize; 2] {
    window.state().edited().unwrap()
}

pub fn command(window: &mut Window, modifiers: Modifiers, key: Key) {
    window.key_press_modifiers(modifiers, key);
    settle(window);
}

/// The canvas without the panels, the marks over it and the pointer.
pub fn canvas(window: &mut Window) -> Vec<[u8; 4]> {
    window.event(Event::PointerGone);
    window.run_steps(2);
    part(window, Vec2::new(0.3, 0.3), Vec2::new(0.6, 0.8))
}

fn bundle(path: &Path) {
    write_bundle(path, from_points(&many_points().points, 0, 0.6).unwrap(), Vec::new());
}

/// A bundle of a model that has learnt nothing.
pub fn write_bundle(path: &Path, gaussians: Gaussians, members: Vec<Member>) {
    let dataset = many_points();
    let photo = |&index: &usize| (dataset.views[index].name.clone(), dataset.views[index].photo.clone());
    let mut config = mean_of_sources();
    // The window's images are large for a software adapter.
    config.residual.factor = Some(0.25);
    config.residual.output = Some(Output::Residual);
    config.ensemble = Some(members.len() as u32 + 1);
    let bundle = Bundle {
        iteration: 30,
        gaussians,
        members,
        levels: None,
        network: Some(weights::to_bytes(&weights::random(0)).unwrap()),
        exposure: None,
        cameras: cameras::records(dataset),
        sources: multi_view::records(dataset, &config.sources),
        photos: dataset.train.iter().map(photo).collect(),
        config,
    };
    bundle.write(path, Packing::Lossless).unwrap();
}

pub fn open(path: &Path) -> Opened {
    let wanted = OpenRequest::Path(path.to_owned());
    match Opener::default().open(&wanted, &gpu(), &|_| {}).unwrap() {
        Outcome::Opened(opened) => *opened,
        Outcome::Scene(path) | Outcome::Photos(path) => panic!("{} is a model", path.display()),
    }
}

fn renderer(opened: &Opened) -> &Renderer {
    let Content::Model(renderer) = &opened.content else { panic!("a model is no training") };
    renderer
}

#[test]
fn deleting_is_undone_and_redone() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = editing(plain(folder.path()));
    press(&mut window, Key::Num2);
    let [whole, selected] = counts(&window);
    assert_eq!((whole, selected), (4_000, 0));
    let before = canvas(&mut window);
    // Nothing is selected: nothing is deleted.
    press(&mut window, Key::Delete);
    assert_eq!(counts(&window), [whole, 0]);
    pick(&mut window, "Box");
    pick(&mut window, "Inside");
    let inside = counts(&window)[1];
    assert!(inside > 1_000 && inside < whole, "{inside}");
    press(&mut window, Key::Delete);
    assert_eq!(counts(&window), [whole - inside, 0]);
    press(&mut window, Key::Escape);
    let after = canvas(&mut window);
    assert!(before != after, "the deleted Gaussians are still there");
    command(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!(counts(&window), [whole, inside]);
    // Nor does what is selected stand over the picture then.
    command(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!(counts(&window), [whole, 0]);
    assert!(canvas(&mut window) == before, "undone, the picture is what it was");
    for _ in 0..2 {
        command(&mut window, Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    }
    assert_eq!(counts(&window), [whole - inside, 0]);
    assert!(canvas(&mut window) == after);
    // All but the box is left where it is kept.
    command(&mut window, Modifiers::COMMAND, Key::Z);
    pick(&mut window, "Keep only");
    assert_eq!(counts(&window), [inside, 0]);
    // The last Gaussian stays.
    pick(&mut window, "All");
    press(&mut window, Key::Delete);
    assert_eq!(counts(&window), [inside, inside]);
    assert_eq!(window.state().error(), None);
}

#[test]
fn a_brush_paints_what_is_in_front() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = editing(plain(folder.path()));
    pick(&mut window, "Brush");
    let stood = *window.state().navigator();
    let at = Pos2::new(430.0, 430.0);
    drag(&mut window, PointerButton::Primary, at, Vec2::new(60.0, 30.0));
    assert_eq!((*window.state().navigator(), window.state().on_view()), (stood, Some(0)), "painting moves no camera");
    assert!(window.state().inspection().is_none());
    let front = counts(&window)[1];
    assert!(front > 0);
    pick(&mut window, "Only in front");
    drag(&mut window, PointerButton::Primary, at, Vec2::new(60.0, 30.0));
    let through = counts(&window)[1];
    assert!(through > front, "{through} {front}");
    // A stroke is one step.
    command(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!(counts(&window)[1], front);
    pick(&mut window, "Add");
    drag(&mut window, PointerButton::Primary, at + Vec2::new(0.0, 120.0), Vec2::new(60.0, 0.0));
    assert!(counts(&window)[1] > front);
    pick(&mut window, "Subtract");
    drag(&mut window, PointerButton::Primary, at + Vec2::new(0.0, 120.0), Vec2::new(60.0, 0.0));
    assert!(counts(&window)[1] <= front);
    // Without the tool the pointer moves the camera again.
    press(&mut window, Key::Escape);
    drag(&mut window, PointerButton::Primary, at, Vec2::new(60.0, 30.0));
    assert_ne!(*window.state().navigator(), stood);
    assert_eq!(window.state().error(), None);
}

#[test]
fn handles_move_the_box() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window_on(&gpu(), Some(untrained(folder.path())), Vec2::new(1280.0, 800.0));
    press(&mut window, Key::X);
    until(&mut window, "edited", |viewer| viewer.edited().is_some());
    pick(&mut window, "Box");
    let (stood, before) = (*window.state().navigator(), *window.state().crop_box().unwrap());
    // Where the picture of the editor shows a handle.
    drag(&mut window, PointerButton::Primary, Pos2::new(724.0, 141.0), Vec2::new(-30.0, 40.0));
    let after = *window.state().crop_box().unwrap();
    assert_eq!((*window.state().navigator(), window.state().on_view()), (stood, Some(0)), "a handle moves no camera");
    let resized = (0..3).filter(|&axis| after.size[axis] != before.size[axis]).count();
    assert!(resized == 1 && after.center != before.center, "{before:?} {after:?}");
    // The same where a frame is slow, and has the way to the handle, the press, and more of the way.
    pick(&mut window, "Fit");
    assert_eq!(window.state().crop_box().unwrap().size, before.size);
    let at = Pos2::new(724.0, 141.0);
    window.event(Event::PointerMoved(at + Vec2::new(-300.0, 200.0)));
    window.step();
    let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
    window.event(Event::PointerMoved(at));
    window.event(Event::PointerButton { pos: at, button, pressed: true, modifiers });
    window.event(Event::PointerMoved(at + Vec2::new(-15.0, 20.0)));
    window.step();
    window.event(Event::PointerMoved(at + Vec2::new(-30.0, 40.0)));
    window.step();
    super::button(&mut window, at + Vec2::new(-30.0, 40.0), button, false);
    settle(&mut window);
    let slow = *window.state().crop_box().unwrap();
    assert_eq!((*window.state().navigator(), window.state().on_view()), (stood, Some(0)));
    assert!(slow.size.distance(after.size) < 0.05 * after.size.distance(before.size), "{after:?} {slow:?}");
    assert_eq!(window.state().error(), None);
}

#[test]
fn an_edited_file_of_gaussians_is_saved_and_opened_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.ply");
    write_gaussians(&path, &from_points(&many_points().points, 0, 0.6).unwrap(), Format::Ply).unwrap();
    let mut window = editing(open(&path));
    window.state_mut().show_mode(Mode::Base);
    pick(&mut window, "Box");
    pick(&mut window, "Outside");
    press(&mut window, Key::Delete);
    let [left, _] = counts(&window);
    assert!((1..4_000).contains(&left));
    // The name that is offered is a new one.
    let saved = folder.path().join("points-edited.ply");
    pick(&mut window, "Save model");
    assert!(window.state().message().unwrap().contains("points-edited.ply"), "{:?}", window.state().error());
    let back = read_gaussians(&saved).unwrap();
    assert_eq!(back.len(), left);
    let whole = read_gaussians(&path).unwrap();
    let places: Vec<_> = whole.positions().collect();
    let kept = Mask::of(whole.len(), |i| back.positions().any(|p| p.distance(places[i]) < 1e-5)).of_model(&whole);
    assert_eq!(kept.len(), left, "what was saved is what the file had");
    // Never over another file without being asked.
    pick(&mut window, "Save model");
    let error = window.state().error().unwrap().to_owned();
    assert!(error.contains("points-edited.ply is there already") && error.contains("replace"), "{error}");
    pick(&mut window, "replace");
    pick(&mut window, "Save model");
    for (name, wanted) in [("a.ibgs", "cameras and photos"), ("a.txt", "must end in"), ("", "give the file a name")] {
        let path = if name.is_empty() { PathBuf::new() } else { folder.path().join(name) };
        window.state_mut().set_model_file(&path);
        pick(&mut window, "Save model");
        let error = window.state().error().unwrap().to_owned();
        assert!(error.contains(wanted) && !error.contains('\n'), "{error}");
        assert!(!folder.path().join("a.ibgs").exists());
    }
    // It looks the same when it is opened.
    let opened = open(&saved);
    let camera = window.state().navigator().camera(320, 240);
    let edited = renderer(&open(&path)).with_splats(Splats::upload(&kept, &gpu()).unwrap());
    let [a, b] = [renderer(&opened), &edited].map(|renderer| renderer.render(&camera).unwrap().base().unwrap());
    assert!(a.rgb.iter().any(|&v| v > 0.1));
    assert!(a.rgb.iter().zip(&b.rgb).all(|(a, b)| (a - b).abs() < 0.02), "the saved file shows another picture");
}

#[test]
fn an_edited_bundle_is_saved_and_opened_again() {
    let folder = tempfile::tempdir().unwrap();
    let (path, saved) = (folder.path().join("model.ibgs"), folder.path().join("model-edited.ibgs"));
    bundle(&path);
    let mut window = editing(open(&path));
    pick(&mut window, "Box");
    pick(&mut window, "Inside");
    press(&mut window, Key::Delete);
    let [left, _] = counts(&window);
    assert!((1..4_000).contains(&left));
    press(&mut window, Key::Escape);
    press(&mut window, Key::P);
    pick(&mut window, "Save model");
    assert!(window.state().message().unwrap().contains("model-edited.ibgs"), "{:?}", window.state().error());
    // It needs no scene, has all of the model but what was deleted, and shows what the window did.
    let mut model = Model::open(&saved, &ModelOptions::default()).unwrap();
    assert_eq!((model.gaussians.len(), model.training_photos().unwrap().len()), (left, many_points().train.len()));
    let differs = differs(folder.path(), &model.renderer(&gpu()).unwrap(), &model);
    assert!(differs < 0.001, "{differs} of the values differ");
    for arguments in [&["info"][..], &["render"]] {
        let program = Command::new(env!("CARGO_BIN_EXE_ibgs")).args(arguments).arg(&saved).output().unwrap();
        assert!(program.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&program.stderr));
    }
    assert!(folder.path().join("model-edited/test/ours_30/renders").is_dir());
    let whole = Model::open(&path, &ModelOptions::default()).unwrap();
    assert_eq!((&model.network, &model.cameras), (&whole.network, &whole.cameras));
    assert_eq!(Bundle::read(&saved).unwrap().sources, Bundle::read(&path).unwrap().sources);
}

/// The share of a screenshot's values that differ from a renderer's image of the first view.
pub fn differs(folder: &Path, renderer: &Renderer, model: &Model) -> f64 {
    let shot = image::open(folder.join("model/screenshots/0001.png")).unwrap().into_rgb8();
    // The window begins with a view that has a photo.
    let camera = model.training_views()[0].camera.resized(shot.width(), shot.height());
    let image = renderer.render(&camera).unwrap().image().unwrap().unwrap().to_rgb8();
    let differ = image.iter().zip(shot.as_raw()).filter(|(a, b)| a.abs_diff(**b) > 2).count();
    differ as f64 / image.len() as f64
}

#[test]
fn points_and_ellipsoids_are_opaque() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = many_points();
    // Flat and small enough to stand apart.
    let mut gaussians = from_points(&dataset.points, 0, 0.6).unwrap();
    gaussians.log_scales.iter_mut().for_each(|[x, y, z]| (*x, *y, *z) = (*x - 1.0, *y - 1.5, *z - 2.5));
    let splats = Splats::upload(&gaussians, &gpu()).unwrap();
    let images = image_part(dataset, &TrainConfig::default(), &weights::random(0));
    let mut window = window(Some(opened(dataset, splats, images, folder.path())));
    press(&mut window, Key::Num9);
    assert_eq!(window.state().mode(), Mode::Points);
    let points = part(&mut window, Vec2::new(0.4, 0.4), Vec2::new(0.7, 0.8));
    let dark = points.iter().filter(|p| p[0].max(p[1]).max(p[2]) < 10).count();
    assert!(dark > points.len() / 4 && dark < points.len(), "{dark} of {} pixels show no point", points.len());
    press(&mut window, Key::Num0);
    assert_eq!(window.state().mode(), Mode::Ellipsoids);
    let ellipsoids = part(&mut window, Vec2::new(0.4, 0.4), Vec2::new(0.7, 0.8));
    assert!(ellipsoids != points);
    window.state_mut().show_figures(false);
    window.state_mut().show_other(Some(Mode::Points));
    settle(&mut window);
    window.run_steps(20);
    snapshot(&mut window, "ellipsoids and points", 300);
    // Beside another mode, and in a screenshot.
    window.state_mut().show_other(Some(Mode::Final));
    settle(&mut window);
    press(&mut window, Key::P);
    assert!(window.state().message().is_some_and(|text| text.contains("0001.png")), "{:?}", window.state().error());
}

#[test]
fn the_editor_looks_as_it_should() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window_on(&gpu(), Some(untrained(folder.path())), Vec2::new(1280.0, 800.0));
    window.state_mut().show_figures(false);
    press(&mut window, Key::X);
    until(&mut window, "edited", |viewer| viewer.edited().is_some());
    pick(&mut window, "Box");
    pick(&mut window, "Inside");
    window.run_steps(20);
    snapshot(&mut window, "editor", 600);
    window.ctx.set_theme(Theme::Light);
    pick(&mut window, "Brush");
    drag(&mut window, PointerButton::Primary, Pos2::new(520.0, 420.0), Vec2::new(80.0, 30.0));
    settle(&mut window);
    snapshot(&mut window, "editor with brush", 600);
    // Small windows keep all in reach.
    window.set_size(Vec2::new(620.0, 420.0));
    settle(&mut window);
    pick(&mut window, "Box");
    window.run_steps(20);
    snapshot(&mut window, "editor in a small window", 600);
    assert_eq!(window.state().error(), None);
}
