//! Sums of normal equations over samples: gradient and Gram matrix in one pass, in a fixed order.

use crate::numerics::lanes::Lanes;
use crate::numerics::linearization::{Curvature, Linearization};
use crate::numerics::workers;

/// Blocks per task; their sum is one term of the sum over tasks.
const CHUNK: usize = 64;

/// `½ rᵀr`, `Jᵀr` and `JᵀJ`, lane by lane, for the columns of a block.
///
/// The first `shared` columns stand for the same parameters in every block. The other columns
/// stand for the unknown points that the block's group touches, and are summed group by group.
#[derive(Debug, Clone)]
pub struct NormalEquations {
    shared: usize,
    width: usize,
    cost: Lanes,
    gradient: Vec<Lanes>,
    /// Lower triangle, row by row.
    gram: Vec<Lanes>,
    own: Vec<Own>,
}

/// Sums of the columns that belong to one group.
#[derive(Debug, Clone)]
pub struct Own {
    /// Number of the group.
    pub group: usize,
    /// `Jᵀr` of the group's own columns.
    pub gradient: Vec<Lanes>,
    /// Rows of `JᵀJ` of the group's own columns.
    pub gram: Vec<Lanes>,
}

impl Own {
    /// The sums of a group. Blocks are sorted by group, so the search starts at the end.
    #[inline(always)]
    pub fn of(all: &mut Vec<Self>, group: usize, columns: usize, entries: usize) -> &mut Self {
        let at = all.iter().rposition(|o| o.group == group).unwrap_or_else(|| {
            let (gradient, gram) = (vec![Lanes::ZERO; columns], vec![Lanes::ZERO; entries]);
            all.push(Self { group, gradient, gram });
            all.len() - 1
        });
        &mut all[at]
    }

    /// Adds the sums of other blocks.
    pub fn merge(all: &mut Vec<Self>, other: &[Self]) {
        for theirs in other {
            let sizes = (theirs.gradient.len(), theirs.gram.len());
            let own = Self::of(all, theirs.group, sizes.0, sizes.1);
            add_all(&mut own.gradient, &theirs.gradient);
            add_all(&mut own.gram, &theirs.gram);
        }
    }
}

/// Adds entry by entry.
pub fn add_all(a: &mut [Lanes], b: &[Lanes]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += *b);
}

/// Where row `i` of a lower triangle starts.
const fn row_of(i: usize) -> usize {
    i * (i + 1) / 2
}

impl NormalEquations {
    /// Zero, for blocks of `width` columns.
    #[must_use]
    pub fn new(shared: usize, width: usize) -> Self {
        Self {
            shared,
            width,
            cost: Lanes::ZERO,
            gradient: vec![Lanes::ZERO; shared],
            gram: vec![Lanes::ZERO; row_of(shared)],
            own: Vec::new(),
        }
    }

    /// Adds all equations of a block: their residuals and rows of the Jacobian.
    #[inline(always)]
    pub fn add(&mut self, group: usize, residuals: &[Lanes], rows: &[Lanes]) {
        let (shared, width) = (self.shared, self.width);
        for residual in residuals {
            self.cost = (*residual * 0.5).mul_add(*residual, self.cost);
        }
        for i in 0..shared {
            let line = &mut self.gram[row_of(i)..row_of(i + 1)];
            add_line(line, &mut self.gradient[i], residuals, rows, width, i);
        }
        if width > shared {
            let entries = row_of(width) - row_of(shared);
            let own = Own::of(&mut self.own, group, width - shared, entries);
            for i in shared..width {
                let line = &mut own.gram[row_of(i) - row_of(shared)..];
                add_line(&mut line[..=i], &mut own.gradient[i - shared], residuals, rows, width, i);
            }
        }
    }

    /// Adds one equation with few columns that are not zero.
    ///
    /// `active` lists the columns that are not zero, ascending.
    #[inline(always)]
    pub fn add_active(&mut self, group: usize, residual: Lanes, row: &[Lanes], active: &[usize]) {
        self.cost += residual * residual * 0.5;
        let shared = self.shared;
        let (here, own) = active.split_at(active.partition_point(|i| *i < shared));
        for (n, &i) in here.iter().enumerate() {
            self.gradient[i] = row[i].mul_add(residual, self.gradient[i]);
            let line = &mut self.gram[row_of(i)..row_of(i + 1)];
            for &j in &here[..=n] {
                line[j] = row[i].mul_add(row[j], line[j]);
            }
        }
        let entries = row_of(self.width) - row_of(shared);
        for (n, &i) in own.iter().enumerate() {
            let sums = Own::of(&mut self.own, group, self.width - shared, entries);
            sums.gradient[i - shared] += row[i] * residual;
            let line = &mut sums.gram[row_of(i) - row_of(shared)..];
            for &j in &active[..=here.len() + n] {
                line[j] += row[i] * row[j];
            }
        }
    }

    /// Adds another sum.
    pub fn merge(&mut self, other: &Self) {
        self.cost += other.cost;
        add_all(&mut self.gradient, &other.gradient);
        add_all(&mut self.gram, &other.gram);
        Own::merge(&mut self.own, &other.own);
    }
}

/// Adds the products of column `i` of `rows` with the first `line.len()` columns to `line`, and
/// with the residuals to `gradient`: three equations at a time, the number of a touch.
#[inline(always)]
pub fn add_line(
    line: &mut [Lanes],
    gradient: &mut Lanes,
    residuals: &[Lanes],
    rows: &[Lanes],
    width: usize,
    i: usize,
) {
    let mut threes = residuals.chunks_exact(3).zip(rows.chunks_exact(3 * width));
    for (r, x) in &mut threes {
        let (x, y, z) = (&x[..width], &x[width..2 * width], &x[2 * width..]);
        let (a, b, c) = (x[i], y[i], z[i]);
        *gradient = a.mul_add(r[0], b.mul_add(r[1], c.mul_add(r[2], *gradient)));
        for (((sum, x), y), z) in line.iter_mut().zip(x).zip(y).zip(z) {
            *sum = a.mul_add(*x, b.mul_add(*y, c.mul_add(*z, *sum)));
        }
    }
    let done = residuals.len() / 3 * 3;
    for (r, x) in residuals[done..].iter().zip(rows[done * width..].chunks_exact(width)) {
        let a = x[i];
        *gradient = a.mul_add(*r, *gradient);
        for (sum, x) in line.iter_mut().zip(x) {
            *sum = a.mul_add(*x, *sum);
        }
    }
}

/// The sums of all parts, with each column at its parameter.
#[derive(Debug, Clone)]
pub struct Total {
    cost: f64,
    gradient: Vec<f64>,
    gram: faer::Mat<f64>,
}

impl Total {
    /// Zero.
    #[must_use]
    pub fn new(parameters: usize) -> Self {
        let gram = faer::Mat::zeros(parameters, parameters);
        Self { cost: 0.0, gradient: vec![0.0; parameters], gram }
    }

    /// Adds up the lanes of one part, whose groups have these `columns`.
    pub fn add(&mut self, sums: &NormalEquations, columns: &[Vec<usize>]) {
        self.cost += sums.cost.sum();
        // The shared columns stand for the same parameters in every group.
        if let Some(columns) = columns.first() {
            self.add_rows(columns, 0, &sums.gradient, &sums.gram);
        }
        for own in &sums.own {
            self.add_rows(&columns[own.group], sums.shared, &own.gradient, &own.gram);
        }
    }

    fn add_rows(&mut self, columns: &[usize], first: usize, gradient: &[Lanes], rows: &[Lanes]) {
        let mut rows = rows.iter();
        for (i, gradient) in (first..).zip(gradient) {
            self.gradient[columns[i]] += gradient.sum();
            for (&column, value) in columns[..=i].iter().zip(&mut rows) {
                let value = value.sum();
                self.gram[(columns[i], column)] += value;
                if columns[i] != column {
                    self.gram[(column, columns[i])] += value;
                }
            }
        }
    }

    /// The sums as a linearisation.
    ///
    /// A column whose norm is below ε times the largest norm is rounding and is set to zero. For
    /// example, a turn about an axis through the only point that the chain carries moves nothing;
    /// its step would otherwise be 1e12 turns.
    #[must_use]
    pub fn finish(mut self) -> Linearization {
        let n = self.gradient.len();
        let diagonal: Vec<f64> = (0..n).map(|i| self.gram[(i, i)]).collect();
        let rounding = diagonal.iter().fold(0.0, |m, d| d.max(m)) * f64::EPSILON.powi(2);
        for i in (0..n).filter(|&i| diagonal[i] <= rounding) {
            self.gradient[i] = 0.0;
            for j in 0..n {
                self.gram[(i, j)] = 0.0;
                self.gram[(j, i)] = 0.0;
            }
        }
        let curvature = Curvature::Gram(self.gram);
        Linearization { cost: self.cost, gradient: self.gradient, curvature, islands: Vec::new() }
    }
}

/// Computes one sum per chunk of `items`, on all cores for many items, and merges the sums in the
/// order of the chunks. `items` holds `per_block` entries per block.
pub fn over_chunks<T: Send, S: Send>(
    items: &mut [T],
    per_block: usize,
    one: impl Fn(usize, &mut [T]) -> S + Sync,
    mut merge: impl FnMut(&mut S, S),
) -> Option<S> {
    let size = CHUNK * per_block;
    let job = |(k, chunk): (usize, &mut [T])| one(k * CHUNK, chunk);
    let mut parts: Vec<S> = if items.len() > 2 * size {
        workers::map(items.chunks_mut(size).enumerate(), job)
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
