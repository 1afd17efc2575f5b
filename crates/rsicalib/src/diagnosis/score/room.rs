//! Scores of errors of one sensor by whatever law, from sums over where its samples are.
//!
//! A law `g(x)` has the column `a g(x)`, with `a` the derivative of a whitened equation by the
//! coordinate of the joint. Samples that are close to each other are one place.

use faer::Mat;

use crate::estimate::angles::Angles;
use crate::estimate::at_fit::{AtFit, Column};
use crate::numerics::lanes::dispatch;
use crate::numerics::order;
use crate::numerics::symmetric::{VISIBLE, dot, invert};

/// A column of which less than this part is left beside the fit is absorbed.
const ABSORBED: f64 = 1e-9;

/// One place along a law, with the sums of `a` over the samples there.
struct Place {
    x: f64,
    sums: Column,
}

/// A session in which laws of one channel are scored beside a fit.
pub(crate) struct Room {
    places: Vec<Place>,
    /// `p` of the fit.
    pull: Vec<f64>,
    /// The lowest and the highest `x`.
    pub low: f64,
    pub high: f64,
}

/// `T` of (72) of some columns, with what stands behind it.
pub(crate) struct LawScore {
    pub score: f64,
    /// Columns that are not absorbed.
    pub rank: f64,
    /// The amplitudes, and their standard deviations.
    pub amplitudes: Vec<[f64; 2]>,
}

impl Room {
    /// Samples at `x`, each with its row, gathered at so many places at the most; none where all
    /// are at one `x`.
    pub fn new(
        at: &AtFit,
        angles: &Angles,
        channel: usize,
        mut samples: Vec<(f64, usize)>,
        most: usize,
    ) -> Option<Self> {
        order::ascending(&mut samples, |a| a.0);
        let (low, high) = (samples.first()?.0, samples.last()?.0);
        if !(high > low && high - low < f64::INFINITY) {
            return None;
        }
        let place = |samples: &[(f64, usize)]| {
            let x = samples.iter().map(|s| s.0).sum::<f64>() / samples.len() as f64;
            let mut sums = Column::new(at.rank());
            for &(_, row) in samples {
                let slope = angles.slope(row, channel);
                at.equations(row).for_each(|e| sums.add(at, e, at.by_reading(e, channel) / slope));
            }
            Place { x, sums }
        };
        let each = samples.len().div_ceil(most);
        let places = samples.chunks(each).map(place).collect();
        Some(Self { places, pull: at.pull.clone(), low, high })
    }

    /// Where samples are gathered.
    pub fn places(&self) -> impl Iterator<Item = f64> + '_ {
        self.places.iter().map(|place| place.x)
    }

    /// The score of columns `a g(x)`; their amplitudes are `-M⁻¹ u`.
    pub fn score(&self, width: usize, columns: impl Fn(f64, &mut [f64])) -> LawScore {
        let n = self.pull.len();
        let mut g = vec![0.0; width];
        let mut square: Mat<f64> = Mat::zeros(width, width);
        let mut cross: Mat<f64> = Mat::zeros(n, width);
        let mut gradient: Mat<f64> = Mat::zeros(width, 1);
        for Place { x, sums } in &self.places {
            columns(*x, &mut g);
            for i in 0..width {
                gradient[(i, 0)] += g[i] * sums.zr;
                (0..width).for_each(|j| square[(i, j)] += g[i] * g[j] * sums.zz);
                (0..n).for_each(|p| cross[(p, i)] += g[i] * sums.zq[p]);
            }
        }
        for i in 0..width {
            gradient[(i, 0)] -= dot(cross.col_as_slice(i), &self.pull);
        }
        let mut left = &square - cross.transpose() * &cross;
        let absorbed = |i: &usize| left[(*i, *i)] <= ABSORBED * square[(*i, *i)];
        for i in (0..width).filter(absorbed).collect::<Vec<_>>() {
            gradient[(i, 0)] = 0.0;
            (0..width).for_each(|j| (left[(i, j)], left[(j, i)]) = (0.0, 0.0));
        }
        let (inverse, ..) = invert(&left);
        let amplitudes = &inverse * &gradient;
        let score = (0..width).map(|i| gradient[(i, 0)] * amplitudes[(i, 0)]).sum();
        let shares = &inverse * &left;
        let rank = (0..width).map(|i| shares[(i, i)]).sum::<f64>().round();
        let of = |i: usize| [-amplitudes[(i, 0)], inverse[(i, i)].max(0.0).sqrt()];
        LawScore { score, rank, amplitudes: (0..width).map(of).collect() }
    }

    /// [`Room::score`] of two columns, given at each place; none where they cannot be told apart
    /// from what the fit absorbs, or from each other.
    pub fn score_two(&self, columns: &[[f64; 2]]) -> Option<f64> {
        dispatch(
            #[inline(always)]
            || self.score_two_as_compiled(columns),
        )
    }

    /// [`Room::score_two`] with the instructions that the caller is compiled for.
    #[inline(always)]
    fn score_two_as_compiled(&self, columns: &[[f64; 2]]) -> Option<f64> {
        let (mut u, mut square) = ([0.0; 2], [0.0; 3]);
        let mut cross = [vec![0.0; self.pull.len()], vec![0.0; self.pull.len()]];
        let [first, second] = &mut cross;
        for (Place { sums, .. }, &[a, b]) in self.places.iter().zip(columns) {
            u[0] += a * sums.zr;
            u[1] += b * sums.zr;
            square[0] += a * a * sums.zz;
            square[1] += a * b * sums.zz;
            square[2] += b * b * sums.zz;
            for ((first, second), q) in first.iter_mut().zip(&mut *second).zip(&sums.zq) {
                *first += a * q;
                *second += b * q;
            }
        }
        u[0] -= dot(first, &self.pull);
        u[1] -= dot(second, &self.pull);
        let m = [
            square[0] - dot(first, first),
            square[1] - dot(first, second),
            square[2] - dot(second, second),
        ];
        let determinant = m[0] * m[2] - m[1] * m[1];
        let form = m[2] * u[0] * u[0] - 2.0 * m[1] * u[0] * u[1] + m[0] * u[1] * u[1];
        (determinant > VISIBLE * square[0] * square[2]).then_some(form / determinant)
    }

    /// What errors of this sensor explain, by whatever law, above what noise has them explain: an
    /// angle of its own for each place, before the fit absorbs any.
    pub fn any_law(&self) -> f64 {
        let seen = self.places.iter().filter(|place| place.sums.zz > 0.0);
        let explained = seen.map(|place| place.sums.zr * place.sums.zr / place.sums.zz - 1.0);
        explained.sum::<f64>().max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_columns_score_as_any_number_of_columns_do() {
        let odd = |i: usize, j: usize| ((1 + i * i + 7 * i * j + j) as f64).sin();
        let place = |i: usize| {
            // Rows of Q are short: a fit absorbs a part of each equation.
            let zq = (0..4).map(|j| 0.2 * odd(i, j)).collect();
            let x = i as f64 / 40.0;
            Place { x, sums: Column { zr: odd(i, 5), zz: 1.0 + odd(i, 6).powi(2), zq } }
        };
        let places: Vec<Place> = (0..40).map(place).collect();
        let room = Room { places, pull: vec![0.3, -0.2, 0.1, 0.4], low: 0.0, high: 1.0 };
        for order in [3.0, 17.5] {
            let wave = |x: f64| [(order * x).sin(), (order * x).cos()];
            let any = room.score(2, |x, out| out.copy_from_slice(&wave(x)));
            let two = room.score_two(&room.places().map(wave).collect::<Vec<_>>());
            let two = two.expect("waves that are apart");
            assert!((two - any.score).abs() < 1e-9 * any.score, "{two} for {}", any.score);
        }
        let same = room.score_two(&room.places().map(|x| [x, 2.0 * x]).collect::<Vec<_>>());
        assert_eq!(same, None);
    }
}
