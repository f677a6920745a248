//! One value for each kind of parameter of a Gaussian.

/// One `T` for each kind of parameter of the Gaussians (method.md section 1): a buffer, a length, a name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PerGaussian<T> {
    /// Positions, `[N, 3]`.
    pub means: T,
    /// Quaternions w x y z, not normalised, `[N, 4]`.
    pub rotations: T,
    /// Logarithms of the standard deviations, `[N, 3]`.
    pub log_scales: T,
    /// Opacities before the sigmoid, `[N]`.
    pub opacity_logits: T,
    /// Spherical-harmonics coefficients, `[N, (degree + 1)^2, 3]`.
    pub sh: T,
    /// Plane normals, `[N, 3]`.
    pub normals: T,
    /// Plane offsets, `[N]`.
    pub offsets: T,
}

impl PerGaussian<()> {
    /// How many kinds there are.
    pub const KINDS: usize = 7;

    /// Their names in messages, in the order of the fields.
    pub const NAMES: PerGaussian<&'static str> = PerGaussian {
        means: "means",
        rotations: "rotations",
        log_scales: "log scales",
        opacity_logits: "opacity logits",
        sh: "spherical harmonics",
        normals: "normals",
        offsets: "offsets",
    };

    /// Their names in the files of checkpoints.
    pub const KEYS: PerGaussian<&'static str> =
        PerGaussian { log_scales: "scales", opacity_logits: "opacities", sh: "sh", ..Self::NAMES };

    /// The names of their fields.
    pub const FIELDS: PerGaussian<&'static str> =
        PerGaussian { log_scales: "log_scales", opacity_logits: "opacity_logits", ..Self::KEYS };

    /// Which of them describe the plane. The base image does not depend on these.
    pub const OF_PLANE: PerGaussian<bool> = PerGaussian {
        means: false,
        rotations: false,
        log_scales: false,
        opacity_logits: false,
        sh: false,
        normals: true,
        offsets: true,
    };

    /// Which of them have gradients: those of the planes with a surface only.
    pub fn with_gradients(surface: bool) -> PerGaussian<bool> {
        Self::OF_PLANE.map(|of_plane| surface || !of_plane)
    }
}

impl<T> PerGaussian<T> {
    /// From an array in the order of the fields.
    pub fn from_array(values: [T; PerGaussian::KINDS]) -> Self {
        let [means, rotations, log_scales, opacity_logits, sh, normals, offsets] = values;
        Self { means, rotations, log_scales, opacity_logits, sh, normals, offsets }
    }

    /// As an array in the order of the fields.
    pub fn into_array(self) -> [T; PerGaussian::KINDS] {
        [self.means, self.rotations, self.log_scales, self.opacity_logits, self.sh, self.normals, self.offsets]
    }

    /// References to the values.
    pub fn as_ref(&self) -> PerGaussian<&T> {
        let Self { means, rotations, log_scales, opacity_logits, sh, normals, offsets } = self;
        PerGaussian { means, rotations, log_scales, opacity_logits, sh, normals, offsets }
    }

    /// References to change the values by.
    pub fn as_mut(&mut self) -> PerGaussian<&mut T> {
        let Self { means, rotations, log_scales, opacity_logits, sh, normals, offsets } = self;
        PerGaussian { means, rotations, log_scales, opacity_logits, sh, normals, offsets }
    }

    /// `change` of every value.
    pub fn map<U>(self, change: impl FnMut(T) -> U) -> PerGaussian<U> {
        PerGaussian::from_array(self.into_array().map(change))
    }

    /// As [`PerGaussian::map`] where it can fail.
    ///
    /// # Errors
    /// The first failure.
    pub fn try_map<U, E>(self, change: impl FnMut(T) -> Result<U, E>) -> Result<PerGaussian<U>, E> {
        let values: Vec<U> = self.into_array().into_iter().map(change).collect::<Result<_, E>>()?;
        Ok(PerGaussian::from_array(values.try_into().unwrap_or_else(|_| unreachable!("as many values"))))
    }

    /// Pairs with another's values.
    pub fn zip<U>(self, other: PerGaussian<U>) -> PerGaussian<(T, U)> {
        let mut others = other.into_array().into_iter();
        self.map(|value| (value, others.next().expect("as many values")))
    }
}

impl PerGaussian<usize> {
    /// Numbers in a row, one row a Gaussian, with `coefficients` colours of spherical harmonics.
    pub fn rows(coefficients: usize) -> Self {
        Self { means: 3, rotations: 4, log_scales: 3, opacity_logits: 1, sh: 3 * coefficients, normals: 3, offsets: 1 }
    }

    /// Numbers in a row of the gradients. That of the spherical harmonics is by the colour: by a coefficient it is this times the
    /// basis in the direction of the view.
    pub fn gradient_rows() -> Self {
        Self::rows(1)
    }
}
