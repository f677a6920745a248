//! Options that are gone: what to do in their place.

use toml::{Table, Value};

/// Dotted name, and what to do instead. docs/log has the measurements.
const REMOVED: [(&str, &str); 5] = [
    ("filter", "leave it out: the 3D smoothing filter gained nothing"),
    ("densify.prune-screen-radius", "leave it out: `densify.growth.screen-size` splits what is wide on the screen"),
    ("densify.growth.error-pixels", "leave it out; for fewer Gaussians raise `densify.growth.threshold`"),
    ("residual.inputs", "leave it out: the network reads differences, which was best"),
    ("residual.learners", "leave it out: the final image teaches Gaussians and network"),
];

/// The sentence for an options file whose first unknown field, by the words of `reason`, is an option that is gone; none for other
/// mistakes.
pub(super) fn instead(text: &str, reason: &str) -> Option<String> {
    let table: Table = text.parse().ok()?;
    let is_given = |name: &str| {
        let (mut path, mut at) = (name.split('.'), None::<&Value>);
        path.all(|key| {
            at = at.map_or(table.get(key), |inner| inner.get(key));
            at.is_some()
        })
    };
    let is_meant = |name: &str| {
        let field = name.rsplit('.').next().unwrap_or(name);
        reason.starts_with(&format!("unknown field `{field}`"))
    };
    let (name, advice) = REMOVED.into_iter().find(|(name, _)| is_meant(name) && is_given(name))?;
    Some(format!("option `{name}` is gone; {advice}"))
}

#[cfg(test)]
mod tests {
    use super::super::TrainConfig;
    use super::REMOVED;
    use std::path::Path;

    #[test]
    fn options_that_are_gone_say_what_to_do() {
        let read = |text: &str| TrainConfig::from_text(text, Path::new("a.toml")).unwrap_err().to_string();
        for (name, advice) in REMOVED {
            let error = read(&format!("seed = 1\n{name} = 1\n"));
            assert_eq!(error, format!("a.toml, line 2: option `{name}` is gone; {advice}"));
        }
        let error = read("seed = 1\n[densify]\nfilter = 1\n");
        assert!(error.starts_with("a.toml, line 3: unknown field `filter`"), "{error}");
    }
}
