//! The training photos on the GPU, as packed 8-bit RGBA: all of them where they fit, otherwise those used last.

use crate::dataset::{CellMask, HostPhoto, Photo};
use crate::gpu::{Buffer, Gpu, GpuError, flush};
use crate::lru::Lru;
use crate::sources::DevicePhoto;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// Uploads beyond this are handed to the device before more follow: wgpu keeps a copy of each until then.
const FLUSH_EVERY: u64 = 256 << 20;

/// Photos on the GPU within a memory budget.
///
/// A photo that is asked for and not there is uploaded. Where the budget is full, the photos used longest ago are evicted, but
/// never one whose [`DevicePhoto`] is still held: the budget is exceeded for that long. A device that has
/// less memory than the budget lowers it.
///
/// Keep a [`DevicePhoto`] until the pass that reads it is submitted: its memory may become another photo's afterwards.
#[derive(Debug)]
pub struct SourceStore {
    gpu: Arc<Gpu>,
    photos: Vec<HostPhoto>,
    decodes_again: bool,
    state: Mutex<StoredPhotos>,
}

#[derive(Debug)]
struct StoredPhotos {
    on_device: Lru<DevicePhoto>,
    /// Counts uploads.
    uploads: u64,
    /// Bytes uploaded since the last flush.
    pending: u64,
    /// Learned masks of photos.
    masks: BTreeMap<usize, Arc<CellMask>>,
}

/// Whether nobody but the store holds a photo.
fn is_free(photo: &DevicePhoto) -> bool {
    Arc::strong_count(&photo.held) == 1
}

impl StoredPhotos {
    /// Makes room for `bytes`; memory of exactly that size is handed over to be used again.
    fn make_room(&mut self, bytes: u64) -> Option<Buffer<u32>> {
        while !self.on_device.has_room(bytes) {
            let (_, freed) = self.on_device.evict(is_free)?;
            if freed.texels.bytes() == bytes && self.on_device.has_room(bytes) {
                return Some(freed.texels);
            }
        }
        None
    }
}

/// Bytes that a photo takes on the device.
fn bytes_of(photo: &HostPhoto) -> u64 {
    photo.bytes().max(16).next_multiple_of(16)
}

/// The pixels of a photo on the host, with an error of those that come with the device.
///
/// # Errors
/// [`GpuError::Photo`]: it cannot be decoded again.
pub fn pixels(photo: &HostPhoto) -> Result<Arc<Photo>, GpuError> {
    photo.pixels().map_err(|error| GpuError::Photo(error.to_string()))
}

impl SourceStore {
    /// A store of `photos` that takes at most `budget` bytes (none: no limit). Everything is uploaded at once where it fits.
    ///
    /// # Errors
    /// A photo that the device cannot bind.
    pub fn new(gpu: Arc<Gpu>, photos: Vec<HostPhoto>, budget: Option<u64>) -> Result<Self, GpuError> {
        for photo in &photos {
            gpu.check_size("photo", bytes_of(photo))?;
        }
        let all: u64 = photos.iter().map(bytes_of).sum();
        let decodes_again = photos.iter().any(|photo| !photo.is_kept());
        let state = StoredPhotos { on_device: Lru::new(budget), uploads: 0, pending: 0, masks: BTreeMap::new() };
        let store = Self { gpu, photos, decodes_again, state: Mutex::new(state) };
        if budget.is_none_or(|budget| all <= budget) {
            for index in 0..store.photos.len() {
                HostPhoto::decode_next(&store.photos[index + 1..]);
                store.photo(index)?;
                if store.lock().on_device.budget() != budget {
                    // The device has less memory than the budget: the rest is uploaded on demand.
                    break;
                }
            }
            store.gpu.queue.submit([]);
        }
        Ok(store)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, StoredPhotos> {
        self.state.lock().expect("source store")
    }

    /// Number of photos.
    pub fn len(&self) -> usize {
        self.photos.len()
    }

    /// True without any photo.
    pub fn is_empty(&self) -> bool {
        self.photos.is_empty()
    }

    /// Photo `index` on the device, uploaded if it is not there.
    ///
    /// # Errors
    /// Not enough memory, even with every other photo that is not held evicted; a photo that cannot be decoded again.
    ///
    /// # Panics
    /// When there is no such photo: a bug of ours.
    pub fn photo(&self, index: usize) -> Result<DevicePhoto, GpuError> {
        let mut state = self.lock();
        if let Some(photo) = state.on_device.get(index) {
            return Ok(photo.clone());
        }
        let photo = self.upload(&mut state, index)?;
        state.on_device.insert(index, photo.clone(), photo.texels.bytes());
        Ok(photo)
    }

    /// Hides these cells of photo `index` from here on, and no others.
    ///
    /// # Errors
    /// A photo that cannot be decoded again.
    ///
    /// # Panics
    /// When the mask is one of photos of another size, or there is no such photo: bugs of ours.
    pub fn set_mask(&self, index: usize, mask: Arc<CellMask>) -> Result<(), GpuError> {
        assert_eq!(mask.size(), self.photos[index].size(), "the mask of a photo has its size");
        let mut state = self.lock();
        let before = state.masks.insert(index, mask.clone());
        let is_new = before.map_or(!mask.is_empty(), |before| before != mask);
        if is_new && let Some(photo) = state.on_device.get(index) {
            let texels = photo.texels.clone();
            let photo = self.shown(&state, index)?;
            self.write(&mut state, &photo, &texels);
        }
        Ok(())
    }

    /// Photo `index` on the host, without its learned mask.
    ///
    /// # Panics
    /// When there is no such photo: a bug of ours.
    pub fn on_host(&self, index: usize) -> &HostPhoto {
        &self.photos[index]
    }

    /// Several photos at once; none of them evicts another.
    ///
    /// # Errors
    /// As [`SourceStore::photo`].
    pub fn photos(&self, indices: &[usize]) -> Result<Vec<DevicePhoto>, GpuError> {
        self.decode_ahead(indices);
        // Those that are there first, so that the others cannot push them out.
        let mut found: Vec<(usize, DevicePhoto)> = Vec::with_capacity(indices.len());
        let (there, missing): (Vec<usize>, Vec<usize>) =
            (0..indices.len()).partition(|&at| self.is_resident(indices[at]));
        for at in there.into_iter().chain(missing) {
            found.push((at, self.photo(indices[at])?));
        }
        found.sort_by_key(|(at, _)| *at);
        Ok(found.into_iter().map(|(_, photo)| photo).collect())
    }

    /// Uploads photos that will be wanted soon.
    ///
    /// # Errors
    /// As [`SourceStore::photo`].
    pub fn prefetch(&self, indices: &[usize]) -> Result<(), GpuError> {
        self.photos(indices).map(|_| ())
    }

    /// Whether some photos have to be decoded again, as the host does not keep all.
    pub fn decodes_again(&self) -> bool {
        self.decodes_again
    }

    /// Begins to decode photos that will be wanted, where neither the device nor the host has them.
    pub fn decode_ahead(&self, indices: &[usize]) {
        let missing = indices.iter().filter(|&&index| !self.is_resident(index));
        missing.for_each(|&index| self.photos[index].decode_ahead());
    }

    /// Whether a photo is on the device now.
    pub fn is_resident(&self, index: usize) -> bool {
        self.lock().on_device.contains(index)
    }

    /// Bytes of the photos on the device.
    pub fn resident_bytes(&self) -> u64 {
        self.lock().on_device.resident_bytes()
    }

    /// Uploads so far: as many as there are photos when everything fits.
    pub fn uploads(&self) -> u64 {
        self.lock().uploads
    }

    fn upload(&self, state: &mut StoredPhotos, index: usize) -> Result<DevicePhoto, GpuError> {
        let photo = self.shown(state, index)?;
        let bytes = bytes_of(&self.photos[index]);
        let texels = match state.make_room(bytes) {
            Some(buffer) => buffer,
            None => self.allocate(state, bytes)?,
        };
        self.write(state, &photo, &texels);
        state.uploads += 1;
        Ok(DevicePhoto::new(texels, self.photos[index].size()))
    }

    /// The pixels of a photo, masked where it is.
    fn shown(&self, state: &StoredPhotos, index: usize) -> Result<Arc<Photo>, GpuError> {
        let photo = pixels(&self.photos[index])?;
        Ok(state.masks.get(&index).map_or_else(|| photo.clone(), |mask| Arc::new(mask.applied(&photo))))
    }

    /// Writes a photo into its memory on the device.
    fn write(&self, state: &mut StoredPhotos, photo: &Photo, texels: &Buffer<u32>) {
        // Ordered on the queue after every pass that reads what was there before.
        flush();
        self.gpu.write(&texels.cast(), 0, &photo.rgba);
        state.pending += texels.bytes();
        if state.pending > FLUSH_EVERY {
            state.pending = 0;
            self.gpu.queue.submit([]);
        }
    }

    /// New memory; where the device has none left the budget shrinks to what it gave, and older photos leave.
    fn allocate(&self, state: &mut StoredPhotos, bytes: u64) -> Result<Buffer<u32>, GpuError> {
        loop {
            let error = match self.gpu.allocate("photo", (bytes / 4) as usize) {
                Ok(buffer) => return Ok(buffer),
                Err(error) => error,
            };
            let resident = state.on_device.resident_bytes();
            let Some((_, freed)) = state.on_device.evict(is_free) else {
                return Err(error);
            };
            state.on_device.set_budget(Some(resident));
            if freed.texels.bytes() == bytes {
                return Ok(freed.texels);
            }
            drop(freed);
            // Evicted memory returns once the device is done with it.
            self.gpu.wait()?;
        }
    }
}
