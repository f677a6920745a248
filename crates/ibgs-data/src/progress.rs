//! How far long work is.

/// Receives how far long work is. `()` ignores it.
pub trait Progress: Sync {
    /// Work of this many steps begins; earlier work has ended.
    fn begin(&self, what: &'static str, steps: usize);

    /// One step is done; called from any thread.
    fn step(&self);

    /// The work has ended.
    fn end(&self);
}

impl Progress for () {
    fn begin(&self, _: &'static str, _: usize) {}
    fn step(&self) {}
    fn end(&self) {}
}
