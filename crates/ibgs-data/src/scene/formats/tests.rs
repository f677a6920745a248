//! Every format there and back: the largest error is half a step of what it keeps.

use super::axes::{LUF, RUB, turn, turned};
use super::*;
use crate::scene::formats::order::morton;
use crate::scene::formats::palette::{Codebook, Palette};
use crate::scene::gaussians::coefficients;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::io::Cursor;

/// Bound of an error of float32 arithmetic: some roundings of values of this size.
fn rounding(size: f64) -> f64 {
    8.0 * f64::from(f32::EPSILON) * size
}

/// Gaussians within what every format can hold: opacities that a byte distinguishes from 0 and 1, coefficients within
/// -0.9 to 0.9.
fn random(n: usize, sh_degree: u32, seed: u64) -> Gaussians {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut within = |low: f32, high: f32| rng.random_range(low..high);
    let mut g = Gaussians::with_capacity(n, sh_degree);
    for _ in 0..n {
        g.means.push([within(-3.0, 5.0), within(-8.0, 1.0), within(0.0, 40.0)]);
        g.rotations.push([0; 4].map(|_| within(-2.0, 2.0)));
        g.log_scales.push([0; 3].map(|_| within(-7.0, 1.0)));
        g.opacity_logits.push(within(-5.0, 5.0));
        g.sh.extend((0..3 * coefficients(sh_degree)).map(|_| within(-0.9, 0.9)));
        g.normals.push([0.0, 0.0, 1.0]);
        g.offsets.push(0.0);
    }
    g
}

fn round_trip(g: &Gaussians, format: Format) -> Gaussians {
    let folder = tempfile::tempdir().unwrap();
    // Contents say what it is, but for `.splat`.
    let path = folder.path().join(if format == Format::Splat { "a.splat" } else { "a.bin" });
    write_gaussians(&path, g, format).unwrap();
    let back = read_gaussians(&path).unwrap();
    back.validate().unwrap();
    assert_eq!(back.len(), g.len());
    assert!(back.normals.iter().all(|&normal| normal == [0.0, 0.0, 1.0]), "what has no plane says so");
    back
}

/// Largest errors of a round trip.
#[derive(Debug, Default)]
struct Errors {
    mean: f64,
    log_scale: f64,
    opacity: f64,
    /// Of a component of the unit quaternion.
    rotation: f64,
    /// Of the colour of degree 0.
    color: f64,
    /// Of the coefficients of degree 1, and of those above.
    harmonics: [f64; 2],
}

fn worst(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, f64::max)
}

/// Errors of `back`, whose Gaussians are those of `g` in the order `order`.
fn errors(g: &Gaussians, back: &Gaussians, order: &[usize]) -> Errors {
    let mut e = Errors::default();
    let [row, kept] = [g, back].map(|g| 3 * g.sh_coefficients());
    for (at, &index) in order.iter().enumerate() {
        let pairs = |a: &[f32], b: &[f32]| worst(a.iter().zip(b).map(|(a, b)| f64::from(a - b).abs()));
        e.mean = e.mean.max(pairs(&g.means[index], &back.means[at]));
        e.log_scale = e.log_scale.max(pairs(&g.log_scales[index], &back.log_scales[at]));
        let opacity = |logit: f32| quantise::opacity(logit);
        e.opacity = e.opacity.max((opacity(g.opacity_logits[index]) - opacity(back.opacity_logits[at])).abs());
        let (a, b) = (quantise::unit_quaternion(g.rotations[index]), quantise::unit_quaternion(back.rotations[at]));
        let difference = |sign: f64| worst(a.iter().zip(&b).map(|(a, b)| (a - sign * b).abs()));
        e.rotation = e.rotation.max(difference(1.0).min(difference(-1.0)));
        let (a, b) = (&g.sh[row * index..row * (index + 1)], &back.sh[kept * at..kept * (at + 1)]);
        e.color = e.color.max(crate::scene::SH_C0 * pairs(&a[..3], &b[..3]));
        if kept > 3 {
            e.harmonics[0] = e.harmonics[0].max(pairs(&a[3..12], &b[3..12]));
            e.harmonics[1] = e.harmonics[1].max(pairs(&a[12..], &b[12..]));
        }
    }
    e
}

/// Where a file keeps the order, errors are taken one by one.
fn in_order(g: &Gaussians, format: Format) -> Errors {
    let order: Vec<usize> = (0..g.len()).collect();
    errors(g, &round_trip(g, format), &order)
}

/// Half a byte's step of 0 to 1, with what rounding the logit to a float adds: its error times the slope of 1/4, at most.
const OPACITY: f64 = 0.5 / 255.0 + 1e-6;

/// The error of the largest component follows from those of the others: at least 1/2 itself, it has at most the sum of their
/// values times their errors over itself, sqrt(3/4) sqrt(3) / (1/2) = 3 times theirs.
const LARGEST: f64 = 3.0;

#[test]
fn spz_errors_are_half_a_step() {
    for degree in 0..=3 {
        let g = random(700, degree, u64::from(degree));
        let e = in_order(&g, Format::Spz);
        // 40 in 23 bits leaves 17 behind the point.
        assert!(e.mean <= 0.5 / f64::from(1 << 17) + rounding(40.0), "{e:?}");
        assert!(e.mean >= 0.4 / f64::from(1 << 17), "more bits than it has: {e:?}");
        assert!(e.log_scale <= 0.5 / 16.0 + rounding(10.0), "{e:?}");
        assert!(e.opacity <= OPACITY, "{e:?}");
        // 511 steps up to 1 / sqrt(2).
        assert!(e.rotation <= LARGEST * 0.5 / 511.0 * std::f64::consts::FRAC_1_SQRT_2, "{e:?}");
        assert!(e.color <= 0.5 / 255.0 / 0.15 * crate::scene::SH_C0 + rounding(4.0), "{e:?}");
        // 32 and 16 steps over -1 to 1.
        assert!(e.harmonics[0] <= 0.5 / 16.0 + rounding(1.0) && e.harmonics[1] <= 0.5 / 8.0 + rounding(1.0), "{e:?}");
    }
}

#[test]
fn splat_errors_are_half_a_step() {
    let g = random(700, 2, 4);
    let back = round_trip(&g, Format::Splat);
    assert_eq!(back.sh_degree, 0);
    // Positions are kept to the bit, and no two are alike.
    let index_of = |mean: &[f32; 3]| g.means.iter().position(|other| other == mean).unwrap();
    let order: Vec<usize> = back.means.iter().map(index_of).collect();
    let e = errors(&g, &back, &order);
    assert_eq!(e.mean, 0.0);
    assert!(e.log_scale <= rounding(8.0) && e.opacity <= OPACITY, "{e:?}");
    // A component near 1 is cut at 127/128, a whole step; the length of 1 is restored by up to sqrt(4) times that.
    assert!(e.rotation <= 2.0 / 128.0, "{e:?}");
    assert!(e.color <= 0.5 / 255.0 + rounding(1.0), "{e:?}");
    let weight = |at: usize| -> f64 {
        let size: f32 = back.log_scales[at].iter().sum();
        f64::from(size).exp() * quantise::opacity(back.opacity_logits[at])
    };
    // Opacities moved by half a step of at least 1/150.
    assert!((1..back.len()).all(|at| weight(at) <= weight(at - 1) * 1.7), "the largest come first");
    assert_eq!(Format::Splat.losses(&g), [Loss::Harmonics { degree: 2, kept: 0 }]);
}

#[test]
fn compressed_ply_errors_are_half_a_step_of_the_chunk() {
    for degree in 0..=3 {
        let g = random(700, degree, 10 + u64::from(degree));
        let e = errors(&g, &round_trip(&g, Format::CompressedPly), &morton(&g));
        // A chunk is no larger than the whole: 40 along the axis of 11 bits, 9 along that of 10.
        assert!(e.mean <= (0.5_f64 * 40.0 / 2047.0).max(0.5 * 9.0 / 1023.0) + rounding(40.0), "{e:?}");
        assert!(e.log_scale <= 0.5 * 8.0 / 1023.0 + rounding(8.0) && e.opacity <= OPACITY, "{e:?}");
        assert!(e.rotation <= LARGEST * 0.5 / 1023.0 * std::f64::consts::SQRT_2, "{e:?}");
        // Colours of this scene have a range of 1.8 times the constant.
        assert!(e.color <= 0.5 / 255.0 * 1.8 * crate::scene::SH_C0 + rounding(1.0), "{e:?}");
        // 256 parts of -4 to 4.
        assert!(e.harmonics.iter().all(|&e| e <= 0.5 * 8.0 / 256.0 + rounding(4.0)), "{e:?}");
    }
}

#[test]
fn glb_keeps_floats() {
    for degree in 0..=3 {
        let g = random(300, degree, 20 + u64::from(degree));
        let back = round_trip(&g, Format::Gltf);
        assert_eq!((&back.means, &back.sh), (&g.means, &g.sh), "signs of the axes cancel to the bit");
        let e = in_order(&g, Format::Gltf);
        assert!(e.log_scale <= rounding(8.0) && e.rotation <= rounding(1.0) && e.opacity <= rounding(1.0), "{e:?}");
    }
}

#[test]
fn sog_errors_are_those_of_its_bits_and_codebooks() {
    for degree in 0..=3 {
        let g = random(700, degree, 30 + u64::from(degree));
        let order = morton(&g);
        let back = round_trip(&g, Format::Sog);
        let e = errors(&g, &back, &order);
        // 16 bits of ln(1 + |x|), whose slope is 1 / (1 + |x|).
        assert!(e.mean <= 41.0 * 0.5 * 41.0_f64.ln() / 65535.0 + rounding(40.0), "{e:?}");
        assert!(e.opacity <= OPACITY, "{e:?}");
        assert!(e.rotation <= LARGEST * 0.5 / 255.0 * std::f64::consts::SQRT_2, "{e:?}");
        // Half of the 256 codes begin as even steps over the range, and the mean square only falls from there: that of half a
        // step is the most it can be.
        let half_step = |range: f64| 0.5 * range / 127.0;
        let row = 3 * g.sh_coefficients();
        let root_mean_square =
            |values: Vec<f32>| (values.iter().map(|v| f64::from(v * v)).sum::<f64>() / values.len() as f64).sqrt();
        let scales =
            order.iter().zip(&back.log_scales).flat_map(|(&i, b)| [0, 1, 2].map(|k| g.log_scales[i][k] - b[k]));
        assert!(root_mean_square(scales.collect()) <= half_step(8.0), "{e:?}");
        // As many entries as Gaussians in the palette, so that only the codebooks are inexact.
        let sh = order.iter().enumerate().flat_map(|(at, &i)| (0..row).map(move |k| (row * at + k, row * i + k)));
        assert!(root_mean_square(sh.map(|(b, a)| g.sh[a] - back.sh[b]).collect()) <= half_step(1.8), "{e:?}");
    }
}

#[test]
fn codebooks_and_palettes() {
    let few = Codebook::fit([3.0, -1.0, 3.0].into_iter());
    assert_eq!(few.0.len(), 256);
    assert_eq!([-9.0, 0.9, 1.1, 9.0].map(|v| few.0[usize::from(few.nearest(v))]), [-1.0, -1.0, 3.0, 3.0]);
    // 400 values of which 390 lie together: quantiles serve them, even steps the others.
    let values = |i: i16| if i < 390 { f32::from(i) * 1e-3 } else { f32::from(i) };
    let codes = Codebook::fit((0..400).map(values));
    assert!((0..390).all(|i| (codes.0[usize::from(codes.nearest(values(i)))] - values(i)).abs() < 3e-3));
    // Rows of 40 places become 40 entries, each at its place.
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let rows: Vec<f32> = (0..2000).flat_map(|_| [(rng.random_range(0..40_u8)).into(), 5.0]).collect();
    let palette = Palette::fit(&rows, 2, 400);
    assert!(palette.entries.len() / 2 <= 400);
    for (row, &label) in rows.chunks_exact(2).zip(&palette.labels) {
        assert_eq!(row, &palette.entries[2 * label as usize..][..2]);
    }
}

/// The covariance, and the colour from a direction, of Gaussian 0.
fn seen(g: &Gaussians, from: glam::DVec3) -> (glam::DMat3, f64) {
    let [w, x, y, z] = quantise::unit_quaternion(g.rotations[0]);
    let turn = glam::DMat3::from_quat(glam::DQuat::from_xyzw(x, y, z, w));
    let scales = glam::DVec3::from(g.log_scales[0].map(|s| f64::from(s).exp()));
    let covariance = turn * glam::DMat3::from_diagonal(scales * scales) * turn.transpose();
    let color =
        gltf_nodes::basis(from).into_iter().zip(g.sh.chunks_exact(3)).map(|(basis, rgb)| basis * f64::from(rgb[0]));
    (covariance, color.sum())
}

#[test]
fn turned_axes_show_the_same_thing() {
    for signs in [RUB, LUF] {
        let s = glam::DVec3::from(signs.map(f64::from));
        let s = glam::DMat3::from_diagonal(s);
        for seed in 0..5 {
            let g = random(1, 3, 40 + seed);
            let mut other = turned(&g, signs);
            for from in [glam::DVec3::X, glam::DVec3::new(0.48, -0.6, 0.64), glam::DVec3::new(-0.6, 0.0, 0.8)] {
                let ((a, red), (b, other_red)) = (seen(&g, from), seen(&other, s * from));
                assert!((s * a * s).abs_diff_eq(b, 1e-12) && (red - other_red).abs() < 1e-12);
            }
            turn(&mut other, signs);
            assert_eq!(other, g);
        }
    }
}

/// What the files say of the axes: in SPZ y points up and z back, in glTF x left and y up, in the others as in memory.
#[test]
fn files_have_the_axes_of_their_format() {
    let mut g = random(1, 0, 50);
    g.means[0] = [0.5, 1.0, 2.0];
    let mut spz = Vec::new();
    spz::write(&turned(&g, RUB), 12, &mut spz).unwrap();
    let mut data = Vec::new();
    flate2::read::GzDecoder::new(spz.as_slice()).read_to_end(&mut data).unwrap();
    assert_eq!(data[..16], [b'N', b'G', b'S', b'P', 3, 0, 0, 0, 1, 0, 0, 0, 0, 12, 0, 0]);
    // 0.5, -1 and -2 in steps of 1/4096.
    assert_eq!(data[16..25], [0, 8, 0, 0, 0xf0, 0xff, 0, 0xe0, 0xff]);
    let mut glb = Vec::new();
    gltf::write(&turned(&g, LUF), &mut glb).unwrap();
    let binary = glb.len() - 4 * 14;
    assert_eq!(bytemuck::pod_collect_to_vec::<u8, f32>(&glb[binary..binary + 12]), [-0.5, -1.0, 2.0]);
    let mut plain = Vec::new();
    splat::write(&g, &mut plain).unwrap();
    assert_eq!(bytemuck::pod_collect_to_vec::<u8, f32>(&plain[..12]), [0.5, 1.0, 2.0]);
}

/// A file of version 2, by hand: two Gaussians with x, y, z of their quaternions.
#[test]
fn spz_of_version_2() {
    let mut data = b"NGSP\x02\0\0\0\x02\0\0\0\x00\x0c\0\0".to_vec();
    data.extend([0, 16, 0, 0, 0, 0, 0, 0xf0, 0xff, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    data.extend([128, 255]);
    data.extend([128; 6]);
    data.extend([160, 160, 160, 0, 0, 0]);
    data.extend([255, 128, 128, 128, 128, 128]);
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gzip.write_all(&data).unwrap();
    let g = read_gaussians_from(&mut Cursor::new(gzip.finish().unwrap()), 1 << 20, Path::new("a")).unwrap();
    assert_eq!(g.means, [[1.0, 0.0, 1.0], [0.0; 3]]);
    assert_eq!(g.log_scales, [[0.0; 3], [-10.0; 3]]);
    assert!(g.rotations[0][1] > 0.999 && g.rotations[1][0] > 0.999, "{:?}", g.rotations);
}

#[test]
fn far_scenes_keep_their_place_where_the_format_can() {
    let mut g = random(50, 1, 60);
    g.space = LocalSpace::at(DVec3::new(5e6, -4e6, 30.5));
    for format in [Format::CompressedPly, Format::Gltf, Format::Ply] {
        assert_eq!(round_trip(&g, format).space, g.space, "{format:?}");
        let [Loss::SplitOff { offset, .. }] = format.losses(&g)[..] else { panic!("{:?}", format.losses(&g)) };
        assert_eq!(offset, g.space.origin);
    }
    for format in [Format::Spz, Format::Sog] {
        assert_eq!(round_trip(&g, format).space, LocalSpace::default());
        assert_eq!(format.losses(&g), [Loss::Offset(g.space.origin)]);
    }
}

#[test]
fn models_that_a_format_cannot_hold() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |g: &Gaussians, name: &str| {
        let path = folder.path().join(name);
        let text = write_gaussians(&path, g, Format::of_name(&path).unwrap()).unwrap_err().to_string();
        assert!(text.contains(name) && !text.contains('\n') && !path.exists(), "{text}");
        text
    };
    for name in ["a.spz", "a.splat", "a.GLB", "a.sog", "a.compressed.ply"] {
        assert!(refused(&Gaussians::default(), name).contains("no Gaussians"));
    }
    let mut far = random(2, 0, 70);
    far.means[1][2] = -1e7;
    assert!(refused(&far, "a.spz").contains("8388607"));
    far.means[1][2] = f32::NAN;
    assert!(refused_nan(&far).contains("`means` of Gaussian 1"));
}

fn refused_nan(g: &Gaussians) -> String {
    let folder = tempfile::tempdir().unwrap();
    write_gaussians(&folder.path().join("a.spz"), g, Format::Spz).unwrap_err().to_string()
}

#[test]
fn names_say_the_format() {
    let of = |name: &str| Format::of_name(Path::new(name));
    assert_eq!(of("a/b.compressed.ply"), Some(Format::CompressedPly));
    assert_eq!(
        (of("b.PLY"), of("c.splat"), of("d.zip"), of("ply")),
        (Some(Format::Ply), Some(Format::Splat), None, None)
    );
}
