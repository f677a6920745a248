//! Compiled kernels on disk, for the next start. wgpu gives them to a program with Vulkan alone; most drivers keep their own too.

use super::Gpu;
use ibgs_data::files::{WriteError, create_folder, write_atomically};
use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// What the driver has compiled, and the file for it.
pub(super) struct Kept {
    pub cache: wgpu::PipelineCache,
    file: PathBuf,
    /// Sum of what the file holds.
    sum: Mutex<Option<[u8; 8]>>,
}

/// Tells a damaged file; no protection against a forged one.
fn sum_of(data: &[u8]) -> [u8; 8] {
    let mut hasher = DefaultHasher::new();
    hasher.write(data);
    hasher.finish().to_le_bytes()
}

/// What a file holds; none where it is missing or damaged.
fn read(file: &Path) -> Option<([u8; 8], Vec<u8>)> {
    let bytes = std::fs::read(file).ok()?;
    let (sum, data) = bytes.split_first_chunk()?;
    (sum_of(data) == *sum).then(|| (*sum, data.to_vec()))
}

impl Gpu {
    /// Takes kernels that an earlier start has compiled from a folder, which has a file for each adapter and version of its driver,
    /// and writes into it what [`Gpu::warm_up`] and [`Gpu::warm_up_rendering`] compile. Does nothing where wgpu has no such files.
    #[expect(unsafe_code, reason = "wgpu asks for it")]
    pub fn keep_kernels_in(&self, folder: &Path) {
        let key = wgpu::util::pipeline_cache_key(&self.info);
        let Some(key) = key.filter(|_| self.device.features().contains(wgpu::Features::PIPELINE_CACHE)) else { return };
        let driver = format!("{} {}", self.info.driver, self.info.driver_info);
        let driver = driver.replace(|c: char| !c.is_ascii_alphanumeric() && c != '.', "-");
        let file = folder.join(format!("{key}-{driver}"));
        let (sum, data) = read(&file).unzip();
        let descriptor =
            wgpu::PipelineCacheDescriptor { label: Some("kept kernels"), data: data.as_deref(), fallback: true };
        // SAFETY: the data are whole, and this program has written them for this adapter and driver, whose own key wgpu compares.
        let cache = unsafe { self.device.create_pipeline_cache(&descriptor) };
        let _ = self.kept.set(Kept { cache, file, sum: Mutex::new(sum) });
    }

    /// Writes what has been compiled, if it is not what the file holds.
    pub(super) fn write_kept(&self) {
        let Some(kept) = self.kept.get() else { return };
        let Some(data) = kept.cache.get_data() else { return };
        let sum = sum_of(&data);
        let mut held = kept.sum.lock().expect("kept kernels");
        if *held == Some(sum) {
            return;
        }
        match write(&kept.file, sum, &data) {
            Ok(()) => *held = Some(sum),
            Err(error) => log::debug!("compiled kernels are not kept: {error}"),
        }
    }
}

fn write(file: &Path, sum: [u8; 8], data: &[u8]) -> Result<(), WriteError> {
    if let Some(folder) = file.parent() {
        create_folder(folder)?;
    }
    write_atomically(file, |out| {
        out.write_all(&sum)?;
        out.write_all(data)
    })
}
