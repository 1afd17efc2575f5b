//! Poses chosen by exchange.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use crate::Error;
use crate::design::information::Candidates;
use crate::error::index_of;

/// What is made small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Criterion {
    /// Sum of the variances of the offsets (A-optimal for what the paper reports).
    #[default]
    Offsets,
    /// Variance of the joint coordinates, averaged over the candidates (I-optimal).
    Joints,
    /// Volume of the confidence ellipsoid (D-optimal).
    Volume,
    /// Variance of the platform, averaged over the workspace (V-optimal).
    Platform,
    /// Probability of a wrong decision between the explanations of a session, (96).
    Decide,
}

/// Names of the criteria, as users write them.
pub const CRITERIA: [(&str, Criterion); 5] = [
    ("decide", Criterion::Decide),
    ("platform", Criterion::Platform),
    ("offsets", Criterion::Offsets),
    ("joints", Criterion::Joints),
    ("volume", Criterion::Volume),
];

impl Criterion {
    /// Its name, as users write it.
    #[must_use]
    pub fn name(self) -> &'static str {
        CRITERIA.iter().find(|c| c.1 == self).map_or("", |c| c.0)
    }

    /// The criterion of a name.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] with the names there are.
    pub fn find(name: &str) -> Result<Self, Error> {
        Ok(CRITERIA[index_of(&CRITERIA, |c| c.0, "criterion", name)?].1)
    }
}

impl Candidates {
    /// Chooses so many poses beside those that are `kept` anyway.
    ///
    /// `start` is where the exchange begins, as indices of candidates; a pose may
    /// be visited more than once, those that are kept are not visited again.
    /// Also returns what was made small. Deterministic.
    #[must_use]
    pub fn exchange(
        &self,
        start: &[usize],
        kept: &[usize],
        criterion: Criterion,
    ) -> (Vec<usize>, f64) {
        let mut chosen = start.to_vec();
        let weight = self.weight(criterion);
        // A trace of information everywhere, so that any start can be improved.
        let n = self.scale.len();
        let faint = Mat::<f64>::identity(n, n) * (1e-9 * self.typical());
        for _ in 0..SWEEPS {
            let mut changed = false;
            for place in 0..chosen.len() {
                let others: Vec<usize> = (0..chosen.len())
                    .filter(|p| *p != place)
                    .map(|p| chosen[p])
                    .chain(kept.iter().copied())
                    .collect();
                let rest = self.information(&others) + &faint;
                let Ok(factor) = rest.llt(Side::Lower) else { continue };
                let inverse = factor.solve(Mat::<f64>::identity(n, n));
                let best = self.best(&inverse, weight.as_ref(), chosen[place], kept);
                changed |= best != chosen[place];
                chosen[place] = best;
            }
            if !changed {
                break;
            }
        }
        let every: Vec<usize> = chosen.iter().chain(kept).copied().collect();
        let score = match (self.information(&every).llt(Side::Lower), weight) {
            (Err(_), _) => f64::INFINITY,
            (Ok(factor), None) => (0..n).map(|i| -2.0 * factor.L()[(i, i)].ln()).sum(),
            (Ok(factor), Some(omega)) => {
                let product = factor.solve(omega);
                (0..n).map(|i| product[(i, i)]).sum()
            }
        };
        (chosen, score)
    }

    /// The candidate that adds most to information with inverse `c`; `now` unless one is better.
    fn best(&self, c: &Mat<f64>, weight: Option<&Mat<f64>>, now: usize, kept: &[usize]) -> usize {
        let spread = weight.map(|w| c * w * c);
        let gain = |pose: usize| -> f64 {
            let w = &self.rows[pose];
            let k = w.nrows();
            let inner = w * c * w.transpose();
            let inner = Mat::from_fn(k, k, |i, j| inner[(i, j)] + if i == j { 1.0 } else { 0.0 });
            let Ok(factor) = inner.llt(Side::Lower) else { return f64::NEG_INFINITY };
            match &spread {
                // log det M' - log det M = log det (I + W C Wᵀ)
                None => 2.0 * (0..k).map(|i| factor.L()[(i, i)].ln()).sum::<f64>(),
                // tr(Ω C) - tr(Ω C') = tr((I + W C Wᵀ)⁻¹ W C Ω C Wᵀ), from (92)
                Some(spread) => {
                    let solved = factor.solve(w * spread * w.transpose());
                    (0..k).map(|i| solved[(i, i)]).sum()
                }
            }
        };
        let mut best = (gain(now) * (1.0 + 1e-9), now);
        for pose in (0..self.len()).filter(|pose| !kept.contains(pose)) {
            let value = gain(pose);
            if value > best.0 {
                best = (value, pose);
            }
        }
        best.1
    }

    /// `Ω` of the criterion `tr(Ω C)`; none for the volume.
    fn weight(&self, criterion: Criterion) -> Option<Mat<f64>> {
        let (c, n) = (self.channels, 2 * self.channels);
        let poses = self.len() as f64;
        match criterion {
            Criterion::Volume => None,
            Criterion::Platform | Criterion::Decide => self.platform.clone(),
            Criterion::Offsets => {
                Some(Mat::from_fn(n, n, |i, j| if i == j && i < c { 1.0 } else { 0.0 }))
            }
            Criterion::Joints => {
                let mut omega = Mat::zeros(n, n);
                for i in 0..c {
                    let a = self.counts.iter().skip(i).step_by(c).map(|v| v / self.scale[c + i]);
                    let (sum, square) = a.fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
                    omega[(i, i)] = 1.0;
                    omega[(i, c + i)] = sum / poses;
                    omega[(c + i, i)] = sum / poses;
                    omega[(c + i, c + i)] = square / poses;
                }
                Some(omega)
            }
        }
    }
}

/// Sweeps of the exchange; it has never needed more than a dozen.
const SWEEPS: usize = 50;
