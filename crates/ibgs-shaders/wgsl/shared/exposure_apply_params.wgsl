struct ExposureApplyParams {
    pixels: u32,
    // Packed slots V.
    slots: u32,
    // 1: the base colour of pixels that see no source stays as it is.
    seen_only: u32,
}

var<immediate> params: ExposureApplyParams;

// Whether a pixel's base colour is left as it is.
fn stays(packed: u32) -> bool {
    return params.seen_only == 1u && !slot_filled(packed, 0u);
}
