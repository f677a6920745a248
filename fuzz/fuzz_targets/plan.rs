#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("plan"), |bytes: &[u8]| {
    ibgs_fuzz::readers::plan(bytes);
});
