//! The residual network's weights on the device and in files.

use crate::common::gpu;
use ibgs_core::residual::layers::WEIGHTS;
use ibgs_core::residual::weights::{FILE_NAME, initial, read, write};
use ibgs_core::residual::{NetworkError, ResidualNetwork};

#[test]
fn weights_survive_device_and_file() {
    let gpu = gpu();
    let network = ResidualNetwork::init(&gpu, 11).unwrap();
    assert_eq!(network.to_values(&gpu).unwrap(), initial(11));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(FILE_NAME);
    write(&path, &network.to_values(&gpu).unwrap()).unwrap();
    let loaded = ResidualNetwork::from_values(&gpu, &read(&path).unwrap()).unwrap();
    assert_eq!(loaded.to_values(&gpu).unwrap(), initial(11));
}

#[test]
fn networks_that_cannot_be_are_refused() {
    let gpu = gpu();
    let short = ResidualNetwork::from_values(&gpu, &[0.0; WEIGHTS - 1]);
    assert!(matches!(short, Err(NetworkError::Count { found }) if found == WEIGHTS - 1));
    let mut weights = initial(1);
    weights[0] = f32::NAN;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(FILE_NAME);
    let text = write(&path, &weights).unwrap_err().to_string();
    assert!(text.contains("`per_view_mlp.0.weight`") && !path.exists(), "{text}");
}
