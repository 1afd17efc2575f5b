//! Order by a number, whichever NaN it may be.
//!
//! `0/0` is a NaN below all numbers in the total order of IEEE 754 where x86 computes it, and above all of them elsewhere.
//! Here it comes after all numbers, and is neither the least nor the greatest.
//!
//! The standard sort is compiled anew for each closure that it is given, 7 kB each; here it is compiled once, for the
//! numbers.

use std::cmp::Ordering;

/// Numbers in their order, NaN after all of them.
pub(crate) fn compare(a: f64, b: f64) -> Ordering {
    a.partial_cmp(&b).unwrap_or_else(|| a.is_nan().cmp(&b.is_nan()))
}

/// Sorts numbers, NaN after all of them.
pub(crate) fn sort(numbers: &mut [f64]) {
    numbers.sort_by(|a, b| compare(*a, *b));
}

/// The items of an iterator at an end of their order.
pub(crate) trait Ends: Iterator + Sized {
    /// The first item with the least number; one of NaN only where all are.
    fn least_by(self, number: impl Fn(&Self::Item) -> f64) -> Option<Self::Item> {
        self.min_by(|a, b| compare(number(a), number(b)))
    }

    /// The last item with the greatest number; one of NaN only where all are.
    fn greatest_by(self, number: impl Fn(&Self::Item) -> f64) -> Option<Self::Item> {
        self.max_by(|a, b| compare(-number(b), -number(a)))
    }
}

impl<I: Iterator> Ends for I {}

/// The items by a number of each, the least first, NaN last. Of items with the same number the earlier stays earlier.
pub(crate) fn ascending<T>(items: &mut [T], number: impl Fn(&T) -> f64) {
    arrange(items, ranks(items.iter().map(number).collect()));
}

/// The items by a number of each, the largest first, NaN last. Of items with the same number the earlier stays earlier.
pub(crate) fn descending<T>(items: &mut [T], number: impl Fn(&T) -> f64) {
    arrange(items, ranks(items.iter().map(|item| -number(item)).collect()));
}

/// The place of each number in their order.
fn ranks(numbers: Vec<f64>) -> Vec<usize> {
    let mut order: Vec<(f64, usize)> = numbers.into_iter().zip(0..).collect();
    order.sort_by(|a, b| compare(a.0, b.0));
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
    use super::{Ends, ascending, descending, sort};
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
    fn what_is_no_number_comes_last_and_is_at_no_end() {
        for nan in [f64::NAN, -f64::NAN] {
            let mut items = [nan, 2.0, 1.0];
            ascending(&mut items, |item| *item);
            assert!(items[..2] == [1.0, 2.0] && items[2].is_nan());
            descending(&mut items, |item| *item);
            assert!(items[..2] == [2.0, 1.0] && items[2].is_nan());
            sort(&mut items);
            assert!(items[..2] == [1.0, 2.0] && items[2].is_nan());
            assert_eq!(items.into_iter().least_by(|item| *item), Some(1.0));
            assert_eq!(items.into_iter().greatest_by(|item| *item), Some(2.0));
            assert!([nan].into_iter().least_by(|item| *item).is_some());
        }
    }

    #[test]
    fn of_items_that_are_alike_the_first_is_the_least_and_the_last_the_greatest() {
        let items = [(1.0, 0), (1.0, 1), (0.0, 2), (0.0, 3)];
        assert_eq!(items.iter().least_by(|item| item.0), Some(&(0.0, 2)));
        assert_eq!(items.iter().greatest_by(|item| item.0), Some(&(1.0, 1)));
    }
}
