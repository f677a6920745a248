//! Subgroups: whether the device has them as our kernels need them, and whether its driver gets them right.

use super::pipeline::Pipelines;
use super::{Gpu, GpuError, Pass};
use ibgs_shaders::bindings::TileSortBindings;
use ibgs_shaders::types::ViewUniforms;
use ibgs_shaders::{SORT_BLOCK, TILE};
use std::sync::Arc;

/// Lanes of a device's subgroups, where they are always as many and our kernels have a form for them.
pub(super) fn subgroup_lanes(info: &wgpu::AdapterInfo, features: wgpu::Features) -> Option<u32> {
    let lanes = info.subgroup_min_size;
    let fits = lanes == info.subgroup_max_size && [8, 16, 32].contains(&lanes);
    (fits && features.contains(wgpu::Features::SUBGROUP)).then_some(lanes)
}

impl Gpu {
    /// Whether `tile_sort`, whose threads exchange what they have within subgroups, sorts two lists whose order is known: one
    /// within a block and one of two.
    ///
    /// # Errors
    /// Not enough memory, or the device failed.
    pub fn sorts_right(&self) -> Result<bool, GpuError> {
        let (few, all) = (SORT_BLOCK / 4 - 1, SORT_BLOCK / 2 - 1 + SORT_BLOCK);
        // Multiplying by an odd number mixes the keys, which stay different.
        let key = |isect: u32| isect.wrapping_mul(0x9e37_79b1);
        let list: Vec<[u32; 2]> = (0..all).map(|isect| [key(isect), isect]).collect();
        let isects: Vec<u32> = (0..all).collect();
        let upload = |values: &[u32]| self.upload("test of subgroups", values);
        // Where the lists begin and end, with one behind them, then their tiles in order.
        let ranges = upload(&[0, few, few, all, all, all, 0, 1])?;
        let [isect_to_gaussian, sorted_gaussians, sorted_isects] =
            [upload(&isects)?, upload(&isects)?, upload(&isects)?];
        let list = self.upload("test of subgroups", &list)?;
        let mut pass = Pass::new(self, "test of subgroups");
        let buffers = TileSortBindings {
            tile_ranges: &ranges,
            isect_to_gaussian: &isect_to_gaussian,
            list: &list,
            sorted_gaussians: &sorted_gaussians,
            sorted_isects: &sorted_isects,
        };
        let frame = ViewUniforms { size: [2 * TILE, TILE], capacity: all, ..ViewUniforms::default() };
        pass.grid(&buffers, &frame, [2, 1, 1]);
        pass.submit();
        let mut expected = isects;
        expected[..few as usize].sort_by_key(|&isect| key(isect));
        expected[few as usize..].sort_by_key(|&isect| key(isect));
        let right = self.read(&sorted_isects, all as usize)? == expected;
        self.release_unused();
        Ok(right)
    }

    /// Does without subgroups where the driver gets them wrong.
    pub(super) fn with_right_subgroups(mut self) -> Result<Arc<Gpu>, GpuError> {
        if self.subgroup_lanes.is_some() && !self.tested("subgroups", || self.sorts_right())? {
            log::warn!("{}: the driver's subgroups give wrong results; going on without them", self.describe());
            self.subgroup_lanes = None;
            self.pipelines = Pipelines::default();
        }
        Ok(Arc::new(self))
    }
}
