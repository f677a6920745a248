//! Lists of names in a `transforms.json` that divide its frames, as nerfstudio reads them.

use crate::dataset::error::DatasetError;
use crate::dataset::names::spelling;
use crate::dataset::split::StatedSplit;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Names of views by the spelling in the file; none where the photo is missing.
pub(super) type Names = BTreeMap<String, Option<String>>;

/// `train_filenames`, `val_filenames` and `test_filenames`: `file_path`s of frames. An empty list is none.
pub(super) struct Lists {
    pub train: Option<Vec<String>>,
    pub val: Option<Vec<String>>,
    pub test: Option<Vec<String>>,
}

/// Makes a frame known by its `file_path`, and by its name.
pub(super) fn add_name(names: &mut Names, file_path: &str, name: Option<String>) {
    if let Some(name) = &name {
        names.insert(name.clone(), Some(name.clone()));
    }
    names.insert(spelling(file_path), name);
}

impl Lists {
    /// The split; none if there are no lists. Held out are the views of `test_filenames`; without that list those of
    /// `val_filenames`; without both, all that are not in `train_filenames`. With `train_filenames` only its views
    /// train, without it all that no list has. Other views are not used.
    ///
    /// # Errors
    /// A name that no frame has, that a list has twice, or that is both in `train_filenames` and in another list.
    pub fn split(&self, path: &Path, names: &Names) -> Result<Option<StatedSplit>, DatasetError> {
        let read = |field, list: &Option<Vec<String>>| match list {
            Some(list) if !list.is_empty() => resolved(path, field, list, names).map(Some),
            _ => Ok(None),
        };
        let train = read("train_filenames", &self.train)?;
        let val = read("val_filenames", &self.val)?;
        let test = read("test_filenames", &self.test)?;
        for (field, list) in [("val_filenames", &val), ("test_filenames", &test)] {
            let (Some(list), Some(train)) = (list, &train) else { continue };
            if let Some(twice) = list.intersection(train).next() {
                let problem = format!("`{twice}` is in train_filenames too: a photo either trains or is held out");
                return Err(DatasetError::field(path, field, problem));
            }
        }
        let all: BTreeSet<String> = names.values().flatten().cloned().collect();
        let (test, by) = match (test, &val, &train) {
            (Some(test), _, _) => (test, "test_filenames"),
            (None, Some(val), _) => (val.clone(), "val_filenames"),
            (None, None, Some(train)) => (&all - train, "train_filenames"),
            (None, None, None) => return Ok(None),
        };
        let train = train.unwrap_or_else(|| &(&all - &test) - &val.unwrap_or_default());
        let unused = &(&all - &train) - &test;
        Ok(Some(StatedSplit { test, unused, by }))
    }
}

/// The views of one list; missing photos are left out.
fn resolved(path: &Path, field: &str, list: &[String], names: &Names) -> Result<BTreeSet<String>, DatasetError> {
    let mut seen = BTreeSet::new();
    let mut views = BTreeSet::new();
    for (at, given) in list.iter().enumerate() {
        let refuse = |problem: String| DatasetError::field(path, format!("{field}[{at}]"), problem);
        let spelling = spelling(given);
        let name = names.get(&spelling).ok_or_else(|| {
            let example = names.keys().next().map(String::as_str).unwrap_or_default();
            refuse(format!("no frame has the file_path `{given}` (they look like `{example}`)"))
        })?;
        if !seen.insert(name.clone().unwrap_or(spelling)) {
            return Err(refuse(format!("`{given}` is listed twice")));
        }
        views.extend(name.clone());
    }
    Ok(views)
}
