//! The training views' own median-depth maps, kept on the GPU until the model changes (method.md section 5).
//!
//! Maps are float32, as the geometry pass writes them: the visibility test compares depths to 1 %, which half floats would
//! resolve too, at the cost of a kernel that converts. A renderer keeps the very buffer of a depth pass; training copies the
//! map of each view that it has just trained, for the pass's own buffer is used again in the next iteration. A map of
//! 1 megapixel takes 4 MB, as its photo does.

use crate::gpu::Buffer;
use crate::lru::Lru;

/// Depth maps by training view within a memory budget: those used last stay.
#[derive(Debug)]
pub struct DepthCache(Lru<Buffer<f32>>);

impl DepthCache {
    /// An empty cache that keeps at most `budget` bytes (none: no limit), but always the map that came last.
    pub fn new(budget: Option<u64>) -> Self {
        Self(Lru::new(budget))
    }

    /// The map of a training view, `[height * width]` float32 view depths, 0 where there is none.
    pub fn get(&mut self, view: usize) -> Option<Buffer<f32>> {
        self.0.get(view).cloned()
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
        let bytes = map.bytes();
        self.0.make_room(bytes);
        self.0.insert(view, map, bytes);
    }

    /// Forgets one map.
    pub fn remove(&mut self, view: usize) {
        self.0.remove(view);
    }

    /// Forgets every map: the model has changed.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Bytes of all maps.
    pub fn resident_bytes(&self) -> u64 {
        self.0.resident_bytes()
    }

    /// Number of maps.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// True without any map.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}
