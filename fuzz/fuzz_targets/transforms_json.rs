#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("transforms_json"), |bytes: &[u8]| {
    ibgs_fuzz::readers::transforms_json(bytes);
});
