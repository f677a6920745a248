#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("colmap_text"), |bytes: &[u8]| {
    ibgs_fuzz::readers::colmap_text(bytes);
});
