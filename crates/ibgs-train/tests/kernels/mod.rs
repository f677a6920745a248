//! Each kernel against its twin. A module has the name of its kernel, or of the beginning that several kernels share; the
//! contract test looks for it. Those of a loss are in its own file.

mod adam;
mod bench;
mod camera;
mod densify;
mod expose;
mod finite;
mod growth;
mod half;
mod image_loss;
mod loss_mean;
mod mcmc;
mod opacity_reset;
mod present;
mod project;
mod rasterize;
mod rasterize_surface_image;
mod residual;
mod transient;
mod warp;
