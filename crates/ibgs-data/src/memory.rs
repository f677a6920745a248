//! How much memory may be taken, of a GPU or of the host.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

const KIB: u64 = 1 << 10;
const MIB: u64 = 1 << 20;
const GIB: u64 = 1 << 30;

/// Units by name, the longer names first.
const UNITS: [(&str, u64); 7] =
    [("KiB", KIB), ("MiB", MIB), ("GiB", GIB), ("KB", 1_000), ("MB", 1_000_000), ("GB", 1_000_000_000), ("B", 1)];

/// Memory that may be taken: `auto`, `none` or a size such as `512MiB`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum MemoryBudget {
    /// By the machine.
    #[default]
    Auto,
    /// No limit.
    Unlimited,
    /// So many bytes.
    Bytes(u64),
}

impl MemoryBudget {
    /// The budget in bytes of the host's memory; none: no limit. `auto` is half of what is free now, also of what a container
    /// or a job of Slurm may take.
    pub fn host_bytes(self) -> Option<u64> {
        match self {
            Self::Unlimited => None,
            Self::Bytes(bytes) => Some(bytes),
            Self::Auto => free_memory().map(|bytes| bytes / 2),
        }
    }
}

/// Bytes of the host's memory that programs may still take; none where that is not known.
#[cfg(not(target_family = "wasm"))]
fn free_memory() -> Option<u64> {
    use sysinfo::{Pid, Process, ProcessRefreshKind, ProcessesToUpdate, System};
    let mut system = System::new();
    system.refresh_memory();
    let own = Pid::from_u32(std::process::id());
    system.refresh_processes_specifics(ProcessesToUpdate::Some(&[own]), true, ProcessRefreshKind::nothing());
    let limits = system.process(own).and_then(Process::cgroup_limits);
    // What the cache of files takes is free.
    let container = limits.map(|limits| limits.total_memory.saturating_sub(limits.rss));
    let known = system.total_memory() > 0;
    known.then(|| container.map_or(system.available_memory(), |bytes| bytes.min(system.available_memory())))
}

#[cfg(target_family = "wasm")]
fn free_memory() -> Option<u64> {
    None
}

impl FromStr for MemoryBudget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let lower = text.to_ascii_lowercase();
        match lower.as_str() {
            "auto" => return Ok(Self::Auto),
            "none" => return Ok(Self::Unlimited),
            _ => {}
        }
        let unit = UNITS.iter().find(|(name, _)| lower.ends_with(&name.to_ascii_lowercase()));
        let (number, factor) = unit.map_or((text, 1), |(name, factor)| (&text[..text.len() - name.len()], *factor));
        let bytes = number.trim().parse::<f64>().ok().map(|number| number * factor as f64);
        match bytes {
            Some(bytes) if (0.0..9e18).contains(&bytes) => Ok(Self::Bytes(bytes as u64)),
            _ => Err(format!(
                "`{text}` is no amount of memory; give `auto`, `none`, or a size such as `512MiB` or `2GiB`"
            )),
        }
    }
}

crate::text_in_files!(MemoryBudget);

impl fmt::Display for MemoryBudget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Auto => f.write_str("auto"),
            Self::Unlimited => f.write_str("none"),
            Self::Bytes(bytes) => {
                let even = [("GiB", GIB), ("MiB", MIB), ("KiB", KIB)];
                match even.iter().find(|(_, factor)| bytes > 0 && bytes.is_multiple_of(*factor)) {
                    Some((name, factor)) => write!(f, "{}{name}", bytes / factor),
                    None => write!(f, "{bytes}B"),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::MemoryBudget::{self, Auto, Bytes, Unlimited};

    #[test]
    fn sizes_are_read_and_written() {
        let cases = [
            ("auto", Auto),
            ("none", Unlimited),
            ("512MiB", Bytes(512 << 20)),
            ("2 GiB", Bytes(2 << 30)),
            ("1.5gib", Bytes(3 << 29)),
            ("3KB", Bytes(3_000)),
            ("17B", Bytes(17)),
            ("17", Bytes(17)),
            ("0", Bytes(0)),
        ];
        for (text, expected) in cases {
            let budget: MemoryBudget = text.parse().unwrap();
            assert_eq!(budget, expected, "{text}");
            assert_eq!(budget.to_string().parse(), Ok(budget), "{text}");
        }
        assert_eq!(Bytes(512 << 20).to_string(), "512MiB");
        for text in ["", "much", "-1GiB", "nan", "1e30GiB", "GiB", "5 bytes"] {
            let error = text.parse::<MemoryBudget>().unwrap_err();
            assert!(error.contains("512MiB"), "{error}");
        }
    }
}
