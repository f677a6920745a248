// Exclusive prefix sum over the 256 values of a workgroup (Hillis and Steele); also the total.
var<workgroup> scan_lanes: array<u32, 256>;

struct BlockScan {
    exclusive: u32,
    total: u32,
}

fn scan_block(local: u32, value: u32) -> BlockScan {
    scan_lanes[local] = value;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step <<= 1u) {
        var add = 0u;
        if local >= step {
            add = scan_lanes[local - step];
        }
        workgroupBarrier();
        scan_lanes[local] += add;
        workgroupBarrier();
    }
    let result = BlockScan(scan_lanes[local] - value, scan_lanes[255]);
    workgroupBarrier();
    return result;
}
