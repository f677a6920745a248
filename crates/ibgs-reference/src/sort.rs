//! Twins of the prefix sum and of the sort of the tile lists.

/// Exclusive prefix sum modulo 2^32, and the total.
pub fn exclusive_scan(values: &[u32]) -> (Vec<u32>, u32) {
    let mut total = 0u32;
    let scanned = values
        .iter()
        .map(|v| {
            let before = total;
            total = total.wrapping_add(*v);
            before
        })
        .collect();
    (scanned, total)
}

/// Key-value pairs by key; equal keys keep their order.
pub fn stable_sort<K: Ord + Copy, V: Copy>(keys: &[K], values: &[V]) -> (Vec<K>, Vec<V>) {
    assert_eq!(keys.len(), values.len(), "one value per key");
    let mut pairs: Vec<(K, V)> = keys.iter().copied().zip(values.iter().copied()).collect();
    pairs.sort_by_key(|(key, _)| *key);
    pairs.into_iter().unzip()
}
