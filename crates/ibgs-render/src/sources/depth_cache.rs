//! The training views' own median-depth maps, kept on the GPU until the model changes (method.md section 5).
//!
//! Maps are float32, as the geometry pass writes them: the visibility test compares depths to 1 %, which half floats would
//! resolve too, at the cost of a kernel that converts. A renderer keeps the very buffer of a depth pass; training copies the
//! map of each view that it has just trained, for the pass's own buffer is used again in the next iteration. A map of
//! 1 megapixel takes 4 MB, as its photo does.

use crate::gpu::Buffer;
use std::collections::HashMap;

/// Depth maps by training view within a memory budget: those used last stay.
#[derive(Debug, Default)]
pub struct DepthCache {
    maps: HashMap<usize, Entry>,
    /// Bytes; none: no limit.
    budget: Option<u64>,
    resident: u64,
    /// Counts uses.
    clock: u64,
}

#[derive(Debug)]
struct Entry {
    map: Buffer<f32>,
    last_use: u64,
}

impl DepthCache {
    /// An empty cache that keeps at most `budget` bytes (none: no limit), but always the map that came last.
    pub fn new(budget: Option<u64>) -> Self {
        Self { budget, ..Self::default() }
    }

    /// The map of a training view, `[height * width]` float32 view depths, 0 where there is none.
    pub fn get(&mut self, view: usize) -> Option<Buffer<f32>> {
        self.clock += 1;
        let entry = self.maps.get_mut(&view)?;
        entry.last_use = self.clock;
        Some(entry.map.clone())
    }

    /// The map of a training view; where there is none it is made and kept.
    ///
    /// # Errors
    /// Errors of `make`.
    pub fn get_or_make<E>(
        &mut self,
        view: usize,
        make: impl FnOnce() -> Result<Buffer<f32>, E>,
    ) -> Result<Buffer<f32>, E> {
        if let Some(map) = self.get(view) {
            return Ok(map);
        }
        let map = make()?;
        self.insert(view, map.clone());
        Ok(map)
    }

    /// Keeps the map of a training view in place of an older one. Passes that are submitted later may write it again. Its
    /// memory lives as long as a clone of it does, also after it has left the cache.
    pub fn insert(&mut self, view: usize, map: Buffer<f32>) {
        self.remove(view);
        self.clock += 1;
        let (bytes, last_use) = (map.bytes(), self.clock);
        while self.budget.is_some_and(|budget| self.resident + bytes > budget) {
            let oldest = self.maps.iter().min_by_key(|(_, entry)| entry.last_use).map(|(view, _)| *view);
            match oldest {
                Some(view) => self.remove(view),
                None => break,
            }
        }
        self.resident += bytes;
        self.maps.insert(view, Entry { map, last_use });
    }

    /// Forgets one map.
    pub fn remove(&mut self, view: usize) {
        if let Some(entry) = self.maps.remove(&view) {
            self.resident -= entry.map.bytes();
        }
    }

    /// Forgets every map: the model has changed.
    pub fn clear(&mut self) {
        self.maps.clear();
        self.resident = 0;
    }

    /// Bytes of all maps.
    pub fn resident_bytes(&self) -> u64 {
        self.resident
    }

    /// Number of maps.
    pub fn len(&self) -> usize {
        self.maps.len()
    }

    /// True without any map.
    pub fn is_empty(&self) -> bool {
        self.maps.is_empty()
    }
}
