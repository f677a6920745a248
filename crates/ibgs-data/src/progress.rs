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

/// Seconds in readable form, `7 min 47 s`.
pub fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..60 => format!("{seconds:.1} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}
