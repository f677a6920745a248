//! The editor's keys.

use crate::viewer::Viewer;
use eframe::egui::{Context, InputState, Key, Modifiers};
use ibgs_core::edit::{Combine, Editor};

/// Modifiers, a key, and the step that they take.
type Step = (Modifiers, Key, fn(&mut Editor));

/// Keys that take a step of the editor. Those with more modifiers come first, as the others would take them too.
const STEPS: [Step; 10] = [
    (Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z, Editor::redo),
    (Modifiers::COMMAND, Key::Y, Editor::redo),
    (Modifiers::COMMAND, Key::Z, Editor::undo),
    (Modifiers::COMMAND, Key::A, Editor::select_all),
    (Modifiers::COMMAND, Key::I, Editor::invert),
    (Modifiers::NONE, Key::Delete, |editor| _ = editor.delete()),
    (Modifiers::SHIFT, Key::H, |editor| _ = editor.show_all()),
    (Modifiers::NONE, Key::H, |editor| _ = editor.hide()),
    (Modifiers::SHIFT, Key::L, |editor| _ = editor.unlock_all()),
    (Modifiers::NONE, Key::L, |editor| _ = editor.lock()),
];

/// Takes the editor's keys, so that they do nothing else.
pub fn keys(viewer: &mut Viewer, ctx: &Context) {
    if viewer.scene.is_none() || viewer.training.is_some() {
        return;
    }
    let pressed = |modifiers, key| ctx.input_mut(|input| input.consume_key(modifiers, key));
    if pressed(Modifiers::NONE, Key::X) {
        viewer.show_editor(!viewer.edit.shown);
    }
    if !viewer.edit.shown {
        return;
    }
    for (modifiers, key, step) in STEPS {
        if pressed(modifiers, key) {
            viewer.edit.step(step);
        }
    }
    escape(viewer, || pressed(Modifiers::NONE, Key::Escape));
}

/// Escape gives up the outline, then puts the tool down, then selects nothing; what is left to leave is the window's.
fn escape(viewer: &mut Viewer, pressed: impl Fn() -> bool) {
    let edit = &mut viewer.edit;
    let selects = edit.editor.as_ref().is_some_and(|editor| editor.selected_count() > 0);
    let (draws, shows) = (!edit.polygon.is_empty(), viewer.found.is_some() || viewer.other.is_some());
    if !draws && edit.tool.is_none() && (!selects || shows) || !pressed() {
        return;
    }
    edit.lift();
    if draws {
        edit.polygon.clear();
    } else if edit.tool.is_none() {
        edit.step(Editor::select_none);
    } else {
        edit.tool = None;
    }
}

/// How a selection counts: by the keys that are held, else as the panel says.
pub fn how(input: &InputState, usual: Combine) -> Combine {
    let removes = input.modifiers.ctrl || input.modifiers.command || input.modifiers.alt;
    match (input.modifiers.shift, removes) {
        (true, true) => Combine::Intersect,
        (true, false) => Combine::Add,
        (false, true) => Combine::Remove,
        (false, false) => usual,
    }
}
