// Whether a pass found more tile intersections than it had room for: it saw only a part of the scene, so its gradients
// must not be used. The kernel imports `frame` and declares `total`, the intersections in all.
fn ran_out_of_room() -> bool {
    return total[0] > frame.capacity;
}
