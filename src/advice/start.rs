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
        BuildError::Gaussians(error) => Some(error),
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
    let BuildError::DoesNotFit(DoesNotFit { needed, budget, .. }) = error else { return None };
    Some(format!(
        "the training needs about {} of device memory at {} Gaussians, and {} is there (`--gpu-memory`)",
        Bytes(needed.bytes),
        needed.gaussians,
        Bytes(*budget)
    ))
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
        // It ends with the most Gaussians.
        Event::Prepared(preparation) if preparation.at_most.is_some() => {
            Some(format!("{preparation} (`--max-splats`)"))
        }
        _ => None,
    }
}
