//! SOG without an archive, and its version 1.

use super::random_gaussians;
use ibgs_data::scene::{Format, Gaussians, read_gaussians};
use ibgs_testing::scene_files::zip_of;
use ibgs_testing::{bytes_of, read};
use serde_json::{Value, json};
use std::fs;
use std::io::Cursor;
use std::path::Path;
use tempfile::TempDir;

fn unpacked(g: &Gaussians) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    zip::ZipArchive::new(Cursor::new(bytes_of(g, Format::Sog))).unwrap().extract(folder.path()).unwrap();
    folder
}

fn complaint(folder: &Path) -> String {
    let text = read_gaussians(&folder.join("meta.json")).map(|g| g.len()).unwrap_err().to_string();
    assert!(text.contains("meta.json") && !text.contains('\n'), "{text}");
    text
}

fn change(folder: &Path, change: impl Fn(&mut Value)) {
    let path = folder.join("meta.json");
    let mut meta = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    change(&mut meta);
    fs::write(path, meta.to_string()).unwrap();
}

#[test]
fn a_folder_holds_what_its_archive_holds() {
    for degree in 0..=3 {
        let g = random_gaussians(60, degree, 8);
        let folder = unpacked(&g);
        let found = read_gaussians(&folder.path().join("meta.json")).unwrap();
        assert_eq!(found, read(&bytes_of(&g, Format::Sog), "a.sog").unwrap());
    }
}

#[test]
fn folders_that_lie() {
    let g = random_gaussians(60, 1, 9);
    let changed = |to: &dyn Fn(&mut Value)| {
        let folder = unpacked(&g);
        change(folder.path(), to);
        complaint(folder.path())
    };
    assert!(changed(&|meta| meta["quats"]["files"][0] = json!("../quats.webp")).contains("`../quats.webp` leads out"));
    assert!(changed(&|meta| meta["quats"]["files"][0] = json!("/etc/passwd")).contains("leads out of its folder"));
    assert!(changed(&|meta| meta["quats"]["files"][0] = json!("none.webp")).contains("`none.webp` cannot be read"));
    assert!(changed(&|meta| meta["quats"]["files"][0] = json!("meta.json")).contains("no lossless WebP picture"));
    assert!(changed(&|meta| meta["count"] = json!(1_u64 << 40)).contains("promises 1099511627776"));
    assert!(changed(&|meta| meta["count"] = json!(5000)).contains("pixels where 5000"));
    assert!(changed(&|meta| meta["version"] = json!(3)).contains("version 3"));
    assert!(changed(&|meta| meta["scales"] = Value::Null).contains("`meta.json` is wrong"));
    let folder = unpacked(&g);
    fs::write(folder.path().join("meta.json"), "{").unwrap();
    assert!(complaint(folder.path()).contains("`meta.json` is wrong"));
}

fn webp(width: u32, rgba: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let height = rgba.len() as u32 / 4 / width;
    image_webp::WebPEncoder::new(&mut bytes).encode(rgba, width, height, image_webp::ColorType::Rgba8).unwrap();
    bytes
}

/// Two Gaussians of version 1, by hand.
fn version_1() -> (Value, Vec<(&'static str, Vec<u8>)>) {
    let meta = json!({
        "means": {"shape": [2, 3], "dtype": "float32", "mins": [0.0, 0.0, -1.0], "maxs": [1.0, 2.0, 0.0],
            "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"shape": [2, 3], "mins": [-8.0, -6.0, -4.0], "maxs": [0.0, 0.0, 0.0], "files": ["scales.webp"]},
        "quats": {"shape": [2, 4], "encoding": "quaternion_packed", "files": ["quats.webp"]},
        "sh0": {"shape": [2, 1, 4], "mins": [-1.0, -2.0, -3.0, -5.0], "maxs": [1.0, 2.0, 3.0, 5.0],
            "files": ["sh0.webp"]},
        "shN": {"shape": [2, 9], "mins": -0.5, "maxs": 0.5, "files": ["shN_centroids.webp", "shN_labels.webp"]},
    });
    // Entry 0 of the palette is the least value, entry 1 the largest.
    let mut palette = vec![0; 4 * 192];
    palette[12..24].fill(255);
    let ends = [[0, 0, 0, 0], [255, 255, 255, 255]].concat();
    let parts = vec![
        ("means_l.webp", webp(2, &ends)),
        ("means_u.webp", webp(2, &ends)),
        ("scales.webp", webp(2, &ends)),
        ("quats.webp", webp(2, &[128, 128, 128, 252, 128, 128, 128, 255])),
        ("sh0.webp", webp(2, &ends)),
        ("shN_centroids.webp", webp(192, &palette)),
        ("shN_labels.webp", webp(2, &[0, 0, 0, 255, 1, 0, 0, 255])),
    ];
    (meta, parts)
}

fn archive(meta: &Value, parts: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let meta = meta.to_string();
    let entries = std::iter::once(("meta.json", meta.as_bytes()));
    let entries: Vec<_> = entries.chain(parts.iter().map(|(name, bytes)| (*name, bytes.as_slice()))).collect();
    zip_of(&entries)
}

#[test]
fn version_1_has_even_steps() {
    let (meta, parts) = version_1();
    let g = read(&archive(&meta, &parts), "a.sog").unwrap();
    let close = |found: &[f32], expected: &[f64]| {
        let close = found.iter().zip(expected).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-5);
        assert!(close && found.len() == expected.len(), "{found:?}, not {expected:?}");
    };
    // sign(x) ln(1 + |x|) from 0 to 1, 0 to 2, -1 to 0.
    let [one, two] = [1.0_f64.exp_m1(), 2.0_f64.exp_m1()];
    close(g.means.as_flattened(), &[0.0, 0.0, -one, one, two, 0.0]);
    close(g.log_scales.as_flattened(), &[-8.0, -6.0, -4.0, 0.0, 0.0, 0.0]);
    close(&g.opacity_logits, &[-5.0, 5.0]);
    assert!(g.rotations[0][0] > 0.999 && g.rotations[1][3] > 0.999);
    assert_eq!(g.sh_degree, 1);
    close(&g.sh[..12], &[[-1.0, -2.0, -3.0].as_slice(), &[-0.5; 9]].concat());
    close(&g.sh[12..], &[[1.0, 2.0, 3.0].as_slice(), &[0.5; 9]].concat());
    // Beside one another in a folder.
    let folder = tempfile::tempdir().unwrap();
    parts.iter().for_each(|(name, bytes)| fs::write(folder.path().join(name), bytes).unwrap());
    fs::write(folder.path().join("meta.json"), meta.to_string()).unwrap();
    assert_eq!(read_gaussians(&folder.path().join("meta.json")).unwrap(), g);
}

#[test]
fn version_1_that_lies() {
    let refused = |change: &dyn Fn(&mut Value)| {
        let (mut meta, parts) = version_1();
        change(&mut meta);
        super::formats::complaint(&archive(&meta, &parts), "a.sog")
    };
    assert!(refused(&|meta| meta["means"]["shape"] = json!([])).contains("`shape` of its `means` is empty"));
    assert!(refused(&|meta| meta["means"]["shape"][0] = json!(3)).contains("2 pixels where 3"));
    assert!(refused(&|meta| meta["means"]["shape"][0] = json!(1_u64 << 40)).contains("promises 1099511627776"));
    assert!(refused(&|meta| meta["sh0"]["mins"] = json!([1, 2, 3])).contains("`meta.json` is wrong"));
    assert!(
        refused(&|meta| meta["shN"]["files"][0] = json!("sh0.webp")).contains("2 pixels wide, which no palette is")
    );
    assert!(refused(&|meta| meta["shN"]["files"][1] = json!("none")).contains("`none` cannot be read"));
}

/// A streamed one with a folder and an archive, of another degree, at its level 0.
fn streamed(first: &Gaussians, second: &Gaussians, change: impl Fn(&mut Value)) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    zip::ZipArchive::new(Cursor::new(bytes_of(first, Format::Sog)))
        .unwrap()
        .extract(folder.path().join("0_0"))
        .unwrap();
    fs::write(folder.path().join("second.sog"), bytes_of(second, Format::Sog)).unwrap();
    let part = |file: usize| json!({"file": file, "offset": 0, "count": 1});
    let mut meta = json!({
        "version": 1, "lodLevels": 2, "filenames": ["none/meta.json", "second.sog", "0_0/meta.json"],
        "tree": {"children": [{"lods": {"0": part(2), "1": part(0)}}, {"lods": {"0": part(1)}}, {"lods": {"0": part(2)}}]},
    });
    change(&mut meta);
    fs::write(folder.path().join("lod-meta.json"), meta.to_string()).unwrap();
    folder
}

#[test]
fn a_streamed_one_is_read_in_full_detail() {
    let [first, second] = [random_gaussians(60, 2, 10), random_gaussians(40, 0, 11)];
    let folder = streamed(&first, &second, |_| ());
    let found = read_gaussians(&folder.path().join("lod-meta.json")).unwrap();
    let [first, second] = [&first, &second].map(|g| read(&bytes_of(g, Format::Sog), "a.sog").unwrap());
    assert_eq!((found.len(), found.sh_degree), (100, 2), "each file once");
    assert_eq!(found.means, [first.means.clone(), second.means.clone()].concat());
    let sky = streamed(&first, &second, |meta| {
        meta["environment"] = json!("second.sog");
        meta["tree"] = meta["tree"]["children"][0].take();
    });
    assert_eq!(read_gaussians(&sky.path().join("lod-meta.json")).unwrap(), found);
}

#[test]
fn streamed_ones_that_lie() {
    let g = random_gaussians(60, 1, 12);
    let refused = |change: &dyn Fn(&mut Value)| {
        let folder = streamed(&g, &g, change);
        let text = read_gaussians(&folder.path().join("lod-meta.json")).map(|g| g.len()).unwrap_err().to_string();
        assert!(text.contains("lod-meta.json") && !text.contains('\n'), "{text}");
        text
    };
    assert!(refused(&|meta| meta["version"] = json!(2)).contains("version 2"));
    assert!(refused(&|meta| meta["tree"] = json!({"children": []})).contains("no files of level 0"));
    assert!(refused(&|meta| meta["tree"] = Value::Null).contains("its text is wrong"));
    assert!(refused(&|meta| meta["filenames"] = json!(["a", "b"])).contains("the file 2 of 2"));
    assert!(refused(&|meta| meta["filenames"][2] = json!("../meta.json")).contains("`../meta.json` leads out"));
    assert!(refused(&|meta| meta["environment"] = json!("/etc/passwd")).contains("leads out of its folder"));
    assert!(refused(&|meta| meta["filenames"][2] = json!("lod-meta.json")).contains("in its `lod-meta.json`"));
    assert!(refused(&|meta| meta["filenames"][2] = json!("none.sog")).contains("`none.sog` cannot be read"));
}
