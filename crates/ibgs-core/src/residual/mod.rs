//! The residual network (method.md section 6).

pub mod hourglass;
pub mod layers;

pub use hourglass::Hourglass;
