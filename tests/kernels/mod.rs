//! Each kernel against its twin. A module has the name of its kernel, or of the beginning that several kernels share; the
//! contract test looks for it.

mod adam;
mod bench;
mod densify;
mod depth_normals;
mod expose;
mod filter;
mod finite;
mod growth;
mod half;
mod image_loss;
mod launch;
mod loss_mean;
mod mcmc;
mod network;
mod normal_loss;
mod opacity_reset;
mod photometric_loss;
mod plane_sweep;
mod planes;
mod present;
mod project;
mod rasterize;
mod rasterize_ellipsoids;
mod rasterize_surface_image;
mod residual;
mod residual_compose;
mod residual_features;
mod residual_mix;
mod scan;
mod shortest_axis;
mod sum_rows;
mod tile;
mod tile_emit;
mod tile_sort;
mod warp;
