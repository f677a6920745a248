//! Twins of the exposure correction (method.md section 8).

use glam::{DMat3, DVec3};

use super::image_loss::{Map, image_loss, l1, ssim, ssim_backward};

/// corrected = linear base + offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    pub linear: DMat3,
    pub offset: DVec3,
}

impl Affine {
    pub const IDENTITY: Affine = Affine { linear: DMat3::IDENTITY, offset: DVec3::ZERO };

    pub fn apply(&self, color: [f64; 3]) -> [f64; 3] {
        (self.linear * DVec3::from(color) + self.offset).to_array()
    }

    /// Gradient by the colour from that by the corrected colour.
    pub fn backward(&self, v_corrected: [f64; 3]) -> [f64; 3] {
        (self.linear.transpose() * DVec3::from(v_corrected)).to_array()
    }

    /// Rows of [linear | offset].
    pub fn rows(&self) -> Vec<f64> {
        (0..3).flat_map(|r| self.linear.row(r).extend(self.offset[r]).to_array()).collect()
    }
}

/// The maps of a target view.
#[derive(Clone, Debug, PartialEq)]
pub struct Maps {
    /// To the exposure of the output.
    pub output: Affine,
    /// To that of each source.
    pub sources: Vec<Affine>,
}

impl Maps {
    /// Without any correction.
    pub fn identity(sources: usize) -> Maps {
        Maps { output: Affine::IDENTITY, sources: vec![Affine::IDENTITY; sources] }
    }

    /// Base colours `[P]`, colours `[V][P]` of the packed slots, and their sources, none where a slot is empty. `photo`: the
    /// target's, with what counts of it; without one the output has the exposure of source 0.
    pub fn fit(
        base: &[[f64; 3]],
        warped: &[Map],
        slots: &[Vec<Option<usize>>],
        sources: usize,
        photo: Option<(&[[f64; 3]], &[bool])>,
    ) -> Maps {
        let of = |source: usize| -> (Map, Vec<bool>) {
            let found = |p: usize| (0..slots.len()).find(|m| slots[*m][p] == Some(source)).map(|m| warped[m][p]);
            let colors: Vec<_> = (0..base.len()).map(found).collect();
            (colors.iter().map(|c| c.unwrap_or_default()).collect(), colors.iter().map(Option::is_some).collect())
        };
        let output = match photo {
            Some((photo, valid)) => fit(base, photo, valid),
            None => {
                let (colors, visible) = of(0);
                fit(base, &colors, &visible)
            }
        };
        let source = |m: usize| {
            let (colors, visible) = of(m);
            fit_or(base, &colors, &visible, output)
        };
        Maps { output, sources: (0..sources).map(source).collect() }
    }

    /// A warped colour of a source with the change of exposure to the output.
    pub fn shift(&self, source: usize, base: [f64; 3], warped: [f64; 3]) -> [f64; 3] {
        let (output, own) = (self.output.apply(base), self.sources[source].apply(base));
        std::array::from_fn(|c| warped[c] + output[c] - own[c])
    }

    /// Gradient by the base colour from that by the shifted one.
    pub fn shift_backward(&self, source: usize, v: [f64; 3]) -> [f64; 3] {
        let (output, own) = (self.output.backward(v), self.sources[source].backward(v));
        std::array::from_fn(|c| output[c] - own[c])
    }
}

/// Sum of a b^T.
fn outer(pairs: &[(DVec3, DVec3)]) -> DMat3 {
    pairs.iter().fold(DMat3::ZERO, |sum, (a, b)| sum + DMat3::from_cols(*a * b.x, *a * b.y, *a * b.z))
}

/// Pivots of the elimination of a symmetric matrix, without exchanges.
fn pivots(m: &DMat3) -> [f64; 3] {
    let (a, b) = (m.x_axis.x, m.x_axis.x * m.y_axis.y - m.x_axis.y * m.x_axis.y);
    [a, b / a, m.determinant() / b]
}

/// The affine map that takes `base` to `warped` over the visible pixels by least squares, with a ridge of 1e-6 mean
/// variances towards the identity. The identity for fewer than 64 pixels, a ratio of smallest to largest pivot under
/// 1e-5, or variances under 1e-8.
pub fn fit(base: &[[f64; 3]], warped: &[[f64; 3]], visible: &[bool]) -> Affine {
    fit_or(base, warped, visible, Affine::IDENTITY)
}

/// The same with another map where there is not enough to go by.
pub fn fit_or(base: &[[f64; 3]], warped: &[[f64; 3]], visible: &[bool], otherwise: Affine) -> Affine {
    let pairs: Vec<(DVec3, DVec3)> =
        (0..base.len()).filter(|i| visible[*i]).map(|i| (DVec3::from(base[i]), DVec3::from(warped[i]))).collect();
    let count = pairs.len() as f64;
    if count < 64.0 {
        return otherwise;
    }
    let mean_x = pairs.iter().map(|p| p.0).sum::<DVec3>() / count;
    let mean_y = pairs.iter().map(|p| p.1).sum::<DVec3>() / count;
    let centred: Vec<_> = pairs.iter().map(|(x, y)| (*x - mean_x, *y - mean_y)).collect();
    let own: Vec<_> = centred.iter().map(|(d, _)| (*d, *d)).collect();
    let swapped: Vec<_> = centred.iter().map(|(d, e)| (*e, *d)).collect();
    let (c, g) = (outer(&own), outer(&swapped));
    let ridge = 1e-6 * (c.x_axis.x + c.y_axis.y + c.z_axis.z) / 3.0;
    let system = c + DMat3::IDENTITY * ridge;
    let pivots = pivots(&system);
    let smallest = pivots.into_iter().fold(f64::INFINITY, f64::min);
    let largest = pivots.into_iter().fold(0.0, f64::max);
    if !(smallest >= 1e-5 * largest && largest >= 1e-8 * count) {
        return otherwise;
    }
    let linear = (g + DMat3::IDENTITY * ridge) * system.inverse();
    Affine { linear, offset: mean_y - linear * mean_x }
}

/// The scalars count while 1 - SSIM of the unmodified image is under this.
const SSIM_GATE: f64 = 0.5;

/// A photo over a background, by as much as `cover` leaves of it.
pub struct Object {
    pub photo: Map,
    pub cover: Vec<f64>,
    pub background: [f64; 3],
}

impl Object {
    /// A photo that leaves nothing of the background.
    pub fn opaque(photo: &[[f64; 3]]) -> Object {
        Object { photo: photo.to_vec(), cover: vec![1.0; photo.len()], background: [0.0; 3] }
    }

    /// What an image in the exposure exp(a) x + b is compared with: the background has it too.
    pub fn target(&self, [a, b]: [f64; 2]) -> Map {
        let pixel = |(photo, cover): (&[f64; 3], &f64)| {
            std::array::from_fn(|c| cover * photo[c] + (1.0 - cover) * (a.exp() * self.background[c] + b))
        };
        self.photo.iter().zip(&self.cover).map(pixel).collect()
    }
}

fn expose(image: &[[f64; 3]], [a, b]: [f64; 2]) -> Map {
    image.iter().map(|p| p.map(|x| a.exp() * x + b)).collect()
}

/// Whether the exposure counts.
fn is_open(image: &[[f64; 3]], target: &[[f64; 3]], width: usize, height: usize) -> bool {
    1.0 - ssim(image, target, width, height) < SSIM_GATE
}

/// (1 - lambda) L1(exp(a) image + b) + lambda (1 - SSIM(image)); the plain image loss where the images differ too much.
pub fn exposed_loss(
    image: &[[f64; 3]],
    object: &Object,
    width: usize,
    height: usize,
    lambda: f64,
    scalars: [f64; 2],
) -> f64 {
    let target = object.target([0.0; 2]);
    let scalars = if is_open(image, &target, width, height) { scalars } else { [0.0; 2] };
    (1.0 - lambda) * l1(&expose(image, scalars), &object.target(scalars))
        + image_loss(image, &target, width, height, lambda)
        - (1.0 - lambda) * l1(image, &target)
}

/// Gradients of `exposed_loss` by the image and by (a, b).
pub fn exposed_loss_backward(
    image: &[[f64; 3]],
    object: &Object,
    width: usize,
    height: usize,
    lambda: f64,
    scalars: [f64; 2],
) -> (Map, [f64; 2]) {
    let target = object.target([0.0; 2]);
    let open = is_open(image, &target, width, height);
    let scalars = if open { scalars } else { [0.0; 2] };
    let (exposed, shown, gain) = (expose(image, scalars), object.target(scalars), scalars[0].exp());
    let share = (1.0 - lambda) / (3 * image.len()) as f64;
    let v_ssim = vec![[-lambda / (3 * image.len()) as f64; 3]; image.len()];
    let mut v_image = ssim_backward(image, &target, width, height, &v_ssim);
    let mut v_scalars = [0.0; 2];
    for (i, v) in v_image.iter_mut().enumerate() {
        let behind = 1.0 - object.cover[i];
        for (c, v) in v.iter_mut().enumerate() {
            let difference = exposed[i][c] - shown[i][c];
            let side = if difference == 0.0 { 0.0 } else { difference.signum() };
            *v += share * side * gain;
            if open {
                v_scalars[0] += share * side * gain * (image[i][c] - behind * object.background[c]);
                v_scalars[1] += share * side * (1.0 - behind);
            }
        }
    }
    (v_image, v_scalars)
}
