//! Steps of the editor, and what the tests of its parts share.

use super::*;
use crate::camera::Camera;
use crate::local_space::LocalSpace;
use glam::{DMat3, DVec2, DVec3};

/// A row of Gaussians along x that differ in every field.
fn row(count: usize) -> Arc<Gaussians> {
    let at = |i: usize| i as f32;
    let values = |of: fn(f32) -> f32| (0..count).map(move |i| of(at(i)));
    Arc::new(Gaussians {
        means: values(|x| x).map(|x| [x, 0.0, 0.0]).collect(),
        rotations: values(|x| x + 1.0).map(|w| [w, 0.0, 0.0, 0.5]).collect(),
        log_scales: values(|x| -x).map(|s| [s, s - 1.0, s - 2.0]).collect(),
        opacity_logits: values(|x| x - 3.0).collect(),
        sh: values(|x| x).flat_map(|x| (0..12).map(move |c| x * 100.0 + c as f32)).collect(),
        sh_degree: 1,
        normals: values(|x| x).map(|x| [0.0, x, 1.0]).collect(),
        offsets: values(|x| x * 0.5).collect(),
        ..Gaussians::default()
    })
}

fn of(count: usize, chosen: &[usize]) -> Mask {
    Mask::of(count, |i| chosen.contains(&i))
}

fn list(mask: &Mask) -> Vec<usize> {
    mask.iter().collect()
}

/// A grid of points with a distance of 1 around the origin of the scene, in local units of 2 around (5, 0, 0).
pub(super) fn grid() -> Gaussians {
    let space = LocalSpace { origin: DVec3::new(5.0, 0.0, 0.0), scale: 2.0 };
    let side = || (-3..=3).map(f64::from);
    let points = side().flat_map(|x| side().flat_map(move |y| side().map(move |z| DVec3::new(x, y, z))));
    let means: Vec<[f32; 3]> = points.map(|point| space.to_local(point).as_vec3().to_array()).collect();
    let count = means.len();
    Gaussians {
        space,
        log_scales: (0..count).map(|i| [-9.0, (0.01 * (i + 1) as f32).ln(), -8.0]).collect(),
        opacity_logits: (0..count).map(|i| (i as f32 - 171.0) * 0.05).collect(),
        means,
        ..Gaussians::default()
    }
}

pub(super) fn camera() -> Camera {
    Camera {
        width: 100,
        height: 80,
        focal: DVec2::splat(100.0),
        principal: DVec2::new(50.0, 40.0),
        view_from_world: DMat3::IDENTITY,
        translation: DVec3::new(0.0, 0.0, 10.0),
    }
}

#[test]
fn every_field_of_the_kept_gaussians_stays_as_it_is() {
    let whole = row(70);
    let kept = of(70, &[0, 3, 64, 69]).of_model(&whole);
    kept.validate().unwrap();
    assert_eq!(kept.len(), 4);
    for (now, before) in [(0, 0), (1, 3), (2, 64), (3, 69)] {
        assert_eq!(kept.row(now), whole.row(before));
    }
    assert_eq!(Mask::all(70).of_model(&whole), *whole);
}

#[test]
fn selections_combine_and_forget_what_was_removed() {
    let mut editor = Editor::new(row(6));
    editor.select(&of(6, &[0, 1, 2]), Combine::Replace);
    editor.select(&of(6, &[2, 3]), Combine::Add);
    assert_eq!(list(editor.selected()), [0, 1, 2, 3]);
    editor.select(&of(6, &[1, 5]), Combine::Remove);
    assert_eq!((list(editor.selected()), editor.selected_count()), (vec![0, 2, 3], 3));
    editor.invert();
    assert_eq!(list(editor.selected()), [1, 4, 5]);
    assert!(editor.delete());
    assert_eq!((list(editor.left()), editor.left_count(), editor.selected_count()), (vec![0, 2, 3], 3, 0));
    editor.select(&of(6, &[0, 1]), Combine::Replace);
    assert_eq!(list(editor.selected()), [0], "1 was removed");
    editor.select_all();
    assert_eq!(list(editor.selected()), [0, 2, 3]);
    assert!(!editor.delete() && !editor.keep(), "one Gaussian stays, and keeping all is no change");
    editor.select_none();
    assert!(!editor.delete() && !editor.keep());
    editor.select(&of(6, &[3]), Combine::Replace);
    assert!(editor.keep() && list(editor.left()) == [3]);
}

#[test]
fn steps_are_undone_and_redone() {
    let mut editor = Editor::new(row(4));
    editor.undo();
    editor.redo();
    assert!(!editor.can_undo() && !editor.can_redo());
    editor.select(&of(4, &[1]), Combine::Replace);
    editor.delete();
    editor.select(&of(4, &[2]), Combine::Replace);
    editor.undo();
    assert_eq!((list(editor.left()), list(editor.selected())), (vec![0, 2, 3], vec![]));
    editor.undo();
    assert_eq!((list(editor.left()), list(editor.selected())), (vec![0, 1, 2, 3], vec![1]));
    editor.redo();
    assert!(list(editor.left()) == [0, 2, 3] && editor.can_redo());
    editor.select(&of(4, &[3]), Combine::Replace);
    assert!(!editor.can_redo(), "a new step ends what could be redone");
    // A step without a change is dropped, so a stroke beside the model needs no undo.
    let steps = editor.undo.len();
    editor.begin();
    editor.change(&Mask::none(4), Combine::Add);
    editor.end();
    assert_eq!(editor.undo.len(), steps);
    // A stroke is one step.
    editor.begin();
    editor.change(&of(4, &[0]), Combine::Add);
    editor.change(&of(4, &[2]), Combine::Add);
    editor.end();
    assert_eq!(list(editor.selected()), [0, 2, 3]);
    editor.undo();
    assert_eq!(list(editor.selected()), [3]);
}

#[test]
fn the_memory_of_steps_is_bounded() {
    let mut editor = Editor::new(row(3));
    for step in 0..1000 {
        editor.select(&of(3, &[step % 3]), Combine::Replace);
    }
    assert_eq!(editor.undo.len(), MOST_STEPS);
    while editor.can_undo() {
        editor.undo();
    }
    assert_eq!(editor.redo.len(), MOST_STEPS);
}

#[test]
fn hidden_and_locked_gaussians_stay_as_they_are() {
    let mut editor = Editor::new(row(6));
    editor.select(&of(6, &[0, 1]), Combine::Replace);
    assert!(editor.hide() && !editor.lock(), "what is hidden is selected no more");
    assert_eq!((list(editor.shown()), editor.hidden_count(), editor.selected_count()), (vec![2, 3, 4, 5], 2, 0));
    editor.select(&of(6, &[5]), Combine::Replace);
    assert!(editor.lock());
    assert_eq!((list(editor.shown()), editor.locked_count()), (vec![2, 3, 4, 5], 1));
    // Neither can be selected.
    editor.select_all();
    assert_eq!(list(editor.selected()), [2, 3, 4]);
    editor.select(&of(6, &[1, 2, 5]), Combine::Replace);
    assert_eq!(list(editor.selected()), [2]);
    editor.invert();
    assert_eq!(list(editor.selected()), [3, 4]);
    // Nor does what is not selected go with the rest.
    assert!(editor.keep());
    assert_eq!(list(editor.left()), [0, 1, 3, 4, 5]);
    assert!(editor.crop(&of(6, &[3])));
    assert_eq!(list(editor.left()), [0, 1, 3, 5]);
    assert!(!editor.crop(&of(6, &[3])), "nothing is left beside it");
    assert!(editor.show_all() && !editor.show_all() && editor.unlock_all() && !editor.unlock_all());
    assert_eq!((list(editor.shown()), editor.hidden_count(), editor.locked_count()), (vec![0, 1, 3, 5], 0, 0));
    // Each was a step.
    for _ in 0..2 {
        editor.undo();
    }
    assert_eq!((list(editor.shown()), editor.locked_count()), (vec![3, 5], 1));
    // The last Gaussian that is seen is not hidden.
    editor.select_all();
    assert!(editor.hide());
    editor.unlock_all();
    editor.select_all();
    assert!(!editor.hide() && editor.selected_count() == 1);
}

#[test]
fn selections_intersect() {
    let mut editor = Editor::new(row(6));
    editor.select(&of(6, &[0, 1, 2]), Combine::Replace);
    editor.select(&of(6, &[2, 3]), Combine::Intersect);
    assert_eq!(list(editor.selected()), [2]);
}

#[test]
fn placing_is_a_step() {
    let mut editor = Editor::new(row(4));
    let wider = Similarity { scale: 2.0, ..Similarity::IDENTITY };
    editor.place(wider);
    assert_eq!(*editor.placement(), wider);
    for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        editor.place(Similarity { scale: wrong, ..wider });
    }
    assert_eq!(*editor.placement(), wider);
    editor.undo();
    assert!(*editor.placement() == Similarity::IDENTITY && !editor.can_undo());
    editor.redo();
    assert_eq!(*editor.placement(), wider);
}
