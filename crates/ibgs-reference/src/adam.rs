//! Twin of the optimiser step (method.md section 1): Adam with bias correction.

/// Settings of one step. The moments' decay rates are `beta1` and `beta2`; `eps` is added after the square root of
/// the bias-corrected second moment.
#[derive(Clone, Copy, Debug)]
pub struct Adam {
    pub learning_rate: f64,
    pub beta1: f64,
    pub beta2: f64,
    pub eps: f64,
    /// Share of a value that is lost in a step, times the learning rate, beside the gradient's step.
    pub decay: f64,
}

impl Adam {
    /// The settings of the Gaussians' tensors.
    pub fn gaussians(learning_rate: f64) -> Adam {
        Adam { learning_rate, beta1: 0.9, beta2: 0.999, eps: 1e-15, decay: 0.0 }
    }

    /// One step in place; `step` counts from 1.
    pub fn step(&self, step: u32, value: &mut [f64], grad: &[f64], m: &mut [f64], v: &mut [f64]) {
        assert!(step > 0, "Adam's step counts from 1");
        let correction1 = 1.0 - self.beta1.powi(step as i32);
        let correction2 = 1.0 - self.beta2.powi(step as i32);
        for i in 0..value.len() {
            m[i] = self.beta1 * m[i] + (1.0 - self.beta1) * grad[i];
            v[i] = self.beta2 * v[i] + (1.0 - self.beta2) * grad[i] * grad[i];
            let kept = (1.0 - self.learning_rate * self.decay) * value[i];
            value[i] = kept - self.learning_rate * (m[i] / correction1) / ((v[i] / correction2).sqrt() + self.eps);
        }
    }
}
