//! Each kernel against its twin.

mod adam;
mod densify;
mod hourglass;
mod image_loss;
mod rasterize;
mod scan_sort;
