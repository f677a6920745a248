//! Which views train and which are held out (method.md section 9).

use super::error::{DatasetError, read_json};
use super::names::spelling;
use super::photos::ListedPhoto;
use super::{Dataset, LoadOptions};
use crate::counted;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// `split.json`: image names.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SplitJson {
    train: Vec<String>,
    #[serde(default)]
    test: Vec<String>,
}

/// The split that a scene's own files state, by names of views. All others train.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct StatedSplit {
    pub test: BTreeSet<String>,
    /// Neither train nor are held out.
    pub unused: BTreeSet<String>,
    /// What states it.
    pub by: &'static str,
}

/// A split of views by their indices in order.
pub(crate) struct Divided {
    pub train: Vec<usize>,
    pub test: Vec<usize>,
    /// What decides it, for `ibgs info`.
    pub by: String,
    note: Option<String>,
}

/// Fills `dataset.train` and `dataset.test`; the views are sorted already.
pub(crate) fn split(
    dataset: &mut Dataset,
    stated: Option<StatedSplit>,
    root: &Path,
    options: &LoadOptions,
) -> Result<(), DatasetError> {
    let names: Vec<String> = dataset.views.iter().map(|view| view.name.clone()).collect();
    let Divided { train, test, note, .. } = divided(&names, stated, root, options)?;
    dataset.notes.extend(note);
    (dataset.train, dataset.test) = (train, test);
    match dataset.train.len() {
        count @ (0 | 1) => Err(DatasetError::TooFewViews { path: dataset.path.clone(), count, what: "training view" }),
        _ => Ok(()),
    }
}

/// Divides views by their sorted names. `split.json` in `root` wins, then, with `eval`, the scene's own lists, then every
/// n-th view.
pub(crate) fn divided(
    names: &[String],
    stated: Option<StatedSplit>,
    root: &Path,
    options: &LoadOptions,
) -> Result<Divided, DatasetError> {
    let path = options.split.clone().unwrap_or_else(|| root.join("split.json"));
    if options.split.is_some() || path.is_file() {
        return from_file(names, &path);
    }
    let all = 0..names.len();
    let Some(stated) = stated.filter(|_| options.eval) else {
        let every = options.eval_split_every.max(1) as usize;
        let (test, train) = all.partition(|index| options.eval && index.is_multiple_of(every));
        return Ok(Divided { train, test, by: format!("every {every}th photo by name"), note: None });
    };
    let (unused, used): (Vec<usize>, Vec<usize>) = all.partition(|&index| stated.unused.contains(&names[index]));
    let (test, train): (Vec<usize>, Vec<usize>) =
        used.into_iter().partition(|&index| stated.test.contains(&names[index]));
    let unused = unused.len();
    let note =
        (unused > 0).then(|| format!("{}: {} neither for training nor held out", stated.by, counted(unused, "photo")));
    Ok(Divided { train, test, by: stated.by.to_owned(), note })
}

fn from_file(names: &[String], path: &Path) -> Result<Divided, DatasetError> {
    let file: SplitJson = read_json(path)?;
    let by_name: BTreeMap<&str, usize> = names.iter().enumerate().map(|(index, name)| (name.as_str(), index)).collect();
    let mut seen = BTreeSet::new();
    let mut resolve = |field: &str, names: &[String]| {
        let mut indices = Vec::with_capacity(names.len());
        for (at, name) in names.iter().enumerate() {
            let field = || format!("{field}[{at}]");
            let index = by_name.get(name.as_str()).or_else(|| by_name.get(spelling(name).as_str()));
            let index = *index.ok_or_else(|| {
                let example = by_name.keys().next().copied().unwrap_or_default();
                let problem = format!("the scene has no image `{name}` (its names look like `{example}`)");
                DatasetError::field(path, field(), problem)
            })?;
            if !seen.insert(index) {
                return Err(DatasetError::field(path, field(), format!("`{name}` is listed twice")));
            }
            indices.push(index);
        }
        indices.sort_unstable();
        Ok(indices)
    };
    let (train, test) = (resolve("train", &file.train)?, resolve("test", &file.test)?);
    let unused = names.len() - train.len() - test.len();
    let tail = if unused > 0 { format!(", {unused} unused") } else { String::new() };
    let by = path.file_name().map_or_else(|| "split.json".into(), |name| name.to_string_lossy().into_owned());
    let note = format!("{by}: {} training and {} test views{tail}", train.len(), test.len());
    Ok(Divided { train, test, by, note: Some(note) })
}

/// Keeps the photos that a split names.
pub(crate) fn keep_named(photos: &mut Vec<ListedPhoto>, path: &Path) -> Result<(), DatasetError> {
    let names: Vec<String> = photos.iter().map(|photo| photo.name.clone()).collect();
    let Divided { train, test, .. } = from_file(&names, path)?;
    let named: BTreeSet<usize> = train.into_iter().chain(test).collect();
    let mut index = 0..;
    photos.retain(|_| index.next().is_some_and(|index| named.contains(&index)));
    Ok(())
}
