/// Colours of the visible sources.
struct VisibleParams {
    /// Number of pixels.
    pixels: u32,
    /// Visible sources a pixel, V.
    visible: u32,
}

var<immediate> params: VisibleParams;
