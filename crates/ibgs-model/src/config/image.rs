//! How a run's views are rendered.

use super::TrainConfig;
use crate::raster::SurfaceOptions;
use crate::render::ImageOptions;
use crate::residual::{Factor, Precision, Variant};
use crate::sources::Reach;

impl TrainConfig {
    /// How the photos of neighbouring views are used.
    pub fn image_options(&self) -> ImageOptions {
        let residual = &self.residual;
        ImageOptions {
            sources: self.sources.clone(),
            surface: SurfaceOptions { intersections: self.surface.intersections, ..SurfaceOptions::default() },
            variant: Variant {
                output: residual.output(),
                aggregation: residual.aggregation,
                factor: Factor::of(residual.factor()),
                reach: if self.data.shows_object() { Reach::Seen } else { Reach::Everywhere },
            },
            // Which precision pays is found by a clock.
            precision: if self.deterministic { Precision::Full } else { residual.precision },
            source_share: residual.source_share as f32,
        }
    }
}
