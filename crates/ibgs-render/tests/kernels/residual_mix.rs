//! The sources' share in the final colour against its twin.

use ibgs_reference::gpu::gpu;
use ibgs_reference::random_scene::random_image;
use ibgs_reference::relative_error;
use ibgs_render::gpu::Pass;
use ibgs_render::residual::mix::SourceMix;

const PIXELS: usize = 35 * 9;
const VISIBLE: usize = 3;

/// Colours and cosines of the sources, and the words that say which pixels see them, with errors of up to 14 thirds.
struct View {
    warped: Vec<[f64; 4]>,
    seen: Vec<[u8; 4]>,
    image: Vec<[f64; 3]>,
}

impl View {
    fn new() -> Self {
        let colors = random_image(PIXELS as u32, VISIBLE as u32, 0.0, 1.0, 1);
        let cosines = random_image(PIXELS as u32, VISIBLE as u32, 0.9, 1.0, 2);
        let warped = colors.iter().zip(&cosines).map(|([r, g, b], [cosine, ..])| [*r, *g, *b, *cosine]);
        let word = |p: usize| {
            let byte = |m: usize| if m < p % (VISIBLE + 1) { (m | ((p / 4 + 5 * m) % 15) << 4) as u8 } else { 255 };
            [byte(0), byte(1), byte(2), 255]
        };
        Self {
            warped: warped.collect(),
            seen: (0..PIXELS).map(word).collect(),
            image: random_image(PIXELS as u32, 1, 0.0, 1.0, 3),
        }
    }

    /// The twin, in double precision.
    fn mixed(&self, share: f64) -> Vec<[f64; 3]> {
        let (angle, doubt) = (f64::from(SourceMix::ANGLE), f64::from(SourceMix::DOUBT));
        let mixed = |p: usize| {
            let seen = (0..VISIBLE).filter(|&m| self.seen[p][m] != 255);
            let sources = seen.map(|m| {
                let [r, g, b, cosine] = self.warped[m * PIXELS + p];
                let error = f64::from(self.seen[p][m] >> 4) / 3.0;
                let weight = (-error * error / 2.0 - (2.0 - 2.0 * cosine).max(0.0).sqrt() / angle).exp();
                (weight, [r, g, b])
            });
            let sources: Vec<(f64, [f64; 3])> = sources.collect();
            let total: f64 = sources.iter().map(|(weight, _)| weight).sum();
            std::array::from_fn(|c| {
                let own = self.image[p][c];
                let towards: f64 = sources.iter().map(|(weight, color)| weight * (color[c] - own)).sum();
                own + share * towards / (doubt + total)
            })
        };
        (0..PIXELS).map(mixed).collect()
    }

    fn on_gpu(&self, share: f32) -> Vec<f64> {
        let gpu = gpu();
        let upload = |values: &[f64]| {
            let single: Vec<f32> = values.iter().map(|v| *v as f32).collect();
            gpu.upload("test", &single).unwrap()
        };
        let (warped, image) = (upload(self.warped.as_flattened()), upload(self.image.as_flattened()));
        let words: Vec<u32> = self.seen.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
        let seen = gpu.upload("test", &words).unwrap();
        let mut pass = Pass::new(&gpu, "mix");
        SourceMix::new(PIXELS as u32, VISIBLE as u32, share).record(&mut pass, &warped.cast(), &seen, &image);
        pass.submit();
        gpu.read(&image, 3 * PIXELS).unwrap().into_iter().map(f64::from).collect()
    }
}

#[test]
fn colours_follow_the_twin() {
    let view = View::new();
    for share in [0.25, 1.0] {
        let error = relative_error(&view.on_gpu(share as f32), view.mixed(share).as_flattened());
        assert!(error < 2e-6, "share {share}: {error:.1e}");
    }
}

/// Without a source, or a share, a colour stays to the last bit, whatever lies in the places of sources that are not there; otherwise
/// it comes nearer to what the sources show, also where a cosine is rounded to more than 1.
#[test]
fn only_what_a_source_shows_changes() {
    let mut view = View::new();
    for (i, source) in view.warped.iter_mut().enumerate() {
        let (m, p) = (i / PIXELS, i % PIXELS);
        match view.seen[p][m] {
            255 => *source = [f64::NAN; 4],
            _ => source[3] = source[3].max(f64::from(1f32.next_up()) - 0.05 * f64::from(p as u32 % 2)),
        }
    }
    let towards = view.mixed(1.0);
    let own: Vec<f64> = view.image.as_flattened().iter().map(|v| f64::from(*v as f32)).collect();
    assert_eq!(view.on_gpu(0.0), own);
    let mixed = view.on_gpu(0.25);
    for (p, (new, old)) in mixed.chunks_exact(3).zip(own.chunks_exact(3)).enumerate() {
        assert_eq!(new == old, view.seen[p][0] == 255, "pixel {p}");
        let distance = |color: &[f64]| color.iter().zip(towards[p]).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        assert!(new == old || distance(new) < distance(old), "pixel {p}");
    }
}
