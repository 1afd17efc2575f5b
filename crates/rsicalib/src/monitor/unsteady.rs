//! What has another size in every row: a bearing that is loose, a sensor that is noisy or stuck.
//!
//! A change `θ` of (101) stands still, or goes on evenly. The end of a chain in a loose bearing is
//! elsewhere in each row, `θ_t ~ N(0, τ²)`, and so is what a sensor with a broken wire says. With the
//! columns `Z_t` of that place the whitened misclosure has the covariance `S_t = 1 + τ² Z_t Z_tᵀ`, and
//! against a sound device the evidence of rows since an onset is
//!
//! ```text
//! 2 ln Z = Σ r_tᵀ (1 - S_t⁻¹) r_t - ln |S_t|                             (134)
//! ```
//!
//! averaged over `τ` from what one row just shows to a thousand times that, evenly in its logarithm.
//! A row is made white again by `S_t^(-1/2)`, one column after the other, and the watch goes on: of
//! what is unsteady it knows that much less. `τ²` is learned from each row by Fisher's scoring,
//!
//! ```text
//! τ² ← τ² + s_t / Σ I,   s_t = (|Zᵀ S⁻¹ r|² - tr B) / 2,   I_t = tr B² / 2,   B = Zᵀ S⁻¹ Z   (135)
//! ```
//!
//! with `Z` and `r` of the row. It is known as from `2 τ⁴ Σ I` values of a noise, and no
//! statistic of a test is taken to be better known than that.

use crate::mechanism::Mechanism;
use crate::monitor::kept::keep;
use crate::monitor::place::Place;
use crate::monitor::recent::Linearised;
use crate::monitor::state::{axpy, dot};
use crate::monitor::watched::{Candidate, Watched};
use crate::numerics::order::Ends;

/// Terms of what is unsteady.
pub(crate) const NOISE: &str = "noise";
pub(crate) const LOOSE: &str = "loose";
pub(crate) const STUCK: &str = "stuck";

/// Deviations that are weighed: so many, each `√2` times the one before.
const DEVIATIONS: i32 = 20;

/// Steps of (135) from the likeliest deviation that is weighed: the error of its logarithm, a sixth at
/// most, is squared in each.
const SCORINGS: usize = 4;

/// A place that has become unsteady.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Unsteady {
    pub(crate) place: usize,
    /// `τ`, in the place's unit.
    pub(crate) deviation: f64,
    /// Information about `τ²`.
    pub(crate) known: f64,
    pub(crate) since: u64,
    /// Score and information of the present row.
    heard: [f64; 2],
}

impl Unsteady {
    pub(crate) fn new(place: usize, found: Found, since: u64) -> Self {
        let Found { deviation, known, .. } = found;
        Self { place, deviation, known, since, heard: [0.0; 2] }
    }

    /// Standard deviation of `τ`.
    pub(crate) fn sd(&self) -> f64 {
        0.5 / (self.deviation * self.known.sqrt())
    }

    /// Values of a noise from which its variance would be known as well.
    pub(crate) fn values(&self) -> f64 {
        2.0 * self.known * self.deviation.powi(4)
    }

    /// Score and information of a white row in noise of the variance `scale`, of which `mean` is known.
    pub(crate) fn hear(
        &mut self,
        watched: &Watched,
        r: &[f64],
        g: &[f64],
        mean: &[f64],
        scale: f64,
    ) {
        let place = &watched.places[self.place];
        let width = g.len() / r.len().max(1);
        let root = scale.sqrt();
        let columns = watched.columns_of(place).map(|(column, unit)| (column, unit * root));
        let left = |row: usize| {
            let own = &g[row * width..row * width + mean.len()];
            (r[row] - dot(own, mean)) / root
        };
        self.heard = score(columns, g, width, left);
    }

    /// Learns from the row that was heard, and forgets what is older than so many values.
    pub(crate) fn learn(&mut self, memory: f64) {
        let [score, information] = self.heard;
        let square = self.deviation.powi(2);
        self.known = (self.known + information).min(0.5 * memory / square.powi(2));
        self.deviation = scored(square, score, self.known).sqrt();
    }
}

/// Score and information of one white row about `τ²`, (135): of columns of `G` with their units, and
/// what is left of each equation.
fn score(
    columns: impl Iterator<Item = (usize, f64)> + Clone,
    g: &[f64],
    width: usize,
    left: impl Fn(usize) -> f64,
) -> [f64; 2] {
    let (mut score, mut information) = (0.0, 0.0);
    for (column, unit) in columns.clone() {
        let rows = g.chunks_exact(width).enumerate();
        let along: f64 = rows.map(|(row, g)| g[column] * left(row)).sum();
        score += (along / unit).powi(2);
        for (other, per) in columns.clone() {
            let products = g.chunks_exact(width).map(|g| g[column] * g[other]);
            let product = products.sum::<f64>() / (unit * per);
            score -= if column == other { product } else { 0.0 };
            information += product.powi(2);
        }
    }
    [0.5 * score, 0.5 * information]
}

/// A variance after a step of (135); it is halved at most.
fn scored(square: f64, score: f64, known: f64) -> f64 {
    let step = if known > 0.0 { score / known } else { 0.0 };
    (square + step).max(0.5 * square)
}

/// What rows say of an unsteady place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// Twice the logarithm of the evidence.
    pub(crate) evidence: f64,
    /// Deviation that is likeliest, and the information about its square.
    pub(crate) deviation: f64,
    pub(crate) known: f64,
    /// Squares that it leaves.
    pub(crate) rest: f64,
}

/// Places of what is watched.
pub(crate) fn places(mechanism: &Mechanism, watched: &Watched) -> Vec<Place> {
    let numbered = || watched.candidates.iter().enumerate();
    let called = |k: &Candidate| k.spec.target.clone().unwrap_or_default();
    let mut places = Vec::new();
    for (candidate, own) in numbered().filter(|(_, k)| k.spec.term == "offset") {
        let target = called(own);
        let channel = mechanism.channels.iter().position(|c| c.name == target);
        let unit = own.parameters[0].1.clone();
        places.push(Place { term: NOISE, target, channel, candidate, columns: 1, unit });
    }
    for chain in &mechanism.chains {
        let own = numbered().rfind(|(_, k)| of_chain(k, &chain.name));
        let Some((candidate, own)) = own else { continue };
        let unit = own.parameters[0].1.clone();
        let along = own.parameters.iter().take_while(|(_, other)| *other == unit);
        let columns = along.count().min(own.columns.len());
        let target = chain.name.clone();
        places.push(Place { term: LOOSE, target, channel: None, candidate, columns, unit });
    }
    places
}

/// True for a change of a link of a chain, or of the point at its end.
fn of_chain(candidate: &Candidate, chain: &str) -> bool {
    let target = candidate.spec.target.as_deref().unwrap_or_default();
    target.split('/').next() == Some(chain)
}

/// Room to make rows white again.
#[derive(Debug, Clone)]
pub(crate) struct Whitener {
    column: Vec<f64>,
    along: Vec<f64>,
}

impl Whitener {
    /// For rows of so many equations and columns.
    pub(crate) fn new(equations: usize, width: usize) -> Self {
        Self { column: vec![0.0; equations], along: vec![0.0; width] }
    }

    /// Makes a row white where one column of `G`, in its unit, has this standard deviation, in place;
    /// `ln |S|` of it.
    pub(crate) fn apply(
        &mut self,
        column: usize,
        deviation: f64,
        r: &mut [f64],
        g: &mut [f64],
    ) -> f64 {
        let width = g.len() / r.len().max(1);
        for (z, row) in self.column.iter_mut().zip(g.chunks_exact(width)) {
            *z = row[column] * deviation;
        }
        let z = &self.column[..r.len()];
        let square = dot(z, z);
        if square == 0.0 {
            return 0.0;
        }
        // (1 + z zᵀ)^(-1/2) = 1 - f z zᵀ
        let factor = (1.0 - 1.0 / (1.0 + square).sqrt()) / square;
        let along = &mut self.along[..width];
        along.fill(0.0);
        for (z, row) in z.iter().zip(g.chunks_exact(width)) {
            axpy(*z, row, along);
        }
        let own = factor * dot(z, r);
        for ((z, row), r) in z.iter().zip(g.chunks_exact_mut(width)).zip(r) {
            axpy(-factor * z, along, row);
            *r -= own * z;
        }
        square.ln_1p()
    }

    /// Makes a row white under all that is unsteady in it, in noise of the variance `scale`.
    pub(crate) fn row(
        &mut self,
        watched: &Watched,
        unsteady: &[Unsteady],
        scale: f64,
        row: u64,
        r: &mut [f64],
        g: &mut [f64],
    ) {
        for one in unsteady.iter().filter(|one| row >= one.since) {
            let place = &watched.places[one.place];
            for (column, unit) in watched.columns_of(place) {
                self.apply(column, one.deviation / (unit * scale.sqrt()), r, g);
            }
        }
    }
}

impl Watched {
    /// What is unsteady adds to the square of an equation, on the average, in noise of the variance
    /// `scale`; `g` is not made white.
    pub(crate) fn loudness(
        &self,
        unsteady: &[Unsteady],
        g: &[f64],
        equations: usize,
        scale: f64,
    ) -> f64 {
        let width = g.len() / equations.max(1);
        let of = |one: &Unsteady| {
            let columns = self.columns_of(&self.places[one.place]);
            let square = |(column, unit): (usize, f64)| {
                let along = g.chunks_exact(width).map(|row| row[column].powi(2)).sum::<f64>();
                along * (one.deviation / unit).powi(2) / scale
            };
            columns.map(square).sum::<f64>()
        };
        unsteady.iter().map(of).sum::<f64>() / equations.max(1) as f64
    }

    /// Columns of a place, with their units.
    fn columns_of(&self, place: &Place) -> impl Iterator<Item = (usize, f64)> + Clone {
        let own = &self.candidates[place.candidate];
        own.columns.iter().copied().zip(own.scale.iter().copied()).take(place.columns)
    }

    /// What rows say of a place in noise of the variance `scale`; none where they show nothing of it,
    /// or where one half of them does not speak for it.
    pub(crate) fn unsteady(&self, place: &Place, rows: &[Linearised], scale: f64) -> Option<Found> {
        let equations = rows.first()?.2.len();
        let columns: Vec<(usize, f64)> = self.columns_of(place).collect();
        let q = columns.len();
        // Columns of the place alone, in its unit over the noise.
        let own: Vec<(Vec<f64>, Vec<f64>)> = rows
            .iter()
            .map(|(.., r, g)| {
                let width = g.len() / equations;
                let r: Vec<f64> = r.iter().map(|v| v / scale.sqrt()).collect();
                let z = g.chunks_exact(width).flat_map(|row| {
                    columns.iter().map(|(column, unit)| row[*column] / (unit * scale.sqrt()))
                });
                (r, z.collect())
            })
            .collect();
        let squares: f64 = own.iter().flat_map(|(_, z)| z).map(|z| z * z).sum();
        if squares <= 0.0 {
            return None;
        }
        let least = (rows.len() as f64 * q as f64 / squares).sqrt();
        let mut whitener = Whitener::new(equations, q);
        // Evidence of the first and of the second half, squares that are left, score and information.
        let mut weigh = |deviation: f64| {
            let mut found = [0.0; 5];
            for (n, (r, z)) in own.iter().enumerate() {
                let (mut left, mut z) = (r.clone(), z.clone());
                let logs: f64 =
                    (0..q).map(|k| whitener.apply(k, deviation, &mut left, &mut z)).sum();
                let rest = dot(&left, &left);
                found[usize::from(2 * n >= own.len())] += dot(r, r) - rest - logs;
                found[2] += rest;
                let own = score((0..q).map(|k| (k, 1.0)), &z, q, |row| left[row]);
                (found[3], found[4]) = (found[3] + own[0], found[4] + own[1]);
            }
            found
        };
        let all: Vec<(f64, [f64; 5])> = (0..DEVIATIONS)
            .map(|k| least * 2.0_f64.powf(0.5 * f64::from(k)))
            .map(|deviation| (deviation, weigh(deviation)))
            .collect();
        let sum = |found: &[f64; 5]| found[0] + found[1];
        let (deviation, best) = *all.iter().greatest_by(|a| sum(&a.1))?;
        if best[0] <= 0.0 || best[1] <= 0.0 {
            return None;
        }
        let weights = all.iter().map(|(_, found)| (0.5 * (sum(found) - sum(&best))).exp());
        let mean = weights.sum::<f64>() / f64::from(DEVIATIONS);
        let evidence = sum(&best) + 2.0 * mean.ln();
        let (mut deviation, mut at) = (deviation, best);
        for _ in 0..SCORINGS {
            deviation = scored(deviation.powi(2), at[3], at[4]).sqrt();
            at = weigh(deviation);
        }
        Some(Found { evidence, deviation, known: at[4], rest: at[2] })
    }
}

keep!(Unsteady: place, deviation, known, since);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::Random;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn a_row_is_made_white_and_its_determinant_told() {
        let (k, width) = (3, 5);
        let mut random = Random::new(8);
        let mut draw = || random.uniform(-1.0, 1.0);
        let g = DMatrix::from_fn(k, width, |_, _| draw());
        let r = DVector::from_fn(k, |_, _| draw());
        let mut values: Vec<f64> = g.transpose().as_slice().to_vec();
        let mut left: Vec<f64> = r.as_slice().to_vec();
        let mut whitener = Whitener::new(k, width);
        let deviations = [(1, 2.0), (4, 0.7)];
        let logs: f64 =
            deviations.iter().map(|(c, d)| whitener.apply(*c, *d, &mut left, &mut values)).sum();
        let mut s = DMatrix::identity(k, k);
        for (column, deviation) in deviations {
            let z = g.column(column) * deviation;
            s += &z * z.transpose();
        }
        assert!((logs - s.determinant().ln()).abs() < 1e-12);
        let inverse = s.try_inverse().expect("positive definite");
        let expected = r.dot(&(&inverse * &r));
        assert!((dot(&left, &left) - expected).abs() < 1e-12);
        // Columns go the same way: G S⁻¹ r is the same for all of them.
        let found = DMatrix::from_row_slice(k, width, &values).transpose()
            * DVector::from_column_slice(&left);
        assert!((found - g.transpose() * inverse * r).norm() < 1e-12);
    }
}
