//! Variants of a kernel's behaviour, chosen by a number in its immediate data. Each is one enum for the host, from
//! which the constants of the WGSL are generated.

use serde::{Deserialize, Serialize};

/// Makes the enums and the list of their constants.
macro_rules! choices {
    ($($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $constant:ident,)* })*) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            #[repr(u32)]
            pub enum $name {
                $($(#[$variant_doc])* #[doc = concat!("In WGSL `", stringify!($constant), "`.")] $variant,)*
            }
        )*

        /// Name in WGSL and number of every variant.
        pub(crate) const CONSTANTS: &[(&str, u32)] = &[$($((stringify!($constant), $name::$variant as u32),)*)*];
    };
}

choices! {
    /// How a convolution of the U-Net reads its input.
    ConvInput {
        /// The input has the size of the output.
        Same = CONV_SAME,
        /// The input is the maximum of 2 x 2 of the source; an odd last row or column is left out.
        Pooled = CONV_POOLED,
        /// The input is the nearest of a smaller source: source = floor(target * source size / target size).
        Nearest = CONV_NEAREST,
    }

    /// What a convolution does with its sums.
    Store {
        /// The bias is added, and what is negative becomes zero.
        Relu = STORE_RELU,
        /// They replace what is there.
        Assign = STORE_ASSIGN,
        /// They are added to what is there.
        Add = STORE_ADD,
        /// The output holds the activation whose gradient this is; the gradient takes its place where it is positive.
        Mask = STORE_MASK,
    }

    /// What the residual network gives.
    #[derive(Default, Serialize, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    Output {
        /// A residual that is added to the base colour.
        #[default]
        Residual = OUTPUT_RESIDUAL,
        /// A residual, and a gate: how much of the sources' mean difference from the base colour is added too. The gate has the
        /// network's size, the difference is taken at the image's: fine detail then needs no network of that size.
        Gated = OUTPUT_GATED,
    }

    /// How the features of the visible sources become one.
    #[derive(Default, Serialize, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    Aggregation {
        /// Their mean.
        #[default]
        Mean = AGGREGATION_MEAN,
        /// Their mean weighted by a learned confidence, exp(l) of each source and 1 of none of them: where no source is
        /// trusted the features are zero. Sources count as far as five times the depth agreement.
        Soft = AGGREGATION_SOFT,
    }

    /// What `present.wgsl` shows.
    Presented {
        /// The values as they are.
        Colors = PRESENT_COLORS,
        /// 0.5 + gain (values - others).
        Residual = PRESENT_RESIDUAL,
        /// One value a pixel in the palette, near bright.
        Depth = PRESENT_DEPTH,
        /// Unit vectors.
        Normal = PRESENT_NORMAL,
        /// The packed sources of the words, counted.
        Visibility = PRESENT_VISIBILITY,
        /// 0.5 + gain (values - the photo in the words).
        Difference = PRESENT_DIFFERENCE,
        /// The photo in the words.
        Photo = PRESENT_PHOTO,
        /// The same, grey but for what masks hide.
        Hidden = PRESENT_HIDDEN,
    }
}
