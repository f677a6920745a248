//! Learned masks: cells of a photo that are hidden because they show what no other photo shows.

use super::Photo;

/// Least side of a cell in pixels, and cells along the longer side of a large photo.
const LEAST_SIDE: u32 = 4;
const MOST_CELLS: u32 = 64;

/// Alpha of a hidden pixel: no loss and no warp reads it, and it can be told from one that the photo does not have.
const ALPHA_HIDDEN: u8 = ibgs_shaders::ALPHA_HIDDEN as u8;

/// Which cells of a photo are hidden. A cell is a square of pixels; those at the right and the lower edge may be cut.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellMask {
    size: [u32; 2],
    hidden: Vec<bool>,
}

impl CellMask {
    /// Of a photo of this width and height, row by row; none with another number of cells than such photos have.
    pub fn new(size: [u32; 2], hidden: Vec<bool>) -> Option<Self> {
        let [columns, rows] = Self::grid(size);
        (hidden.len() == columns as usize * rows as usize).then_some(Self { size, hidden })
    }

    /// Side, in pixels, of the cells of photos of this width and height: 64 of them make the longer side, and they have four
    /// pixels at least.
    pub fn side(size: [u32; 2]) -> u32 {
        size[0].max(size[1]).div_ceil(MOST_CELLS).max(LEAST_SIDE)
    }

    /// Cells in a row and in a column.
    pub fn grid(size: [u32; 2]) -> [u32; 2] {
        size.map(|n| n.div_ceil(Self::side(size)))
    }

    /// Width and height of the photo in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Whether each cell is hidden, row by row.
    pub fn hidden(&self) -> &[bool] {
        &self.hidden
    }

    /// Whether no cell is hidden.
    pub fn is_empty(&self) -> bool {
        !self.hidden.contains(&true)
    }

    /// Whether a pixel is hidden.
    pub fn hides(&self, x: u32, y: u32) -> bool {
        let (side, [columns, _]) = (Self::side(self.size), Self::grid(self.size));
        self.hidden[(y / side * columns + x / side) as usize]
    }

    /// The photo with alpha just under one half where a pixel is hidden. Alphas under one half become 0.
    ///
    /// # Panics
    /// When the photo has another size: a bug of ours.
    pub fn applied(&self, photo: &Photo) -> Photo {
        assert_eq!([photo.width, photo.height], self.size, "the mask of a photo has its size");
        let (side, [columns, _]) = (Self::side(self.size) as usize, Self::grid(self.size));
        let mut rgba = photo.rgba.clone();
        let rows = rgba.chunks_exact_mut(4 * photo.width as usize);
        for (y, row) in rows.enumerate() {
            let hidden = &self.hidden[y / side * columns as usize..];
            for (x, pixel) in row.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                pixel[3] = match pixel[3] {
                    0..128 => 0,
                    _ if hidden[x / side] => ALPHA_HIDDEN,
                    own => own,
                };
            }
        }
        Photo { rgba, ..*photo }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::HostPhoto;
    use std::sync::Arc;

    #[test]
    fn cells_grow_with_the_photo() {
        for (size, side, grid) in [([160, 120], 4, [40, 30]), ([1600, 1064], 25, [64, 43]), ([3, 5], 4, [1, 2])] {
            assert_eq!((CellMask::side(size), CellMask::grid(size)), (side, grid), "{size:?}");
        }
        assert!(CellMask::new([160, 120], vec![false; 1199]).is_none());
    }

    #[test]
    fn a_hidden_pixel_keeps_its_colour_and_can_be_told_from_one_that_is_not_there() {
        let mut hidden = vec![false; 6];
        hidden[4] = true;
        let mask = CellMask::new([10, 7], hidden).unwrap();
        let rgba: Vec<u8> = (0..70).flat_map(|p| [p, 1, 2, if p == 45 { 127 } else { 200 }]).collect();
        let photo = HostPhoto::from(Photo { width: 10, height: 7, rgba });
        let (own, masked) = (photo.pixels().unwrap(), photo.clone().masked(Arc::new(mask)).pixels().unwrap());
        for (p, (own, masked)) in own.rgba.chunks(4).zip(masked.rgba.chunks(4)).enumerate() {
            let inside = (4..8).contains(&(p % 10)) && p / 10 >= 4;
            let alpha = if p == 45 {
                0
            } else if inside {
                127
            } else {
                200
            };
            assert_eq!((&masked[..3], masked[3]), (&own[..3], alpha), "pixel {p}");
        }
    }
}
