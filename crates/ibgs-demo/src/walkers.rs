//! The demo scene with somebody who walks through it: some training photos show a figure that no other photo shows there, with its
//! shadow and its mirror images.

use super::cache::Cache;
use super::figure::Figure;
use super::numeric::Stream;
use super::scene::{Object, Scene, TABLE, scene};
use super::shape::Ray;
use super::texture::ROOM_HALF;
use super::trace::{render_in, walker_pixels};
use super::{DemoError, DemoOptions, load};
use glam::DVec2;
use ibgs_data::adjust::{Seen, Track};
use ibgs_data::camera::Camera;
use ibgs_data::dataset::{Dataset, Photo};
use ibgs_data::progress::Progress;
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// Heights of walkers in metres: the cameras look down, and taller ones would lose their heads.
const HEIGHTS: [f64; 2] = [1.0, 1.3];
/// Least distance of a walker from its photo's camera in metres.
const CAMERA_DISTANCE: f64 = 1.7;
/// Least distance of a walker's middle from walls and table in metres.
const CLEARANCE: f64 = 0.38;
/// Distance in metres from which on two walkers stand apart.
const APART: f64 = 0.25;
/// Places that are tried for each walker.
const TRIES: usize = 192;
/// Points of a body that its photo should show: to the side as the camera sees it and up, in heights of the body.
const BODY: [[f64; 2]; 6] = [[0.0, 0.02], [0.0, 0.3], [0.0, 0.6], [0.0, 0.97], [-0.2, 0.6], [0.2, 0.6]];
/// Off the walker, a pixel counts as changed where a channel differs by more than this.
const SHADOW_LEVELS: u8 = 2;

/// A demo scene with walkers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct WalkerOptions {
    /// The scene without them.
    pub scene: DemoOptions,
    /// Percent of the training photos that show a walker, 0 to 100; rounded to a number of photos.
    pub percent: u32,
}

/// What a walker did to a pixel of its photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum WalkerPixel {
    /// Nothing, but for two levels at most.
    Same = 0,
    /// The pixel does not show the walker, and a channel differs by more than two levels: by a shadow or a reflection.
    Shadow = 128,
    /// A ray of the pixel meets the walker.
    Figure = 255,
}

/// What a walker did to its photo, before a change of the exposure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WalkerMask {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height` pixels, row by row.
    pub pixels: Vec<WalkerPixel>,
}

/// A demo scene with walkers, and where they are.
pub struct Walked {
    /// The scene.
    pub dataset: Dataset,
    /// For each view the mask of its walker, if it has one.
    pub masks: Vec<Option<WalkerMask>>,
}

/// Reads the demo scene with walkers from the cache, and traces what is missing there. Each walker stands in one training photo, and
/// nowhere twice. Held-out photos, the other training photos and the points are those of the scene without walkers.
///
/// The scene has its own folder, as [`load`] says; masks are in its folder `walkers`, with the names of their photos: 255 is
/// the walker, 128 its shadow or reflection.
///
/// # Errors
/// Options outside of their range. A folder that cannot be written is a note of the data set.
pub fn walkers(
    options: &WalkerOptions,
    cache_dir: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Walked, DemoError> {
    let WalkerOptions { scene: demo, percent } = options;
    if *percent > 100 {
        return Err(DemoError::Option { field: "walkers", value: u64::from(*percent), least: 0, most: 100 });
    }
    let mut dataset = load(demo, cache_dir, progress)?;
    let mut masks = vec![None; dataset.views.len()];
    if *percent == 0 {
        return Ok(Walked { dataset, masks });
    }
    let cache = Cache::new(cache_dir, &format!("{}-{percent}w", demo.folder_name()));
    let places = places(&dataset, *percent, demo.seed);
    let scenes: Vec<Scene> = places.iter().map(|walker| Scene::with(walker.figure(demo.seed))).collect();
    let views = places.iter().map(|walker| &dataset.views[walker.view]);
    let wanted: Vec<(String, Camera)> = views.map(|view| (view.name.clone(), view.camera)).collect();
    let render = |index: usize| render_in(&scenes[index], &wanted[index].1, demo.samples);
    let (photos, trouble) = cache.photos(&wanted, render, progress, &mut dataset.notes);
    for ((walker, scene), photo) in places.iter().zip(&scenes).zip(photos) {
        let view = &mut dataset.views[walker.view];
        let shown = walker_pixels(scene, &view.camera, demo.samples);
        masks[walker.view] = Some(WalkerMask::new(&shown, &*view.photo.pixels()?, &photo));
        view.photo = photo.into();
    }
    dataset.made_tracks = shown_tracks(&dataset.made_tracks, &masks);
    let trouble = trouble.or_else(|| fill_folder(&cache, options, &dataset, &masks).err());
    dataset.notes.extend(trouble.filter(|trouble| !dataset.notes.contains(trouble)));
    dataset.path = cache.path();
    Ok(Walked { dataset, masks })
}

/// Writes all but the photos of walkers; the error is a note for the user.
fn fill_folder(
    cache: &Cache,
    options: &WalkerOptions,
    dataset: &Dataset,
    masks: &[Option<WalkerMask>],
) -> Result<(), String> {
    for (view, mask) in dataset.views.iter().zip(masks) {
        match mask {
            Some(WalkerMask { width, height, pixels }) => {
                let levels: Vec<u8> = pixels.iter().map(|&pixel| pixel as u8).collect();
                cache.write_mask(&view.name, &levels, [*width, *height])?;
            }
            None => {
                let photo = view.photo.pixels().map_err(|error| error.to_string())?;
                cache.keep_photo(&view.name, &photo)?;
            }
        }
    }
    let cameras: Vec<Camera> = dataset.views.iter().map(|view| view.camera).collect();
    cache.describe(options, &cameras, (&dataset.points, &dataset.made_tracks))
}

/// The tracks without what walkers hide.
fn shown_tracks(tracks: &[Track], masks: &[Option<WalkerMask>]) -> Arc<[Track]> {
    let is_shown = |seen: &&Seen| {
        let hides = |mask: &WalkerMask| {
            let [x, y] = seen.pixel.to_array().map(|at| at as usize);
            mask.pixels[y * mask.width as usize + x] == WalkerPixel::Figure
        };
        !masks[seen.view].as_ref().is_some_and(hides)
    };
    let shown = |track: &Track| Track { seen: track.seen.iter().filter(is_shown).copied().collect(), ..*track };
    tracks.iter().map(shown).filter(|track| track.seen.len() > 1).collect()
}

/// Where the walker of a photo stands.
struct Walker {
    /// Its view.
    view: usize,
    /// Its middle on the floor.
    place: DVec2,
    /// Its height in metres.
    height: f64,
}

impl Walker {
    fn figure(&self, seed: u64) -> Figure {
        Figure::walking(self.place, self.height, &mut Stream::new(seed, 5, self.view as u64))
    }
}

/// The walkers of so many percent of the training photos, in the order of their views. More percent add walkers to those of fewer.
fn places(dataset: &Dataset, percent: u32, seed: u64) -> Vec<Walker> {
    let mut order = dataset.train.clone();
    order.sort_by_key(|&view| (Stream::new(seed, 3, view as u64).bits(), view));
    order.truncate((order.len() * percent as usize + 50) / 100);
    let mut placed: Vec<Walker> = Vec::new();
    for view in order {
        let walker = place(&dataset.views[view].camera, view, seed, &placed);
        placed.push(walker);
    }
    placed.sort_by_key(|walker| walker.view);
    placed
}

/// The place of which the camera sees most, apart from the others.
fn place(camera: &Camera, view: usize, seed: u64, others: &[Walker]) -> Walker {
    let mut random = Stream::new(seed, 4, view as u64);
    let height = HEIGHTS[0] + (HEIGHTS[1] - HEIGHTS[0]) * random.uniform();
    let mut best = (-1.0, DVec2::ZERO);
    for _ in 0..TRIES {
        let place = DVec2::new(random.signed(), random.signed()) * (ROOM_HALF.truncate() - DVec2::splat(CLEARANCE));
        let nearest = others.iter().map(|other| other.place.distance(place)).fold(APART, f64::min);
        let score = if is_free(place, camera) { seen(camera, place, height) as f64 + nearest / APART } else { 0.0 };
        if score > best.0 {
            best = (score, place);
        }
    }
    Walker { view, place: best.1, height }
}

/// Whether a walker has room there, beside the table and away from the camera.
fn is_free(place: DVec2, camera: &Camera) -> bool {
    let is_away = |object: &Object| {
        let solid = &object.solid;
        object.id != TABLE || solid.distance(place.extend(solid.center.z)) >= CLEARANCE
    };
    camera.center().truncate().distance(place) >= CAMERA_DISTANCE && scene().objects.iter().all(is_away)
}

/// How many of [`BODY`]'s points the camera sees.
fn seen(camera: &Camera, place: DVec2, height: f64) -> usize {
    let away = (place - camera.center().truncate()).normalize();
    let is_seen = |[aside, up]: &[f64; 2]| {
        let point = (place + DVec2::new(-away.y, away.x) * (aside * height)).extend(up * height);
        let offset = point - camera.center();
        let ray = Ray { origin: camera.center(), direction: offset.normalize() };
        camera.seen(point).is_some() && scene().nearest(&ray).t > offset.length()
    };
    BODY.iter().filter(|point| is_seen(point)).count()
}

impl WalkerMask {
    fn new(shown: &[bool], without: &Photo, with: &Photo) -> Self {
        let pixels = shown.iter().zip(without.rgba.as_chunks::<4>().0).zip(with.rgba.as_chunks::<4>().0);
        let pixel = |((&shown, a), b): ((&bool, &[u8; 4]), &[u8; 4])| match shown {
            true => WalkerPixel::Figure,
            false if (0..3).any(|c| a[c].abs_diff(b[c]) > SHADOW_LEVELS) => WalkerPixel::Shadow,
            false => WalkerPixel::Same,
        };
        WalkerMask { width: with.width, height: with.height, pixels: pixels.map(pixel).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_walkers_stand_in_one_place() {
        let scene = DemoOptions { width: 16, height: 12, samples: 1, points: 10, ..DemoOptions::large() };
        let folder = tempfile::tempdir().unwrap();
        let dataset = load(&scene, Some(folder.path()), &()).unwrap();
        let walkers = places(&dataset, 100, 0);
        assert_eq!(walkers.len(), dataset.train.len());
        for (index, walker) in walkers.iter().enumerate() {
            assert!(is_free(walker.place, &dataset.views[walker.view].camera), "walker {index} has no room");
            for other in &walkers[..index] {
                let apart = walker.place.distance(other.place);
                assert!(apart > 0.02, "views {} and {}: {apart} m", walker.view, other.view);
            }
        }
        let shown = |walker: &Walker| seen(&dataset.views[walker.view].camera, walker.place, walker.height);
        let counts: Vec<usize> = walkers.iter().map(shown).collect();
        assert!(counts.iter().all(|&count| count >= 4), "{counts:?}");
        assert!(counts.iter().sum::<usize>() * 10 > walkers.len() * BODY.len() * 9, "{counts:?}");
    }
}
