//! The stages that the bench measures, and the kernels that each is made of.

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

/// A part of the work with a floor of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Median depth maps of the sources, each with its own projection and sort.
    DepthMaps,
    /// Culling, projection, colour.
    Project,
    /// Prefix sum, tile intersections, lists of the tiles, each by depth.
    Sort,
    /// Planes in camera space.
    Planes,
    /// Alpha blending, with the surface where there is one.
    Blend,
    /// Colours of the sources at the median intersections.
    Warp,
    /// Features and per-view MLP.
    Features,
    /// The U-Net.
    UNet,
    /// Base colour and residual to the final colour.
    Compose,
    /// L1 and SSIM, of base and final image.
    ImageLoss,
    /// Depth normals against the normal map.
    NormalLoss,
    /// SSIM of photo and warped photos.
    PhotometricLoss,
    /// Gradient of the image loss.
    ImageLossBackward,
    /// Gradient of the normal loss.
    NormalLossBackward,
    /// Gradient of the photometric loss.
    PhotometricLossBackward,
    /// Gradient of the composition, and of the colour map.
    ComposeBackward,
    /// Gradient of the U-Net by activations.
    UNetBackward,
    /// Gradient of the U-Net by weights.
    UNetWeights,
    /// Gradient of features and MLP by inputs and weights.
    FeaturesBackward,
    /// Gradient of the warping.
    WarpBackward,
    /// Gradient of the blending.
    BlendBackward,
    /// Gradient of the planes.
    PlanesBackward,
    /// Gradient of the projection.
    ProjectBackward,
    /// Adam for Gaussians and network.
    Adam,
    /// A kernel that belongs to none of the stages above.
    Other(&'static str),
}

use Stage::*;

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

impl Stage {
    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            DepthMaps => "depth maps of the sources",
            Project => "project",
            Sort => "sort",
            Planes => "planes",
            Blend => "blend",
            Warp => "warp",
            Features => "features",
            UNet => "unet",
            Compose => "compose",
            ImageLoss => "image loss",
            NormalLoss => "normal loss",
            PhotometricLoss => "photometric loss",
            ImageLossBackward => "image loss backward",
            NormalLossBackward => "normal loss backward",
            PhotometricLossBackward => "photometric loss backward",
            ComposeBackward => "compose backward",
            UNetBackward => "unet backward",
            UNetWeights => "unet weights",
            FeaturesBackward => "features backward",
            WarpBackward => "warp backward",
            BlendBackward => "blend backward",
            PlanesBackward => "planes backward",
            ProjectBackward => "project backward",
            Adam => "adam",
            Other(kernel) => kernel,
        }
    }

    /// The stage of a kernel in a pass. A kernel of the residual's passes that is not known by its name counts as one
    /// of the U-Net.
    pub fn of(pass: &'static str, kernel: &'static str) -> Self {
        match (pass, kernel) {
            ("depth map", _) => DepthMaps,
            ("image loss", _) => ImageLoss,
            ("image loss backward", _) => ImageLossBackward,
            ("normal loss", _) => NormalLoss,
            ("normal loss backward", _) => NormalLossBackward,
            ("photometric loss", _) => PhotometricLoss,
            ("photometric loss backward", _) => PhotometricLossBackward,
            ("warp", _) => Warp,
            ("warp backward", _) => WarpBackward,
            (_, "adam") => Adam,
            (_, "project" | "project_half") => Project,
            (_, "planes") => Planes,
            (_, "rasterize" | "rasterize_surface" | "rasterize_surface_image") => Blend,
            (_, "rasterize_backward" | "rasterize_surface_backward") => BlendBackward,
            (_, "planes_backward") => PlanesBackward,
            (_, "project_backward" | "sum_rows" | "sum_rows_surface") => ProjectBackward,
            ("rasterize", _) => Sort,
            ("residual", "residual_features" | "residual_features_half" | "half_features") => Features,
            ("residual", "residual_compose" | "residual_mix") => Compose,
            ("residual", _) => UNet,
            ("residual backward", "residual_compose_backward") => ComposeBackward,
            ("residual backward", kernel) if kernel.starts_with("residual_features") => FeaturesBackward,
            ("residual backward", "residual_inputs_backward" | "half_features_backward") => FeaturesBackward,
            (
                "residual backward",
                "residual_conv_weights"
                | "residual_head_weights"
                | "residual_sum"
                | "half_conv_weights"
                | "half_linear_weights"
                | "half_sum",
            ) => UNetWeights,
            ("residual backward", _) => UNetBackward,
            (_, kernel) => Other(kernel),
        }
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
        assert_eq!(Stage::of("residual", "residual_conv"), UNet);
        assert_eq!(Stage::of("residual backward", "residual_conv"), UNetBackward);
        assert_eq!(Stage::of("residual backward", "residual_head_weights"), UNetWeights);
        assert_eq!(Stage::of("residual backward", "half_sum"), UNetWeights);
        assert_eq!(Stage::of("residual backward", "half_conv"), UNetBackward);
        assert_eq!(Stage::of("residual backward", "half_features_backward"), FeaturesBackward);
        assert_eq!(Stage::of("rasterize backward", "sum_rows_surface"), ProjectBackward);
        assert_eq!(Stage::of("depth map", "project"), DepthMaps);
        assert_eq!(Stage::of("shape normals", "shortest_axis"), Other("shortest_axis"));
    }
}
