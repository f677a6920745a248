//! Exposure correction against its twins.

use crate::common::{gpu, values};
use crate::reference::adam::Adam;
use crate::reference::exposure::{Affine, Maps, Object, exposed_loss, exposed_loss_backward, fit};
use crate::reference::image_loss::Map;
use crate::reference::random_scene::random_image;
use crate::reference::relative_error;
use burn::tensor::{Tensor, TensorData};
use glam::{DMat3, DVec3};
use ibgs_core::dataset::Photo;
use ibgs_core::fuse::{ExposedColors, ExposureFit, Reach};
use ibgs_core::gpu::{Buffer, Gpu, Pass};
use ibgs_core::loss::{ExposureAdam, ExposureScalars, ImageLoss, Outside, Target};

fn float(map: Map) -> Map {
    map.into_iter().map(|p| p.map(|v| f64::from(v as f32))).collect()
}

fn upload(gpu: &Gpu, map: &[[f64; 3]]) -> Buffer {
    let flat: Vec<f32> = map.as_flattened().iter().map(|v| *v as f32).collect();
    gpu.upload("map", &flat).unwrap()
}

fn read(gpu: &Gpu, buffer: &Buffer, count: usize) -> Vec<f64> {
    gpu.read::<f32>(buffer, count).unwrap().into_iter().map(f64::from).collect()
}

/// A known change of exposure with some mixing of the channels.
fn known() -> Affine {
    let rows = DMat3::from_cols_array(&[1.3, 0.05, -0.02, 0.04, 0.9, 0.03, -0.06, 0.01, 1.1]);
    Affine { linear: rows.transpose(), offset: DVec3::new(0.02, -0.05, 0.1) }
}

/// Fits on the GPU; what is not visible holds another source or nothing, and NaN.
fn on_gpu(base: &Map, warped: &Map, visible: &[bool], size: [u32; 2]) -> Vec<f64> {
    let gpu = gpu();
    let seen = |(i, v): (usize, &bool)| if *v { 0x00ff_0200 } else { [0xffff_ff01, 0xffff_ffff][i % 2] };
    let seen: Vec<u32> = visible.iter().enumerate().map(seen).collect();
    let row = |(p, v): (&[f64; 3], &bool)| {
        let [r, g, b] = p.map(|v| v as f32);
        if *v { [r, g, b, 0.7] } else { [f32::NAN; 4] }
    };
    // A second slot behind the first.
    let mut flat: Vec<f32> = warped.iter().zip(visible).flat_map(row).collect();
    flat.resize(2 * flat.len(), f32::NAN);
    let (warped, seen) = (gpu.upload("warped", &flat).unwrap(), gpu.upload("seen", &seen).unwrap());
    let fit = ExposureFit::new(&gpu).unwrap();
    let mut pass = Pass::new(&gpu, "test");
    let base = upload(&gpu, base);
    let reach = Reach::Everywhere;
    let colors = ExposedColors { base: &base, warped: &warped, seen: &seen, slots: 2, sources: 1, reach, size };
    fit.record_fit(&mut pass, &colors, None);
    pass.submit();
    let maps = read(&gpu, &fit.maps, 24);
    assert_eq!(maps[..12], maps[12..], "the output has the exposure of the first source");
    maps[..12].to_vec()
}

fn visible(count: usize, seed: u64, share: f64) -> Vec<bool> {
    random_image(count as u32, 1, 0.0, 1.0, seed).iter().map(|v| v[0] < share).collect()
}

#[test]
fn the_fit_follows_the_twin_and_recovers_a_known_map() {
    for (seed, size) in (0..).zip([[13, 9], [33, 17], [70, 50], [300, 240]]) {
        let [width, height] = size;
        let base = float(random_image(width, height, 0.1, 0.8, seed));
        let noise = random_image(width, height, -0.05, 0.05, seed + 9);
        let seen = visible(base.len(), seed, 0.8);
        for level in [0.0, 1.0] {
            let exposed = |(x, n): (&[f64; 3], &[f64; 3])| {
                let y = known().apply(*x);
                std::array::from_fn(|c| y[c] + level * n[c])
            };
            let warped = float(base.iter().zip(&noise).map(exposed).collect());
            let map = on_gpu(&base, &warped, &seen, size);
            let twin = fit(&base, &warped, &seen);
            let error = relative_error(&map, &twin.rows());
            let known = relative_error(&map, &known().rows());
            println!("{width} x {height}, noise {level}: {error:.1e} from the twin, {known:.1e} from the truth");
            assert!(error <= 1e-5 && (level > 0.0 || known <= 1e-5), "{width} x {height}: {map:?} against {twin:?}");
        }
    }
}

/// Bright nearly flat colours are where uncentred moments cancel.
#[test]
fn nearly_flat_colours_keep_their_precision() {
    let base = float(random_image(64, 48, 0.90, 0.91, 20));
    let warped = float(base.iter().map(|x| known().apply(*x)).collect());
    let seen = visible(base.len(), 21, 0.5);
    let map = on_gpu(&base, &warped, &seen, [64, 48]);
    let error = relative_error(&map, &fit(&base, &warped, &seen).rows());
    println!("flat: {error:.1e}");
    assert!(error <= 1e-3, "{map:?}");
}

#[test]
fn without_enough_to_go_by_the_map_is_the_identity() {
    let base = float(random_image(20, 10, 0.0, 1.0, 30));
    let warped = float(base.iter().map(|x| known().apply(*x)).collect());
    let first = |n: usize| (0..base.len()).map(|i| i < n).collect::<Vec<_>>();
    let identity = Affine::IDENTITY.rows();
    let map_of = |base: &Map, seen: &[bool]| {
        let map = on_gpu(base, &warped, seen, [20, 10]);
        assert!(relative_error(&map, &fit(base, &warped, seen).rows()) <= 1e-5, "as the twin");
        map
    };
    assert_eq!(map_of(&base, &first(0)), identity, "no pixel");
    assert_eq!(map_of(&base, &first(63)), identity, "63 pixels");
    assert_ne!(map_of(&base, &first(64)), identity, "64 pixels are enough");
    let grey: Map = base.iter().map(|p| [p[0]; 3]).collect();
    assert_eq!(map_of(&grey, &first(200)), identity, "a grey picture");
    assert_eq!(map_of(&vec![[0.5, 0.25, 0.75]; 200], &first(200)), identity, "a flat picture");
    let same = on_gpu(&warped, &warped, &first(200), [20, 10]);
    assert!(relative_error(&same, &identity) < 1e-6, "equal exposure: {same:?}");
}

/// Three slots a pixel, filled from the first on with rising numbers of five sources, of which the last is hardly seen; some
/// pixels see none.
struct Sources {
    size: [u32; 2],
    base: Map,
    warped: Vec<Map>,
    slots: Vec<Vec<Option<usize>>>,
    photo: Map,
    valid: Vec<bool>,
}

const COUNT: usize = 5;

impl Sources {
    fn new(size: [u32; 2], seed: u64) -> Sources {
        let [width, height] = size;
        let base = float(random_image(width, height, 0.1, 0.8, seed));
        let chances = random_image(width, height, 0.0, 1.0, seed + 1);
        let packed = |p: usize| -> Vec<usize> {
            let seen = (0..COUNT - 1).filter(|m| chances[p][m % 3] * (1.0 + *m as f64) < 1.2);
            let last = (p % 97 == 3).then_some(COUNT - 1);
            if p % 11 == 5 { Vec::new() } else { seen.take(2).chain(last).collect() }
        };
        let packed: Vec<Vec<usize>> = (0..base.len()).map(packed).collect();
        let slots: Vec<Vec<Option<usize>>> =
            (0..3).map(|slot| packed.iter().map(|list| list.get(slot).copied()).collect()).collect();
        let noise = random_image(width, height, -0.02, 0.02, seed + 2);
        let exposed = |p: usize, m: f64| -> [f64; 3] {
            let y = known().apply(base[p]);
            std::array::from_fn(|c| (1.0 - 0.1 * m) * y[c] + 0.02 * m + noise[p][c])
        };
        let colors = |of: &Vec<Option<usize>>| -> Map {
            of.iter().enumerate().map(|(p, m)| m.map_or([0.0; 3], |m| exposed(p, m as f64))).collect()
        };
        let warped = slots.iter().map(|of| float(colors(of))).collect();
        let byte = |v: f64| (v.clamp(0.0, 1.0) * 255.0).round() / 255.0;
        let photo = (0..base.len()).map(|p| exposed(p, 2.5).map(byte)).collect();
        let valid = visible(base.len(), seed + 3, 0.7);
        Sources { size, base, warped, slots, photo, valid }
    }

    fn twin(&self, with_photo: bool) -> Maps {
        let photo = with_photo.then_some((&self.photo[..], &self.valid[..]));
        Maps::fit(&self.base, &self.warped, &self.slots, COUNT, photo)
    }

    /// Maps, corrected base and shifted colours, and the gradient by the base from those by both.
    fn on_gpu(
        &self,
        (with_photo, reach): (bool, Reach),
        v_corrected: &Map,
        v_shifted: &[Map],
        before: &Map,
    ) -> [Vec<f64>; 4] {
        let gpu = gpu();
        let pixels = self.base.len();
        let four = |maps: &[Map]| -> Buffer {
            let flat: Vec<f32> =
                maps.iter().flatten().flat_map(|c| [c[0], c[1], c[2], 0.7].map(|v| v as f32)).collect();
            gpu.upload("four", &flat).unwrap()
        };
        let word = |p: usize| {
            let byte = |m: usize| self.slots[m][p].map_or(255, |source| source as u32) << (8 * m);
            (0..3).map(byte).sum::<u32>() | 0xff00_0000
        };
        let seen = gpu.upload("seen", &(0..pixels).map(word).collect::<Vec<u32>>()).unwrap();
        let texel = |(c, valid): (&[f64; 3], &bool)| {
            let [r, g, b] = c.map(|v| (v * 255.0).round() as u8);
            u32::from_le_bytes([r, g, b, if *valid { 255 } else { 7 }])
        };
        let texels: Vec<u32> = self.photo.iter().zip(&self.valid).map(texel).collect();
        let photo = gpu.upload("photo", &texels).unwrap();
        let (base, warped) = (upload(&gpu, &self.base), four(&self.warped));
        let colors = ExposedColors {
            base: &base,
            warped: &warped,
            seen: &seen,
            slots: 3,
            sources: COUNT as u32,
            reach,
            size: self.size,
        };
        let fit = ExposureFit::new(&gpu).unwrap();
        let corrected = gpu.allocate("corrected", 12 * pixels as u64).unwrap();
        let shifted = gpu.allocate("shifted", 48 * pixels as u64).unwrap();
        let (v_corrected, v_shifted, v_base) = (upload(&gpu, v_corrected), four(v_shifted), upload(&gpu, before));
        let mut pass = Pass::new(&gpu, "test");
        fit.record_fit(&mut pass, &colors, with_photo.then_some(&photo));
        fit.record_apply(&mut pass, &colors, &corrected, &shifted);
        fit.record_apply_backward(&mut pass, &colors, [&v_corrected, &v_shifted], &v_base);
        pass.submit();
        [
            read(&gpu, &fit.maps, 12 * (1 + COUNT)),
            read(&gpu, &corrected, 3 * pixels),
            read(&gpu, &shifted, 12 * pixels),
            read(&gpu, &v_base, 3 * pixels),
        ]
    }
}

#[test]
fn every_source_has_a_map_of_its_own_and_all_come_to_one_exposure() {
    for (seed, size) in (40..).zip([[33, 17], [120, 90]]) {
        let case = Sources::new(size, seed);
        let random = |low: f64, seed: u64| float(random_image(size[0], size[1], low, 1.0, seed));
        let (v_corrected, before) = (random(-1.0, seed + 4), random(-1.0, seed + 5));
        let v_shifted: Vec<Map> = (0..3).map(|m| random(-1.0, seed + 6 + m)).collect();
        let ways = [(false, Reach::Everywhere), (true, Reach::Everywhere), (true, Reach::Seen)];
        for (with_photo, reach) in ways {
            let twin = case.twin(with_photo);
            let [maps, corrected, shifted, v_base] =
                case.on_gpu((with_photo, reach), &v_corrected, &v_shifted, &before);
            let rows: Vec<f64> = std::iter::once(&twin.output).chain(&twin.sources).flat_map(Affine::rows).collect();
            assert!(relative_error(&maps, &rows) <= 1e-5, "{maps:?} against {twin:?}");
            assert_ne!(twin.sources[1], twin.sources[2]);
            assert_eq!(twin.sources[COUNT - 1] == twin.output, size[0] < 100, "hardly seen in the small picture");
            // Pixels that see no source may be left as they are.
            let stays = |p: usize| reach == Reach::Seen && case.slots[0][p].is_none();
            assert!(reach == Reach::Everywhere || (0..case.base.len()).any(stays));
            let of = |p: usize| if stays(p) { Affine::IDENTITY } else { twin.output };
            let applied: Map = case.base.iter().enumerate().map(|(p, x)| of(p).apply(*x)).collect();
            assert!(relative_error(&corrected, applied.as_flattened()) <= 1e-5);
            let (mut shifts, mut gradient) = (Vec::new(), before.clone());
            for (p, v) in v_corrected.iter().enumerate() {
                gradient[p].iter_mut().zip(of(p).backward(*v)).for_each(|(to, by)| *to += by);
            }
            for (m, slots) in case.slots.iter().enumerate() {
                for (p, source) in slots.iter().enumerate() {
                    let [r, g, b] =
                        source.map_or(case.warped[m][p], |s| twin.shift(s, case.base[p], case.warped[m][p]));
                    shifts.extend([r, g, b, f64::from(0.7f32)]);
                    let by_base = source.map_or([0.0; 3], |s| twin.shift_backward(s, v_shifted[m][p]));
                    gradient[p].iter_mut().zip(by_base).for_each(|(to, by)| *to += by);
                }
            }
            let (forward, back) = (relative_error(&shifted, &shifts), relative_error(&v_base, gradient.as_flattened()));
            println!("{size:?}, photo {with_photo}, {reach:?}: shifted {forward:.1e}, backward {back:.1e}");
            assert!(forward <= 1e-5 && back <= 1e-5, "{forward:e}, {back:e}");
        }
    }
}

/// An image, a photo that another exposure took of nearly the same, and how alike they are.
struct Exposed {
    size: [u32; 2],
    image: Map,
    target: Map,
    /// Alpha of the photo and the background, where it shows an object.
    object: Option<(Vec<u8>, [f64; 3])>,
}

impl Exposed {
    fn new(size: [u32; 2], seed: u64, noise: f64) -> Exposed {
        let [width, height] = size;
        let target = random_image(width, height, 0.0, 1.0, seed);
        let target: Map = target.into_iter().map(|p| p.map(|v| (v * 255.0).round() / 255.0)).collect();
        let noise = random_image(width, height, -noise, noise, seed + 1);
        let image = |(t, n): (&[f64; 3], &[f64; 3])| std::array::from_fn(|c| 0.8 * t[c] + 0.05 + n[c]);
        Exposed { size, image: float(target.iter().zip(&noise).map(image).collect()), target, object: None }
    }

    /// Loss, gradient by the image and by the scalars; the upstream gradient is 3. Without scalars the plain loss.
    fn on_gpu(&self, lambda: f64, scalars: Option<[f64; 2]>, alpha: impl Fn(usize) -> u8) -> (f64, Vec<f64>, Vec<f64>) {
        let gpu = gpu();
        let [width, height] = self.size;
        let texel = |(i, p): (usize, &[f64; 3])| {
            let [r, g, b] = p.map(|v| (v * 255.0).round() as u8);
            [r, g, b, alpha(i)]
        };
        let rgba = self.target.iter().enumerate().flat_map(texel).collect();
        let mut target = Target::upload(&gpu, &Photo { width, height, rgba }).unwrap();
        if let Some((_, background)) = self.object {
            target.outside = Outside::Background(background.map(|v| v as f32));
        }
        let flat: Vec<f32> = self.image.as_flattened().iter().map(|v| *v as f32).collect();
        let data = TensorData::new(flat, [height as usize, width as usize, 3]);
        let leaf = Tensor::<3>::from_data(data, &gpu.burn).autodiff().require_grad();
        let loss = ImageLoss::new(gpu.clone(), lambda as f32);
        let (value, scratch) = match scalars {
            Some(s) => {
                let s = gpu.upload("scalars", &s.map(|v| v as f32)).unwrap();
                loss.tracked_with_exposure(leaf.clone(), &target, &s).unwrap()
            }
            None => loss.tracked(leaf.clone(), &target).unwrap(),
        };
        let mut grads = (value.clone() * 3.0).backward();
        let by_image = values(leaf.grad_remove(&mut grads).unwrap());
        (values(value.inner())[0], by_image, read(&gpu, scratch.v_scalars(), 2))
    }

    fn check(&self, lambda: f64, scalars: [f64; 2]) -> [f64; 2] {
        let [w, h] = self.size.map(|v| v as usize);
        let alpha = |i: usize| self.object.as_ref().map_or(255, |(alpha, _)| alpha[i]);
        let (loss, by_image, by_scalars) = self.on_gpu(lambda, Some(scalars), alpha);
        let object = Object {
            photo: self.target.clone(),
            cover: (0..w * h).map(|i| f64::from(alpha(i) - 1) / 254.0).collect(),
            background: self.object.as_ref().map_or([0.0; 3], |(_, background)| *background),
        };
        let expected = exposed_loss(&self.image, &object, w, h, lambda, scalars);
        let (v_image, v_scalars) = exposed_loss_backward(&self.image, &object, w, h, lambda, scalars);
        let tripled = |v: &[f64]| -> Vec<f64> { v.iter().map(|v| 3.0 * v).collect() };
        let error = relative_error(&by_image, &tripled(v_image.as_flattened()));
        let scalar_error = relative_error(&by_scalars, &tripled(&v_scalars));
        println!("{w} x {h}, lambda {lambda}: image {error:.1e}, scalars {scalar_error:.1e}");
        assert!((loss - expected).abs() <= 2e-6 + 1e-5 * expected, "{loss} against {expected}");
        assert!(error <= 1e-4 && scalar_error <= 1e-4, "{w} x {h}: {error:e}, {scalar_error:e}");
        v_scalars
    }
}

#[test]
fn the_exposed_loss_follows_its_twin_while_the_images_are_alike() {
    for (seed, size) in (50..).zip([[13, 9], [33, 17], [300, 230]]) {
        for lambda in [0.0, 0.2] {
            let alike = Exposed::new(size, seed, 0.02).check(lambda, [0.15, 0.03]);
            assert!(alike.iter().all(|v| *v != 0.0), "a gradient there is");
        }
    }
    let unlike = Exposed::new([33, 17], 60, 3.0).check(0.2, [0.15, 0.03]);
    assert_eq!(unlike, [0.0; 2], "the gate is closed");
    let (.., by_scalars) = Exposed::new([33, 17], 60, 3.0).on_gpu(0.2, Some([0.15, 0.03]), |_| 255);
    assert_eq!(by_scalars, [0.0; 2], "exactly");
}

/// The background has the photo's exposure too: where nothing is, the scalars have no say.
#[test]
fn the_exposed_loss_of_an_object_follows_its_twin() {
    for (seed, size) in (70..).zip([[13, 9], [33, 17], [120, 90]]) {
        let mut case = Exposed::new(size, seed, 0.02);
        let background = [0.9f32, 0.05, 0.4].map(f64::from);
        let alpha: Vec<u8> = (0..case.target.len()).map(|i| [1, 1, 255, 254, 77, 200][i / 5 % 6]).collect();
        for ((x, t), a) in case.image.iter_mut().zip(&case.target).zip(&alpha) {
            let cover = f64::from(a - 1) / 254.0;
            let over = |c: usize| x[c] + (1.0 - cover) * (background[c] - t[c]);
            *x = [0, 1, 2].map(|c| f64::from(over(c) as f32));
        }
        case.object = Some((alpha, background));
        for lambda in [0.0, 0.2] {
            let by_scalars = case.check(lambda, [0.15, 0.03]);
            assert!(by_scalars.iter().all(|v| *v != 0.0), "a gradient there is");
        }
        case.object.as_mut().unwrap().0.fill(1);
        let (.., by_scalars) = case.on_gpu(0.0, Some([0.15, 0.03]), |_| 1);
        assert!(by_scalars[1] == 0.0, "{by_scalars:?}");
    }
}

#[test]
fn no_change_of_exposure_is_the_plain_loss() {
    let case = Exposed::new([33, 17], 61, 0.02);
    let masked = |i: usize| if i % 33 < 7 { 0 } else { 255 };
    let (plain, by_image, _) = case.on_gpu(0.2, None, masked);
    let (exposed, same, by_scalars) = case.on_gpu(0.2, Some([0.0; 2]), masked);
    assert!((plain - exposed).abs() < 1e-6, "{plain} against {exposed}");
    assert_eq!(by_image, same);
    assert!(by_scalars.iter().all(|v| *v != 0.0));
    let (_, by_image, _) = case.on_gpu(0.2, Some([0.2, 0.1]), masked);
    for (i, v) in by_image.chunks_exact(3).enumerate().filter(|(i, _)| masked(*i) == 0) {
        assert_eq!(v, [0.0; 3], "masked pixel {i}");
    }
}

#[test]
fn only_the_visited_photo_steps() {
    let gpu = gpu();
    let mut scalars = ExposureScalars::new(&gpu, 3, ExposureAdam::default()).unwrap();
    let settings = Adam { learning_rate: 1e-3, beta1: 0.9, beta2: 0.99, eps: 1e-8 };
    let mut twins = [([0.0; 2], [0.0; 2], [0.0; 2], 0u32); 3];
    for (turn, photo) in [1usize, 2, 1, 1].into_iter().enumerate() {
        let gradient = [0.3 - 0.2 * turn as f64, 1e-3 * (turn as f64 + 1.0)];
        let uploaded = gpu.upload("gradient", &gradient.map(|v| v as f32)).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        scalars.record_step(&mut pass, photo, &uploaded);
        pass.submit();
        let (value, m, v, step) = &mut twins[photo];
        *step += 1;
        settings.step(*step, value, &gradient, m, v);
    }
    let states = scalars.states(&gpu).unwrap();
    for (state, (value, m, _, steps)) in states.iter().zip(&twins) {
        assert_eq!(state.steps as u32, *steps);
        assert!(relative_error(&state.scalars.map(f64::from), value) <= 1e-5, "{state:?} against {value:?}");
        assert!(relative_error(&state.moment1.map(f64::from), m) <= 1e-5);
    }
    assert_eq!(states[0], Default::default(), "never visited");
    let again = ExposureScalars::from_states(&gpu, &states, ExposureAdam::default()).unwrap();
    assert_eq!(again.states(&gpu).unwrap(), states);
    let part: Vec<f32> = gpu.read(&again.scalars(2), 2).unwrap();
    assert_eq!(part, states[2].scalars);
}
