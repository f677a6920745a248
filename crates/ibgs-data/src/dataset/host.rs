//! Photos on the host: decoded while there is room for them, decoded again from their files where there is none.

use super::{CellMask, DatasetError, Photo};
use crate::lru::Lru;
use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};

/// A photo on the host. Clones share its pixels, which are there or are decoded again when they are asked for.
#[derive(Clone, Debug)]
pub struct HostPhoto {
    size: [u32; 2],
    /// CRC-32 of its pixels, where it was read from a file.
    checksum: Option<u32>,
    place: Place,
    /// Hides cells of it.
    mask: Option<Arc<CellMask>>,
}

#[derive(Clone, Debug)]
enum Place {
    Here(Arc<Photo>),
    Cached { cache: Arc<PhotoCache>, index: usize },
}

impl From<Arc<Photo>> for HostPhoto {
    fn from(photo: Arc<Photo>) -> Self {
        Self { size: [photo.width, photo.height], checksum: None, place: Place::Here(photo), mask: None }
    }
}

impl From<Photo> for HostPhoto {
    fn from(photo: Photo) -> Self {
        Arc::new(photo).into()
    }
}

impl HostPhoto {
    /// Photos that are decoded while another one is used.
    pub const AHEAD: usize = 16;

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Bytes of its pixels.
    pub fn bytes(&self) -> u64 {
        bytes(self.size)
    }

    /// Whether its pixels stay where they are.
    pub fn is_kept(&self) -> bool {
        matches!(self.place, Place::Here(_))
    }

    /// The same photo with cells hidden.
    ///
    /// # Panics
    /// When the mask is one of photos of another size: a bug of ours.
    pub fn masked(self, mask: Arc<CellMask>) -> Self {
        assert_eq!(mask.size(), self.size, "the mask of a photo has its size");
        Self { mask: Some(mask), ..self }
    }

    /// Its pixels; decoded, where they are not there.
    ///
    /// # Errors
    /// The file cannot be decoded any more, or has changed since it was loaded.
    pub fn pixels(&self) -> Result<Arc<Photo>, DatasetError> {
        let photo = match &self.place {
            Place::Here(photo) => photo.clone(),
            Place::Cached { cache, index } => cache.get(*index)?,
        };
        Ok(self.shown(photo))
    }

    /// Its pixels if they are there.
    pub fn pixels_if_there(&self) -> Option<Arc<Photo>> {
        let photo = match &self.place {
            Place::Here(photo) => photo.clone(),
            Place::Cached { cache, index } => cache.lock().find(*index)?,
        };
        Some(self.shown(photo))
    }

    fn shown(&self, photo: Arc<Photo>) -> Arc<Photo> {
        match &self.mask {
            Some(mask) => Arc::new(mask.applied(&photo)),
            None => photo,
        }
    }

    /// Begins to decode it on another thread, if it is not there and the memory holds what was to be decoded before it.
    /// Whoever asks for its pixels later meets an error, if there is one.
    pub fn decode_ahead(&self) {
        if let Place::Cached { cache, index } = &self.place
            && cache.lock().queue(*index)
        {
            // A queue that outlives the scene is of no use.
            let (cache, index) = (Arc::downgrade(cache), *index);
            rayon::spawn(move || {
                if let Some(cache) = cache.upgrade().filter(|cache| cache.lock().begin(index)) {
                    drop(cache.decode(index));
                }
            });
        }
    }

    /// Begins to decode the next of the photos that work goes through in this order.
    pub fn decode_next<'a>(photos: impl IntoIterator<Item = &'a HostPhoto>) {
        photos.into_iter().take(Self::AHEAD).for_each(Self::decode_ahead);
    }

    /// CRC-32 of its pixels.
    pub(super) fn checksum(&self) -> u32 {
        let computed = || match &self.place {
            Place::Here(photo) => crc32fast::hash(&photo.rgba),
            Place::Cached { cache, index } => cache.lock().slots[*index].checksum,
        };
        self.checksum.unwrap_or_else(computed)
    }
}

fn bytes([width, height]: [u32; 2]) -> u64 {
    4 * u64::from(width) * u64::from(height)
}

/// Decodes the photo of this number.
type Decode = Box<dyn Fn(usize) -> Result<Photo, DatasetError> + Send + Sync>;

/// The photos of a scene within a budget: those used last stay.
pub(super) struct PhotoCache {
    /// Files of the photos.
    paths: Vec<PathBuf>,
    decode: Decode,
    state: Mutex<CachedPhotos>,
    /// A photo was decoded, or could not be.
    decoded: Condvar,
}

struct CachedPhotos {
    slots: Vec<Slot>,
    /// The decoded photos.
    decoded: Lru<Arc<Photo>>,
    /// Bytes of the photos that are decoded ahead, until they are asked for.
    ahead: u64,
    has_evicted: bool,
}

#[derive(Clone, Copy, Default, PartialEq)]
enum Work {
    #[default]
    None,
    /// A thread of the pool will decode it.
    Queued,
    /// A thread decodes it.
    Begun,
}

#[derive(Clone, Default)]
struct Slot {
    size: [u32; 2],
    checksum: u32,
    work: Work,
    /// It was decoded ahead, or will be, and nobody has asked for it yet.
    is_ahead: bool,
}

impl fmt::Debug for PhotoCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PhotoCache").field("resident", &self.lock().decoded.resident_bytes()).finish_non_exhaustive()
    }
}

impl PhotoCache {
    /// A cache for the photos of these files within a budget in bytes (none: no limit).
    pub fn new(paths: Vec<PathBuf>, budget: Option<u64>, decode: Decode) -> Self {
        let slots = vec![Slot::default(); paths.len()];
        let state = CachedPhotos { slots, decoded: Lru::new(budget), ahead: 0, has_evicted: false };
        Self { paths, decode, state: Mutex::new(state), decoded: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, CachedPhotos> {
        self.state.lock().expect("photos on the host")
    }

    /// Puts a photo there for the first time.
    pub fn put(&self, index: usize, photo: Photo) {
        let (size, checksum) = ([photo.width, photo.height], crc32fast::hash(&photo.rgba));
        let mut state = self.lock();
        let slot = &mut state.slots[index];
        (slot.size, slot.checksum) = (size, checksum);
        state.keep(index, Arc::new(photo));
    }

    /// The photos, all of which have been put there. Where all of them fit, the cache itself is not kept.
    pub fn into_photos(self) -> Vec<HostPhoto> {
        let cache = Arc::new(self);
        let mut state = cache.lock();
        let CachedPhotos { slots, decoded, has_evicted, .. } = &mut *state;
        let photo = |(index, slot): (usize, &Slot)| {
            let photo = if *has_evicted { None } else { decoded.remove(index) };
            let place = match photo {
                Some(photo) => Place::Here(photo),
                None => Place::Cached { cache: cache.clone(), index },
            };
            HostPhoto { size: slot.size, checksum: Some(slot.checksum), place, mask: None }
        };
        slots.iter().enumerate().map(photo).collect()
    }

    /// The pixels of a photo.
    fn get(&self, index: usize) -> Result<Arc<Photo>, DatasetError> {
        let mut state = self.lock();
        loop {
            if let Some(photo) = state.find(index) {
                return Ok(photo);
            }
            // A thread of the pool may stand on top of the one that decodes it: it must not wait.
            if state.slots[index].work != Work::Begun || rayon::current_thread_index().is_some() {
                break;
            }
            state = self.decoded.wait(state).expect("photos on the host");
        }
        state.slots[index].work = Work::Begun;
        state.leave_ahead(index);
        drop(state);
        self.decode(index)
    }

    /// Decodes a photo; the caller has begun it.
    fn decode(&self, index: usize) -> Result<Arc<Photo>, DatasetError> {
        let _released = Released { cache: self, index };
        let photo = Arc::new((self.decode)(index)?);
        let checksum = crc32fast::hash(&photo.rgba);
        let mut state = self.lock();
        let slot = &state.slots[index];
        if (slot.size, slot.checksum) != ([photo.width, photo.height], checksum) {
            return Err(DatasetError::PhotoChanged { path: self.paths[index].clone() });
        }
        state.keep(index, photo.clone());
        Ok(photo)
    }
}

impl Slot {
    fn bytes(&self) -> u64 {
        bytes(self.size)
    }
}

/// Lets others decode a photo again.
struct Released<'a> {
    cache: &'a PhotoCache,
    index: usize,
}

impl Drop for Released<'_> {
    fn drop(&mut self) {
        if let Ok(mut state) = self.cache.state.lock() {
            state.slots[self.index].work = Work::None;
        }
        self.cache.decoded.notify_all();
    }
}

impl CachedPhotos {
    /// The pixels of a photo that is there; it counts as used.
    fn find(&mut self, index: usize) -> Option<Arc<Photo>> {
        self.leave_ahead(index);
        self.decoded.get(index).cloned()
    }

    /// A photo that was decoded ahead is one of all others now.
    fn leave_ahead(&mut self, index: usize) {
        let slot = &mut self.slots[index];
        if std::mem::take(&mut slot.is_ahead) {
            self.ahead -= slot.bytes();
        }
    }

    /// Marks a photo to be decoded ahead; false where it is there, another thread decodes it, or half of the memory is taken by
    /// photos that nobody has asked for yet.
    fn queue(&mut self, index: usize) -> bool {
        let is_there = self.decoded.get(index).is_some();
        let slot = &mut self.slots[index];
        let has_room = self.decoded.budget().is_none_or(|budget| self.ahead + slot.bytes() <= budget / 2);
        if is_there || slot.work != Work::None || slot.is_ahead || !has_room {
            return false;
        }
        (slot.work, slot.is_ahead) = (Work::Queued, true);
        self.ahead += slot.bytes();
        true
    }

    /// Whether a photo is still queued; then it is begun.
    fn begin(&mut self, index: usize) -> bool {
        let is_queued = self.slots[index].work == Work::Queued;
        if is_queued {
            self.slots[index].work = Work::Begun;
        }
        is_queued
    }

    /// Keeps a photo in place of those used longest ago.
    fn keep(&mut self, index: usize, photo: Arc<Photo>) {
        self.decoded.insert(index, photo, self.slots[index].bytes());
        while !self.decoded.has_room(0) {
            let Some((oldest, _)) = self.decoded.evict(|_| true) else { break };
            self.leave_ahead(oldest);
            self.has_evicted = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::{Duration, Instant};

    /// A cache of black photos of 16 bytes, with room for some of them, and how many were decoded again.
    fn cache(photos: usize, room: u64) -> (Vec<HostPhoto>, Arc<AtomicUsize>) {
        let count = Arc::new(AtomicUsize::new(0));
        let black = || Photo { width: 2, height: 2, rgba: vec![0; 16] };
        let decode = {
            let count = count.clone();
            move |_| {
                count.fetch_add(1, Ordering::SeqCst);
                Ok(black())
            }
        };
        let cache = PhotoCache::new(vec![PathBuf::new(); photos], Some(16 * room), Box::new(decode));
        (0..photos).for_each(|index| cache.put(index, black()));
        (cache.into_photos(), count)
    }

    fn eventually(done: impl Fn() -> bool) {
        let start = Instant::now();
        while !done() {
            assert!(start.elapsed() < Duration::from_secs(20));
            std::thread::yield_now();
        }
    }

    #[test]
    fn what_is_decoded_ahead_is_decoded_once_and_takes_half_of_the_room() {
        let (photos, count) = cache(20, 8);
        for _ in 0..3 {
            photos[..12].iter().for_each(HostPhoto::decode_ahead);
        }
        // The last eight are there already.
        eventually(|| count.load(Ordering::SeqCst) == 4);
        for photo in &photos[..4] {
            eventually(|| photo.pixels_if_there().is_some());
            photo.pixels().unwrap();
        }
        assert_eq!(count.load(Ordering::SeqCst), 4);
        assert!(photos[5].pixels_if_there().is_none());
        // They have been asked for, so others may come.
        photos[4..8].iter().for_each(HostPhoto::decode_ahead);
        eventually(|| count.load(Ordering::SeqCst) == 8);
    }

    #[test]
    fn where_all_fit_nothing_is_decoded_again() {
        let (photos, count) = cache(5, 5);
        photos.iter().for_each(HostPhoto::decode_ahead);
        assert!(photos.iter().all(|photo| photo.is_kept() && photo.pixels().is_ok()));
        assert_eq!(count.load(Ordering::SeqCst), 0);
    }
}
