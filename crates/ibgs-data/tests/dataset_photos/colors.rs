//! From file to 8 bits: 16-bit PNG, EXR in linear light, alpha over a background.

use crate::dataset::{assert_note, load, load_plain};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes, Vec2, WritableImage,
    write_rgb_file, write_rgba_file,
};
use ibgs_data::dataset::{Alpha, ColorSpace, LoadOptions};
use ibgs_testing::fails;
use ibgs_testing::scene_files::{Model, write_file, write_photo};
use std::fs;
use std::path::Path;

/// Linear light of an sRGB value, both 1 at white: the inverse of what is tested.
fn linear(encoded: f64) -> f32 {
    (if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }) as f32
}

/// The small scene with `a0.exr` in place of `a0.png`.
fn exr_scene(write: impl Fn(&Path)) -> tempfile::TempDir {
    let folder = Model::small(2).scene();
    fs::remove_file(folder.path().join("images/a0.png")).unwrap();
    write(&folder.path().join("images/a0.exr"));
    folder
}

/// RGBA of `a0`, with options.
fn first(folder: &Path, options: &LoadOptions) -> Vec<u8> {
    load(folder, options).views[0].photo.pixels().unwrap().rgba.clone()
}

#[test]
fn every_sixteen_bit_value_goes_to_the_nearest_level() {
    let mut model = Model::small(2);
    model.cameras[0].size = [256, 256];
    let folder = model.scene();
    let deep = image::ImageBuffer::from_fn(256, 256, |x, y| image::Luma([(256 * y + x) as u16]));
    image::DynamicImage::from(deep).save(folder.path().join("images/a0.png")).unwrap();
    for (value, pixel) in load_plain(folder.path()).views[0].photo.pixels().unwrap().rgba.chunks_exact(4).enumerate() {
        let nearest = (value as f64 / 257.0).round() as u8;
        assert_eq!(pixel, [nearest, nearest, nearest, 255], "{value}");
    }
    // Values of 16 bits that are linear light keep what 8 bits of it would lose in the dark.
    let options = LoadOptions { color_space: Some(ColorSpace::Linear), ..Default::default() };
    let levels: Vec<u8> = first(folder.path(), &options).chunks_exact(4).map(|pixel| pixel[0]).collect();
    assert!(levels.is_sorted() && (0..=255).all(|level| levels.contains(&level)));
    assert_eq!((levels[0], levels[32768], levels[65535]), (0, 188, 255));
}

#[test]
fn exr_photos_are_linear_light() {
    // All 96 pixels: every level from 60 on, in red; and what no level can hold in green and blue.
    let folder = exr_scene(|path| {
        write_rgb_file(path, 12, 8, |x, y| {
            let odd = [-0.5, f32::NAN, f32::INFINITY, 7.5][x % 4];
            (linear((60 + y * 12 + x) as f64 / 255.0), odd, 1.0_f32)
        })
        .unwrap();
    });
    let dataset = load_plain(folder.path());
    assert_eq!(dataset.views[0].name, "a0.png");
    for (i, pixel) in dataset.views[0].photo.pixels().unwrap().rgba.chunks_exact(4).enumerate() {
        let odd = [0, 0, 255, 255][i % 12 % 4];
        assert_eq!(pixel, [60 + i as u8, odd, 255, 255], "pixel {i}");
    }
    let as_they_are = LoadOptions { color_space: Some(ColorSpace::Srgb), ..Default::default() };
    let raw = (linear(60.0 / 255.0) * 255.0).round() as u8;
    assert_eq!(first(folder.path(), &as_they_are)[..4], [raw, 0, 255, 255]);
    // The other photo is a PNG of the values (90, 120, 150).
    let all_linear = LoadOptions { color_space: Some(ColorSpace::Linear), ..Default::default() };
    assert_eq!(load(folder.path(), &all_linear).views[1].photo.pixels().unwrap().rgba[..4], [160, 182, 202, 255]);
}

#[test]
fn exr_alpha_masks_or_lets_the_background_through() {
    // OpenEXR's colours are multiplied by alpha.
    let folder = exr_scene(|path| {
        let level = linear(200.0 / 255.0);
        write_rgba_file(path, 12, 8, |x, _| {
            let a = [1.0_f32, 0.25, 0.0][x % 3];
            (level * a, level * a, 0.0_f32, a)
        })
        .unwrap();
    });
    let masked = first(folder.path(), &LoadOptions::default());
    assert_eq!(masked[..12], [200, 200, 0, 255, 200, 200, 0, 64, 0, 0, 0, 0]);
    let options = LoadOptions { alpha: Some(Alpha::Composite), ..Default::default() };
    let over =
        |background: [f32; 3]| load(folder.path(), &options).views[0].photo.pixels().unwrap().over(background).rgba;
    assert_eq!(over([0.0; 3])[..12], [200, 200, 0, 255, 50, 50, 0, 255, 0, 0, 0, 255]);
    // 200 / 4 + 255 * 3 / 4 = 241.25, 255 * 3 / 4 = 191.25.
    assert_eq!(over([1.0; 3])[..12], [200, 200, 0, 255, 241, 241, 191, 255, 255, 255, 255, 255]);
    // A mask beside it still masks.
    write_photo(&folder.path().join("masks/a0.png"), 12, 8, |u, _| [if u < 1.0 { 0 } else { 255 }; 4]);
    assert_eq!(over([0.0; 3])[..8], [0, 0, 0, 0, 50, 50, 0, 255]);
    // Photos without alpha stay as they are.
    assert_eq!(load(folder.path(), &options).views[1].photo.pixels().unwrap().rgba[..4], [90, 120, 150, 255]);
}

/// 6 x 4 red pixels at (2, 1) of a picture of 12 x 8.
fn write_part(path: &Path, channels: &[&str]) {
    let plane = |name: &&str| {
        let value = if *name == "R" { 1.0 } else { 0.0 };
        AnyChannel::new(*name, FlatSamples::F32(vec![value; 24]))
    };
    let list: Vec<_> = channels.iter().map(plane).collect();
    let attributes = LayerAttributes { layer_position: Vec2(2, 1), ..LayerAttributes::default() };
    let layer = Layer::new(Vec2(6, 4), attributes, Encoding::UNCOMPRESSED, AnyChannels::sort(list.into()));
    let mut image = Image::from_layer(layer);
    image.attributes.display_window = IntegerBounds::from_dimensions(Vec2(12, 8));
    image.write().to_file(path).unwrap();
}

#[test]
fn what_an_exr_leaves_out_of_its_picture_is_masked() {
    let folder = exr_scene(|path| write_part(path, &["R", "G", "B"]));
    let dataset = load_plain(folder.path());
    let photo = dataset.views[0].photo.pixels().unwrap();
    assert_eq!((photo.width, photo.height), (12, 8));
    for (i, pixel) in photo.rgba.chunks_exact(4).enumerate() {
        let inside = (2..8).contains(&(i % 12)) && (1..5).contains(&(i / 12));
        assert_eq!(pixel, if inside { [255, 0, 0, 255] } else { [0; 4] }, "pixel {i}");
    }
    // The header's size is that of the picture, where transforms.json does not tell it.
    let frames = [("a0", ""), ("a1", "")];
    let nerf = folder.path().join("nerf");
    write_part(
        &{
            fs::create_dir(&nerf).unwrap();
            nerf.join("a0.exr")
        },
        &["R", "G", "B"],
    );
    write_photo(&nerf.join("a1.png"), 12, 8, |_, _| [1, 2, 3, 255]);
    write_file(&nerf.join("transforms.json"), crate::dataset::transforms(r#""camera_angle_x": 0.7,"#, &frames));
    let dataset = load_plain(&nerf);
    assert_eq!((dataset.views[0].name.as_str(), dataset.views[0].camera.principal.x), ("a0.exr", 6.0));
    assert!(dataset.notes.iter().all(|note| !note.contains("another size")), "{:?}", dataset.notes);
}

#[test]
fn exr_files_that_make_no_sense() {
    let folder = exr_scene(|path| write_part(path, &["Y"]));
    let path = folder.path().join("images/a0.exr");
    fails(folder.path(), &["a0.exr does not decode"]);
    write_part(&path, &["R", "G", "B"]);
    let whole = fs::read(&path).unwrap();
    for length in 0..whole.len() {
        write_file(&path, &whole[..length]);
        fails(folder.path(), &["a0.exr does not decode"]);
    }
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 0xff;
        write_file(&path, damaged);
        // Some damage is harmless; none may panic or ask for all memory.
        let _ = ibgs_data::dataset::load(folder.path(), &LoadOptions::default());
    }
    // The display window ends at (99999, 7).
    let at = whole.windows(13).position(|bytes| bytes == b"displayWindow").unwrap() + 14 + 6 + 4 + 8;
    let mut huge = whole.clone();
    huge[at..at + 4].copy_from_slice(&99_999_i32.to_le_bytes());
    write_file(&path, huge);
    fails(folder.path(), &["a0.exr does not decode", "100000 x 8 pixels makes no sense"]);
}

#[test]
fn transparent_parts_lie_over_the_background_before_anything_is_resized() {
    let folder = Model::small(2).scene();
    let half = |u: f64, _| [200, 0, 0, if u < 6.0 { 255 } else { 0 }];
    write_photo(&folder.path().join("images/a0.png"), 12, 8, half);
    let options = LoadOptions { alpha: Some(Alpha::Composite), resolution: "2".parse().unwrap(), ..Default::default() };
    let dataset = load(folder.path(), &options);
    assert_note(&dataset, "transparent pixels are empty");
    let row = &dataset.views[0].photo.pixels().unwrap().over([1.0; 3]).rgba[..24];
    assert!(row.chunks_exact(4).all(|pixel| pixel[3] == 255), "{row:?}");
    assert!(row[1] < 8 && row[21] > 247, "{row:?}");
}
