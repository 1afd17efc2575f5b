//! Weighted least squares of (127) for given jumps and a given scatter.

use crate::numerics::order::Ends;
use faer::Mat;

use crate::history::past::Past;
use crate::numerics::symmetric::invert;

/// Which parts of (127) there are.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shape {
    /// True where there is a rate.
    pub(super) line: bool,
    /// The last result before each jump, ascending.
    pub(super) jumps: Vec<usize>,
}

impl Shape {
    /// Number of parameters: the level at the last date, the rate, the jumps.
    pub(super) fn width(&self) -> usize {
        1 + usize::from(self.line) + self.jumps.len()
    }

    /// Degrees of freedom that are left of `n` results: the place of a jump is a parameter, too.
    pub(super) fn dof(&self, n: usize) -> f64 {
        n as f64 - (self.width() + self.jumps.len()) as f64
    }

    /// True where two results of different dates are between the same jumps.
    pub(super) fn tells_rate(&self, past: &[Past]) -> bool {
        let between =
            |(i, two): (usize, &[Past])| two[1].day > two[0].day && !self.jumps.contains(&i);
        past.windows(2).enumerate().any(between)
    }

    /// Row of a result: of the level, the rate where there is one, and the jumps.
    fn row(&self, past: &[Past], i: usize) -> Vec<f64> {
        let last = past.len() - 1;
        let line = self.line.then(|| past[i].day - past[last].day);
        let jumps = self.jumps.iter().map(|&j| if i <= j { -1.0 } else { 0.0 });
        [1.0].into_iter().chain(line).chain(jumps).collect()
    }
}

/// A weighted fit of a shape.
pub(super) struct Fitted {
    /// Level, rate where there is one, jumps.
    pub(super) x: Vec<f64>,
    /// Their covariance.
    pub(super) covariance: Mat<f64>,
    /// `Σ r²/v`.
    pub(super) chi2: f64,
    /// `Σ r²/v + Σ ln v`: -2 ln L, up to a constant.
    pub(super) cost: f64,
    /// `r` of each result.
    pub(super) left: Vec<f64>,
}

/// The fit of a shape with scatter `tau2 = τ²`.
pub(super) fn fitted(past: &[Past], shape: &Shape, tau2: f64) -> Fitted {
    let k = shape.width();
    let (mut normal, mut rhs) = (Mat::<f64>::zeros(k, k), vec![0.0; k]);
    let rows: Vec<Vec<f64>> = (0..past.len()).map(|i| shape.row(past, i)).collect();
    let weight = |one: &Past| (one.sd * one.sd + tau2).recip();
    for (one, row) in past.iter().zip(&rows) {
        let w = weight(one);
        for a in 0..k {
            rhs[a] += w * row[a] * one.value;
            for b in 0..k {
                normal[(a, b)] += w * row[a] * row[b];
            }
        }
    }
    let covariance = invert(&normal).0;
    let x: Vec<f64> = (0..k).map(|a| (0..k).map(|b| covariance[(a, b)] * rhs[b]).sum()).collect();
    let of = |(one, row): (&Past, &Vec<f64>)| {
        one.value - row.iter().zip(&x).map(|(r, x)| r * x).sum::<f64>()
    };
    let left: Vec<f64> = past.iter().zip(&rows).map(of).collect();
    let chi2 = past.iter().zip(&left).map(|(one, r)| weight(one) * r * r).sum::<f64>();
    let cost = chi2 - past.iter().map(|one| weight(one).ln()).sum::<f64>();
    Fitted { x, covariance, chi2, cost, left }
}

/// The scatter with the largest likelihood, `τ²`; zero where none helps.
pub(super) fn likeliest(past: &[Past], shape: &Shape) -> f64 {
    let cost = |ln: f64| fitted(past, shape, ln.exp()).cost;
    let spread = fitted(past, shape, 0.0).left.iter().map(|r| r * r).sum::<f64>();
    let top = spread.max(f64::MIN_POSITIVE).ln();
    let grid: Vec<f64> = (0..17).map(|k| top - 0.9 * f64::from(k)).collect();
    let costs: Vec<f64> = grid.iter().map(|&ln| cost(ln)).collect();
    let best = (0..grid.len()).least_by(|&a| costs[a]).unwrap_or(0);
    let (mut low, mut high) = (grid[best] - 0.9, grid[best] + 0.9);
    for _ in 0..18 {
        let third = (high - low) / 3.0;
        if cost(low + third) < cost(high - third) { high -= third } else { low += third }
    }
    let found = (0.5 * (low + high)).exp();
    if fitted(past, shape, 0.0).cost <= cost(found.ln()) { 0.0 } else { found }
}

/// The scatter with which the weighted squares are as many as the degrees of freedom
/// (Paule and Mandel 1982), `τ²`: unbiased where that with the largest likelihood is too small.
pub(super) fn unbiased(past: &[Past], shape: &Shape) -> f64 {
    let dof = shape.dof(past.len());
    let over = |tau2: f64| fitted(past, shape, tau2).chi2 > dof;
    if dof < 1.0 || !over(0.0) {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, likeliest(past, shape).max(f64::MIN_POSITIVE));
    while over(high) {
        high *= 2.0;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if over(middle) { low = middle } else { high = middle }
    }
    high
}
