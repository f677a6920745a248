//! Which views train and which are held out (method.md section 9).

use super::error::{DatasetError, read_bytes};
use super::{Dataset, LoadOptions};
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

/// Fills `dataset.train` and `dataset.test`; the views are sorted already. `split.json` in `root` wins, then,
/// with `eval`, the scene's own test list, then every n-th view.
pub(crate) fn split(
    dataset: &mut Dataset,
    held_out: Option<Vec<String>>,
    root: &Path,
    options: &LoadOptions,
) -> Result<(), DatasetError> {
    let path = root.join("split.json");
    if path.is_file() {
        from_file(dataset, &path)?;
    } else {
        let held_out: Option<BTreeSet<String>> = held_out.map(|names| names.into_iter().collect());
        let every = options.eval_split_every.max(1);
        let is_test = |index: usize| match &held_out {
            _ if !options.eval => false,
            Some(names) => names.contains(&dataset.views[index].name),
            None => index.is_multiple_of(every),
        };
        (dataset.test, dataset.train) = (0..dataset.views.len()).partition(|index| is_test(*index));
    }
    match dataset.train.len() {
        count @ (0 | 1) => Err(DatasetError::TooFewViews { path: dataset.path.clone(), count, what: "training views" }),
        _ => Ok(()),
    }
}

fn from_file(dataset: &mut Dataset, path: &Path) -> Result<(), DatasetError> {
    let file: SplitJson = serde_json::from_slice(&read_bytes(path)?)
        .map_err(|cause| DatasetError::Json { path: path.to_owned(), cause: cause.to_string() })?;
    let by_name: BTreeMap<&str, usize> =
        dataset.views.iter().enumerate().map(|(index, view)| (view.name.as_str(), index)).collect();
    let mut seen = BTreeSet::new();
    let mut resolve = |field: &str, names: &[String]| {
        let mut indices = Vec::with_capacity(names.len());
        for (at, name) in names.iter().enumerate() {
            let field = || format!("{field}[{at}]");
            let index = *by_name.get(name.as_str()).ok_or_else(|| {
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
    let unused = dataset.views.len() - train.len() - test.len();
    let tail = if unused > 0 { format!(", {unused} unused") } else { String::new() };
    dataset.notes.push(format!("split.json: {} training and {} test views{tail}", train.len(), test.len()));
    (dataset.train, dataset.test) = (train, test);
    Ok(())
}
