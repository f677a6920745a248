//! Compiled kernels on disk.

use ibgs_reference::gpu::open_gpu;
use std::fs;
use std::path::Path;

/// Opens a device, compiles the kernels of the base and gives the files.
fn start(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let gpu = open_gpu();
    gpu.keep_kernels_in(folder);
    gpu.warm_up_rendering(false);
    assert!(gpu.sorts_right().unwrap());
    gpu.check().unwrap();
    let Ok(files) = fs::read_dir(folder) else { return Vec::new() };
    let paths = files.map(|file| file.unwrap().path());
    paths.map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), fs::read(path).unwrap())).collect()
}

#[test]
fn a_start_takes_what_another_has_kept_and_replaces_what_is_damaged() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("ibgs/kernels");
    let first = start(&folder);
    let [(name, bytes)] = &first[..] else {
        return ibgs_testing::skipped("a_start_takes_what_another_has_kept", "wgpu has no such files for this adapter");
    };
    assert!(name.contains("vulkan") && bytes.len() > 8, "{name}: {} bytes", bytes.len());
    let again = start(&folder);
    assert_eq!(again.len(), 1);
    for damaged in [&bytes[..bytes.len() - 1], &bytes[..4], b"", &[bytes.as_slice(), b"more"].concat(), &{
        let mut other = bytes.clone();
        *other.last_mut().unwrap() ^= 1;
        other
    }] {
        fs::write(folder.join(name), damaged).unwrap();
        let [(after, written)] = &start(&folder)[..] else { panic!("one file") };
        assert_eq!(after, name);
        assert!(written != damaged && written.len() > 8, "{} bytes", damaged.len());
    }
    // A folder that cannot be written is no reason to stop.
    fs::write(home.path().join("file"), "").unwrap();
    assert!(start(&home.path().join("file/below")).is_empty());
}
