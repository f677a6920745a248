//! The chunks on the device: as many as its memory may hold, those that the view needs.

use super::cut::cut;
use super::{Levels, Node};
use crate::camera::Camera;
use crate::gpu::{Buffer, Gpu, GpuError};
use crate::scene::{Harmonics, PerGaussian, Splats};
use bytemuck::cast_slice;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::io;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex};

/// Size in pixels up to which a merged Gaussian may stand for others: then its blur is of the order of the rasterizer's own.
const PIXELS: f64 = 0.25;
/// Part of the memory that Gaussians may take; images, lists, photos and depth maps have the rest.
const SHARE: f64 = 0.5;
/// Bytes of a Gaussian beside its parameters: projection, tile counts and their sums.
const WORKSPACE: usize = 48 + 8 + 8;
/// Chunks on the device at least: a view that needs fewer is no view.
const FEWEST: usize = 4;
/// Chunks that are read ahead of the frames; more would keep a view waiting for those of an earlier one.
const AHEAD: usize = 12;

/// When a frame is rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Loading {
    /// Once all chunks that it needs are there.
    #[default]
    Complete,
    /// At once, with what is there: at most so many chunks come with each frame, and coarser ones stand for those to come.
    AsItComes(usize),
}

impl Loading {
    /// For a camera that flies: 8 MB come with a frame at degree 2.
    pub const FLYING: Self = Self::AsItComes(4);
}

/// Chunks that fit into a budget of device memory; none: all leaves, and so no need of a tree.
///
/// # Errors
/// The budget holds too few.
pub fn slots(levels: &Levels, budget: Option<u64>, gpu: &Gpu, harmonics: Harmonics) -> Result<usize, GpuError> {
    let rows = harmonics.rows(levels.coefficients()).into_array();
    let chunk = levels.chunk() as u64;
    let bytes = chunk * (4 * rows.iter().sum::<usize>() + WORKSPACE) as u64;
    let widest = chunk * 4 * rows.into_iter().max().unwrap_or(1).max(12) as u64;
    let leaves = levels.leaves().count();
    let fits = budget.map_or(usize::MAX, |budget| (SHARE * budget as f64 / bytes as f64) as usize);
    let fits = fits.min((gpu.binding_limit() / widest) as usize);
    match fits < FEWEST.min(leaves) {
        true => {
            let mib = ((FEWEST as f64 * bytes as f64 / SHARE) / f64::from(1 << 20)).ceil() as u64;
            Err(GpuError::FewChunks { mib })
        }
        false => Ok(fits.min(leaves)),
    }
}

/// The chunks on the device.
#[derive(Debug)]
pub struct Stream {
    levels: Arc<Levels>,
    loading: Loading,
    /// The first so many chunks, the coarsest, always stay: what has not come yet is shown by them.
    pinned: usize,
    state: Mutex<ChunkState>,
}

#[derive(Debug)]
struct ChunkState {
    /// The chunk in each place, and when a view last wanted it.
    places: Vec<Option<(u32, u64)>>,
    place_of: HashMap<u32, usize>,
    /// Rotations of the chunks that are there; on the device they are zero for those that are not shown, which hides them.
    rotations: HashMap<u32, Vec<f32>>,
    shown: BTreeSet<u32>,
    clock: u64,
    reader: Option<Reader>,
    /// Chunks are still to come for the last view.
    is_waiting: bool,
    /// What is shown has changed since the sources' depth maps were made.
    is_new: bool,
}

/// A thread that reads chunks.
#[derive(Debug)]
struct Reader {
    wanted: Sender<u32>,
    read: Receiver<(u32, io::Result<Vec<f32>>)>,
    asked: HashSet<u32>,
}

impl Reader {
    fn new(levels: Arc<Levels>) -> Self {
        let ((wanted, requests), (answers, read)) = (channel(), channel());
        std::thread::spawn(move || {
            for node in requests {
                if answers.send((node, levels.read(node))).is_err() {
                    break;
                }
            }
        });
        Self { wanted, read, asked: HashSet::new() }
    }
}

impl Stream {
    /// Room for so many chunks, at least two, some of the coarsest among them.
    ///
    /// # Errors
    /// Not enough memory, or the file cannot be read.
    pub fn new(
        levels: Arc<Levels>,
        gpu: &Gpu,
        slots: usize,
        loading: Loading,
        harmonics: Harmonics,
    ) -> Result<(Self, Splats), GpuError> {
        let slots = slots.max(2);
        let (coefficients, count) = (levels.coefficients(), slots * levels.chunk());
        let named = PerGaussian::NAMES.zip(harmonics.rows(levels.coefficients()));
        let parameters = named.try_map(|(name, row)| gpu.allocate(name, row * count))?;
        let splats = Splats { space: levels.space, count, coefficients, harmonics, parameters };
        let mut state = ChunkState {
            places: vec![None; slots],
            place_of: HashMap::new(),
            rotations: HashMap::new(),
            shown: BTreeSet::new(),
            clock: 0,
            reader: (loading != Loading::Complete).then(|| Reader::new(levels.clone())),
            is_waiting: false,
            is_new: false,
        };
        let pinned = if loading == Loading::Complete { 1 } else { (slots / 4).clamp(1, levels.nodes.len()) };
        let all = (0..pinned as u32).collect();
        for node in 0..pinned as u32 {
            state.put(&levels, (gpu, &splats), node, &all, levels.read(node))?;
        }
        state.show(&levels, (gpu, &splats), BTreeSet::from([0]));
        Ok((Self { levels, loading, pinned, state: Mutex::new(state) }, splats))
    }

    /// Gaussians that the last frame was made of.
    pub fn shown(&self) -> usize {
        let state = self.state.lock().expect("levels of detail");
        state.shown.iter().map(|&node| self.levels.nodes[node as usize].count as usize).sum()
    }

    /// Whether a frame of the same view would show more.
    pub fn is_waiting(&self) -> bool {
        self.state.lock().expect("levels of detail").is_waiting
    }

    /// Brings what the view of a local camera needs. True where the sources' depth maps have to be made again: after a change of
    /// what is shown, once no more is to come; while a camera flies that would be in every frame.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn prepare(&self, gpu: &Gpu, splats: &Splats, camera: &Camera) -> Result<bool, GpuError> {
        self.bring((gpu, splats), camera, self.loading)
    }

    /// The same once all chunks that the view needs are there.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn complete(&self, gpu: &Gpu, splats: &Splats, camera: &Camera) -> Result<bool, GpuError> {
        self.bring((gpu, splats), camera, Loading::Complete)
    }

    fn bring(&self, device: (&Gpu, &Splats), camera: &Camera, loading: Loading) -> Result<bool, GpuError> {
        let mut state = self.state.lock().expect("levels of detail");
        let (state, levels) = (&mut *state, &*self.levels);
        state.clock += 1;
        let before = state.shown.clone();
        let slots = state.places.len();
        // Where frames do not wait, chunks of the last view stay until those of this one are there.
        let spare = if self.loading == Loading::Complete { 0 } else { slots / 8 };
        let wanted = cut(&levels.nodes, camera, slots.saturating_sub(self.pinned + spare).max(1), PIXELS);
        let needed: HashSet<u32> = (0..self.pinned as u32).chain(wanted.iter().copied()).collect();
        let mut missing: Vec<u32> = wanted.iter().copied().filter(|node| !state.place_of.contains_key(node)).collect();
        // The coarse ones first.
        missing.sort_unstable();
        match loading {
            Loading::Complete => {
                for &node in &missing {
                    state.put(levels, device, node, &needed, levels.read(node))?;
                }
                missing.clear();
            }
            Loading::AsItComes(most) => {
                for _ in 0..most {
                    let reader = state.reader.as_mut().expect("a reader");
                    let (node, numbers) = match reader.read.try_recv() {
                        Ok(read) => read,
                        Err(TryRecvError::Empty) => break,
                        Err(TryRecvError::Disconnected) => {
                            return Err(GpuError::Levels("the thread that reads chunks has ended".to_owned()));
                        }
                    };
                    reader.asked.remove(&node);
                    // Of a view that has passed.
                    if needed.contains(&node) && !state.place_of.contains_key(&node) {
                        state.put(levels, device, node, &needed, numbers)?;
                    }
                }
                missing.retain(|node| !state.place_of.contains_key(node));
                let reader = state.reader.as_mut().expect("a reader");
                for &node in &missing {
                    if reader.asked.len() < AHEAD && reader.asked.insert(node) {
                        let _ = reader.wanted.send(node);
                    }
                }
            }
        }
        state.is_waiting = !missing.is_empty();
        let shown = state.stand_ins(levels, &wanted);
        for node in shown.iter().chain(&wanted) {
            if let Some(&place) = state.place_of.get(node) {
                state.places[place] = Some((*node, state.clock));
            }
        }
        state.show(levels, device, shown);
        state.is_new |= state.shown != before;
        Ok(!state.is_waiting && std::mem::take(&mut state.is_new))
    }
}

impl ChunkState {
    /// Puts a chunk that is needed into a free place, or into that of one that is not: rather one that is not shown, and of those
    /// the one that has not been wanted for longest.
    fn put(
        &mut self,
        levels: &Levels,
        (gpu, splats): (&Gpu, &Splats),
        node: u32,
        needed: &HashSet<u32>,
        numbers: io::Result<Vec<f32>>,
    ) -> Result<(), GpuError> {
        let numbers = numbers.map_err(|error| GpuError::Levels(format!("cannot read {error}")))?;
        let free = |&place: &usize| self.places[place].is_none_or(|(old, _)| !needed.contains(&old));
        let age = |&place: &usize| self.places[place].map(|(old, last)| (self.shown.contains(&old), last));
        let place =
            (0..self.places.len()).filter(free).min_by_key(age).expect("fewer are needed than there are places");
        if let Some((old, _)) = self.places[place] {
            self.hide(levels, (gpu, splats), old);
            self.place_of.remove(&old);
            self.rotations.remove(&old);
        }
        let first = place * levels.chunk();
        let rows = splats.harmonics.rows(levels.coefficients());
        let parts = levels.parts(&numbers);
        let values = splats.harmonics.pack(parts, levels.coefficients());
        for ((values, row), buffer) in values.zip(rows).zip(splats.parameters.as_ref()).into_array() {
            if !std::ptr::eq(buffer, &raw const splats.parameters.rotations) {
                write(gpu, buffer, first * row, &values);
            }
        }
        self.places[place] = Some((node, self.clock));
        self.place_of.insert(node, place);
        self.rotations.insert(node, parts.rotations.to_vec());
        Ok(())
    }

    /// For each wanted chunk itself, its parts, or what stands for it: all of them there.
    fn stand_ins(&self, levels: &Levels, wanted: &[u32]) -> BTreeSet<u32> {
        let (mut shown, mut coarse) = (BTreeSet::new(), HashSet::new());
        for &node in wanted {
            if self.place_of.contains_key(&node) {
                shown.insert(node);
            } else if let Some(parts) = self.parts(&levels.nodes, node) {
                shown.extend(parts);
            } else {
                let mut node = node;
                while !self.place_of.contains_key(&node) {
                    node = levels.parents[node as usize];
                }
                coarse.insert(node);
            }
        }
        let is_below = |&node: &u32| {
            let mut at = node;
            while at != 0 {
                at = levels.parents[at as usize];
                if coarse.contains(&at) {
                    return true;
                }
            }
            false
        };
        shown.extend(&coarse);
        shown.into_iter().filter(|node| !is_below(node)).collect()
    }

    /// Chunks that are there and together are a finer form of this one.
    fn parts(&self, nodes: &[Node], node: u32) -> Option<Vec<u32>> {
        if self.place_of.contains_key(&node) {
            return Some(vec![node]);
        }
        let [left, right] = nodes[node as usize].children?;
        let mut parts = self.parts(nodes, left)?;
        parts.extend(self.parts(nodes, right)?);
        Some(parts)
    }

    /// Shows these chunks alone.
    fn show(&mut self, levels: &Levels, (gpu, splats): (&Gpu, &Splats), shown: BTreeSet<u32>) {
        let gone: Vec<u32> = self.shown.difference(&shown).copied().collect();
        gone.into_iter().for_each(|node| self.hide(levels, (gpu, splats), node));
        for &node in shown.difference(&self.shown) {
            write(
                gpu,
                &splats.parameters.rotations,
                self.first_rotation(levels, node),
                cast_slice(&self.rotations[&node]),
            );
        }
        self.shown = shown;
    }

    fn hide(&mut self, levels: &Levels, (gpu, splats): (&Gpu, &Splats), node: u32) {
        if self.shown.remove(&node) {
            let zeros = vec![0; self.rotations[&node].len()];
            write(gpu, &splats.parameters.rotations, self.first_rotation(levels, node), &zeros);
        }
    }

    fn first_rotation(&self, levels: &Levels, node: u32) -> usize {
        4 * self.place_of[&node] * levels.chunk()
    }
}

/// Writes words into a buffer of them, from one on.
fn write(gpu: &Gpu, buffer: &Buffer<f32>, first: usize, words: &[u32]) {
    gpu.write(&buffer.cast(), first, words);
}
