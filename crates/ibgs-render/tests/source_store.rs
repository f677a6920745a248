//! Photos and depth maps on the device within a budget.

use ibgs_data::dataset::{HostPhoto, Photo};
use ibgs_reference::gpu::gpu;
use ibgs_render::sources::DevicePhoto;
use ibgs_render::sources::depth_cache::DepthCache;
use ibgs_render::sources::source_store::SourceStore;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Photos of 13 x 9 and 8 x 4 pixels in turn.
fn photos(count: usize) -> Vec<HostPhoto> {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    (0..count)
        .map(|i| {
            let (width, height) = if i % 2 == 0 { (13, 9) } else { (8, 4) };
            let rgba = (0..width * height * 4).map(|_| rng.random()).collect();
            Photo { width, height, rgba }.into()
        })
        .collect()
}

const LARGE: u64 = 480;
const SMALL: u64 = 128;

fn contents(target: &DevicePhoto) -> Vec<u8> {
    gpu().read(&target.texels.cast(), (target.size[0] * target.size[1] * 4) as usize).unwrap()
}

fn resident(store: &SourceStore) -> Vec<usize> {
    (0..store.len()).filter(|&i| store.is_resident(i)).collect()
}

#[test]
fn contents_do_not_depend_on_the_budget() {
    let photos = photos(9);
    let all = 5 * LARGE + 4 * SMALL;
    for budget in [None, Some(all), Some(all - 1), Some(2 * LARGE), Some(SMALL), Some(0)] {
        let store = SourceStore::new(gpu(), photos.clone(), budget).unwrap();
        let fits = budget.is_none_or(|budget| budget >= all);
        assert_eq!(store.resident_bytes(), if fits { all } else { 0 });
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        for _ in 0..40 {
            let index = rng.random_range(0..9);
            let target = store.photo(index).unwrap();
            assert_eq!(target.size, photos[index].size());
            assert!(
                contents(&target) == photos[index].pixels().unwrap().rgba,
                "photo {index} with a budget of {budget:?}"
            );
            assert!(budget.is_none_or(|budget| store.resident_bytes() <= budget.max(LARGE)));
        }
        println!("budget {budget:?}: {} uploads", store.uploads());
        assert_eq!(store.uploads() == 9, fits);
    }
}

#[test]
fn photos_unused_for_longest_leave_first() {
    let store = SourceStore::new(gpu(), photos(9), Some(3 * LARGE)).unwrap();
    for index in [0, 2, 4, 0] {
        store.photo(index).unwrap();
    }
    assert_eq!(resident(&store), [0, 2, 4]);
    store.photo(6).unwrap();
    assert_eq!(resident(&store), [0, 4, 6]);
    // A small one takes the place of a large one, and the next small one fits beside it.
    store.prefetch(&[1, 3]).unwrap();
    assert_eq!(resident(&store), [0, 1, 3, 6]);
    assert_eq!(store.resident_bytes(), 2 * LARGE + 2 * SMALL);
}

#[test]
fn photos_in_use_stay() {
    let photos = photos(9);
    let store = SourceStore::new(gpu(), photos.clone(), Some(2 * LARGE)).unwrap();
    let held = store.photos(&[0, 2, 4]).unwrap();
    assert_eq!((resident(&store), store.resident_bytes()), (vec![0, 2, 4], 3 * LARGE));
    let six = store.photo(6).unwrap();
    assert_eq!(store.resident_bytes(), 4 * LARGE);
    for (target, index) in held.iter().chain([&six]).zip([0, 2, 4, 6]) {
        assert!(contents(target) == photos[index].pixels().unwrap().rgba);
    }
    // Once they are let go the next one brings the store back under its budget.
    drop((held, six));
    store.photo(8).unwrap();
    assert_eq!((resident(&store), store.resident_bytes()), (vec![6, 8], 2 * LARGE));
    // Asked for as a set, what is there stays.
    let set = store.photos(&[0, 8]).unwrap();
    assert_eq!(resident(&store), [0, 8]);
    assert!(
        contents(&set[0]) == photos[0].pixels().unwrap().rgba && contents(&set[1]) == photos[8].pixels().unwrap().rgba
    );
}

#[test]
fn depth_maps_are_kept_within_their_budget() {
    let map = |value: f32, count: usize| gpu().upload("depth", &vec![value; count]).unwrap();
    let mut cache = DepthCache::new(Some(3 * LARGE));
    for view in 0..3 {
        cache.insert(view, map(view as f32, 120));
    }
    assert!(cache.get(0).is_some());
    cache.insert(7, map(7.0, 120));
    assert!(cache.get(1).is_none() && cache.len() == 3 && cache.resident_bytes() == 3 * LARGE);
    // A newer map of the same view takes its place alone.
    cache.insert(2, map(2.5, 120));
    assert_eq!(cache.len(), 3);
    for (view, value) in [(0, 0.0), (2, 2.5), (7, 7.0)] {
        let found = cache.get(view).unwrap();
        assert_eq!(gpu().read::<f32>(&found, 120).unwrap(), vec![value; 120]);
    }
    // A map above the whole budget is kept, alone.
    let kept = cache.get(7).unwrap();
    cache.insert(9, map(9.0, 1_000));
    assert!(cache.len() == 1 && cache.get(9).is_some());
    assert_eq!(gpu().read::<f32>(&kept, 120).unwrap(), [7.0; 120]);
    cache.clear();
    assert!(cache.is_empty() && cache.resident_bytes() == 0);
}
