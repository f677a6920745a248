//! `multi_view.json`: the sources of each view, one JSON object a line, in the form of the published code.

use crate::camera::Camera;
use crate::dataset::Dataset;
use crate::output::cameras::{self, CameraRecord, Split};
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
    of_cameras(&cameras::records(dataset), options)
}

/// The sources of every view that trains or is held out, in their order.
pub fn of_cameras(cameras: &[CameraRecord], options: &SourceOptions) -> Vec<ViewSources> {
    let training: Vec<&CameraRecord> = cameras.iter().filter(|view| view.split == Some(Split::Train)).collect();
    let places: Vec<Camera> = training.iter().map(|view| view.camera).collect();
    let finder = SourceFinder::new(&places, options);
    let record = |view: &CameraRecord| {
        let own = training.iter().position(|other| std::ptr::eq(*other, view));
        let sources = finder.neighbours(&view.camera, own);
        let names = sources.into_iter().map(|source| training[source].name.clone());
        ViewSources { name: view.name.clone(), sources: names.collect() }
    };
    cameras.iter().filter(|view| view.split.is_some()).map(record).collect()
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
