//! Textures of surfaces known by formula.

use super::*;
use crate::mesh::MeshFormat;
use glam::{DVec2, DVec3, Vec2, Vec3};
use ibgs_demo::look_at;
use std::collections::HashSet;
use texels::covered;

/// The sides of a cube: x, y and z, the upper one second.
const COLORS: [[u8; 3]; 6] =
    [[220, 40, 50], [50, 210, 60], [60, 50, 200], [220, 210, 40], [40, 200, 210], [200, 50, 220]];
/// What the photos show beside the colours of the sides, which are those of the vertices.
fn pattern(point: Vec3) -> f32 {
    20.0 * (12.0 * point.x + 9.0 * point.y + 7.0 * point.z).sin()
}

/// The side of the cube that a point lies on.
fn side_of(point: Vec3) -> usize {
    let axis = point.abs().max_position();
    2 * axis + usize::from(point[axis] > 0.0)
}

/// A cube from -1 to 1 with cells on each side.
fn cube(cells: i32) -> Mesh {
    let mut mesh = Mesh::default();
    for (side, color) in COLORS.into_iter().enumerate() {
        let (axis, sign) = (side / 2, if side % 2 == 1 { 1.0 } else { -1.0 });
        let first = mesh.positions.len() as u32;
        let wide = cells as u32 + 1;
        for i in 0..wide * wide {
            let mut p = Vec3::ZERO;
            p[axis] = sign;
            p[(axis + 1) % 3] = 2.0 * (i % wide) as f32 / cells as f32 - 1.0;
            p[(axis + 2) % 3] = 2.0 * (i / wide) as f32 / cells as f32 - 1.0;
            let mut normal = Vec3::ZERO;
            normal[axis] = sign;
            mesh.positions.push(p.to_array());
            mesh.normals.push(normal.to_array());
            mesh.colors.push(color);
        }
        for i in 0..(cells * cells) as u32 {
            let a = first + i / cells as u32 * wide + i % cells as u32;
            let quad = [[a, a + 1, a + wide], [a + 1, a + wide + 1, a + wide]];
            mesh.triangles.extend(quad.map(|[a, b, c]| if sign > 0.0 { [a, b, c] } else { [a, c, b] }));
        }
    }
    mesh
}

/// Six cameras around the cube.
fn cameras() -> Vec<crate::camera::Camera> {
    let camera = |side: usize| {
        let mut from = DVec3::ZERO;
        from[side / 2] = if side % 2 == 1 { 4.0 } else { -4.0 };
        // Off the axis, so that `look_at` has an upper side.
        from += DVec3::new(0.013, 0.017, 0.011);
        crate::camera::Camera { focal: DVec2::splat(60.0), ..look_at(64, 64, from, DVec3::ZERO) }
    };
    (0..6).map(camera).collect()
}

/// What a camera sees of the cube: depth and point.
fn seen(camera: &crate::camera::Camera, pixel: usize) -> Option<(f64, Vec3)> {
    let at = DVec2::new((pixel % camera.width as usize) as f64, (pixel / camera.width as usize) as f64) + 0.5;
    let (from, ray) = (camera.center(), camera.ray(at));
    let (a, b) = ((-1.0 - from) / ray, (1.0 - from) / ray);
    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
    (enter < leave && enter > 0.0).then(|| (enter * ray.dot(camera.forward()), (from + ray * enter).as_vec3()))
}

fn map(camera: &crate::camera::Camera) -> DepthMap {
    let depths: Vec<f32> = (0..camera.pixels()).map(|i| seen(camera, i).map_or(0.0, |(z, _)| z as f32)).collect();
    DepthMap::new(*camera, &depths, None, &vec![0.0; 3 * camera.pixels()], 80.0)
}

/// The photo of a camera in an exposure.
fn photo(camera: &crate::camera::Camera, exposure: Exposure) -> TexturePhoto {
    let expose = |v: f32, c: usize| {
        ((v / 255.0 * exposure.log_gain[c].exp() + exposure.offset[c]) * 255.0).round().clamp(0.0, 255.0) as u8
    };
    let color = |point: Vec3, c: usize| f32::from(COLORS[side_of(point)][c]) + pattern(point);
    let pixel = |i: usize| match seen(camera, i) {
        Some((_, point)) => [0, 1, 2, 3].map(|c| if c < 3 { expose(color(point, c), c) } else { 255 }),
        // Nothing of it may come into the texture.
        None => [255; 4],
    };
    let rgba = (0..camera.pixels()).flat_map(pixel).collect();
    TexturePhoto { photo: Arc::new(Photo { width: camera.width, height: camera.height, rgba }), exposure }
}

fn textured(mesh: &Mesh, photos: &[TexturePhoto], size: u32) -> TexturedMesh {
    let maps: Vec<DepthMap> = cameras().iter().map(map).collect();
    TexturedMesh::new(mesh, &maps, photos, &TextureOptions { size, tolerance: 0.05 }, &()).unwrap()
}

fn photos() -> Vec<TexturePhoto> {
    cameras().iter().map(|camera| photo(camera, Exposure::default())).collect()
}

/// Texture coordinates of a triangle in texels.
fn corners(textured: &TexturedMesh, triangle: [u32; 3]) -> [Vec2; 3] {
    triangle.map(|i| Vec2::from(textured.uvs[i as usize]) * textured.image.width as f32)
}

/// Every texel in a triangle, with the point there.
fn texels(textured: &TexturedMesh, mut visit: impl FnMut(Vec3, [u8; 3])) {
    for &triangle in &textured.mesh.triangles {
        let points = triangle.map(|i| Vec3::from(textured.mesh.positions[i as usize]));
        covered(corners(textured, triangle), |x, y, w| {
            let first = 3 * (y as usize * textured.image.width as usize + x as usize);
            let color = textured.image.rgb[first..first + 3].try_into().unwrap();
            visit(points[0] * w.x + points[1] * w.y + points[2] * w.z, color);
        });
    }
}

/// Largest differences of a texel from its side's colour, without and with the pattern.
fn differences(point: Vec3, color: [u8; 3]) -> [f32; 2] {
    let off = |c: usize| f32::from(color[c]) - f32::from(COLORS[side_of(point)][c]);
    let largest = |more: f32| (0..3).map(|c| (off(c) - more).abs()).fold(0.0, f32::max);
    [largest(0.0), largest(pattern(point))]
}

#[test]
fn a_cube_that_six_photos_see_gets_its_six_colours() {
    let textured = textured(&cube(12), &photos(), 1024);
    assert!(textured.scale == 1.0 && textured.seen > 0.8, "{} {}", textured.scale, textured.seen);
    let mut found = [(0, 0.0_f32); 6];
    texels(&textured, |point, color| {
        let [plain, off] = differences(point, color);
        // At the edges of the cube the depth maps have an outline.
        let inner = point.abs().to_array().into_iter().filter(|&v| v < 0.85).count() == 2;
        assert!(if inner { off < 8.0 } else { plain.min(off) < 26.0 }, "{point}: {color:?} off by {plain} and {off}");
        let (count, largest) = &mut found[side_of(point)];
        (*count, *largest) = (*count + 1, largest.max(plain));
    });
    assert!(found.iter().all(|&(count, largest)| count > 300 && largest > 14.0), "{found:?}");
}

#[test]
fn charts_lie_apart_and_coordinates_within_the_texture() {
    for size in [1024, 150] {
        let textured = textured(&cube(7), &photos(), size);
        assert!(textured.image.width <= size && (textured.scale < 1.0) == (size == 150), "{}", textured.scale);
        assert_eq!(textured.mesh.triangles.len(), cube(7).triangles.len());
        assert!(textured.uvs.as_flattened().iter().all(|v| (0.0..=1.0).contains(v)));
        let mut owner = HashSet::new();
        for &triangle in &textured.mesh.triangles {
            covered(corners(&textured, triangle), |x, y, _| assert!(owner.insert((x, y)), "texel {x} {y} is in two"));
        }
        assert!(owner.len() > 1000, "{}", owner.len());
    }
}

/// A sheet that is folded over itself as the photo sees it: a chart has one layer.
#[test]
fn layers_are_charts_of_their_own() {
    let strip = |z: f32, first: u32| {
        let positions = [[-0.5, -0.5, z], [0.5, -0.5, z], [-0.5, 0.5, z], [0.5, 0.5, z]];
        (positions, [[first, first + 1, first + 2], [first + 1, first + 3, first + 2]])
    };
    let ((low, first), (high, second)) = (strip(0.0, 0), strip(0.01, 4));
    // A slope from the right end of the lower one to the left end of the upper one joins both.
    let slope = [[1, 4, 3], [4, 6, 3]];
    let triangles = [first, slope, second].concat();
    let positions = [low, high].concat();
    let mut mesh =
        Mesh { normals: vec![[0.0, 0.0, 1.0]; 8], colors: vec![[9; 3]; 8], positions, triangles, ..Mesh::default() };
    mesh.find_normals();
    let beyond = neighbours(&mesh.triangles);
    let charts = charts(&mesh, &[], &[None; 6], &vec![Vec::new(); 6], &beyond);
    assert!(charts.len() >= 2, "{}", charts.len());
    for chart in &charts {
        let mut owner = HashSet::new();
        chart.corners.iter().for_each(|&corners| covered(corners, |x, y, _| assert!(owner.insert((x, y)))));
    }
    assert_eq!(charts.iter().map(|chart| chart.triangles.len()).sum::<usize>(), 6);
}

#[test]
fn exposures_are_taken_away_and_masks_kept() {
    let exposures = (0..6).map(|i| {
        let log_gain = [-0.2 + 0.05 * i as f32, -0.1, 0.0 - 0.03 * i as f32];
        Exposure { log_gain, offset: [0.01, 0.02 * i as f32 / 5.0, 0.0] }
    });
    let mut photos: Vec<_> =
        cameras().iter().zip(exposures).map(|(camera, exposure)| photo(camera, exposure)).collect();
    // The photo of one side is masked.
    let mut masked = (*photos[3].photo).clone();
    masked.rgba.chunks_exact_mut(4).for_each(|pixel| pixel[3] = 100);
    photos[3].photo = Arc::new(masked);
    let mut largest = 0.0_f32;
    texels(&textured(&cube(12), &photos, 1024), |point, color| {
        let [plain, off] = differences(point, color);
        let inner = point.abs().to_array().into_iter().filter(|&v| v < 0.85).count() == 2;
        if side_of(point) == 3 {
            assert!(plain < 1.0, "{point}: {color:?}");
        } else {
            assert!(!inner || off < 9.0, "{point}: {color:?} off by {off}");
            largest = largest.max(plain);
        }
    });
    assert!(largest > 14.0, "{largest}");
}

/// Two photos of the same side that differ in their light: the texture has no step, and about the level of the vertices.
#[test]
fn photos_that_differ_meet_without_a_seam() {
    let camera = |x: f64| crate::camera::Camera {
        focal: DVec2::splat(150.0),
        ..look_at(160, 160, DVec3::new(x, -4.0, 0.02), DVec3::new(0.7 * x, -1.0, 0.0))
    };
    let cameras = [camera(-1.2), camera(1.2)];
    let maps: Vec<DepthMap> = cameras.iter().map(map).collect();
    let plain = |level: u8| {
        let rgba = [level, level, level, 255].repeat(160 * 160);
        TexturePhoto { photo: Arc::new(Photo { width: 160, height: 160, rgba }), exposure: Exposure::default() }
    };
    let mut side = cube(40);
    side.triangles.retain(|&[a, ..]| side.normals[a as usize][1] < 0.0);
    side.colors.fill([130; 3]);
    let options = TextureOptions { size: 512, tolerance: 0.1 };
    let textured = TexturedMesh::new(&side, &maps, &[plain(100), plain(160)], &options, &()).unwrap();
    let mut row: Vec<(f32, u8)> = Vec::new();
    texels(&textured, |point, color| {
        if point.z.abs() < 0.04 && point.x.abs() < 0.9 {
            row.push((point.x, color[0]));
        }
    });
    row.sort_by(|a, b| a.0.total_cmp(&b.0));
    assert!(row.len() > 40 && row.windows(2).all(|two| two[0].1.abs_diff(two[1].1) <= 4), "{row:?}");
    assert!(row.iter().all(|(_, level)| level.abs_diff(130) <= 15), "{row:?}");
}

#[test]
fn files_of_a_textured_mesh() {
    let textured = textured(&cube(2), &photos(), 256);
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    textured.write(&path("a.obj")).unwrap();
    let text = |name: &str| std::fs::read_to_string(path(name)).unwrap();
    let lines = |start: &str| text("a.obj").lines().filter(|line| line.starts_with(start)).count();
    let vertices = textured.mesh.positions.len();
    assert_eq!([lines("v "), lines("vt "), lines("vn "), lines("f ")], [vertices, vertices, vertices, 48]);
    assert!(text("a.obj").starts_with("mtllib a.mtl\nusemtl texture\n") && text("a.mtl").contains("\nmap_Kd a.png\n"));
    let image = image::open(path("a.png")).unwrap().to_rgb8();
    assert_eq!((image.width(), image.as_raw()), (textured.image.width, &textured.image.rgb));
    // Again over its own files, but not over those of something else.
    textured.write(&path("a.obj")).unwrap();
    std::fs::write(path("b.png"), "a picture").unwrap();
    std::fs::write(path("c.mtl"), "a material").unwrap();
    for (mesh, file) in [("b.obj", "b.png"), ("c.obj", "c.mtl")] {
        let before = std::fs::read(path(file)).unwrap();
        let told = textured.write(&path(mesh)).unwrap_err().to_string();
        assert!(told.contains(file) && told.contains("is there already"), "{told}");
        assert!(!path(mesh).exists() && std::fs::read(path(file)).unwrap() == before);
    }
    let told = MeshFormat::of_textured(&path("a.ply")).unwrap_err().to_string();
    assert!(told.contains("a.ply cannot have a texture"), "{told}");

    textured.write(&path("a.glb")).unwrap();
    let bytes = std::fs::read(path("a.glb")).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap();
    let buffer = &bytes[28 + word(12)..];
    assert_eq!((word(8), word(20 + word(12)), buffer.len() % 4), (bytes.len(), buffer.len(), 0));
    let view = |index: usize| {
        let number = |key: &str| json["bufferViews"][index][key].as_u64().unwrap() as usize;
        &buffer[number("byteOffset")..number("byteOffset") + number("byteLength")]
    };
    let attribute = json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"].as_u64().unwrap();
    assert_eq!(bytemuck::pod_collect_to_vec::<u8, [f32; 2]>(view(attribute as usize)), textured.uvs);
    let image = image::load_from_memory(view(json["images"][0]["bufferView"].as_u64().unwrap() as usize)).unwrap();
    assert_eq!(image.to_rgb8().as_raw(), &textured.image.rgb);
}
