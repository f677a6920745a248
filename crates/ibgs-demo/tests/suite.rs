//! The tests of the demo scene: one binary, no GPU.
#![allow(missing_docs)]
#![forbid(unsafe_code)]

mod cache;
mod scene;
mod tracks;
mod walkers;

use ibgs_data::dataset::Dataset;
use ibgs_demo::DemoOptions;
use std::path::Path;

fn tiny() -> DemoOptions {
    DemoOptions { width: 40, height: 30, views: 10, samples: 2, points: 500, seed: 3 }
}

fn load(options: &DemoOptions, cache: &Path) -> Dataset {
    ibgs_demo::load(options, Some(cache), &()).expect("the tiny demo scene loads")
}

fn assert_same(a: &Dataset, b: &Dataset) {
    assert_eq!(a.views.len(), b.views.len());
    for (x, y) in a.views.iter().zip(&b.views) {
        assert_eq!(x.name, y.name);
        assert_eq!(x.camera, y.camera);
        assert_eq!(x.photo.pixels().unwrap().rgba, y.photo.pixels().unwrap().rgba, "pixels of {}", x.name);
    }
    let bits = |set: &Dataset| -> Vec<([f64; 3], [u8; 3])> {
        set.points.iter().map(|p| (p.position.to_array(), p.color)).collect()
    };
    assert_eq!(bits(a), bits(b));
    assert_eq!((&a.train, &a.test), (&b.train, &b.test));
}
