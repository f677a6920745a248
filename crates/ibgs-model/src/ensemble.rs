//! Ensembles: several bases, whose images are averaged. The first member has the surface; it and the first of the others have a
//! network, whose residuals are averaged too, the rest are models of the base alone.

use crate::exposure::Exposure;
use crate::scene::Gaussians;
use std::collections::HashMap;

/// A member of an ensemble besides the first.
#[derive(Clone, Debug)]
pub struct Member {
    /// Its Gaussians, as the file has them.
    pub gaussians: Gaussians,
    /// Flat weights of its residual network, where it has one.
    pub network: Option<Vec<f32>>,
    /// What it learned of the training photos' exposures, by name; none where they were not corrected.
    pub exposure: Option<HashMap<String, Exposure>>,
}

/// The Gaussians of all bases as those of one model, in the space of the first and the largest degree of all. Of N bases each has
/// the opacity 1 - (1 - a)^(1 / N), so that what all of them make of a place is as opaque as one was. No image of it is the mean of
/// the bases' images, but a training that begins with it comes near.
pub fn united(first: &Gaussians, members: &[Member]) -> Gaussians {
    let all = || std::iter::once(first).chain(members.iter().map(|member| &member.gaussians));
    let (count, degree) = (all().count() as f64, all().map(|base| base.sh_degree).max().unwrap_or_default());
    let mut united = Gaussians::with_capacity(all().map(Gaussians::len).sum(), degree);
    united.space = first.space;
    all().for_each(|base| united.append(base.in_space(first.space).with_sh_degree(degree)));
    for logit in &mut united.opacity_logits {
        // -ln(1 - a) of what was, and the logit of an Nth of it.
        let depth = f64::from(*logit).exp().ln_1p().min(f64::from(f32::MAX));
        *logit = (depth / count).exp_m1().ln() as f32;
    }
    united
}

/// The folder of a further member's files inside that of the first, by its number from 2.
pub fn folder(member: usize) -> String {
    format!("member_{member}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use ibgs_testing::random_gaussians;

    #[test]
    fn united_bases_are_as_opaque_as_one() {
        let mut first = random_gaussians(6, 1, 1);
        first.opacity_logits = vec![-8.0, -2.0, 0.0, 3.0, 20.0, 90.0];
        let further = |seed, degree| {
            let gaussians =
                Gaussians { opacity_logits: first.opacity_logits.clone(), ..random_gaussians(6, degree, seed) };
            Member { gaussians, network: None, exposure: None }
        };
        let members = [further(2, 3), further(3, 0)];
        let united = united(&first, &members);
        united.validate().unwrap();
        assert_eq!((united.len(), united.sh_degree), (18, 3));
        let through = |logit: f32| 1.0 / (1.0 + f64::from(logit).exp());
        for (i, &logit) in first.opacity_logits.iter().enumerate() {
            let all: f64 = [i, 6 + i, 12 + i].map(|at| through(united.opacity_logits[at])).iter().product();
            let expected = through(logit);
            assert!((all - expected).abs() <= 1e-5 * expected.max(1e-12), "{logit}: {all} in place of {expected}");
        }
        let alone = super::united(&first, &[]);
        for (own, united) in first.opacity_logits.iter().zip(&alone.opacity_logits) {
            assert!((own - united).abs() < 1e-4, "{own} became {united}");
        }
    }
}
