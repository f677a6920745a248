//! Formats of photos: what is read, and the sentence for what is not.

use crate::dataset::load_plain;
use ibgs_data::dataset::{self, LoadOptions};
use ibgs_testing::fails;
use ibgs_testing::scene_files::{Model, write_file};
use image::{DynamicImage, ImageFormat, Luma, Rgb, Rgba};
use std::io::Cursor;
use std::path::Path;

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn pixels(bytes: &[u8]) -> Vec<u8> {
    dataset::decode_photo(Path::new("a.photo"), bytes, &LoadOptions::default()).unwrap().rgba
}

#[test]
fn webp_and_tiff_have_the_values_that_they_were_written_with() {
    let value = |x: u32, y: u32, c: u32| (x * 20 + y * 11 + c * 31) as u8;
    let at = |x: u32, y: u32, alpha| Rgba([value(x, y, 0), value(x, y, 1), value(x, y, 2), alpha]);
    let rgba = image::RgbaImage::from_fn(9, 7, |x, y| at(x, y, if x == 3 { 40 } else { 255 }));
    let opaque = image::RgbaImage::from_fn(9, 7, |x, y| at(x, y, 255)).into_raw();
    let rgb = image::RgbImage::from_fn(9, 7, |x, y| Rgb([0, 1, 2].map(|c| value(x, y, c))));
    for format in [ImageFormat::WebP, ImageFormat::Tiff] {
        assert_eq!(pixels(&encoded(&rgba.clone().into(), format)), rgba.clone().into_raw(), "{format:?}");
        assert_eq!(pixels(&encoded(&rgb.clone().into(), format)), opaque, "{format:?}");
    }
    // 16 bits round to the nearest of 256 levels.
    let deep = image::ImageBuffer::from_fn(9, 7, |x, y| {
        Rgb([0, 1, 2].map(|c| (u16::from(value(x, y, c)) * 257).saturating_add(100)))
    });
    assert_eq!(pixels(&encoded(&DynamicImage::ImageRgb16(deep), ImageFormat::Tiff)), opaque);
    let grey = image::ImageBuffer::from_fn(9, 7, |x, y| Luma([u16::from(value(x, y, 0)) * 257]));
    let shown = pixels(&encoded(&DynamicImage::ImageLuma16(grey), ImageFormat::Tiff));
    assert!((0..63).all(|i| shown[4 * i..4 * i + 3] == [opaque[4 * i]; 3]));
}

#[test]
fn scenes_of_webp_and_tiff_photos() {
    let mut model = Model::small(3);
    for (image, name) in model.images.iter_mut().zip(["a.webp", "b.TIF", "c.tiff"]) {
        image.name = name.to_owned();
    }
    let folder = tempfile::tempdir().unwrap();
    model.write_binary(folder.path());
    let photo: DynamicImage = image::RgbImage::from_pixel(12, 8, Rgb([50, 60, 70])).into();
    write_file(&folder.path().join("images/a.webp"), encoded(&photo, ImageFormat::WebP));
    write_file(&folder.path().join("images/b.TIF"), encoded(&photo, ImageFormat::Tiff));
    write_file(&folder.path().join("images/c.tiff"), encoded(&photo, ImageFormat::Tiff));
    // A white mask of next to no bytes.
    let white: DynamicImage = image::RgbImage::from_pixel(3000, 2000, Rgb([255; 3])).into();
    write_file(&folder.path().join("masks/a.webp"), encoded(&white, ImageFormat::WebP));
    let dataset = load_plain(folder.path());
    assert!(dataset.views.iter().all(|view| view.photo.pixels().unwrap().rgba[..4] == [50, 60, 70, 255]));
    assert_eq!(dataset::inspect(folder.path()).unwrap().sizes[0].photos, 3);
}

#[test]
fn formats_that_are_not_read_name_a_converter() {
    let folder = Model::small(2).scene();
    let path = folder.path().join("images/a1.png");
    let media = |brands: &str| [b"\0\0\0\x20ftyp", brands.as_bytes(), b"rest of it"].concat();
    for (bytes, format, converter) in [
        (media("heic\0\0\0\0mif1heic"), "HEIC", "heif-convert"),
        (media("mif1\0\0\0\0mif1heic"), "HEIC", "heif-convert"),
        (media("avif\0\0\0\0avifmif1miaf"), "AVIF", "avifdec"),
        (media("mif1\0\0\0\0mif1avif"), "AVIF", "avifdec"),
        (b"\xff\x0a....".to_vec(), "JPEG XL", "djxl"),
        (b"\0\0\0\x0cJXL \r\n\x87\n".to_vec(), "JPEG XL", "djxl"),
    ] {
        write_file(&path, bytes);
        fails(folder.path(), &[&format!("a1.png is a {format} file, which is not read"), converter]);
    }
    write_file(&path, media("isom\0\0\0\0isommp42"));
    fails(folder.path(), &["a1.png does not decode", "JPEG, PNG, WebP, TIFF or EXR"]);
}

#[test]
fn damaged_webp_and_tiff() {
    let photo: DynamicImage = image::RgbImage::from_fn(30, 20, |x, y| Rgb([(x * 8) as u8, (y * 12) as u8, 9])).into();
    for format in [ImageFormat::WebP, ImageFormat::Tiff] {
        let whole = encoded(&photo, format);
        for length in (0..whole.len()).step_by(7) {
            let read = dataset::decode_photo(Path::new("a.photo"), &whole[..length], &LoadOptions::default());
            assert!(read.unwrap_err().to_string().contains("a.photo does not decode"), "{format:?} {length}");
        }
    }
    // A header of 16,000 x 16,000 pixels and no data: VP8L, then width and height less one in 14 bits each.
    let size: u32 = 15_999 | 15_999 << 14;
    let chunk = [&b"VP8L\x05\0\0\0\x2f"[..], &size.to_le_bytes(), b"\0"].concat();
    let webp = [b"RIFF", &(chunk.len() as u32 + 4).to_le_bytes()[..], b"WEBP", &chunk].concat();
    let error = dataset::decode_photo(Path::new("a.photo"), &webp, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("its header promises 16000 x 16000 pixels"), "{error}");
}
