//! `multi_view.json`: the sources of each view, one JSON object a line, in the form of the published code.

use crate::camera::Camera;
use crate::dataset::Dataset;
use crate::sources::find::{SourceFinder, SourceOptions};
use serde::{Deserialize, Serialize};

/// The sources of one view.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ViewSources {
    /// Name of the view.
    #[serde(rename = "ref_name")]
    pub name: String,
    /// Names of its sources, best first.
    #[serde(rename = "nearest_name")]
    pub sources: Vec<String>,
}

/// The sources of every view of a data set that trains or is held out, in its order.
pub fn records(dataset: &Dataset, options: &SourceOptions) -> Vec<ViewSources> {
    let cameras: Vec<Camera> = dataset.train.iter().map(|&i| dataset.views[i].camera).collect();
    let finder = SourceFinder::new(&cameras, options);
    let record = |index: usize| {
        let own = dataset.train.iter().position(|&i| i == index);
        let view = &dataset.views[index];
        let sources = finder.neighbours(&view.camera, own);
        let name = |source: usize| dataset.views[dataset.train[source]].name.clone();
        ViewSources { name: view.name.clone(), sources: sources.into_iter().map(name).collect() }
    };
    let listed = |index: &usize| dataset.train.contains(index) || dataset.test.contains(index);
    (0..dataset.views.len()).filter(listed).map(record).collect()
}

/// Contents of `multi_view.json`.
pub fn to_text(views: &[ViewSources]) -> Result<String, serde_json::Error> {
    views.iter().map(|view| Ok(serde_json::to_string(view)? + "\n")).collect()
}

/// Reads the contents of `multi_view.json`.
///
/// # Errors
/// One sentence that names the line.
pub fn from_text(text: &str) -> Result<Vec<ViewSources>, String> {
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    lines.map(|(at, line)| serde_json::from_str(line).map_err(|error| format!("line {}: {error}", at + 1))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip_and_damage() {
        let view = |name: &str, sources: &[&str]| ViewSources {
            name: name.to_owned(),
            sources: sources.iter().map(|&s| s.to_owned()).collect(),
        };
        let views = [view("a/0001.jpg", &["0002.jpg", "\"odd\".jpg"]), view("b.png", &[])];
        let text = to_text(&views).unwrap();
        assert!(text.starts_with("{\"ref_name\":\"a/0001.jpg\",\"nearest_name\":[\"0002.jpg\","), "{text}");
        assert_eq!(from_text(&text).unwrap(), views);
        let error = from_text(&text.replace("b.png", "b\"")).unwrap_err();
        assert!(error.starts_with("line 2"), "{error}");
    }
}
