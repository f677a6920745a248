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
