//! The words of a training that begins.

use super::AnyError;
use ibgs_core::gpu::Bytes;
use ibgs_train::memory::DoesNotFit;
use ibgs_train::session::{BuildError, Event};

/// The error that another one passes on unchanged.
pub fn passed_on(error: &BuildError) -> Option<AnyError<'_>> {
    match error {
        BuildError::Config(error) => Some(error),
        BuildError::Scene(error) => Some(error),
        BuildError::Start(error) => Some(error),
        BuildError::Network(error) => Some(error),
        BuildError::Gpu(error) => Some(error),
        BuildError::Train(error) => Some(error),
        BuildError::Output(error) => Some(error),
        BuildError::Write(error) => Some(error),
        BuildError::Checkpoint(error) => Some(error),
        _ => None,
    }
}

/// The error in other words than the library's.
pub fn rephrased(error: &BuildError) -> Option<String> {
    let BuildError::DoesNotFit(error) = error else { return None };
    Some(format!("{error} (`--gpu-memory`)"))
}

/// What to do about the error.
pub fn advice(error: &BuildError) -> Option<String> {
    let advice = match error {
        // A merge, whose photos and Gaussians are what they are.
        BuildError::DoesNotFit(DoesNotFit { has_network: true, .. }) => "`ibgs merge --iterations 0` does without it",
        BuildError::DoesNotFit(_) => {
            "train on smaller photos (`--resolution`), give the source photos less (`--source-memory`), or cut the scene into more \
             blocks (`ibgs split`)"
        }
        BuildError::IsScene { .. } => "choose another `--model`",
        BuildError::NoCheckpoint { .. } => "train without `--resume`",
        BuildError::OnlyModel { gaussians, .. } => {
            let path = gaussians.display();
            return Some(format!("train on from its Gaussians (`--init {path}`), or anew (`--overwrite`)"));
        }
        _ => return None,
    };
    Some(advice.to_owned())
}

/// An event that names an option.
pub fn event(event: &Event) -> Option<String> {
    match event {
        Event::Limited(limit) => Some(format!(
            "warning: {} Gaussians would need {} of device memory, and {} is there (`--gpu-memory`): their number stops at {}",
            limit.wanted.gaussians,
            Bytes(limit.wanted.bytes),
            Bytes(limit.budget),
            limit.fits
        )),
        Event::Slow { .. } => Some(format!(
            "{event}; `--preset fast`, smaller photos (`-r 4`, `-r 8`) and fewer iterations (`--iterations 500`) shorten it"
        )),
        Event::SmallNetwork(_) => Some(format!("{event}; `--residual-factor 1` runs it there")),
        // It ends with the most Gaussians.
        Event::Prepared(preparation) if preparation.at_most.is_some() => {
            Some(format!("{preparation} (`--max-splats`)"))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ibgs_core::config::OptionDifference;
    use ibgs_core::gpu::GpuError;
    use ibgs_train::TrainError;
    use ibgs_train::memory::{MemoryLimit, Need};
    use ibgs_train::session::{Preparation, SmallNetwork};

    #[track_caller]
    fn says(error: BuildError, expected: &str) {
        assert_eq!(crate::advice::sentence(&error.into()), expected);
    }

    const NEED: Need = Need { gaussians: 500, bytes: 3 << 20 };

    #[test]
    fn a_training_that_cannot_begin_is_told_with_its_options() {
        let full = |has_network| BuildError::DoesNotFit(DoesNotFit { needed: NEED, budget: 1 << 20, has_network });
        says(
            full(false),
            "the training needs about 3 MiB of device memory at 500 Gaussians, and 1 MiB is there (`--gpu-memory`); train on \
             smaller photos (`--resolution`), give the source photos less (`--source-memory`), or cut the scene into more blocks \
             (`ibgs split`)",
        );
        says(
            full(true),
            "the training needs about 3 MiB of device memory at 500 Gaussians, and 1 MiB is there (`--gpu-memory`); `ibgs merge \
             --iterations 0` does without it",
        );
        says(BuildError::IsScene { path: "a".into() }, "a is the scene itself; choose another `--model`");
        says(
            BuildError::NoCheckpoint { path: "a".into() },
            "a holds no checkpoint to resume from; train without `--resume`",
        );
        says(
            BuildError::OnlyModel { path: "a".into(), iteration: 7, iterations: 9, gaussians: "a/b.ply".into() },
            "a has no checkpoint to resume from, only the model of iteration 7 of 9; train on from its Gaussians (`--init \
             a/b.ply`), or anew (`--overwrite`)",
        );
        says(
            BuildError::Ended { path: "a".into(), iteration: 9 },
            "the training in a has ended, its model has 9 iterations; there is nothing to resume",
        );
        let option = OptionDifference { name: "seed".to_owned(), first: Some("1".to_owned()), second: None };
        says(
            BuildError::OtherOption { path: "a".into(), option: Box::new(option) },
            "the training in a has the option `seed` at 1, not unset; a resumed run keeps its options: leave it out",
        );
        // An error inside has the advice that it has elsewhere.
        let large = || GpuError::TooLarge { what: "means", bytes: 9, limit: 8 };
        let alone = crate::advice::of(&large());
        says(BuildError::Train(TrainError::Gpu(large())), &alone);
        assert!(alone.ends_with("use fewer Gaussians (`--max-splats`)"), "{alone}");
    }

    #[test]
    fn events_before_a_training_name_the_options() {
        let limit = MemoryLimit { wanted: NEED, budget: 1 << 20, fits: 100 };
        assert_eq!(
            crate::advice::event(&Event::Limited(&limit)),
            "warning: 500 Gaussians would need 3 MiB of device memory, and 1 MiB is there (`--gpu-memory`): their number stops at \
             100"
        );
        let network = SmallNetwork { factor: 0.5, size: [1600, 1064], whole: 0.1204 };
        assert_eq!(
            crate::advice::event(&Event::SmallNetwork(&network)),
            "note: the residual network runs at 0.5 of the image's size; at the whole size a frame of 1600 x 1064 pixels would take \
             about 120 ms on this adapter; `--residual-factor 1` runs it there"
        );
        let mut preparation = Preparation {
            training_views: 9,
            test_views: 2,
            points: 500,
            shown: 400,
            init: None,
            iterations: 60,
            folder: Some("output/a".into()),
            at_start: NEED,
            at_most: Some(Need { gaussians: 900, bytes: 6 << 20 }),
        };
        let views = "9 training views, 2 test views, 500 initial points (400 within the training views), 60 iterations; \
                     writing to output/a\nmemory: needs about 3 MiB at 500 Gaussians";
        let said = crate::advice::event(&Event::Prepared(&preparation));
        assert_eq!(said, format!("{views}, 6 MiB at 900 (`--max-splats`)"));
        preparation.at_most = None;
        assert_eq!(crate::advice::event(&Event::Prepared(&preparation)), views);
        preparation.init = Some("a.ply".into());
        let said = crate::advice::event(&Event::Prepared(&preparation));
        assert!(
            said.starts_with("9 training views, 2 test views, 500 Gaussians of a.ply to begin with, 60 it"),
            "{said}"
        );
        for (seconds, words) in [(700.0, "12 minutes"), (8_000.0, "2 hours"), (400_000.0, "5 days")] {
            let said = crate::advice::event(&Event::Slow { adapter: "llvmpipe", seconds });
            let begins = format!(
                "note: llvmpipe is no GPU but computes on the processor: this training will take about {words};"
            );
            assert!(said.starts_with(&begins) && said.contains("`--iterations 500`"), "{said}");
        }
        let resuming = Event::Resuming { iteration: 7, iterations: 60 };
        assert_eq!(crate::advice::event(&resuming), "resuming from iteration 7 of 60");
    }
}
