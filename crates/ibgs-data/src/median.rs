//! The middle of values.

/// The middle value, the upper one of two; none without any.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_is_found_in_any_order() {
        let lists = [vec![], vec![3.0, 1.0, 2.0], vec![4.0, 1.0, 2.0, 3.0]];
        assert_eq!(lists.map(median), [None, Some(2.0), Some(3.0)]);
    }
}
