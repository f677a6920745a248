struct ScanLength {
    // Elements to scan.
    count: u32,
}

var<immediate> scan: ScanLength;
