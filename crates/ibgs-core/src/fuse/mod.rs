//! What the photos of neighbouring training views tell about a target view (method.md sections 4, 5 and 8).

mod exposure;

pub use exposure::ExposureFit;
