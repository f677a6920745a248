//! The bytes of mesh files.

use super::*;
use serde::Deserialize;
use serde_json::{Value, json};

fn mesh() -> Mesh {
    let normals = vec![[0.0, 0.0, 1.0], [0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
    let positions = vec![[0.5, -1.25, 3.0], [1.0, 0.0, 0.1], [0.0, 1e-7, -2.0], [7.0, 8.0, 9.0]];
    let colors = vec![[255, 0, 128], [1, 2, 3], [0, 0, 0], [255, 255, 255]];
    Mesh { offset: DVec3::ZERO, positions, normals, colors, triangles: vec![[0, 1, 2], [2, 1, 3]] }
}

/// The bytes that are written under a name.
fn written(name: &str) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    mesh().write(&path).unwrap();
    std::fs::read(path).unwrap()
}

#[derive(Deserialize)]
struct Ply {
    vertex: Vec<Vertex>,
    face: Vec<Face>,
}

#[derive(Deserialize)]
struct Vertex {
    x: f32,
    y: f32,
    z: f32,
    nx: f32,
    ny: f32,
    nz: f32,
    red: u8,
    green: u8,
    blue: u8,
}

#[derive(Deserialize)]
struct Face {
    vertex_indices: Vec<u32>,
}

#[test]
fn ply() {
    let bytes = written("a.PLY");
    let ply: Ply = serde_ply::from_bytes(&bytes).unwrap();
    let read = Mesh {
        offset: DVec3::ZERO,
        positions: ply.vertex.iter().map(|v| [v.x, v.y, v.z]).collect(),
        normals: ply.vertex.iter().map(|v| [v.nx, v.ny, v.nz]).collect(),
        colors: ply.vertex.iter().map(|v| [v.red, v.green, v.blue]).collect(),
        triangles: ply.face.iter().map(|face| face.vertex_indices.clone().try_into().unwrap()).collect(),
    };
    assert_eq!(read, mesh());
}

#[test]
fn obj() {
    let text = String::from_utf8(written("a.obj")).unwrap();
    let mut read = Mesh::default();
    for line in text.lines() {
        let (kind, rest) = line.split_once(' ').unwrap();
        let words: Vec<&str> = rest.split(' ').collect();
        let numbers = || words.iter().map(|word| word.parse().unwrap()).collect::<Vec<f32>>();
        match kind {
            "v" => {
                read.positions.push(numbers()[..3].try_into().unwrap());
                read.colors.push([3, 4, 5].map(|i| (numbers()[i] * 255.0).round() as u8));
            }
            "vn" => read.normals.push(numbers().try_into().unwrap()),
            "f" => {
                let corner = |word: &str| {
                    let (vertex, normal) = word.split_once("//").unwrap();
                    assert_eq!(vertex, normal);
                    vertex.parse::<u32>().unwrap() - 1
                };
                read.triangles.push([0, 1, 2].map(|i| corner(words[i])));
            }
            _ => panic!("{line}"),
        }
    }
    assert_eq!(read, mesh());
}

#[test]
fn glb() {
    let bytes = written("a.glb");
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!((&bytes[..4], word(4), word(8) as usize), (&b"glTF"[..], 2, bytes.len()));
    let length = word(12) as usize;
    assert_eq!((&bytes[16..20], length % 4), (&b"JSON"[..], 0));
    let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let buffer = &bytes[28 + length..];
    assert_eq!((&bytes[24 + length..28 + length], word(20 + length) as usize), (&b"BIN\0"[..], buffer.len()));
    assert_eq!(document["buffers"][0]["byteLength"], buffer.len());
    let primitive = &document["meshes"][0]["primitives"][0];
    let data = |accessor: &Value, size: usize| {
        let accessor = &document["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let (first, count) =
            (view["byteOffset"].as_u64().unwrap() as usize, accessor["count"].as_u64().unwrap() as usize);
        assert_eq!(view["byteLength"], count * size);
        &buffer[first..first + count * size]
    };
    let floats =
        |name: &str| -> Vec<[f32; 3]> { bytemuck::pod_collect_to_vec(data(&primitive["attributes"][name], 12)) };
    assert_eq!((floats("POSITION"), floats("NORMAL")), (mesh().positions, mesh().normals));
    let indices: Vec<[u32; 3]> = bytemuck::pod_collect_to_vec(data(&primitive["indices"], 4));
    assert_eq!(indices, mesh().triangles);
    let colors: Vec<[u16; 4]> = bytemuck::pod_collect_to_vec(data(&primitive["attributes"]["COLOR_0"], 8));
    // Linear light: 128 of 255 is 21.6 %.
    assert_eq!((colors[0], colors[3]), ([65535, 0, 14146, 65535], [65535; 4]));
    assert_eq!(document["accessors"][0]["min"], json!([0.0, -1.25, -2.0]));
    assert_eq!(document["accessors"][0]["max"], json!([7.0, 8.0, 9.0]));
}

#[test]
fn far_meshes_keep_their_place() {
    let far = Mesh { offset: DVec3::new(5_000_000.0, -4e6, 0.5), ..mesh() };
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| {
        let path = folder.path().join(name);
        far.write(&path).unwrap();
        String::from_utf8_lossy(&std::fs::read(path).unwrap()).into_owned()
    };
    assert!(file("a.ply").contains("\ncomment offset 5000000 -4000000 0.5\nelement vertex 4\n"));
    assert!(file("a.obj").starts_with("v 5000000.5 -4000001.25 3.5 "));
    assert!(file("a.glb").contains("\"translation\":[5000000.0,-4000000.0,0.5]"));
}

#[test]
fn names_that_tell_no_format() {
    for name in ["a.stl", "a", "ply"] {
        let error = mesh().write(&PathBuf::from("nowhere").join(name)).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("must end in `.ply`, `.obj` or `.glb`"), "{error}");
    }
    assert!(!PathBuf::from("nowhere").exists());
}
