//! Each kernel against its twin.

mod adam;
mod bench_rates;
mod compose;
mod densify;
mod exposure;
mod features;
mod filter;
mod growth;
mod image_loss;
mod mcmc;
mod network;
mod normal_loss;
mod photometric_loss;
mod present;
mod rasterize;
mod scan_sort;
mod unet;
