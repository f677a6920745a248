#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("camera_path"), |bytes: &[u8]| {
    ibgs_fuzz::readers::camera_path(bytes);
});
