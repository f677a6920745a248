//! The parameters of all Gaussians as plain arrays (method.md section 1).

use super::{PerGaussian, SceneError};
use crate::local_space::LocalSpace;
use glam::DVec3;
use std::borrow::Cow;

/// Highest degree of the spherical harmonics.
pub const MAX_SH_DEGREE: u32 = 3;

/// Constant basis function of the spherical harmonics, `1 / (2 sqrt(pi))`: colour = 0.5 + `SH_C0` dc + ...
pub const SH_C0: f64 = 0.282_094_791_773_878_14;

/// N Gaussians, every value as stored, before its activation (method.md section 1), in local coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    /// Where the local coordinates lie in the scene.
    pub space: LocalSpace,
    /// N means.
    pub means: Vec<[f32; 3]>,
    /// N quaternions in the order w, x, y, z, not normalised.
    pub rotations: Vec<[f32; 4]>,
    /// N x 3 natural logarithms of the standard deviations.
    pub log_scales: Vec<[f32; 3]>,
    /// N logits of the opacity.
    pub opacity_logits: Vec<f32>,
    /// N x C x 3 coefficients with C = (`sh_degree` + 1)^2: Gaussian, then coefficient (0 is dc), then channel.
    pub sh: Vec<f32>,
    /// Degree L of the spherical harmonics, 0 to 3.
    pub sh_degree: u32,
    /// N plane normals in world space, not normalised.
    pub normals: Vec<[f32; 3]>,
    /// N offsets of the plane along its normal from the mean.
    pub offsets: Vec<f32>,
    /// Whether a file says that they were trained with antialiasing (the 2D filter of Mip-Splatting), which is not how they are
    /// rendered here. No training sets it.
    pub antialiased: bool,
}

impl Gaussians {
    /// No Gaussians, with room for `capacity` of them.
    pub fn with_capacity(capacity: usize, sh_degree: u32) -> Self {
        Self {
            space: LocalSpace::default(),
            means: Vec::with_capacity(capacity),
            rotations: Vec::with_capacity(capacity),
            log_scales: Vec::with_capacity(capacity),
            opacity_logits: Vec::with_capacity(capacity),
            sh: Vec::with_capacity(capacity.saturating_mul(3 * coefficients(sh_degree))),
            sh_degree,
            normals: Vec::with_capacity(capacity),
            offsets: Vec::with_capacity(capacity),
            antialiased: false,
        }
    }

    /// From the numbers of each kind, one Gaussian after the other.
    pub fn from_values(space: LocalSpace, sh_degree: u32, values: PerGaussian<Vec<f32>>) -> Self {
        let PerGaussian { means, rotations, log_scales, opacity_logits, sh, normals, offsets } = values;
        Self {
            space,
            means: in_rows(means),
            rotations: in_rows(rotations),
            log_scales: in_rows(log_scales),
            opacity_logits,
            sh,
            sh_degree,
            normals: in_rows(normals),
            offsets,
            antialiased: false,
        }
    }

    /// The numbers of each kind.
    pub fn values(&self) -> PerGaussian<&[f32]> {
        PerGaussian {
            means: self.means.as_flattened(),
            rotations: self.rotations.as_flattened(),
            log_scales: self.log_scales.as_flattened(),
            opacity_logits: &self.opacity_logits,
            sh: &self.sh,
            normals: self.normals.as_flattened(),
            offsets: &self.offsets,
        }
    }

    /// The numbers of one Gaussian.
    ///
    /// # Panics
    /// There is no Gaussian with this number.
    pub fn row(&self, number: usize) -> PerGaussian<&[f32]> {
        let rows = PerGaussian::rows(self.sh_coefficients());
        self.values().zip(rows).map(|(values, row)| &values[row * number..row * (number + 1)])
    }

    /// Number of Gaussians N.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// True when there are none.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// Coefficients per channel, C = (L + 1)^2.
    pub fn sh_coefficients(&self) -> usize {
        coefficients(self.sh_degree)
    }

    /// Positions of the means in the scene.
    pub fn positions(&self) -> impl Iterator<Item = DVec3> + Clone {
        self.means.iter().map(|&mean| self.space.to_scene(DVec3::from(mean.map(f64::from))))
    }

    /// The offset of their coordinates in files of single precision ([`LocalSpace::file_offset`]). Those of another file may
    /// have an offset that float32 does not need, such as the translation of a node of glTF: they get none.
    pub fn file_offset(&self) -> Option<DVec3> {
        let offset = self.space.file_offset()?;
        if self.space.scale != 1.0 {
            return Some(offset);
        }
        let own = LocalSpace::of_points(self.positions()).unwrap_or_else(|| {
            let largest = self.log_scales.as_flattened().iter().copied().fold(f32::NEG_INFINITY, f32::max);
            LocalSpace { scale: f64::from(largest).exp(), ..self.space }
        });
        (!own.is_near()).then_some(offset)
    }

    /// The same Gaussians in the local coordinates of another space.
    pub fn into_space(mut self, space: LocalSpace) -> Self {
        let carry = Carry::new(self.space, space);
        self.space = space;
        self.means.iter_mut().for_each(|mean| *mean = carry.mean(*mean));
        self.log_scales.as_flattened_mut().iter_mut().for_each(|scale| *scale = carry.log_scale(*scale));
        self.offsets.iter_mut().for_each(|offset| *offset = carry.offset(*offset));
        self
    }

    /// [`Gaussians::into_space`] without a copy where they are in it already.
    pub fn in_space(&self, space: LocalSpace) -> Cow<'_, Self> {
        if self.space == space { Cow::Borrowed(self) } else { Cow::Owned(self.clone().into_space(space)) }
    }

    /// Adds those of another part of the same model: of the same degree, in the same space.
    ///
    /// # Panics
    /// Another degree of the spherical harmonics: a bug of ours.
    pub fn append(&mut self, part: Self) {
        assert_eq!(self.sh_degree, part.sh_degree, "parts of one model have one degree");
        // Each field by name, so that none can be forgotten.
        let Self {
            space: _,
            means,
            rotations,
            log_scales,
            opacity_logits,
            sh,
            sh_degree: _,
            normals,
            offsets,
            antialiased,
        } = part;
        self.antialiased |= antialiased;
        self.means.extend(means);
        self.rotations.extend(rotations);
        self.log_scales.extend(log_scales);
        self.opacity_logits.extend(opacity_logits);
        self.sh.extend(sh);
        self.normals.extend(normals);
        self.offsets.extend(offsets);
    }

    /// All parts of a file as one: in the space of the first, with the highest degree of any.
    pub(super) fn joined(parts: Vec<Self>) -> Self {
        let degree = parts.iter().map(|part| part.sh_degree).max().unwrap_or_default();
        let mut all = Self::with_capacity(0, degree);
        all.space = parts.first().map(|part| part.space).unwrap_or_default();
        for part in parts {
            let part = if part.sh_degree == degree { part } else { part.with_sh_degree(degree) };
            all.append(part.into_space(all.space));
        }
        all
    }

    /// Those with the given numbers, `count` of them, in that order.
    ///
    /// # Panics
    /// A number that no Gaussian has.
    pub fn rows(&self, count: usize, numbers: impl Iterator<Item = usize> + Clone) -> Self {
        let rows = PerGaussian::rows(self.sh_coefficients());
        let values = self.values().zip(rows).map(|(values, row)| {
            let mut kept = Vec::with_capacity(row * count);
            numbers.clone().for_each(|i| kept.extend_from_slice(&values[row * i..row * (i + 1)]));
            kept
        });
        Self { antialiased: self.antialiased, ..Self::from_values(self.space, self.sh_degree, values) }
    }

    /// With spherical harmonics of another degree: coefficients that are new are zero, others are left out.
    pub fn with_sh_degree(&self, sh_degree: u32) -> Self {
        let [own, wanted] = [self.sh_degree, sh_degree].map(|degree| 3 * coefficients(degree));
        let kept = own.min(wanted);
        let mut sh = vec![0.0; self.len() * wanted];
        for (to, from) in sh.chunks_exact_mut(wanted).zip(self.sh.chunks_exact(own)) {
            to[..kept].copy_from_slice(&from[..kept]);
        }
        Self { sh, sh_degree, ..self.clone() }
    }

    /// Takes the planes away: from a format that has none.
    pub(super) fn remove_planes(&mut self) {
        self.normals = vec![[0.0, 0.0, 1.0]; self.len()];
        self.offsets = vec![0.0; self.len()];
    }

    /// Whether the planes are those of a format that has none.
    pub fn lacks_planes(&self) -> bool {
        self.normals.iter().all(|normal| *normal == [0.0, 0.0, 1.0])
    }

    /// Checks that all fields have the length that `means` asks for and that every value is finite.
    ///
    /// # Errors
    /// [`SceneError::ShDegree`], [`SceneError::Shape`] or [`SceneError::NotFinite`], naming the field.
    pub fn validate(&self) -> Result<(), SceneError> {
        if self.sh_degree > MAX_SH_DEGREE {
            return Err(SceneError::ShDegree { degree: self.sh_degree });
        }
        let n = self.len();
        let named = PerGaussian::FIELDS.zip(self.values()).zip(PerGaussian::rows(self.sh_coefficients()));
        named.try_map(|((field, values), row)| check(field, values, row, n))?;
        Ok(())
    }
}

/// Takes parameters from one space to another, in double precision.
pub(super) struct Carry {
    from: LocalSpace,
    to: LocalSpace,
    ratio: f64,
}

impl Carry {
    pub(super) fn new(from: LocalSpace, to: LocalSpace) -> Self {
        Self { from, to, ratio: from.scale / to.scale }
    }

    pub(super) fn mean(&self, mean: [f32; 3]) -> [f32; 3] {
        if self.from == self.to {
            return mean;
        }
        self.to.to_local(self.from.to_scene(DVec3::from(mean.map(f64::from)))).to_array().map(single)
    }

    pub(super) fn log_scale(&self, log_scale: f32) -> f32 {
        if self.ratio == 1.0 { log_scale } else { single(f64::from(log_scale) + self.ratio.ln()) }
    }

    pub(super) fn offset(&self, offset: f32) -> f32 {
        single(f64::from(offset) * self.ratio)
    }
}

/// In single precision; what does not fit becomes the largest number that does.
fn single(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN, f32::MAX)
}

/// Coefficients per channel of the degrees 0 to `sh_degree`.
pub fn coefficients(sh_degree: u32) -> usize {
    (sh_degree.min(MAX_SH_DEGREE) as usize + 1).pow(2)
}

/// The degree whose higher coefficients are so many numbers, all channels together.
pub(super) fn degree_of(higher: usize) -> Option<u32> {
    (0..=MAX_SH_DEGREE).find(|&degree| 3 * (coefficients(degree) - 1) == higher)
}

fn in_rows<const C: usize>(values: Vec<f32>) -> Vec<[f32; C]> {
    values.as_chunks().0.to_vec()
}

fn check(field: &'static str, values: &[f32], row: usize, n: usize) -> Result<(), SceneError> {
    if values.len() != n * row {
        return Err(SceneError::Shape { field, expected: n * row, found: values.len() });
    }
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(at) => Err(SceneError::NotFinite {
            place: "the model in memory".to_owned(),
            field: field.to_owned(),
            index: at / row,
            value: values[at],
        }),
    }
}
