//! Errors that another one passes on unchanged: what is said of them is said of the inner one.

use super::{AnyError, start};
use ibgs_core::blocks::PlanError;
use ibgs_core::eval::EvalError;
use ibgs_core::model::ModelError;
use ibgs_core::output::OutputError;
use ibgs_core::output::pictures::RenderError;
use ibgs_train::TrainError;
use ibgs_train::lpips::LpipsError;
use ibgs_train::session::SessionError;

/// The error that another one passes on unchanged.
pub(super) fn passed_on(error: AnyError) -> Option<AnyError> {
    None.or_else(|| in_model(error.downcast_ref()?))
        .or_else(|| in_session(error.downcast_ref()?))
        .or_else(|| in_session(error.downcast_ref::<Box<SessionError>>()?))
        .or_else(|| start::passed_on(error.downcast_ref()?))
        .or_else(|| in_training(error.downcast_ref()?))
        .or_else(|| in_evaluation(error.downcast_ref()?))
        .or_else(|| in_lpips(error.downcast_ref()?))
        .or_else(|| match error.downcast_ref()? {
            RenderError::Gpu(error) => Some(error as AnyError),
            RenderError::Write(error) => Some(error),
        })
        .or_else(|| match error.downcast_ref()? {
            OutputError::Config(error) => Some(error as AnyError),
            _ => None,
        })
        .or_else(|| match error.downcast_ref()? {
            PlanError::Config(error) => Some(error as AnyError),
            PlanError::Write(error) => Some(error),
            _ => None,
        })
}

fn in_model(error: &ModelError) -> Option<AnyError<'_>> {
    match error {
        ModelError::Folder(error) => Some(error),
        ModelError::Network(error) => Some(error),
        ModelError::Scene(error) => Some(error),
        ModelError::Gpu(error) => Some(error),
        _ => None,
    }
}

fn in_session(error: &SessionError) -> Option<AnyError<'_>> {
    match error {
        SessionError::Train(error) => Some(error),
        SessionError::Gpu(error) => Some(error),
        SessionError::Eval(error) => Some(error),
        SessionError::Output(error) => Some(error),
        SessionError::Network(error) => Some(error),
        SessionError::Checkpoint(error) => Some(error),
        _ => None,
    }
}

fn in_training(error: &TrainError) -> Option<AnyError<'_>> {
    match error {
        TrainError::Gpu(error) => Some(error),
        TrainError::Network(error) => Some(error),
        TrainError::Checkpoint(error) => Some(error),
        _ => None,
    }
}

fn in_evaluation(error: &EvalError) -> Option<AnyError<'_>> {
    match error {
        EvalError::Gpu(error) => Some(error),
        EvalError::Photo(error) => Some(error),
        EvalError::Write(error) => Some(error),
        EvalError::Distance(error) => Some(&**error),
    }
}

fn in_lpips(error: &LpipsError) -> Option<AnyError<'_>> {
    match error {
        LpipsError::File(error) => Some(error),
        LpipsError::Gpu(error) => Some(error),
        _ => None,
    }
}
