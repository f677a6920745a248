//! Camera paths: the timeline, films and stills.

use super::*;
use egui_kittest::kittest::Queryable;
use ibgs_core::camera_path::KeyframePath;

/// Opens the panel and adds keyframes at three views.
fn add_keyframes(window: &mut Window) {
    window.state_mut().show_path(true);
    window.state_mut().show_figures(false);
    for view in [0, 5, 9] {
        window.state_mut().stand_on(view);
        settle(window);
        press(window, Key::K);
    }
}

#[test]
fn a_keyframe_that_no_timeline_shows_is_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(plain(folder.path()));
    press(&mut window, Key::K);
    assert_eq!(window.state().keyframes(), 1);
    assert!(window.state().message().unwrap().starts_with("keyframe 1 added"), "{:?}", window.state().message());
}

#[test]
fn a_camera_path_is_made_played_kept_and_filmed() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = window(Some(untrained(folder.path())));
    add_keyframes(&mut window);
    assert_eq!(window.state().keyframes(), 3);
    window.get_by_label("Add keyframe").click();
    settle(&mut window);
    assert_eq!(window.state().keyframes(), 4);
    window.run_steps(20);
    snapshot(&mut window, "camera path", 300);
    window.set_size(Vec2::new(620.0, 800.0));
    settle(&mut window);
    snapshot(&mut window, "camera path in a tall window", 300);
    window.set_size(Vec2::new(760.0, 420.0));
    settle(&mut window);
    // Play moves the camera along.
    let before = window.state().navigator().position;
    window.key_press(Key::Space);
    until(&mut window, "moved", |viewer| viewer.navigator().position.distance(before) > 1e-3);
    window.key_press(Key::Space);
    settle(&mut window);

    let file = folder.path().join("path.json");
    window.state_mut().set_path_file(&file);
    window.run_steps(2);
    window.get_by_label("Save").click();
    window.run_steps(2);
    assert!(window.state().message().unwrap().contains("path.json"), "{:?}", window.state().error());
    let saved = KeyframePath::load(&file).unwrap();
    assert_eq!(saved.keyframes.len(), 4);
    window.get_by_label("Clear").click();
    window.run_steps(2);
    assert_eq!(window.state().keyframes(), 0);
    // A turn in one click, around what the camera orbits.
    let orbited = window.state().navigator().pivot();
    window.get_by_label("Turntable").click();
    settle(&mut window);
    assert_eq!(window.state().keyframes(), 16);
    let start = *window.state().navigator();
    window.get_by_label("5").click();
    settle(&mut window);
    let aside = *window.state().navigator();
    assert!(aside.pivot().distance(orbited) < 1e-6 * start.distance, "it looks at {}", aside.pivot());
    // The demo's photos stand on one side, so the turn goes to and fro and never looks from the other one.
    let ahead = [start, aside].map(|navigator| navigator.world_from_view.z_axis.reject_from(start.up).normalize());
    let turned = ahead[0].dot(ahead[1]);
    assert!((0.1..0.95).contains(&turned), "a quarter of the path later it has turned: {turned}");
    window.get_by_label("Clear").click();
    window.run_steps(2);
    std::fs::write(&file, serde_json::to_string(&shortened(&file)).unwrap()).unwrap();
    window.get_by_label("Load").click();
    settle(&mut window);
    assert_eq!(window.state().keyframes(), 4, "{:?}", window.state().error());

    window.get_by_label("Render film").click();
    until(&mut window, "filmed", |viewer| viewer.message().is_some_and(|text| text.contains("frames in")));
    for (index, there) in [(0, true), (2, true), (3, false)] {
        let path = folder.path().join(format!("film-1/{index:05}.png"));
        assert_eq!(path.exists(), there, "{}", path.display());
    }
    let frame = image::open(folder.path().join("film-1/00001.png")).unwrap();
    assert_eq!((frame.width(), frame.height()), (64, 48));
    // A path that is none changes nothing.
    std::fs::write(&file, "{}").unwrap();
    window.get_by_label("Load").click();
    window.run_steps(2);
    assert!(window.state().error().unwrap().contains("path.json"));
    assert_eq!(window.state().keyframes(), 4);
}

/// The saved path with three small frames.
fn shortened(file: &Path) -> serde_json::Value {
    let mut path: serde_json::Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
    for (field, value) in [("render_width", 64.0), ("render_height", 48.0), ("fps", 3.0), ("seconds", 1.0)] {
        path[field] = if field.starts_with("render") { (value as u32).into() } else { value.into() };
    }
    path
}

/// A window with keyframes at three views, each with its picture.
fn with_keyframes(folder: &Path) -> Window {
    let mut window = coarse(plain(folder));
    add_keyframes(&mut window);
    window.run_steps(20);
    window
}

fn saved(window: &mut Window, folder: &Path) -> KeyframePath {
    let file = folder.join("path.json");
    window.state_mut().set_path_file(&file);
    window.run_steps(2);
    window.get_by_label("Save").click();
    window.run_steps(2);
    KeyframePath::load(&file).unwrap()
}

#[test]
fn keyframes_are_dragged_to_another_place_in_the_timeline() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = with_keyframes(folder.path());
    let before = saved(&mut window, folder.path());
    assert_eq!((before.seconds, before.time_of(2)), (4.0, 4.0));
    let middle = |window: &Window, label: &str| window.get_by_label(label).rect().center();
    let from = middle(&window, "1");
    let to = middle(&window, "3") + Vec2::new(30.0, 0.0);
    drag(&mut window, PointerButton::Primary, from, to - from);
    let after = saved(&mut window, folder.path());
    let places = |path: &KeyframePath| path.keyframes.iter().map(|key| key.position).collect::<Vec<_>>();
    let [a, b, c] = places(&before)[..] else { panic!("three keyframes") };
    let expected = [b, c, a];
    assert!(places(&after).iter().zip(expected).all(|(found, place)| found.abs_diff_eq(place, 1e-9)));
    assert_eq!(after.seconds, 4.0, "each way keeps its time");
    // A click goes there, and what stands there can be removed.
    window.get_by_label("2").click();
    settle(&mut window);
    let there = window.state().navigator().position;
    assert!(there.abs_diff_eq(c, 1e-6), "{there} is not {c}; {a}, {b}");
    window.get_by_label("Remove").click();
    window.run_steps(2);
    let rest = saved(&mut window, folder.path());
    assert!(places(&rest).iter().zip([b, a]).all(|(found, place)| found.abs_diff_eq(place, 1e-9)));
    assert_eq!((rest.seconds, window.state().error()), (2.0, None));
}

#[test]
fn a_path_is_played_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = with_keyframes(folder.path());
    // Times between the slider's own steps stay as they are, and so do ways that are shorter than can be typed.
    let saved_path = KeyframePath { seconds: 0.1 / 3.0, ..saved(&mut window, folder.path()) };
    saved_path.save(&folder.path().join("path.json")).unwrap();
    window.get_by_label("Load").click();
    settle(&mut window);
    assert!((saved(&mut window, folder.path()).seconds - 0.1 / 3.0).abs() < 1e-12);
    window.get_by_label("2").click();
    settle(&mut window);
    window.get_by_label("keyframe 2:");
    let path = KeyframePath { seconds: 2.0, ..saved_path };
    path.save(&folder.path().join("path.json")).unwrap();
    window.get_by_label("Load").click();
    settle(&mut window);
    window.get_by_label("Play").click();
    let end = path.keyframes[2].position;
    until(&mut window, "at its end", |viewer| viewer.navigator().position.abs_diff_eq(end, 1e-9));
    settle(&mut window);
    window.get_by_label("Play");
}

#[test]
fn a_path_is_closed_and_eased() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = with_keyframes(folder.path());
    window.get_by_label("ease in and out").click();
    window.run_steps(2);
    assert!(saved(&mut window, folder.path()).eased);
    window.get_by_label("closed loop").click();
    window.run_steps(2);
    window.get_by_label("to 1");
    let path = saved(&mut window, folder.path());
    assert!(path.cycle);
    assert_eq!(path.seconds, 6.0, "the way back takes its time");
}

#[test]
fn a_still_has_the_size_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = with_keyframes(folder.path());
    let path = KeyframePath { width: 90, height: 40, ..saved(&mut window, folder.path()) };
    path.save(&folder.path().join("path.json")).unwrap();
    window.get_by_label("Load").click();
    settle(&mut window);
    for number in [1, 2] {
        window.get_by_label("Render still").click();
        let name = format!("still-{number}.png");
        until(&mut window, "written", |viewer| viewer.message().is_some_and(|text| text.contains(&name)));
        let still = image::open(folder.path().join(name)).unwrap();
        assert_eq!((still.width(), still.height()), (90, 40));
    }
}
