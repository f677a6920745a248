//! Errors in the words of the command line. The libraries say what is wrong and where, and know no flags; what the user can do
//! about it with the flags of this program is added here.

mod folders;
mod passed_on;
mod photos;
mod start;

pub use folders::{quoted, resume};
use ibgs_core::blocks::PlanError;
use ibgs_core::config::ConfigError;
use ibgs_core::dataset::{DatasetError, Resolution};
use ibgs_core::gpu::GpuError;
use ibgs_core::local_space::Length;
use ibgs_core::mesh::MeshError;
use ibgs_core::model::ModelError;
use ibgs_core::residual::NetworkError;
use ibgs_core::scene::SceneError;
use ibgs_core::sentence_with;
use ibgs_train::checkpoint::CheckpointError;
use ibgs_train::lpips::LpipsError;
use ibgs_train::session::{Event, SessionError};
use passed_on::passed_on;
use std::error::Error;

type AnyError<'a> = &'a (dyn Error + 'static);

/// Options of the table `data` that have a flag of the same name.
const DATA_FLAGS: [&str; 10] = [
    "resolution",
    "resampler",
    "images",
    "max-resolution",
    "eval-split-every",
    "principal-point",
    "masks",
    "alpha",
    "initial-points",
    "color-space",
];

/// Buffers by what [`GpuError::TooLarge`] calls them: those that grow with the images alone, and with the Gaussians alone.
const OF_IMAGES: [&str; 12] = [
    "photo",
    "image",
    "transmittance",
    "last contributors",
    "normal map",
    "median depth",
    "median intersections",
    "SSIM moments",
    "SSIM moments of the warped images",
    "packed sources",
    "residual",
    "screen",
];
const OF_GAUSSIANS: [&str; 8] = [
    "projected Gaussians",
    "planes",
    "filters",
    "means",
    "spherical harmonics",
    "Adam moments",
    "densification statistics",
    "densification plan",
];

/// An error with its causes in one line, with what the user can do about it.
pub fn sentence(error: &anyhow::Error) -> String {
    sentence_with(error.as_ref(), &words)
}

/// As [`sentence`], for an error of a library.
pub fn of(error: AnyError) -> String {
    sentence_with(error, &words)
}

/// What a training reports.
pub fn event(event: &Event) -> String {
    start::event(event).unwrap_or_else(|| event.with_errors(&|error| of(error)).to_string())
}

/// Parses the size of photos; clap adds the name of the flag to the error.
pub fn resolution(text: &str) -> Result<Resolution, String> {
    text.parse().map_err(|error| match error {
        DatasetError::Option { value, allowed, .. } => format!("`{value}` is not allowed; use {allowed}"),
        error => error.to_string(),
    })
}

/// The words for one error, without its causes.
fn words(error: AnyError) -> String {
    if let Some(passed_on) = passed_on(error) {
        return words(passed_on);
    }
    let text = rephrased(error).unwrap_or_else(|| error.to_string());
    match advice(error) {
        Some(advice) => format!("{text}; {advice}"),
        None => text,
    }
}

/// An error in other words than the library's.
fn rephrased(error: AnyError) -> Option<String> {
    None.or_else(|| dataset(error.downcast_ref()?))
        .or_else(|| photos::rephrased(error.downcast_ref()?))
        .or_else(|| session(error.downcast_ref()?))
        .or_else(|| session(error.downcast_ref::<Box<SessionError>>()?))
        .or_else(|| start::rephrased(error.downcast_ref()?))
        .or_else(|| match error.downcast_ref()? {
            GpuError::UnknownAdapter { wanted, available } => {
                Some(format!("no adapter matches `--adapter {wanted}`; this machine has: {available}"))
            }
            _ => None,
        })
        .or_else(|| match error.downcast_ref()? {
            NetworkError::Gpu(error) => Some(format!("the residual network: {}", words(error))),
            _ => None,
        })
        .or_else(|| match error.downcast_ref()? {
            ConfigError::Invalid { path: None, .. } => Some(format!("command line: {error}")),
            _ => None,
        })
}

/// `data.masks` and the like become flags.
fn dataset(error: &DatasetError) -> Option<String> {
    let DatasetError::Option { .. } = error else { return None };
    let flagged = |text: String, name| text.replace(&format!("`data.{name}`"), &format!("`--{name}`"));
    Some(DATA_FLAGS.into_iter().fold(error.to_string(), flagged))
}

fn session(error: &SessionError) -> Option<String> {
    match error {
        SessionError::Stopped { saved: Some(path), checkpoint: Some(_), folder, .. } => Some(format!(
            "training stopped; the model so far is in {}, and {} continues from there",
            path.display(),
            resume(folder)
        )),
        SessionError::Stopped { saved: None, checkpoint: Some(iteration), folder, .. } => {
            Some(format!("training stopped; {} continues from iteration {iteration}", resume(folder)))
        }
        SessionError::OnlyCheckpoint { folder, .. } => {
            Some(format!("{} continues from here, but not everything was saved and measured", resume(folder)))
        }
        _ => None,
    }
}

/// What to do about an error, where the error itself does not say it.
fn advice(error: AnyError) -> Option<String> {
    None.or_else(|| model(error.downcast_ref()?))
        .or_else(|| scene(error.downcast_ref()?))
        .or_else(|| gpu(error.downcast_ref()?))
        .or_else(|| match error.downcast_ref()? {
            SceneError::NoGaussians => Some("export it without levels of detail (`--levels`, `--streamed`)"),
            _ => None,
        })
        .or_else(|| match error.downcast_ref()? {
            LpipsError::TooWide { .. } => Some("use smaller images (`--resolution`) or another adapter (`--adapter`)"),
            _ => None,
        })
        .or_else(|| match error.downcast_ref()? {
            CheckpointError::Version { .. } => {
                Some("continue with that version, or start again from its Gaussians with `--init`")
            }
            _ => None,
        })
        .or_else(|| match error.downcast_ref()? {
            PlanError::NoPlan { .. } => Some("`ibgs split` makes one"),
            _ => None,
        })
        .map(str::to_owned)
        .or_else(|| mesh(error.downcast_ref()?))
        .or_else(|| folders::advice(error.downcast_ref()?))
        .or_else(|| start::advice(error.downcast_ref()?))
}

fn model(error: &ModelError) -> Option<&'static str> {
    match error {
        ModelError::OtherIteration { .. } => Some("leave `--iteration` out"),
        ModelError::KnowsItsPhotos { .. } => Some("leave `--resolution` out"),
        ModelError::NoScene { .. } => Some("give the scene folder with `--source`"),
        ModelError::OtherScene { .. } | ModelError::OtherPoses { .. } => {
            Some("give the scene that it was trained on with `--source`")
        }
        ModelError::SceneGone { .. } | ModelError::PhotosGone { .. } => {
            Some("if the scene has moved, say where it is (`-s SCENE`)")
        }
        _ => None,
    }
}

fn gpu(error: &GpuError) -> Option<&'static str> {
    match error {
        GpuError::NoAdapter => {
            Some("install a Vulkan driver (Debian: `apt install mesa-vulkan-drivers` gives a software one)")
        }
        GpuError::FewChunks { .. } => Some("give more of it (`--gpu-memory`)"),
        GpuError::Lacking { .. } => Some("choose another one with `--adapter`"),
        GpuError::TooLarge { what, .. } if OF_IMAGES.contains(what) => {
            Some("use smaller images (`--resolution` or `--max-resolution`)")
        }
        GpuError::TooLarge { what, .. } if OF_GAUSSIANS.contains(what) => Some("use fewer Gaussians (`--max-splats`)"),
        GpuError::TooLarge { .. } => {
            Some("use smaller images (`--resolution` or `--max-resolution`) or fewer Gaussians (`--max-splats`)")
        }
        GpuError::OutOfMemory { .. } => Some(
            "use fewer Gaussians (`--max-splats`), a smaller image (`--resolution`), or end other programs that use the GPU",
        ),
        _ => None,
    }
}

fn mesh(error: &MeshError) -> Option<String> {
    match error {
        MeshError::Voxels { enough, .. } => Some(format!(
            "choose a voxel size of {} (`--voxel-size`), smaller `--bounds`, a smaller `--max-depth`, or a higher `--memory`",
            Length(*enough)
        )),
        MeshError::DepthMaps { .. } => {
            Some("render them smaller with `--width`, or give a higher `--memory`".to_owned())
        }
        _ => None,
    }
}

fn scene(error: &DatasetError) -> Option<&'static str> {
    match error {
        DatasetError::InArchive { error, .. } => scene(error),
        DatasetError::NoPhotoFolder { .. } => Some("create it or name another with `--images`"),
        DatasetError::NoPhotos { .. } => Some("put the photos there or name their folder with `--images`"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ibgs_core::dataset::{Alpha, LoadOptions, Masks};
    use ibgs_core::eval::EvalError;
    use ibgs_core::output::OutputError;
    use ibgs_train::TrainError;
    use ibgs_train::session::Event;
    use std::path::PathBuf;

    #[track_caller]
    fn says(error: impl Into<anyhow::Error>, expected: &str) {
        assert_eq!(sentence(&error.into()), expected);
    }

    #[test]
    fn options_of_the_scene_are_named_by_their_flags() {
        says(
            "abc".parse::<Resolution>().unwrap_err(),
            "option `--resolution`: `abc` is not allowed; use 1, 2, 4 or 8 to divide, a larger number for the width in pixels, \
             or -1 to cap the width at 1600",
        );
        let both = LoadOptions { masks: Some(Masks::Object), alpha: Some(Alpha::Composite), ..LoadOptions::default() };
        let refused = ibgs_core::dataset::load(&PathBuf::from("scene"), &both).err();
        says(
            ModelError::Scene(refused.expect("both cannot be")),
            "option `--alpha`: `composite` is not allowed; use `mask` where `--masks` is `object`, or leave it out",
        );
        for name in DATA_FLAGS {
            let error = DatasetError::Option { option: "data.masks", value: format!("`data.{name}`"), allowed: "" };
            assert!(sentence(&error.into()).contains(&format!("`--{name}`")));
        }
    }

    #[test]
    fn errors_are_found_inside_of_others() {
        let gpu = || GpuError::TooLarge { what: "unet v_x", bytes: 9, limit: 8 };
        let advised = "unet v_x needs 9 bytes in one buffer, more than this device allows (8); use smaller images (`--resolution` or \
                       `--max-resolution`) or fewer Gaussians (`--max-splats`)";
        says(gpu(), advised);
        says(anyhow::Error::from(gpu()).context("outside"), &format!("outside: {advised}"));
        says(ModelError::Network(NetworkError::Gpu(gpu())), &format!("the residual network: {advised}"));
        let stopped = |saved: Option<PathBuf>, checkpoint| SessionError::Stopped {
            source: Box::new(SessionError::Train(TrainError::Gpu(gpu()))),
            folder: "my out".into(),
            saved,
            checkpoint,
        };
        let resume = "`ibgs train --resume -m 'my out'`";
        says(stopped(None, Some(7)), &format!("training stopped; {resume} continues from iteration 7: {advised}"));
        says(
            stopped(Some("out".into()), Some(7)),
            &format!("training stopped; the model so far is in out, and {resume} continues from there: {advised}"),
        );
        let wide = LpipsError::TooWide { width: 5, bytes: 9, limit: 8 };
        says(
            EvalError::Distance(Box::new(wide)),
            "LPIPS of an image 5 pixels wide needs 9 bytes in one buffer, more than this device binds at once (8); use smaller \
             images (`--resolution`) or another adapter (`--adapter`)",
        );
        let folder = || DatasetError::NoPhotoFolder { path: "images".into() };
        says(folder(), "photo folder images does not exist; create it or name another with `--images`");
        says(
            DatasetError::InArchive { error: Box::new(folder()), message: "scene.zip lacks them".into() },
            "scene.zip lacks them; create it or name another with `--images`",
        );
    }

    /// Every arm that adds advice, with the option that it names.
    #[test]
    fn advice_names_the_option() {
        let path = || PathBuf::from("model");
        let large = |what| GpuError::TooLarge { what, bytes: 9, limit: 8 };
        let only_checkpoint = SessionError::OnlyCheckpoint {
            iteration: 7,
            folder: path(),
            source: Box::new(GpuError::OutOfMemory { what: "planes", bytes: 9 }.into()),
        };
        let cases: [(anyhow::Error, &[&str]); 16] = [
            (
                ModelError::OtherIteration { path: path(), found: 7, wanted: 8 }.into(),
                &["7", "8", "leave `--iteration` out"],
            ),
            (ModelError::KnowsItsPhotos { path: path() }.into(), &["leave `--resolution` out"]),
            (ModelError::NoScene { path: path() }.into(), &["config.toml", "with `--source`"]),
            (
                ModelError::OtherScene { path: path(), missing: 2, count: 3, name: "a.png".into() }.into(),
                &["2 of the 3 photos", "`a.png`", "with `--source`"],
            ),
            (
                GpuError::Lacking { adapter: "a".into(), missing: "b".into() }.into(),
                &["`a` lacks b", "with `--adapter`"],
            ),
            (
                GpuError::OutOfMemory { what: "planes", bytes: 9 }.into(),
                &["planes", "`--max-splats`", "`--resolution`"],
            ),
            (large("photo").into(), &["photo", "use smaller images (`--resolution` or `--max-resolution`)"]),
            (large("image").into(), &["use smaller images (`--resolution` or `--max-resolution`)"]),
            (large("means").into(), &["use fewer Gaussians (`--max-splats`)"]),
            (CheckpointError::Version { path: path(), found: "0.0.1".into() }.into(), &["ibgs 0.0.1", "with `--init`"]),
            (
                only_checkpoint.into(),
                &["`ibgs train --resume -m model` continues from here", "was saved and measured", "no memory left"],
            ),
            (OutputError::HoldsModel { path: path(), iteration: 7 }.into(), &["7 iterations", "(`--overwrite`)"]),
            (
                OutputError::HoldsTraining { path: path(), iteration: 7 }.into(),
                &["(`ibgs train --resume -m model`)", "(`--overwrite`)"],
            ),
            (OutputError::Foreign { path: path(), file: "split.json" }.into(), &["split.json", "(`--overwrite`)"]),
            (DatasetError::NoPhotos { path: path(), count: 3, first: path() }.into(), &["with `--images`"]),
            (
                MeshError::DepthMaps { what: "depth maps", views: 3, needed: 9, limit: 8 }.into(),
                &["`--width`", "`--memory`"],
            ),
        ];
        for (error, fragments) in cases {
            let said = sentence(&error);
            assert!(fragments.iter().all(|fragment| said.contains(fragment)), "{fragments:?} in {said}");
        }
        // Fewer Gaussians do not make a photo fit, and smaller photos do not make Gaussians fit.
        assert!(!sentence(&large("photo").into()).contains("Gaussians"));
        assert!(!sentence(&large("means").into()).contains("--resolution"));
    }

    /// What a training warns of is advised like what ends it.
    #[test]
    fn warnings_of_a_training_have_the_advice_too() {
        let error = SessionError::Gpu(GpuError::OutOfMemory { what: "planes", bytes: 9 });
        let events =
            [Event::NoCheckpoint { error: &error }, Event::RolledBack { error: &error, iteration: 7, rates: 0.5 }];
        for event in events {
            let said = event.with_errors(&|error| of(error)).to_string();
            assert!(said.starts_with("warning: ") && said.contains("use fewer Gaussians (`--max-splats`)"), "{said}");
            assert!(!event.to_string().contains("--max-splats"), "the library knows no options");
        }
    }

    #[test]
    fn what_the_library_says_stays_as_it_is() {
        let error = ModelError::NoCameras;
        let text = error.to_string();
        says(error, &text);
    }
}
