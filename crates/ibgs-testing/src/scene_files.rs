//! Writers of small scenes for the loader tests: COLMAP models in both formats, photos.

use glam::DVec3;
use ibgs_data::dataset::parse_points_ply;
use image::{Rgba, RgbaImage};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::fs;
use std::io::{Cursor, Write as _};
use std::path::Path;

/// A camera of a COLMAP model; `model` is its number and name.
#[derive(Clone)]
pub struct Camera {
    pub id: u32,
    pub model: (i32, &'static str),
    pub size: [u64; 2],
    pub params: Vec<f64>,
}

/// An image of a COLMAP model with `[w, x, y, z]` and translation.
#[derive(Clone)]
pub struct Image {
    pub name: String,
    pub camera: u32,
    pub q: [f64; 4],
    pub t: [f64; 3],
    pub observations: Vec<(f64, f64, i64)>,
}

/// A point of a COLMAP model.
#[derive(Clone)]
pub struct ModelPoint {
    pub xyz: [f64; 3],
    pub rgb: [u8; 3],
    pub error: f64,
    pub track: Vec<(u32, u32)>,
}

/// A COLMAP model.
#[derive(Clone)]
pub struct Model {
    pub cameras: Vec<Camera>,
    pub images: Vec<Image>,
    pub points: Vec<ModelPoint>,
}

pub const SIMPLE_PINHOLE: (i32, &str) = (0, "SIMPLE_PINHOLE");
pub const PINHOLE: (i32, &str) = (1, "PINHOLE");

impl Model {
    /// `count` images `a0.png`, `a1.png` ... of one 12 x 8 pinhole camera, side by side, and two points.
    pub fn small(count: usize) -> Model {
        let image = |index: usize| Image {
            name: format!("a{index}.png"),
            camera: 1,
            q: [0.9, 0.1, -0.2, 0.05 * index as f64],
            t: [0.25 * index as f64, -0.1, 2.0],
            observations: vec![(1.5, 2.5, 7), (3.0, 4.0, -1)],
        };
        let track = vec![(1, 0), (2, 1)];
        let point = |x: f64| ModelPoint { xyz: [x, 0.5, 3.0], rgb: [10, 200, 30], error: 0.5, track: track.clone() };
        Model {
            cameras: vec![Camera { id: 1, model: PINHOLE, size: [12, 8], params: vec![10.0, 11.0, 6.5, 3.75] }],
            images: (0..count).map(image).collect(),
            points: vec![point(0.1), point(-0.3)],
        }
    }

    pub fn cameras_bin(&self) -> Vec<u8> {
        let mut out = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for camera in &self.cameras {
            out.extend(camera.id.to_le_bytes());
            out.extend(camera.model.0.to_le_bytes());
            camera.size.iter().for_each(|side| out.extend(side.to_le_bytes()));
            camera.params.iter().for_each(|param| out.extend(param.to_le_bytes()));
        }
        out
    }

    pub fn images_bin(&self) -> Vec<u8> {
        let mut out = (self.images.len() as u64).to_le_bytes().to_vec();
        for (index, image) in self.images.iter().enumerate() {
            out.extend((index as u32 + 1).to_le_bytes());
            image.q.iter().chain(&image.t).for_each(|value| out.extend(value.to_le_bytes()));
            out.extend(image.camera.to_le_bytes());
            out.extend(image.name.as_bytes());
            out.push(0);
            out.extend((image.observations.len() as u64).to_le_bytes());
            for (x, y, point) in &image.observations {
                out.extend(x.to_le_bytes());
                out.extend(y.to_le_bytes());
                out.extend(point.to_le_bytes());
            }
        }
        out
    }

    pub fn points_bin(&self) -> Vec<u8> {
        let mut out = (self.points.len() as u64).to_le_bytes().to_vec();
        for (index, point) in self.points.iter().enumerate() {
            out.extend((index as u64 + 1).to_le_bytes());
            point.xyz.iter().for_each(|value| out.extend(value.to_le_bytes()));
            out.extend(point.rgb);
            out.extend(point.error.to_le_bytes());
            out.extend((point.track.len() as u64).to_le_bytes());
            for (image, index) in &point.track {
                out.extend(image.to_le_bytes());
                out.extend(index.to_le_bytes());
            }
        }
        out
    }

    pub fn cameras_txt(&self) -> String {
        let mut out = "# Camera list\n".to_owned();
        for camera in &self.cameras {
            let [w, h] = camera.size;
            let _ = write!(out, "{} {} {w} {h}", camera.id, camera.model.1);
            camera.params.iter().for_each(|param| write!(out, " {param:?}").unwrap());
            out.push('\n');
        }
        out
    }

    pub fn images_txt(&self) -> String {
        let mut out = "# Image list\n# two lines an image\n".to_owned();
        for (index, image) in self.images.iter().enumerate() {
            let _ = write!(out, "{}", index + 1);
            image.q.iter().chain(&image.t).for_each(|value| write!(out, " {value:?}").unwrap());
            let _ = writeln!(out, " {} {}", image.camera, image.name);
            for (x, y, point) in &image.observations {
                let _ = write!(out, "{x:?} {y:?} {point} ");
            }
            out.push('\n');
        }
        out
    }

    pub fn points_txt(&self) -> String {
        let mut out = "# Points\n".to_owned();
        for (index, point) in self.points.iter().enumerate() {
            let ([x, y, z], [r, g, b]) = (point.xyz, point.rgb);
            let _ = write!(out, "{} {x:?} {y:?} {z:?} {r} {g} {b} {:?}", index + 1, point.error);
            point.track.iter().for_each(|(i, j)| write!(out, " {i} {j}").unwrap());
            out.push('\n');
        }
        out
    }

    pub fn write_binary(&self, scene: &Path) {
        self.write_binary_to(&scene.join("sparse/0"));
    }

    pub fn write_binary_to(&self, folder: &Path) {
        write_file(&folder.join("cameras.bin"), self.cameras_bin());
        write_file(&folder.join("images.bin"), self.images_bin());
        write_file(&folder.join("points3D.bin"), self.points_bin());
    }

    /// Directly in `sparse/`.
    pub fn write_text(&self, scene: &Path) {
        self.write_text_to(&scene.join("sparse"));
    }

    pub fn write_text_to(&self, folder: &Path) {
        write_file(&folder.join("cameras.txt"), self.cameras_txt());
        write_file(&folder.join("images.txt"), self.images_txt());
        write_file(&folder.join("points3D.txt"), self.points_txt());
    }

    /// A grey photo of its camera's size for every image.
    pub fn write_photos(&self, scene: &Path) {
        for image in &self.images {
            let camera = self.cameras.iter().find(|camera| camera.id == image.camera);
            let [w, h] = camera.map_or([4, 4], |camera| camera.size);
            write_photo(&scene.join("images").join(&image.name), w as u32, h as u32, |_, _| [90, 120, 150, 255]);
        }
    }

    /// Photos and binary model in a new temporary folder.
    pub fn scene(&self) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        self.write_binary(folder.path());
        self.write_photos(folder.path());
        folder
    }
}

/// Writes a file and the folders above it.
pub fn write_file(path: &Path, bytes: impl AsRef<[u8]>) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

/// Writes a PNG or JPEG; `pixel` gets pixel coordinates, centres at +0.5.
pub fn write_photo(path: &Path, w: u32, h: u32, pixel: impl Fn(f64, f64) -> [u8; 4]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let image = RgbaImage::from_fn(w, h, |x, y| Rgba(pixel(f64::from(x) + 0.5, f64::from(y) + 0.5)));
    let jpeg = path.extension().is_some_and(|extension| extension != "png");
    if jpeg {
        image::DynamicImage::from(image).into_rgb8().save(path).unwrap();
    } else {
        image.save(path).unwrap();
    }
}

/// A ZIP archive of files.
pub fn zip_of(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in files {
        let small = bytes.len() < 1 << 20;
        let method = if small { zip::CompressionMethod::Stored } else { zip::CompressionMethod::Deflated };
        writer.start_file(*name, zip::write::SimpleFileOptions::default().compression_method(method)).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// A `.npy` file of doubles in rows of `columns`.
pub fn npy(columns: usize, values: &[f64]) -> Vec<u8> {
    let shape = format!("({}, {columns})", values.len() / columns);
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes()].concat();
    values.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
    bytes
}

/// A ZIP archive of all files of a folder, with a prefix for their names.
pub fn zip_of_folder(folder: &Path, prefix: &str) -> Vec<u8> {
    let mut files = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(inner) = open.pop() {
        for path in fs::read_dir(inner).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                open.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_str().unwrap().replace('\\', "/");
                files.push((format!("{prefix}{name}"), fs::read(path).unwrap()));
            }
        }
    }
    let files: Vec<(&str, &[u8])> = files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    zip_of(&files)
}

/// Copies a scene of `transforms.json` and `points3D.ply` in other units to another place: every length times `scale`, then
/// moved by `shift`.
pub fn copy_scene(from: &Path, to: &Path, scale: f64, shift: DVec3) {
    let mut file: Value = serde_json::from_slice(&fs::read(from.join("transforms.json")).unwrap()).unwrap();
    for frame in file["frames"].as_array_mut().unwrap() {
        let name = frame["file_path"].as_str().unwrap();
        write_file(&to.join(name), fs::read(from.join(name)).unwrap());
        for axis in 0..3 {
            let place = &mut frame["transform_matrix"][axis][3];
            *place = json!(place.as_f64().unwrap() * scale + shift[axis]);
        }
    }
    write_file(&to.join("transforms.json"), file.to_string());
    let points = from.join("points3D.ply");
    let points = parse_points_ply(&points, &fs::read(&points).unwrap()).unwrap();
    let mut ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        points.len()
    )
    .into_bytes();
    for point in points {
        (point.position * scale + shift).to_array().iter().for_each(|v| ply.extend(v.to_le_bytes()));
        ply.extend(point.color);
    }
    write_file(&to.join("points3D.ply"), ply);
}
