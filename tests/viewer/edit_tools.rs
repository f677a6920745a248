//! Each tool of the editor, driven by pointer and keys.

use super::edit::{canvas, click_on, command, counts, editing, pick};
use super::*;
use egui_kittest::kittest::Queryable;

/// A place of the model in the image, and a step from there to another.
const AT: Pos2 = Pos2::new(430.0, 430.0);
const STEP: Vec2 = Vec2::new(90.0, 60.0);

fn editor() -> (tempfile::TempDir, Window) {
    let folder = tempfile::tempdir().unwrap();
    let window = editing(plain(folder.path()));
    (folder, window)
}

fn selected(window: &Window) -> usize {
    counts(window)[1]
}

/// Drags while keys are held.
fn drag_with(window: &mut Window, held: Modifiers, from: Pos2, by: Vec2) {
    window.event(Event::ModifiersChanged(held));
    drag(window, PointerButton::Primary, from, by);
    window.event(Event::ModifiersChanged(Modifiers::NONE));
    window.step();
}

/// Drags over a way of several places.
fn draw(window: &mut Window, places: &[Pos2]) {
    button(window, places[0], PointerButton::Primary, true);
    for place in &places[1..] {
        window.event(Event::PointerMoved(*place));
        window.step();
    }
    button(window, places[places.len() - 1], PointerButton::Primary, false);
    settle(window);
}

#[test]
fn a_rectangle_selects_and_keys_add_and_take_away() {
    let (_folder, mut window) = editor();
    pick(&mut window, "Rectangle");
    let stood = *window.state().navigator();
    drag(&mut window, PointerButton::Primary, AT, STEP);
    let first = selected(&window);
    assert!(first > 0 && first < 4_000, "{first}");
    // The other way round it is the same rectangle.
    drag(&mut window, PointerButton::Primary, AT + STEP, -STEP);
    assert_eq!(selected(&window), first);
    let beside = AT + Vec2::new(-120.0, 0.0);
    drag_with(&mut window, Modifiers::SHIFT, beside, STEP);
    let both = selected(&window);
    assert!(both > first);
    for held in [Modifiers::CTRL, Modifiers::ALT] {
        drag_with(&mut window, held, beside, STEP);
        assert!(selected(&window) <= first, "{held:?}");
        command(&mut window, Modifiers::COMMAND, Key::Z);
        assert_eq!(selected(&window), both, "{held:?}");
    }
    drag_with(&mut window, Modifiers::SHIFT | Modifiers::CTRL, AT, STEP);
    assert_eq!(selected(&window), first, "what both have in common");
    // What is behind the surface can be left out.
    pick(&mut window, "Only in front");
    drag(&mut window, PointerButton::Primary, AT, STEP);
    let front = selected(&window);
    assert!(front > 0 && front < first, "{front} {first}");
    assert_eq!(*window.state().navigator(), stood, "selecting moves no camera");
    assert_eq!(window.state().error(), None);
}

#[test]
fn all_none_and_the_others_by_keys() {
    let (_folder, mut window) = editor();
    command(&mut window, Modifiers::COMMAND, Key::A);
    assert_eq!(counts(&window), [4_000; 2]);
    command(&mut window, Modifiers::COMMAND, Key::I);
    assert_eq!(selected(&window), 0);
    pick(&mut window, "Rectangle");
    drag(&mut window, PointerButton::Primary, AT, STEP);
    let some = selected(&window);
    command(&mut window, Modifiers::COMMAND, Key::I);
    assert_eq!(selected(&window), 4_000 - some);
    // The tool goes first, then the selection.
    press(&mut window, Key::Escape);
    assert_eq!(selected(&window), 4_000 - some);
    press(&mut window, Key::Escape);
    assert_eq!(selected(&window), 0);
    command(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!(selected(&window), 4_000 - some);
    command(&mut window, Modifiers::COMMAND, Key::Y);
    assert_eq!(selected(&window), 0);
}

/// As where frames are slow, or a touchpad is tapped.
#[test]
fn a_click_within_a_frame_is_the_tools() {
    let (_folder, mut window) = editor();
    let quick_click = |window: &mut Window, at: Pos2| {
        window.event(Event::PointerMoved(at));
        for pressed in [true, false] {
            let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
            window.event(Event::PointerButton { pos: at, button, pressed, modifiers });
        }
        settle(window);
    };
    for tool in ["Colour", "Flood"] {
        pick(&mut window, tool);
        quick_click(&mut window, AT);
        assert!(selected(&window) > 0, "{tool}: {:?}", window.state().error());
        pick(&mut window, "None");
    }
    pick(&mut window, "Polygon");
    for way in [Vec2::ZERO, Vec2::new(120.0, 10.0), Vec2::new(60.0, 100.0), Vec2::ZERO] {
        quick_click(&mut window, AT + way);
    }
    assert!(selected(&window) > 0, "the polygon is closed by a click on its first corner");
    assert!(window.state().inspection().is_none());
}

#[test]
fn a_lasso_and_a_polygon_around_the_same_select_the_same() {
    let (_folder, mut window) = editor();
    let corners = [Vec2::ZERO, Vec2::new(120.0, 10.0), Vec2::new(60.0, 100.0)].map(|way| AT + way);
    pick(&mut window, "Lasso");
    draw(&mut window, &corners);
    let inside = selected(&window);
    assert!(inside > 0 && inside < 4_000, "{inside}");
    press(&mut window, Key::Escape);
    press(&mut window, Key::Escape);
    // By Enter, by a click on the first corner, and by a second one on the last.
    pick(&mut window, "Polygon");
    corners.iter().for_each(|&corner| click_on(&mut window, corner));
    assert_eq!(selected(&window), 0, "it is not closed yet");
    press(&mut window, Key::Enter);
    assert_eq!(selected(&window), inside);
    pick(&mut window, "None");
    corners.iter().for_each(|&corner| click_on(&mut window, corner));
    click_on(&mut window, corners[0] + Vec2::new(2.0, 1.0));
    assert_eq!(selected(&window), inside);
    pick(&mut window, "None");
    corners.iter().for_each(|&corner| click_on(&mut window, corner));
    click_on(&mut window, corners[2]);
    assert_eq!(selected(&window), inside, "a double click");
    // Escape gives up an outline, and no more than that.
    corners.iter().for_each(|&corner| click_on(&mut window, corner));
    press(&mut window, Key::Escape);
    press(&mut window, Key::Enter);
    assert_eq!(selected(&window), inside);
    assert!(window.state().inspection().is_none() && window.state().error().is_none());
}

#[test]
fn a_sphere_grows_as_it_is_dragged() {
    let (_folder, mut window) = editor();
    pick(&mut window, "Sphere");
    let mut sizes = Vec::new();
    for way in [20.0, 60.0, 160.0] {
        drag(&mut window, PointerButton::Primary, AT, Vec2::new(way, 0.0));
        sizes.push(selected(&window));
    }
    assert!(sizes[0] < sizes[1] && sizes[1] < sizes[2] && sizes[2] < 4_000, "{sizes:?}");
    assert_eq!(window.state().error(), None);
}

#[test]
fn colour_and_flood_begin_where_one_clicks() {
    let (_folder, mut window) = editor();
    pick(&mut window, "Colour");
    click_on(&mut window, AT);
    let alike = selected(&window);
    assert!(alike > 0 && alike < 4_000, "{alike}");
    pick(&mut window, "Flood");
    click_on(&mut window, AT);
    let connected = selected(&window);
    assert!(connected > 0, "{connected}");
    pick(&mut window, "Of one colour");
    click_on(&mut window, AT);
    assert!((1..=connected).contains(&selected(&window)));
    assert!(window.state().inspection().is_none() && window.state().error().is_none());
}

#[test]
fn what_is_selected_is_tinted_hidden_and_locked() {
    let (_folder, mut window) = editor();
    press(&mut window, Key::Num2);
    let plain = canvas(&mut window);
    command(&mut window, Modifiers::COMMAND, Key::A);
    let tinted = canvas(&mut window);
    let mean = |picture: &[[u8; 4]], channel: usize| {
        picture.iter().map(|pixel| f64::from(pixel[channel])).sum::<f64>() / picture.len() as f64
    };
    // Orange: more red, less blue.
    assert!(mean(&tinted, 0) > mean(&plain, 0) + 10.0, "{} {}", mean(&tinted, 0), mean(&plain, 0));
    assert!(mean(&tinted, 2) < mean(&plain, 2) - 10.0, "{} {}", mean(&tinted, 2), mean(&plain, 2));
    // No more than the editor shows it.
    press(&mut window, Key::X);
    press(&mut window, Key::X);
    assert!(canvas(&mut window) == tinted);
    command(&mut window, Modifiers::COMMAND, Key::I);
    assert!(canvas(&mut window) == plain);
    pick(&mut window, "Rectangle");
    drag(&mut window, PointerButton::Primary, AT, STEP);
    let some = selected(&window);
    press(&mut window, Key::H);
    assert_eq!((window.state().kept_from_edits(), counts(&window)), (Some([some, 0]), [4_000, 0]));
    assert!(canvas(&mut window) != plain, "what is hidden is seen");
    // Nor is it selected. Hiding is nothing to save.
    drag(&mut window, PointerButton::Primary, AT, STEP);
    assert_eq!(selected(&window), 0);
    command(&mut window, Modifiers::SHIFT, Key::H);
    assert!(canvas(&mut window) == plain);
    drag(&mut window, PointerButton::Primary, AT, STEP);
    press(&mut window, Key::L);
    assert_eq!(window.state().kept_from_edits(), Some([0, some]));
    command(&mut window, Modifiers::COMMAND, Key::A);
    press(&mut window, Key::Delete);
    assert_eq!(counts(&window), [some, 0], "what is locked stays");
    command(&mut window, Modifiers::SHIFT, Key::L);
    assert_eq!(window.state().kept_from_edits(), Some([0, 0]));
}

#[test]
fn a_range_of_values_is_chosen_in_a_histogram() {
    let (_folder, mut window) = editor();
    pick(&mut window, "By values");
    for (name, decides) in [("Distance", true), ("Size", true), ("Photos", true), ("Opacity", false)] {
        pick(&mut window, name);
        let start = Instant::now();
        while window.query_by_label("Histogram").is_none() {
            assert!(start.elapsed() < Duration::from_secs(60), "{name} has no histogram");
            window.step();
        }
        window.get_by_label("Histogram").scroll_to_me();
        window.run_steps(10);
        pick(&mut window, "Select by values");
        assert_eq!(selected(&window), 4_000, "{name}: the whole range is all");
        let room = window.get_by_label("Histogram").rect();
        drag(&mut window, PointerButton::Primary, room.center(), Vec2::new(room.width(), 0.0));
        pick(&mut window, "Select by values");
        let upper = selected(&window);
        assert_eq!((1..4_000).contains(&upper), decides, "{name}: {upper}");
    }
    assert_eq!(window.state().error(), None);
}

/// Looks at the error against the photos, once it is there.
fn error_histogram(window: &mut Window) {
    pick(window, "Error");
    until(window, "compared", |viewer| viewer.compares() == Some(false));
    window.step();
    window.get_by_label("Histogram").scroll_to_me();
    window.run_steps(10);
}

#[test]
fn what_is_far_from_the_photos_is_chosen_by_its_error() {
    let (_folder, mut window) = editor();
    pick(&mut window, "By values");
    error_histogram(&mut window);
    pick(&mut window, "Select by values");
    let all = selected(&window);
    assert!((1_000..4_000).contains(&all), "{all}: those that no photo sees have no error");
    let room = window.get_by_label("Histogram").rect();
    drag(&mut window, PointerButton::Primary, room.center(), Vec2::new(room.width(), 0.0));
    pick(&mut window, "Select by values");
    let upper = selected(&window);
    assert!((1..all).contains(&upper), "{upper} of {all}");
    // Those that are left are compared without the others, and what was deleted has no error.
    press(&mut window, Key::Delete);
    assert_eq!(counts(&window), [4_000 - upper, 0]);
    error_histogram(&mut window);
    pick(&mut window, "Select by values");
    let left = selected(&window);
    assert!((1..=4_000 - upper).contains(&left), "{left}");
    // Another value is looked at before the photos are compared with.
    window.get_by_label("Error").click();
    window.step();
    pick(&mut window, "Opacity");
    until(&mut window, "counted", |viewer| viewer.compares() == Some(false));
    window.get_by_label("Histogram");
    assert_eq!(window.state().error(), None);
}

#[test]
fn without_photos_there_is_no_error_to_choose_by() {
    let folder = tempfile::tempdir().unwrap();
    let mut opened = plain(folder.path());
    opened.scene.views.iter_mut().for_each(|view| view.photo = None);
    let mut window = editing(opened);
    pick(&mut window, "By values");
    pick(&mut window, "Error");
    window.get_by_label_contains("no photos to compare with");
    assert_eq!((window.query_by_label("Histogram").is_none(), window.state().error()), (true, None));
}

#[test]
fn what_a_tool_could_not_do_is_said_until_it_is_used_again() {
    let (_folder, mut window) = editor();
    pick(&mut window, "Colour");
    // Above the picture.
    click_on(&mut window, Pos2::new(430.0, 60.0));
    assert!(window.state().error().unwrap().starts_with("no surface there"));
    assert_eq!(selected(&window), 0);
    click_on(&mut window, Pos2::new(430.0, 430.0));
    assert_eq!((selected(&window) > 0, window.state().error()), (true, None));
}

/// While the camera flies, no picture has the depths of the view.
#[test]
fn a_brush_that_waits_for_depths_says_so() {
    let (_folder, mut window) = editor();
    pick(&mut window, "Brush");
    window.key_down(Key::E);
    window.step();
    button(&mut window, AT, PointerButton::Primary, true);
    let said = window.state().error().unwrap().to_owned();
    assert!(said.contains("wait until it is sharp, or switch `Only in front` off"), "{said}");
    button(&mut window, AT, PointerButton::Primary, false);
    window.key_up(Key::E);
    settle(&mut window);
    assert_eq!((selected(&window), window.state().error()), (0, Some(&*said)));
    drag(&mut window, PointerButton::Primary, AT, STEP);
    assert_eq!((selected(&window) > 0, window.state().error()), (true, None));
}

#[test]
fn floaters_are_previewed_and_removed() {
    let (_folder, mut window) = editor();
    pick(&mut window, "Floaters");
    window.get_by_label("Preview").scroll_to_me();
    window.run_steps(10);
    pick(&mut window, "Preview");
    let [left, floats] = counts(&window);
    assert!(left == 4_000 && floats > 0 && floats < 4_000, "{floats}");
    pick(&mut window, "Remove selected");
    assert_eq!(counts(&window), [4_000 - floats, 0]);
    command(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!(counts(&window), [4_000, floats]);
}

#[test]
fn the_box_crops() {
    let (_folder, mut window) = editor();
    pick(&mut window, "Box");
    pick(&mut window, "Inside");
    let inside = selected(&window);
    pick(&mut window, "None");
    pick(&mut window, "Crop");
    assert_eq!(counts(&window), [inside, 0]);
    command(&mut window, Modifiers::COMMAND, Key::Z);
    assert_eq!(counts(&window)[0], 4_000);
    // The button of the bar closes the editor as the key does.
    window.get_by_label("Edit").click();
    settle(&mut window);
    assert!(window.query_by_label("Edit the model").is_none());
}

/// What stands in the panel is neither cut off at its edge nor at that of the window.
#[test]
fn the_panel_keeps_all_in_a_small_window() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = coarse(plain(folder.path()));
    window.set_size(Vec2::new(620.0, 420.0));
    press(&mut window, Key::X);
    until(&mut window, "edited", |viewer| viewer.edited().is_some());
    settle(&mut window);
    for (section, last) in [("Floaters", "Remove selected"), ("Place and size", "As it was")] {
        window.get_by_label(section).scroll_to_me();
        window.run_steps(10);
        pick(&mut window, section);
        window.run_steps(10);
        let edge = window.get_by_label("Fold the panel").rect().right();
        for label in ["Edit the model", "Rectangle", section, last] {
            let room = window.get_by_label(label).rect();
            assert!(
                room.left() >= edge && room.right() <= 620.0,
                "{section}: {label} is at {room:?}, the panel at {edge}"
            );
        }
    }
}
