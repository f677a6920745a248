//! Readers of the golden data: the true derivatives of small scenes (`fixtures`), and a dump of the published
//! implementation (`../shared/golden`). The dump is not in the repository: where it is absent its reader gives None.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use ibgs_data::camera::Camera;
use npyz::{DType, NpyHeader};
use zip::ZipArchive;

use super::Params;
use ibgs_testing::shared;

/// A numpy array, every type widened to f64, last index fastest.
#[derive(Clone, Debug)]
pub struct Array {
    pub shape: Vec<usize>,
    pub data: Vec<f64>,
}

impl Array {
    /// The data in groups of N, for a last dimension of N.
    pub fn rows<const N: usize>(&self) -> Vec<[f64; N]> {
        assert_eq!(self.shape.last(), Some(&N), "last dimension");
        self.data.as_chunks().0.to_vec()
    }

    /// Image `index` of an array ... x 3 x H x W (channel-first) as H x W x 3.
    pub fn image(&self, index: usize) -> Vec<[f64; 3]> {
        let [.., 3, height, width] = self.shape[..] else {
            panic!("not a channel-first image: shape {:?}", self.shape);
        };
        let pixels = height * width;
        let planes = &self.data[index * 3 * pixels..];
        (0..pixels).map(|i| std::array::from_fn(|c| planes[c * pixels + i])).collect()
    }
}

/// The arrays of one npz file by name.
#[derive(Clone, Debug)]
pub struct Npz(BTreeMap<String, Array>);

impl Npz {
    /// The array `name`; panics where there is none.
    pub fn get(&self, name: &str) -> &Array {
        self.0.get(name).unwrap_or_else(|| panic!("no array {name}; there are {:?}", self.0.keys()))
    }

    fn read(path: &Path) -> Npz {
        let file = fs::File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let mut archive = ZipArchive::new(file).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let arrays = (0..archive.len()).map(|index| {
            let mut file = archive.by_index(index).expect("array is in the archive");
            let name = file.name().expect("name is text").trim_end_matches(".npy").to_owned();
            let header = NpyHeader::from_reader(&mut file).expect("npy header");
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes).expect("array data");
            let shape = header.shape().iter().map(|n| *n as usize).collect();
            (name, Array { shape, data: widen(&header.dtype(), &bytes) })
        });
        Npz(arrays.collect())
    }
}

fn widen(dtype: &DType, bytes: &[u8]) -> Vec<f64> {
    fn each<const N: usize>(bytes: &[u8], read: impl Fn([u8; N]) -> f64) -> Vec<f64> {
        bytes.as_chunks().0.iter().map(|b| read(*b)).collect()
    }
    let DType::Plain(kind) = dtype else {
        panic!("structured array: {}", dtype.descr());
    };
    match kind.to_string().as_str() {
        "<f8" => each(bytes, f64::from_le_bytes),
        "<f4" => each(bytes, |b| f64::from(f32::from_le_bytes(b))),
        "<f2" => each(bytes, |b| half(u16::from_le_bytes(b))),
        "<i8" => each(bytes, |b| i64::from_le_bytes(b) as f64),
        "<i4" => each(bytes, |b| f64::from(i32::from_le_bytes(b))),
        "|u1" => each(bytes, |[b]| f64::from(b)),
        other => panic!("array type {other} is not read"),
    }
}

/// Value of an IEEE half.
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let fraction = f64::from(bits & 0x3ff) / 1024.0;
    let magnitude = match bits >> 10 & 0x1f {
        0 => fraction * 2f64.powi(-14),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        exponent => (1.0 + fraction) * 2f64.powi(i32::from(exponent) - 15),
    };
    sign * magnitude
}

fn camera(rotation: &[f64], translation: &[f64], intrinsics: &[f64]) -> Camera {
    let [fx, fy, cx, cy, width, height] = intrinsics[..] else {
        panic!("six intrinsics, not {intrinsics:?}");
    };
    Camera {
        width: width as u32,
        height: height as u32,
        focal: DVec2::new(fx, fy),
        principal: DVec2::new(cx, cy),
        view_from_world: DMat3::from_cols_slice(rotation).transpose(),
        translation: DVec3::from_slice(translation),
    }
}

/// The true derivatives of a small scene.
pub struct GoldenGradients {
    pub params: Params,
    pub normals: Vec<[f64; 3]>,
    pub offsets: Vec<f64>,
    /// The target camera, then the sources.
    pub cameras: Vec<Camera>,
    /// Number of median intersections.
    pub k: usize,
    pub out_base: Vec<[f64; 3]>,
    pub cotangent_base: Vec<[f64; 3]>,
    /// Everything in the file by its name there.
    pub arrays: Npz,
}

impl GoldenGradients {
    /// Gradient of the loss on one output (`base`, `normal`, `depth`, `warped`, `cosine`, `all`) by one parameter.
    pub fn grad(&self, group: &str, name: &str) -> &[f64] {
        &self.arrays.get(&format!("grad/{group}/{name}")).data
    }
}

/// Reads `gradients_k2_m2.npz`, `gradients_k4_m3.npz` or `gradients_k6_m4.npz`.
pub fn load_gradients(file: &str) -> GoldenGradients {
    let arrays = Npz::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(file));
    let param = |name: &str| arrays.get(&format!("param/{name}"));
    let coefficients = param("sh").shape[1];
    let params = Params {
        means: param("mean").rows(),
        rotations: param("rotation").rows(),
        log_scales: param("log_scale").rows(),
        opacity_logits: param("opacity_logit").data.clone(),
        sh: param("sh").data.clone(),
        sh_degree: coefficients.isqrt() - 1,
    };
    let cameras = (0..)
        .take_while(|i| arrays.0.contains_key(&format!("camera/{i}/R")))
        .map(|i| {
            let part = |name: &str| arrays.get(&format!("camera/{i}/{name}")).data.as_slice();
            camera(part("R"), part("t"), part("fx_fy_cx_cy_w_h"))
        })
        .collect();
    GoldenGradients {
        normals: param("normal").rows(),
        offsets: param("offset").data.clone(),
        params,
        cameras,
        k: arrays.get("K").data[0] as usize,
        out_base: arrays.get("out/base").rows(),
        cotangent_base: arrays.get("cotangent/base").rows(),
        arrays,
    }
}

/// The dump of the published implementation at one test view.
pub struct Golden {
    pub camera: Camera,
    pub source_cameras: Vec<Camera>,
    /// H x W x 3, not clamped.
    pub base: Vec<[f64; 3]>,
    /// Everything in the file by its name there.
    pub arrays: Npz,
}

/// Reads `golden.npz` for the test of this name.
pub fn load_golden(test: &str) -> Option<Golden> {
    let arrays = Npz::read(&shared("golden/golden.npz", test)?);
    let intrinsics = &arrays.get("intrinsics").data;
    let pose = |m: &[f64]| {
        let rotation = [&m[0..3], &m[4..7], &m[8..11]].concat();
        camera(&rotation, &[m[3], m[7], m[11]], intrinsics)
    };
    let sources = &arrays.get("source_world_to_camera").data;
    Some(Golden {
        camera: pose(&arrays.get("world_to_camera").data),
        source_cameras: sources.chunks_exact(16).map(pose).collect(),
        base: arrays.get("base").image(0),
        arrays,
    })
}

/// The trained Gaussians of the dump.
pub struct GoldenCloud {
    pub params: Params,
    pub normals: Vec<[f64; 3]>,
    pub offsets: Vec<f64>,
}

/// Reads `golden.npz` and `point_cloud.ply` for the test of this name.
pub fn load_dump(test: &str) -> Option<(Golden, GoldenCloud)> {
    Some((load_golden(test)?, load_golden_cloud(test)?))
}

/// Reads `point_cloud.ply`: binary little-endian, float properties only.
fn load_golden_cloud(test: &str) -> Option<GoldenCloud> {
    let bytes = fs::read(shared("golden/point_cloud.ply", test)?).expect("PLY is readable");
    const END: &[u8] = b"end_header\n";
    let end = bytes.windows(END.len()).position(|w| w == END).expect("PLY header ends");
    let header = std::str::from_utf8(&bytes[..end]).expect("PLY header is text");
    let names: Vec<&str> = header.lines().filter_map(|l| l.strip_prefix("property float ")).collect();
    let values: Vec<f64> =
        bytes[end + END.len()..].as_chunks().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect();
    let column = |name: &str| names.iter().position(|n| *n == name).unwrap_or_else(|| panic!("no {name}"));
    let columns = |names: &[&str]| names.iter().map(|n| column(n)).collect::<Vec<_>>();
    let rest = names.iter().filter(|n| n.starts_with("f_rest_")).count() / 3;
    // The file stores all higher coefficients of red, then of green, then of blue.
    let sh: Vec<usize> = (0..3)
        .map(|c| column(&format!("f_dc_{c}")))
        .chain((0..rest).flat_map(|k| (0..3).map(move |c| c * rest + k)).map(|i| column(&format!("f_rest_{i}"))))
        .collect();
    let read = |columns: &[usize]| -> Vec<f64> {
        values.chunks_exact(names.len()).flat_map(|row| columns.iter().map(|c| row[*c])).collect()
    };
    let read3 = |names: &[&str]| read(&columns(names)).as_chunks().0.to_vec();
    let params = Params {
        means: read3(&["x", "y", "z"]),
        rotations: read(&columns(&["rot_0", "rot_1", "rot_2", "rot_3"])).as_chunks().0.to_vec(),
        log_scales: read3(&["scale_0", "scale_1", "scale_2"]),
        opacity_logits: read(&columns(&["opacity"])),
        sh: read(&sh),
        sh_degree: (rest + 1).isqrt() - 1,
    };
    let (normals, offsets) = (read3(&["nx", "ny", "nz"]), read(&columns(&["nd"])));
    Some(GoldenCloud { params, normals, offsets })
}
