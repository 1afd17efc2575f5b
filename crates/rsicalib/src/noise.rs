//! How large the noise is, from the readings themselves.
//!
//! A hand that holds a pose shakes. Shaking keeps the loop closed, sensor noise
//! does not, so the noise is the scatter of the *whitened misclosure* within a
//! pose, not that of the channels. In a recording, where no pose is held, the
//! scatter about a straight line over a few neighbouring rows takes its place.
//!
//! ```text
//! s²   = Σ_p Σ_s |r_ps - r̄_p|² / ν,     ν = K Σ_p (n_p - 1)               (61)
//! ```

use crate::objective::Residuals;
use crate::readings::Readings;

/// Rows that a stretch of a recording has.
const STRETCH: usize = 8;

/// Where the noise is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Declared by the user or the mechanism.
    Declared,
    /// Scatter of the misclosure within held poses.
    Repeats,
    /// Scatter of the misclosure about neighbouring rows of a recording.
    Neighbours,
    /// Readings never differ within a pose: rounding alone.
    Quantisation,
    /// Nothing but the fit itself: lack of fit cannot be judged.
    Fit,
}

impl Source {
    /// In words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Declared => "declared",
            Self::Repeats => "misclosure of repeats",
            Self::Neighbours => "misclosure of neighbouring rows",
            Self::Quantisation => "quantisation",
            Self::Fit => "the fit itself",
        }
    }

    /// True where lack of fit can be judged against it.
    #[must_use]
    pub fn independent(self) -> bool {
        self != Self::Fit
    }
}

/// Scatter of whitened residuals within groups of rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scatter {
    /// Sum of squares within the groups.
    pub within: f64,
    /// Its degrees of freedom, as if samples were independent.
    pub dof: f64,
    /// Correlation of neighbouring samples.
    pub correlation: f64,
    /// Variance of a group mean over that of independent samples.
    pub inflation: f64,
}

/// Rows that repeat each other: held poses, or stretches of a recording.
#[derive(Debug, Clone)]
pub struct Groups {
    /// The rows of each.
    pub rows: Vec<Vec<usize>>,
    /// Parameters of what is removed from each: 1 a mean, 2 a line.
    pub order: usize,
}

impl Groups {
    /// The groups of these readings, of the rows in use.
    #[must_use]
    pub fn of(readings: &Readings, weights: &[f64]) -> Self {
        if readings.held {
            let mut rows = readings.rows_of_poses();
            for rows in &mut rows {
                rows.retain(|&r| weights[r] > 0.0);
            }
            return Self { rows, order: 1 };
        }
        if !readings.timed {
            return Self { rows: Vec::new(), order: 1 };
        }
        let live: Vec<usize> = (0..readings.samples).filter(|&r| weights[r] > 0.0).collect();
        let rows = live.chunks_exact(STRETCH).map(<[usize]>::to_vec).collect();
        Self { rows, order: 2 }
    }

    /// Eq. (61): the scatter of residuals within these groups.
    #[must_use]
    pub fn scatter(&self, residuals: &Residuals) -> Scatter {
        let k = residuals.equations;
        let (mut within, mut dof) = (0.0, 0.0);
        // Lag-1 products, and what independent samples would give them.
        let (mut product, mut expected) = (0.0, 0.0);
        let mut left = Vec::new();
        for rows in self.rows.iter().filter(|r| r.len() > self.order) {
            for equation in 0..k {
                left.clear();
                left.extend(rows.iter().map(|r| residuals.whitened[r * k + equation]));
                detrend(&mut left, self.order);
                within += left.iter().map(|r| r * r).sum::<f64>();
                product += left.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
            }
            let free = (rows.len() - self.order) as f64;
            dof += free * k as f64;
            expected -= lost_product(rows.len(), self.order) * k as f64;
        }
        if dof == 0.0 {
            return Scatter { within, dof, correlation: 0.0, inflation: 1.0 };
        }
        let n = (self.rows.iter().map(Vec::len).sum::<usize>() as f64 / self.rows.len() as f64)
            .max(2.0);
        let pairs = dof * (n - 1.0) / (n - self.order as f64).max(1.0);
        let variance = within / dof;
        let raw = if variance > 0.0 { (product / variance - expected) / pairs } else { 0.0 };
        // Noise of the estimate itself: one over the root of the pairs.
        let sure = 3.0 / pairs.sqrt();
        let correlation = if raw > sure { unbias(raw, n).min(0.95) } else { 0.0 };
        let inflation = inflation(correlation, n);
        Scatter {
            within,
            dof,
            correlation: if correlation > 0.0 { correlation } else { raw },
            inflation,
        }
    }
}

/// `-E Σ e_i e_{i+1} / σ²` of independent samples from which a mean (order 1) or
/// a line (order 2) was removed: the sum of the hat matrix beside its diagonal.
fn lost_product(n: usize, order: usize) -> f64 {
    let count = n as f64;
    let mut lost = (count - 1.0) / count;
    if order > 1 {
        let x = |i: usize| i as f64 - 0.5 * (count - 1.0);
        let moment: f64 = (0..n).map(|i| x(i).powi(2)).sum();
        lost += (1..n).map(|i| x(i) * x(i - 1)).sum::<f64>() / moment;
    }
    lost
}

/// Correlation whose removal of a mean over `n` samples shows as `raw`.
fn unbias(raw: f64, n: f64) -> f64 {
    // Within-group covariances lose the variance of the mean, V = σ²/n · g(ρ):
    // raw ≈ (ρ - V + 1/n ...)/(1 - V); solved by a few fixed-point steps.
    let mut rho = raw;
    for _ in 0..50 {
        let v = mean_variance(rho, n);
        let scale = (1.0 - v) / (1.0 - 1.0 / n);
        rho = (v + (raw - 1.0 / n) * scale).clamp(0.0, 0.95);
    }
    rho
}

/// Variance of the mean of `n` samples of unit variance and lag-1 correlation `rho`.
fn mean_variance(rho: f64, n: f64) -> f64 {
    let mut sum = 1.0;
    let mut power = 1.0;
    for lag in 1..n as usize {
        power *= rho;
        sum += 2.0 * (1.0 - lag as f64 / n) * power;
    }
    sum / n
}

/// Variance of a group mean, over what the scatter within promises for it.
fn inflation(rho: f64, n: f64) -> f64 {
    if rho <= 0.0 {
        return 1.0;
    }
    let v = mean_variance(rho, n);
    // Scatter within, per degree of freedom, is σ² (1 - v) n / (n - 1).
    v * n / ((1.0 - v) * n / (n - 1.0))
}

/// Removes a mean (order 1) or a straight line (order 2).
fn detrend(values: &mut [f64], order: usize) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let middle = 0.5 * (n - 1.0);
    let mut slope = 0.0;
    if order > 1 {
        let moment: f64 = (0..values.len()).map(|i| (i as f64 - middle).powi(2)).sum();
        slope =
            values.iter().enumerate().map(|(i, v)| (i as f64 - middle) * v).sum::<f64>() / moment;
    }
    for (i, value) in values.iter_mut().enumerate() {
        *value -= mean + slope * (i as f64 - middle);
    }
}
