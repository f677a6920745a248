//! The residual network (method.md section 6).

pub mod layers;
pub mod variant;
