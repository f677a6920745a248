//! What the inspection of a pixel tells, against whole images and the kernels' own results.

use crate::small::small_model;
use glam::{DMat3, DVec2, DVec3};
use ibgs_core::camera::Camera;
use ibgs_core::dataset::Photo;
use ibgs_core::inspect::{Inspection, SourceReading, Verdict};
use ibgs_core::local_space::LocalSpace;
use ibgs_core::raster::{RasterView, Room};
use ibgs_core::render::{ImagePart, Renderer};
use ibgs_core::scene::{Gaussians, Splats};
use ibgs_core::sources::find::SourceFinder;
use ibgs_core::sources::source_store::SourceStore;
use ibgs_core::sources::{SourceView, Warper};
use ibgs_reference::gpu::{gpu, rasterizer};
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// A model that has learned a little, and the camera of a test view.
fn model() -> &'static (Renderer, Camera) {
    static MODEL: OnceLock<(Renderer, Camera)> = OnceLock::new();
    MODEL.get_or_init(|| {
        let (renderer, dataset) = small_model();
        (renderer, dataset.views[dataset.test[0]].camera)
    })
}

/// What the kernels leave on the device for a view and its sources, made once more, in scene units. P pixels.
struct Warped {
    /// `[K, P]` of (depth, weight).
    intersections: Vec<[f32; 2]>,
    /// `[P]`, a source a byte.
    packed: Vec<u32>,
    /// `[V, P]` of colour and cosine.
    values: Vec<[f32; 4]>,
}

fn warped(renderer: &Renderer, camera: &Camera, sources: &[usize]) -> Warped {
    let (gpu, raster, part) = (gpu(), rasterizer(), renderer.part().unwrap());
    let space = renderer.space();
    let view = |camera: Camera| {
        let view = RasterView::new(camera, renderer.splats().sh_degree());
        RasterView { surface: Some(part.options.surface), ..view }
    };
    let source = |&index: &usize| {
        let camera = space.camera(&part.cameras[index]);
        let depth = raster.depth_map(renderer.splats(), &view(camera), Room::Checked).unwrap();
        SourceView { camera, photo: part.photos.photo(index).unwrap(), depth }
    };
    let sources: Vec<SourceView> = sources.iter().map(source).collect();
    let forward = raster.surface(renderer.splats(), &view(space.camera(camera))).unwrap();
    let warper = Warper::new(gpu.clone(), part.options.warp());
    let warped = warper.warp(&forward, &sources, warper.memory(camera).unwrap()).unwrap();
    let pixels = camera.pixels();
    let values = gpu.read(&warped.colors, warped.visible as usize * pixels).unwrap();
    let intersections = &forward.surface().unwrap().intersections;
    let intersections = gpu.read(intersections, part.options.surface.intersections as usize * pixels).unwrap();
    let in_scene_units = |[z, weight]: [f32; 2]| [(f64::from(z) * space.scale) as f32, weight];
    Warped {
        intersections: intersections.into_iter().map(in_scene_units).collect(),
        packed: gpu.read(&warped.seen.visible, pixels).unwrap(),
        values,
    }
}

fn visible_as(reading: &SourceReading) -> Option<u32> {
    match reading.verdict {
        Verdict::Used { number } => Some(number),
        _ => None,
    }
}

/// Whether the host's numbers, without the device's decision, say that the source sees the point.
fn sees(reading: &SourceReading) -> bool {
    reading.depth_error.is_some_and(|error| error < reading.depth_limit) && reading.color.is_some()
}

/// Whether some limit is within rounding.
fn is_close_call(found: &Inspection, part: &ImagePart) -> bool {
    let near_limit = |r: &SourceReading| r.depth_error.is_some_and(|error| (error - r.depth_limit).abs() < 1e-5);
    let near_edge = |r: &SourceReading, point: DVec3| {
        let camera = part.cameras[r.view];
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let uv = camera.project(point).0;
        (uv - 0.5).abs().min_element().min((size - 0.5 - uv).abs().min_element()) < 1e-3
    };
    let points = || found.point.into_iter().chain(found.intersections.iter().map(|i| i.point));
    found.sources.iter().any(|r| near_limit(r) || points().any(|point| near_edge(r, point)))
}

fn assert_near(what: &str, pixel: [u32; 2], ours: &[f32], theirs: &[f32], tolerance: f32) {
    let worst = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(ours.len() == theirs.len() && worst < tolerance, "{what} at {pixel:?}: {ours:?} against {theirs:?}");
}

/// The surface of one pixel: the kernel's intersections, points that lie on the pixel's ray, their mean depth.
fn check_surface(found: &Inspection, camera: &Camera, device: &Warped, intersections: usize) {
    let [x, y] = found.pixel;
    let (pixels, at) = ((camera.width * camera.height) as usize, (y * camera.width + x) as usize);
    let all = (0..intersections).map(|k| (device.intersections[k * pixels + at], k < intersections / 2));
    let expected: Vec<_> = all.filter(|([_, weight], _)| *weight > 0.0).collect();
    let ours: Vec<_> = found.intersections.iter().map(|i| ([i.depth, i.weight], i.before)).collect();
    assert_eq!(ours, expected, "intersections at {x}, {y}");
    assert_eq!(found.intersections.is_empty(), found.median_depth.is_none());
    assert_eq!(found.point.is_some(), found.median_depth.is_some());
    let depths = found.intersections.iter().map(|i| (i.depth, i.point));
    for (depth, point) in depths.chain(found.median_depth.zip(found.point)) {
        let (uv, z) = camera.project(point);
        assert!(uv.abs_diff_eq(DVec2::new(x.into(), y.into()) + 0.5, 1e-9) && (z - f64::from(depth)).abs() < 1e-6 * z);
    }
    if let Some(median) = found.median_depth {
        let weights: f32 = found.intersections.iter().map(|i| i.weight).sum();
        let mean = found.intersections.iter().map(|i| i.weight * i.depth).sum::<f32>() / weights;
        assert_near("median depth", found.pixel, &[median], &[mean], 1e-5 * mean);
    }
}

/// The sources of one pixel against the kernel's visible sources and warped values.
fn check_sources(found: &Inspection, camera: &Camera, device: &Warped, visible: usize) {
    let [x, y] = found.pixel;
    let (pixels, at) = ((camera.width * camera.height) as usize, (y * camera.width + x) as usize);
    let packed = device.packed[at].to_le_bytes();
    for (number, reading) in found.sources.iter().enumerate() {
        // The upper half of a byte has the error of the depth.
        let place = packed.iter().position(|&byte| byte != 255 && usize::from(byte & 15) == number);
        assert_eq!(visible_as(reading), place.map(|number| number as u32), "visible source {number} at {x}, {y}");
        if let (Some(number), Some(color)) = (place, reading.color) {
            let [r, g, b, cosine] = device.values[number * pixels + at];
            assert_near("warped colour", found.pixel, &color, &[r, g, b], 1e-3);
            assert_near("cosine", found.pixel, &[reading.cosine], &[cosine], 1e-5);
        }
        assert_eq!(reading.reads.len(), found.intersections.len());
        assert_eq!(reading.color.is_some(), reading.reads.iter().any(Option::is_some));
        assert!(reading.place.is_some() || reading.depth_error.is_none());
        let full = packed[..visible].iter().all(|&byte| byte != 255);
        match reading.verdict {
            Verdict::Behind | Verdict::Outside => assert_eq!(reading.place, None),
            Verdict::NoDepth => assert!(reading.place.is_some() && reading.depth_error.is_none()),
            Verdict::Enough => assert!(full && sees(reading)),
            Verdict::Unreadable => assert_eq!(reading.color, None),
            Verdict::Used { .. } | Verdict::Hidden => {}
        }
    }
}

/// One pixel in 23 of three views; the verdicts, and how many differ from the device's by rounding.
fn check_views(renderer: &Renderer, test: &Camera) -> (BTreeMap<String, usize>, usize) {
    let part = renderer.part().unwrap();
    let (intersections, visible) = (part.options.surface.intersections as usize, part.options.sources.visible as usize);
    // A view that nobody took, beside the test view, and a training view, which is no source of itself.
    let aside = Camera { translation: test.translation + DVec3::new(0.1, -0.05, 0.1), ..*test };
    let finder = SourceFinder::new(&part.cameras, &part.options.sources);
    let (mut verdicts, mut flipped) = (BTreeMap::new(), 0);
    for (camera, own) in [(*test, None), (aside, None), (part.cameras[3], Some(3))] {
        let frame = renderer.render(&camera).unwrap();
        let (base, image) = (frame.base().unwrap().rgb, frame.image().unwrap().unwrap().rgb);
        let (depths, normals) = (frame.depth().unwrap().unwrap(), frame.normals().unwrap().unwrap());
        let sources = finder.sources(&camera, own);
        assert!(!sources.is_empty());
        let device = warped(renderer, &camera, &sources);
        for at in (0..depths.len()).step_by(23) {
            let (x, y) = (at as u32 % camera.width, at as u32 / camera.width);
            let found = frame.inspect(x, y).unwrap().unwrap();
            assert_eq!((found.pixel, &found.base[..]), ([x, y], &base[3 * at..][..3]));
            assert_eq!(&found.image.unwrap(), &image[3 * at..][..3]);
            assert_eq!(found.residual.unwrap(), std::array::from_fn(|c| image[3 * at + c] - base[3 * at + c]));
            assert_eq!(&found.normal.unwrap_or_default(), &normals[3 * at..][..3]);
            assert_eq!(found.median_depth, frame.depth_at(x, y).unwrap());
            assert_eq!(found.median_depth.unwrap_or(0.0), depths[at]);
            check_surface(&found, &camera, &device, intersections);
            if found.median_depth.is_none() {
                assert!(found.sources.is_empty() && device.packed[at] == u32::MAX);
                continue;
            }
            assert_eq!(found.sources.iter().map(|r| r.view).collect::<Vec<_>>(), sources);
            check_sources(&found, &camera, &device, visible);
            // The first that see the point by the host's numbers are those that the device uses.
            let seers = found.sources.iter().filter(|r| sees(r)).take(visible);
            let mut used: Vec<&SourceReading> = found.sources.iter().filter(|r| visible_as(r).is_some()).collect();
            used.sort_by_key(|r| visible_as(r));
            if !seers.eq(used) {
                assert!(is_close_call(&found, part), "{found:?}");
                flipped += 1;
            }
            for reading in &found.sources {
                *verdicts.entry(format!("{:?}", reading.verdict)).or_default() += 1;
            }
        }
    }
    (verdicts, flipped)
}

#[test]
fn pixels_say_what_images_and_kernels_say() {
    let (renderer, camera) = model();
    // The depths of so short a training hardly agree; with a wider limit many sources see many points.
    let mut part = renderer.part().unwrap().clone();
    part.options.sources.depth_agreement = 0.08;
    let lenient = Renderer::new(Arc::new(rasterizer()), renderer.splats().clone(), [0.0; 3], Some(part));
    for (renderer, expected) in [
        (renderer, &["Used { number: 0 }", "Hidden", "Outside"][..]),
        (&lenient, &["Used { number: 0 }", "Used { number: 1 }", "Used { number: 2 }", "Enough", "Hidden", "Outside"]),
    ] {
        let (verdicts, flipped) = check_views(renderer, camera);
        println!("{verdicts:?}, {flipped} pixels otherwise by rounding");
        assert!(flipped <= 2, "{flipped} pixels");
        for verdict in expected {
            assert!(verdicts.get(*verdict).is_some_and(|&n| n >= 10), "hardly ever {verdict}: {verdicts:?}");
        }
    }
}

/// A wall at depth 4, and before it a ball that one of the sources looks at: each source has its own verdict.
#[test]
fn every_verdict_has_its_reason() {
    let part = model().0.part().unwrap();
    let camera = Camera {
        width: 48,
        height: 36,
        focal: DVec2::splat(48.0),
        // The ray of pixel (24, 18) is the optical axis.
        principal: DVec2::new(24.5, 18.5),
        view_from_world: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };
    let scene = Gaussians {
        space: LocalSpace::default(),
        means: vec![[0.0, 0.0, 4.0], [0.5, 0.0, 2.0]],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        log_scales: vec![[2.0, 2.0, -5.0], [-2.3; 3]],
        opacity_logits: vec![8.0; 2],
        sh: vec![0.5; 6],
        sh_degree: 0,
        normals: vec![[0.0, 0.0, -1.0]; 2],
        offsets: vec![0.0; 2],
        antialiased: false,
    };
    // Where the sources stand, nearest first, and what comes of it. At 3.95 the wall is nearer than anything is drawn.
    let sources = [
        (DVec3::X * 1e-3, Verdict::Used { number: 0 }),
        (DVec3::X * 2e-3, Verdict::Enough),
        (DVec3::X * 3e-3, Verdict::Unreadable),
        (DVec3::X, Verdict::Hidden),
        (DVec3::Z * 3.95, Verdict::NoDepth),
        (DVec3::Z * 10.0, Verdict::Behind),
        (DVec3::X * 20.0, Verdict::Outside),
    ];
    let photo = |index: usize| {
        let alpha = if sources[index].1 == Verdict::Unreadable { 127 } else { 128 };
        Photo { width: 48, height: 36, rgba: [10 * index as u8, 100, 200, alpha].repeat(48 * 36) }.into()
    };
    let photos = Arc::new(SourceStore::new(gpu(), (0..sources.len()).map(photo).collect(), None).unwrap());
    let cameras = sources.iter().map(|(center, _)| Camera { translation: -*center, ..camera }).collect();
    let mut options = part.options.clone();
    options.sources.used = sources.len() as u32;
    options.sources.visible = 1;
    (options.sources.min_distance, options.sources.max_distance) = (Some(0.0), Some(100.0));
    let part = ImagePart { cameras, photos, network: part.network.clone(), options };
    let splats = Splats::upload(&scene, &gpu()).unwrap();
    let renderer = Renderer::new(Arc::new(rasterizer()), splats, [0.0; 3], Some(part));
    let found = renderer.render(&camera).unwrap().inspect(24, 18).unwrap().unwrap();

    let verdicts: Vec<_> = found.sources.iter().map(|r| (r.view, r.verdict)).collect();
    assert_eq!(verdicts, sources.iter().map(|s| s.1).enumerate().collect::<Vec<_>>());
    let [wall] = &found.intersections[..] else { panic!("{found:?}") };
    assert!(wall.before && (wall.weight - 0.99).abs() < 1e-5 && wall.point.abs_diff_eq(DVec3::Z * 4.0, 1e-5));
    assert_near("normal", found.pixel, &found.normal.unwrap(), &[0.0, 0.0, -0.99], 1e-5);
    let errors: Vec<_> = found.sources.iter().map(|r| r.depth_error).collect();
    assert!(errors[..3].iter().all(|error| error.unwrap() < 1e-5), "{errors:?}");
    assert!((errors[3].unwrap() - 0.5).abs() < 0.01 && errors[4..] == [None; 3], "{errors:?}");
    for (i, reading) in found.sources.iter().enumerate() {
        // Five times what agrees: a confidence weighs the sources.
        assert!((reading.depth_limit - 0.05).abs() < 1e-6, "{reading:?}");
        if reading.depth_error.is_some() && reading.verdict != Verdict::Unreadable {
            // What a photo has there is told of those that are not used too.
            let rgb = [10.0 * i as f32, 100.0, 200.0].map(|v| v / 255.0);
            assert_near("colour", found.pixel, &reading.color.unwrap(), &rgb, 1e-5);
            let step = DVec2::X * sources[i].0.x * 12.0;
            assert!(reading.place.unwrap().abs_diff_eq(camera.principal - step, 1e-5), "{reading:?}");
            assert!((f64::from(reading.cosine) - 4.0 / sources[i].0.x.hypot(4.0)).abs() < 1e-5);
        }
    }
}

/// A frame tells the same whatever is rendered or forgotten after it.
#[test]
fn a_frame_keeps_what_it_was_made_from() {
    let (renderer, camera) = model();
    let frame = renderer.render(camera).unwrap();
    let look = || (0..48).map(|x| frame.inspect(x, 7 * x % 36).unwrap()).collect::<Vec<_>>();
    let before = look();
    assert!(before.iter().flatten().any(|found| found.sources.iter().any(|r| visible_as(r).is_some())));
    renderer.forget_depths();
    let part = renderer.part().unwrap();
    let _others: Vec<_> = part.cameras.iter().step_by(9).map(|other| renderer.render(other).unwrap()).collect();
    assert_eq!(before, look());
}

#[test]
fn models_and_pixels_that_have_less() {
    let (renderer, camera) = model();
    let frame = renderer.render(camera).unwrap();
    for (x, y) in [(camera.width, 0), (0, camera.height), (u32::MAX, u32::MAX)] {
        assert_eq!(frame.inspect(x, y).unwrap(), None);
    }
    // Without a network, with and without a surface.
    let plain = || Renderer::new(Arc::new(rasterizer()), renderer.splats().clone(), [0.25, 0.5, 0.75], None);
    let (bare, surface) = (plain().render(camera).unwrap(), plain().showing_surface().render(camera).unwrap());
    let (x, y) = (camera.width / 2, camera.height / 2);
    let at = 3 * (y * camera.width + x) as usize;
    let found = bare.inspect(x, y).unwrap().unwrap();
    let base = bare.base().unwrap().rgb[at..at + 3].try_into().unwrap();
    assert_eq!(found, Inspection { pixel: [x, y], base, ..Inspection::default() });
    let found = surface.inspect(x, y).unwrap().unwrap();
    assert!(found.image.is_none() && found.residual.is_none() && found.sources.is_empty());
    assert!(found.median_depth.is_some() && found.normal.is_some() && !found.intersections.is_empty());
    // Looking away from everything.
    let center = camera.center() - 100.0 * camera.forward();
    let turned = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)) * camera.view_from_world;
    let away = Camera { view_from_world: turned, translation: -(turned * center), ..*camera };
    let found = plain().showing_surface().render(&away).unwrap().inspect(0, 0).unwrap().unwrap();
    assert_eq!(found, Inspection { base: [0.25, 0.5, 0.75], ..Inspection::default() });
}
