//! Renders the held-out views of a model from a mesh of `ibgs mesh`, without a GPU, and compares them with their photos.
//!
//! ```sh
//! cargo run --release --example mesh_views -- output/my-scene my-scene.glb pictures
//! ```

#![expect(clippy::print_stdout, reason = "an example")]

use glam::{DVec3, Vec2, Vec3};
use ibgs_core::camera::Camera;
use ibgs_core::exposure::Exposure;
use ibgs_core::image_io::write_png;
use ibgs_core::model::{Model, ModelOptions};
use serde_json::Value;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

/// Samples along the side of a pixel.
const SAMPLES: u32 = 2;

/// How a mesh is coloured.
enum Colors {
    /// By its vertices, sRGB.
    Vertices(Vec<Vec3>),
    /// By a texture at the coordinates of the vertices.
    Texture(Vec<Vec2>, image::RgbImage),
}

struct Mesh {
    offset: DVec3,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    colors: Colors,
}

fn main() -> Result<(), Box<dyn Error>> {
    let paths: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [model, mesh, folder] = &paths[..] else { return Err("give a model, a `.glb` and a folder".into()) };
    let mesh = read(mesh)?;
    let mut model = Model::open(
        model,
        &ModelOptions { make_scene: Some(ibgs::commands::train::demo::MAKE_DEMO), ..ModelOptions::default() },
    )?;
    let field = model.exposure_field()?;
    let scene = model.dataset(&())?;
    fs::create_dir_all(folder)?;
    let (mut sum, mut covered, mut pixels) = (0.0, 0, 0);
    for &index in &scene.test {
        let view = &scene.views[index];
        let exposure = field.as_ref().map_or_else(Exposure::default, |field| field.at(&view.camera));
        let image = render(&mesh, &view.camera);
        let photo = view.photo.pixels()?;
        let (mut error, mut compared, mut bytes) = (0.0, 0, Vec::new());
        for (pixel, photo) in image.iter().zip(photo.rgba.chunks_exact(4)) {
            let shown = pixel.map(|color| expose(color, &exposure));
            bytes.extend(shown.unwrap_or_default().to_array().map(|v| (v * 255.0).round() as u8));
            if let Some(color) = shown.filter(|_| photo[3] >= 128) {
                error += f64::from(
                    (color - Vec3::new(photo[0].into(), photo[1].into(), photo[2].into()) / 255.0).length_squared(),
                );
                compared += 3;
            }
        }
        let psnr = -10.0 * (error / f64::from(compared.max(1))).log10();
        println!("{}: {psnr:.2} dB", view.name);
        let name = Path::new(&view.name).with_extension("png");
        write_png(&folder.join(name.file_name().unwrap_or_default()), photo.width, photo.height, &bytes)?;
        (sum, covered, pixels) = (sum + psnr, covered + compared, pixels + 3 * image.len());
    }
    let part = 100.0 * f64::from(covered) / pixels as f64;
    println!(
        "mean {:.2} dB of {} views, over {part:.1} % of the pixels",
        sum / scene.test.len() as f64,
        scene.test.len()
    );
    Ok(())
}

fn expose(color: Vec3, exposure: &Exposure) -> Vec3 {
    let gain = Vec3::from(exposure.log_gain.map(f32::exp));
    (color * gain + Vec3::from(exposure.offset)).clamp(Vec3::ZERO, Vec3::ONE)
}

/// The colours that a camera sees; none where less than half of a pixel shows the mesh.
fn render(mesh: &Mesh, camera: &Camera) -> Vec<Option<Vec3>> {
    let fine = camera.resized(SAMPLES * camera.width, SAMPLES * camera.height);
    let points: Vec<DVec3> = mesh.positions.iter().map(|p| fine.to_view(mesh.offset + p.as_dvec3())).collect();
    // The nearest inverse depth, and which point of which triangle it is.
    let mut nearest = vec![(0.0_f64, 0_usize, Vec3::ZERO); fine.pixels()];
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        let corners = triangle.map(|i| points[i as usize]);
        if corners.iter().all(|p| p.z > 1e-6) {
            draw(corners, &fine, |at, inverse, weights| {
                if inverse > nearest[at].0 {
                    nearest[at] = (inverse, index, weights);
                }
            });
        }
    }
    let width = fine.width as usize;
    let pixel = |i: usize| {
        let (x, y) = (i % camera.width as usize, i / camera.width as usize);
        let side = 0..SAMPLES as usize;
        let samples = side.clone().flat_map(|dy| side.clone().map(move |dx| (dx, dy)));
        let places = samples.map(|(dx, dy)| (SAMPLES as usize * y + dy) * width + SAMPLES as usize * x + dx);
        let hit: Vec<Vec3> =
            places.filter(|&at| nearest[at].0 > 0.0).map(|at| mesh.color(nearest[at].1, nearest[at].2)).collect();
        (2 * hit.len() >= (SAMPLES * SAMPLES) as usize).then(|| hit.iter().sum::<Vec3>() / hit.len() as f32)
    };
    (0..camera.pixels()).map(pixel).collect()
}

/// Calls `visit` with index, inverse depth and weights of the corners for each pixel of a triangle.
fn draw(corners: [DVec3; 3], camera: &Camera, mut visit: impl FnMut(usize, f64, Vec3)) {
    let flat = corners.map(|p| camera.focal * p.truncate() / p.z + camera.principal);
    let area = (flat[1] - flat[0]).perp_dot(flat[2] - flat[0]);
    let size = glam::DVec2::new(camera.width.into(), camera.height.into());
    let low = (flat[0].min(flat[1]).min(flat[2]) - 0.5).ceil().max(glam::DVec2::ZERO);
    let high = (flat[0].max(flat[1]).max(flat[2]) - 0.5).floor().min(size - 1.0);
    if area == 0.0 || !(low.x <= high.x && low.y <= high.y) {
        return;
    }
    for y in low.y as u32..=high.y as u32 {
        for x in low.x as u32..=high.x as u32 {
            let at = glam::DVec2::new(x.into(), y.into()) + 0.5;
            let part = |a: usize, b: usize| (flat[b] - flat[a]).perp_dot(at - flat[a]) / area;
            let parts = [part(1, 2), part(2, 0), part(0, 1)];
            if parts.iter().all(|&v| v >= 0.0) {
                let inverses = [0, 1, 2].map(|i| parts[i] / corners[i].z);
                let inverse = inverses.iter().sum::<f64>();
                visit((y * camera.width + x) as usize, inverse, inverses.map(|v| (v / inverse) as f32).into());
            }
        }
    }
}

impl Mesh {
    fn color(&self, triangle: usize, weights: Vec3) -> Vec3 {
        let vertices = self.triangles[triangle].map(|i| i as usize);
        let (a, b, c) = (weights.x, weights.y, weights.z);
        match &self.colors {
            Colors::Vertices(colors) => colors[vertices[0]] * a + colors[vertices[1]] * b + colors[vertices[2]] * c,
            Colors::Texture(uvs, image) => {
                let uv = uvs[vertices[0]] * a + uvs[vertices[1]] * b + uvs[vertices[2]] * c;
                let at = uv * Vec2::new(image.width() as f32, image.height() as f32) - 0.5;
                let (low, part) = (at.floor(), at - at.floor());
                let read = |dx: f32, dy: f32| {
                    let last = Vec2::new(image.width() as f32, image.height() as f32) - 1.0;
                    let place = (low + Vec2::new(dx, dy)).clamp(Vec2::ZERO, last).as_uvec2();
                    Vec3::from(image.get_pixel(place.x, place.y).0.map(f32::from)) / 255.0
                };
                let [top, bottom] = [0.0, 1.0].map(|dy| read(0.0, dy).lerp(read(1.0, dy), part.x));
                top.lerp(bottom, part.y)
            }
        }
    }
}

/// Reads a mesh of `ibgs mesh`.
fn read(path: &Path) -> Result<Mesh, Box<dyn Error>> {
    let bytes = fs::read(path)?;
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let length = word(12).ok_or("no binary glTF")?;
    let document: Value = serde_json::from_slice(bytes.get(20..20 + length).ok_or("it is cut off")?)?;
    let view = |index: &Value| -> Option<&[u8]> {
        let view = &document["bufferViews"][index.as_u64()? as usize];
        let first = 28 + length + view["byteOffset"].as_u64().unwrap_or(0) as usize;
        bytes.get(first..first + view["byteLength"].as_u64()? as usize)
    };
    let primitive = &document["meshes"][0]["primitives"][0];
    let data = |accessor: &Value| view(&document["accessors"][accessor.as_u64()? as usize]["bufferView"]);
    let floats = |accessor: &Value| -> Option<Vec<f32>> {
        Some(data(accessor)?.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect())
    };
    let attributes = &primitive["attributes"];
    let positions = floats(&attributes["POSITION"]).ok_or("no positions")?;
    let indices = data(&primitive["indices"]).ok_or("no indices")?.as_chunks::<4>().0;
    let indices: Vec<u32> = indices.iter().map(|&b| u32::from_le_bytes(b)).collect();
    let colors = match (floats(&attributes["TEXCOORD_0"]), data(&attributes["COLOR_0"])) {
        (Some(uvs), _) => {
            let image = image::load_from_memory(view(&document["images"][0]["bufferView"]).ok_or("no texture")?)?;
            Colors::Texture(uvs.as_chunks::<2>().0.iter().map(|&uv| uv.into()).collect(), image.to_rgb8())
        }
        (None, Some(colors)) => {
            let srgb = |v: f32| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
            let value = |c: &[u8; 8], i: usize| srgb(f32::from(u16::from_le_bytes([c[2 * i], c[2 * i + 1]])) / 65535.0);
            Colors::Vertices(
                colors.as_chunks::<8>().0.iter().map(|c| Vec3::from([0, 1, 2].map(|i| value(c, i)))).collect(),
            )
        }
        (None, None) => return Err("neither colours nor a texture".into()),
    };
    let offset = &document["nodes"][0]["translation"];
    Ok(Mesh {
        offset: DVec3::from([0, 1, 2].map(|i| offset[i].as_f64().unwrap_or(0.0))),
        positions: positions.as_chunks::<3>().0.iter().map(|&p| p.into()).collect(),
        triangles: indices.as_chunks::<3>().0.to_vec(),
        colors,
    })
}
