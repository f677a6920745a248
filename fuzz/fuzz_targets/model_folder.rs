#![no_main]

libfuzzer_sys::fuzz_target!(init: ibgs_fuzz::write_seeds("model_folder"), |bytes: &[u8]| {
    ibgs_fuzz::readers::model_folder(bytes);
});
