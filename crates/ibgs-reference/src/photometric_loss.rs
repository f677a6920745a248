//! Twin of the photometric loss (method.md section 7) and of its gradient by the warped colours.

use super::image_loss::{Map, ssim_backward, ssim_map};

/// A photo of which some pixels may be masked.
pub struct Masked<'a> {
    pub photo: &'a [[f64; 3]],
    pub valid: &'a [bool],
    pub width: usize,
    pub height: usize,
}

/// What SSIM compares for one visible source: the warped image where it counts and the photo elsewhere, and the photo; both are
/// zero where the photo is masked.
fn pictures(target: &Masked, warped: &[[f64; 3]], visible: &[bool]) -> (Map, Map) {
    let pick = |i: usize| match (target.valid[i], visible[i]) {
        (false, _) => ([0.0; 3], [0.0; 3]),
        (true, false) => (target.photo[i], target.photo[i]),
        (true, true) => (warped[i], target.photo[i]),
    };
    (0..warped.len()).map(pick).unzip()
}

fn counts(target: &Masked, visible: &[bool]) -> Vec<bool> {
    visible.iter().zip(target.valid).map(|(a, b)| *a && *b).collect()
}

fn total_count(target: &Masked, visible: &[Vec<bool>]) -> usize {
    visible.iter().flat_map(|v| counts(target, v)).filter(|c| *c).count()
}

/// weight x mean over the pairs (visible source, pixel) that count of 1 - SSIM, itself averaged over channels; 0 without a pair.
pub fn photometric_loss(target: &Masked, warped: &[Map], visible: &[Vec<bool>], weight: f64) -> f64 {
    let mut sum = 0.0;
    for (warped, visible) in warped.iter().zip(visible) {
        let (x, y) = pictures(target, warped, visible);
        let ssim = ssim_map(&x, &y, target.width, target.height);
        for (value, counts) in ssim.iter().zip(counts(target, visible)) {
            if counts {
                sum += 1.0 - value.iter().sum::<f64>() / 3.0;
            }
        }
    }
    weight * sum / total_count(target, visible).max(1) as f64
}

/// Gradient of `photometric_loss` by the warped images.
pub fn photometric_loss_backward(target: &Masked, warped: &[Map], visible: &[Vec<bool>], weight: f64) -> Vec<Map> {
    let share = -weight / (3 * total_count(target, visible).max(1)) as f64;
    let compared = |(warped, visible): (&Map, &Vec<bool>)| -> Map {
        let (x, y) = pictures(target, warped, visible);
        let counts = counts(target, visible);
        let v_map: Map = counts.iter().map(|c| if *c { [share; 3] } else { [0.0; 3] }).collect();
        let mut v = ssim_backward(&x, &y, target.width, target.height, &v_map);
        v.iter_mut().zip(counts).filter(|(_, c)| !c).for_each(|(v, _)| *v = [0.0; 3]);
        v
    };
    warped.iter().zip(visible).map(compared).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finite::assert_gradient;
    use crate::random_scene::random_image;

    #[test]
    fn gradient_agrees_with_finite_differences() {
        let (width, height) = (15, 13);
        let photo = random_image(15, 13, 0.0, 1.0, 4);
        let valid: Vec<bool> = (0..photo.len()).map(|i| i % 9 != 4).collect();
        let target = Masked { photo: &photo, valid: &valid, width, height };
        let level = random_image(15, 13, 0.0, 1.0, 5);
        let visible = [0.3, 0.7].map(|limit| level.iter().map(|v| v[0] > limit).collect::<Vec<bool>>());
        let warped = [random_image(15, 13, 0.0, 1.0, 6), random_image(15, 13, 0.0, 1.0, 7)];
        let split = |v: &[f64]| -> Vec<Map> { v.as_chunks().0.chunks(width * height).map(<[_]>::to_vec).collect() };
        let flat: Vec<f64> = warped.concat().into_flattened();
        let v = photometric_loss_backward(&target, &warped, &visible, 0.3).concat().into_flattened();
        let worst =
            assert_gradient("warped", &flat, &v, 1e-6, |at| photometric_loss(&target, &split(at), &visible, 0.3));
        println!("photometric {worst:.1e}");
    }
}
