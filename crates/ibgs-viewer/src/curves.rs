//! What a training's plots show.

use ibgs_core::output::log::TrainingProgress;

/// Most points of a curve; older ones are thinned out.
const MOST: usize = 2000;

/// Loss and PSNR over the iterations.
#[derive(Clone, Debug, Default)]
pub struct Curves {
    /// (iteration, loss).
    pub loss: Vec<[f64; 2]>,
    /// (iteration, PSNR in dB) of recent training photos.
    pub psnr: Vec<[f64; 2]>,
    /// (iteration, number of Gaussians).
    pub gaussians: Vec<[f64; 2]>,
    last: Option<(f32, f32)>,
}

impl Curves {
    /// Adds what a report says, if it is new.
    pub fn add(&mut self, progress: &TrainingProgress) {
        let (Some(loss), Some(psnr)) = (progress.loss, progress.psnr) else { return };
        if self.last == Some((loss, psnr)) {
            return;
        }
        self.last = Some((loss, psnr));
        let at = f64::from(progress.iteration);
        let values = [f64::from(loss), f64::from(psnr), progress.gaussians as f64];
        for (curve, value) in [&mut self.loss, &mut self.psnr, &mut self.gaussians].into_iter().zip(values) {
            curve.push([at, value]);
            if curve.len() > MOST {
                let mut keep = false;
                curve.retain(|_| {
                    keep = !keep;
                    keep
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_stay_short_and_keep_their_ends() {
        let mut curves = Curves::default();
        curves.add(&TrainingProgress::default());
        assert!(curves.loss.is_empty(), "nothing has come back yet");
        for iteration in 0..10_000u32 {
            let (loss, psnr) = (Some(1.0 / (iteration + 1) as f32), Some(20.0));
            let progress = TrainingProgress { iteration, loss, psnr, ..TrainingProgress::default() };
            curves.add(&progress);
            curves.add(&progress);
        }
        assert!(curves.loss.len() <= MOST && curves.loss.len() > MOST / 4);
        assert_eq!((curves.loss[0][0], curves.psnr.len()), (0.0, curves.loss.len()));
        assert!(curves.loss.windows(2).all(|pair| pair[0][0] < pair[1][0]));
        assert!(curves.loss.last().unwrap()[0] > 9_990.0);
    }
}
