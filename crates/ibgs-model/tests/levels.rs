//! Levels of detail: the bundle, and its chunks on the device.

use glam::{DMat3, DVec2, DVec3};
use ibgs_data::camera::Camera;
use ibgs_data::scene::Gaussians;
use ibgs_model::bundle::{Bundle, Packing};
use ibgs_model::config::{Method, TrainConfig};
use ibgs_model::model::{Model, ModelError, ModelOptions};
use ibgs_model::output::cameras::CameraRecord;
use ibgs_reference::gpu::gpu;
use ibgs_render::gpu::GpuError;
use ibgs_render::levels::{CHUNK, Levels, Loading, Stream, slots};
use ibgs_render::raster::Rasterizer;
use ibgs_render::render::Renderer;
use ibgs_render::scene::{Harmonics, Splats};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// At a place, looking along z.
pub fn camera(x: f64, z: f64) -> Camera {
    Camera {
        width: 96,
        height: 64,
        focal: DVec2::splat(60.0),
        principal: DVec2::new(48.0, 32.0),
        view_from_world: DMat3::IDENTITY,
        translation: -DVec3::new(x, 0.0, z),
    }
}

/// A long wall of small Gaussians, whose colours change slowly along it.
fn wall(n: usize) -> Gaussians {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut g = Gaussians::with_capacity(n, 0);
    for _ in 0..n {
        let [x, y] = [rng.random_range(-40.0..40.0), rng.random_range(-2.0f32..2.0)];
        g.means.push([x, y, rng.random_range(0.0..0.2)]);
        g.rotations.push([1.0, 0.0, 0.0, 0.0]);
        g.log_scales.push([-3.2, -3.2, -4.5]);
        g.opacity_logits.push(2.0);
        g.sh.extend([(0.3 * x).sin(), y / 2.0, (0.2 * x + y).cos()]);
        g.normals.push([0.0, 0.0, -1.0]);
        g.offsets.push(0.0);
    }
    g
}

fn bundle(gaussians: Gaussians) -> Bundle {
    let record = |(name, x): (&str, f64)| CameraRecord { name: name.to_owned(), split: None, camera: camera(x, -6.0) };
    Bundle {
        iteration: 1,
        gaussians,
        members: Vec::new(),
        levels: None,
        network: None,
        exposure: None,
        cameras: [("a", -8.0), ("b", 8.0)].map(record).to_vec(),
        config: TrainConfig { method: Method::Gs3, ..TrainConfig::default() },
        photos: Vec::new(),
        sources: Vec::new(),
    }
}

fn written(folder: &Path, gaussians: &Gaussians) -> Arc<Levels> {
    let path = folder.join("wall.ibgs");
    bundle(gaussians.clone()).write(&path, Packing::Levels).unwrap();
    Bundle::read(&path).unwrap().levels.unwrap()
}

fn renderer((stream, splats): (Stream, Splats)) -> Renderer {
    Renderer::new(Arc::new(Rasterizer::new(gpu())), splats, [0.0; 3], None).with_stream(stream)
}

fn image(renderer: &Renderer, camera: &Camera) -> Vec<f32> {
    renderer.render(camera).unwrap().base().unwrap().rgb
}

/// The image once no more chunks are to come.
#[track_caller]
fn at_rest(renderer: &Renderer, camera: &Camera) -> Vec<f32> {
    for _ in 0..1_000 {
        let last = image(renderer, camera);
        if !renderer.stream().unwrap().is_waiting() {
            return last;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("the view of {:?} never comes to rest", camera.center());
}

fn psnr(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (sum / a.len() as f64).log10()
}

/// A model with fewer places than chunks shows, at rest, what the whole one shows.
#[test]
fn a_part_of_the_chunks_shows_the_view() {
    let folder = tempfile::tempdir().unwrap();
    let levels = written(folder.path(), &wall(12 * CHUNK));
    let leaves = levels.leaves().count();
    assert!(leaves == 16 && levels.len() == 12 * CHUNK && levels.chunk() <= CHUNK);
    let whole = Splats::upload(&levels.whole().unwrap(), &gpu()).unwrap();
    let whole = Renderer::new(Arc::new(Rasterizer::new(gpu())), whole, [0.0; 3], None);
    let complete = renderer(Stream::new(levels.clone(), &gpu(), 12, Loading::Complete, Harmonics::Half).unwrap());
    // Some places are for the coarsest chunks and for those of the last view.
    let moving = renderer(Stream::new(levels.clone(), &gpu(), 15, Loading::AsItComes(1), Harmonics::Half).unwrap());
    assert_eq!(complete.splats().len(), 12 * levels.chunk());
    for x in [-20.0, 0.0, 15.0, -20.0] {
        let camera = camera(x, -6.0);
        let expected = image(&whole, &camera);
        let shown = image(&complete, &camera);
        let error = psnr(&shown, &expected);
        assert!(error >= 45.0, "{error} dB at {x}");
        assert!(!complete.stream().unwrap().is_waiting());
        // A frame that does not wait is there at once, and becomes the same after some more.
        let error = psnr(&at_rest(&moving, &camera), &expected);
        assert!(error >= 45.0, "{error} dB at {x} at rest");
        assert!(moving.stream().unwrap().shown() <= 15 * levels.chunk());
    }
    // From afar a part of the Gaussians is enough.
    let far = camera(0.0, -30.0);
    let error = psnr(&image(&complete, &far), &image(&whole, &far));
    assert!(error >= 30.0, "{error} dB from afar");
    assert!(complete.stream().unwrap().shown() <= levels.len() / 2);
}

/// With few places a view may need both finer and coarser chunks than the last one: every view comes to rest.
#[test]
fn every_view_comes_to_rest() {
    let folder = tempfile::tempdir().unwrap();
    let levels = written(folder.path(), &wall(12 * CHUNK));
    for places in 4..9 {
        let moving =
            renderer(Stream::new(levels.clone(), &gpu(), places, Loading::AsItComes(1), Harmonics::Half).unwrap());
        let complete =
            renderer(Stream::new(levels.clone(), &gpu(), places, Loading::AsItComes(1), Harmonics::Half).unwrap());
        for (x, z) in [(-20.0, -3.0), (20.0, -3.0), (0.0, -60.0), (18.0, -3.0), (-35.0, -2.0)] {
            let camera = camera(x, z);
            let last = at_rest(&moving, &camera);
            // As a film does.
            complete.complete(&camera).unwrap();
            let film = image(&complete, &camera);
            assert!(!complete.stream().unwrap().is_waiting());
            assert!(psnr(&last, &film) > 20.0, "{places} places at {x}, {z}: {} dB", psnr(&last, &film));
        }
    }
}

#[test]
fn memory_decides_how_many_chunks_fit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall.ibgs");
    bundle(wall(9 * CHUNK)).write(&path, Packing::Levels).unwrap();
    let levels = Bundle::read(&path).unwrap().levels.unwrap();
    let leaves = levels.leaves().count();
    assert_eq!(slots(&levels, None, &gpu(), Harmonics::Half).unwrap(), leaves);
    let some = slots(&levels, Some(24 << 20), &gpu(), Harmonics::Half).unwrap();
    assert!((4..leaves).contains(&some), "{some}");
    let error = slots(&levels, Some(1 << 20), &gpu(), Harmonics::Half).unwrap_err();
    assert!(matches!(&error, GpuError::FewChunks { mib } if *mib > 0), "{error}");
    // A model that fits is on the device as a whole.
    let mut model = Model::open(&path, &ModelOptions::default()).unwrap();
    // Its options name no scene, and this program makes none.
    assert!(matches!(model.dataset(&()), Err(ModelError::NotMade { .. })));
    let renderer = model.renderer(&gpu()).unwrap();
    assert!(renderer.stream().is_none() && renderer.splats().len() == 9 * CHUNK);
    let options = ModelOptions { gpu_memory: "24MiB".parse().unwrap(), ..ModelOptions::default() };
    let small = Model::open(&path, &options).unwrap().renderer(&gpu()).unwrap();
    assert_eq!(small.splats().len(), some * levels.chunk());
    model.expand().unwrap();
    assert!(model.gaussians.len() == 9 * CHUNK && model.levels.is_none());
}

#[test]
fn damage_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall.ibgs");
    bundle(wall(2 * CHUNK)).write(&path, Packing::Levels).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let error = Model::from_bundle(&bytes, Path::new("elsewhere.ibgs"), &ModelOptions::default()).unwrap_err();
    assert!(error.to_string().contains("can only be read from a file"), "{error}");
    // A number of the last chunk that is none.
    let end = bytes.windows(4).rposition(|four| four == 2f32.to_le_bytes()).unwrap();
    bytes[end..end + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    let levels = Bundle::read(&path).unwrap().levels.unwrap();
    let error = (0..levels.nodes.len() as u32).find_map(|node| levels.read(node).err()).unwrap();
    assert!(error.to_string().contains("wall.ibgs") && error.to_string().contains("damaged"), "{error}");
    let text = |find: &str, put: &str| {
        let mut damaged = bytes.clone();
        let at = damaged.windows(find.len()).position(|window| window == find.as_bytes()).unwrap();
        damaged[at..at + put.len()].copy_from_slice(put.as_bytes());
        std::fs::write(&path, &damaged).unwrap();
        Bundle::read(&path).unwrap_err().to_string()
    };
    for (find, put) in [("\"children\":[1,2]", "\"children\":[1,1]"), ("\"sh_degree\":0", "\"sh_degree\":3")] {
        let error = text(find, put);
        assert!(error.contains("levels."), "{error}");
    }
}
