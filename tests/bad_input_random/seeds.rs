//! Whole files, small: what the damaged ones are made from.

use exr::prelude::{
    Blocks, Encoding, Image, Layer, LayerAttributes, SpecificChannels, Vec2, WritableImage, write_rgba_file,
};
use glam::{DMat3, DVec2, DVec3};
use ibgs_core::blocks::{Block, BlockPlan, PlanFolder};
use ibgs_core::bundle::{Bundle, Packing};
use ibgs_core::camera::Camera;
use ibgs_core::config::{Method, TrainConfig};
use ibgs_core::dataset::{Photo, Point};
use ibgs_core::exposure::Exposure;
use ibgs_core::local_space::LocalSpace;
use ibgs_core::output::cameras::{self, CameraRecord, Split};
use ibgs_core::scene::{self, Format, PlyFlavor};
use ibgs_testing::checkpoint_file;
use ibgs_testing::scene_files::{Model, npy, write_photo, zip_of};
use ibgs_train::checkpoint;
use image::{DynamicImage, ImageFormat};
use serde_json::json;
use std::fs;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use std::sync::OnceLock;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// The tensor in files of weights.
pub const TENSOR: &str = "a";
pub const TENSOR_SHAPE: [usize; 2] = [2, 3];

/// The JSON files of a model folder, by the number that chooses one.
pub const MODEL_FILES: [&str; 7] = [
    "cameras.json",
    "multi_view.json",
    "results_renders.json",
    "per_view_renders.json",
    "result_fps_mem.json",
    "result_training.json",
    "training_log.json",
];

/// Parts of an archive by name.
pub type Parts = Vec<(String, Vec<u8>)>;

/// Whole files for a reader, or for a file of scenes that a loader checks by itself.
pub fn of(reader: &str) -> Vec<Vec<u8>> {
    match reader {
        "cameras.bin" => vec![Model::small(2).cameras_bin()],
        "images.bin" => vec![Model::small(2).images_bin()],
        "points3D.bin" => vec![Model::small(2).points_bin()],
        "cameras.txt" => vec![Model::small(2).cameras_txt().into_bytes()],
        "images.txt" => vec![Model::small(2).images_txt().into_bytes()],
        "points3D.txt" => vec![Model::small(2).points_txt().into_bytes()],
        "cameras.csv" => reality_capture(),
        "poses_bounds.npy" => vec![poses_bounds()],
        "cameras_sphere.npz" => vec![neus_cameras()],
        "transforms_json" => transforms(),
        "ply" => plys(),
        "gaussians" => gaussians(),
        "camera_path" => camera_paths(),
        "bundle" => archives(&bundle_parts()),
        "checkpoint" => archives(&checkpoint_parts()),
        "pth" => vec![chosen(1, &pickle()), chosen(0, &pth_of(&pickle())), chosen(0, &legacy_pth())],
        "safetensors" => vec![safetensors()],
        "zip_scene" => vec![ibgs_testing::scene_files::zip_of_folder(Model::small(2).scene().path(), "top/")],
        "photo" => photos(),
        "config" => vec![TrainConfig::default().to_text().unwrap().into_bytes(), b"iterations = 3\n".to_vec()],
        "model_folder" => numbered(model_files()),
        "plan" => vec![plan()],
        other => panic!("no seeds for {other}"),
    }
}

fn chosen(at: usize, bytes: &[u8]) -> Vec<u8> {
    [&[at as u8], bytes].concat()
}

/// Every part of an archive, and the whole.
fn archives(parts: &Parts) -> Vec<Vec<u8>> {
    let single = parts.iter().enumerate().map(|(at, (_, part))| chosen(at, part));
    single.chain([stored_zip(parts)]).collect()
}

/// A whole checkpoint of plain splatting with two Gaussians, part by part.
pub fn checkpoint_parts() -> Parts {
    let config = TrainConfig { method: Method::Gs3, ..TrainConfig::default() }.to_text().unwrap();
    checkpoint_file::parts(checkpoint::FORMAT, checkpoint::VERSION, &config)
}

fn numbered<const N: usize>(files: [Vec<u8>; N]) -> Vec<Vec<u8>> {
    files.iter().enumerate().map(|(at, bytes)| chosen(at, bytes)).collect()
}

/// The photos that the transforms name.
pub fn transforms_photos(folder: &Path) {
    for index in 0..2 {
        write_photo(&folder.join(format!("images/{index}.png")), 8, 6, |_, _| [1, 2, 3, 255]);
    }
}

fn transforms() -> Vec<Vec<u8>> {
    let pose = |x: f64| json!([[1, 0, 0, x], [0, 1, 0, 0.5], [0, 0, 1, 2], [0, 0, 0, 1]]);
    let plain = json!({ "fl_x": 8.5, "frames": [
        { "file_path": "images/0.png", "transform_matrix": pose(0.25) },
        { "file_path": "./images/1", "transform_matrix": pose(-1.0) },
    ]});
    let full = json!({ "camera_model": "OPENCV", "camera_angle_x": 0.7, "w": 16, "h": 12, "cx": 8.0, "cy": 5.5,
        "k1": 0.01, "k2": -0.02, "k3": 0.0, "k4": 0.0, "p1": 0.001, "p2": 0.0, "ply_file_path": "points.ply", "frames": [
        { "file_path": "images/0.png", "transform_matrix": pose(0.0), "fl_x": 9.0, "fl_y": 9.5 },
        { "file_path": "images/1.png", "transform_matrix": pose(1.0), "camera_model": "OPENCV_FISHEYE", "k1": 0.1 },
    ]});
    [plain, full].map(|json| json.to_string().into_bytes()).into()
}

fn points() -> Vec<Point> {
    [[0.0, 1.0, 2.0], [0.5, -1.0, 3.0]].map(|p| Point { position: p.into(), color: [9, 100, 200] }).into()
}

/// The contents of a file that something writes by path.
fn written(name: &str, write: impl FnOnce(&Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write(&path);
    fs::read(path).unwrap()
}

fn plys() -> Vec<Vec<u8>> {
    let write = |degree: u32, flavor: PlyFlavor| {
        let gaussians = scene::from_points(&points(), degree, 0.3).unwrap();
        written("a.ply", |path| scene::write_ply(path, &gaussians, flavor).unwrap())
    };
    let fields = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let fields: String = fields.split(' ').map(|field| format!("property float {field}\n")).collect();
    let text = format!(
        "ply\nformat ascii 1.0\ncomment c\nelement camera 1\nproperty list uchar float v\nelement vertex 2\n{fields}\
         end_header\n2 0.5 1\n1 2 3 4 5 6 7 8 9 10 11 12 13 14\n-1 -2 -3 4e0 5 6 7 8 9 10 11 12 13 14\n"
    );
    let cloud = "ply\nformat binary_big_endian 1.0\nelement vertex 2\nproperty double x\nproperty float y\n\
                 property short z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    let cloud = [cloud.as_bytes(), &[7; 34]].concat();
    let far = LocalSpace::at(DVec3::new(5e6, -0.5, 3.0));
    let own = written("a.ply", |path| scene::write_points_ply(path, &points(), far).unwrap());
    vec![write(1, PlyFlavor::Full), write(0, PlyFlavor::Plain), text.into_bytes(), cloud, own]
}

/// Endings of the names of files of Gaussians, by the number that chooses one: one that says nothing, then those of the
/// formats.
pub fn endings() -> Vec<&'static str> {
    std::iter::once(".gaussians").chain(Format::ALL.map(Format::ending)).collect()
}

/// Every format that is written; its name has its ending only where its contents do not say what it is.
fn gaussians() -> Vec<Vec<u8>> {
    let model = scene::from_points(&points(), 1, 0.3).unwrap();
    let write = |(at, format): (usize, Format)| {
        let bytes = written("a.bin", |path| scene::write_gaussians(path, &model, format).unwrap());
        chosen(if Format::of_contents(&bytes).is_some() { 0 } else { at }, &bytes)
    };
    let is_written = |&(_, format): &(usize, Format)| Format::written().any(|written| written == format);
    (1..).zip(Format::ALL).filter(is_written).map(write).collect()
}

fn camera_paths() -> Vec<Vec<u8>> {
    let matrix = |x: f64| vec![1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.5, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 1.0];
    let frame = |x: f64| json!({ "camera_to_world": matrix(x), "fov": 50.0, "aspect": 1.5 });
    let key = |x: f64| json!({ "matrix": matrix(x), "fov": 60.0 });
    let base = json!({ "render_width": 64, "render_height": 48.0, "fps": 4.0, "seconds": 2.0,
        "camera_type": "perspective", "camera_path": [frame(0.0), frame(1.0)] });
    let mut keys = base.clone();
    keys["keyframes"] = json!([key(0.0), key(1.0), key(-2.0)]);
    keys["is_cycle"] = json!(true);
    [base, keys].map(|json| json.to_string().into_bytes()).into()
}

fn camera() -> Camera {
    Camera {
        width: 4,
        height: 3,
        focal: DVec2::new(5.0, 5.5),
        principal: DVec2::new(2.0, 1.5),
        view_from_world: DMat3::IDENTITY,
        translation: DVec3::new(0.5, 0.0, 2.0),
    }
}

fn records() -> Vec<CameraRecord> {
    let record = |name: &str, split| CameraRecord { name: name.to_owned(), camera: camera(), split: Some(split) };
    vec![record("a.png", Split::Train), record("sub/b.png", Split::Train), record("c.png", Split::Test)]
}

/// A whole bundle, part by part.
pub fn bundle_parts() -> Parts {
    static PARTS: OnceLock<Parts> = OnceLock::new();
    let make = || {
        let photo = |alpha: u8| Photo { width: 4, height: 3, rgba: [10, 20, 30, alpha].repeat(12) }.into();
        let bundle = Bundle {
            iteration: 7,
            gaussians: scene::from_points(&points(), 0, 0.3).unwrap(),
            members: Vec::new(),
            levels: None,
            network: Some(vec![1, 2, 3]),
            exposure: Some([("a.png".to_owned(), Exposure { log_gain: [0.1; 3], offset: [0.0; 3] })].into()),
            cameras: records(),
            config: TrainConfig::default(),
            photos: vec![("a.png".to_owned(), photo(255)), ("sub/b.png".to_owned(), photo(0))],
            sources: Vec::new(),
        };
        let bytes = written("a.ibgs", |path| bundle.write(path, Packing::Lossless).unwrap());
        let mut zip = ZipArchive::new(Cursor::new(bytes)).unwrap();
        let names: Vec<String> = (0..zip.len()).map(|at| zip.name_for_index(at).unwrap().unwrap().into()).collect();
        let mut part = |name: String| {
            let mut bytes = Vec::new();
            zip.by_name(&name).unwrap().read_to_end(&mut bytes).unwrap();
            (name, bytes)
        };
        names.into_iter().map(&mut part).collect()
    };
    PARTS.get_or_init(make).clone()
}

/// An archive without compression.
pub fn stored_zip(parts: &[(String, Vec<u8>)]) -> Vec<u8> {
    zip_with(parts, CompressionMethod::Stored)
}

/// An archive with one compression for all parts.
pub fn zip_with(parts: &[(String, Vec<u8>)], method: CompressionMethod) -> Vec<u8> {
    let options = zip::write::SimpleFileOptions::default().compression_method(method);
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in parts {
        zip.start_file(name, options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

fn text(value: &str) -> Vec<u8> {
    [b"X", &(value.len() as u32).to_le_bytes()[..], value.as_bytes()].concat()
}

/// The pickle of a state dict with one tensor, as `torch.save` writes it.
pub fn pickle() -> Vec<u8> {
    let storage =
        [b"(", &text("storage")[..], b"ctorch\nFloatStorage\n", &text("0"), &text("cpu"), b"K\x06tQ"].concat();
    [
        b"\x80\x02ccollections\nOrderedDict\nq\x00)Rq\x01(",
        &text(TENSOR)[..],
        b"ctorch._utils\n_rebuild_tensor_v2\n(",
        &storage,
        b"K\x00K\x02K\x03\x86K\x03K\x01\x86\x89h\x00)RtRu.",
    ]
    .concat()
}

fn values() -> Vec<u8> {
    (0..6_u8).flat_map(|v| f32::from(v).to_le_bytes()).collect()
}

/// A PyTorch file with this pickle.
pub fn pth_of(pickle: &[u8]) -> Vec<u8> {
    let part = |name: &str, bytes: &[u8]| (format!("archive/{name}"), bytes.to_vec());
    stored_zip(&[
        part("data.pkl", pickle),
        part("byteorder", b"little"),
        part("data/0", &values()),
        part("version", b"3\n"),
    ])
}

/// The same in the form before PyTorch 1.6.
pub fn legacy_pth() -> Vec<u8> {
    [
        b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03.\x80\x02}(",
        &text("little_endian")[..],
        b"\x88u.",
        &pickle(),
        b"\x80\x02](",
        &text("0"),
        b"e.",
        &6_u64.to_le_bytes(),
        &values(),
    ]
    .concat()
}

fn safetensors() -> Vec<u8> {
    let view =
        |bytes| safetensors::tensor::TensorView::new(safetensors::Dtype::F32, TENSOR_SHAPE.into(), bytes).unwrap();
    safetensors::serialize([(TENSOR, view(&values()))], None).unwrap()
}

fn plan() -> Vec<u8> {
    let block = Block { train: vec!["a.png".to_owned()], minutes: 0.5, ..Block::default() };
    let plan = BlockPlan { blocks: vec![block.clone(), block], memory_limit: Some(1 << 33) };
    let folder = tempfile::tempdir().unwrap();
    PlanFolder::at(folder.path()).write(&plan, &TrainConfig::default()).unwrap();
    std::fs::read(folder.path().join("plan.json")).unwrap()
}

fn reality_capture() -> Vec<Vec<u8>> {
    let header = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2";
    let row = |name| format!("{name},1.5,-2,3e2,170.3,85,-22.7,14.2,-9.4e-004,2e-3,0.1,-0.2,0.3,0,0.01,-0.01");
    let whole = format!("\u{feff}#cameras 2\r\n{header}\r\n{}\r\n{}\r\n", row("a.jpg"), row("\"b, c.jpg\""));
    vec![whole.into_bytes(), format!("#name,x,y,alt,heading,pitch,roll,f\n{}\n", "a.png,1,2,3,4,5,6,7").into_bytes()]
}

fn poses_bounds() -> Vec<u8> {
    let row = [0.0, 1.0, 0.0, 0.5, 48.0, 1.0, 0.0, 0.0, -2.0, 64.0, 0.0, 0.0, -1.0, 3.0, 70.5, 0.1, 9.0];
    npy(17, &[row, row].concat())
}

fn neus_cameras() -> Vec<u8> {
    let matrix = [70.0, 0.0, 32.0, 5.0, 0.0, 71.0, 24.0, -6.0, 0.0, 0.0, 1.0, 4.0, 0.0, 0.0, 0.0, 1.0];
    let matrix = npy(4, &matrix);
    let parts = [("world_mat_0.npy", &matrix[..]), ("scale_mat_0.npy", &matrix), ("world_mat_1.npy", &matrix)];
    zip_of(&parts)
}

fn photos() -> Vec<Vec<u8>> {
    let rgba = DynamicImage::from(image::RgbaImage::from_fn(9, 7, |x, y| {
        image::Rgba([x as u8 * 20, y as u8 * 30, 7, if x == 3 { 0 } else { 255 }])
    }));
    let encoded = |image: &DynamicImage, format| {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let value = |x: usize, y: usize| (x as f32 * 0.1, y as f32 * 0.2, 0.5, 1.0);
    let exr = written("a.exr", |path| write_rgba_file(path, 9, 7, value).unwrap());
    let encoding = Encoding { blocks: Blocks::Tiles(Vec2(16, 16)), ..Encoding::UNCOMPRESSED };
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| (at.0 as f32 * 0.1, 0.2_f32, 0.5_f32));
    let layer = Layer::new((9, 7), LayerAttributes::named("tiled"), encoding, channels);
    let tiled = written("a.exr", |path| Image::from_layer(layer).write().to_file(path).unwrap());
    let deep = DynamicImage::from(rgba.to_rgb16());
    let rgb = DynamicImage::from(rgba.to_rgb8());
    vec![
        encoded(&rgba, ImageFormat::Png),
        encoded(&deep, ImageFormat::Png),
        encoded(&rgb, ImageFormat::Jpeg),
        exr,
        tiled,
        encoded(&rgba, ImageFormat::WebP),
        encoded(&deep, ImageFormat::Tiff),
    ]
}

fn model_files() -> [Vec<u8>; 7] {
    let means = json!({ "ours_7": { "PSNR": 20.5, "SSIM": 0.9, "LPIPS": null, "PSNR_aligned": 21.0 } });
    let views = json!({ "ours_7": { "PSNR": { "a": 20.5 }, "SSIM": { "a": 0.9 }, "LPIPS": {} } });
    let speed = json!({ "ours_7": { "FPS_warm": 9.5, "FPS_cold": null, "gaussians": 3, "device": "GPU",
        "storage_bytes": { "gaussians": 100, "network": null, "poses": 5, "photos": 7 }, "memory_reserved_bytes": 9 } });
    let time = json!({ "ours_7": { "seconds": 3.5, "iterations": 7, "device": "GPU",
        "stages": { "base": { "iterations": 7, "seconds": 3.5, "peak_reserved_bytes": 9 } } } });
    let sources = json!({ "ref_name": "a.png", "nearest_name": ["b.png"] });
    let log = json!({ "entries": [{ "iteration": 1, "loss": 0.5, "psnr": 20.5, "gaussians": 3, "seconds": 0.1 }], "spacing": 0 });
    [cameras::to_json(&records()), sources, means, views, speed, time, log].map(|json| json.to_string().into_bytes())
}
