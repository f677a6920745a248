//! Gaussians on the host: start from points, and their files.

mod formats;
mod gltf;
mod odd_values;
mod offset;
mod ply_damage;
mod sog_folder;
mod start;

use ibgs_data::local_space::LocalSpace;
use ibgs_data::scene::{Gaussians, PlyFlavor, SceneError, read_ply, write_ply, write_points_ply};
use ibgs_testing::{header_length, random_gaussians, random_points, skipped};
use std::fs;
use std::path::{Path, PathBuf};

/// Writes `bytes` to a file and reads it as Gaussians.
fn read_bytes(bytes: &[u8]) -> Result<Gaussians, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.ply");
    fs::write(&path, bytes).unwrap();
    read_ply(&path)
}

fn ply_bytes(g: &Gaussians, flavor: PlyFlavor) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.ply");
    write_ply(&path, g, flavor).unwrap();
    fs::read(path).unwrap()
}

#[test]
fn ply_round_trip_of_every_degree() {
    for degree in 0..=3 {
        for n in [0, 1, 57] {
            let g = random_gaussians(n, degree, u64::from(degree));
            let full = ply_bytes(&g, PlyFlavor::Full);
            assert_eq!(read_bytes(&full).unwrap(), g, "degree {degree}, {n}");
            let plain = ply_bytes(&g, PlyFlavor::Plain);
            let without_offsets = Gaussians { offsets: vec![0.0; n], ..g };
            assert_eq!(read_bytes(&plain).unwrap(), without_offsets);
        }
    }
}

#[test]
fn ply_header_is_the_one_that_viewers_know() {
    let g = random_gaussians(2, 1, 0);
    let full = ply_bytes(&g, PlyFlavor::Full);
    let header = String::from_utf8(full[..header_length(&full)].to_vec()).unwrap();
    let mut lines = header.lines();
    assert_eq!(lines.next(), Some("ply"));
    assert_eq!(lines.next(), Some("format binary_little_endian 1.0"));
    assert_eq!(lines.next(), Some("element vertex 2"));
    let names: Vec<_> = lines.filter_map(|line| line.strip_prefix("property float ")).collect();
    let expected = "x y z nx ny nz nd f_dc_0 f_dc_1 f_dc_2 f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 \
        f_rest_6 f_rest_7 f_rest_8 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    assert_eq!(names, expected.split_whitespace().collect::<Vec<_>>());
    // f_rest is channel-major: f_rest_1 is coefficient 2 of the first channel, f_rest_3 coefficient 1 of the second.
    let field = |i: usize| {
        let at = header_length(&full) + 4 * i;
        f32::from_le_bytes(full[at..at + 4].try_into().unwrap())
    };
    assert_eq!((field(7), field(11), field(13)), (g.sh[0], g.sh[6], g.sh[4]));
    let plain = ply_bytes(&g, PlyFlavor::Plain);
    assert!(!String::from_utf8_lossy(&plain[..header_length(&plain)]).contains("nd\n"));
}

/// A text PLY with one Gaussian of degree 0: fields in odd order and of odd types, an unknown one, another element before.
const TEXT_PLY: &str = "ply\nformat ascii 1.0\ncomment by hand\nelement camera 2\nproperty list uchar float values\n\
    element vertex 1\nproperty double rot_3\nproperty float32 rot_2\nproperty float rot_1\nproperty int rot_0\n\
    property float opacity\nproperty float unknown\nproperty uchar x\nproperty short y\nproperty double z\n\
    property float scale_0\nproperty float scale_1\nproperty float scale_2\nproperty float f_dc_0\n\
    property float f_dc_1\nproperty float f_dc_2\nend_header\n2 1.5 2.5\n0\n4 3 2 -1 -0.5 nan 200 -300 1e-3 1 2 3 0.1 0.2 0.3";

#[test]
fn text_and_odd_orders_and_types_load() {
    for text in [TEXT_PLY.to_owned(), TEXT_PLY.replace('\n', "\r\n") + "\r\n\r\n"] {
        let g = read_bytes(text.as_bytes()).unwrap();
        assert_eq!(g.means, [[200.0, -300.0, 1e-3]]);
        assert_eq!(g.rotations, [[-1.0, 2.0, 3.0, 4.0]]);
        assert_eq!((g.sh_degree, &g.sh[..]), (0, &[0.1, 0.2, 0.3][..]));
        assert_eq!((g.normals[0], g.offsets[0]), ([0.0, 0.0, 1.0], 0.0));
    }
    // The same as big-endian binary.
    let header = TEXT_PLY.split("end_header").next().unwrap().replace("ascii", "binary_big_endian");
    let mut bytes = (header + "end_header\n").into_bytes();
    bytes.push(2);
    [1.5_f32, 2.5].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
    bytes.push(0);
    bytes.extend(4.0_f64.to_be_bytes());
    [3.0_f32, 2.0].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
    bytes.extend((-1_i32).to_be_bytes());
    [-0.5_f32, f32::NAN].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
    bytes.push(200);
    bytes.extend((-300_i16).to_be_bytes());
    bytes.extend(1e-3_f64.to_be_bytes());
    [1.0_f32, 2.0, 3.0, 0.1, 0.2, 0.3].iter().for_each(|v| bytes.extend(v.to_be_bytes()));
    assert_eq!(read_bytes(&bytes).unwrap(), read_bytes(TEXT_PLY.as_bytes()).unwrap());
}

#[test]
fn invalid_models_are_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.ply");
    let good = random_gaussians(2, 1, 6);
    let mut nan = good.clone();
    nan.sh[13] = f32::NAN;
    let mut short = good.clone();
    short.offsets.pop();
    let mut degree = good;
    degree.sh_degree = 4;
    for (g, expected) in [(nan, "`sh` of Gaussian 1"), (short, "`offsets`"), (degree, "degree 4")] {
        let text = write_ply(&path, &g, PlyFlavor::Full).unwrap_err().to_string();
        assert!(text.contains(expected), "{text}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn model_of_another_program_loads() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/published.ply");
    let g = read_ply(&path).unwrap();
    assert_eq!((g.len(), g.sh_degree), (5, 2));
    g.validate().unwrap();
    for i in 0..5 {
        // The file counts up in steps of 1/64.
        let row: [f32; 42] = std::array::from_fn(|column| (42 * i + column) as f32 / 64.0 - 1.5);
        assert_eq!(g.means[i], row[..3]);
        assert_eq!((&g.normals[i][..], g.offsets[i]), (&row[3..6], row[6]));
        let sh = &g.sh[27 * i..][..27];
        assert_eq!(sh[..3], row[7..10]);
        // All higher coefficients of red, then of green, then of blue.
        for (k, c) in (0..8).flat_map(|k| (0..3).map(move |c| (k, c))) {
            assert_eq!(sh[3 * (k + 1) + c], row[10 + 8 * c + k], "coefficient {} of channel {c}", k + 1);
        }
        assert_eq!(g.opacity_logits[i], row[34]);
        assert_eq!(g.log_scales[i], row[35..38]);
        assert_eq!(g.rotations[i], row[38..]);
    }
    // Same layout, so writing gives the rows back byte for byte.
    let (theirs, ours) = (fs::read(&path).unwrap(), ply_bytes(&g, PlyFlavor::Full));
    assert!(theirs[header_length(&theirs)..] == ours[header_length(&ours)..]);
}

/// Unmounts when dropped.
struct SmallDisk(PathBuf);

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = std::process::Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn full_disk_is_said_and_leaves_no_partial_file() {
    let folder = tempfile::tempdir().unwrap();
    let mounted = cfg!(target_os = "linux")
        && std::process::Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=256k", "tmpfs"])
            .arg(folder.path())
            .stderr(std::process::Stdio::null())
            .status()
            .is_ok_and(|status| status.success());
    if !mounted {
        let why = "mounting a small disk needs root; the simulated one is tested beside the writer";
        skipped("scene::full_disk_is_said_and_leaves_no_partial_file", why);
        return;
    }
    let disk = SmallDisk(folder.path().to_owned());
    let path = disk.0.join("model.ply");
    let small = random_gaussians(10, 0, 7);
    write_ply(&path, &small, PlyFlavor::Full).unwrap();
    let error = write_ply(&path, &random_gaussians(20_000, 2, 8), PlyFlavor::Full).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("model.ply") && text.contains("free some disk space"), "{text}");
    assert_eq!(read_ply(&path).unwrap(), small, "the older model must survive");
    assert_eq!(fs::read_dir(&disk.0).unwrap().count(), 1);
}

#[test]
fn points_of_the_start_are_written_as_others_write_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("input.ply");
    let points = random_points(3, 14);
    write_points_ply(&path, &points, LocalSpace::default()).unwrap();
    let bytes = fs::read(&path).unwrap();
    let last = &bytes[bytes.len() - 27..];
    assert_eq!(last[..4], (points[2].position.x as f32).to_le_bytes());
    assert_eq!(last[24..], points[2].color);
    // It is no model of Gaussians, and the error says what it may be.
    assert!(read_ply(&path).unwrap_err().to_string().contains("plain point cloud"));
}
