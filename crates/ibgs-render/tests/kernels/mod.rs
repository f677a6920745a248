//! Each kernel against its twin. A module has the name of its kernel, or of the beginning that several kernels share;
//! the contract test looks for it here and beside the training.

mod launch;
mod network;
mod plane_sweep;
mod planes;
mod rasterize_ellipsoids;
mod residual_compose;
mod residual_features;
mod residual_mix;
mod scan;
mod shortest_axis;
mod sum_rows;
mod tile;
mod tile_emit;
mod tile_sort;
mod weighted_sum;
