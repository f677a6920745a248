//! What tests of an adapter came to, kept in the user's cache folder: a file for each test and adapter. It holds for one driver,
//! version of the kernels and of the program; where any differs, where it is damaged or cannot be written, the test runs again.

use super::{Gpu, GpuError};
use crate::files::write_atomically;
use ibgs_shaders::fingerprint;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::PathBuf;
use std::time::Duration;

/// A file.
#[derive(Serialize, Deserialize)]
struct Kept<T> {
    /// What the test ran on.
    adapter: String,
    result: T,
}

/// The results of one adapter.
struct Results {
    /// None where the machine has no cache folder.
    folder: Option<PathBuf>,
    /// Everything that a result depends on, in words.
    adapter: String,
    /// Of the adapter alone: what the files are called.
    hash: u64,
}

impl Results {
    fn of(info: &wgpu::AdapterInfo) -> Self {
        Self::at(dirs::cache_dir().map(|folder| folder.join("ibgs").join("adapters")), info)
    }

    fn at(folder: Option<PathBuf>, info: &wgpu::AdapterInfo) -> Self {
        let wgpu::AdapterInfo { name, vendor, device, driver, driver_info, backend, .. } = info;
        let lanes = [info.subgroup_min_size, info.subgroup_max_size];
        let (version, kernels) = (env!("CARGO_PKG_VERSION"), fingerprint());
        let adapter = format!(
            "{name}, {vendor:x}:{device:x}, {backend:?}, {driver}, {driver_info}, subgroups {lanes:?}, ibgs {version}, kernels {kernels:x}"
        );
        let mut hasher = DefaultHasher::new();
        (name, vendor, device, backend).hash(&mut hasher);
        Self { folder, adapter, hash: hasher.finish() }
    }

    fn path(&self, test: &str) -> Option<PathBuf> {
        Some(self.folder.as_ref()?.join(format!("{test}-{:016x}.json", self.hash)))
    }

    fn read<T: DeserializeOwned>(&self, test: &str) -> Option<T> {
        let bytes = std::fs::read(self.path(test)?).ok()?;
        let kept: Kept<T> = serde_json::from_slice(&bytes).ok()?;
        (kept.adapter == self.adapter).then_some(kept.result)
    }

    fn write<T: Serialize>(&self, test: &str, result: &T) {
        let Some(path) = self.path(test) else { return };
        let kept = Kept { adapter: self.adapter.clone(), result };
        // Without the file the next start tests once more.
        if let Err(error) = write_atomically(&path, |out| Ok(serde_json::to_writer(out, &kept)?)) {
            log::debug!("{error}");
        }
    }

    fn tested<T: Serialize + DeserializeOwned, E>(
        &self,
        name: &str,
        test: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        if let Some(kept) = self.read(name) {
            return Ok(kept);
        }
        let result = test()?;
        self.write(name, &result);
        Ok(result)
    }

    /// A time that is longer than `enough` is measured again, and the shortest counts: another program may have kept the adapter
    /// busy.
    fn time<E>(&self, name: &str, enough: Duration, test: impl FnOnce() -> Result<Duration, E>) -> Result<Duration, E> {
        let kept = self.read(name).unwrap_or(Duration::MAX);
        if kept <= enough {
            return Ok(kept);
        }
        let time = test()?.min(kept);
        self.write(name, &time);
        Ok(time)
    }
}

/// What a test of an adapter came to: as an earlier start with the same driver has kept it, else by the test.
///
/// # Errors
/// Those of the test.
pub fn tested<T: Serialize + DeserializeOwned, E>(
    info: &wgpu::AdapterInfo,
    name: &str,
    test: impl FnOnce() -> Result<T, E>,
) -> Result<T, E> {
    Results::of(info).tested(name, test)
}

// On a device that another program has opened the tests always run: it may lack what its adapter has.
impl Gpu {
    pub(crate) fn tested<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        test: impl FnOnce() -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        if self.is_own { Results::of(&self.info).tested(name, test) } else { test() }
    }

    /// How long something takes: as it is kept where that is no longer than `enough`, else the shortest time so far.
    pub(crate) fn time(
        &self,
        name: &str,
        enough: Duration,
        test: impl FnOnce() -> Result<Duration, GpuError>,
    ) -> Result<Duration, GpuError> {
        if self.is_own { Results::of(&self.info).time(name, enough, test) } else { test() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn results(folder: &Path, driver: &str) -> Results {
        let info = wgpu::AdapterInfo::new(wgpu::DeviceType::Other, wgpu::Backend::Vulkan);
        let info = wgpu::AdapterInfo { name: "a card".to_owned(), driver_info: driver.to_owned(), ..info };
        Results::at(Some(folder.to_owned()), &info)
    }

    #[test]
    fn a_result_is_kept_by_adapter_and_driver() {
        let folder = tempfile::tempdir().unwrap();
        let of = |driver: &str, test: &str, result: u32| {
            results(folder.path(), driver).tested(test, || Ok::<_, ()>(result)).unwrap()
        };
        assert_eq!([of("1", "a", 1), of("1", "a", 2), of("1", "b", 3)], [1, 1, 3]);
        // Another driver; the file is that of the latest.
        assert_eq!([of("2", "a", 4), of("2", "a", 5), of("1", "a", 6)], [4, 4, 6]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_failure_is_not_kept_and_a_damaged_file_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let results = results(&folder.path().join("made"), "1");
        let run = |result: Result<f32, &'static str>| results.tested("a", || result);
        assert_eq!([run(Err("lost")), run(Ok(0.5)), run(Err("not run"))], [Err("lost"), Ok(0.5), Ok(0.5)]);
        let file = results.path("a").unwrap();
        let whole = std::fs::read(&file).unwrap();
        for damaged in [&whole[..whole.len() / 2], b"", b"{\"adapter\": 1}", b"\xff\xfe"] {
            std::fs::write(&file, damaged).unwrap();
            assert_eq!([run(Ok(0.5)), run(Ok(1.0))], [Ok(0.5), Ok(0.5)]);
            assert_eq!(std::fs::read(&file).unwrap(), whole);
        }
    }

    #[test]
    fn a_long_time_is_measured_again() {
        let folder = tempfile::tempdir().unwrap();
        let results = results(folder.path(), "1");
        let run = |time| results.time("a", Duration::from_secs(2), || Ok::<_, ()>(Duration::from_secs(time)));
        let times = [5, 7, 3, 2, 1].map(|time| run(time).unwrap().as_secs());
        assert_eq!(times, [5, 5, 3, 2, 2]);
    }

    #[test]
    fn without_a_folder_that_can_be_written_the_test_runs_each_time() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let of_file = results(file.path(), "1");
        let without = Results { folder: None, ..results(file.path(), "1") };
        for results in [of_file, without] {
            let run = |result: u32| results.tested("a", || Ok::<_, ()>(result)).unwrap();
            assert_eq!([run(1), run(2)], [1, 2]);
        }
    }
}
