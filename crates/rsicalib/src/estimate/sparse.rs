//! Directions in the space of parameters, told by few of them.

use crate::numerics::order::Ends;

/// Parameters that take part by less than this share of the largest are not listed.
pub(crate) const LISTED: f64 = 0.2;

/// The least part of a unit direction that is no rounding.
const PART: f64 = 1e-6;

/// A parameter that belongs to one direction alone, and that direction with 1 there, in standard
/// deviations of each parameter alone.
pub(crate) type Row = (usize, Vec<f64>);

/// Directions, each with a parameter that no other has: the last that can be, of those `first` where
/// one of these takes part. What is `beside` is taken out of them.
pub(crate) fn reduced(mut rows: Vec<Vec<f64>>, first: &[usize], beside: &[Row]) -> Vec<Row> {
    for (pivot, other) in beside {
        rows.iter_mut().for_each(|row| eliminate(row, other, *pivot));
    }
    let n = rows.first().map_or(0, Vec::len);
    let all: Vec<usize> = (0..n).collect();
    let mut pivots: Vec<usize> = Vec::new();
    for done in 0..rows.len() {
        let most = |i: usize| rows[done..].iter().map(|r| r[i].abs()).fold(0.0, f64::max);
        let sizes: Vec<f64> = (0..n).map(most).collect();
        let last = |of: &[usize]| {
            let largest = of.iter().map(|i| sizes[*i]).fold(0.0, f64::max);
            let counts = |i: &&usize| {
                sizes[**i] > LISTED * largest && sizes[**i] > PART && !pivots.contains(*i)
            };
            of.iter().rev().find(counts).copied()
        };
        let Some(pivot) = last(first).or_else(|| last(&all)) else { break };
        let size = |k: &usize| rows[*k][pivot].abs();
        let Some(best) = (done..rows.len()).greatest_by(|a| size(a)) else {
            break;
        };
        rows.swap(done, best);
        let by = rows[done][pivot];
        rows[done].iter_mut().for_each(|v| *v /= by);
        let own = rows[done].clone();
        let others = rows.iter_mut().enumerate().filter(|(k, _)| *k != done);
        others.for_each(|(_, row)| eliminate(row, &own, pivot));
        pivots.push(pivot);
    }
    pivots.into_iter().zip(rows).collect()
}

/// Takes out of a direction what another one, whose entry is 1 there, has of a parameter.
fn eliminate(row: &mut [f64], other: &[f64], pivot: usize) {
    let by = row[pivot];
    row.iter_mut().zip(other).for_each(|(v, other)| *v -= by * other);
}
