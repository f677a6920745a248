//! Exposures against their twins.

use crate::common::{parameters, values};
use burn::tensor::{Tensor, TensorData};
use ibgs_core::exposure::{Exposure, ExposureAdam, ExposurePass, PhotoExposures};
use ibgs_core::gpu::Pass;
use ibgs_core::raster::RasterView;
use ibgs_reference::adam::Adam;
use ibgs_reference::exposure::{Exposure as Twin, Image};
use ibgs_reference::gpu::{gpu, rasterizer};
use ibgs_reference::random_scene::{random_camera, random_image, random_params};
use ibgs_reference::raster::render as render_twin;
use ibgs_reference::relative_error;
use ibgs_shaders::EXPOSURE_PULL;
use ibgs_train::autodiff::{self, Leaves};
use ibgs_train::tensor::device;

/// An exposure that float32 holds.
fn exposure(seed: u64) -> Twin {
    let [gain, offset] = [0, 1].map(|i| random_image(1, 1, -0.4, 0.4, 100 + 2 * seed + i)[0]);
    Twin { log_gain: gain.map(|v| f64::from(v as f32)), offset: offset.map(|v| f64::from(0.2 * v as f32)) }
}

#[test]
fn an_image_in_a_photos_exposure_follows_its_twin() {
    let (gpu, raster) = (gpu(), rasterizer());
    for seed in 1..4 {
        let (params, camera) = (random_params(60, 1, seed), random_camera(33, 21, seed));
        let background = [0.9f32, 0.05, 0.4];
        let view = RasterView { background, ..RasterView::new(camera, 1) };
        let model = parameters(&params);
        // Makes room for every intersection.
        raster.render(model.splats(), &view).unwrap();
        let leaves = Leaves::new(&model);
        let (image, forward) = autodiff::rasterized(&raster, &leaves, &view, None, None).unwrap();
        let twin_forward = render_twin(&params, &camera, background.map(f64::from), 1);
        let colors = values(image.clone().inner()).as_chunks().0.to_vec();
        let twin = Image { colors, transmittance: twin_forward.final_t, background: background.map(f64::from) };
        assert!(twin.transmittance.iter().any(|t| *t > 0.9) && twin.transmittance.iter().any(|t| *t < 0.5));

        let own = exposure(seed);
        let exposure_pass = ExposurePass::new(gpu.clone());
        let exposures = exposure_pass.upload(&own.single(), &[]).unwrap();
        let shown = autodiff::exposed(&exposures, &image, &forward).unwrap();
        let error = relative_error(&values(shown.clone().inner()), twin.exposed(&own).as_flattened());
        let v = random_image(33, 21, -1.0, 1.0, seed + 9);
        let flat: Vec<f32> = v.as_flattened().iter().map(|v| *v as f32).collect();
        let cotangent = Tensor::<3>::from_data(TensorData::new(flat, [21, 33, 3]), device(&gpu).unwrap()).autodiff();
        let (v_image, mut v_numbers) = twin.exposed_backward(&own, &v);
        v_numbers.iter_mut().zip(own.numbers()).for_each(|(v, number)| *v += f64::from(EXPOSURE_PULL) * number);
        // The gradients by the model are those by the image, brought back.
        let mut through = (shown * cotangent).sum().backward();
        let through = leaves.gradients(&mut through).unwrap();
        let by_numbers = gpu.read(exposures.v_target(), 2).unwrap().into_flattened();
        let straight = Leaves::new(&model);
        let (image, _) = autodiff::rasterized(&raster, &straight, &view, None, None).unwrap();
        let flat: Vec<f32> = v_image.as_flattened().iter().map(|v| *v as f32).collect();
        let cotangent = Tensor::<3>::from_data(TensorData::new(flat, [21, 33, 3]), device(&gpu).unwrap()).autodiff();
        let mut plain = (image * cotangent).sum().backward();
        let plain = straight.gradients(&mut plain).unwrap();
        let [through, plain] = [through, plain].map(|g| g.map(|gradient| gradient.map(values)));
        let by_sh = relative_error(&through.sh.unwrap(), &plain.sh.unwrap());
        let by_means = relative_error(&through.means.unwrap(), &plain.means.unwrap());
        let numbers: Vec<f64> = [0, 1, 2, 4, 5, 6].map(|i: usize| f64::from(by_numbers[i])).to_vec();
        let by_exposure = relative_error(&numbers, &v_numbers);
        println!("{error:.1e}, by the exposure {by_exposure:.1e}, by the model {by_sh:.1e} and {by_means:.1e}");
        assert!(error <= 1e-5 && by_exposure <= 1e-4 && by_sh <= 1e-5 && by_means <= 1e-4);
        assert!(by_numbers[3] == 0.0 && by_numbers[7] == 0.0, "{by_numbers:?}");
    }
}

#[test]
fn only_the_visited_photo_steps() {
    let gpu = gpu();
    let mut photos = PhotoExposures::new(&gpu, 3, ExposureAdam::default()).unwrap();
    let settings = Adam { learning_rate: 1e-2, beta1: 0.9, beta2: 0.99, eps: 1e-8, decay: 0.0 };
    let mut twins = [([0.0; 6], [0.0; 6], [0.0; 6], 0u32); 3];
    for (turn, photo) in [1usize, 2, 1, 1].into_iter().enumerate() {
        let gradient: [f64; 6] = std::array::from_fn(|i| (0.3 - 0.2 * turn as f64) / (i as f64 + 1.0));
        let [a, b, c, d, e, f] = gradient.map(|v| v as f32);
        let uploaded = gpu.upload("gradient", &[[a, b, c, 0.0], [d, e, f, 0.0]]).unwrap();
        let mut pass = Pass::new(&gpu, "test");
        photos.record_step(&mut pass, photo, &uploaded, settings.learning_rate);
        pass.submit();
        let (value, m, v, step) = &mut twins[photo];
        *step += 1;
        settings.step(*step, value, &gradient, m, v);
    }
    let numbers =
        |e: &Exposure| Twin { log_gain: e.log_gain.map(f64::from), offset: e.offset.map(f64::from) }.numbers();
    let states = photos.states(&gpu).unwrap();
    for (state, (value, m, _, steps)) in states.iter().zip(&twins) {
        assert_eq!(state.steps as u32, *steps);
        assert!(relative_error(&numbers(&state.exposure), value) <= 1e-5, "{state:?} against {value:?}");
        assert!(relative_error(&numbers(&state.moment1), m) <= 1e-5);
    }
    assert_eq!(states[0], Default::default(), "never visited");
    let again = PhotoExposures::from_states(&gpu, &states, ExposureAdam::default()).unwrap();
    assert_eq!(again.states(&gpu).unwrap(), states);
    let own: Vec<Exposure> = states.iter().map(|state| state.exposure).collect();
    assert_eq!(again.exposures(&gpu).unwrap(), own);
}
