//! What becomes of the photos: undistortion, resampling, alpha, and the cameras that go with them.

mod backdrop;
mod colors;
mod fisheye;
mod formats;
mod host;

use crate::dataset::{assert_note, load, load_plain, transforms};
use glam::DVec2;
use ibgs_data::dataset::{self, Alpha, Dataset, LoadOptions, Masks, Photo, PrincipalPoint, Resolution, View};
use ibgs_testing::scene_files::{Camera, Model, PINHOLE, write_file, write_photo};

/// A smooth pattern over the normalised view coordinates, steep enough to show a shift of half a pixel.
fn pattern(p: DVec2) -> [u8; 4] {
    let wave = |x: f64| (128.0 + 60.0 * x.sin()).round() as u8;
    [wave(14.0 * p.x), wave(13.0 * p.y), wave(8.0 * p.x - 9.0 * p.y), 255]
}

/// Every opaque pixel shows the pattern at its own ray, to within `tolerance` levels (at the photo's border, where
/// kernels are one-sided) and 0.8 on average; a shift of half a pixel would give 2. Returns the opaque share.
#[track_caller]
fn assert_pattern(view: &View, tolerance: f64) -> f64 {
    let camera = &view.camera;
    let photo = view.photo.pixels().unwrap();
    assert_eq!((photo.width, photo.height), (camera.width, camera.height));
    assert_eq!(photo.rgba.len(), 4 * camera.width as usize * camera.height as usize);
    let (mut opaque, mut sum) = (0, 0.0);
    let pixels = photo.rgba.chunks_exact(4);
    let count = pixels.len();
    for (index, pixel) in (0_u32..).zip(pixels) {
        let uv = DVec2::from([index % camera.width, index / camera.width].map(f64::from)) + 0.5;
        if pixel[3] < 255 {
            continue;
        }
        opaque += 1;
        let expected = pattern((uv - camera.principal) / camera.focal);
        for channel in 0..3 {
            let error = (f64::from(pixel[channel]) - f64::from(expected[channel])).abs();
            sum += error / 3.0;
            assert!(error <= tolerance, "{}: off by {error} at {uv}", view.name);
        }
    }
    let mean = sum / f64::from(opaque);
    assert!(mean <= 0.8, "{}: off by {mean} on average", view.name);
    f64::from(opaque) / count as f64
}

/// OpenCV's distortion, written again for the test: `k1 k2 p1 p2 k3 k4 k5 k6`.
fn distort(p: DVec2, k: [f64; 8]) -> DVec2 {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = k;
    let r2 = p.length_squared();
    let radial =
        (1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2) / (1.0 + k4 * r2 + k5 * r2 * r2 + k6 * r2 * r2 * r2);
    let x = p.x * radial + 2.0 * p1 * p.x * p.y + p2 * (r2 + 2.0 * p.x * p.x);
    let y = p.y * radial + p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * p.x * p.y;
    DVec2::new(x, y)
}

/// The inverse, by fixed-point iteration.
fn undistort(target: DVec2, k: [f64; 8]) -> DVec2 {
    (0..100).fold(target, |p, _| p + target - distort(p, k))
}

/// A scene of two photos of the pattern through one camera with OpenCV's distortion.
fn pattern_scene(camera: &Camera, photo_size: [u32; 2], k: [f64; 8]) -> tempfile::TempDir {
    pattern_scene_through(camera, photo_size, |p| undistort(p, k))
}

/// The same through any lens; `undistort` takes distorted normalised coordinates to those of the pinhole.
fn pattern_scene_through(
    camera: &Camera,
    photo_size: [u32; 2],
    undistort: impl Fn(DVec2) -> DVec2,
) -> tempfile::TempDir {
    let mut model = Model::small(2);
    model.cameras = vec![camera.clone()];
    let folder = tempfile::tempdir().unwrap();
    model.write_binary(folder.path());
    let (focal, principal) = match camera.params.as_slice() {
        [f, cx, cy] | [f, cx, cy, _] if camera.model.1.starts_with("SIMPLE") => ([*f; 2], [*cx, *cy]),
        [f, cx, cy, _, _] if camera.model.1.starts_with("RADIAL") => ([*f; 2], [*cx, *cy]),
        params => ([params[0], params[1]], [params[2], params[3]]),
    };
    let scale = DVec2::from(camera.size.map(|side| side as f64)) / DVec2::from(photo_size.map(f64::from));
    for image in &model.images {
        let path = folder.path().join("images").join(&image.name);
        write_photo(&path, photo_size[0], photo_size[1], |u, v| {
            let uv = DVec2::new(u, v) * scale;
            pattern(undistort((uv - DVec2::from(principal)) / DVec2::from(focal)))
        });
    }
    folder
}

fn camera(model: (i32, &'static str), params: &[f64]) -> Camera {
    Camera { id: 1, model, size: [160, 120], params: params.to_vec() }
}

#[test]
fn distorted_photos_become_pinhole() {
    let cases: [(&str, i32, &[f64], [f64; 8]); 5] = [
        ("SIMPLE_RADIAL", 2, &[130.0, 78.0, 63.0, -0.2], [-0.2, 0., 0., 0., 0., 0., 0., 0.]),
        ("SIMPLE_RADIAL", 2, &[130.0, 78.0, 63.0, 0.1], [0.1, 0., 0., 0., 0., 0., 0., 0.]),
        ("RADIAL", 3, &[130.0, 78.0, 63.0, -0.15, 0.05], [-0.15, 0.05, 0., 0., 0., 0., 0., 0.]),
        (
            "OPENCV",
            4,
            &[130.0, 128.0, 84.0, 57.0, -0.1, 0.03, 0.004, -0.003],
            [-0.1, 0.03, 0.004, -0.003, 0., 0., 0., 0.],
        ),
        (
            "FULL_OPENCV",
            6,
            &[130.0, 128.0, 84.0, 57.0, 0.1, -0.05, 0.002, 0.001, 0.02, 0.15, -0.02, 0.01],
            [0.1, -0.05, 0.002, 0.001, 0.02, 0.15, -0.02, 0.01],
        ),
    ];
    for (name, number, params, k) in cases {
        let folder = pattern_scene(&camera((number, name), params), [160, 120], k);
        let dataset = load_plain(folder.path());
        assert_note(&dataset, "2 photos undistorted");
        let view = &dataset.views[0];
        let opaque = assert_pattern(view, 4.0);
        let pincushion = k[0] > 0.0 && name == "SIMPLE_RADIAL";
        assert!(if pincushion { (0.8..0.999).contains(&opaque) } else { opaque > 0.9 }, "{name} {opaque}");
        // At half size too, and from photos of another size than the camera's.
        let options = LoadOptions { resolution: Resolution::Factor(2), ..Default::default() };
        let half = load(pattern_scene(&camera((number, name), params), [320, 240], k).path(), &options);
        assert_note(&half, "intrinsics rescaled");
        assert_eq!(half.views[0].camera, view.camera);
        assert_pattern(&half.views[0], 4.0);
    }
}

#[test]
fn photos_beyond_the_fold_are_blank() {
    // The polynomial turns back at r = 0.577 / sqrt(0.8), inside the frame.
    let params = [70.0, 80.0, 60.0, -0.8];
    let folder = tempfile::tempdir().unwrap();
    let mut model = Model::small(2);
    model.cameras = vec![camera((2, "SIMPLE_RADIAL"), &params)];
    model.write_binary(folder.path());
    model.write_photos(folder.path());
    let dataset = load_plain(folder.path());
    let photo = dataset.views[0].photo.pixels().unwrap();
    let alpha = |x: usize, y: usize| photo.rgba[(y * 160 + x) * 4 + 3];
    assert_eq!((alpha(80, 60), alpha(100, 60), alpha(0, 0), alpha(140, 60)), (255, 255, 0, 0));
}

#[test]
fn sizes_and_principal_points() {
    let plain = camera(PINHOLE, &[130.0, 128.0, 84.0, 57.0]);
    let folder = pattern_scene(&plain, [160, 120], [0.0; 8]);
    let with = |options: &LoadOptions| load(folder.path(), options).views[1].clone();
    let resolution = |text: &str| LoadOptions { resolution: text.parse().unwrap(), ..Default::default() };
    for (text, size) in [("1", (160, 120)), ("2", (80, 60)), ("8", (20, 15)), ("100", (100, 75)), ("-1", (160, 120))] {
        let view = with(&resolution(text));
        assert_eq!(view.photo.size(), <[u32; 2]>::from(size));
        let scale = f64::from(size.0) / 160.0;
        assert!((view.camera.principal - DVec2::new(84.0, 57.0) * scale).length() < 1e-9);
        if size.0 >= 80 {
            assert_pattern(&view, if size.0 == 160 { 0.0 } else { 4.0 });
        }
    }
    let capped = with(&LoadOptions { max_resolution: Some(40), ..Default::default() });
    assert_eq!(capped.photo.size(), [40, 30]);
    let centred = with(&LoadOptions { principal_point: PrincipalPoint::Centred, ..resolution("2") });
    assert_eq!(centred.camera.principal, DVec2::new(40.0, 30.0));
    assert_eq!(centred.camera.focal, DVec2::new(65.0, 64.0));
}

#[test]
fn photos_of_another_size_than_the_camera() {
    let plain = camera(PINHOLE, &[130.0, 128.0, 84.0, 57.0]);
    let folder = pattern_scene(&plain, [240, 180], [0.0; 8]);
    let dataset = load_plain(folder.path());
    assert_note(&dataset, "2 photos of another size than the camera (a0.png: 240 x 180, camera 160 x 120)");
    assert_eq!(dataset.views[0].camera.focal, DVec2::new(195.0, 192.0));
    assert_pattern(&dataset.views[0], 0.0);
    let turned = pattern_scene(&plain, [120, 160], [0.0; 8]);
    assert_note(&load_plain(turned.path()), "another shape");
}

#[test]
fn reduced_and_named_folders() {
    let folder = Model::small(2).scene();
    for name in ["a0.JPG", "a1.JPG"] {
        let grey = |_, _| [60, 60, 60, 255];
        write_photo(&folder.path().join("images_2").join(name), 6, 4, grey);
    }
    let half = LoadOptions { resolution: Resolution::Factor(2), ..Default::default() };
    let reduced = load(folder.path(), &half);
    assert_note(&reduced, "images_2");
    assert_eq!(reduced.views[0].camera.principal, DVec2::new(3.25, 1.875));
    assert_eq!((reduced.views[0].name.as_str(), reduced.views[0].photo.pixels().unwrap().rgba[0]), ("a0.png", 60));
    // Named by hand, the folder is the photo, and the factor divides it.
    let named = load(folder.path(), &LoadOptions { images: Some("images_2".into()), ..half.clone() });
    assert_eq!(named.views[0].photo.size(), [3, 2]);
    let full = load(folder.path(), &LoadOptions { images: Some("images".into()), ..half });
    assert_eq!((full.views[0].photo.pixels().unwrap().width, full.views[0].photo.pixels().unwrap().rgba[0]), (6, 90));
}

#[test]
fn a_width_that_photos_do_not_have_is_said() {
    let folder = Model::small(2).scene();
    write_photo(&folder.path().join("images/a1.png"), 24, 16, |_, _| [60, 60, 60, 255]);
    let at = |width| load(folder.path(), &LoadOptions { resolution: Resolution::Width(width), ..Default::default() });
    let [fits, missed] = [12, 24].map(at);
    let widths = |dataset: &Dataset| [0, 1].map(|view: usize| dataset.views[view].camera.width);
    assert_eq!((widths(&fits), widths(&missed)), ([12, 12], [12, 24]));
    assert_note(&missed, "1 photo narrower than the 24 pixels asked for");
    assert!(!fits.notes.iter().any(|note| note.contains("narrower")), "{:?}", fits.notes);
    // Few pixels are hardly meant.
    assert_note(&at(63), "a resolution of 63 is a width of 63 pixels; 1, 2, 4 and 8 divide the size");
    assert!(!at(64).notes.iter().any(|note| note.contains("divide")));
}

#[test]
fn alpha_masks_and_sixteen_bits() {
    let folder = Model::small(3).scene();
    let deep = image::ImageBuffer::from_fn(12, 8, |_, _| image::Rgba([65535_u16, 32896, 0, 65535]));
    image::DynamicImage::from(deep).save(folder.path().join("images/a0.png")).unwrap();
    // Red where opaque; the colour under the transparent half must not bleed.
    let half = |u: f64, _| {
        if u < 6.0 { [200, 0, 0, 255] } else { [0, 255, 0, 0] }
    };
    write_photo(&folder.path().join("images/a1.png"), 12, 8, half);
    let mask = |u: f64, _| if u < 3.0 { [0, 0, 0, 255] } else { [255; 4] };
    write_photo(&folder.path().join("masks/a2.png"), 12, 8, mask);
    let dataset = load_plain(folder.path());
    assert_eq!(dataset.views[0].photo.pixels().unwrap().rgba[..4], [255, 128, 0, 255]);
    assert_eq!(dataset.views[1].photo.pixels().unwrap().rgba[4 * 7..4 * 8], [0, 255, 0, 0]);
    assert_eq!(dataset.views[2].photo.pixels().unwrap().rgba[..4], [90, 120, 150, 0]);
    assert_eq!(dataset.views[2].photo.pixels().unwrap().rgba[12..16], [90, 120, 150, 255]);
    assert_note(&dataset, "1 photo masked");
    let options = LoadOptions { resolution: Resolution::Factor(4), ..Default::default() };
    let small = load(folder.path(), &options);
    let small = small.views[1].photo.pixels().unwrap();
    let pixels: Vec<&[u8]> = small.rgba.chunks_exact(4).collect();
    assert!(pixels[0][3] > 240 && pixels[2][3] < 20, "{pixels:?}");
    assert!(pixels.iter().all(|p| p[3] < 8 || (p[0] > 190 && p[1] < 16)), "{pixels:?}");
}

/// Masks that leave one object in each photo say so themselves; those of a lens, and of some photos, do not.
#[test]
fn masks_around_an_object_need_no_option() {
    let folder = Model::small(3).scene();
    let write = |name: &str, at: f64, drops: u8| {
        let mask =
            move |u: f64, v: f64| if (u - at).hypot(v - 4.0) < 3.0 { [255; 4] } else { [drops, drops, drops, 255] };
        write_photo(&folder.path().join("masks").join(name), 12, 8, mask);
    };
    let loaded = |options: &LoadOptions| {
        let dataset = load(folder.path(), options);
        let outside = dataset.views[1].photo.pixels().unwrap().rgba[3];
        (dataset.masks, outside)
    };
    let usual = LoadOptions::default();
    write("a0.png", 5.0, 0);
    write("a1.png", 6.0, 0);
    assert_eq!(loaded(&usual), (Masks::Ignore, 0), "a photo has no mask");
    write("a2.png", 7.0, 0);
    assert_eq!(loaded(&usual), (Masks::Object, 1));
    assert_note(&load(folder.path(), &usual), "outside of the masks there is nothing");
    let ignored = LoadOptions { masks: Some(Masks::Ignore), ..LoadOptions::default() };
    assert_eq!(loaded(&ignored), (Masks::Ignore, 0));
    let plain = LoadOptions { alpha: Some(Alpha::Mask), ..LoadOptions::default() };
    assert_eq!(loaded(&plain), (Masks::Ignore, 0), "who says what alpha is wants no guess");
    ["a0.png", "a1.png", "a2.png"].into_iter().for_each(|name| write(name, 6.0, 0));
    assert_eq!(loaded(&usual), (Masks::Ignore, 0), "the same in all photos: a lens");
    write("a0.png", 5.0, 0);
    write("a2.png", 5.0, 255);
    assert_eq!(loaded(&usual), (Masks::Ignore, 0), "one photo is whole");
}

/// Alpha says how much of a pixel the object covers: 1 is nothing, 255 all, 0 no photo at all.
#[test]
fn an_object_is_told_from_emptiness_and_from_what_the_lens_leaves_out() {
    let folder = Model::small(3).scene();
    let half = |u: f64, _| [200, 0, 0, [255, 100, 0][u as usize / 4]];
    write_photo(&folder.path().join("images/a0.png"), 12, 8, half);
    let mask = |u: f64, _| if u < 3.0 { [0, 0, 0, 255] } else { [255; 4] };
    write_photo(&folder.path().join("masks/a2.png"), 12, 8, mask);
    let object = LoadOptions { masks: Some(Masks::Object), ..Default::default() };
    let dataset = load(folder.path(), &object);
    assert_note(&dataset, "2 photos of an object");
    let pixel = |view: usize, at: usize| -> [u8; 4] {
        dataset.views[view].photo.pixels().unwrap().rgba[4 * at..4 * at + 4].try_into().unwrap()
    };
    assert_eq!([pixel(0, 0), pixel(0, 4), pixel(0, 8)], [[200, 0, 0, 255], [200, 0, 0, 100], [200, 0, 0, 1]]);
    // A photo without a mask beside others is an ordinary one.
    assert!(dataset.views[1].photo.pixels().unwrap().rgba.chunks_exact(4).all(|p| p == [90, 120, 150, 255]));
    assert_eq!([pixel(2, 0), pixel(2, 3)], [[90, 120, 150, 1], [90, 120, 150, 255]]);
    // Over white: (200, 0, 0) with a cover of 99 / 254, and white.
    let over = dataset.views[0].photo.pixels().unwrap().over([1.0; 3]);
    let white: Vec<&[u8]> = over.rgba.chunks_exact(4).take(12).collect();
    assert_eq!([white[0], white[4], white[8]], [[200, 0, 0, 255], [234, 156, 156, 255], [255; 4]]);
    let untouched = load_plain(folder.path());
    assert_eq!(
        untouched.views[0].photo.pixels().unwrap().rgba[4 * 8..4 * 9],
        [200, 0, 0, 0],
        "masks are ignored unless asked for"
    );
    let none = Model::small(2).scene();
    assert_note(&load(none.path(), &object), "no photo has a mask");
    let both = LoadOptions { alpha: Some(Alpha::Composite), ..object };
    let text = dataset::load(folder.path(), &both).unwrap_err().to_string();
    assert!(
        text.contains("`data.alpha`") && text.contains("composite") && text.contains("`data.masks` is `object`"),
        "{text}"
    );
}

/// What the undistorted photo has no value for is not empty, at full size and resized.
#[test]
fn an_object_through_a_lens() {
    let camera = camera((2, "SIMPLE_RADIAL"), &[130.0, 78.0, 63.0, 0.2]);
    let folder = pattern_scene(&camera, [160, 120], [0.2, 0., 0., 0., 0., 0., 0., 0.]);
    let mask = |u: f64, _| if u < 80.0 { [0, 0, 0, 255] } else { [255; 4] };
    write_photo(&folder.path().join("masks/a0.png"), 160, 120, mask);
    for factor in [1, 2] {
        let options =
            LoadOptions { masks: Some(Masks::Object), resolution: Resolution::Factor(factor), ..Default::default() };
        let dataset = load(folder.path(), &options);
        let [masked, plain] = [0, 1].map(|view| dataset.views[view].photo.pixels().unwrap());
        let alphas = |photo: &Photo| photo.rgba.chunks_exact(4).map(|p| p[3]).collect::<Vec<_>>();
        let (masked, plain) = (alphas(&masked), alphas(&plain));
        let outside = plain.iter().filter(|&&a| a == 0).count();
        assert!(outside > 20 && plain.iter().all(|&a| a == 0 || a == 255), "{factor}: {outside}");
        for (i, (&with, &without)) in masked.iter().zip(&plain).enumerate() {
            assert_eq!(with == 0, without == 0, "factor {factor}, pixel {i}");
        }
        assert!(masked.contains(&1) && masked.contains(&255));
    }
}

#[test]
fn exif_orientation_is_not_applied() {
    let folder = Model::small(2).scene();
    let path = folder.path().join("images/a0.png");
    write_photo(&path, 12, 8, |u, _| [if u < 6.0 { 255 } else { 0 }, 0, 0, 255]);
    let mut png = std::fs::read(&path).unwrap();
    // An eXIf chunk after IHDR: big-endian TIFF, one entry, tag 0x0112 (orientation) = 3, turned by 180 degrees.
    let mut chunk = b"eXIfMM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x03\0\0\0\0\0\0".to_vec();
    let crc = crc32(&chunk);
    chunk.splice(0..0, (chunk.len() as u32 - 4).to_be_bytes());
    chunk.extend(crc.to_be_bytes());
    png.splice(33..33, chunk);
    write_file(&path, png);
    let dataset = load_plain(folder.path());
    let rgba = &dataset.views[0].photo.pixels().unwrap().rgba;
    assert_eq!((rgba[0], rgba[4 * 11]), (255, 0));
    let note = "1 photo has an EXIF orientation that asks for turned pixels";
    assert_note(&dataset, &format!("{note}: a0.png; the pixels are used as the files store them"));
    let info = dataset::inspect(folder.path()).unwrap();
    assert!(info.notes.len() == 1 && info.notes[0].starts_with(&format!("{note}: images/a0.png")), "{:?}", info.notes);
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg()))
    })
}

#[test]
fn transforms_json_distortion() {
    let folder = tempfile::tempdir().unwrap();
    let (focal, principal) = (DVec2::new(130.0, 128.0), DVec2::new(84.0, 57.0));
    // nerfstudio's k3 stays in the numerator; k4 there is the factor of r^8, none of OpenCV's.
    let k = [-0.1, 0.03, 0.004, -0.003, 0.02, 0.0, 0.0, 0.0];
    for name in ["a.png", "b.png"] {
        write_photo(&folder.path().join(name), 160, 120, |u, v| {
            pattern(undistort((DVec2::new(u, v) - principal) / focal, k))
        });
    }
    let head = r#""camera_model": "OPENCV", "fl_x": 130, "fl_y": 128, "cx": 84, "cy": 57, "w": 160, "h": 120,
        "k1": -0.1, "k2": 0.03, "p1": 0.004, "p2": -0.003, "k3": 0.02, "k4": 0.0,"#;
    write_file(&folder.path().join("transforms.json"), transforms(head, &[("a.png", ""), ("b.png", "")]));
    let dataset = load_plain(folder.path());
    assert!(assert_pattern(&dataset.views[0], 4.0) > 0.9);
    assert_note(&dataset, "2 photos undistorted");
    assert_note(&dataset, "random");
}
