//! An order of rows that does not depend on where they stand in a file.

use crate::numerics::order;
use crate::numerics::order::Ends;
use crate::numerics::symmetric::eigenvalues;

/// Place of each row along the direction in which rows vary most, each channel in parts of what it
/// spans; zero for all where there is none. `values` holds the readings of each of `rows`, channel by
/// channel.
///
/// Which way the direction points is a convention: its largest component is positive.
#[must_use]
pub(crate) fn along<'a>(rows: impl Iterator<Item = &'a [f64]> + Clone) -> Vec<f64> {
    let Some(n) = rows.clone().next().map(<[f64]>::len) else { return Vec::new() };
    let count = rows.clone().count();
    let mut middle = vec![0.0; n];
    let mut span = vec![[f64::INFINITY, f64::NEG_INFINITY]; n];
    for row in rows.clone() {
        for ((sum, [low, high]), value) in middle.iter_mut().zip(&mut span).zip(row) {
            *sum += value / count as f64;
            (*low, *high) = (low.min(*value), high.max(*value));
        }
    }
    let part = |row: &[f64], c: usize| {
        let off = (row[c] - middle[c]) / (span[c][1] - span[c][0]);
        if off.is_finite() { off } else { 0.0 }
    };
    let square = faer::Mat::from_fn(n, n, |i, j| {
        rows.clone().map(|row| part(row, i) * part(row, j)).sum::<f64>()
    });
    let Some((_, vectors)) = eigenvalues(square.as_ref()) else { return vec![0.0; count] };
    let largest = (0..n).map(|c| vectors[(c, n - 1)]).greatest_by(|a| a.abs());
    let way = largest.map_or(1.0, f64::signum);
    rows.map(|row| (0..n).map(|c| way * vectors[(c, n - 1)] * part(row, c)).sum()).collect()
}

/// Numbers of rows in the order of their places.
pub(crate) fn ascending(places: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..places.len()).collect();
    order::ascending(&mut order, |a| places[*a]);
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_its_place_wherever_it_stands_in_the_file() {
        // The golden ratio's multiples, folded: no two rows are alike.
        let rows: Vec<[f64; 3]> = (0..40_u32)
            .map(|k| [0.618, 0.387, 0.871].map(|by| (f64::from(k) * by).fract()))
            .map(|[a, b, c]| [3.0 * a, 0.2 * b + 0.1 * a, 50.0 * c])
            .collect();
        let shuffled: Vec<usize> = (0..40).map(|k| (k * 17 + 5) % 40).collect();
        let plain = along(rows.iter().map(|row| &row[..]));
        let other = along(shuffled.iter().map(|&k| &rows[k][..]));
        for (place, &k) in other.iter().zip(&shuffled) {
            assert!((place - plain[k]).abs() < 1e-12, "{place} {}", plain[k]);
        }
        let spread = plain.iter().copied().fold(0.0, |m: f64, v| m.max(v.abs()));
        assert!(spread > 0.3, "{spread}");
    }

    #[test]
    fn readings_that_stand_still_or_are_missing_tell_no_place() {
        let rows = [[1.0, f64::NAN], [1.0, 2.0]];
        assert_eq!(along(rows.iter().map(|row| &row[..])), [0.0, 0.0]);
        assert!(along(std::iter::empty()).is_empty());
    }
}
