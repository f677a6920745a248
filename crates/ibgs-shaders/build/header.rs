//! The first lines of a kernel:
//!
//! ```text
//! //! Alpha blending.
//! #set render
//! #stage blend
//! ```
//!
//! The sentence is the kernel's documentation; the others name a [`KernelSet`] and a [`KernelStage`].

use super::shared::class::{KernelSet, KernelStage};
use super::shared::import::lines_of;

/// What the header says.
pub struct Header {
    /// Sentences for the documentation, a line each.
    pub doc: Vec<String>,
    pub set: KernelSet,
    pub stage: KernelStage,
}

/// Reads the header of a kernel from the text of its file.
pub fn read(name: &str, source: &str) -> Header {
    let all = |directive| lines_of(name, source).filter_map(move |line| line.trim_end().strip_prefix(directive));
    let doc: Vec<String> = all("//! ").map(str::to_string).collect();
    assert!(!doc.is_empty(), "kernel {name}: no line `//! ` says what the kernel does");
    let one = |directive| {
        let mut values = all(directive);
        match (values.next(), values.next()) {
            (Some(value), None) => value.trim(),
            _ => panic!("kernel {name}: one line `{directive}` is needed"),
        }
    };
    let (set, stage) = (one("#set "), one("#stage "));
    Header {
        doc,
        set: find(KernelSet::ALL, set, KernelSet::name)
            .unwrap_or_else(|| panic!("kernel {name}: no set of kernels is called `{set}`")),
        stage: find(KernelStage::ALL, stage, KernelStage::name)
            .unwrap_or_else(|| panic!("kernel {name}: no stage is called `{stage}`")),
    }
}

fn find<T: Copy>(all: &[T], name: &str, name_of: fn(T) -> &'static str) -> Option<T> {
    all.iter().copied().find(|&value| name_of(value) == name)
}
