//! Where the options of two runs differ.

use super::TrainConfig;
use toml::{Table, Value};

/// An option that two runs have differently, its values written as in the options file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OptionDifference {
    /// Its dotted name, for instance `densify.interval`.
    pub name: String,
    /// The value of the first run; none where it is unset.
    pub first: Option<String>,
    /// The value of the second run; none where it is unset.
    pub second: Option<String>,
}

impl TrainConfig {
    /// The first option in which another run differs; none where all are equal.
    ///
    /// # Errors
    /// A value that an options file cannot hold.
    pub fn difference(&self, other: &Self) -> Result<Option<OptionDifference>, toml::ser::Error> {
        Ok(difference(&Table::try_from(self)?, &Table::try_from(other)?))
    }
}

fn difference(a: &Table, b: &Table) -> Option<OptionDifference> {
    a.keys().chain(b.keys()).find_map(|key| match (a.get(key), b.get(key)) {
        (Some(Value::Table(a)), Some(Value::Table(b))) => {
            difference(a, b).map(|inner| OptionDifference { name: format!("{key}.{}", inner.name), ..inner })
        }
        (a, b) => (a != b).then(|| OptionDifference {
            name: key.clone(),
            first: a.map(Value::to_string),
            second: b.map(Value::to_string),
        }),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_difference_has_a_name_and_both_values() {
        let usual = TrainConfig::default();
        assert_eq!(usual.difference(&usual).unwrap(), None);
        let mut other = usual.clone();
        other.residual.factor = Some(0.5);
        let found = usual.difference(&other).unwrap().unwrap();
        assert_eq!((&*found.name, found.first, found.second.as_deref()), ("residual.factor", None, Some("0.5")));
        other.iterations = Some(70);
        assert_eq!(other.difference(&usual).unwrap().unwrap().name, "iterations");
    }
}
