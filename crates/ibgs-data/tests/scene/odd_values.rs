//! Values of other programs that look like damage and are none, and damage that looks like values.

use super::formats::complaint;
use super::{ply_bytes, random_gaussians, read_bytes};
use glam::DVec3;
use ibgs_data::local_space::LocalSpace;
use ibgs_data::scene::{Format, Gaussians, Loss, PlyFlavor, SH_C0, read_gaussians, write_gaussians};
use ibgs_testing::{bytes_of, header_length, read};

/// Columns of a PLY of degree 0 with all fields.
const OPACITY: usize = 10;
const SCALE: usize = 11;
const ROTATION: usize = 14;
const COLUMNS: usize = 18;

/// The bytes of a PLY of degree 0 with other values at (row, column).
fn spoiled(g: &Gaussians, values: &[(usize, usize, f32)]) -> Vec<u8> {
    let mut bytes = ply_bytes(g, PlyFlavor::Full);
    let start = header_length(&bytes);
    for (row, column, value) in values {
        let at = start + 4 * (COLUMNS * row + column);
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }
    bytes
}

fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}

#[test]
fn infinite_logits_and_logarithms_of_zero_are_read() {
    let g = random_gaussians(4, 0, 11);
    let all =
        |column: usize, value: f32| -> Vec<(usize, usize, f32)> { (0..4).map(|row| (row, column, value)).collect() };
    let read = |values: &[(usize, usize, f32)]| {
        let read = read_bytes(&spoiled(&g, values)).unwrap();
        read.validate().unwrap();
        read
    };
    let opaque = read(&all(OPACITY, f32::INFINITY));
    assert_eq!(opaque.opacity_logits.iter().map(|&v| sigmoid(v)).collect::<Vec<_>>(), [1.0; 4]);
    let transparent = read(&all(OPACITY, f32::NEG_INFINITY));
    assert!(transparent.len() == 4 && transparent.opacity_logits.iter().all(|&v| sigmoid(v) < 1e-7));
    let flat = read(&all(SCALE + 2, f32::NEG_INFINITY));
    for (found, whole) in flat.log_scales.iter().zip(&g.log_scales) {
        assert_eq!((found[0], found[1]), (whole[0], whole[1]));
        assert!(found[2].is_finite() && found[2] < -80.0, "{found:?}");
    }
    // NaN, and a scale without end, are damage.
    for (column, value) in [(OPACITY, f32::NAN), (SCALE, f32::NAN), (SCALE + 1, f32::INFINITY)] {
        assert_eq!(read(&[(1, column, value)]).len(), 3);
        assert!(read_bytes(&spoiled(&g, &all(column, value))).is_err());
    }
    // Every format keeps what was made of them.
    let mixed = read(&[(0, OPACITY, f32::INFINITY), (1, OPACITY, f32::NEG_INFINITY), (2, SCALE, f32::NEG_INFINITY)]);
    for format in Format::written() {
        let name = format!("a{}", format.ending());
        let back = self::read(&bytes_of(&mixed, format), &name).unwrap();
        back.validate().unwrap();
        assert_eq!(back.len(), 4, "{format:?}");
        assert!(back.opacity_logits.iter().any(|&v| sigmoid(v) > 0.99), "{format:?}");
    }
}

/// One flat Gaussian does not coarsen the scales of the others in its chunk.
#[test]
fn flat_gaussians_in_a_compressed_ply() {
    let mut g = random_gaussians(200, 0, 17);
    let whole = read(&bytes_of(&g, Format::CompressedPly), "a.ply").unwrap();
    g.log_scales[0] = read_bytes(&spoiled(&g, &[(0, SCALE, f32::NEG_INFINITY)])).unwrap().log_scales[0];
    let flat = read(&bytes_of(&g, Format::CompressedPly), "a.ply").unwrap();
    let sorted = |g: &Gaussians| {
        let mut scales: Vec<f32> = g.log_scales.iter().map(|scales| scales[0]).collect();
        scales.sort_by(f32::total_cmp);
        scales
    };
    let off = sorted(&flat)[1..].iter().zip(&sorted(&g)[1..]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    // Half a step of 2047 over a range of 20.
    assert!(off <= 0.006 && sorted(&flat)[0] < -15.0, "{off}, {}", sorted(&flat)[0]);
    assert_eq!(whole.len(), flat.len());
}

/// A chunk whose scales reach from the logarithm of 0.
#[test]
fn bounds_of_minus_infinity_in_a_compressed_ply() {
    let g = random_gaussians(300, 0, 12);
    let mut ply = bytes_of(&g, Format::CompressedPly);
    let header = header_length(&ply);
    // Least and largest scale along x, of the first of two chunks.
    for field in [6, 9] {
        let at = header + 4 * field;
        ply[at..at + 4].copy_from_slice(&f32::NEG_INFINITY.to_le_bytes());
    }
    let read = read(&ply, "a.ply").unwrap();
    read.validate().unwrap();
    assert_eq!(read.len(), 300);
    assert_eq!(read.log_scales.iter().filter(|scales| scales[0] < -80.0).count(), 256);
}

#[test]
fn gaussians_without_a_rotation_are_left_out() {
    let g = random_gaussians(3, 0, 13);
    let zeros = |row: usize| [0, 1, 2, 3].map(|k| (row, ROTATION + k, 0.0));
    let read_ply = read_bytes(&spoiled(&g, &zeros(1))).unwrap();
    assert_eq!(read_ply.means, [g.means[0], g.means[2]]);
    // Squares that float32 cannot hold are no rotation on a device either.
    let tiny = [0, 1, 2, 3].map(|k| (2, ROTATION + k, 1e-30));
    assert_eq!(read_bytes(&spoiled(&g, &tiny)).unwrap().len(), 2);
    let text = read_bytes(&spoiled(&g, &[zeros(0), zeros(1), zeros(2)].concat())).unwrap_err().to_string();
    assert!(text.contains("model.ply") && text.contains("all 3 Gaussians") && text.contains("`rot_0`"), "{text}");
    let mut splat = bytes_of(&g, Format::Splat);
    splat[32 + 28..64].fill(128);
    assert_eq!(read(&splat, "a.splat").unwrap().len(), 2);
    let mut glb = bytes_of(&g, Format::Gltf);
    let binary = glb.len() - 4 * 3 * (3 + 4 + 3 + 1 + 3);
    glb[binary + 4 * 3 * 3..][..16].fill(0);
    assert_eq!(read(&glb, "a.glb").unwrap().len(), 2);
}

/// A text PLY of one Gaussian with a colour in place of coefficients.
fn colored(kind: &str, names: [&str; 3], rows: &[&str]) -> String {
    let fields = "x y z opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let fields: String = fields.split(' ').map(|field| format!("property float {field}\n")).collect();
    let colors: String = names.map(|name| format!("property {kind} {name}\n")).concat();
    let rows: String = rows.iter().map(|color| format!("1 2 3 0.5 -3 -3 -3 1 0 0 0 {color}\n")).collect();
    let count = rows.lines().count();
    format!("ply\nformat ascii 1.0\nelement vertex {count}\n{fields}{colors}end_header\n{rows}")
}

#[test]
fn colours_stand_for_the_constant_coefficients() {
    let rgb = ["red", "green", "blue"];
    let diffuse = ["diffuse_red", "diffuse_green", "diffuse_blue"];
    let cases = [
        ("uchar", rgb, ["255 0 51", "1 1 1"], [1.0, 0.0, 0.2]),
        ("uchar", diffuse, ["255 0 51", "0 0 0"], [1.0, 0.0, 0.2]),
        ("ushort", rgb, ["65535 0 13107", "0 0 0"], [1.0, 0.0, 0.2]),
        ("float", rgb, ["1 0 0.2", "0 0 0"], [1.0, 0.0, 0.2]),
        ("double", rgb, ["1 0 0.2", "1.1 0 0"], [1.0, 0.0, 0.2]),
        ("float", rgb, ["255 0 51", "0 0 0"], [1.0, 0.0, 0.2]),
        // One white Gaussian says what white is.
        ("float", rgb, ["1 0 0.5", "255 255 255"], [1.0 / 255.0, 0.0, 0.5 / 255.0]),
    ];
    for (kind, names, rows, expected) in cases {
        let g = read_bytes(colored(kind, names, &rows).as_bytes()).unwrap();
        assert_eq!((g.len(), g.sh_degree), (2, 0));
        for (found, expected) in g.sh.iter().zip(expected) {
            let color = 0.5 + SH_C0 * f64::from(*found);
            assert!((color - expected).abs() < 1e-6, "{kind} {rows:?}: {color} for {expected}");
        }
    }
    // Coefficients count before colours; neither is an error.
    let both = colored("float", rgb, &["9 9 9"])
        .replace(
            "property float rot_3",
            "property float rot_3\nproperty float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2",
        )
        .replace("1 0 0 0 9 9 9", "1 0 0 0 0.1 0.2 0.3 9 9 9");
    assert_eq!(read_bytes(both.as_bytes()).unwrap().sh, [0.1, 0.2, 0.3]);
    let text = read_bytes(colored("float", ["a", "b", "c"], &["1 2 3"]).as_bytes()).unwrap_err().to_string();
    assert!(text.contains("`f_dc_0`"), "{text}");
}

/// A glTF file with another text of the same length in its description, spaces added.
fn changed(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
    let mut changed = bytes.to_vec();
    changed[at..at + from.len()].copy_from_slice(format!("{to:<width$}", width = from.len()).as_bytes());
    changed
}

#[test]
fn linear_colours_are_converted_and_unknown_ones_refused() {
    let g = Gaussians { sh: vec![((0.2 - 0.5) / SH_C0) as f32; 6], ..random_gaussians(2, 0, 14) };
    let glb = bytes_of(&g, Format::Gltf);
    let space = "\"srgb_rec709_display\"";
    let color = |bytes: &[u8]| 0.5 + SH_C0 * f64::from(read(bytes, "a.glb").unwrap().sh[0]);
    assert!((color(&glb) - 0.2).abs() < 1e-6);
    // 0.2 of the light of white is shown by 0.4845 of the code of white.
    let linear = color(&changed(&glb, space, "\"lin_rec709_display\""));
    assert!((linear - 0.484_529).abs() < 1e-5, "{linear}");
    let text = complaint(&changed(&glb, space, "\"lin_rec2020\""), "a.glb");
    assert!(text.contains("lin_rec2020") && text.contains("srgb_rec709_display"), "{text}");
    // Files of before the property.
    assert!((color(&changed(&glb, "\"colorSpace\"", "\"other\"")) - 0.2).abs() < 1e-6);
}

#[test]
fn offsets_that_floats_hold_are_applied() {
    let folder = tempfile::tempdir().unwrap();
    let mut g = random_gaussians(60, 1, 15);
    (g.normals, g.offsets) = (vec![[0.0, 0.0, 1.0]; 60], vec![0.0; 60]);
    // Formats change the order.
    let apart = |a: &Gaussians, b: &Gaussians| {
        let nearest = |place: DVec3| b.positions().map(|other| other.distance(place)).fold(f64::INFINITY, f64::min);
        a.positions().map(nearest).fold(0.0, f64::max)
    };
    for (origin, is_far) in [(DVec3::new(2.0, 12.0, -7.0), false), (DVec3::new(5e6, -4e6, 30.5), true)] {
        g.space = LocalSpace::at(origin);
        assert_eq!(g.file_offset(), is_far.then_some(origin));
        for format in Format::written() {
            let path = folder.path().join(format!("a{}", format.ending()));
            write_gaussians(&path, &g, format).unwrap();
            let back = read_gaussians(&path).unwrap();
            let says: Vec<String> = format.losses(&g).iter().map(ToString::to_string).collect();
            let offset = format!("{} {} {}", origin.x, origin.y, origin.z);
            assert_eq!(says.iter().any(|text| text.contains(&offset)), is_far, "{format:?}: {says:?}");
            let keeps = format.losses(&g).iter().any(|loss| matches!(loss, Loss::SplitOff { .. }));
            if !is_far {
                assert_eq!(back.space, LocalSpace::default(), "{format:?}");
                assert!(apart(&g, &back) < 0.05, "{format:?}: {}", apart(&g, &back));
            } else if keeps {
                assert_eq!(back.space.origin, origin, "{format:?}");
            }
        }
    }
    // A lone Gaussian is measured by its own size.
    let mut one = random_gaussians(1, 0, 16);
    one.space = LocalSpace::at(DVec3::new(3.0, 0.0, 0.0));
    assert_eq!(one.file_offset(), None);
    one.log_scales[0] = [-20.0; 3];
    assert_eq!(one.file_offset(), Some(one.space.origin));
}
