//! The loss of an iteration.

use super::Trainer;
use super::iteration::Rendered;
use crate::loss::{LossInputs, LossScratch, WarpedSources};
use crate::stages::{FinalImage, FromSources, Work};
use burn::tensor::Tensor;
use ibgs_core::gpu::pool::Lease;
use ibgs_core::gpu::{GpuError, Pass};
use std::sync::Arc;

/// The whole loss of an iteration. burn adds its parts only when all are [submitted](ibgs_core::gpu::flush).
pub(super) struct Total {
    /// L_img of the base image.
    base_loss: Tensor<1>,
    /// L_img of the final image.
    final_loss: Option<Tensor<1>>,
    /// Those beside the image loss.
    others: Vec<Tensor<1>>,
    /// Statistics of the image that counts: the final one where there is one.
    pub scratch: Arc<Lease<LossScratch>>,
    /// The network's weights as a leaf, where the loss depends on them.
    pub network: Option<Tensor<1>>,
    /// The sources, where something read them.
    pub warped: Option<WarpedSources>,
}

impl Total {
    /// The sum of all losses.
    pub fn loss(&self) -> Tensor<1> {
        let image_loss = match &self.final_loss {
            Some(final_loss) => (self.base_loss.clone() + final_loss.clone()) * 0.5,
            None => self.base_loss.clone(),
        };
        match self.others.iter().cloned().reduce(|sum, loss| sum + loss) {
            Some(others) => image_loss + others,
            None => image_loss,
        }
    }
}

impl Trainer {
    /// The whole loss, of which L_img(base) is always a part.
    pub(super) fn total(&mut self, rendered: &Rendered) -> Result<Total, GpuError> {
        let Rendered { shown, forward, image, target, .. } = rendered;
        let (base_loss, mut scratch) = self.loss.tracked(shown.clone(), target)?;
        let FromSources { warped, final_image } = self.read_sources(rendered)?;
        let (mut final_loss, mut network) = (None, None);
        let mut final_target = target.clone();
        if let Some(FinalImage { image, rows, network: leaf }) = &final_image {
            if let Some(rows) = rows {
                let mut copy = Pass::new(&self.gpu, "rows of a photo");
                final_target = target.of_rows(&self.gpu, &mut copy, rows)?;
                copy.submit();
            }
            let (loss, statistics) = self.loss.tracked(image.clone(), &final_target)?;
            (final_loss, network, scratch) = (Some(loss), Some(leaf.clone()), statistics);
        }
        let inputs = LossInputs {
            iteration: self.iteration,
            schedule: &self.schedule,
            target,
            image,
            shown,
            surface: forward.surface().map(|surface| &***surface),
            cameras: forward.cameras.as_ref(),
            warped: warped.as_ref(),
            final_image: final_image.as_ref().map(|made| (&made.image, &final_target)),
        };
        let others = self.losses.iter().filter_map(|loss| loss.of(&inputs).transpose()).collect::<Result<_, _>>()?;
        Ok(Total { base_loss, final_loss, others, scratch, network, warped })
    }

    /// What the sources give the iteration; nothing for a method without.
    fn read_sources(&mut self, rendered: &Rendered) -> Result<FromSources, GpuError> {
        let Some(stages) = &mut self.stages else {
            return Ok(FromSources::default());
        };
        stages.read_sources(&Work {
            iteration: self.iteration,
            index: rendered.index,
            image: &rendered.image,
            shown: &rendered.shown,
            exposures: rendered.exposures.as_ref(),
            sources: &rendered.sources,
            warps: self.losses.iter().any(|loss| loss.reads_sources(self.iteration, &self.schedule)),
            forward: &rendered.forward,
            schedule: &self.schedule,
            photos: &self.photos,
            raster: &self.raster,
            splats: self.parameters.splats(),
        })
    }
}
