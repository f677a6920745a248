//! Each kernel against its twin.

mod adam;
mod compose;
mod densify;
mod features;
mod image_loss;
mod network;
mod rasterize;
mod scan_sort;
