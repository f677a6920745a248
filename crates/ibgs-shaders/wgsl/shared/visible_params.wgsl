struct VisibleParams {
    pixels: u32,
    // Visible sources a pixel, V.
    visible: u32,
}

var<immediate> params: VisibleParams;
