#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("pose_arrays"), |bytes: &[u8]| {
    ibgs_fuzz::readers::pose_arrays(bytes);
});
