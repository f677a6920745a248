//! The keys: one table that handles them and that the help of the window shows.

use crate::IN_BROWSER;
use crate::dialogs::Sought;
use crate::mode::Mode;
use crate::viewer::{Over, Viewer};
use eframe::egui::{Context, Key, KeyboardShortcut, ModifierNames, Modifiers, Popup, ViewportCommand};
use glam::DVec3;
use ibgs_core::edit::Editor;

/// Where a key counts.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scope {
    /// Everywhere, also while something is typed.
    Window,
    /// Over the picture and the start page.
    Page,
    /// Over the picture.
    Picture,
    /// Over the picture, for what a browser does not have.
    Files,
    /// In the open editor.
    Editor,
}

/// A key and what it does.
struct Row {
    modifiers: Modifiers,
    key: Key,
    scope: Scope,
    /// In the help; rows that follow each other with the same text are one.
    what: &'static str,
    /// Otherwise the key is left to others.
    when: fn(&Viewer) -> bool,
    act: fn(&mut Viewer, &Context),
}

const fn row(scope: Scope, modifiers: Modifiers, key: Key, what: &'static str, act: fn(&mut Viewer, &Context)) -> Row {
    Row { modifiers, key, scope, what, when: |_| true, act }
}

/// A step of the editor.
macro_rules! step {
    ($modifiers:expr, $key:ident, $what:expr, $step:expr) => {
        row(Scope::Editor, $modifiers, Key::$key, $what, |viewer, _| viewer.edit.step($step))
    };
}

const NONE: Modifiers = Modifiers::NONE;
const CTRL: Modifiers = Modifiers::COMMAND;
const SHIFT: Modifiers = Modifiers::SHIFT;
const CTRL_SHIFT: Modifiers = CTRL.plus(SHIFT);

/// The keys. Of one key those with more modifiers come first, as the others would take them too.
static TABLE: [Row; 27] = [
    row(Scope::Window, CTRL_SHIFT, Key::O, "opens a model folder", |viewer, ctx| {
        viewer.start.dialog.open(Sought::ModelFolder, ctx);
    }),
    row(Scope::Window, CTRL, Key::O, "opens a bundle or a file of Gaussians", |viewer, ctx| {
        viewer.start.dialog.open(Sought::ModelFile, ctx);
    }),
    Row {
        when: |viewer| !viewer.start.shown && viewer.edit.editor.is_some(),
        ..row(Scope::Window, CTRL, Key::S, "saves the edited model", |viewer, _| _ = viewer.save_edited())
    },
    row(Scope::Window, NONE, Key::F11, "shows the window on the full screen, and no more", |_, ctx| full_screen(ctx)),
    row(
        Scope::Picture,
        NONE,
        Key::F,
        "turns to the surface under the pointer and orbits it from then on",
        |viewer, _| {
            viewer.focuses = true;
        },
    ),
    row(Scope::Picture, NONE, Key::ArrowLeft, "stands on the previous view, on the next view", |viewer, _| {
        viewer.step_view(-1);
    }),
    row(Scope::Picture, NONE, Key::ArrowRight, "stands on the previous view, on the next view", |viewer, _| {
        viewer.step_view(1);
    }),
    row(Scope::Picture, NONE, Key::R, "goes back to the first view", |viewer, _| viewer.reset()),
    row(Scope::Picture, NONE, Key::C, "shows the scene's cameras", |viewer, _| {
        viewer.panels.shows_cameras = !viewer.panels.shows_cameras;
    }),
    row(Scope::Files, NONE, Key::K, "adds a keyframe to the camera path", |viewer, _| viewer.add_keyframe()),
    row(Scope::Files, NONE, Key::Space, "plays the camera path", |viewer, _| viewer.panels.path.toggle()),
    row(Scope::Files, NONE, Key::P, "writes a screenshot into the model folder", |viewer, _| viewer.screenshot()),
    Row {
        when: |viewer| viewer.training.is_none(),
        ..row(Scope::Files, NONE, Key::X, "opens and closes the editor", |viewer, _| {
            viewer.show_editor(!viewer.edit.shown);
        })
    },
    step!(CTRL, A, "selects all", Editor::select_all),
    step!(CTRL, I, "selects the others", Editor::invert),
    step!(NONE, Delete, "deletes the selected Gaussians", |editor| _ = editor.delete()),
    step!(SHIFT, H, "shows all that is hidden", |editor| _ = editor.show_all()),
    step!(NONE, H, "hides the selected Gaussians", |editor| _ = editor.hide()),
    step!(SHIFT, L, "unlocks all", |editor| _ = editor.unlock_all()),
    step!(NONE, L, "locks the selected Gaussians", |editor| _ = editor.lock()),
    step!(CTRL_SHIFT, Z, "redoes a step of the editor", Editor::redo),
    step!(CTRL, Y, "redoes a step of the editor", Editor::redo),
    step!(CTRL, Z, "undoes a step of the editor", Editor::undo),
    Row {
        when: |viewer| viewer.edit.can_close_polygon(),
        ..row(Scope::Editor, NONE, Key::Enter, "ends the polygon", |viewer, _| viewer.edit.ends_polygon = true)
    },
    Row {
        when: |viewer| {
            viewer.panels.over.is_none() && viewer.edit.escapes(viewer.found.is_some() || viewer.other.is_some())
        },
        ..row(
            Scope::Editor,
            NONE,
            Key::Escape,
            "gives up the polygon, puts the tool down, selects nothing",
            |viewer, _| {
                viewer.edit.escape();
            },
        )
    },
    Row {
        when: |viewer| {
            let below = !viewer.start.shown && (viewer.found.is_some() || viewer.other.is_some());
            viewer.panels.over.is_some() || below
        },
        ..row(
            Scope::Page,
            NONE,
            Key::Escape,
            "closes what covers the picture, then the pixel and the split",
            |viewer, _| {
                if viewer.panels.over.take().is_none() {
                    (viewer.found, viewer.other) = (None, None);
                }
            },
        )
    },
    row(Scope::Picture, NONE, Key::F1, "shows keys and pointer", |viewer, _| {
        viewer.panels.put_over(Over::Help, viewer.panels.over != Some(Over::Help));
    }),
];

/// Keys that fly, with their direction: right, down, forward.
const FLY: [(Key, DVec3); 6] = [
    (Key::W, DVec3::Z),
    (Key::A, DVec3::NEG_X),
    (Key::S, DVec3::NEG_Z),
    (Key::D, DVec3::X),
    (Key::Q, DVec3::Y),
    (Key::E, DVec3::NEG_Y),
];

/// Keys that a button or a slider has to itself once Tab has chosen it.
const OF_FOCUSED: [Key; 4] = [Key::Space, Key::Enter, Key::ArrowLeft, Key::ArrowRight];

/// What the pointer does.
const POINTER: [(&str, &str); 6] = [
    ("left drag", "orbits around the point in the middle; with a tool of the editor it is the tool's"),
    ("right drag, middle drag", "looks around, moves sideways"),
    ("wheel", "goes nearer or farther"),
    ("click", "explains the colour of the pixel"),
    ("double click", "turns to the surface under the pointer and orbits it from then on"),
    (
        "Shift, Ctrl or Alt with a tool",
        "adds to the selection, takes away from it; Shift and Ctrl leave what is common",
    ),
];

/// All keys and the pointer, with what they do.
pub fn help() -> Vec<(String, &'static str)> {
    let names: Vec<&str> = FLY.iter().map(|(key, _)| key.name()).collect();
    let fly = (names.join(" "), "flies; Q and E go down and up, with Shift faster");
    let modes: Vec<Key> = Mode::ALL.into_iter().filter_map(Mode::key).collect();
    let modes = (format!("{} to {}", modes[0].name(), modes[modes.len() - 1].name()), "chooses what is shown");
    let pointer = POINTER.map(|(pointer, what)| (pointer.to_owned(), what));
    let named =
        |modifiers, key| KeyboardShortcut::new(modifiers, key).format(&ModifierNames::NAMES, cfg!(target_os = "macos"));
    let mut all: Vec<_> = pointer.into_iter().chain([fly, modes]).collect();
    if !IN_BROWSER {
        // Keys of egui's own.
        let sizes = [Key::Plus, Key::Minus, Key::Num0].map(|key| named(CTRL, key)).join(", ");
        all.extend([
            (named(CTRL, Key::Q), "closes the window"),
            (sizes, "text and panels larger, smaller, as at first"),
        ]);
    }
    let mut last = "";
    for Row { modifiers, key, what, scope, .. } in &TABLE {
        if IN_BROWSER && !matches!(scope, Scope::Page | Scope::Picture) {
            continue;
        }
        let name = named(*modifiers, *key);
        match all.last_mut().filter(|_| last == *what) {
            Some((names, _)) => *names += &format!(", {name}"),
            None => all.push((name, what)),
        }
        last = what;
    }
    all
}

/// Whether the window has the full screen.
pub fn is_full_screen(ctx: &Context) -> bool {
    ctx.input(|input| input.viewport().fullscreen).unwrap_or(false)
}

/// Gives the window the full screen, or takes it back.
pub fn full_screen(ctx: &Context) {
    ctx.send_viewport_cmd(ViewportCommand::Fullscreen(!is_full_screen(ctx)));
}

/// Takes the keys that were pressed, so that they do nothing else.
pub fn keys(viewer: &mut Viewer, ctx: &Context) {
    let (over_page, over_picture) = (viewer.is_free(ctx), viewer.takes_keys(ctx));
    let has_focus = ctx.egui_wants_keyboard_input();
    if viewer.leaving.is_some() || ctx.input(|input| input.modifiers.alt) {
        return;
    }
    for row in &TABLE {
        let counts = match row.scope {
            Scope::Window => !IN_BROWSER,
            Scope::Page => over_page,
            Scope::Picture => over_picture,
            Scope::Files => over_picture && !IN_BROWSER,
            Scope::Editor => over_picture && viewer.edit.shown && viewer.training.is_none(),
        };
        if counts
            && !(has_focus && OF_FOCUSED.contains(&row.key))
            && (row.when)(viewer)
            && ctx.input_mut(|input| input.consume_key(row.modifiers, row.key))
        {
            (row.act)(viewer, ctx);
        }
    }
    if !over_picture {
        return;
    }
    for mode in Mode::ALL {
        if mode.key().is_some_and(|key| ctx.input_mut(|input| input.consume_key(NONE, key))) {
            viewer.show_mode(mode);
        }
    }
}

/// Where the keys that are held fly to, in the axes of the view; with Shift faster.
pub fn flight(ctx: &Context) -> DVec3 {
    ctx.input(|input| {
        let held = input.modifiers;
        if held.command || held.ctrl || held.alt {
            return DVec3::ZERO;
        }
        let ways = FLY.iter().filter(|(key, _)| input.key_down(*key)).map(|(_, way)| *way);
        ways.sum::<DVec3>() * if held.shift { 4.0 } else { 1.0 }
    })
}

impl Viewer {
    /// Whether keys are for the picture: it is shown, and the window is free.
    pub(crate) fn takes_keys(&self, ctx: &Context) -> bool {
        !self.start.shown && self.scene.is_some() && self.is_free(ctx)
    }

    /// Whether nothing is asked or typed, and no menu is open.
    fn is_free(&self, ctx: &Context) -> bool {
        self.leaving.is_none() && !ctx.text_edit_focused() && !Popup::is_any_open(ctx)
    }

    /// Adds a keyframe where the camera is, and says so where its timeline is not shown.
    fn add_keyframe(&mut self) {
        self.panels.path.add(&self.navigator);
        if !self.panels.shows_path {
            let number = self.keyframes();
            self.message = Some(format!("keyframe {number} added to the camera path, which `Film` opens"));
        }
    }

    /// Begins to save what is left of an edited model, where there is one.
    pub(crate) fn save_edited(&mut self) -> bool {
        let Some(command) = self.scene.as_ref().and_then(|scene| self.edit.save(scene)) else { return false };
        self.error = None;
        self.doing = Some("saving the model".to_owned());
        self.send(command);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_hides_another_one() {
        for (index, row) in TABLE.iter().enumerate() {
            for later in &TABLE[index + 1..] {
                let same = row.key == later.key && row.scope == later.scope;
                assert!(!(same && later.modifiers.matches_logically(row.modifiers)), "{}, {}", row.what, later.what);
            }
            assert!(!FLY.iter().any(|(key, _)| *key == row.key && row.modifiers == NONE), "{}", row.what);
            assert!(!Mode::ALL.iter().any(|mode| mode.key() == Some(row.key)), "{}", row.what);
        }
    }

    #[test]
    fn the_manual_lists_every_key() {
        let manual = include_str!("../../../docs/viewer.md");
        let missing: Vec<String> = help()
            .iter()
            .map(|(keys, what)| format!("| {keys} | {what} |\n"))
            .filter(|row| !manual.contains(row.as_str()))
            .collect();
        assert!(missing.is_empty(), "docs/viewer.md lacks\n{}", missing.concat());
    }
}
