//! Damage by the thousand: whatever a file holds, every reader answers with a scene or a sentence. `PROPTEST_CASES` is the
//! number of damaged files for each reader; the same readers are fuzzed in `fuzz/`.

pub mod attacks;
pub mod mutate;
#[macro_use]
mod readers;
pub mod seeds;

use ibgs_core::dataset::Loaders;
use mutate::{damaged, damages};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed, TestRunner};
use std::cell::Cell;

/// Damaged files for each reader where `PROPTEST_CASES` is not set.
const CASES: u32 = 400;

/// Runs a reader on damaged seeds, then on bytes without any order.
fn survives(name: &str) {
    let (_, read) = readers::all().into_iter().find(|(reader, _)| *reader == name).unwrap();
    let seeds = seeds::of(name);
    for (at, seed) in seeds.iter().enumerate() {
        assert!(read(seed), "seed {at} of {name} is not whole");
    }
    // Readers of several files choose by the first byte; it stays, so that every one of them is damaged as often.
    let keep = usize::from(matches!(name, "pth" | "model_folder"));
    let cases = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(CASES);
    let config = Config { cases, rng_seed: RngSeed::Fixed(7), failure_persistence: None, ..Config::default() };
    let whole = Cell::new(0);
    let input = (proptest::sample::select(seeds), damages());
    let outcome = TestRunner::new(config.clone()).run(&input, |(seed, damages)| {
        whole.set(whole.get() + u32::from(read(&damaged(&seed, keep, &damages))));
        Ok(())
    });
    outcome.unwrap_or_else(|error| panic!("{name}: {error}"));
    println!("{name}: {} of {cases} damaged files were accepted", whole.get());
    assert!(whole.get() < cases, "nothing was noticed");
    let config = Config { cases: cases.div_ceil(8), ..config };
    let outcome = TestRunner::new(config).run(&proptest::collection::vec(any::<u8>(), 0..200), |bytes| {
        read(&bytes);
        Ok(())
    });
    outcome.unwrap_or_else(|error| panic!("{name}: {error}"));
}

macro_rules! survive {
    ($($name:ident),*) => {$(
        #[test]
        fn $name() {
            survives(stringify!($name));
        }
    )*};
}

each_reader!(survive);

#[test]
fn files_of_scenes() {
    Loaders::default().files().iter().for_each(|file| survives(file.name));
}
