//! Rows of the next model from rows of the last.
#set train
#stage other
// One thread a word, a float or packed moments: rows of the next model from rows of the last. The top bit of a source marks a new
// Gaussian, whose optimiser moments start at zero (`params.fresh_zero` = 1).
#import index

/// Row gathering.
struct GatherParams {
    /// Words to write.
    count: u32,
    /// Words a row.
    row: u32,
    /// 1: rows of new Gaussians are zero.
    fresh_zero: u32,
    /// Padding.
    pad: u32,
}

var<immediate> params: GatherParams;

@group(0) @binding(0) var<storage, read> sources: array<u32>;
@group(0) @binding(1) var<storage, read> previous: array<u32>;
@group(0) @binding(2) var<storage, read_write> next: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_workgroup(wid, groups) * 256u + local;
    if i >= params.count {
        return;
    }
    let code = sources[i / params.row];
    let fresh = (code >> 31u) * params.fresh_zero;
    let value = previous[(code & 0x7fffffffu) * params.row + i % params.row];
    next[i] = select(value, 0u, fresh == 1u);
}
