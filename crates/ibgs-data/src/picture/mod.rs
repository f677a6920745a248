//! What a view shows, as pictures for the eye: colours, residual, depth, normals, number of sources. Exact values go to an
//! EXR file ([`exr`]).

pub mod exr;
mod read;
mod scale_bar;
pub mod web;

pub use read::{ReadError, read_picture};

use crate::files::WriteError;
use crate::image_io::write_png;
use colorous::VIRIDIS;
use std::path::Path;

/// An 8-bit RGB picture, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height * 3` bytes.
    pub rgb: Vec<u8>,
}

/// 0..1 clamped and rounded to 8 bits.
fn to_byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

impl Picture {
    /// Colours `[H, W, 3]`, clamped to 0..1.
    pub fn colors(width: u32, height: u32, rgb: &[f32]) -> Self {
        Self { width, height, rgb: rgb.iter().map(|&v| to_byte(v)).collect() }
    }

    /// A residual `[H, W, 3]` as 0.5 + residual: grey where it changes nothing.
    pub fn residual(width: u32, height: u32, residual: &[f32]) -> Self {
        Self { width, height, rgb: residual.iter().map(|&v| to_byte(0.5 + v)).collect() }
    }

    /// View depths `[H, W]` in the colours of viridis, near bright and far dark, above a bar that shows the depths of the
    /// colours. Pixels without a depth (0, or not finite) are black. `range` is the depth of the brightest and of the darkest
    /// colour; without it the range of the picture is taken, one pixel in a hundred at either end aside.
    pub fn depth(width: u32, height: u32, depth: &[f32], range: Option<[f32; 2]>) -> Self {
        let [near, far] = range.unwrap_or_else(|| usual_range(depth));
        let span = (far - near).max(f32::MIN_POSITIVE);
        let color = |&z: &f32| if is_depth(z) { viridis(1.0 - (z - near) / span) } else { [0; 3] };
        let picture = Self { width, height, rgb: depth.iter().flat_map(color).collect() };
        scale_bar::below(picture, [near, far])
    }

    /// Camera-space normals `[H, W, 3]` of any length. They are shown in the axes of normal maps (x right, y up, z towards
    /// the viewer; those of the camera are x right, y down, z away) as `(n + 1) / 2`: a surface that faces the camera is
    /// (128, 128, 255), its upper edge greenish, its right one reddish. Pixels without a normal are black.
    pub fn normals(width: u32, height: u32, normals: &[f32]) -> Self {
        let color = |n: &[f32]| {
            let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
            if !(length > 0.0 && length.is_finite()) {
                return [0; 3];
            }
            [n[0], -n[1], -n[2]].map(|v| to_byte(0.5 * v / length + 0.5))
        };
        Self { width, height, rgb: normals.chunks_exact(3).flat_map(color).collect() }
    }

    /// Number of sources `[H, W]` that see a pixel's point, of at most `most`, in the colours of viridis; 0 is black.
    pub fn visibility(width: u32, height: u32, counts: &[u32], most: u32) -> Self {
        let color = |&n: &u32| visibility_color(n, most);
        Self { width, height, rgb: counts.iter().flat_map(color).collect() }
    }

    /// Writes it as PNG in one atomic step, folders included.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        write_png(path, self.width, self.height, &self.rgb)
    }
}

/// Number of visible photos that has the brightest colour.
pub const MOST_VISIBLE: u32 = 4;

/// Colour of a number of visible photos, of which `most` has the brightest; none is black.
pub fn visibility_color(count: u32, most: u32) -> [u8; 3] {
    if count == 0 { [0; 3] } else { viridis(count as f32 / most.max(1) as f32) }
}

/// The colour of viridis at `t`, clamped to 0..1.
pub fn viridis(t: f32) -> [u8; 3] {
    let color = VIRIDIS.eval_continuous(f64::from(t));
    [color.r, color.g, color.b]
}

fn is_depth(z: f32) -> bool {
    z > 0.0 && z.is_finite()
}

/// Depths between the first and the last hundredth; 0..1 without any.
pub fn usual_range(depth: &[f32]) -> [f32; 2] {
    let mut known: Vec<f32> = depth.iter().copied().filter(|&z| is_depth(z)).collect();
    if known.is_empty() {
        return [0.0, 1.0];
    }
    known.sort_by(f32::total_cmp);
    let last = known.len() - 1;
    [known[last / 100], known[last - last / 100]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_residual_and_normals() {
        assert_eq!(Picture::colors(1, 1, &[-0.1, 0.5, 2.0]).rgb, [0, 128, 255]);
        assert_eq!(Picture::residual(1, 1, &[0.0, -0.5, 0.25]).rgb, [128, 0, 191]);
        // Facing the camera, pointing up, pointing right at any length, none.
        let normals = [0.0, 0.0, -1.0, 0.0, -0.25, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let expected = [[128, 128, 255], [128, 255, 128], [255, 128, 128], [0, 0, 0]];
        assert_eq!(Picture::normals(4, 1, &normals).rgb, expected.concat());
        let counts = Picture::visibility(3, 1, &[0, 1, 3], 3).rgb;
        assert_eq!((&counts[..3], &counts[6..]), (&[0; 3][..], &viridis(1.0)[..]));
    }

    #[test]
    fn depth_has_a_bar_below() {
        let (width, height) = (200, 40);
        let depth: Vec<f32> =
            (0..width * height).map(|i| if i == 7 { 0.0 } else { 2.0 + (i % width) as f32 / 100.0 }).collect();
        let picture = Picture::depth(width, height, &depth, Some([2.0, 3.99]));
        assert!(picture.height > height && picture.rgb.len() == (picture.width * picture.height * 3) as usize);
        let at = |x: u32, y: u32| &picture.rgb[3 * (y * width + x) as usize..][..3];
        assert_eq!((at(0, 5), at(199, 5), at(7, 0)), (&viridis(1.0)[..], &viridis(0.0)[..], &[0; 3][..]));
        // The bar has the picture's colours, the nearest first.
        assert_eq!(at(0, height + 2), at(0, 5));
        assert_eq!(at(199, height + 2), at(199, 5));
        let white = picture.rgb[(3 * width * height) as usize..].chunks_exact(3).filter(|p| *p == [255; 3]).count();
        assert!(white > 40, "{white} pixels of numbers");
        // Too narrow for numbers, empty, and odd values.
        for depth in [vec![0.0; 6], vec![f32::NAN, 1.0, 1.0, 1.0, f32::INFINITY, -1.0]] {
            assert_eq!(Picture::depth(3, 2, &depth, None).width, 3);
        }
    }

    #[test]
    fn outliers_do_not_set_the_range() {
        let mut depth = vec![0.0; 50];
        depth.extend((0..=1000).map(|i| 1.0 + i as f32 / 1000.0));
        depth.extend([1e6; 5]);
        let [near, far] = usual_range(&depth);
        assert!((1.0..1.02).contains(&near) && (1.98..=2.0).contains(&far), "{near} {far}");
    }
}
