#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("colmap_binary"), |bytes: &[u8]| {
    ibgs_fuzz::readers::colmap_binary(bytes);
});
