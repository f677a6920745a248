//! The first lines of a kernel's file:
//!
//! ```text
//! //! Alpha blending.
//! #set render
//! #stage blend
//! ```
//!
//! The sentence is the kernel's documentation; the others name a [`KernelSet`] and a [`KernelStage`].

use super::shared::class::{KernelSet, KernelStage};

/// What the header says.
pub struct Header {
    /// Sentences for the documentation, a line each.
    pub doc: Vec<String>,
    pub set: KernelSet,
    pub stage: KernelStage,
}

/// Reads the header of `wgsl/NAME.wgsl`.
pub fn read(name: &str, source: &str) -> Header {
    let all = |directive| source.lines().filter_map(move |line| line.trim_end().strip_prefix(directive));
    let doc: Vec<String> = all("//! ").map(str::to_string).collect();
    assert!(!doc.is_empty(), "wgsl/{name}.wgsl: no line `//! ` says what the kernel does");
    let one = |directive| {
        let mut values = all(directive);
        match (values.next(), values.next()) {
            (Some(value), None) => value.trim(),
            _ => panic!("wgsl/{name}.wgsl: one line `{directive}` is needed"),
        }
    };
    let (set, stage) = (one("#set "), one("#stage "));
    Header {
        doc,
        set: find(KernelSet::ALL, set, KernelSet::name)
            .unwrap_or_else(|| panic!("wgsl/{name}.wgsl: no set of kernels is called `{set}`")),
        stage: find(KernelStage::ALL, stage, KernelStage::name)
            .unwrap_or_else(|| panic!("wgsl/{name}.wgsl: no stage is called `{stage}`")),
    }
}

fn find<T: Copy>(all: &[T], name: &str, name_of: fn(T) -> &'static str) -> Option<T> {
    all.iter().copied().find(|&value| name_of(value) == name)
}
