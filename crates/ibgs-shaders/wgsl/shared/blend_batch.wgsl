// List entries of a tile in workgroup memory, which the threads that blend them load together.

const THREADS: u32 = TILE * TILE;
// Entries at a time: the less workgroup memory, the more workgroups run at once.
const BATCH: u32 = 160u;
// Vectors of a list entry in `batch`: the projected row, of which the last vector is the colour, and the plane.
#if INTERSECTIONS
const ENTRY: u32 = 4u;
#else
const ENTRY: u32 = 3u;
#endif
const COLOR_ROW: u32 = 2u;
const PLANE_ROW: u32 = ENTRY - 1u;

var<workgroup> batch: array<vec4<f32>, ENTRY * BATCH>;
// Threads whose pixel needs no more of them.
var<workgroup> finished: atomic<u32>;
var<workgroup> finished_now: u32;

// Every thread calls it first, in uniform control flow.
fn begin(local: u32) {
    if local == 0u {
        atomicStore(&finished, 0u);
        finished_now = 0u;
    }
    workgroupBarrier();
}

// Every thread calls it before it loads the next entries, in uniform control flow.
fn all_finished(local: u32) -> bool {
    workgroupBarrier();
    if local == 0u {
        finished_now = atomicLoad(&finished);
    }
    return workgroupUniformLoad(&finished_now) == THREADS;
}

// Entry `first` + `local` of the lists, where it lies before `end`; the first BATCH threads load one each.
fn load_entry(local: u32, first: u32, end: u32) {
    if local >= min(BATCH, end - first) {
        return;
    }
    let g = sorted_gaussians[first + local];
    let a = projected[3u * g];
    let b = projected[3u * g + 1u];
    batch[ENTRY * local] = a;
    #if SUBGROUPS
    // In place of depth and radius.
    batch[ENTRY * local + 1u] = vec4(b.xy, block_reach(vec3(a.zw, b.x), b.y));
    #else
    batch[ENTRY * local + 1u] = b;
    #endif
    #if COLOR
    batch[ENTRY * local + COLOR_ROW] = projected[3u * g + 2u];
    #endif
    #if PLANES
    batch[ENTRY * local + PLANE_ROW] = planes[g];
    #endif
}
