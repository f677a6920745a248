// Whether a pass found more tile intersections than it had room for: it saw only a part of the scene, so its gradients
// must not be used. The kernel imports `frame` and declares `offsets`, `tile_counts` and `depth_order`.
fn ran_out_of_room() -> bool {
    return offsets[frame.count - 1u] + tile_counts[depth_order[frame.count - 1u]] > frame.capacity;
}
