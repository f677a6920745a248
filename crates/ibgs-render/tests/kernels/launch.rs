//! How passes reach the queue, and what their bind groups keep.

use ibgs_reference::gpu::{gpu, open_gpu};
use ibgs_render::gpu::scan::Scan;
use ibgs_render::gpu::{Batch, Buffer, Gpu, Pass, flush};

const VALUES: [u32; 4] = [3, 1, 4, 1];
const NONE: [u32; 4] = [0; 4];

/// What another thread reads, whose reads do not flush this one's batch.
fn elsewhere(gpu: &Gpu, buffer: &Buffer<u32>) -> Vec<u32> {
    std::thread::scope(|scope| scope.spawn(|| gpu.read(buffer, 4).unwrap()).join().unwrap())
}

fn copy(gpu: &Gpu, source: &Buffer<u32>, target: &Buffer<u32>) {
    let mut pass = Pass::new(gpu, "test");
    pass.copy(source, target, 0, 4);
    pass.submit();
}

#[test]
fn the_passes_of_a_batch_are_submitted_together_and_in_order() {
    let gpu = gpu();
    let [source, between, target] = [VALUES, NONE, NONE].map(|values| gpu.upload("values", &values).unwrap());
    let batch = Batch::new(&gpu);
    copy(&gpu, &source, &between);
    copy(&gpu, &between, &target);
    assert_eq!(elsewhere(&gpu, &target), NONE, "submitted before its batch is flushed");
    flush();
    assert_eq!(elsewhere(&gpu, &target), VALUES);

    let mut pass = Pass::new(&gpu, "test");
    pass.clear(&between);
    pass.submit();
    copy(&gpu, &between, &target);
    assert_eq!(gpu.read(&target, 4).unwrap(), NONE, "a read flushes");

    copy(&gpu, &source, &between);
    let mut pass = Pass::new(&gpu, "test");
    pass.copy(&between, &target, 0, 4);
    let end = pass.submit_marked();
    gpu.wait_for(end).unwrap();
    assert_eq!(elsewhere(&gpu, &target), VALUES, "a marked pass is submitted with the rest of its batch");

    // Of two open passes the one that ends first comes first.
    let mut last = Pass::new(&gpu, "test");
    last.copy(&between, &target, 0, 4);
    let mut first = Pass::new(&gpu, "test");
    first.clear(&between);
    first.submit();
    last.submit();
    drop(batch);
    assert_eq!(elsewhere(&gpu, &target), NONE, "the end of a batch flushes");

    copy(&gpu, &source, &target);
    assert_eq!(elsewhere(&gpu, &target), VALUES, "without a batch a pass is submitted at once");
}

/// On a device of its own, on which nothing else allocates.
#[test]
fn bind_groups_keep_memory_until_it_is_needed() {
    const LABEL: &str = "memory of a bind group";
    let gpu = open_gpu();
    let scan = Scan::new(&gpu, 4).unwrap();
    let [sums, total] = [NONE, NONE].map(|values| gpu.upload("values", &values).unwrap());
    let is_there = || {
        gpu.wait().unwrap();
        let memory = gpu.memory_report().expect("the driver of the tests tells");
        memory.kinds.iter().any(|kind| kind.name == LABEL)
    };
    let frees: [(&str, &dyn Fn()); 2] =
        [("release", &|| gpu.release_unused()), ("allocation", &|| drop(gpu.allocate::<u32>("values", 4).unwrap()))];
    for (how, free) in frees {
        let values = gpu.upload(LABEL, &VALUES).unwrap();
        for _ in 0..2 {
            let mut pass = Pass::new(&gpu, "test");
            scan.record(&mut pass, &values, &sums, &total, 4);
            pass.submit();
            assert_eq!(gpu.read(&sums, 4).unwrap(), [0, 3, 4, 8]);
        }
        drop(values);
        assert!(is_there(), "{how}: the group was not kept");
        free();
        assert!(!is_there(), "{how}: the memory is still there");
    }
}
