//! Sorting by a number.
//!
//! The standard sort is compiled anew for each closure that it is given, 7 kB each; here it is compiled once, for the
//! numbers.

/// The items by a number of each, the least first. Of items with the same number the earlier stays earlier; NaN counts as
/// the largest number.
pub(crate) fn ascending<T>(items: &mut [T], number: impl Fn(&T) -> f64) {
    arrange(items, ranks(items.iter().map(number).collect()));
}

/// The items by a number of each, the largest first. Of items with the same number the earlier stays earlier; NaN counts
/// as the largest number.
pub(crate) fn descending<T>(items: &mut [T], number: impl Fn(&T) -> f64) {
    arrange(items, ranks(items.iter().map(|item| -number(item)).collect()));
}

/// The place of each number in their order.
fn ranks(numbers: Vec<f64>) -> Vec<usize> {
    let mut order: Vec<(f64, usize)> = numbers.into_iter().zip(0..).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut ranks = vec![0; order.len()];
    for (rank, (_, item)) in order.into_iter().enumerate() {
        ranks[item] = rank;
    }
    ranks
}

/// Moves each item to its place; each exchange brings one there.
fn arrange<T>(items: &mut [T], mut ranks: Vec<usize>) {
    for i in 0..items.len() {
        while ranks[i] != i {
            let to = ranks[i];
            items.swap(i, to);
            ranks.swap(i, to);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{ascending, descending};
    use crate::numerics::random::Random;

    /// The witness is the stable sort of the standard library.
    #[test]
    fn items_come_in_the_order_of_the_standard_sort() {
        let mut random = Random::new(7);
        for n in 0..40 {
            // Few different numbers, so that many are the same.
            let items: Vec<(f64, usize)> =
                (0..n).map(|k| (random.below(9) as f64 - 4.0, k)).collect();
            let (mut up, mut down) = (items.clone(), items.clone());
            ascending(&mut up, |item| item.0);
            descending(&mut down, |item| item.0);
            let mut sorted = items;
            sorted.sort_by(|a, b| a.0.partial_cmp(&b.0).expect("finite"));
            assert_eq!(up, sorted);
            sorted.sort_by_key(|item| item.1);
            sorted.sort_by(|a, b| b.0.partial_cmp(&a.0).expect("finite"));
            assert_eq!(down, sorted);
        }
    }

    #[test]
    fn what_is_no_number_counts_as_the_largest() {
        let mut items = [f64::NAN, 2.0, 1.0];
        ascending(&mut items, |item| *item);
        assert!(items[..2] == [1.0, 2.0] && items[2].is_nan());
        descending(&mut items, |item| *item);
        assert!(items[0].is_nan() && items[1..] == [2.0, 1.0]);
    }
}
