//! Where the camera stands and what is shown, as text for links.
//!
//! `mode=base&view=3`, or `at=X,Y,Z&turn=W,X,Y,Z&distance=D&fov=F`: the camera's centre, the quaternion that turns its axes
//! (right, down, forward) into the scene's, the distance of its pivot, and the vertical field of view in radians.

use super::Viewer;
use crate::mode::Mode;
use crate::navigator::Navigator;
use glam::{DMat3, DQuat, DVec3};

impl Viewer {
    /// Whether a picture of what is open has been rendered.
    pub fn has_picture(&self) -> bool {
        self.canvas.last().is_some()
    }

    /// Mode and camera as text; none while nothing is open.
    pub fn link(&self) -> Option<String> {
        self.scene.as_ref()?;
        let mode = self.mode.word();
        if let Some(view) = self.on_view {
            return Some(format!("mode={mode}&view={view}"));
        }
        let Navigator { position, world_from_view, distance, fov, .. } = self.navigator;
        // A hundred-thousandth of the scene.
        let decimals = (5.0 - self.extent.log10()).ceil().clamp(0.0, 17.0) as usize;
        let turn = DQuat::from_mat3(&world_from_view);
        let list = |values: &[f64], decimals: usize| {
            values.iter().map(|value| format!("{value:.decimals$}")).collect::<Vec<_>>().join(",")
        };
        let (at, turn) = (list(&position.to_array(), decimals), list(&[turn.w, turn.x, turn.y, turn.z], 6));
        Some(format!("mode={mode}&at={at}&turn={turn}&distance={}&fov={fov:.4}", list(&[distance], decimals)))
    }

    /// Goes where such a text says, once something is open. What it does not say, or says wrongly, stays as it is.
    pub fn follow_link(&mut self, link: &str) {
        if self.scene.is_none() {
            self.link = Some(link.to_owned());
            return;
        }
        let value = |name: &str| {
            let part = link.split('&').find_map(|part| part.strip_prefix(name)?.strip_prefix('='));
            part.map(str::to_owned)
        };
        if let Some(view) = value("view").and_then(|text| text.parse().ok()) {
            self.stand_on(view);
        } else if let Some(navigator) = self.linked(&value) {
            self.has_moved();
            self.navigator = navigator;
        }
        let mode = value("mode").and_then(|word| Mode::ALL.into_iter().find(|mode| mode.word() == word));
        // It may need what has not been rendered yet; what cannot be shown is left later.
        self.mode = mode.unwrap_or(self.mode);
    }

    fn linked(&self, value: &impl Fn(&str) -> Option<String>) -> Option<Navigator> {
        let [x, y, z] = numbers(&value("at")?)?;
        let [w, i, j, k] = numbers(&value("turn")?)?;
        let [distance] = numbers(&value("distance")?)?;
        let [fov] = numbers(&value("fov")?)?;
        let turn = DQuat::from_xyzw(i, j, k, w);
        let is_sound = distance > 0.0 && (0.01..3.1).contains(&fov) && turn.length() > 0.5;
        is_sound.then(|| Navigator {
            position: DVec3::new(x, y, z),
            world_from_view: DMat3::from_quat(turn.normalize()),
            distance,
            fov,
            ..self.navigator
        })
    }
}

/// So many finite numbers, separated by commas.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers = text.split(',').map(|part| part.parse().ok().filter(|value: &f64| value.is_finite()));
    numbers.collect::<Option<Vec<_>>>()?.try_into().ok()
}
