#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("zip_scene"), |bytes: &[u8]| {
    ibgs_fuzz::readers::zip_scene(bytes);
});
