//! What a session writes.

use super::{Due, Event, ExposureSummary, Observer, Result, Session, SessionError, Summary};
use crate::checkpoint::Checkpoint;
use ibgs_core::config::Method;
use ibgs_core::eval::Score;
use ibgs_core::eval::fitted::fitted_views;
use ibgs_core::eval::scores::{protocol, score_test_views};
use ibgs_core::exposure::{Exposure, ExposureField};
use ibgs_core::output::OutputFolder;
use ibgs_core::output::figures::TIME_FILE;
use ibgs_core::output::log::Evaluation;
use ibgs_core::output::results::{ViewScore, means};
use ibgs_core::render::Renderer;
use ibgs_core::residual::weights;
use ibgs_core::scene::{Gaussians, PlyFlavor, write_ply};
use serde_json::json;
use std::fs;
use std::iter;
use std::path::PathBuf;

/// What a model folder gets of a member of an ensemble; a model of one base is its first.
struct Member {
    gaussians: Gaussians,
    network: Option<Vec<f32>>,
    exposure: Option<Vec<Exposure>>,
}

impl Member {
    /// That of a checkpoint.
    fn kept(member: &Checkpoint) -> Self {
        let network = member.network.as_ref().map(|network| network.weights.clone());
        Self { gaussians: member.gaussians.clone(), network, exposure: member.exposures() }
    }

    /// That of a renderer.
    fn on_device(renderer: &Renderer) -> Result<Self> {
        let gpu = renderer.gpu();
        let network = renderer.part().map(|part| part.network.to_values(gpu)).transpose()?;
        let exposure = renderer.exposure().map(|field| field.photos().to_vec());
        Ok(Self { gaussians: renderer.splats().download(gpu)?, network, exposure })
    }
}

impl Session {
    /// Saves and measures. What cannot be written is a warning while the training goes on: it is sound, and the next time may be
    /// another.
    pub(super) fn do_due(&mut self, due: Due, observer: &mut dyn Observer) -> Result<()> {
        let settle = |result: Result<()>, observer: &mut dyn Observer| match result {
            Err(error) if !due.ends && error.is_unwritten() => {
                observer.event(&Event::NotSaved { error: &error });
                Ok(())
            }
            result => result,
        };
        if due.save || due.evaluate {
            let adopted = self.adopt_cameras().map_err(SessionError::from);
            let has_cameras = adopted.is_ok();
            settle(adopted, observer)?;
            // Gaussians never stand beside the cameras of an earlier iteration.
            if !has_cameras {
                return Ok(());
            }
        }
        if due.save {
            // Wait for a checkpoint that is being written: on a small disk its temporary file could take the space
            // needed here.
            self.checkpoints.wait(observer);
            settle(self.save().map(drop), observer)?;
        }
        if due.evaluate {
            settle(self.evaluate(observer), observer)?;
        }
        match &self.folder {
            Some(folder) => settle(folder.write_log(&self.records.log).map_err(SessionError::from), observer),
            None => Ok(()),
        }
    }

    /// Saves what there is after an error, and says where it went.
    pub(super) fn rescue(&mut self, error: SessionError, observer: &mut dyn Observer) -> SessionError {
        // If this fails, the last good state is saved: a lost device returns nothing, and a state that is not finite
        // cannot be resumed from.
        let _ = self.keep();
        let (Some(checkpoint), Some(folder)) = (self.checkpoints.last().cloned(), self.folder.clone()) else {
            return error;
        };
        let members: Vec<Member> = iter::once(&*checkpoint).chain(&checkpoint.members).map(Member::kept).collect();
        let adopted = self.adopt_cameras().map_err(SessionError::from);
        let saved = adopted.and_then(|()| self.write(&folder, checkpoint.iteration(), &members));
        // Without the curves the error is reported all the same.
        if saved.is_ok() {
            let _ = folder.write_log(&self.records.log);
        }
        let resumed = self.checkpoints.write(observer);
        if saved.is_err() && resumed.is_err() {
            return error;
        }
        let checkpoint = resumed.ok().map(|()| checkpoint.iteration());
        let folder = folder.root().to_owned();
        SessionError::Stopped { source: Box::new(error), folder, saved: saved.ok(), checkpoint }
    }

    /// Writes the model as it is now into the model folder; returns where. None without a folder.
    ///
    /// # Errors
    /// The device failed, or a file cannot be written.
    pub fn save(&mut self) -> Result<Option<PathBuf>> {
        let Some(folder) = &self.folder else { return Ok(None) };
        let renderer = self.trainer.renderer()?;
        let members =
            iter::once(&renderer).chain(renderer.members()).map(Member::on_device).collect::<Result<Vec<_>>>()?;
        // Data read from a lost device looks like any other result.
        self.raster.gpu().check()?;
        self.write(folder, self.trainer.iteration(), &members).map(Some)
    }

    fn write(&self, folder: &OutputFolder, iteration: u32, members: &[Member]) -> Result<PathBuf> {
        let residual = self.trainer.schedule().residual_at(iteration);
        let path = folder.point_cloud_path(iteration);
        // The Gaussians of the first last: a folder holds a model once it holds them, and never one without its network or exposures.
        let written = || -> Result<()> {
            if let Some(masks) = self.trainer.masks() {
                folder.write_transients(iteration, &self.dataset, masks.iter().map(|mask| &**mask))?;
            }
            for (index, member) in members.iter().enumerate().rev() {
                let number = index + 1;
                let network = member.network.as_ref().filter(|_| residual);
                if let Some(network) = network {
                    weights::write(&folder.network_save_path(iteration, number), network)?;
                }
                if let Some(photos) = &member.exposure {
                    folder.write_exposures((iteration, number), &self.dataset, photos)?;
                }
                // Without planes the file is exactly what other programs write and read.
                let planes = network.is_some() || number == 1 && self.config.method == Method::Ibgs;
                let flavor = if planes { PlyFlavor::Full } else { PlyFlavor::Plain };
                write_ply(&folder.member_path(iteration, number), &member.gaussians, flavor)?;
            }
            Ok(())
        };
        if let Err(error) = written() {
            // Without them the other files are of no use.
            if let Some(folder) = path.parent().filter(|_| !path.is_file()) {
                let _ = fs::remove_dir_all(folder);
            }
            return Err(error);
        }
        Ok(path)
    }

    /// Renders the held-out views and scores them.
    fn evaluate(&mut self, observer: &mut dyn Observer) -> Result<()> {
        let iteration = self.trainer.iteration();
        if self.dataset.test.is_empty() {
            return Ok(());
        }
        let renderer = self.trainer.renderer()?;
        let into = self.folder.as_ref().map(|folder| (folder, iteration));
        let mut scores = score_test_views(&renderer, &self.dataset, &self.config, into, None, &mut |_, _| {})?;
        if self.loaded_cameras.is_some() && self.is_done() {
            scores.fitted = fitted_views(&renderer, &self.dataset, &self.config, &mut |_| {})?;
        }
        if let Some(folder) = &self.folder {
            scores.write(folder, iteration, &protocol(&self.config, &self.dataset, self.raster.gpu()))?;
        }
        let gaussians = self.trainer.splats().len();
        let iteration_time = self.records.watch.total() / iteration.max(1);
        observer.event(&Event::Evaluated { iteration, gaussians, scores: &scores, iteration_time });
        let mean = |scores: &[ViewScore]| -> Option<Score> { (!scores.is_empty()).then(|| means(scores)) };
        let measured = |base| Evaluation { iteration, gaussians, base, image: mean(&scores.image) };
        self.records.evaluations.extend(mean(&scores.base).map(measured));
        Ok(())
    }

    /// Saves, measures and reports what there is: called once, after the last iteration or when the training is stopped
    /// before. [`Session::run`] does.
    ///
    /// # Errors
    /// The device failed, or a file cannot be written.
    pub fn finish(&mut self, observer: &mut dyn Observer) -> Result<()> {
        let iteration = self.trainer.iteration();
        if iteration == 0 {
            return Ok(());
        }
        let is_whole = self.is_done();
        // The checkpoint comes first, because the rest takes a while.
        let kept = if is_whole { Ok(()) } else { self.keep().and_then(|()| self.checkpoints.write(observer)) };
        // One that was stopped in between, or before it was saved.
        let save = self.folder.as_ref().is_some_and(|folder| !folder.point_cloud_path(iteration).is_file());
        let evaluate = self.records.evaluations.last().is_none_or(|last| last.iteration != iteration);
        let done = self.do_due(Due { save, evaluate, ends: true, ..Due::default() }, observer);
        match (&kept, &self.folder) {
            (Ok(()), Some(folder)) if !is_whole => {
                let folder = folder.root().to_owned();
                done.map_err(|error| SessionError::OnlyCheckpoint { iteration, folder, source: Box::new(error) })?
            }
            _ => done?,
        }
        if self.trainer.overflowed() {
            observer.event(&Event::Overflowed);
        }
        self.write_time()?;
        let corrected =
            |field: ExposureField| ExposureSummary::Corrected { spread: field.spread(), predicted: field.trust() };
        let exposure = self.trainer.exposure()?.map_or(ExposureSummary::Off, corrected);
        let training = self.records.watch.total();
        let resumable = self.folder.as_ref().filter(|_| !is_whole && kept.is_ok());
        observer.event(&Event::Finished(&Summary {
            iteration,
            length: is_whole.then(|| self.config.length_reason(self.dataset.train.len())).flatten(),
            training,
            beside: (self.started.elapsed() + self.before).saturating_sub(training),
            gaussians: self.trainer.splats().len(),
            stages: self.records.watch.sentence(),
            exposure,
            cameras: self.camera_summary(),
            transients: self.transient_summary(),
            resumable: resumable.map(|folder| folder.root().to_owned()),
        }));
        if is_whole { self.checkpoints.clear() } else { kept }
    }

    /// Writes how long the training took, for its figures.
    fn write_time(&self) -> Result<()> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let time = json!({
            "seconds": self.records.watch.total().as_secs_f64(),
            "iterations": self.trainer.iteration(),
            "stages": self.records.watch.json(),
            "device": self.raster.gpu().describe(),
            "commands": self.records.commands,
        });
        Ok(folder.write_result(self.trainer.iteration(), TIME_FILE, time)?)
    }
}
