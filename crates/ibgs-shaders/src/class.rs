//! What the header of a kernel's file says of it.

/// Makes the enums with the names of their variants.
macro_rules! named {
    ($($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $text:literal,)* })*) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            pub enum $name {
                $($(#[$variant_doc])* $variant,)*
            }

            impl $name {
                /// All of them.
                pub const ALL: &[Self] = &[$(Self::$variant),*];

                /// Its name in the header of a kernel's file.
                pub fn name(self) -> &'static str {
                    match self {
                        $(Self::$variant => $text,)*
                    }
                }
            }
        )*
    };
}

named! {
    /// Who needs a kernel, and so what of a device it may use.
    KernelSet {
        /// Rendering, which keeps to the limits of a browser.
        Render = "render",
        /// Training, measurements, and frames on devices that have more than a browser's.
        Train = "train",
        /// The residual network in half precision, sums in float32, on [`MatrixUnits`](crate::MatrixUnits).
        Matrix = "matrix",
    }

    /// The part of a frame or of a training iteration that a kernel belongs to. A kernel of several passes has the stage of the
    /// first of them.
    KernelStage {
        /// Median depth maps of the sources.
        DepthMaps = "depth maps of the sources",
        /// Culling, projection, colour.
        Project = "project",
        /// Prefix sum, tile intersections, lists of the tiles, each by depth.
        Sort = "sort",
        /// Planes in camera space.
        Planes = "planes",
        /// Alpha blending, with the surface where there is one.
        Blend = "blend",
        /// Colours of the sources at the median intersections.
        Warp = "warp",
        /// Features and per-view MLP.
        Features = "features",
        /// The U-Net.
        UNet = "unet",
        /// Base colour and residual to the final colour.
        Compose = "compose",
        /// L1 and SSIM, of base and final image.
        ImageLoss = "image loss",
        /// Depth normals against the normal map.
        NormalLoss = "normal loss",
        /// SSIM of photo and warped photos.
        PhotometricLoss = "photometric loss",
        /// Gradient of the image loss.
        ImageLossBackward = "image loss backward",
        /// Gradient of the normal loss.
        NormalLossBackward = "normal loss backward",
        /// Gradient of the photometric loss.
        PhotometricLossBackward = "photometric loss backward",
        /// Gradient of the composition, and of the colour map.
        ComposeBackward = "compose backward",
        /// Gradient of the U-Net by activations.
        UNetBackward = "unet backward",
        /// Gradient of the U-Net by weights.
        UNetWeights = "unet weights",
        /// Gradient of features and MLP by inputs and weights.
        FeaturesBackward = "features backward",
        /// Gradient of the warping.
        WarpBackward = "warp backward",
        /// Gradient of the blending.
        BlendBackward = "blend backward",
        /// Gradient of the planes.
        PlanesBackward = "planes backward",
        /// Gradient of the projection.
        ProjectBackward = "project backward",
        /// Adam for Gaussians and network.
        Adam = "adam",
        /// None of these.
        Other = "other",
    }
}

impl KernelStage {
    /// Whether it is a part of the residual network, with its gradients.
    pub fn is_of_network(self) -> bool {
        match self {
            Self::Features | Self::UNet | Self::Compose => true,
            Self::ComposeBackward | Self::UNetBackward | Self::UNetWeights | Self::FeaturesBackward => true,
            Self::DepthMaps | Self::Project | Self::Sort | Self::Planes | Self::Blend | Self::Warp => false,
            Self::ImageLoss | Self::NormalLoss | Self::PhotometricLoss => false,
            Self::ImageLossBackward | Self::NormalLossBackward | Self::PhotometricLossBackward => false,
            Self::WarpBackward | Self::BlendBackward | Self::PlanesBackward | Self::ProjectBackward => false,
            Self::Adam | Self::Other => false,
        }
    }

    /// Whether a training of the base alone may need it.
    pub fn is_of_base(self) -> bool {
        match self {
            Self::Project | Self::Sort | Self::Blend | Self::ImageLoss | Self::Adam | Self::Other => true,
            Self::ImageLossBackward | Self::BlendBackward | Self::ProjectBackward => true,
            Self::DepthMaps | Self::Planes | Self::Warp | Self::NormalLoss | Self::PhotometricLoss => false,
            Self::NormalLossBackward | Self::PhotometricLossBackward => false,
            Self::WarpBackward | Self::PlanesBackward => false,
            Self::Features | Self::UNet | Self::Compose => false,
            Self::ComposeBackward | Self::UNetBackward | Self::UNetWeights | Self::FeaturesBackward => false,
        }
    }
}
