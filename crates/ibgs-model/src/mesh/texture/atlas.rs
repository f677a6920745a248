//! Where the charts lie in the texture.

use crate::mesh::MeshError;
use glam::{UVec2, Vec2};
use guillotiere::{AtlasAllocator, size2};

/// Texels around each chart, so that neither filtering nor reduced copies reach the next one.
pub const PADDING: u32 = 4;
/// Part of a texture that charts fill at most.
const FILL: f32 = 0.9;
/// What is tried next where the charts do not fit: a larger side, or smaller charts.
const STEP: f32 = 1.06;
/// Charts are not made smaller than this.
const LEAST_SCALE: f32 = 0.01;

/// Charts in a square.
#[derive(Debug)]
pub struct Atlas {
    /// Width and height in texels.
    pub side: u32,
    /// Texels for a pixel of the charts.
    pub scale: f32,
    /// Least corner of each chart, with its padding.
    pub places: Vec<UVec2>,
}

impl Atlas {
    /// Packs charts of these sizes into a square, the smallest that they fit in at their scale, or one of `most` texels with
    /// smaller charts.
    ///
    /// # Errors
    /// [`MeshError::Option`] where that is too small for their number.
    pub fn of(sizes: &[Vec2], most: u32) -> Result<Self, MeshError> {
        let area = sizes.iter().map(|&size| extent(size, 1.0).as_vec2().element_product()).sum::<f32>();
        let mut side = (area / FILL).sqrt();
        let mut scale = 1.0;
        while scale > LEAST_SCALE {
            let whole = (side as u32).clamp(1, most);
            if let Some(places) = places(sizes, scale, whole) {
                return Ok(Self { side: whole, scale, places });
            }
            if whole < most { side *= STEP } else { scale /= STEP }
        }
        let wanted = "large enough for this mesh: choose a larger one, or fewer triangles";
        Err(MeshError::Option { option: "the side of the texture", value: most.to_string(), wanted })
    }
}

/// Texels that a chart takes with its padding.
pub fn extent(size: Vec2, scale: f32) -> UVec2 {
    (size * scale).ceil().as_uvec2().max(UVec2::ONE) + 2 * PADDING
}

fn places(sizes: &[Vec2], scale: f32, side: u32) -> Option<Vec<UVec2>> {
    let extents: Vec<UVec2> = sizes.iter().map(|&size| extent(size, scale)).collect();
    // The next would take some seconds to fail by itself.
    let area: u64 = extents.iter().map(|e| u64::from(e.x) * u64::from(e.y)).sum();
    if area > u64::from(side) * u64::from(side) {
        return None;
    }
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(extents[i].max_element()), i));
    let mut atlas = AtlasAllocator::new(size2(side as i32, side as i32));
    let mut places = vec![UVec2::ZERO; sizes.len()];
    for i in order {
        let UVec2 { x, y } = extents[i];
        let corner = atlas.allocate(size2(x as i32, y as i32))?.rectangle.min;
        places[i] = UVec2::new(corner.x as u32, corner.y as u32);
    }
    Some(places)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sizes() -> Vec<Vec2> {
        (0..300).map(|i| Vec2::new((i * 7 % 61) as f32 + 0.5, (i * 13 % 47) as f32)).collect()
    }

    fn assert_apart(atlas: &Atlas) {
        let mut owner = vec![false; (atlas.side * atlas.side) as usize];
        for (place, size) in atlas.places.iter().zip(sizes()) {
            let end = place + extent(size, atlas.scale);
            assert!(end.max_element() <= atlas.side, "{end} of {}", atlas.side);
            for y in place.y..end.y {
                for x in place.x..end.x {
                    assert!(!std::mem::replace(&mut owner[(y * atlas.side + x) as usize], true), "{x} {y}");
                }
            }
        }
    }

    #[test]
    fn charts_lie_apart_in_a_square_that_they_fill() {
        let atlas = Atlas::of(&sizes(), 4096).unwrap();
        assert_apart(&atlas);
        let area: u32 = sizes().iter().map(|&size| extent(size, 1.0).element_product()).sum();
        let fill = area as f32 / (atlas.side * atlas.side) as f32;
        assert!(atlas.scale == 1.0 && fill > 0.75, "{fill} of {}", atlas.side);
    }

    #[test]
    fn charts_become_smaller_where_the_texture_ends() {
        let atlas = Atlas::of(&sizes(), 400).unwrap();
        assert_apart(&atlas);
        assert!(atlas.side == 400 && (0.1..0.9).contains(&atlas.scale), "{} {}", atlas.side, atlas.scale);
        let error = Atlas::of(&sizes(), 64).unwrap_err().to_string();
        assert!(error.contains("the side of the texture is 64, which is not large enough for this mesh"), "{error}");
    }
}
