//! Twin of the exposures: images and warped colours in a photo's exposure.

use super::image_loss::Map;

/// exp(log_gain) color + offset, by channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Exposure {
    pub log_gain: [f64; 3],
    pub offset: [f64; 3],
}

impl Exposure {
    /// What the Gaussians show of a pixel in this exposure, before a background that shines through by `t`.
    pub fn apply(&self, color: [f64; 3], t: f64, background: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|c| {
            let behind = t * background[c];
            self.log_gain[c].exp() * (color[c] - behind) + (1.0 - t) * self.offset[c] + behind
        })
    }

    /// A colour of another exposure's photo in this one.
    pub fn shift(&self, from: &Exposure, color: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|c| self.relative_gain(from, c) * (color[c] - from.offset[c]) + self.offset[c])
    }

    pub fn relative_gain(&self, from: &Exposure, c: usize) -> f64 {
        (self.log_gain[c] - from.log_gain[c]).exp()
    }

    /// As the device has it.
    pub fn single(&self) -> ibgs_render::exposure::Exposure {
        let single = |values: [f64; 3]| values.map(|v| v as f32);
        ibgs_render::exposure::Exposure { log_gain: single(self.log_gain), offset: single(self.offset) }
    }

    /// Log gains, then offsets.
    pub fn numbers(&self) -> [f64; 6] {
        let ([a, b, c], [d, e, f]) = (self.log_gain, self.offset);
        [a, b, c, d, e, f]
    }

    pub fn from_numbers([a, b, c, d, e, f]: [f64; 6]) -> Exposure {
        Exposure { log_gain: [a, b, c], offset: [d, e, f] }
    }
}

/// An image with the transmittance of its pixels.
#[derive(Clone, Debug)]
pub struct Image {
    pub colors: Map,
    pub transmittance: Vec<f64>,
    pub background: [f64; 3],
}

impl Image {
    pub fn exposed(&self, exposure: &Exposure) -> Map {
        let pixels = self.colors.iter().zip(&self.transmittance);
        pixels.map(|(color, t)| exposure.apply(*color, *t, self.background)).collect()
    }

    /// Gradients by the colours and by the exposure's numbers; the transmittance is a constant.
    pub fn exposed_backward(&self, exposure: &Exposure, v: &[[f64; 3]]) -> (Map, [f64; 6]) {
        let mut numbers = [0.0; 6];
        let mut colors = v.to_vec();
        for (i, v) in colors.iter_mut().enumerate() {
            let t = self.transmittance[i];
            for c in 0..3 {
                let gain = exposure.log_gain[c].exp();
                numbers[c] += v[c] * gain * (self.colors[i][c] - t * self.background[c]);
                numbers[3 + c] += v[c] * (1.0 - t);
                v[c] *= gain;
            }
        }
        (colors, numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finite::assert_gradient;
    use crate::random_scene::random_image;

    #[test]
    fn gradients_agree_with_finite_differences() {
        let colors = random_image(13, 11, 0.0, 1.0, 8);
        let transmittance = random_image(13, 11, 0.0, 1.0, 9).iter().map(|v| v[0]).collect();
        let v = random_image(13, 11, -1.0, 1.0, 10);
        let image = Image { colors, transmittance, background: [0.9, 0.1, 0.4] };
        let own = Exposure { log_gain: [0.2, -0.3, 0.1], offset: [0.02, -0.05, 0.1] };
        let along = |map: &Map| -> f64 { map.as_flattened().iter().zip(v.as_flattened()).map(|(x, v)| x * v).sum() };
        let (v_image, v_numbers) = image.exposed_backward(&own, &v);
        let by_image = assert_gradient("image", image.colors.as_flattened(), v_image.as_flattened(), 1e-6, |x| {
            along(&Image { colors: x.as_chunks().0.to_vec(), ..image.clone() }.exposed(&own))
        });
        let by_numbers = assert_gradient("exposure", &own.numbers(), &v_numbers, 1e-6, |x| {
            along(&image.exposed(&Exposure::from_numbers(x.try_into().unwrap())))
        });
        println!("by image {by_image:.1e}, by exposure {by_numbers:.1e}");
    }
}
