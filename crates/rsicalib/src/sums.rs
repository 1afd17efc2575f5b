//! Sums over samples: gradient and Gram matrix in one pass, in a fixed order.

use rayon::prelude::*;

use crate::lanes::Lanes;
use crate::lm::{Curvature, Linearization};

/// Blocks that one task takes; also what is summed before the next level.
const CHUNK: usize = 64;

/// `½ rᵀr`, `Jᵀr` and `JᵀJ`, lane by lane.
#[derive(Debug, Clone)]
pub struct Sums {
    columns: usize,
    cost: Lanes,
    gradient: Vec<Lanes>,
    /// Lower triangle, row by row.
    gram: Vec<Lanes>,
}

impl Sums {
    /// Zero.
    #[must_use]
    pub fn new(columns: usize) -> Self {
        Self {
            columns,
            cost: Lanes::ZERO,
            gradient: vec![Lanes::ZERO; columns],
            gram: vec![Lanes::ZERO; columns * (columns + 1) / 2],
        }
    }

    /// Adds one equation: its residual and its row of the Jacobian.
    ///
    /// `active` lists the columns that are not zero, ascending.
    #[inline(always)]
    pub fn add(&mut self, residual: Lanes, row: &[Lanes], active: &[usize]) {
        self.cost += residual * residual * 0.5;
        for (n, &i) in active.iter().enumerate() {
            let value = row[i];
            self.gradient[i] += value * residual;
            let line = &mut self.gram[i * (i + 1) / 2..(i + 1) * (i + 2) / 2];
            for &j in &active[..=n] {
                line[j] += value * row[j];
            }
        }
    }

    /// Adds another sum.
    pub fn merge(&mut self, other: &Self) {
        self.cost += other.cost;
        for (a, b) in self.gradient.iter_mut().zip(&other.gradient) {
            *a += *b;
        }
        for (a, b) in self.gram.iter_mut().zip(&other.gram) {
            *a += *b;
        }
    }

    /// Adds up the lanes.
    ///
    /// A column that is zero but for rounding, below ε times the largest, is made
    /// zero: a turn about an axis through the only point that it carries moves
    /// nothing, and would otherwise be sent round 1e12 times.
    #[must_use]
    pub fn finish(&self) -> Linearization {
        let n = self.columns;
        let entry = |i: usize, j: usize| self.gram[i * (i + 1) / 2 + j].sum();
        let diagonal: Vec<f64> = (0..n).map(|i| entry(i, i)).collect();
        let rounding = diagonal.iter().fold(0.0, |m, d| d.max(m)) * f64::EPSILON.powi(2);
        let silent: Vec<bool> = diagonal.iter().map(|d| *d <= rounding).collect();
        let mut gram = faer::Mat::zeros(n, n);
        for i in (0..n).filter(|&i| !silent[i]) {
            for j in (0..=i).filter(|&j| !silent[j]) {
                gram[(i, j)] = entry(i, j);
                gram[(j, i)] = gram[(i, j)];
            }
        }
        let gradient = self.gradient.iter().zip(&silent);
        Linearization {
            cost: self.cost.sum(),
            gradient: gradient.map(|(g, silent)| if *silent { 0.0 } else { g.sum() }).collect(),
            curvature: Curvature::Gram(gram),
        }
    }
}

/// Sums over chunks of `items`, on all cores where there are many, always in
/// the same order.
pub fn over_chunks<T: Send, S: Send>(
    items: &mut [T],
    per_block: usize,
    one: impl Fn(usize, &mut [T]) -> S + Sync,
    mut merge: impl FnMut(&mut S, S),
) -> Option<S> {
    let size = CHUNK * per_block;
    let job = |(k, chunk): (usize, &mut [T])| one(k * CHUNK, chunk);
    let mut parts: Vec<S> = if items.len() > 2 * size {
        items.par_chunks_mut(size).enumerate().map(job).collect()
    } else {
        items.chunks_mut(size).enumerate().map(job).collect()
    };
    if parts.is_empty() {
        return None;
    }
    let rest = parts.split_off(1);
    let mut sum = parts.pop()?;
    for part in rest {
        merge(&mut sum, part);
    }
    Some(sum)
}
