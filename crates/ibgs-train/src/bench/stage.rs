//! The stages that the bench measures.

use ibgs_shaders::Kernel;
use serde::{Deserialize, Serialize};

/// What is measured as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Work {
    /// A frame of the base colour alone.
    BaseFrame,
    /// A frame of the final colour; the depth maps of its sources are there already.
    WarmFrame,
    /// A frame of the final colour with the depth maps of its sources.
    ColdFrame,
    /// A training iteration of `3dgs`.
    BaseIteration,
    /// A training iteration of `ibgs` with every loss and the network at work.
    FinalIteration,
}

use Stage::*;
pub use ibgs_shaders::KernelStage as Stage;

impl Work {
    /// All of them.
    pub const ALL: [Work; 5] =
        [Work::BaseFrame, Work::WarmFrame, Work::ColdFrame, Work::BaseIteration, Work::FinalIteration];

    /// What it is called in tables.
    pub fn title(self) -> &'static str {
        match self {
            Work::BaseFrame => "base frame",
            Work::WarmFrame => "final frame, depth maps of the sources kept",
            Work::ColdFrame => "final frame, depth maps of the sources rendered again",
            Work::BaseIteration => "3dgs iteration",
            Work::FinalIteration => "ibgs iteration",
        }
    }

    /// Whether surface, sources and network take part.
    pub fn is_image_based(self) -> bool {
        !matches!(self, Work::BaseFrame | Work::BaseIteration)
    }

    /// Whether it is a frame, which nobody trains on.
    pub fn is_frame(self) -> bool {
        self == Work::BaseFrame || self.is_final_frame()
    }

    /// Whether it ends with a final image that nobody trains on.
    pub fn is_final_frame(self) -> bool {
        matches!(self, Work::WarmFrame | Work::ColdFrame)
    }

    /// Its stages in order.
    pub fn stages(self) -> Vec<Stage> {
        let frame: &[Stage] = &[Project, Sort, Planes, Blend, Warp];
        let network: &[Stage] = &[Features, UNet, Compose];
        match self {
            Work::BaseFrame => vec![Project, Sort, Blend],
            Work::WarmFrame => [frame, network].concat(),
            Work::ColdFrame => [&[DepthMaps], frame, network].concat(),
            Work::BaseIteration => {
                vec![Project, Sort, Blend, ImageLoss, ImageLossBackward, BlendBackward, ProjectBackward, Adam]
            }
            Work::FinalIteration => {
                let losses = [NormalLoss, PhotometricLoss, ImageLoss, ImageLossBackward, NormalLossBackward];
                let back = [PhotometricLossBackward, ComposeBackward, UNetWeights, UNetBackward];
                let last = [FeaturesBackward, WarpBackward, BlendBackward, PlanesBackward, ProjectBackward, Adam];
                [frame, network, &losses, &back, &last].concat()
            }
        }
    }
}

/// The stage that a kernel has in a pass: its own but where kernels serve several.
pub fn stage_of(pass: &str, kernel: &Kernel) -> Stage {
    match (pass, kernel.stage) {
        ("depth map", _) => DepthMaps,
        ("residual backward", UNet) => UNetBackward,
        ("normal loss", Other) => NormalLoss,
        ("photometric loss", Other) => PhotometricLoss,
        (_, stage) => stage,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_told_apart_and_every_stage_of_an_iteration_is_listed_once() {
        for work in Work::ALL {
            let names: Vec<_> = work.stages().into_iter().map(Stage::name).collect();
            let distinct: std::collections::BTreeSet<_> = names.iter().collect();
            assert_eq!(distinct.len(), names.len(), "{work:?}");
        }
        assert_eq!(stage_of("residual", &ibgs_shaders::RESIDUAL_CONV), UNet);
        assert_eq!(stage_of("residual backward", &ibgs_shaders::RESIDUAL_CONV), UNetBackward);
        assert_eq!(stage_of("residual backward", &ibgs_shaders::RESIDUAL_HEAD_WEIGHTS), UNetWeights);
        assert_eq!(stage_of("residual backward", &ibgs_shaders::HALF_SUM), UNetWeights);
        assert_eq!(stage_of("residual backward", &ibgs_shaders::HALF_CONV), UNetBackward);
        assert_eq!(stage_of("residual backward", &ibgs_shaders::HALF_FEATURES_BACKWARD), FeaturesBackward);
        assert_eq!(stage_of("rasterize backward", &ibgs_shaders::SUM_ROWS_SURFACE), ProjectBackward);
        assert_eq!(stage_of("depth map", &ibgs_shaders::PROJECT), DepthMaps);
        assert_eq!(stage_of("photometric loss", &ibgs_shaders::LOSS_MEAN), PhotometricLoss);
        assert_eq!(stage_of("shape normals", &ibgs_shaders::SHORTEST_AXIS), Other);
    }
}
