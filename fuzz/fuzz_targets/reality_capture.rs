#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("reality_capture"), |bytes: &[u8]| {
    ibgs_fuzz::readers::reality_capture(bytes);
});
