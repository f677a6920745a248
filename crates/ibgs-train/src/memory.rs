//! How much device memory a training takes, estimated before it begins.
//!
//! It counts the buffers of an iteration with everything at work, the buffers that burn keeps between iterations, and
//! what densification and evaluation need besides. Bytes are as the modules allocate them; where these change, the test
//! that compares the estimate with the allocator's report fails. With N Gaussians of C coefficients a channel, room for
//! I tile intersections, P pixels of the largest photo, T tiles, p pixels of the network, K medians, V visible sources,
//! M sources and `ibgs` (for `3dgs` the parts in braces fall away):
//!
//! | part | bytes |
//! |---|---|
//! | photos | 4 a pixel of all training photos, within `sources.memory` |
//! | Gaussians | (60 + 12 C) N |
//! | optimiser | (36 + 8 C {+ 12}) N, 16 N of statistics {, 8 a weight of the network} |
//! | gradients | (56 {+ 16}) N |
//! | raster | 56 N + 20 I + 48 {64} I + 16 T + 8 P {, 72 N + 20 I + 16 T + 8 P once more for depth maps} |
//! | images | 24 P, with exposures 48 P {+ 48 P + 64 V P} |
//! | surface | {16 N + (32 + 20 K) P} |
//! | network | {(912 + 76 + 2.25 + 16 + 16) p, 16 V p, 14 MB, 4 P, with exposures 32 V P} |
//! | losses | 36 P {twice, and 36 V P} |
//! | depth maps | {4 a pixel of all training photos, within `surface.depth-memory`} |
//! | what moves | 48 a cell of all training photos, where masks are learned |
//! | densification | the next model and its optimiser beside the last, while Gaussians may still be added |
//! | evaluation | {(608 + 16) p + (52 + 16 V + 4 M + 8 K) P, where there are views to evaluate} |
//!
//! With full moments the optimiser has 2 (44 + 12 C {+ 16}) N in place of the first. `p` are the pixels of a view at the
//! network's factor, in training with bands those of a band, b at the image's: then (32 + 32 V) b are added.
//!
//! The network's are those of float32, the most that any precision takes.

mod needs;

pub use needs::{DoesNotFit, MemoryLimit, Need, Needs};

use crate::optim::{moment_names, moment_words};
use ibgs_core::camera::Camera;
use ibgs_core::config::{ExposureSwitch, Method, TrainConfig, TransientSwitch};
use ibgs_core::dataset::CellMask;
use ibgs_core::residual::Factor;
use ibgs_core::residual::features::SUMS_BYTES;
use ibgs_core::residual::layers::{HALF, INPUT, QUARTER, WEIGHTS};
use ibgs_core::scene::PerGaussian;
use ibgs_core::sources::memory::MemoryBudget;
use ibgs_shaders::TILE;

/// Tile intersections of a Gaussian that trained scenes of about a megapixel do not exceed on average.
pub const INTERSECTIONS: u64 = 8;

/// What a training has to hold in memory.
#[derive(Clone, Copy, Debug)]
pub struct Demand<'a> {
    /// Its options.
    pub config: &'a TrainConfig,
    /// Degree of the spherical harmonics.
    pub sh_degree: u32,
    /// Cameras of the training views.
    pub cameras: &'a [Camera],
    /// Number of Gaussians.
    pub gaussians: u64,
    /// Tile intersections that there is room for.
    pub room: u64,
    /// Bytes that the photos may take; none: no limit.
    pub photo_budget: Option<u64>,
    /// Gaussians may still be added.
    pub grows: bool,
    /// Views are evaluated on the way.
    pub evaluates: bool,
}

impl Demand<'_> {
    /// The same training with more Gaussians: as many intersections for each as now, but not more than trained scenes
    /// have, and twice the room.
    pub fn grown_to(self, gaussians: u64) -> Self {
        // A training begins with room for four times the most that it counts.
        let counted = self.room / 4;
        let alike = (counted as f64 * gaussians as f64 / self.gaussians.max(1) as f64) as u64;
        let needed = alike.min(counted.max(INTERSECTIONS * gaussians));
        Self { gaussians, room: self.room.max(2 * needed + 1024), ..self }
    }
}

/// Buffers of one purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// What they belong to; a row of the module's table.
    pub part: &'static str,
    /// What one of them holds.
    pub what: &'static str,
    /// Bytes of one.
    pub bytes: u64,
    /// How many there are.
    pub buffers: u64,
}

/// The buffers of a training.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Estimate {
    parts: Vec<Part>,
}

/// Sizes that the parts are made of.
struct Sizes {
    n: u64,
    coefficients: u64,
    room: u64,
    pixels: u64,
    tiles: u64,
    /// Pixels of a band of a view's rows; 0: iterations make the final image of whole views.
    band: u64,
    /// Width and height of the network's images, of a band and of a view.
    low: [[u64; 2]; 2],
    medians: u64,
    visible: u64,
    sources: u64,
}

impl Sizes {
    fn of(demand: &Demand) -> Self {
        let config = demand.config;
        let factor = Factor::of(config.residual.factor());
        let largest = |of: &dyn Fn(&Camera) -> u64| demand.cameras.iter().map(of).max().unwrap_or(0);
        let area = |size: [u32; 2]| u64::from(size[0]) * u64::from(size[1]);
        let widest = demand.cameras.iter().max_by_key(|c| area([c.width, c.height]));
        let whole = widest.map_or([0; 2], |c| [c.width, c.height]);
        let (bands, rows) = config.residual.bands_of(whole[1]);
        let band = [whole[0], rows];
        Self {
            n: demand.gaussians,
            coefficients: u64::from(demand.sh_degree + 1).pow(2),
            room: demand.room,
            pixels: largest(&|c| area([c.width, c.height])),
            tiles: largest(&|c| area([c.width.div_ceil(TILE), c.height.div_ceil(TILE)])),
            band: if bands > 1 { area(band) } else { 0 },
            low: [band, whole].map(|size| factor.size(size).map(u64::from)),
            medians: config.surface.intersections.into(),
            visible: config.sources.visible.into(),
            sources: config.sources.used.into(),
        }
    }

    /// Values of a Gaussian by tensor.
    fn tensors(&self) -> PerGaussian<(&'static str, u64)> {
        let rows = PerGaussian::rows(self.coefficients as usize);
        PerGaussian::KEYS.zip(rows.map(|row| row as u64))
    }
}

impl Estimate {
    /// The buffers of a training.
    pub fn new(demand: &Demand) -> Self {
        let sizes = Sizes::of(demand);
        let image_based = demand.config.method == Method::Ibgs;
        let mut estimate = Self { parts: Vec::new() };
        estimate.add_kept("photos", "training photos", demand, demand.photo_budget);
        estimate.add_gaussians(&sizes, demand);
        for number in 2..=demand.config.ensemble() {
            estimate.add_member(&sizes, demand, number);
        }
        estimate.add_raster(&sizes, demand.config.method);
        estimate.add("images", "base image and its gradient", 12 * sizes.pixels, 2);
        if demand.config.exposure.enabled != ExposureSwitch::Off {
            estimate.add("images", "base image in the photo's exposure and its gradient", 12 * sizes.pixels, 2);
        }
        if demand.config.transients.mask != TransientSwitch::Off {
            let cells = |c: &Camera| CellMask::grid([c.width, c.height]).map(u64::from).iter().product::<u64>();
            let most = demand.cameras.iter().map(cells).max().unwrap_or(0);
            estimate.add("what moves", "evidence of what moves", 48 * most, demand.cameras.len() as u64);
        }
        estimate.add("losses", "SSIM moments", 36 * sizes.pixels, if image_based { 2 } else { 1 });
        for _ in 0..if image_based { demand.config.residual.networks } else { 0 } {
            estimate.add_image_part(&sizes, demand);
        }
        estimate
    }

    /// Adds what a member with a network has.
    fn add_image_part(&mut self, sizes: &Sizes, demand: &Demand) {
        self.add_surface(sizes);
        self.add_network(sizes, demand);
        let budget = match demand.config.surface.depth_memory {
            MemoryBudget::Bytes(bytes) => Some(bytes),
            MemoryBudget::Auto => demand.photo_budget,
            MemoryBudget::Unlimited => None,
        };
        self.add_kept("depth maps", "depth maps of the training views", demand, budget);
    }

    fn add(&mut self, part: &'static str, what: &'static str, bytes: u64, buffers: u64) {
        self.parts.push(Part { part, what, bytes, buffers });
    }

    /// Adds images of four bytes a pixel, one for each training view, within a budget.
    fn add_kept(&mut self, part: &'static str, what: &'static str, demand: &Demand, budget: Option<u64>) {
        let image = |c: &Camera| (4 * u64::from(c.width) * u64::from(c.height)).next_multiple_of(16);
        let all: u64 = demand.cameras.iter().map(image).sum();
        let largest = demand.cameras.iter().map(image).max().unwrap_or(0);
        // A view and its sources are there at the same time under any budget.
        let least = largest * (1 + u64::from(demand.config.sources.used)).min(demand.cameras.len() as u64);
        let kept = budget.map_or(all, |budget| all.min(budget.max(least)));
        self.add(part, what, largest, kept.div_ceil(largest.max(1)));
    }

    fn add_gaussians(&mut self, sizes: &Sizes, demand: &Demand) {
        let (n, grows, image_based) = (sizes.n, demand.grows, demand.config.method == Method::Ibgs);
        let gradients = PerGaussian::gradient_rows().zip(PerGaussian::with_gradients(image_based));
        for ((what, values), (gradient, trained)) in sizes.tensors().zip(gradients).into_array() {
            self.add("Gaussians", what, 4 * values * n, 1);
            self.add("gradients", what, 4 * gradient as u64 * n, u64::from(trained));
            self.add("densification", what, 4 * values * n, u64::from(grows));
            let moments = demand.config.adam.moments;
            let bytes = 4 * n * moment_words(moments, values as usize) as u64;
            let buffers = if trained { moment_names(moments).len() as u64 } else { 0 };
            self.add("optimiser", what, bytes, buffers);
            self.add("densification", what, bytes, if grows { buffers } else { 0 });
        }
        self.add("optimiser", "densification statistics", 16 * n, 1);
        if image_based {
            self.add("optimiser", "network", 4 * WEIGHTS as u64, 2);
        }
    }

    /// Adds a further member of an ensemble, whose passes run in the memory of the first.
    fn add_member(&mut self, sizes: &Sizes, demand: &Demand, number: u32) {
        let config = demand.config.of_member(number);
        let sh_degree = config.sh_degree();
        let sizes = Sizes { coefficients: u64::from(sh_degree + 1).pow(2), ..*sizes };
        self.add_gaussians(&sizes, &Demand { config: &config, sh_degree, ..*demand });
        self.add("images", "base image of a member, exposed, and the mean", 12 * sizes.pixels, 3);
    }

    fn add_raster(&mut self, sizes: &Sizes, method: Method) {
        let image_based = method == Method::Ibgs;
        let Sizes { n, room, pixels, tiles, .. } = *sizes;
        // The views whose depth maps are made have a workspace beside the iteration's.
        let workspaces = if image_based { 2 } else { 1 };
        self.add("raster", "projected Gaussians", 48 * n, workspaces);
        self.add("raster", "tile counts and offsets", 4 * n, 2 * workspaces);
        self.add("raster", "intersections", 4 * room, workspaces);
        self.add("raster", "tile lists before the sort", 8 * room, workspaces);
        self.add("raster", "tile lists", 4 * room, 2 * workspaces);
        self.add("raster", "intersection gradients", 16 * room, if image_based { 4 } else { 3 });
        self.add("raster", "tile ranges", 16 * tiles, workspaces);
        self.add("raster", "last contributors", 4 * pixels, 2 * workspaces);
        if image_based {
            self.add("raster", "planes of a depth map", 16 * n, 1);
        }
    }

    fn add_surface(&mut self, sizes: &Sizes) {
        let Sizes { n, pixels, medians, visible, .. } = *sizes;
        self.add("surface", "planes", 16 * n, 1);
        self.add("surface", "normal map and its gradient", 12 * pixels, 2);
        self.add("surface", "median depth and its gradient", 4 * pixels, 2);
        self.add("surface", "median intersections and their gradient", 8 * medians * pixels, 2);
        self.add("surface", "entries of the median intersections", 4 * medians * pixels, 1);
        self.add("images", "final image, gradients of base and final image", 12 * pixels, 4);
        self.add("images", "warped colours and their gradients", 16 * visible * pixels, 4);
        self.add("losses", "SSIM moments of the warped images", 36 * pixels, visible);
    }

    fn add_network(&mut self, sizes: &Sizes, demand: &Demand) {
        let Sizes { pixels, band, medians, visible, sources, .. } = *sizes;
        let [width, height] = sizes.low[0];
        let [low, half, quarter] = [1, 2, 4].map(|by| (width / by) * (height / by));
        self.add("network", "activations and gradients at full size", 4 * INPUT as u64 * low, 6);
        self.add("network", "activations and gradients at half size", 4 * HALF as u64 * half, 4);
        self.add("network", "activations at quarter size", 4 * QUARTER as u64 * quarter, 1);
        self.add("network", "output and its gradient", 16 * low, 2);
        self.add("network", "gradients of the features", 16 * visible * low, 1);
        self.add("network", "seen sources", 4 * pixels, 1);
        self.add("network", "base and warped colours of a band and their gradients", (12 + 16 * visible) * band, 2);
        self.add("network", "photo and seen sources of a band", 4 * band, 2);
        let tiles = width.div_ceil(16) * height.div_ceil(2);
        let row = (9 * INPUT * INPUT + INPUT) as u64;
        self.add("network", "sums of the weights' gradients", 4 * row * tiles.div_ceil(8).min(264), 1);
        self.add("network", "sums of the per-view network", SUMS_BYTES, 1);
        self.add("network", "weights and their gradient", 4 * WEIGHTS as u64, 2);
        if demand.config.exposure.enabled != ExposureSwitch::Off {
            self.add("network", "warped colours in the photo's exposure and their gradient", 16 * visible * pixels, 2);
        }
        if demand.evaluates {
            let whole: u64 = sizes.low[1].iter().product();
            self.add("evaluation", "activations", 4 * INPUT as u64 * whole, 4);
            self.add("evaluation", "output", 16 * whole, 1);
            self.add("evaluation", "images", 12 * pixels, 2);
            self.add("evaluation", "warped colours", 16 * visible * pixels, 1);
            self.add("evaluation", "depth maps of the sources", 4 * pixels, sources);
            self.add("evaluation", "surface", (28 + 8 * medians) * pixels, 1);
        }
    }

    /// All buffers.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Bytes in all.
    pub fn total(&self) -> u64 {
        self.parts.iter().map(|part| part.bytes * part.buffers).sum()
    }

    /// The largest single buffer.
    pub fn largest(&self) -> Option<Part> {
        self.parts.iter().copied().filter(|part| part.buffers > 0).max_by_key(|part| part.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2, DVec3};
    use ibgs_core::gpu::Bytes;

    fn camera(width: u32, height: u32) -> Camera {
        let size = DVec2::new(width.into(), height.into());
        let (view_from_world, translation) = (DMat3::IDENTITY, DVec3::ZERO);
        Camera { width, height, focal: size, principal: size / 2.0, view_from_world, translation }
    }

    fn demand<'a>(config: &'a TrainConfig, cameras: &'a [Camera], gaussians: u64) -> Demand<'a> {
        let room = 4 * INTERSECTIONS * gaussians;
        let photo_budget = Some(4 << 30);
        Demand { config, sh_degree: 3, cameras, gaussians, room, photo_budget, grows: true, evaluates: true }
    }

    /// Bindings are limited to 2 GiB - 1 on many devices.
    #[test]
    fn no_binding_of_five_million_gaussians_is_too_large() {
        let cameras = vec![camera(1600, 1064); 300];
        let config = TrainConfig::default();
        let small = demand(&config, &cameras, 100_000);
        let estimate = Estimate::new(&small.grown_to(5_000_000));
        for part in estimate.parts() {
            println!("{:>14} {:<50} {:>12} x {}", part.part, part.what, part.bytes, part.buffers);
            assert!(part.bytes < 1 << 31, "{}, {}: {} bytes", part.part, part.what, part.bytes);
        }
        println!("{} in all, the largest {:?}", Bytes(estimate.total()), estimate.largest());
        assert_eq!(small.grown_to(5_000_000).room, 2 * INTERSECTIONS * 5_000_000 + 1024);
    }

    #[test]
    fn more_of_anything_needs_more() {
        let (few, many) = (vec![camera(64, 48); 3], vec![camera(64, 48); 9]);
        let large = vec![camera(128, 48); 3];
        let config = TrainConfig::default();
        let base = TrainConfig { method: Method::Gs3, ..TrainConfig::default() };
        let total = |demand: Demand| Estimate::new(&demand).total();
        let usual = demand(&config, &few, 1000);
        for more in [demand(&config, &many, 1000), demand(&config, &large, 1000), usual.grown_to(2000)] {
            assert!(total(more) > total(usual));
        }
        for less in [
            Demand { config: &base, ..usual },
            Demand { grows: false, ..usual },
            Demand { evaluates: false, ..usual },
            Demand { sh_degree: 0, ..usual },
            Demand { room: usual.room / 2, ..usual },
            Demand { photo_budget: Some(0), cameras: &many, ..usual },
        ] {
            let compared = Demand { cameras: less.cameras, ..usual };
            assert!(total(less) < total(compared));
        }
    }
}
