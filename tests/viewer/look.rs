//! Modes, split, camera, path, screenshots.

use super::*;
use eframe::egui::{MouseWheelSource, MouseWheelUnit, Theme, TouchPhase};
use egui_kittest::kittest::Queryable;
use ibgs_core::raster::Rasterizer;
use ibgs_reference::gpu::device_of;
use ibgs_viewer::Mode;

/// Shows a mode by its key, one that has none by its button.
fn show(window: &mut Window, mode: Mode) {
    match mode.key() {
        Some(key) => press(window, key),
        None => {
            // In the menu, which has the name of what is shown.
            let shown = window.state().mode().name();
            window.get_by_label(shown).click();
            window.run_steps(3);
            window.get_by_label(mode.name()).click();
            settle(window);
        }
    }
}

/// The canvas' middle.
fn middle(window: &mut Window) -> Vec<[u8; 4]> {
    part(window, Vec2::new(0.5, 0.5), Vec2::new(0.75, 0.75))
}

#[test]
fn every_mode_shows_something_else() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window(Some(small(folder.path())));
    assert_eq!((window.state().mode(), window.state().on_view()), (Mode::Final, Some(0)));
    let mut seen: Vec<Vec<[u8; 4]>> = Vec::new();
    for mode in Mode::ALL {
        show(&mut window, mode);
        assert_eq!(window.state().mode(), mode);
        let picture = middle(&mut window);
        // The Gaussians of so short a training are still round: they all have one normal.
        let varies = picture.iter().any(|p| *p != picture[0]);
        assert!(varies || mode == Mode::Normal, "{mode:?} shows one colour");
        assert!(!seen.contains(&picture), "{mode:?} shows what another mode does");
        seen.push(picture);
    }
    // By pointer as well; the photo is of the view, so moving leaves it.
    window.get_by_label("Hidden").click();
    window.run_steps(3);
    window.get_by_label("Depth").click();
    settle(&mut window);
    assert_eq!(window.state().mode(), Mode::Depth);
    press(&mut window, Key::Num8);
    window.key_down(Key::W);
    window.run_steps(2);
    window.key_up(Key::W);
    settle(&mut window);
    assert_eq!((window.state().mode(), window.state().on_view()), (Mode::Final, None));
    assert_eq!(window.state().error(), None);
}

#[test]
fn the_window_looks_as_it_should() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window(Some(untrained(folder.path())));
    window.state_mut().show_figures(false);
    // Thumbnails come a few at a time.
    window.run_steps(20);
    snapshot(&mut window, "dark", 300);
    window.ctx.set_theme(Theme::Light);
    window.run_steps(3);
    snapshot(&mut window, "light", 300);
    press(&mut window, Key::C);
    window.state_mut().show_other(Some(Mode::Depth));
    settle(&mut window);
    snapshot(&mut window, "split with cameras", 300);
    press(&mut window, Key::Escape);
    press(&mut window, Key::C);
    window.get_by_label("?").click();
    window.run_steps(3);
    snapshot(&mut window, "keys", 300);
    // Small windows keep all in reach.
    window.set_size(Vec2::new(360.0, 300.0));
    settle(&mut window);
    assert_eq!(window.state().error(), None);
}

/// The picture is as large as the device can bind, which else has what WebGPU promises, and nothing is said of it.
#[test]
fn a_device_without_room_for_the_window_has_a_smaller_picture() {
    const LIMIT: u64 = 3 << 20;
    let limits = wgpu::Limits { max_storage_buffer_binding_size: LIMIT, ..Default::default() };
    let gpu = device_of(|_| wgpu::DeviceDescriptor { required_limits: limits, ..Default::default() });
    let folder = tempfile::tempdir().unwrap();
    let dataset = many_points();
    let splats = Splats::upload(&from_points(&dataset.points, 0, 0.6).unwrap(), &gpu).unwrap();
    let raster = Arc::new(Rasterizer::new(gpu.clone()));
    let renderer = Renderer::new(raster, splats, [0.0; 3], None).showing_surface();
    let content = Content::Model(Arc::new(renderer));
    let opened = Opened { scene: surroundings(dataset, folder.path()), content };
    let mut window = window_on(&gpu, Some(opened), Vec2::new(760.0, 420.0));
    window.state_mut().show_only_frame(false);
    settle(&mut window);
    assert_eq!(window.state().error(), None);
    let [width, height] = window.state().image_size().unwrap().map(u64::from);
    // Its four intersections, of which each pixel has a depth and a weight, are the most that is bound.
    assert!(32 * width * height <= LIMIT && 32 * width * height > LIMIT / 4, "{width} x {height}");
    // A larger window keeps that.
    window.set_size(Vec2::new(1200.0, 800.0));
    settle(&mut window);
    let [width, height] = window.state().image_size().unwrap().map(u64::from);
    assert!(32 * width * height <= LIMIT && width * height > 40_000, "{width} x {height}");
    assert_eq!(window.state().error(), None);
}

#[test]
fn the_picture_fills_the_window() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window(Some(plain(folder.path())));
    window.state_mut().show_figures(false);
    let ratio = |window: &Window| {
        let [width, height] = window.state().image_size().unwrap();
        f64::from(width) / f64::from(height)
    };
    let middle = |window: &mut Window| part(window, Vec2::new(0.5, 0.35), Vec2::new(0.8, 0.75));
    let edge = |window: &mut Window| part(window, Vec2::new(0.978, 0.35), Vec2::new(0.995, 0.75));
    assert!((ratio(&window) - 4.0 / 3.0).abs() < 0.01, "the shape of the photo");
    let (alone, beyond) = (middle(&mut window), edge(&mut window));
    assert!(beyond.iter().all(|pixel| *pixel == beyond[0]), "nothing beyond the photo");
    window.state_mut().show_only_frame(false);
    settle(&mut window);
    assert!(ratio(&window) > 1.4, "{}", ratio(&window));
    // The same picture, up to half a pixel, with more around it.
    let filled = middle(&mut window);
    let differences = alone.iter().zip(&filled).map(|(a, b)| f64::from(a[1].abs_diff(b[1])));
    let mean = differences.sum::<f64>() / alone.len() as f64;
    assert!(mean < 4.0, "{mean}");
    let around = edge(&mut window);
    assert!(around.iter().any(|pixel| *pixel != around[0]), "what lies beyond is rendered");
    snapshot(&mut window, "filled", 300);
    // A narrow window has its modes in a menu, which is named as what it shows.
    window.set_size(Vec2::new(390.0, 620.0));
    settle(&mut window);
    window.get_by_label("Base").click();
    window.run_steps(3);
    window.get_by_label("Depth").click();
    settle(&mut window);
    assert_eq!(window.state().mode(), Mode::Depth);
    snapshot(&mut window, "narrow", 300);
}

/// In a tall window too, where a view has more above and below.
#[test]
fn leaving_a_view_changes_the_picture_little() {
    let folder = tempfile::tempdir().unwrap();
    let first = Some(Outcome::Opened(Box::new(plain(folder.path()))));
    let mut window = window_with(&gpu(), Opener::default(), first, Vec2::new(390.0, 620.0), None, 0.5);
    window.state_mut().show_only_frame(false);
    window.state_mut().show_figures(false);
    settle(&mut window);
    let canvas = |window: &mut Window| part(window, Vec2::new(0.3, 0.3), Vec2::new(0.95, 0.95));
    let on = canvas(&mut window);
    window.key_down(Key::E);
    window.step();
    window.key_up(Key::E);
    settle(&mut window);
    assert_eq!(window.state().on_view(), None);
    let off = canvas(&mut window);
    let differences = on.iter().zip(&off).map(|(a, b)| f64::from(a[1].abs_diff(b[1])));
    let mean = differences.sum::<f64>() / on.len() as f64;
    assert!(mean > 0.0 && mean < 4.0, "{mean}");
}

#[test]
fn a_split_shows_two_modes() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(small(folder.path()));
    let left = |window: &mut Window| part(window, Vec2::new(0.45, 0.4), Vec2::new(0.55, 0.6));
    let right = |window: &mut Window| part(window, Vec2::new(0.7, 0.4), Vec2::new(0.8, 0.6));
    let whole = (left(&mut window), right(&mut window));
    press(&mut window, Key::Num4);
    let depth = (left(&mut window), right(&mut window));
    press(&mut window, Key::Num1);
    window.state_mut().show_other(Some(Mode::Depth));
    settle(&mut window);
    assert_eq!(window.state().other_mode(), Some(Mode::Depth));
    assert!(left(&mut window) == whole.0 && right(&mut window) == depth.1, "final left, depth right");
    let from = Pos2::new(window.state().divider().unwrap(), 250.0);
    drag(&mut window, PointerButton::Primary, from, Vec2::new(-180.0, 0.0));
    assert!(left(&mut window) == depth.0 && right(&mut window) == depth.1, "the line stands left of both");
    assert_eq!(window.state().on_view(), Some(0), "dragging the line moves no camera");
    // One picture of both is written.
    press(&mut window, Key::P);
    assert!(window.state().message().unwrap().contains("0001.png"));
    let written = image::open(folder.path().join("screenshots/0001.png")).unwrap();
    assert_eq!(Some([written.width(), written.height()]), window.state().image_size());
    window.state_mut().show_other(Some(Mode::Photo));
    settle(&mut window);
    assert_eq!(window.state().other_mode(), Some(Mode::Photo));
    window.key_down(Key::W);
    window.run_steps(2);
    window.key_up(Key::W);
    settle(&mut window);
    assert_eq!(window.state().other_mode(), None, "away from the view there is no photo");
}

#[test]
fn a_split_offers_the_modes_that_are_not_shown() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(plain(folder.path()));
    let shown = window.state().mode();
    let labels = |window: &Window, mode: Mode| window.query_all_by_label(mode.name()).count();
    let before: Vec<usize> = Mode::ALL.into_iter().map(|mode| labels(&window, mode)).collect();
    window.get_by_label("Split").click();
    window.run_steps(3);
    for (mode, before) in Mode::ALL.into_iter().zip(before) {
        assert_eq!(labels(&window, mode) - before, usize::from(mode != shown), "{mode:?}");
    }
}

#[test]
fn models_without_a_network_or_photos_offer_what_they_have() {
    let (renderer, dataset) = small_model();
    let (raster, splats) = (ibgs_reference::gpu::rasterizer(), renderer.splats().clone());
    let renderer = ibgs_core::render::Renderer::new(Arc::new(raster), splats, [0.0; 3], None);
    let view = View { name: "one".to_owned(), camera: dataset.views[0].camera, held_out: false, photo: None };
    let note = Some("the photos are gone".to_owned());
    let scene = Scene { views: vec![view], note: note.clone(), ..Scene::default() };
    let content = Content::Model(Arc::new(renderer.showing_surface()));
    let mut window = window(Some(Opened { scene, content }));
    assert_eq!(window.state().message(), note.as_deref());
    let offered: Vec<Mode> = Mode::ALL.into_iter().filter(|mode| window.state().offers(*mode)).collect();
    let (needing, others): (Vec<Mode>, Vec<Mode>) =
        Mode::ALL.into_iter().partition(|mode| mode.needs_network() || mode.needs_photo());
    assert_eq!(offered, others);
    for mode in [Mode::Final, Mode::Residual, Mode::Visibility, Mode::Difference, Mode::Photo, Mode::Hidden] {
        assert!(needing.contains(&mode), "{mode:?}");
    }
    for mode in [Mode::Base, Mode::Depth, Mode::Normal, Mode::Points, Mode::Ellipsoids] {
        assert!(others.contains(&mode), "{mode:?}");
    }
    for mode in needing {
        show(&mut window, mode);
        assert_eq!(window.state().mode(), Mode::Base);
    }
    window.state_mut().show_other(Some(Mode::Visibility));
    assert_eq!(window.state().other_mode(), None);
}

#[test]
fn a_scene_without_views_can_be_looked_at() {
    let (renderer, dataset) = small_model();
    let scene = Scene { points: dataset.points, ..Scene::default() };
    let content = Content::Model(Arc::new(renderer.showing_surface()));
    let mut window = coarse(Opened { scene, content });
    press(&mut window, Key::ArrowRight);
    press(&mut window, Key::R);
    assert_eq!((window.state().on_view(), window.state().error()), (None, None));
    let picture = middle(&mut window);
    assert!(picture.iter().any(|p| *p != picture[0]), "the camera looks at the points");
}

#[test]
fn keys_and_pointer_move_the_camera() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(small(folder.path()));
    press(&mut window, Key::ArrowRight);
    assert_eq!(window.state().on_view(), Some(1));
    press(&mut window, Key::ArrowLeft);
    press(&mut window, Key::ArrowLeft);
    let last = window.state().on_view();
    assert!(last > Some(1), "{last:?}");
    window.get_by_label("Camera").click();
    window.run_steps(3);
    window.get_by_label("Reset").click();
    settle(&mut window);
    assert_eq!(window.state().on_view(), Some(0));

    let before = *window.state().navigator();
    window.key_down(Key::W);
    window.run_steps(5);
    window.key_up(Key::W);
    settle(&mut window);
    let flown = *window.state().navigator();
    let way = flown.position - before.position;
    assert!(way.length() > 0.0 && way.normalize().dot(before.world_from_view.z_axis) > 0.999);

    let dragged = |window: &mut Window, with| {
        drag(window, with, CANVAS, Vec2::splat(30.0));
        *window.state().navigator()
    };
    let orbited = dragged(&mut window, PointerButton::Primary);
    assert!(orbited.pivot().abs_diff_eq(flown.pivot(), 1e-9) && orbited.position.distance(flown.position) > 1e-3);
    let turned = dragged(&mut window, PointerButton::Secondary);
    assert!(turned.position == orbited.position && turned.pivot().distance(orbited.pivot()) > 1e-3);
    let panned = dragged(&mut window, PointerButton::Middle);
    assert!(panned.world_from_view == turned.world_from_view && panned.position != turned.position);
    window.event(Event::MouseWheel {
        unit: MouseWheelUnit::Line,
        delta: Vec2::new(0.0, 1.0),
        phase: TouchPhase::Move,
        source: MouseWheelSource::Wheel,
        modifiers: Modifiers::NONE,
    });
    window.run_steps(20);
    let zoomed = *window.state().navigator();
    assert!(zoomed.distance < panned.distance && zoomed.pivot().abs_diff_eq(panned.pivot(), 1e-6));
    assert_eq!(window.state().error(), None);
}

#[test]
fn a_link_leads_to_a_place_and_a_mode() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(small(folder.path()));
    assert_eq!(window.state().link().as_deref(), Some("mode=final&view=0"));
    window.state_mut().follow_link("mode=depth&view=2");
    settle(&mut window);
    assert_eq!((window.state().mode(), window.state().on_view()), (Mode::Depth, Some(2)));
    // A place beside all views comes back within a pixel.
    drag(&mut window, PointerButton::Primary, CANVAS, Vec2::new(40.0, -15.0));
    let (there, link) = (*window.state().navigator(), window.state().link().unwrap());
    assert!(link.starts_with("mode=depth&at="), "{link}");
    press(&mut window, Key::R);
    window.state_mut().follow_link(&link);
    settle(&mut window);
    let back = *window.state().navigator();
    assert!(back.position.distance(there.position) < 1e-4 * there.distance, "{back:?} is not {there:?}");
    assert!(back.world_from_view.abs_diff_eq(there.world_from_view, 1e-5) && (back.fov - there.fov).abs() < 1e-4);
    assert_eq!(window.state().on_view(), None);
    // What makes no sense changes nothing.
    for link in ["", "view=99", "at=1,2&turn=0,0,0,0", "mode=other&at=NaN,0,0&turn=1,0,0,0&distance=1&fov=1", "view=-1"]
    {
        window.state_mut().follow_link(link);
        assert_eq!((*window.state().navigator(), window.state().mode()), (back, Mode::Depth), "{link}");
    }
}

#[test]
fn another_model_of_the_scene_takes_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let whole = small(folder.path());
    let Content::Model(renderer) = &whole.content else { unreachable!("it is a model") };
    let base = Renderer::new(Arc::new(rasterizer()), renderer.splats().clone(), [0.0; 3], None).showing_surface();
    let scene = Scene { views: whole.scene.views.clone(), ..Scene::default() };
    let mut window = window(Some(Opened { scene, content: Content::Model(Arc::new(base)) }));
    window.state_mut().follow_link("view=1");
    settle(&mut window);
    assert!(!window.state().offers(Mode::Residual));
    let before = middle(&mut window);
    window.state_mut().replace(whole);
    until(&mut window, "complete", |viewer| viewer.offers(Mode::Residual));
    settle(&mut window);
    assert!(middle(&mut window) != before, "the residual does not show");
    assert_eq!((window.state().mode(), window.state().on_view()), (Mode::Final, Some(1)));
    press(&mut window, Key::Num3);
    assert_eq!((window.state().mode(), window.state().error()), (Mode::Residual, None));
}
