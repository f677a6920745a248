//! Blending with surface for an image alone against the same for gradients, which the twin checks.

use crate::small::small_model;
use ibgs_core::exposure::{Exposure, ExposurePass};
use ibgs_core::gpu::{Buffer, Pass};
use ibgs_core::raster::{Keep, RasterView, SurfaceOptions};
use ibgs_reference::gpu::{gpu, rasterizer};

#[test]
fn it_gives_what_gradients_get_bit_for_bit() {
    let (model, dataset) = small_model();
    let (gpu, splats) = (gpu(), model.splats());
    let exposure = Exposure { log_gain: [0.2, -0.1, 0.3], offset: [0.05, 0.1, -0.02] };
    let exposures = ExposurePass::new(gpu.clone()).upload(&exposure, &[]).unwrap();
    for (&index, intersections) in dataset.test.iter().zip([2, 4, 6, 8]) {
        let camera = splats.space.camera(&dataset.views[index].camera);
        let mut view = RasterView::new(camera, splats.sh_degree());
        view.background = [0.2, 0.4, 0.6];
        view.surface = Some(SurfaceOptions { intersections, ..SurfaceOptions::default() });
        let passes = [Keep::Image, Keep::Gradients].map(|keep| {
            // Of its own, so that it has no memory for gradients that another pass has left.
            let raster = rasterizer();
            let image = raster.image_memory(&camera).unwrap();
            let forward = raster.forward(splats, &view, keep, image).unwrap();
            assert!(raster.had_room(&forward).unwrap());
            let surface = forward.surface().unwrap();
            assert_eq!(surface.v.is_some(), keep == Keep::Gradients);
            let (transmittance, first) = forward.transmittance();
            let exposed = raster.image_memory(&camera).unwrap();
            let mut pass = Pass::new(&gpu, "exposed");
            exposures.record(&mut pass, &forward, &exposed);
            pass.submit();
            let read =
                |buffer: &Buffer<f32>, values| gpu.read(&buffer.cast::<u32>(), values * camera.pixels()).unwrap();
            [
                read(&forward.image, 3),
                read(&transmittance.part(first as usize, camera.pixels()), 1),
                read(&exposed, 3),
                read(&surface.normal_map, 3),
                read(&surface.median_depth, 1),
                read(&surface.intersections.cast(), 2 * intersections as usize),
            ]
        });
        let names = ["image", "transmittance", "image in an exposure", "normal map", "median depth", "intersections"];
        for ((name, a), b) in names.iter().zip(&passes[0]).zip(&passes[1]) {
            assert!(a == b, "{name}, {intersections} intersections");
            assert!(a.iter().any(|bits| *bits != 0), "{name} is not empty");
        }
    }
}
