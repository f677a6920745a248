//! What `--version` prints.

use ibgs_core::gpu;
use std::sync::LazyLock;

/// Version and, where it is known, commit.
pub const SHORT: &str = concat!(env!("CARGO_PKG_VERSION"), env!("IBGS_COMMIT"));

/// [`SHORT`], and what the build can do.
pub fn long() -> &'static str {
    static LONG: LazyLock<String> = LazyLock::new(|| {
        let (target, profile) = env!("IBGS_BUILD").split_once('/').unwrap_or_default();
        format!("{SHORT}\nbackends: {}\ntarget: {target}\nprofile: {profile}", gpu::backends())
    });
    &LONG
}
