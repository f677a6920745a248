//! Attacks made by hand, each with the sentence that answers it.

use super::{readers, seeds};
use glam::DVec3;
use ibgs_core::bundle::Bundle;
use ibgs_core::camera_path::{CameraPath, KeyframePath};
use ibgs_core::dataset::{self, LoadOptions, Point};
use ibgs_core::mesh::score::read_truth;
use ibgs_core::output::cameras;
use ibgs_core::output::figures::Storage;
use ibgs_core::residual::state_dict::StateDict;
use ibgs_core::scene::from_points;
use ibgs_testing::fails;
use ibgs_testing::scene_files::{Camera, Model, PINHOLE, write_file, write_photo, zip_of};
use serde_json::json;
use std::io::Cursor;
use std::path::Path;
use std::time::{Duration, Instant};
use zip::CompressionMethod;

/// A chunk of a PNG with its checksum.
fn chunk(kind: &[u8], data: &[u8]) -> Vec<u8> {
    let body = [kind, data].concat();
    let step = |crc: u32, byte: &u8| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { 0xedb8_8320 ^ crc >> 1 } else { crc >> 1 })
    };
    let crc = !body.iter().fold(u32::MAX, step);
    [&(data.len() as u32).to_be_bytes(), &body[..], &crc.to_be_bytes()].concat()
}

/// A PNG that promises a size and has no pixel.
pub fn png_header(width: u32, height: u32) -> Vec<u8> {
    let size = [width.to_be_bytes(), height.to_be_bytes()].concat();
    let header = chunk(b"IHDR", &[&size[..], &[8, 2, 0, 0, 0]].concat());
    [b"\x89PNG\r\n\x1a\n", &header[..], &chunk(b"IDAT", &[]), &chunk(b"IEND", &[])].concat()
}

/// The bytes with the first occurrence of some replaced.
fn replaced(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|window| window == from).expect("it is in there");
    [&bytes[..at], to, &bytes[at + from.len()..]].concat()
}

#[track_caller]
fn photo_fails(bytes: &[u8], sentence: &str) {
    let error = dataset::decode_photo(Path::new("a.photo"), bytes, &LoadOptions::default()).unwrap_err();
    let expected =
        format!("photo a.photo does not decode: {sentence}; replace it with a whole JPEG, PNG, WebP, TIFF or EXR file");
    assert_eq!(error.to_string(), expected);
}

#[test]
fn photos_whose_headers_promise_too_much() {
    let begun = Instant::now();
    photo_fails(
        &png_header(100_000, 100_000),
        "its header promises 100000 x 100000 pixels, which its 57 bytes cannot hold",
    );
    // So many bytes could hold them.
    let many = [&png_header(20_000, 10_000)[..], &[0; 30_000]].concat();
    photo_fails(&many, "its 20000 x 10000 pixels take more than 512 MiB");
    let [_, _, jpeg, exr, tiled, ..]: [Vec<u8>; 7] = seeds::of("photo").try_into().unwrap();
    // Height and width stand after the length and depth of the frame header.
    let at = jpeg.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap() + 5;
    let mut wide = jpeg.clone();
    wide[at..at + 4].copy_from_slice(&[0x7f, 0xff, 0x7f, 0xff]);
    let length = jpeg.len();
    let sentence = format!("its header promises 32767 x 32767 pixels, which its {length} bytes cannot hold");
    photo_fails(&wide, &sentence);
    let window = |x: i32, y: i32| [0, 0, x, y].map(i32::to_le_bytes).concat();
    let named = |name: &str, x, y| [format!("{name}\0box2i\0\x10\0\0\0").as_bytes(), &window(x, y)].concat();
    let exr_of = |data: [i32; 2], display: [i32; 2]| {
        let exr = replaced(&exr, &named("dataWindow", 8, 6), &named("dataWindow", data[0], data[1]));
        replaced(&exr, &named("displayWindow", 8, 6), &named("displayWindow", display[0], display[1]))
    };
    let length = exr.len();
    let sentence = format!("its header promises 16000 x 16000 pixels, which its {length} bytes cannot hold");
    photo_fails(&exr_of([15_999, 15_999], [15_999, 15_999]), &sentence);
    photo_fails(&exr_of([8, 6], [15_999, 15_999]), "a frame of 16000 x 16000 pixels around 63 makes no sense");
    photo_fails(&exr_of([99_999, 99_999], [8, 6]), "a size of 100000 x 100000 pixels makes no sense");
    let tiles = |side: u32| [&b"tiles\0tiledesc\0\x09\0\0\0"[..], &side.to_le_bytes(), &side.to_le_bytes()].concat();
    let huge = replaced(&tiled, &tiles(16), &tiles(1 << 22));
    photo_fails(&huge, "blocks of 4194304 x 4194304 pixels make no sense");
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
}

#[test]
fn names_that_windows_takes_for_a_way_out() {
    for name in [".. /a.png", "a/.../b.png", "..\\a.png", ". ./a.png"] {
        let mut model = Model::small(2);
        model.images[0].name = name.to_owned();
        let folder = Model::small(2).scene();
        model.write_binary(folder.path());
        fails(folder.path(), &["images.bin", name, "or contains `..` or control characters"]);
    }
}

#[test]
fn cameras_beyond_all_measure() {
    let fails_after = |change: fn(&mut Model), fragments: &[&str]| {
        let mut model = Model::small(2);
        change(&mut model);
        let folder = Model::small(2).scene();
        model.write_binary(folder.path());
        fails(folder.path(), fragments);
    };
    let focal = "the focal length [0.000000000000000000000000000001, 11] fits no image of 12 x 8 pixels";
    fails_after(|model| model.cameras[0].params[0] = 1e-30, &["camera 1", focal]);
    fails_after(|model| model.cameras[0].params[3] = -1e30, &["camera 1", "the principal point", "fits no image"]);
    let far = "image `a0.png`: the translation [0, -10000000000000000, 2] lies beyond 1e12";
    fails_after(|model| model.images[0].t[1] = -1e16, &["images.bin", far]);
    // A point that single precision does not hold is left out.
    let mut model = Model::small(2);
    model.points[0].xyz[1] = 1e200;
    let dataset = dataset::load(model.scene().path(), &LoadOptions::default()).unwrap();
    assert_eq!((dataset.points.len(), dataset.notes.len()), (1, 1));
}

/// As many cameras as images: no work that grows with their product.
#[test]
fn many_cameras_are_counted_in_one_go() {
    let mut model = Model::small(1);
    let image = model.images[0].clone();
    let camera = |id| Camera { id, model: PINHOLE, size: [12, 8], params: vec![10.0, 11.0, 6.5, 3.75] };
    model.cameras = (0..150_000).map(camera).collect();
    model.images = (0..150_000).map(|camera| ibgs_testing::scene_files::Image { camera, ..image.clone() }).collect();
    let folder = tempfile::tempdir().unwrap();
    write_photo(&folder.path().join("images/a0.png"), 12, 8, |_, _| [1; 4]);
    model.write_binary(folder.path());
    let begun = Instant::now();
    let info = dataset::inspect(folder.path()).unwrap();
    assert!(begun.elapsed() < Duration::from_secs(8), "{:?}", begun.elapsed());
    assert!(info.cameras.len() == 150_000 && info.cameras.iter().all(|camera| camera.images == 1));
}

fn bundle_error(bytes: &[u8]) -> String {
    Bundle::read_from(Cursor::new(bytes), Path::new("a.ibgs")).unwrap_err().to_string()
}

#[test]
fn bundles_that_unpack_to_more_than_they_are() {
    let parts = seeds::bundle_parts();
    let compressed = seeds::zip_with(&parts, CompressionMethod::Deflated);
    assert_eq!(
        bundle_error(&compressed),
        "the bundle a.ibgs is damaged: its `ibgs.json` cannot be read (unsupported Zip archive: it is compressed, which \
         no part of such a file is); copy or export it again"
    );
    let with_cameras = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut parts = parts.clone();
        let part = &mut parts.iter_mut().find(|(name, _)| name == "cameras.json").unwrap().1;
        let mut json: serde_json::Value = serde_json::from_slice(part).unwrap();
        change(&mut json);
        *part = json.to_string().into_bytes();
        seeds::stored_zip(&parts)
    };
    // The same photo for many cameras, each of 16384 x 16384 pixels.
    let many = with_cameras(&|json| {
        let mut camera = json[0].clone();
        (camera["width"], camera["height"]) = (16_384.into(), 16_384.into());
        *json = vec![camera; 100].into();
    });
    let length = many.len();
    let sentence = format!("its `cameras.json` asks for 107374182400 bytes of photos, which a file of {length} bytes");
    assert!(bundle_error(&many).contains(&sentence), "{}", bundle_error(&many));
    let mut lying = parts.clone();
    let photo = &mut lying.iter_mut().find(|(name, _)| name == "photos/a.png.png").unwrap().1;
    *photo = png_header(10_000, 10_000);
    let cameras = with_cameras(&|json| (json[0]["width"], json[0]["height"]) = (10_000.into(), 10_000.into()));
    let mut zip = zip::ZipArchive::new(Cursor::new(cameras)).unwrap();
    let mut text = Vec::new();
    std::io::copy(&mut zip.by_name("cameras.json").unwrap(), &mut text).unwrap();
    lying.iter_mut().find(|(name, _)| name == "cameras.json").unwrap().1 = text;
    assert_eq!(
        bundle_error(&seeds::stored_zip(&lying)),
        "the bundle a.ibgs is damaged: its `photos/a.png.png` is no usable picture (its header promises 10000 x 10000 \
         pixels, which its 57 bytes cannot hold); copy or export it again"
    );
}

#[test]
fn cameras_json_beyond_all_measure() {
    let whole = serde_json::from_slice::<serde_json::Value>(&seeds::of("model_folder")[0][1..]).unwrap();
    let problem = |field: &str, value: serde_json::Value| {
        let mut json = whole.clone();
        json[0][field] = value;
        cameras::from_json(&json.to_string()).unwrap_err()
    };
    let sentence = |what: &str| format!("camera `a.png` has {what}");
    assert_eq!(problem("width", json!(4_000_000_000_u32)), sentence("an image of more than 2^28 pixels"));
    assert_eq!(problem("fx", json!(1e-300)), sentence("a focal length that is not positive"));
    let far = sentence("a principal point or position out of range");
    assert_eq!(problem("translation", json!([0, 1e300, 0])), far);
    assert_eq!(problem("cx", json!(1e300)), far);
}

/// The state dict in a file of this name and contents, asked for the tensor of a shape.
fn weights(name: &str, bytes: &[u8], shape: &[usize]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write_file(&path, bytes);
    let read = StateDict::open(&path).and_then(|file| file.tensor(seeds::TENSOR, shape));
    let error = read.unwrap_err().to_string();
    error.replace(folder.path().to_str().unwrap(), "").replace(['\\', '/'], "")
}

#[test]
fn weights_that_unpack_to_more_than_they_are() {
    let unusable =
        |problem: &str| format!("a.pth is not a usable file of network weights: {problem}; copy or export it again");
    // 100 MB of `None` in 100 KB.
    let bomb = [b"\x80\x02(", &vec![b'N'; 100 << 20][..], b"l."].concat();
    let part = [("archive/data.pkl".to_owned(), bomb.clone())];
    let compressed = seeds::zip_with(&part, CompressionMethod::Deflated);
    assert!(compressed.len() < 200_000, "{}", compressed.len());
    assert_eq!(
        weights("a.pth", &compressed, &[6]),
        unusable("its part `archivedata.pkl` is compressed, which PyTorch never does")
    );
    let much = unusable("it has more than 1048576 bytes besides the values, which no file of weights has");
    assert_eq!(weights("a.pth", &seeds::stored_zip(&part), &[6]), much);
    assert_eq!(weights("a.pth", &bomb, &[6]), much);
    let mut tar = vec![0; 1024];
    tar[..8].copy_from_slice(b"sys_info");
    tar[257..262].copy_from_slice(b"ustar");
    assert_eq!(
        weights("a.pth", &tar, &[6]),
        unusable("it is a TAR archive, as PyTorch wrote before 2017; save it again with a later one")
    );
    // A tensor of 2^30 values that are all the same one: 4 GiB of 24 bytes.
    let repeated = replaced(&seeds::pickle(), b"K\x02K\x03\x86K\x03K\x01\x86", b"J\0\0\0\x40\x85K\0\x85");
    assert_eq!(
        weights("a.pth", &seeds::pth_of(&repeated), &seeds::TENSOR_SHAPE),
        "a.pth: tensor `a` has the shape [1073741824] where [2, 3] is needed"
    );
}

/// A legacy file larger than what its pickles may have still loads: the values do not count.
#[test]
fn old_files_of_many_values_load() {
    let mut bytes = vec![0];
    bytes.extend(seeds::legacy_pth());
    assert!(readers::pth(&bytes));
    bytes.extend(vec![0; 2 << 20]);
    assert!(readers::pth(&bytes));
}

#[test]
fn safetensors_whose_sizes_lie() {
    let unusable = |problem: &str| {
        format!("a.safetensors is not a usable file of network weights: {problem}; copy or export it again")
    };
    let file = |header: &str, values: &[u8]| [&(header.len() as u64).to_le_bytes(), header.as_bytes(), values].concat();
    // Tensors whose sizes add up to 2^64 - 1.
    let each = (1_u64 << 61) - 1;
    let tensor = |at: u64, size: u64| {
        format!(
            r#""{at}": {{"dtype": "U8", "shape": [{size}], "data_offsets": [{}, {}]}}"#,
            at * each,
            at * each + size
        )
    };
    let tensors: Vec<String> = (0..8).map(|at| tensor(at, each)).chain([tensor(8, 7)]).collect();
    let header = format!("{{{}}}", tensors.join(", "));
    assert_eq!(
        weights("a.safetensors", &file(&header, &[1, 2, 3]), &[6]),
        unusable("its header promises 18446744073709551615 bytes of values, it has 3")
    );
    let mut long = file("{}", &[]);
    long[..8].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    assert_eq!(weights("a.safetensors", &long, &[6]), unusable("it ends inside its header"));
}

#[test]
fn archives_of_empty_folders() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep.zip");
    let write = |count: usize, depth: usize| {
        let names: Vec<String> = (0..count).map(|at| format!("{at}/{}a", "a/".repeat(depth - 1))).collect();
        let parts: Vec<(&str, &[u8])> = names.iter().map(|name| (name.as_str(), &b""[..])).collect();
        write_file(&path, zip_of(&parts));
    };
    write(1, 1500);
    fails(&path, &["deep.zip: it has an entry 1500 folders deep, more than 32; pack the scene again"]);
    write(700, 32);
    fails(&path, &["deep.zip", "it unpacks to more than", "20 times its size and 64 MiB"]);
}

#[test]
fn paths_beyond_all_measure() {
    let whole: serde_json::Value = serde_json::from_slice(&seeds::of("camera_path")[0]).unwrap();
    let problems = |pointer: &str, value: serde_json::Value| {
        let mut json = whole.clone();
        *json.pointer_mut(pointer).unwrap() = value;
        let text = json.to_string();
        [CameraPath::parse(&text).unwrap_err(), KeyframePath::parse(&text).unwrap_err()]
    };
    for problem in problems("/camera_path/1/camera_to_world/3", json!(1e300)) {
        assert!(problem.starts_with("camera_path[1]: the position is [1"), "{problem}");
        assert!(problem.ends_with("; its coordinates must lie within 1e12"), "{problem}");
    }
    for problem in problems("/camera_path/1/fov", json!(1e-320)) {
        assert!(problem.starts_with("camera_path[1]: `fov` is 0.000"), "{problem}");
    }
}

/// Points that follow one another along a line.
#[test]
fn clouds_in_order_make_no_deep_tree() {
    let point = |at: f64| Point { position: DVec3::new(at, 2.0 * at, 3.0 * at), color: [1, 2, 3] };
    let points: Vec<Point> = (0..400_000).map(|at| point(f64::from(at))).collect();
    let begun = Instant::now();
    let gaussians = from_points(&points, 0, 0.1).unwrap();
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
    // In the middle two neighbours are a step away, the third two steps.
    let expected = ((14.0 + 14.0 + 4.0 * 14.0) / 3.0_f64).ln() / 2.0;
    assert!((f64::from(gaussians.log_scales[200_000][0]) - expected).abs() < 1e-5);
}

#[test]
fn storage_that_adds_up_to_more_than_there_is() {
    let storage = Storage { gaussians: Some(u64::MAX), network: Some(1), ..Storage::default() };
    assert_eq!(storage.total(), Some(u64::MAX));
}

#[test]
fn true_surfaces_in_other_units() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("truth.ply");
    write_file(
        &path,
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
         property list uchar int vertex_indices\nend_header\n0 0 0\n1e9 0 0\n0 1e9 0\n3 0 1 2\n",
    );
    let error = read_truth(&path, 0.01).unwrap_err().to_string();
    assert!(error.contains("truth.ply") && error.contains("its triangles would give 1"), "{error}");
    assert!(error.contains("points 0.01 apart, more than 100000000; is it in other units?"), "{error}");
}
