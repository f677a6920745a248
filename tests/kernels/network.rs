//! The residual network's weights on the device and in files.

use crate::common::gpu;
use ibgs_core::residual::layers::WEIGHTS;
use ibgs_core::residual::weights::{FILE_NAME, initial};
use ibgs_core::residual::{NetworkError, ResidualNetwork};

#[test]
fn weights_survive_device_and_file() {
    let gpu = gpu();
    let network = ResidualNetwork::init(&gpu, 11);
    assert_eq!(network.to_values().unwrap(), initial(11));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(FILE_NAME);
    network.save(&path).unwrap();
    let loaded = ResidualNetwork::load(&gpu, &path).unwrap();
    assert_eq!(loaded.to_values().unwrap(), initial(11));
}

#[test]
fn networks_that_cannot_be_are_refused() {
    let gpu = gpu();
    let short = ResidualNetwork::from_values(&gpu, &[0.0; WEIGHTS - 1]);
    assert!(matches!(short, Err(NetworkError::Count { found }) if found == WEIGHTS - 1));
    let mut weights = initial(1);
    weights[0] = f32::NAN;
    let network = ResidualNetwork::from_values(&gpu, &weights).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(FILE_NAME);
    let text = network.save(&path).unwrap_err().to_string();
    assert!(text.contains("`per_view_mlp.0.weight`") && !path.exists(), "{text}");
}
