//! Photos on the host: decoded while there is room for them, decoded again from their files where there is none.

use super::{DatasetError, Photo};
use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};

/// A photo on the host. Clones share its pixels, which are there or are decoded again when they are asked for.
#[derive(Clone, Debug)]
pub struct HostPhoto {
    size: [u32; 2],
    place: Place,
}

#[derive(Clone, Debug)]
enum Place {
    Here(Arc<Photo>),
    Shelf { shelf: Arc<Shelf>, index: usize },
}

impl From<Arc<Photo>> for HostPhoto {
    fn from(photo: Arc<Photo>) -> Self {
        Self { size: [photo.width, photo.height], place: Place::Here(photo) }
    }
}

impl From<Photo> for HostPhoto {
    fn from(photo: Photo) -> Self {
        Arc::new(photo).into()
    }
}

impl HostPhoto {
    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Whether its pixels stay where they are.
    pub fn is_kept(&self) -> bool {
        matches!(self.place, Place::Here(_))
    }

    /// Its pixels; decoded, where they are not there.
    ///
    /// # Errors
    /// The file cannot be decoded any more, or has changed since it was loaded.
    pub fn pixels(&self) -> Result<Arc<Photo>, DatasetError> {
        match &self.place {
            Place::Here(photo) => Ok(photo.clone()),
            Place::Shelf { shelf, index } => shelf.get(*index),
        }
    }

    /// Begins to decode it on another thread, if it is not there. Whoever asks for its pixels later meets an error, if there
    /// is one.
    pub fn decode_ahead(&self) {
        if let Place::Shelf { shelf, index } = &self.place
            && shelf.claim(*index)
        {
            let (shelf, index) = (shelf.clone(), *index);
            rayon::spawn(move || drop(shelf.decode(index)));
        }
    }

    /// Checksum of the pixels, CRC-32, and their bytes.
    pub(super) fn checksum(&self) -> (u32, u64) {
        let bytes = 4 * u64::from(self.size[0]) * u64::from(self.size[1]);
        match &self.place {
            Place::Here(photo) => (crc32fast::hash(&photo.rgba), bytes),
            Place::Shelf { shelf, index } => (shelf.lock().slots[*index].checksum, bytes),
        }
    }
}

/// Decodes the photo of this number.
type Decode = Box<dyn Fn(usize) -> Result<Photo, DatasetError> + Send + Sync>;

/// The photos of a scene within a budget: those used last stay.
pub(super) struct Shelf {
    /// Files of the photos.
    paths: Vec<PathBuf>,
    decode: Decode,
    state: Mutex<State>,
    /// A photo was decoded, or could not be.
    decoded: Condvar,
}

struct State {
    slots: Vec<Slot>,
    /// Bytes of the decoded photos.
    resident: u64,
    /// Bytes; none: no limit.
    budget: Option<u64>,
    /// Counts uses.
    clock: u64,
    has_evicted: bool,
}

#[derive(Clone, Default)]
struct Slot {
    size: [u32; 2],
    checksum: u32,
    photo: Option<Arc<Photo>>,
    last_use: u64,
    /// A thread decodes it.
    claimed: bool,
}

impl fmt::Debug for Shelf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Shelf").field("resident", &self.lock().resident).finish_non_exhaustive()
    }
}

impl Shelf {
    /// A shelf for the photos of these files within a budget in bytes (none: no limit).
    pub fn new(paths: Vec<PathBuf>, budget: Option<u64>, decode: Decode) -> Self {
        let slots = vec![Slot::default(); paths.len()];
        let state = State { slots, resident: 0, budget, clock: 0, has_evicted: false };
        Self { paths, decode, state: Mutex::new(state), decoded: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("photos on the host")
    }

    /// Puts a photo there for the first time.
    pub fn put(&self, index: usize, photo: Photo) {
        let mut state = self.lock();
        let slot = &mut state.slots[index];
        (slot.size, slot.checksum) = ([photo.width, photo.height], crc32fast::hash(&photo.rgba));
        state.keep(index, Arc::new(photo));
    }

    /// The photos, all of which have been put there. Where all of them fit, the shelf itself is not kept.
    pub fn into_photos(self) -> Vec<HostPhoto> {
        let shelf = Arc::new(self);
        let mut state = shelf.lock();
        let all_fit = !state.has_evicted;
        let photo = |(index, slot): (usize, &mut Slot)| match slot.photo.take_if(|_| all_fit) {
            Some(photo) => photo.into(),
            None => HostPhoto { size: slot.size, place: Place::Shelf { shelf: shelf.clone(), index } },
        };
        state.slots.iter_mut().enumerate().map(photo).collect()
    }

    /// The pixels of a photo.
    fn get(&self, index: usize) -> Result<Arc<Photo>, DatasetError> {
        let mut state = self.lock();
        loop {
            state.clock += 1;
            let now = state.clock;
            let slot = &mut state.slots[index];
            if let Some(photo) = &slot.photo {
                slot.last_use = now;
                return Ok(photo.clone());
            }
            // A thread of the pool may stand on top of the one that decodes it: it must not wait.
            if !slot.claimed || rayon::current_thread_index().is_some() {
                break;
            }
            state = self.decoded.wait(state).expect("photos on the host");
        }
        state.slots[index].claimed = true;
        drop(state);
        self.decode(index)
    }

    /// Marks a photo to be decoded; false where it is there, or another thread decodes it.
    fn claim(&self, index: usize) -> bool {
        let mut state = self.lock();
        let slot = &mut state.slots[index];
        let is_free = slot.photo.is_none() && !slot.claimed;
        slot.claimed |= is_free;
        is_free
    }

    /// Decodes a photo that was claimed.
    fn decode(&self, index: usize) -> Result<Arc<Photo>, DatasetError> {
        let _released = Released { shelf: self, index };
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

/// Lets others decode a photo again.
struct Released<'a> {
    shelf: &'a Shelf,
    index: usize,
}

impl Drop for Released<'_> {
    fn drop(&mut self) {
        if let Ok(mut state) = self.shelf.state.lock() {
            state.slots[self.index].claimed = false;
        }
        self.shelf.decoded.notify_all();
    }
}

impl State {
    /// Keeps a photo in place of those used longest ago.
    fn keep(&mut self, index: usize, photo: Arc<Photo>) {
        let bytes = photo.rgba.len() as u64;
        self.clock += 1;
        let now = self.clock;
        let slot = &mut self.slots[index];
        slot.last_use = now;
        if slot.photo.replace(photo).is_none() {
            self.resident += bytes;
        }
        while self.budget.is_some_and(|budget| self.resident > budget) {
            let there = self.slots.iter_mut().filter(|slot| slot.photo.is_some());
            let Some(oldest) = there.min_by_key(|slot| slot.last_use) else { break };
            self.resident -= oldest.photo.take().map_or(0, |photo| photo.rgba.len() as u64);
            self.has_evicted = true;
        }
    }
}
