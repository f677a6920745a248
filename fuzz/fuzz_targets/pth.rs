#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("pth"), |bytes: &[u8]| {
    ibgs_fuzz::readers::pth(bytes);
});
