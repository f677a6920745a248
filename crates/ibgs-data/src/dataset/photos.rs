//! Finding, loading and resampling photos.

use super::archive::Unpacked;
use super::backdrop;
use super::decode::{Drops, apply_mask, decode, is_turned, photo_size};
use super::error::{DatasetError, read_bytes};
use super::host::PhotoCache;
use super::info::Found;
use super::lens::{Lens, Pose};
use super::masks::SAME_SHAPE;
use super::names::{Inside, points_into};
use super::notes as notes_on;
use super::undistort::undistort;
use super::{ALPHA_EMPTY, Alpha, Dataset, LoadOptions, Masks, Photo, PrincipalPoint, Resampler, Resolution, View};
use crate::camera::Camera;
use crate::counted;
use crate::progress::Progress;
use glam::DVec2;
use image::imageops::{self, FilterType};
use image::{GrayImage, ImageBuffer, Rgba, RgbaImage};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A posed photo that exists on disk but is not decoded yet.
#[derive(Clone, Debug)]
pub(crate) struct ListedPhoto {
    pub name: String,
    pub photo: PathBuf,
    pub mask: Option<PathBuf>,
    pub lens: Lens,
    pub pose: Pose,
    /// The photo comes from a folder such as `images_4`: the resolution factor is done already.
    pub prescaled: bool,
    /// The colour that it lies on, where that is to become empty.
    pub key: Option<[u8; 3]>,
}

/// A view with its photo made smaller, so that its longer side has at most `longest` pixels.
///
/// # Errors
/// It cannot be decoded again.
pub(super) fn reduced(view: &View, longest: u32) -> Result<View, DatasetError> {
    let photo = view.photo.pixels()?;
    let scale = f64::from(longest) / f64::from(photo.width.max(photo.height));
    if scale >= 1.0 {
        return Ok(View { photo: photo.into(), ..view.clone() });
    }
    let [width, height] = [photo.width, photo.height].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
    let image = to_image(Photo::clone(&photo), Path::new(&view.name))?;
    let rgba = resample(image, width, height, Resampler::Bicubic).into_raw();
    Ok(View {
        name: view.name.clone(),
        camera: view.camera.resized(width, height),
        photo: Photo { width, height, rgba }.into(),
    })
}

impl ListedPhoto {
    /// Its files.
    pub fn found(self) -> Found {
        Found { name: self.name, photo: self.photo, mask: self.mask }
    }
}

/// A lens that leaves more than this share of a photo blank is not a calibration of that photo.
const MAX_BLANK: f64 = 0.9;
/// Widths in pixels below this one are hardly meant.
const SMALL_WIDTH: u32 = 64;

/// Counts the photos that have absolute names in the scene file but are read from the scene folder.
#[derive(Default)]
pub(crate) struct AbsoluteNames {
    count: usize,
    /// The first one: its name in the file and its name in the scene folder.
    first: Option<(String, String)>,
}

impl AbsoluteNames {
    /// Counts a name if it points outside the scene folder.
    pub fn add(&mut self, root: &Path, given: &str, inside: &Inside) {
        if inside.is_end && !points_into(root, given) {
            self.count += 1;
            self.first.get_or_insert_with(|| (given.replace(char::is_control, "?"), inside.name.clone()));
        }
    }

    pub fn note(&self) -> Option<String> {
        let (given, name) = self.first.as_ref()?;
        let count = photos(self.count);
        Some(format!(
            "{count} with absolute names of another place are taken from the scene folder (first: {given} as {name})"
        ))
    }
}

/// The resampler (image crate, antialiased) on the 8-bit sRGB values, colours weighted by alpha. Where the kernel reaches
/// transparent pixels its negative lobes would overshoot and shift the picture, so a triangle kernel stands in there.
pub fn resample(photo: RgbaImage, width: u32, height: u32, resampler: Resampler) -> RgbaImage {
    let filter = match resampler {
        Resampler::Lanczos3 => FilterType::Lanczos3,
        Resampler::Bicubic => FilterType::CatmullRom,
    };
    if photo.dimensions() == (width, height) {
        return photo;
    }
    if photo.pixels().all(|pixel| pixel.0[3] == u8::MAX) {
        return imageops::resize(&photo, width, height, filter);
    }
    // The image crate clamps floats to 0..1: at half the range an overshoot of alpha stays visible.
    let weighted: ImageBuffer<Rgba<f32>, Vec<f32>> = ImageBuffer::from_fn(photo.width(), photo.height(), |x, y| {
        let [r, g, b, a] = photo.get_pixel(x, y).0.map(|v| f32::from(v) / 255.0);
        Rgba([r * a, g * a, b * a, a].map(|v| v / 2.0))
    });
    let sharp = imageops::resize(&weighted, width, height, filter);
    let soft = imageops::resize(&weighted, width, height, FilterType::Triangle);
    RgbaImage::from_fn(width, height, |x, y| {
        let whole = (sharp.get_pixel(x, y).0[3] - 0.5).abs() < 0.25 / 255.0;
        let [r, g, b, a] = if whole { sharp.get_pixel(x, y).0 } else { soft.get_pixel(x, y).0 };
        if a < 0.25 / 255.0 {
            return Rgba([0; 4]);
        }
        Rgba([r / a, g / a, b / a, a * 2.0].map(|v| (v * 255.0).round() as u8))
    })
}

/// Sets the alpha of masked pixels in an object's photo to [`ALPHA_EMPTY`], and to 0 where they touch the blank
/// `outside` of the lens, whose image may have another size.
fn mark_empty(photo: &mut RgbaImage, outside: Option<&GrayImage>) {
    let (width, height) = photo.dimensions();
    let outside = outside.map(|outside| imageops::resize(outside, width, height, FilterType::Triangle).into_raw());
    for (index, pixel) in photo.pixels_mut().enumerate() {
        let is_outside = outside.as_ref().is_some_and(|outside| outside[index] > 0);
        pixel.0[3] = if is_outside { 0 } else { pixel.0[3].max(ALPHA_EMPTY) };
    }
}

/// The alpha of a pixel that is covered by this part, of 255, so that 0 is left for where there is no photo.
fn cover_alpha(part: u8) -> u8 {
    let full = u32::from(u8::MAX - ALPHA_EMPTY);
    let rounded = (2 * u32::from(part) * full + 255) / 510;
    ALPHA_EMPTY + rounded as u8
}

/// What happened to a photo while it was loaded.
struct Loaded {
    name: String,
    camera: Camera,
    /// EXIF asks to turn its pixels.
    is_turned: bool,
    /// Size of the file and of the camera, where they differ.
    rescaled: Option<([u32; 2], [u32; 2])>,
    prescaled: bool,
    /// The width that was asked for, where the photo is narrower.
    missed_width: Option<u32>,
    masked: bool,
    /// The photo of an object leaves pixels out.
    has_outside: bool,
    /// Degrees across that are left of a fisheye.
    fisheye: Option<DVec2>,
    /// Share of blank pixels after undistortion, where the lens was distorted.
    blank: Option<f64>,
}

fn load_one(frame: &ListedPhoto, options: &LoadOptions) -> Result<(Loaded, Photo), DatasetError> {
    let (mut image, is_turned) = {
        let bytes = read_bytes(&frame.photo)?;
        (decode(&frame.photo, &bytes, options)?, is_turned(&bytes))
    };
    let is_cover = options.masks() == Masks::Ignore && options.shows_object();
    if let Some(color) = frame.key {
        backdrop::key(&mut image, color);
    } else if is_cover {
        image.pixels_mut().for_each(|pixel| pixel.0[3] = cover_alpha(pixel.0[3]));
    }
    if let Some(mask) = &frame.mask {
        let drops = if is_cover { Drops::Photo } else { Drops::ByBrightness };
        apply_mask(&mut image, (&frame.photo, mask), drops)?;
    }
    let (width, height) = image.dimensions();
    let camera_size = [frame.lens.width, frame.lens.height];
    let rescaled = (camera_size != [width, height]).then_some(([width, height], camera_size));
    let lens = frame.lens.resized(width, height);
    let (mut blank, mut outside) = (None, None);
    if !lens.distortion.is_none() {
        let photo = Photo { width, height, rgba: image.into_raw() };
        let undistorted = undistort(&photo, &lens);
        let share = undistorted.blank_share();
        if share > MAX_BLANK {
            let problem = format!("its distortion leaves {:.0} % of the undistorted photo blank", share * 100.0);
            let camera = format!("camera of image `{}`", frame.name);
            return Err(DatasetError::Intrinsics { path: frame.photo.clone(), camera, problem });
        }
        blank = Some(share);
        outside = GrayImage::from_raw(width, height, undistorted.blank);
        image = to_image(undistorted.photo, &frame.photo)?;
    }
    let camera = resized_camera(&lens, frame, options);
    let (width, height) = (camera.width, camera.height);
    let mut image = resample(image, width, height, options.resampler);
    if options.masks() == Masks::Object {
        mark_empty(&mut image, outside.as_ref());
    }
    let has_outside = options.shows_object() && image.pixels().any(|pixel| (1..u8::MAX).contains(&pixel.0[3]));
    let photo = Photo { width, height, rgba: image.into_raw() };
    let (prescaled, masked) = (frame.prescaled, frame.mask.is_some());
    let missed_width = options.missed_width(lens.width);
    let fisheye = lens.is_fisheye().then(|| lens.field_of_view());
    let name = frame.name.clone();
    let loaded =
        Loaded { name, camera, is_turned, rescaled, prescaled, missed_width, masked, has_outside, fisheye, blank };
    Ok((loaded, photo))
}

/// The camera of a photo once it is loaded, by its size alone.
pub(crate) fn camera(frame: &ListedPhoto, options: &LoadOptions) -> Result<Camera, DatasetError> {
    let (width, height) = photo_size(&frame.photo)?;
    Ok(resized_camera(&frame.lens.resized(width, height), frame, options))
}

fn resized_camera(lens: &Lens, frame: &ListedPhoto, options: &LoadOptions) -> Camera {
    let (width, height) = options.target_size(lens.width, lens.height, frame.prescaled);
    let camera = lens.pinhole(&frame.pose).resized(width, height);
    match options.principal_point {
        PrincipalPoint::True => camera,
        PrincipalPoint::Centred => camera.centred(),
    }
}

fn to_image(photo: Photo, path: &Path) -> Result<RgbaImage, DatasetError> {
    RgbaImage::from_raw(photo.width, photo.height, photo.rgba).ok_or_else(|| {
        let cause = "its pixels do not fill its size".to_owned();
        DatasetError::Photo { path: path.to_owned(), cause }
    })
}

/// Decodes, undistorts and resamples all photos, in parallel; adds views and notes to `dataset`. An unpacked archive is kept as
/// long as photos may have to be decoded again.
pub(crate) fn load_views(
    frames: Vec<ListedPhoto>,
    (options, archive): (&LoadOptions, Option<&Arc<Unpacked>>),
    progress: &dyn Progress,
    dataset: &mut Dataset,
) -> Result<(), DatasetError> {
    progress.begin("loading photos", frames.len());
    let frames: Arc<[ListedPhoto]> = frames.into();
    let again = {
        let (frames, options, archive) = (frames.clone(), options.clone(), archive.cloned());
        move |index: usize| {
            let loaded = load_one(&frames[index], &options).map(|(_, photo)| photo);
            loaded.map_err(|error| match &archive {
                Some(archive) => archive.error(error),
                None => error,
            })
        }
    };
    let paths = frames.iter().map(|frame| frame.photo.clone()).collect();
    let cache = PhotoCache::new(paths, options.host_memory.host_bytes(), Box::new(again));
    // The first bad photo in name order is reported, whichever thread meets one first.
    let first_bad = AtomicUsize::new(usize::MAX);
    let loaded: Vec<Option<Result<Loaded, DatasetError>>> = frames
        .par_iter()
        .enumerate()
        .map(|(index, frame)| {
            if index > first_bad.load(Ordering::Relaxed) {
                return None;
            }
            let loaded = load_one(frame, options);
            progress.step();
            Some(match loaded {
                Ok((loaded, photo)) => {
                    cache.put(index, photo);
                    Ok(loaded)
                }
                Err(error) => {
                    first_bad.fetch_min(index, Ordering::Relaxed);
                    Err(error)
                }
            })
        })
        .collect();
    progress.end();
    let loaded = loaded.into_iter().flatten().collect::<Result<Vec<Loaded>, _>>()?;
    add_notes(&loaded, &mut dataset.notes);
    dataset.notes.extend(object_note(&loaded, options));
    dataset.notes.extend(width_note(options));
    let views = loaded.into_iter().zip(cache.into_photos());
    dataset.views.extend(views.map(|(Loaded { name, camera, .. }, photo)| View { name, camera, photo }));
    Ok(())
}

fn object_note(loaded: &[Loaded], options: &LoadOptions) -> Option<String> {
    if !options.shows_object() {
        return None;
    }
    let emptied = photos(loaded.iter().filter(|one| one.has_outside).count());
    Some(match options.alpha {
        _ if !loaded.iter().any(|one| one.has_outside) => {
            "no photo has a mask or transparent pixels: masks of an object change nothing".to_owned()
        }
        Some(Alpha::Composite) => format!("{emptied} of an object: transparent pixels are empty, over the background"),
        Some(Alpha::Keyed) => {
            format!("{emptied} of an object on one colour: what of that colour touches the edge is empty")
        }
        _ => format!("{emptied} of an object: outside of the masks there is nothing"),
    })
}

/// A small width may have been meant to divide the size.
fn width_note(options: &LoadOptions) -> Option<String> {
    let Resolution::Width(width @ ..SMALL_WIDTH) = options.resolution else { return None };
    Some(format!("a resolution of {width} is a width of {width} pixels; 1, 2, 4 and 8 divide the size"))
}

fn photos(count: usize) -> String {
    counted(count, "photo")
}

fn add_notes(loaded: &[Loaded], notes: &mut Vec<String>) {
    let rescaled = || {
        let all = loaded.iter().filter(|one| !one.prescaled);
        all.filter_map(|one| one.rescaled.map(|sizes| (&one.name, sizes)))
    };
    if let Some((name, ([w, h], [cw, ch]))) = rescaled().next() {
        notes.push(format!(
            "{} of another size than the camera ({name}: {w} x {h}, camera {cw} x {ch}): intrinsics rescaled",
            photos(rescaled().count())
        ));
    }
    let mut odd = rescaled().filter(|(_, ([w, h], [cw, ch]))| {
        let ratio = f64::from(*w) * f64::from(*ch) / (f64::from(*h) * f64::from(*cw));
        (ratio - 1.0).abs() > SAME_SHAPE
    });
    if let Some((name, _)) = odd.next() {
        notes.push(format!(
            "{} of another shape than the camera (first: {name}): check that the photos are the calibrated ones, not \
             cropped or turned",
            photos(1 + odd.count())
        ));
    }
    let missed = || loaded.iter().filter_map(|one| one.missed_width);
    if let Some(wanted) = missed().next() {
        let count = photos(missed().count());
        notes.push(format!("{count} narrower than the {wanted} pixels asked for: photos are never enlarged"));
    }
    let turned: Vec<String> = loaded.iter().filter(|one| one.is_turned).map(|one| one.name.clone()).collect();
    notes.extend(notes_on::turned(&turned));
    let masked = loaded.iter().filter(|one| one.masked).count();
    if masked > 0 {
        notes.push(format!("{} masked", photos(masked)));
    }
    let undistorted: Vec<f64> = loaded.iter().filter_map(|one| one.blank).collect();
    if !undistorted.is_empty() {
        let worst = undistorted.iter().fold(0.0_f64, |worst, blank| worst.max(*blank));
        notes.push(format!(
            "{} undistorted to a pinhole of the same focal length and size; blank edges, which do not count, are at most \
             {:.1} % of a photo",
            photos(undistorted.len()),
            worst * 100.0
        ));
    }
    let views = || loaded.iter().filter_map(|one| one.fisheye);
    if let Some(widest) = views().max_by(|a, b| a.element_sum().total_cmp(&b.element_sum())) {
        notes.push(format!(
            "{} through a fisheye: a pinhole shows at most {:.0} x {:.0} degrees of each, the rest is cropped",
            photos(views().count()),
            widest.x,
            widest.y
        ));
    }
}
