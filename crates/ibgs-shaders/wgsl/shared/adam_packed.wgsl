// One thread a step of three values of a row, whose moments share two words, or of one in rows that three do not divide. The step
// itself is made with moments that are not rounded yet.
#import index
#import hash
#import adam
#import packed_moments

@group(0) @binding(2) var<storage, read_write> moments: array<u32>;
#if HARMONICS
@group(0) @binding(3) var<storage, read> means: array<f32>;
#endif

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) wid: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear_workgroup(wid, groups) * 256u + local;
    let size = select(1u, 3u, params.row % 3u == 0u);
    let first = at * size;
    if first >= params.count {
        return;
    }
    let row = first / params.row;
    let column = first % params.row;
    var random = hash(at ^ hash(params.step));
    if size == 1u {
        let m = adam_moments(unpack_moments(moments[at]), adam_gradient(row, column));
        values[first] = adam_value(values[first], column, m);
        moments[at] = pack_moments(m, random);
        return;
    }
    let codes = split_codes(vec2(moments[2u * at], moments[2u * at + 1u]));
    let v = adam_gradients(row, column);
    var next: vec3<u32>;
    #repeat k 3
    let m$k = adam_moments(unpack_moments(codes[$k]), v[$k]);
    values[first + $ku] = adam_value(values[first + $ku], column + $ku, m$k);
    next[$k] = pack_moments(m$k, random);
    random = hash(random);
    #end
    let words = join_codes(next);
    moments[2u * at] = words.x;
    moments[2u * at + 1u] = words.y;
}
