//! What a model is shared as: a page, a bundle, or Gaussians for other programs.

use crate::train_form::PathField;
use ibgs_core::model::is_bundle;
use ibgs_core::scene::Format;
use std::path::{Path, PathBuf};

/// What is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ShareKind {
    /// A folder that a web server shows: the viewer for browsers, the model and its photos.
    #[default]
    Page,
    /// One file with all that renders the final image.
    Bundle,
    /// The Gaussians of the base image alone.
    Gaussians(Format),
}

impl ShareKind {
    /// All kinds.
    pub fn all() -> impl Iterator<Item = Self> {
        [Self::Page, Self::Bundle].into_iter().chain(Format::written().map(Self::Gaussians))
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Page => "Web page",
            Self::Bundle => "Bundle (.ibgs)",
            Self::Gaussians(format) => format.name(),
        }
    }

    /// What it is for, and what it leaves out.
    pub fn meaning(self, small: bool) -> &'static str {
        match self {
            Self::Page => {
                "A folder for any web server: the viewer with the final image. Gaussians are kept as in SOG files, photos as JPEG."
            }
            Self::Bundle if small => {
                "One file with the final image, for `ibgs`. Gaussians are kept as in SOG files, photos as JPEG."
            }
            Self::Bundle => "One file with the final image, for `ibgs`. Nothing is lost.",
            Self::Gaussians(Format::Ply) => {
                "For most other programs: the base image, exactly. Network, photos and further bases are left out."
            }
            Self::Gaussians(_) => {
                "For other programs: the base image, in fewer bytes. Network, photos and further bases are left out, and \
                 values are rounded."
            }
        }
    }

    /// Those that a model can be written as: a file of Gaussians as such files alone.
    pub fn of(model: &Path) -> impl Iterator<Item = Self> + use<> {
        let is_whole = model.is_dir() || is_bundle(model);
        Self::all().filter(move |kind| is_whole || matches!(kind, Self::Gaussians(_)))
    }

    /// How names of it end.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Page => "-page",
            Self::Bundle => ".ibgs",
            Self::Gaussians(format) => format.ending(),
        }
    }
}

/// A model that is to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShareRequest {
    /// The model as it was opened.
    pub model: PathBuf,
    /// As what.
    pub kind: ShareKind,
    /// The folder or file to write.
    pub target: PathBuf,
    /// A bundle's photos are kept as JPEG.
    pub is_small: bool,
    /// What is there is replaced.
    pub replaces: bool,
}

/// The panel's state.
#[derive(Default)]
pub(crate) struct Share {
    /// The model that the name was proposed for.
    pub model: Option<PathBuf>,
    pub kind: ShareKind,
    pub target: PathField,
    pub is_small: bool,
    pub replaces: bool,
    /// It is being written.
    pub runs: bool,
    /// What was said of the last one.
    pub said: Vec<String>,
}

impl Share {
    /// Proposes a name beside the model.
    pub fn propose(&mut self, model: &Path) {
        if !ShareKind::of(model).any(|kind| kind == self.kind) {
            self.kind = ShareKind::Gaussians(Format::Spz);
        }
        let stem = match model.is_dir() {
            true => model.file_name(),
            false => model.file_stem(),
        };
        let stem = stem.unwrap_or_else(|| "model".as_ref());
        let named = |addition: &str| {
            let mut name = stem.to_owned();
            name.push(addition);
            name.push(self.kind.ending());
            model.with_file_name(name)
        };
        let usual = named("");
        self.target.set(if usual == model { named("-shared") } else { usual });
        (self.model, self.replaces) = (Some(model.to_owned()), false);
        self.said.clear();
    }

    /// What it describes of this model; none without a name.
    pub fn request(&self, model: &Path) -> Option<ShareRequest> {
        let Self { kind, is_small, replaces, .. } = *self;
        Some(ShareRequest { model: model.to_owned(), kind, target: self.target.path()?, is_small, replaces })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_beside_the_model_is_proposed() {
        let mut share = Share::default();
        let mut proposed = |kind, model: &str| {
            share.kind = kind;
            share.propose(model.as_ref());
            share.request(model.as_ref()).unwrap().target
        };
        assert_eq!(proposed(ShareKind::Page, "output/room.ibgs"), Path::new("output/room-page"));
        assert_eq!(proposed(ShareKind::Bundle, "output/room.ibgs"), Path::new("output/room-shared.ibgs"), "not itself");
        assert_eq!(proposed(ShareKind::Gaussians(Format::Spz), "a/b.ply"), Path::new("a/b.spz"));
        assert_eq!(proposed(ShareKind::Page, "a/b.ply"), Path::new("a/b.spz"), "a page shows a whole model");
        share.target = PathField::default();
        assert_eq!(share.request("a".as_ref()), None);
    }

    #[test]
    fn every_kind_has_a_name_and_says_what_it_leaves_out() {
        let mut names: Vec<_> = ShareKind::all().map(ShareKind::name).collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
        for kind in ShareKind::all() {
            let text = kind.meaning(false);
            assert!(text.contains("left out") == matches!(kind, ShareKind::Gaussians(_)), "{text}");
        }
        assert!(ShareKind::Bundle.meaning(true).contains("JPEG"));
    }
}
