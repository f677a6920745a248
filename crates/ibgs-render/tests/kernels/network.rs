//! The residual network's weights: what a fresh network does, on the device and in files.

use super::residual_features::random_view;
use ibgs_reference::features::EMPTY;
use ibgs_reference::gpu::gpu;
use ibgs_reference::unet::{Map, forward};
use ibgs_render::residual::layers::WEIGHTS;
use ibgs_render::residual::weights::{FILE_NAME, initial, random, read, write};
use ibgs_render::residual::{Aggregation, NetworkError, ResidualNetwork, Variant};

#[test]
fn weights_survive_device_and_file() {
    let gpu = gpu();
    let network = ResidualNetwork::from_values(&gpu, &initial(&Variant::default(), 11)).unwrap();
    assert_eq!(network.to_values(&gpu).unwrap(), initial(&Variant::default(), 11));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(FILE_NAME);
    write(&path, &network.to_values(&gpu).unwrap()).unwrap();
    let loaded = ResidualNetwork::from_values(&gpu, &read(&path).unwrap()).unwrap();
    assert_eq!(loaded.to_values(&gpu).unwrap(), initial(&Variant::default(), 11));
}

/// By the twin: the residual of a network that has learned nothing is about half of the sources' mean difference to the base.
#[test]
fn a_fresh_network_passes_half_of_the_mean_difference() {
    for aggregation in [Aggregation::Mean, Aggregation::Soft] {
        let variant = Variant { aggregation, ..Variant::default() };
        let mut view = random_view([24, 20], 3, 3, variant, 3);
        // Every source sees every pixel with the right depth: all of them have about the same confidence.
        view.seen.iter_mut().for_each(|seen| *seen = [0, 1, 2, EMPTY]);
        view.weights = initial(&variant, 4).into_iter().map(f64::from).collect();
        let residual = forward(&view.weights, &Map::new(view.input(), 24, 20)).residual;
        let pixels = view.base.len();
        let mean =
            |c: usize, p: usize| (0..3).map(|m| view.warped[m * pixels + p][c] - view.base[p][c]).sum::<f64>() / 3.0;
        let values = (0..3).flat_map(|c| (0..pixels).map(move |p| (c, p)));
        let pairs: Vec<[f64; 2]> = values.map(|(c, p)| [mean(c, p), residual.data[c * pixels + p]]).collect();
        let sum = |of: &dyn Fn(&[f64; 2]) -> f64| pairs.iter().map(of).sum::<f64>();
        let passed = sum(&|[d, r]| d * r) / sum(&|[d, _]| d * d);
        let rest = sum(&|[d, r]| (r - passed * d).powi(2)) / sum(&|[d, _]| d * d);
        let what = format!("{aggregation:?}: {passed:.3} of the difference, {rest:.4} of its square beside it");
        assert!((0.4..0.6).contains(&passed) && rest < 0.05, "{what}");
    }
}

#[test]
fn networks_that_cannot_be_are_refused() {
    let gpu = gpu();
    let short = ResidualNetwork::from_values(&gpu, &[0.0; WEIGHTS - 1]);
    assert!(matches!(short, Err(NetworkError::Count { found }) if found == WEIGHTS - 1));
    let mut weights = random(1);
    weights[0] = f32::NAN;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(FILE_NAME);
    let text = write(&path, &weights).unwrap_err().to_string();
    assert!(text.contains("`per_view_mlp.0.weight`") && !path.exists(), "{text}");
}
