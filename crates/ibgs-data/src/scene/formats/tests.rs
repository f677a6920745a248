//! Every format there and back: the largest error is half a step of what it keeps.

use super::axes::{LUF, RUB, turn};
use super::*;
use crate::scene::formats::palette::{Codebook, Palette};
use crate::scene::gaussians::coefficients;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::io::Cursor;

/// Bound of an error of float32 arithmetic: some roundings of values of this size.
pub(super) fn rounding(size: f64) -> f64 {
    8.0 * f64::from(f32::EPSILON) * size
}

/// Gaussians within what every format can hold: opacities that a byte distinguishes from 0 and 1, coefficients within
/// -0.9 to 0.9.
pub(in crate::scene) fn random(n: usize, sh_degree: u32, seed: u64) -> Gaussians {
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

/// The bytes of a file.
pub(super) fn written(g: &Gaussians, format: Format) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    write_gaussians(&path, g, format).unwrap();
    std::fs::read(path).unwrap()
}

/// The Gaussians of a file of this name.
pub(super) fn read_named(bytes: &[u8], name: &str) -> Result<Gaussians, SceneError> {
    read_gaussians_from(&mut Cursor::new(bytes), bytes.len() as u64, Path::new(name))
}

pub(super) fn round_trip(g: &Gaussians, format: Format) -> Gaussians {
    let bytes = written(g, format);
    // Contents say what it is, where there is a mark.
    let ending = if Format::of_contents(&bytes).is_some() { ".bin" } else { format.ending() };
    let back = read_named(&bytes, &format!("a{ending}")).unwrap();
    back.validate().unwrap();
    assert_eq!(back.len(), g.len());
    assert!(back.normals.iter().all(|&normal| normal == [0.0, 0.0, 1.0]), "what has no plane says so");
    back
}

/// Largest errors of a round trip.
#[derive(Debug, Default)]
pub(super) struct Errors {
    pub mean: f64,
    pub log_scale: f64,
    pub opacity: f64,
    /// Of a component of the unit quaternion.
    pub rotation: f64,
    /// Of the colour of degree 0.
    pub color: f64,
    /// Of the coefficients of degree 1, and of those above.
    pub harmonics: [f64; 2],
}

fn worst(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, f64::max)
}

/// Errors of `back`, whose Gaussians are those of `g` in the order `order`.
pub(super) fn errors(g: &Gaussians, back: &Gaussians, order: &[usize]) -> Errors {
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
pub(super) fn in_order(g: &Gaussians, format: Format) -> Errors {
    let order: Vec<usize> = (0..g.len()).collect();
    errors(g, &round_trip(g, format), &order)
}

/// Half a byte's step of 0 to 1, with what rounding the logit to a float adds: its error times the slope of 1/4, at most.
pub(super) const OPACITY: f64 = 0.5 / 255.0 + 1e-6;

/// The error of the largest component follows from those of the others: at least 1/2 itself, it has at most the sum of their
/// values times their errors over itself, sqrt(3/4) sqrt(3) / (1/2) = 3 times theirs.
pub(super) const LARGEST: f64 = 3.0;

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
            let mut other = g.clone();
            turn(&mut other, signs);
            for from in [glam::DVec3::X, glam::DVec3::new(0.48, -0.6, 0.64), glam::DVec3::new(-0.6, 0.0, 0.8)] {
                let ((a, red), (b, other_red)) = (seen(&g, from), seen(&other, s * from));
                assert!((s * a * s).abs_diff_eq(b, 1e-12) && (red - other_red).abs() < 1e-12);
            }
            turn(&mut other, signs);
            assert_eq!(other, g);
        }
    }
}

#[test]
fn far_scenes_keep_their_place_where_the_format_can() {
    let mut g = random(50, 1, 60);
    g.space = LocalSpace::at(DVec3::new(5e6, -4e6, 30.5));
    for format in Format::written() {
        let back = round_trip(&g, format).space;
        let offsets: Vec<Loss> =
            format.losses(&g).into_iter().filter(|loss| !matches!(loss, Loss::Harmonics { .. })).collect();
        let expected = match format.row().place_of_offset {
            Some(place) => (g.space, Loss::SplitOff { offset: g.space.origin, place }),
            None => (LocalSpace::default(), Loss::Offset(g.space.origin)),
        };
        assert_eq!((back, &offsets[..]), (expected.0, &[expected.1][..]), "{format:?}");
    }
}

#[test]
fn harmonics_stay_up_to_the_degree_of_the_format() {
    for degree in 0..=MAX_SH_DEGREE {
        let g = random(20, degree, 80);
        for format in Format::written() {
            let kept = degree.min(format.max_sh_degree());
            assert_eq!(round_trip(&g, format).sh_degree, kept, "{format:?}");
            let lost = (kept < degree).then_some(Loss::Harmonics { degree, kept });
            assert_eq!(format.losses(&g), Vec::from_iter(lost), "{format:?}");
        }
    }
}

#[test]
fn models_that_no_format_can_hold() {
    let folder = tempfile::tempdir().unwrap();
    let mut spoiled = random(2, 0, 70);
    spoiled.means[1][2] = f32::NAN;
    for format in Format::written() {
        let name = format!("a{}", format.ending().to_ascii_uppercase());
        let path = folder.path().join(&name);
        let refused = |g: &Gaussians| {
            let text = write_gaussians(&path, g, Format::of_name(&path).unwrap()).unwrap_err().to_string();
            assert!(!text.contains('\n') && !path.exists(), "{text}");
            text
        };
        assert!(refused(&spoiled).contains("`means` of Gaussian 1"));
        // PLY has files without Gaussians.
        if matches!(format.row().writing, Writing::By(_)) {
            let text = refused(&Gaussians::default());
            assert!(text.contains(&name) && text.contains("no Gaussians"), "{text}");
        }
    }
}

#[test]
fn antialiasing_is_kept_or_said_to_be_lost() {
    let mut g = random(30, 0, 72);
    for format in Format::written() {
        assert!(!round_trip(&g, format).antialiased, "{format:?}");
    }
    g.antialiased = true;
    for format in Format::written() {
        let lost = format.losses(&g) == [Loss::Antialiased];
        assert_eq!(round_trip(&g, format).antialiased, !lost, "{format:?}");
        assert_eq!(lost, [Format::Splat, Format::Gltf, Format::Usda].contains(&format));
    }
    assert!(g.rows(2, 1..3).antialiased && g.with_sh_degree(1).antialiased);
}

#[test]
fn formats_that_are_read_only() {
    let path = tempfile::tempdir().unwrap().path().join("a.ksplat");
    let error = write_gaussians(&path, &random(2, 0, 71), Format::Ksplat).unwrap_err();
    let text = error.to_string();
    assert!(
        matches!(error, SceneError::CannotHold { .. }) && text.contains("read only") && text.contains("`.sog`"),
        "{text}"
    );
    assert!(!path.exists() && !Format::written_endings().contains("ksplat") && Format::endings().contains("`.ksplat`"));
}

#[test]
fn names_say_the_format() {
    let of = |name: &str| Format::of_name(Path::new(name));
    for format in Format::ALL {
        assert_eq!(of(&format!("a/b{}", format.ending())), Some(format));
    }
    assert_eq!(of("a/b.compressed.ply"), Some(Format::CompressedPly));
    assert_eq!(
        (of("b.PLY"), of("c.splat"), of("d.zip"), of("ply")),
        (Some(Format::Ply), Some(Format::Splat), None, None)
    );
}

/// The words of docs/formats.md for the axes.
fn words([x, y, z]: [f32; 3]) -> String {
    let word = |sign: f32, words: [&'static str; 2]| words[usize::from(sign < 0.0)];
    let [x, y, z] = [word(x, ["right", "left"]), word(y, ["down", "up"]), word(z, ["forward", "back"])];
    format!("x {x}, y {y}, z {z}")
}

/// The rows of the table of docs/formats.md with this first line, without their bars.
fn table(first: &str) -> Vec<Vec<&'static str>> {
    let text = include_str!("../../../../../docs/formats.md");
    let rows = text.lines().skip_while(|line| !line.starts_with(first)).take_while(|line| line.starts_with('|'));
    rows.skip(2).map(|row| row.trim_matches('|').split('|').map(str::trim).collect()).collect()
}

#[test]
fn the_documentation_has_every_format() {
    let [formats, most, figures] = ["| format | ending |", "| ending | position |", "| ending | bytes"].map(table);
    let ending = |format: Format| format!("`{}`", format.ending());
    let [all, written] = [Format::ALL.map(ending).to_vec(), Format::written().map(ending).collect()];
    for format in Format::ALL {
        let row = format.row();
        let ending = format!("`{}`", row.ending);
        let found = formats.iter().find(|found| found[1] == ending);
        let found = found.unwrap_or_else(|| panic!("docs/formats.md has no {ending}"));
        let degree = row.max_sh_degree.to_string();
        let offset = row.place_of_offset.unwrap_or("no place");
        let read_only = if matches!(row.writing, Writing::Never) { ", read only" } else { "" };
        let [name, axes] = [format!("{}{read_only}", row.name), words(row.axes)];
        assert_eq!([found[0], found[3], found[4], found[5]], [&name, &degree, &axes, offset]);
    }
    let tables = [formats.iter().map(|row| row[1]).collect::<Vec<_>>(), first(&most), first(&figures)];
    for (table, endings) in tables.into_iter().zip([&all, &written, &written]) {
        let has = |ending: &String| table.contains(&ending.as_str());
        assert!(table.len() == endings.len() && endings.iter().all(has), "docs/formats.md has {table:?}");
    }
}

fn first<'a>(table: &[Vec<&'a str>]) -> Vec<&'a str> {
    table.iter().map(|row| row[0]).collect()
}
