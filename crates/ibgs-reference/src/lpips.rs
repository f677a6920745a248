//! LPIPS with VGG16 (method.md section 9) in double precision, layer by layer.

/// A 3 x 3 convolution.
pub struct Layer {
    /// `[outputs, inputs, 3, 3]`.
    pub weight: Vec<f32>,
    /// `[outputs]`.
    pub bias: Vec<f32>,
}

/// The layers of each block, and the weights of its channels.
pub struct Network {
    pub blocks: Vec<Vec<Layer>>,
    pub linear: Vec<Vec<f32>>,
}

/// Values `[channels][height][width]`.
struct Map {
    channels: usize,
    height: usize,
    width: usize,
    values: Vec<f64>,
}

impl Map {
    /// 3 x 3, zeros beyond the border, then ReLU.
    fn convolved(&self, layer: &Layer) -> Map {
        let [height, width] = [self.height, self.width];
        let outputs = layer.bias.len();
        let mut values = Vec::with_capacity(outputs * height * width);
        for (o, &bias) in layer.bias.iter().enumerate() {
            let mut plane = vec![f64::from(bias); height * width];
            for i in 0..self.channels {
                let source = &self.values[i * height * width..][..height * width];
                for (tap, &w) in layer.weight[9 * (o * self.channels + i)..][..9].iter().enumerate() {
                    let (w, dy, dx) = (f64::from(w), tap / 3, tap % 3);
                    for y in (1 - dy.min(1))..height.min(height + 1 - dy) {
                        for x in (1 - dx.min(1))..width.min(width + 1 - dx) {
                            plane[y * width + x] += w * source[(y + dy - 1) * width + x + dx - 1];
                        }
                    }
                }
            }
            values.extend(plane.into_iter().map(|v| v.max(0.0)));
        }
        Map { channels: outputs, height, width, values }
    }

    /// The largest of each 2 x 2 values; an odd last row or column is left out.
    fn halved(&self) -> Map {
        let (height, width) = (self.height / 2, self.width / 2);
        let at = |c: usize, y: usize, x: usize| self.values[(c * self.height + y) * self.width + x];
        let mut values = Vec::with_capacity(self.channels * height * width);
        for c in 0..self.channels {
            for y in 0..height {
                for x in 0..width {
                    let pair = |y: usize| at(c, y, 2 * x).max(at(c, y, 2 * x + 1));
                    values.push(pair(2 * y).max(pair(2 * y + 1)));
                }
            }
        }
        Map { channels: self.channels, height, width, values }
    }

    /// A pixel's features, divided by their length.
    fn unit(&self, pixel: usize) -> Vec<f64> {
        let pixels = self.height * self.width;
        let own: Vec<f64> = (0..self.channels).map(|c| self.values[c * pixels + pixel]).collect();
        let length = own.iter().map(|v| v * v).sum::<f64>().sqrt() + 1e-10;
        own.into_iter().map(|v| v / length).collect()
    }
}

/// Distance of two images `[height][width][3]` in 0..1; `signed` ones are mapped to -1..1 first.
pub fn distance(network: &Network, [height, width]: [usize; 2], images: [&[f64]; 2], signed: bool) -> f64 {
    let (shift, scale) = ([-0.030, -0.088, -0.188], [0.458, 0.448, 0.450]);
    let input = |image: &[f64]| {
        let value = |c: usize, i: usize| {
            let value = if signed { 2.0 * image[3 * i + c] - 1.0 } else { image[3 * i + c] };
            (value - shift[c]) / scale[c]
        };
        let values = (0..3).flat_map(|c| (0..height * width).map(move |i| value(c, i))).collect();
        Map { channels: 3, height, width, values }
    };
    let mut maps = images.map(input);
    let mut sum = 0.0;
    for (number, (block, linear)) in network.blocks.iter().zip(&network.linear).enumerate() {
        maps = maps.map(|map| {
            let first = if number > 0 { map.halved() } else { map };
            block.iter().fold(first, |map, layer| map.convolved(layer))
        });
        let pixels = maps[0].height * maps[0].width;
        let one = |pixel: usize| {
            let [a, b] = maps.each_ref().map(|map| map.unit(pixel));
            a.iter().zip(&b).zip(linear).map(|((a, b), &w)| f64::from(w) * (a - b) * (a - b)).sum::<f64>()
        };
        sum += (0..pixels).map(one).sum::<f64>() / pixels as f64;
    }
    sum
}
