//! Values within a budget of bytes, of which those used last stay.

use std::collections::HashMap;

/// Numbered values with their bytes, in the order of their last use. Evicts nothing by itself: its owner knows which values are
/// still needed, and whether a new one may go beyond the budget.
#[derive(Debug)]
pub struct Lru<V> {
    entries: HashMap<usize, Entry<V>>,
    /// Bytes; none: no limit.
    budget: Option<u64>,
    /// Bytes of all values.
    resident: u64,
    /// Counts uses.
    clock: u64,
}

#[derive(Debug)]
struct Entry<V> {
    value: V,
    bytes: u64,
    last_use: u64,
}

impl<V> Lru<V> {
    /// No values, with a budget in bytes (none: no limit).
    pub fn new(budget: Option<u64>) -> Self {
        Self { entries: HashMap::new(), budget, resident: 0, clock: 0 }
    }

    /// A value, which is used by that.
    pub fn get(&mut self, number: usize) -> Option<&V> {
        self.clock += 1;
        let entry = self.entries.get_mut(&number)?;
        entry.last_use = self.clock;
        Some(&entry.value)
    }

    /// Whether a value is there; that is no use of it.
    pub fn contains(&self, number: usize) -> bool {
        self.entries.contains_key(&number)
    }

    /// Puts a value in, used just now, in place of an older one with its number.
    pub fn insert(&mut self, number: usize, value: V, bytes: u64) {
        self.remove(number);
        self.clock += 1;
        self.resident += bytes;
        self.entries.insert(number, Entry { value, bytes, last_use: self.clock });
    }

    /// Takes a value out.
    pub fn remove(&mut self, number: usize) -> Option<V> {
        let entry = self.entries.remove(&number)?;
        self.resident -= entry.bytes;
        Some(entry.value)
    }

    /// Takes the value out that was used longest ago, of those that may go, with its number.
    pub fn evict(&mut self, may_go: impl Fn(&V) -> bool) -> Option<(usize, V)> {
        let free = self.entries.iter().filter(|(_, entry)| may_go(&entry.value));
        let (&number, _) = free.min_by_key(|(_, entry)| entry.last_use)?;
        self.remove(number).map(|value| (number, value))
    }

    /// Takes out those used longest ago until so many bytes more are within the budget, or none is left.
    pub fn make_room(&mut self, bytes: u64) {
        while !self.has_room(bytes) && self.evict(|_| true).is_some() {}
    }

    /// Takes all of them out.
    pub fn clear(&mut self) {
        self.entries.clear();
        self.resident = 0;
    }

    /// Whether so many bytes more are within the budget.
    pub fn has_room(&self, bytes: u64) -> bool {
        self.budget.is_none_or(|budget| self.resident + bytes <= budget)
    }

    /// Bytes that the values may take; none: no limit.
    pub fn budget(&self) -> Option<u64> {
        self.budget
    }

    /// Changes the budget; what is there stays.
    pub fn set_budget(&mut self, budget: Option<u64>) {
        self.budget = budget;
    }

    /// Bytes of all values.
    pub fn resident_bytes(&self) -> u64 {
        self.resident
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// True without any value.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_value_used_longest_ago_goes_first() {
        let mut lru = Lru::new(Some(30));
        for number in 0..3 {
            assert!(lru.has_room(10));
            lru.insert(number, "value", 10);
        }
        assert!(!lru.has_room(1));
        assert!(lru.contains(1) && lru.get(0).is_some() && lru.get(7).is_none());
        assert_eq!(lru.evict(|_| true), Some((1, "value")), "to look whether it is there was no use");
        lru.insert(2, "newer", 5);
        assert_eq!((lru.len(), lru.resident_bytes()), (2, 15));
        assert_eq!(lru.evict(|value| *value == "newer"), Some((2, "newer")), "the other is still needed");
        assert_eq!(lru.evict(|value| *value == "newer"), None);
        assert_eq!(lru.remove(0), Some("value"));
        assert!(lru.is_empty() && lru.has_room(30));
    }
}
