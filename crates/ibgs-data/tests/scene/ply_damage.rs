//! Damaged PLY files: one clear sentence each, never a panic.

use super::{TEXT_PLY, header_length, ply_bytes, random_gaussians, read_bytes};
use ibgs_data::scene::{PlyFlavor, read_ply};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;

/// The error's text, which must be one line that names the file.
fn complaint(bytes: &[u8]) -> String {
    let text = read_bytes(bytes).unwrap_err().to_string();
    assert!(text.contains("model.ply") && !text.contains('\n'), "{text}");
    text
}

#[test]
fn truncated_ply_is_an_error_at_every_offset() {
    let bytes = ply_bytes(&random_gaussians(3, 1, 1), PlyFlavor::Full);
    for end in 0..bytes.len() {
        complaint(&bytes[..end]);
    }
    let text = complaint(&bytes[..bytes.len() - 1]);
    assert!(text.contains("promises 3 Gaussians") && text.contains("holds 2"), "{text}");
    // Text: where a number is cut the file still reads as numbers, so only missing values can be noticed.
    let last_gap = TEXT_PLY.rfind(' ').unwrap();
    for end in 0..last_gap {
        complaint(&TEXT_PLY.as_bytes()[..end]);
    }
}

#[test]
fn counts_that_lie_are_errors_and_reserve_nothing() {
    let bytes = ply_bytes(&random_gaussians(3, 0, 2), PlyFlavor::Full);
    let start = header_length(&bytes);
    let header = String::from_utf8(bytes[..start].to_vec()).unwrap();
    let with_count = |count: &str| {
        let mut lied = header.replace("vertex 3", &format!("vertex {count}")).into_bytes();
        lied.extend(&bytes[start..]);
        lied
    };
    assert!(read_bytes(&with_count("3")).is_ok());
    assert!(complaint(&with_count("4")).contains("truncated"));
    assert!(complaint(&with_count("18446744073709551615")).contains("truncated"));
    assert!(complaint(&with_count("2")).contains("follow the last Gaussian"));
    assert!(complaint(&with_count("-1")).contains("count"));
    assert!(complaint(&with_count("99999999999999999999999")).contains("count"));
    let text = TEXT_PLY.replace("vertex 1", "vertex 1000000000000");
    assert!(complaint(text.as_bytes()).contains("truncated"));
    assert!(complaint(TEXT_PLY.replace("vertex 1", "vertex 2").as_bytes()).contains("truncated"));
    assert!(complaint(format!("{TEXT_PLY}\n1 2 3 4 5 6 7 8 9 0 1 2 3 4 5").as_bytes()).contains("follow"));
    let empty = TEXT_PLY.replace("element camera 2\nproperty list uchar float values", "element camera 9999999999999");
    assert!(complaint(empty.as_bytes()).contains("no fields"));
}

#[test]
fn wrong_fields_are_named() {
    let cases = [
        ("property float opacity", "property float opaque", "`opacity`"),
        ("property double z\n", "property list uchar float z\n", "`z` is a list"),
        ("property short y", "property short x", "two fields `x`"),
        ("property float unknown", "property float f_rest_0", "1 fields `f_rest_*`"),
        ("element vertex", "element points", "no `vertex`"),
        ("format ascii 1.0", "format base64 1.0", "base64"),
        ("property short y", "property long y", "long"),
        ("ply\n", "obj\n", "does not begin"),
        ("-300", "1e39", "cannot be read"),
        ("0.2 0.3", "inf 0.3", "`f_dc_1` of Gaussian 0"),
        ("0.2 0.3", "0.2 NaN", "`f_dc_2` of Gaussian 0"),
        ("1e-3 1 2", "1e300 1 2", "`z` of Gaussian 0 (counted from 0) is inf"),
    ];
    for (from, to, expected) in cases {
        let text = complaint(TEXT_PLY.replacen(from, to, 1).as_bytes());
        assert!(text.contains(expected), "{from} -> {to}: {text}");
    }
    assert!(complaint(b"").contains("does not begin"));
    assert!(complaint(&[b"ply\n".as_slice(), &[0xff; 300]].concat()).contains("header is damaged"));
    let missing = read_ply(Path::new("no/such/model.ply")).unwrap_err().to_string();
    assert!(missing.contains("no/such/model.ply"), "{missing}");
    assert!(read_ply(Path::new("/")).is_err());
}

/// Gaussians with a value that is not finite are left out; only a file without any other is refused.
#[test]
fn gaussians_that_are_not_finite_are_left_out() {
    let whole = random_gaussians(3, 0, 3);
    let bytes = ply_bytes(&whole, PlyFlavor::Full);
    let row = 4 * 18;
    let spoiled = |rows: &[usize], column: usize, value: f32| {
        let mut bytes = bytes.clone();
        for index in rows {
            let at = header_length(&bytes) + row * index + 4 * column;
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        }
        bytes
    };
    for (column, value) in [(10, f32::NAN), (2, f32::INFINITY), (17, f32::NEG_INFINITY), (6, f32::NAN)] {
        let g = read_bytes(&spoiled(&[1], column, value)).unwrap();
        assert_eq!((&g.means[..], g.opacity_logits.len()), (&[whole.means[0], whole.means[2]][..], 2));
        g.validate().unwrap();
    }
    let text = complaint(&spoiled(&[0, 1, 2], 10, f32::NAN));
    assert!(text.contains("`opacity` of Gaussian 0"), "{text}");
}

#[test]
fn flat_gaussians_with_two_scales_are_refused() {
    let text = complaint(TEXT_PLY.replace("property float scale_2", "property float other").as_bytes());
    assert!(text.contains("two scales"), "{text}");
}

#[test]
fn damaged_bytes_never_panic() {
    let bytes = ply_bytes(&random_gaussians(2, 1, 4), PlyFlavor::Full);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for source in [&bytes[..], TEXT_PLY.as_bytes()] {
        for _ in 0..500 {
            let mut damaged = source.to_vec();
            for _ in 0..rng.random_range(1..4) {
                let at = rng.random_range(0..damaged.len());
                damaged[at] = rng.random();
            }
            let _ = read_bytes(&damaged);
        }
    }
}
