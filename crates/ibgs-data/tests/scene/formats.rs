//! Files of other programs that are damaged or hostile.

use super::{TEXT_PLY, random_gaussians};
use flate2::Compression;
use flate2::write::GzEncoder;
use ibgs_data::scene::{Format, read_gaussians};
use ibgs_testing::scene_files::zip_of;
use ibgs_testing::{bytes_of, read};
use serde_json::Value;
use std::io::{Cursor, Write};
use std::path::Path;

/// The error's text, which must be one line that names the file.
#[track_caller]
pub fn complaint(bytes: &[u8], name: &str) -> String {
    let text = read(bytes, name).map(|g| g.len()).unwrap_err().to_string();
    assert!(text.contains(name) && !text.contains('\n'), "{text}");
    text
}

#[test]
fn every_cut_is_told() {
    let g = random_gaussians(40, 2, 1);
    for format in Format::written() {
        let bytes = bytes_of(&g, format);
        let name = format!("a{}", format.ending());
        assert_eq!(read(&bytes, &name).unwrap().len(), 40);
        let is_counted = Format::of_contents(&bytes).is_some();
        for end in (0..bytes.len()).step_by(bytes.len() / 60 + 1) {
            // A whole number of Gaussians is a whole file where nothing counts them.
            if !is_counted && (40 * end).is_multiple_of(bytes.len()) {
                continue;
            }
            complaint(&bytes[..end], &name);
        }
    }
    assert!(complaint(b"something else", "a.bin").contains("`.ply`, `.spz`"));
    assert!(complaint(b"", "a.bin").contains("`.ply`, `.spz`"));
    assert!(read_gaussians(Path::new("no/such.spz")).unwrap_err().to_string().contains("no/such.spz"));
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::best());
    gzip.write_all(bytes).unwrap();
    gzip.finish().unwrap()
}

fn spz_header(version: u32, count: u32, degree: u8) -> Vec<u8> {
    [b"NGSP".as_slice(), &version.to_le_bytes(), &count.to_le_bytes(), &[degree, 12, 0, 0]].concat()
}

#[test]
fn spz_that_lies() {
    let header = |version: u32, count: u32, degree: u8| gzip(&spz_header(version, count, degree));
    assert!(complaint(&header(3, u32::MAX, 3), "a.spz").contains("promises 4294967295"));
    assert!(complaint(&header(3, 1000, 0), "a.spz").contains("truncated"));
    assert!(complaint(&header(4, 0, 0), "a.spz").contains("which version 4 is not"));
    assert!(complaint(&header(5, 0, 0), "a.spz").contains("version 5"));
    assert!(complaint(&header(1, 0, 0), "a.spz").contains("version 1"));
    assert!(complaint(&header(3, 0, 4), "a.spz").contains("degree 4"));
    assert!(complaint(b"NGSP\x04\0\0\0", "a.spz").contains("truncated"));
    let plain = |version: u32, count: u32, degree: u8| [spz_header(version, count, degree), vec![0; 16]].concat();
    assert!(complaint(&plain(3, 0, 0), "a.spz").contains("it is none"));
    assert!(complaint(&plain(4, u32::MAX, 3), "a.spz").contains("promises 4294967295"));
    assert!(complaint(&plain(4, 0, 4), "a.spz").contains("degree 4"));
    assert!(complaint(&plain(7, 0, 0), "a.spz").contains("version 7"));
    assert!(complaint(&gzip(b"<svg> 16 bytes and more"), "a.spz").contains("NGSP"));
    // 60 MB of zeros in 60 KB: as many as are promised, but no scene.
    let mut bomb = spz_header(3, 1_000_000, 3);
    bomb.resize(bomb.len() + 65_000_000, 0);
    assert!(complaint(&gzip(&bomb), "a.spz").contains("promises 1000000 Gaussians, more than"));
}

#[test]
fn sog_that_lies() {
    let g = random_gaussians(40, 1, 2);
    let bytes = bytes_of(&g, Format::Sog);
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    let names: Vec<String> = archive.file_names().map(|name| name.unwrap().into_owned()).collect();
    let mut parts: Vec<(String, Vec<u8>)> = Vec::new();
    for name in names {
        let mut part = Vec::new();
        std::io::copy(&mut archive.by_name(&name).unwrap(), &mut part).unwrap();
        parts.push((name, part));
    }
    let changed = |name: &str, change: &dyn Fn(&[u8]) -> Vec<u8>| {
        let part = |(n, bytes): &(String, Vec<u8>)| (n.clone(), if n == name { change(bytes) } else { bytes.clone() });
        let parts: Vec<_> = parts.iter().map(part).collect();
        let entries: Vec<(&str, &[u8])> = parts.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
        zip_of(&entries)
    };
    let meta = |from: &'static str, to: &'static str| {
        changed("meta.json", &move |bytes| String::from_utf8_lossy(bytes).replacen(from, to, 1).into_bytes())
    };
    assert_eq!(read(&meta("count", "count"), "a.sog").unwrap().len(), 40);
    // A scale of 0 has no logarithm that JSON can hold; a colour that is null is damage.
    let first = |field: &'static str| {
        changed("meta.json", &move |bytes| {
            let mut meta: Value = serde_json::from_slice(bytes).unwrap();
            meta[field]["codebook"][0] = Value::Null;
            meta.to_string().into_bytes()
        })
    };
    let flat = read(&first("scales"), "a.sog").unwrap();
    assert!(flat.len() == 40 && flat.log_scales.as_flattened().iter().any(|&v| v < -80.0));
    flat.validate().unwrap();
    assert!(read(&first("sh0"), "a.sog").unwrap().len() < 40);
    assert!(complaint(&meta("\"count\":40", "\"count\":400000000000"), "a.sog").contains("promises 400000000000"));
    assert!(complaint(&meta("\"count\":40", "\"count\":5000"), "a.sog").contains("pixels where 5000"));
    assert!(complaint(&meta("\"version\":2", "\"version\":3"), "a.sog").contains("version 3"));
    assert!(complaint(&meta("\"version\":2", "\"version\":null"), "a.sog").contains("`shape`"));
    assert!(complaint(&meta("\"bands\":1", "\"bands\":7"), "a.sog").contains("degree 7"));
    assert!(complaint(&meta("\"means_l.webp\"", "\"../a.webp\""), "a.sog").contains("../a.webp"));
    assert!(complaint(&meta("\"mins\":[", "\"mins\":[0,"), "a.sog").contains("meta.json"));
    assert!(complaint(&changed("quats.webp", &|_| b"no picture".to_vec()), "a.sog").contains("quats.webp"));
    // Equal pixels take hardly a byte.
    let mut huge = Vec::new();
    let size = 6_000;
    image_webp::WebPEncoder::new(&mut huge)
        .encode(&vec![0; 4 * size * size], size as u32, size as u32, image_webp::ColorType::Rgba8)
        .unwrap();
    assert!(complaint(&changed("sh0.webp", &move |_| huge.clone()), "a.sog").contains("6000 x 6000"));
    let zeros = complaint(&changed("quats.webp", &|_| vec![0; 30 << 20]), "a.sog");
    assert!(zeros.contains("quats.webp` unpacks to more than"), "{zeros}");
    let spaces = complaint(&changed("meta.json", &|_| vec![b' '; 30 << 20]), "a.sog");
    assert!(spaces.contains("meta.json` unpacks to more than"), "{spaces}");
    assert!(complaint(&zip_of(&[("a.txt", b"x".as_slice())]), "a.sog").contains("meta.json"));
}

#[test]
fn glb_that_lies() {
    let bytes = bytes_of(&random_gaussians(4, 1, 3), Format::Gltf);
    // Replacements are as long as what they replace.
    let changed = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
        let mut changed = bytes.clone();
        changed[at..at + from.len()].copy_from_slice(to.as_bytes());
        changed
    };
    let cases = [
        ("\"count\":4,", "\"count\":9,", "behind the end"),
        ("\"byteLength\":48", "\"byteLength\":40", "behind the end"),
        ("\"bufferView\":0", "\"bufferView\":9", "no buffer view"),
        ("\"bufferView\":2", "\"bufferView\":9", "no buffer view"),
        ("\"byteOffset\":48", "\"byteOffset\":9e", "description"),
        ("\"componentType\":5126", "\"componentType\":5125", "component type"),
        ("\"nodes\":[0]", "\"nodes\":[7]", "no node 7"),
        ("\"mesh\":0", "\"mesh\":5", "no mesh 5"),
        ("\"kernel\":\"ellipse\"", "\"kernel\":\"elephan\"", "elephan"),
        ("_splatting:SCALE", "_splatting:SCALA", "SCALE"),
        ("{\"KHR_gaussian_splatting\":{", "{\"KHR_gaussian_splattinG\":{", "no primitive"),
        ("glTF\u{2}", "glTF\u{1}", "version 1"),
    ];
    for (from, to, expected) in cases {
        let changed = changed(from, to);
        let text = complaint(&changed, "a.glb");
        assert!(text.contains(expected), "{from} -> {to}: {text}");
    }
    // A node below itself, and one mesh so often that little becomes much.
    let document = |nodes: &str| {
        let start = 20 + u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let text = String::from_utf8(bytes[20..start].to_vec()).unwrap();
        let mut text = text.replace("\"nodes\":[{\"mesh\":0}]", nodes);
        text.push_str(&" ".repeat(text.len().next_multiple_of(4) - text.len()));
        [&bytes[..12], &(text.len() as u32).to_le_bytes(), b"JSON", text.as_bytes(), &bytes[start..]].concat()
    };
    let whole = read(&document("\"nodes\":[{\"mesh\":0,\"translation\":[0,0,9]}]"), "a.glb").unwrap();
    assert_eq!((whole.len(), whole.space.origin.z), (4, 9.0));
    assert!(complaint(&document("\"nodes\":[{\"mesh\":0,\"children\":[0]}]"), "a.glb").contains("two parents"));
    let children: Vec<String> = (1..4000).map(|i| i.to_string()).collect();
    let many = format!("\"nodes\":[{{\"children\":[{}]}}{}]", children.join(","), ",{\"mesh\":0}".repeat(3999));
    assert!(complaint(&document(&many), "a.glb").contains("too often"));
    assert!(complaint(&document("\"nodes\":[{\"mesh\":0,\"scale\":[1,2,1]}]"), "a.glb").contains("stretches"));
}

#[test]
fn compressed_ply_that_lies() {
    let bytes = bytes_of(&random_gaussians(300, 1, 4), Format::CompressedPly);
    let changed = |from: &str, to: &str| {
        let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    let cases = [
        ("chunk 2", "chunk 1", "do not fit"),
        ("vertex 300", "vertex 299", "do not fit"),
        ("chunk 2", "chunk 99999999999999", "truncated"),
        ("element sh 300", "element sh 99999999999", "truncated"),
        ("uint packed_scale", "float packed_scale", "no `uint`"),
        ("float max_z", "float max_w", "max_z"),
        ("property uchar f_rest_8\n", "", "8 fields"),
        ("element sh", "element xy", "chunk, vertex, xy"),
    ];
    for (from, to, expected) in cases {
        let text = complaint(&changed(from, to), "a.ply");
        assert!(text.contains(expected), "{from} -> {to}: {text}");
    }
}

/// A chunk with NaN among its bounds spoils its 256 Gaussians; the others stay.
#[test]
fn values_that_are_not_finite_are_left_out_of_every_format() {
    let g = random_gaussians(300, 0, 5);
    let mut ply = bytes_of(&g, Format::CompressedPly);
    let header = super::header_length(&ply);
    ply[header..header + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert_eq!(read(&ply, "a.ply").unwrap().len(), 300 - 256);
    let mut splat = bytes_of(&g, Format::Splat);
    splat[32 * 7..32 * 7 + 4].copy_from_slice(&f32::INFINITY.to_le_bytes());
    // A standard deviation below 0 has no logarithm.
    splat[32 * 9 + 12..32 * 9 + 16].copy_from_slice(&(-1.0_f32).to_le_bytes());
    let kept = read(&splat, "a.splat").unwrap();
    kept.validate().unwrap();
    assert_eq!(kept.len(), 298);
    let mut glb = bytes_of(&g, Format::Gltf);
    let last = glb.len() - 4;
    glb[last..].copy_from_slice(&f32::NAN.to_le_bytes());
    assert_eq!(read(&glb, "a.glb").unwrap().len(), 299);
}

#[test]
fn a_ply_is_read_by_its_contents() {
    assert_eq!(read(TEXT_PLY.as_bytes(), "model.splat").unwrap().len(), 1);
}
