//! Photos or a video in place of a scene.

use super::quoted;
use crate::prepare;
use ibgs_core::dataset::DatasetError;

/// The error in other words than the library's: what is missing is poses, and a command estimates them.
pub fn rephrased(error: &DatasetError) -> Option<String> {
    let DatasetError::NotAScene { path, wanted } = error else { return None };
    prepare::inputs_in(path)?;
    let what = if path.is_file() { "is a video without camera poses" } else { "has photos but no camera poses" };
    let command = format!("`ibgs train {} --prepare`", quoted(path));
    Some(format!("{} {what}; {command} estimates them and trains; it has {wanted}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_and_a_video_are_told_apart_from_other_folders() {
        let work = tempfile::tempdir().unwrap();
        let folder = work.path().join("my photos");
        std::fs::create_dir(&folder).unwrap();
        let error =
            |path: &std::path::Path| DatasetError::NotAScene { path: path.to_owned(), wanted: "no x".to_owned() };
        assert_eq!(rephrased(&error(&folder)), None);
        std::fs::write(folder.join("a.jpg"), "").unwrap();
        let said = rephrased(&error(&folder)).unwrap();
        let path = folder.display();
        assert_eq!(
            said,
            format!(
                "{path} has photos but no camera poses; `ibgs train '{path}' --prepare` estimates them and trains; it has no x"
            )
        );
        let video = work.path().join("a.mp4");
        std::fs::write(&video, "").unwrap();
        assert!(rephrased(&error(&video)).unwrap().contains("a.mp4 is a video without camera poses"));
    }
}
