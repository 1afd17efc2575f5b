//! The score of columns of one channel beside a fit, by sums over where the samples are.

use faer::Mat;

use crate::estimate::angles::Angles;
use crate::estimate::{Fit, Implicit, Observations, Part};
use crate::numerics::symmetric::invert;
use crate::terms::term::Over;

/// Places that samples are gathered at, at the most: a recording has many that are alike.
const PLACES: usize = 1024;

/// A column of which less than this part is left beside the fit is absorbed.
const ABSORBED: f64 = 1e-9;

/// One place along a curve, with the sums of the samples there. `a` is the derivative of a whitened
/// residual by the coordinate of the joint.
struct Place {
    x: f64,
    /// `Σ a²`
    square: f64,
    /// `Σ a r`
    residual: f64,
    /// `Σ a X`, one for each parameter of the fit.
    fitted: Vec<f64>,
}

/// A session in which curves of one channel are scored beside a fit.
pub(crate) struct Room {
    places: Vec<Place>,
    /// `N⁻¹`, priors included.
    inverse: Mat<f64>,
    /// `N⁻¹ Xᵀr`, the priors' pull included: 0 at the minimum.
    step: Mat<f64>,
    /// The lowest and the highest `x`.
    pub low: f64,
    pub high: f64,
    /// Readings from the middle of the range in one unit of `x`; 1 over time.
    pub per_x: f64,
    /// The reading at `x = 0`; 0 over time.
    pub zero: f64,
}

/// `T` of (72) of some columns, with what stands behind it.
pub(crate) struct Scored {
    pub score: f64,
    /// Columns that are not absorbed.
    pub rank: f64,
    /// The amplitudes, and their standard deviations.
    pub amplitudes: Vec<[f64; 2]>,
}

impl Room {
    /// None where the channel's readings are all alike.
    pub fn new(
        observations: &Observations,
        without: &Fit,
        channel: usize,
        over: Over,
    ) -> Option<Self> {
        let Observations { readings, weights, .. } = observations;
        let part = Part { model: &without.model, readings, weights: Some(weights) };
        let there =
            Implicit::new(vec![(part, without.assumed())], &[]).residuals(&without.beta, true);
        let angles = Angles::of(observations, &without.model, &without.beta);
        let live: Vec<usize> = (0..readings.samples).filter(|&row| weights[row] > 0.0).collect();
        let slope = live.iter().map(|&r| angles.slope(r, channel)).sum::<f64>() / live.len() as f64;
        let middle = without.model.scales[channel].middle;
        let (per_x, zero) = match over {
            Over::Reading => (slope.recip(), middle),
            Over::Time => (1.0, 0.0),
        };
        let mut where_: Vec<(f64, usize)> = match over {
            Over::Reading => {
                let x = |&row: &usize| (readings.row(row)[channel] - middle) * slope;
                live.iter().map(|row| (x(row), *row)).collect()
            }
            Over::Time => {
                let blocks = readings.blocks().iter();
                let of = |b: &crate::readings::Block| {
                    let rows = b.rows.iter().take(b.live).enumerate();
                    rows.map(|(lane, &row)| (b.time.0[lane], row)).collect::<Vec<_>>()
                };
                blocks.flat_map(of).filter(|(_, row)| weights[*row] > 0.0).collect()
            }
        };
        where_.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (low, high) = (where_.first()?.0, where_.last()?.0);
        if !(high > low && per_x.is_finite()) {
            return None;
        }
        let (k, c, n) = (there.equations, readings.channels, without.model.parameters);
        let mut base: Mat<f64> = Mat::zeros(n, 1);
        for (x, r) in there.by_parameter.chunks_exact(n.max(1)).zip(&there.whitened) {
            x.iter().enumerate().for_each(|(p, x)| base[(p, 0)] += x * r);
        }
        for prior in &without.priors {
            for (column, slope) in prior.slopes(&without.beta) {
                base[(column, 0)] += slope * prior.off(&without.beta);
            }
        }
        let inverse = invert(&without.gram).0;
        let step = &inverse * base;
        let each = where_.len().div_ceil(PLACES);
        let place = |samples: &[(f64, usize)]| {
            let x = samples.iter().map(|s| s.0).sum::<f64>() / samples.len() as f64;
            let mut place = Place { x, square: 0.0, residual: 0.0, fitted: vec![0.0; n] };
            for e in samples.iter().flat_map(|(_, row)| row * k..(row + 1) * k) {
                let row = e / k;
                let a = there.by_reading[e * c + channel] / angles.slope(row, channel);
                place.square += a * a;
                place.residual += a * there.whitened[e];
                let fitted = &there.by_parameter[e * n..(e + 1) * n];
                place.fitted.iter_mut().zip(fitted).for_each(|(sum, x)| *sum += a * x);
            }
            place
        };
        let places = where_.chunks(each).map(place).collect();
        Some(Self { places, inverse, step, low, high, per_x, zero })
    }

    /// The score of columns `g(x)`: with `Z = a g`, `G = ZᵀZ − ZᵀX N⁻¹ XᵀZ` and `u = Zᵀr − ZᵀX N⁻¹ Xᵀr`,
    /// `T = uᵀ G⁻¹ u` and the amplitudes `−G⁻¹ u`.
    pub fn score(&self, width: usize, columns: impl Fn(f64, &mut [f64])) -> Scored {
        let n = self.inverse.nrows();
        let mut g = vec![0.0; width];
        let mut square: Mat<f64> = Mat::zeros(width, width);
        let mut cross: Mat<f64> = Mat::zeros(n, width);
        let mut gradient: Mat<f64> = Mat::zeros(width, 1);
        for place in &self.places {
            columns(place.x, &mut g);
            for i in 0..width {
                gradient[(i, 0)] += g[i] * place.residual;
                (0..width).for_each(|j| square[(i, j)] += g[i] * g[j] * place.square);
                (0..n).for_each(|p| cross[(p, i)] += g[i] * place.fitted[p]);
            }
        }
        gradient -= cross.transpose() * &self.step;
        let mut left = &square - cross.transpose() * (&self.inverse * &cross);
        for i in
            (0..width).filter(|&i| left[(i, i)] <= ABSORBED * square[(i, i)]).collect::<Vec<_>>()
        {
            gradient[(i, 0)] = 0.0;
            (0..width).for_each(|j| (left[(i, j)], left[(j, i)]) = (0.0, 0.0));
        }
        let (inverse, ..) = invert(&left);
        let amplitudes = &inverse * &gradient;
        let score = (0..width).map(|i| gradient[(i, 0)] * amplitudes[(i, 0)]).sum();
        let shares = &inverse * &left;
        let rank = (0..width).map(|i| shares[(i, i)]).sum::<f64>().round();
        let of = |i: usize| [-amplitudes[(i, 0)], inverse[(i, i)].max(0.0).sqrt()];
        Scored { score, rank, amplitudes: (0..width).map(of).collect() }
    }
}
