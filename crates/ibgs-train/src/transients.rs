//! What moves, in a training: each photo's cells gather how far the photo is from the render and from the photos warped to it, and
//! now and then masks hide the cells that are far from both.

mod mask;
mod oddity;
mod rules;

pub use oddity::Oddity;
pub use rules::MaskRules;

use crate::loss::WarpedSources;
use crate::tensor::{bind, primitive};
use burn::tensor::Tensor;
use ibgs_core::camera::Camera;
use ibgs_core::config::{TrainConfig, TransientSwitch};
use ibgs_core::dataset::CellMask;
use ibgs_core::gpu::{Buffer, Gpu, GpuError, Pass};
use ibgs_core::sources::DevicePhoto;
use ibgs_core::sources::source_store::SourceStore;
use ibgs_shaders::bindings::TransientCellsBindings;
use ibgs_shaders::types::TransientParams;
use mask::Cell;
use std::sync::Arc;

/// Rows of a cell on the device.
const ROWS: usize = 3;
/// Numbers of a cell in a checkpoint: its rows, and whether it is hidden.
const NUMBERS: usize = 4 * ROWS + 1;

/// A photo with its evidence.
struct Gathered {
    size: [u32; 2],
    evidence: Buffer<[f32; 4]>,
    mask: Arc<CellMask>,
    oddity: Option<Oddity>,
}

impl Gathered {
    fn cells(&self) -> usize {
        self.mask.hidden().len()
    }

    fn read(&self, gpu: &Gpu) -> Result<Vec<Cell>, GpuError> {
        let rows = gpu.read(&self.evidence, ROWS * self.cells())?;
        let value = |row: &[f32; 4]| (row[3] > 0.0).then(|| [0, 1, 2].map(|c| row[c] / row[3]));
        let cell = |rows: &[[f32; 4]]| Cell {
            difference: value(&rows[0]),
            from_sources: value(&rows[1]),
            error: value(&rows[2]),
        };
        Ok(rows.chunks_exact(ROWS).map(cell).collect())
    }
}

/// The masks of the training photos as they are learned.
pub(super) struct Masking {
    gpu: Arc<Gpu>,
    switch: TransientSwitch,
    /// What decides.
    pub rules: MaskRules,
    photos: Vec<Gathered>,
    /// Stand in where nothing is warped.
    no_colors: Buffer<f32>,
    no_seen: Buffer<u32>,
}

impl Masking {
    /// None where none are learned.
    pub fn new(gpu: &Arc<Gpu>, cameras: &[Camera], config: &TrainConfig) -> Result<Option<Self>, GpuError> {
        let switch = config.transients.mask;
        if switch == TransientSwitch::Off || config.data.shows_object() {
            return Ok(None);
        }
        let gathered = |camera: &Camera| {
            let size = [camera.width, camera.height];
            let [columns, rows] = CellMask::grid(size).map(|n| n as usize);
            let mask = CellMask::new(size, vec![false; columns * rows]).expect("as many cells as the photo has");
            let (mask, oddity) = (Arc::new(mask), None);
            let evidence = gpu.upload("evidence of what moves", &vec![[0.0; 4]; ROWS * columns * rows])?;
            Ok(Gathered { size, evidence, mask, oddity })
        };
        Ok(Some(Self {
            photos: cameras.iter().map(gathered).collect::<Result<_, GpuError>>()?,
            no_colors: gpu.allocate("no warped colours", 4)?,
            no_seen: gpu.allocate("no visible sources", 4)?,
            gpu: gpu.clone(),
            switch,
            rules: MaskRules::default(),
        }))
    }

    /// Records what a visit says of a photo: `shown` is the base image in its exposure.
    pub fn record(
        &self,
        pass: &mut Pass,
        index: usize,
        target: &DevicePhoto,
        shown: &Tensor<3>,
        warped: Option<&WarpedSources>,
    ) {
        let photo = &self.photos[index];
        let image = bind(&primitive(shown.clone().inner()));
        let sources = warped.map(|warped| {
            let colors = warped.colors.clone().inner();
            (colors.dims()[0] as u32, bind(&primitive(colors)), &warped.visible)
        });
        let (visible, warped, seen) = match &sources {
            Some((visible, colors, seen)) => (*visible, colors, *seen),
            None => (0, &self.no_colors, &self.no_seen),
        };
        let bindings =
            TransientCellsBindings { photo: &target.texels, image: &image, warped, seen, evidence: &photo.evidence };
        let (size, side) = (photo.size, CellMask::side(photo.size));
        let cells = CellMask::grid(size);
        let params =
            TransientParams { size, cells, side, visible, rate: self.rules.rate, ..TransientParams::default() };
        pass.relabel("what moves");
        pass.linear(&bindings, &params, photo.cells());
    }

    /// Weight of a photo's loss; none: 1.
    pub fn weight(&self, index: usize) -> Option<f32> {
        self.photos[index].oddity.map(|_| self.rules.odd_weight)
    }

    /// Makes all masks anew, and hides their cells; waits for the GPU.
    pub fn make_masks(&mut self, store: &SourceStore) -> Result<(), GpuError> {
        let cells = self.photos.iter().map(|photo| photo.read(&self.gpu)).collect::<Result<Vec<_>, _>>()?;
        let all = cells.iter().flat_map(|cells| mask::distances(cells)).collect();
        let Some(scale) = mask::quantile(all, self.rules.usual) else { return Ok(()) };
        let masks = self.photos.iter().zip(&cells).map(|(photo, cells)| {
            let columns = CellMask::grid(photo.size)[0] as usize;
            let hidden = mask::hidden(cells, columns, photo.mask.hidden(), scale, &self.rules);
            let count = hidden.iter().filter(|hidden| **hidden).count();
            // Such a photo is bad as a whole.
            if count as f32 > self.rules.limit * cells.len() as f32 { vec![false; cells.len()] } else { hidden }
        });
        let mut masks: Vec<Vec<bool>> = masks.collect();
        let total: usize = cells.iter().map(Vec::len).sum();
        let found = masks.iter().flatten().filter(|hidden| **hidden).count();
        if self.switch == TransientSwitch::Auto && (found as f64) < self.rules.worth * total as f64 {
            masks.iter_mut().for_each(|mask| mask.fill(false));
        }
        let oddities = oddity::oddities(&cells, &self.rules);
        self.photos.iter_mut().zip(oddities).for_each(|(photo, oddity)| photo.oddity = oddity);
        for (index, (photo, hidden)) in self.photos.iter_mut().zip(masks).enumerate() {
            photo.mask = Arc::new(CellMask::new(photo.size, hidden).expect("a value a cell"));
            store.set_mask(index, photo.mask.clone())?;
        }
        Ok(())
    }

    /// The photos' masks, in the order of the training views.
    pub fn masks(&self) -> Vec<Arc<CellMask>> {
        self.photos.iter().map(|photo| photo.mask.clone()).collect()
    }

    /// How each photo disagrees as a whole, in the same order.
    pub fn oddities(&self) -> Vec<Option<Oddity>> {
        self.photos.iter().map(|photo| photo.oddity).collect()
    }

    /// Numbers of its state, for photos of these widths and heights.
    pub fn numbers(sizes: &[[u32; 2]]) -> usize {
        let of = |size: &[u32; 2]| CellMask::grid(*size).iter().map(|n| *n as usize).product::<usize>();
        sizes.iter().map(|size| 1 + NUMBERS * of(size)).sum()
    }

    /// Everything on the host; waits for the GPU.
    pub fn state(&self) -> Result<Vec<f32>, GpuError> {
        let mut state = Vec::new();
        for photo in &self.photos {
            state.extend(self.gpu.read(&photo.evidence, ROWS * photo.cells())?.as_flattened());
            state.extend(photo.mask.hidden().iter().map(|hidden| f32::from(u8::from(*hidden))));
            // 0: none; otherwise its number, from 1.
            state.push(photo.oddity.map_or(0.0, |oddity| 1.0 + f32::from(oddity as u8)));
        }
        Ok(state)
    }

    /// Goes on from there; the state has as many [`numbers`](Self::numbers) as the photos have.
    pub fn restore(&mut self, state: &[f32], store: &SourceStore) -> Result<(), GpuError> {
        let mut rest = state;
        for (index, photo) in self.photos.iter_mut().enumerate() {
            let (evidence, after) = rest.split_at(4 * ROWS * photo.cells());
            let (hidden, after) = after.split_at(photo.cells());
            photo.oddity = (after[0] as usize).checked_sub(1).and_then(|number| Oddity::ALL.get(number).copied());
            rest = &after[1..];
            self.gpu.write(&photo.evidence, 0, evidence.as_chunks::<4>().0);
            let hidden = hidden.iter().map(|hidden| *hidden > 0.5).collect();
            photo.mask = Arc::new(CellMask::new(photo.size, hidden).expect("a value a cell"));
            store.set_mask(index, photo.mask.clone())?;
        }
        Ok(())
    }
}
