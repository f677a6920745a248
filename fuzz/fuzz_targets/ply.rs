#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("ply"), |bytes: &[u8]| {
    ibgs_fuzz::readers::ply(bytes);
});
