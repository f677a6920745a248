//! PSNR and SSIM, as the program measures them.

use crate::arrays::array;
use crate::errors::refused;
use ibgs_core::dataset::Photo;
use ibgs_core::eval::{Score, score};
use ibgs_core::render::Rendered;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// PSNR in dB of an image against a photo.
#[pyfunction]
pub fn psnr(py: Python<'_>, image: PyReadonlyArrayDyn<f32>, photo: PyReadonlyArrayDyn<u8>) -> PyResult<f64> {
    Ok(scored(py, &image, &photo)?.psnr)
}

/// SSIM of an image against a photo.
#[pyfunction]
pub fn ssim(py: Python<'_>, image: PyReadonlyArrayDyn<f32>, photo: PyReadonlyArrayDyn<u8>) -> PyResult<f64> {
    Ok(scored(py, &image, &photo)?.ssim)
}

/// Clamped and rounded to 8 bits, as pictures are written.
#[pyfunction]
pub fn to_uint8<'py>(py: Python<'py>, image: PyReadonlyArrayDyn<f32>) -> PyResult<Bound<'py, PyArrayDyn<u8>>> {
    let shape = image.shape().to_vec();
    let rgb = image.as_array().iter().copied().collect();
    array(py, Rendered { width: 0, height: 0, rgb }.to_rgb8(), &shape)
}

fn scored(py: Python<'_>, image: &PyReadonlyArrayDyn<f32>, photo: &PyReadonlyArrayDyn<u8>) -> PyResult<Score> {
    let (&[height, width, 3], &[photo_height, photo_width, channels @ (3 | 4)]) = (image.shape(), photo.shape()) else {
        return Err(refused(
            "an image has the shape [height, width, 3], a photo [height, width, 3] or [height, width, 4]",
        ));
    };
    if (height, width) != (photo_height, photo_width) || height == 0 || width == 0 {
        return Err(refused(format!(
            "image and photo differ in size: {width} x {height}, {photo_width} x {photo_height}"
        )));
    }
    let rgb = image.as_array().iter().copied().collect();
    let values: Vec<u8> = photo.as_array().iter().copied().collect();
    let pixel = |pixel: &[u8]| [pixel[0], pixel[1], pixel[2], pixel.get(3).copied().unwrap_or(255)];
    let rgba = values.chunks_exact(channels).flat_map(pixel).collect();
    let (width, height) = (width as u32, height as u32);
    let (image, photo) = (Rendered { width, height, rgb }, Photo { width, height, rgba });
    Ok(py.detach(|| score(&image, &photo)))
}
