//! glTF as text, and with an SPZ file in it.

use super::random_gaussians;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ibgs_data::scene::{Format, Gaussians, read_gaussians};
use ibgs_testing::{bytes_of, read};
use serde_json::{Value, json};
use std::fs;

/// The description and the binary chunk of what we write.
fn chunks(g: &Gaussians) -> (Value, Vec<u8>) {
    let bytes = bytes_of(g, Format::Gltf);
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    (serde_json::from_slice(&bytes[20..20 + length]).unwrap(), bytes[28 + length..].to_vec())
}

fn data(bytes: &[u8]) -> Value {
    json!(format!("data:application/octet-stream;base64,{}", STANDARD.encode(bytes)))
}

fn complaint(document: &Value) -> String {
    super::formats::complaint(document.to_string().as_bytes(), "a.gltf")
}

#[test]
fn text_holds_what_a_binary_file_holds() {
    let g = random_gaussians(30, 2, 31);
    let whole = read(&bytes_of(&g, Format::Gltf), "a.glb").unwrap();
    let (mut document, binary) = chunks(&g);
    document["buffers"][0]["uri"] = data(&binary);
    assert_eq!(read(document.to_string().as_bytes(), "a.gltf").unwrap(), whole);
    // In a file beside it, whose name has a space.
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("the data.bin"), &binary).unwrap();
    document["buffers"][0]["uri"] = json!("the%20data.bin");
    let path = folder.path().join("a.gltf");
    fs::write(&path, document.to_string()).unwrap();
    assert_eq!(read_gaussians(&path).unwrap(), whole);
}

#[test]
fn buffers_that_lie() {
    let (mut document, binary) = chunks(&random_gaussians(30, 0, 32));
    let mut refused = |uri: Value| {
        document["buffers"][0]["uri"] = uri;
        complaint(&document)
    };
    assert!(refused(data(&binary[..40])).contains("buffer 0 has 40 bytes"));
    assert!(refused(json!("data:;base64,?")).contains("buffer 0 is no base64"));
    assert!(refused(json!("data:text/plain,abc")).contains("no base64"));
    assert!(refused(json!("../a.bin")).contains("`../a.bin` lies in no file beside it"));
    assert!(refused(json!("%2e%2e/a.bin")).contains("lies in no file beside it"));
    assert!(refused(json!("http://a/b.bin")).contains("lies in no file beside it"));
    assert!(refused(json!("none.bin")).contains("`none.bin` cannot be read"));
    assert!(refused(Value::Null).contains("buffer 0 has 0 bytes"));
    assert!(complaint(&json!({"asset": 3})).contains("no scene"));
    assert!(complaint(&json!([])).contains("description is wrong"));
}

/// A file with one SPZ file for a primitive that so many nodes show.
fn with_spz(spz: &[u8], nodes: usize) -> Value {
    let inner = json!({"KHR_gaussian_splatting_compression_spz_2": {"bufferView": 0}});
    let extension = json!({"kernel": "ellipse", "colorSpace": "srgb_rec709_display", "extensions": inner});
    json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": (0..nodes).collect::<Vec<_>>()}],
        "nodes": vec![json!({"mesh": 0, "translation": [1, 2, 3]}); nodes],
        "meshes": [{"primitives": [{"attributes": {}, "extensions": {"KHR_gaussian_splatting": extension}}]}],
        "bufferViews": [{"buffer": 0, "byteLength": spz.len()}],
        "buffers": [{"byteLength": spz.len(), "uri": data(spz)}],
    })
}

#[test]
fn spz_in_gltf() {
    let g = random_gaussians(300, 2, 33);
    let spz = bytes_of(&g, Format::Spz);
    let alone = read(&spz, "a.spz").unwrap();
    let document = with_spz(&spz, 2);
    let found = read(document.to_string().as_bytes(), "a.gltf").unwrap();
    assert_eq!((found.len(), found.sh_degree), (600, 2));
    // x of glTF points left, y up.
    for (found, alone) in found.positions().zip(alone.positions()) {
        assert!((found - alone).abs_diff_eq(glam::DVec3::new(-1.0, -2.0, 3.0), 1e-6), "{found} {alone}");
    }
    assert_eq!((&found.sh[..], &found.rotations[..300]), (&alone.sh.repeat(2)[..], &alone.rotations[..]));
    let refused = |change: &dyn Fn(&mut Value)| {
        let mut document = with_spz(&spz, 1);
        change(&mut document);
        complaint(&document)
    };
    let extension = "/meshes/0/primitives/0/extensions/KHR_gaussian_splatting/extensions";
    assert!(refused(&|d| d["bufferViews"][0]["byteLength"] = json!(90)).contains("SPZ file in it is wrong"));
    assert!(refused(&|d| d["bufferViews"][0]["byteLength"] = json!(1 << 30)).contains("behind the end of its buffer"));
    assert!(refused(&|d| d["bufferViews"][0]["buffer"] = json!(7)).contains("no buffer 7"));
    let set =
        |name: &'static str, value: Value| refused(&move |d| *d.pointer_mut(extension).unwrap() = json!({name: value}));
    assert!(set("KHR_gaussian_splatting_compression_spz", json!({"bufferView": 5})).contains("no buffer view 5"));
    assert!(set("KHR_gaussian_splatting_compression_spz", json!({})).contains("names no `bufferView`"));
    assert!(set("KHR_other", json!({})).contains("`KHR_other`, which is not read"));
    assert!(complaint(&with_spz(&spz, 100)).contains("too often"));
}
