//! What is unknown in one pose alone, eliminated in that pose.
//!
//! With the whitened equations `r = L⁻¹ w` and `B = L⁻¹ ∂f/∂ξ` of a sample,
//!
//! ```text
//! B = Q [R; 0],   Q = [M N],   g = Nᵀ r,   ξ ← ξ - R⁻¹ Mᵀ r               (59)
//! ```
//!
//! repeated with (52) until `ξ` stands still: then it minimises `|r|`, and `Nᵀ L⁻¹ X` is the exact
//! Jacobian of `g`, for the derivatives of `L` cancel as they do in (51). The rest of the estimation
//! sees `g`, of as many equations less as there are coordinates of `ξ`. `Q` is a product of
//! reflections, in an order that does not change from sample to sample: samples of one pose have the
//! same `N` but for their noise. No single entry of `g` belongs to a closure; `N g = N Nᵀ r` does.

use crate::model::RANK;
use crate::numerics::lanes::{Lanes, WIDTH, dispatch};

/// The reflections of one block, and `R`.
#[derive(Debug, Clone, Default)]
pub(crate) struct Eliminated {
    /// Coordinates of `ξ`.
    unknowns: usize,
    /// Vectors of the reflections, one after another, each as long as there are equations.
    vectors: Vec<Lanes>,
    /// `B`, turned: `R` above.
    b: Vec<Lanes>,
}

impl Eliminated {
    /// Room for so many unknowns of a pose.
    pub(crate) fn new(unknowns: usize) -> Self {
        Self { unknowns, ..Self::default() }
    }

    /// True where nothing is eliminated.
    #[inline(always)]
    pub(crate) fn is_none(&self) -> bool {
        self.unknowns == 0
    }

    /// Finds the reflections that turn whitened `b`, `equations` rows, into `R`.
    pub(crate) fn factor(&mut self, b: &[Lanes], equations: usize) {
        let n = self.unknowns;
        self.b.clear();
        self.b.extend_from_slice(b);
        self.vectors.clear();
        self.vectors.resize(n * equations, Lanes::ZERO);
        let norm = |b: &[Lanes], j: usize, from: usize| {
            let squares = (from..equations).map(|i| b[i * n + j] * b[i * n + j]);
            squares.fold(Lanes::ZERO, |sum, square| sum + square).sqrt()
        };
        let mut largest = Lanes::ZERO;
        for j in 0..n {
            largest = largest.zip(norm(b, j, 0), f64::max);
        }
        for j in 0..n {
            let long = norm(&self.b, j, j);
            let v = &mut self.vectors[j * equations..(j + 1) * equations];
            let mut square = Lanes::ZERO;
            for (i, v) in v.iter_mut().enumerate().skip(j) {
                *v = self.b[i * n + j];
                if i == j {
                    *v += v.zip(long, |pivot, long| long.copysign(pivot));
                }
                square += *v * *v;
            }
            // No reflection where the direction is not determined.
            let by = Lanes(std::array::from_fn(|lane| {
                let determined = long.0[lane] > RANK * largest.0[lane];
                if determined { (2.0 / square.0[lane]).sqrt() } else { 0.0 }
            }));
            v.iter_mut().for_each(|v| *v = *v * by);
            reflect(v, &mut self.b, n);
        }
    }

    /// `Qᵀ` of some columns, row by row, so many in a row.
    pub(crate) fn turn(&self, rows: &mut [Lanes], columns: usize) {
        for v in self.reflections(rows.len() / columns.max(1)) {
            reflect(v, rows, columns);
        }
    }

    /// `Q` of one column.
    pub(crate) fn turn_back(&self, column: &mut [Lanes]) {
        for v in self.reflections(column.len()).rev() {
            reflect(v, column, 1);
        }
    }

    fn reflections(&self, equations: usize) -> impl DoubleEndedIterator<Item = &[Lanes]> {
        self.vectors.chunks_exact(equations.max(1))
    }

    /// The step `-R⁻¹ z` of `ξ`, which `z = Mᵀ r` leaves; zero along what is not determined.
    pub(crate) fn step(&self, z: &[Lanes]) -> Vec<Lanes> {
        let n = self.unknowns;
        let mut largest = Lanes::ZERO;
        for j in 0..n {
            largest = largest.zip(self.b[j * n + j], |most, r| most.max(r.abs()));
        }
        let mut step = vec![Lanes::ZERO; n];
        for j in (0..n).rev() {
            let mut left = -z[j];
            for (k, step) in step.iter().enumerate().skip(j + 1) {
                left -= self.b[j * n + k] * *step;
            }
            let pivot = self.b[j * n + j];
            step[j] = Lanes(std::array::from_fn(|lane| {
                let determined = pivot.0[lane].abs() > RANK * largest.0[lane];
                if determined { left.0[lane] / pivot.0[lane] } else { 0.0 }
            }));
        }
        step
    }

    /// What rounding of `ξ` leaves of `z`, lane by lane the largest.
    pub(crate) fn rounding(&self, xi: &[Lanes]) -> [f64; WIDTH] {
        let n = self.unknowns;
        let mut most = [0.0_f64; WIDTH];
        for row in self.b.chunks_exact(n).take(n) {
            for (lane, most) in most.iter_mut().enumerate() {
                let of_row: f64 =
                    row.iter().zip(xi).map(|(r, x)| (r.0[lane] * x.0[lane]).abs()).sum();
                *most = most.max(64.0 * f64::EPSILON * of_row);
            }
        }
        most
    }
}

/// `rows -= v vᵀ rows`, where `vᵀ v` is two, or zero for no reflection.
fn reflect(v: &[Lanes], rows: &mut [Lanes], columns: usize) {
    dispatch(
        #[inline(always)]
        || {
            for c in 0..columns {
                let mut along = Lanes::ZERO;
                for (i, v) in v.iter().enumerate() {
                    along = v.mul_add(rows[i * columns + c], along);
                }
                for (i, v) in v.iter().enumerate() {
                    rows[i * columns + c] -= *v * along;
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::numerics::random::Random;

    const EQUATIONS: usize = 5;

    fn lanes(random: &mut Random, count: usize) -> Vec<Lanes> {
        (0..count).map(|_| Lanes(std::array::from_fn(|_| random.uniform(-1.0, 1.0)))).collect()
    }

    fn matrix(rows: &[Lanes], columns: usize, lane: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows.len() / columns, columns, |i, j| rows[i * columns + j].0[lane])
    }

    #[test]
    fn what_is_left_is_what_no_place_takes_up() {
        let mut random = Random::new(3);
        for n in 1..4 {
            let (b, r) = (lanes(&mut random, EQUATIONS * n), lanes(&mut random, EQUATIONS));
            let mut own = Eliminated::new(n);
            own.factor(&b, EQUATIONS);
            let mut turned = r.clone();
            own.turn(&mut turned, 1);
            let step = own.step(&turned[..n]);
            let mut left = turned.clone();
            left[..n].fill(Lanes::ZERO);
            own.turn_back(&mut left);
            for lane in 0..WIDTH {
                let (b, r) = (matrix(&b, n, lane), matrix(&r, 1, lane));
                let r: DVector<f64> = r.column(0).into();
                let plain = (b.transpose() * &b).lu().solve(&(b.transpose() * -&r));
                let plain = plain.expect("full rank");
                // Condition of a random matrix of three columns: below 1e3.
                let off = |k: usize| (step[k].0[lane] - plain[k]).abs();
                assert!((0..n).all(|k| off(k) < 1e-10), "n = {n}");
                let expected = r + b * plain;
                for i in 0..EQUATIONS {
                    assert!((left[i].0[lane] - expected[i]).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn a_direction_that_is_not_determined_is_left_where_it_is() {
        let mut random = Random::new(4);
        let one = lanes(&mut random, EQUATIONS);
        let b: Vec<Lanes> = one.iter().flat_map(|one| [*one, *one * 2.0]).collect();
        let mut own = Eliminated::new(2);
        own.factor(&b, EQUATIONS);
        let mut r = lanes(&mut random, EQUATIONS);
        let square: f64 = r.iter().map(|r| r.0[0] * r.0[0]).sum();
        own.turn(&mut r, 1);
        let step = own.step(&r[..2]);
        assert_eq!(step[1], Lanes::ZERO);
        let turned: f64 = r.iter().map(|r| r.0[0] * r.0[0]).sum();
        assert!((square - turned).abs() < 1e-14);
    }
}
