#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds(), |bytes: &[u8]| {
    ibgs_fuzz::read(bytes);
});
