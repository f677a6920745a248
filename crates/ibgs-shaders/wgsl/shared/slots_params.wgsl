struct SlotsParams {
    pixels: u32,
    // Packed slots V.
    slots: u32,
}

var<immediate> params: SlotsParams;
