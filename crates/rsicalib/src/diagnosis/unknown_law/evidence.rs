//! The marginal likelihood of a smooth law of one or two variables, (115).
//!
//! The error of a channel, or of what is built, in sample `p` is `Σ_j φ_j(p) b_j`, with polynomials `φ_j` of degree `d_j`
//! of its variables, and `b_j ~ N(0, (τ d_j^-s)²)`. With (71) for the columns `Z = A Φ`, in units of
//! the prior, `M` has eigenvalues `m_k`, and `u` the components `u_k`:
//!
//! ```text
//! -2 ln L(τ, s) = data(χ² - Σ τ² u_k² / (1 + τ² m_k)) - data(χ²) + Σ ln(1 + τ² m_k)     (115)
//! ```
//!
//! `L` is averaged over amplitudes `τ` and smoothness `s`: so a law is charged for what data must tell
//! of it, and for nothing else. Where a closure makes two coordinates equal, what is linear in either is a
//! gain, which shrinks that closure to nothing beside the gain of the other: laws are orthogonal to it.

use crate::numerics::order::Ends;
use faer::{ColRef, Mat, MatRef};
use nalgebra::linalg::SymmetricTridiagonal;
use nalgebra::{DMatrix, DVector};

use crate::diagnosis::price::{Data, charge, less, mean};
use crate::diagnosis::unknown_law::formula::SMALL;
use crate::diagnosis::unknown_law::variables::{Function, Variable, degree};
use crate::estimate::at_fit::{AtFit, add_scaled};
use crate::numerics::symmetric::dot;

stated! {
    /// Degree of a law of two variables, of both together.
    fn degree_of_two() -> usize = 4;
    /// Amplitudes: doublings of a quarter of what one sample tells.
    fn law_amplitudes() -> i32 = 10;
}

/// Powers of the degree by which the amplitudes fall: a law that bends, and one that is smooth.
const SMOOTH: [f64; 2] = [1.0, 2.0];

/// What the equations of a session tell of the errors of one place, sample by sample.
#[derive(Clone)]
pub struct Errors {
    /// `Σ a²` of each sample.
    pub(super) square: Vec<f64>,
    /// `Aᵀ r - (Aᵀ Q) p`
    gradient: Vec<f64>,
    /// `Qᵀ a`, a column for each sample.
    absorbed: Mat<f64>,
    /// Orthonormal functions of the samples that no law has a part of.
    apart: Vec<Vec<f64>>,
    /// By how much χ² falls with an error that is the same in all samples, where that is fitted as well, and
    /// what it costs.
    pub(super) constant: Option<[f64; 2]>,
}

impl Errors {
    /// Of a channel in samples at a fit, by laws that have no part of the functions `apart`.
    pub fn of_channel(at: &AtFit, rows: &[usize], channel: usize, apart: &[Vec<f64>]) -> Self {
        let errors = Self::of(at, rows, |e| at.by_reading(e, channel));
        Self { apart: apart.to_vec(), ..errors }
    }

    /// Of parameter `k` of what may be fitted beside a fit, were it another in each pose.
    pub fn of_beside(at: &AtFit, rows: &[usize], k: usize) -> Self {
        Self::of(at, rows, |e| at.by_beside(e, k))
    }

    /// The same, beside an error that is the same in all samples, where that pays for itself as an effect of one
    /// parameter, and for `places`.
    pub fn beside_a_constant(mut self, places: f64) -> Self {
        let n = self.square.len();
        let constant = self.column(vec![1.0; n]);
        let left = self.entry(&constant, &constant);
        let fall = constant.along * constant.along / left;
        let paid = charge(1.0, fall) + places;
        if left <= SMALL * constant.plain || fall <= paid {
            return self;
        }
        let own = |p: usize| self.square[p] - dot(self.absorbed.col_as_slice(p), &constant.taken);
        let along: Vec<f64> = (0..n).map(own).collect();
        let rank = self.absorbed.nrows();
        let entry = |k: usize, p: usize| match k == rank {
            true => along[p] / left.sqrt(),
            false => self.absorbed[(k, p)],
        };
        self.absorbed = Mat::from_fn(rank + 1, n, entry);
        add_scaled(&mut self.gradient, -constant.along / left, &along);
        self.constant = Some([fall, paid]);
        self
    }

    /// Of what changes each whitened equation so.
    fn of(at: &AtFit, rows: &[usize], by: impl Fn(usize) -> f64) -> Self {
        let (mut square, mut gradient) = (Vec::new(), Vec::new());
        let mut absorbed = Mat::zeros(at.rank(), rows.len());
        for (p, &row) in rows.iter().enumerate() {
            let (mut aa, mut ar, aq) = (0.0, 0.0, absorbed.col_as_slice_mut(p));
            for e in at.equations(row) {
                let a = by(e);
                aa += a * a;
                ar += a * at.residuals.whitened[e];
                add_scaled(aq, a, at.q(e));
            }
            square.push(aa);
            gradient.push(ar - dot(aq, &at.pull));
        }
        Self { square, gradient, absorbed, apart: Vec::new(), constant: None }
    }

    /// True where they show in some equation.
    pub fn show(&self) -> bool {
        self.square.iter().any(|aa| *aa > 0.0)
    }

    /// How likely a law of these variables is, beside a fit of which χ² is `chi2`.
    pub fn evidence(&self, variables: &[&Variable], data: &Data, chi2: f64) -> Evidence {
        let basis = Basis::of(variables, self.square.len(), &self.apart);
        let m = basis.degrees.len();
        let (square, gradient) = self.normal(&basis);
        let [constant, paid] = self.constant.unwrap_or_default();
        let usual = self.square.iter().sum::<f64>() / self.square.len().max(1) as f64;
        let mut found = Vec::with_capacity(SMOOTH.len() * law_amplitudes() as usize);
        for smooth in SMOOTH {
            let scales: Vec<f64> = basis.degrees.iter().map(|d| d.powf(-smooth)).collect();
            let of = DMatrix::from_fn(m, m, |i, j| square[(i, j)] * scales[i] * scales[j]);
            let scaled = DVector::from_fn(m, |j, _| gradient[j] * scales[j]);
            let ridge = Ridge::of(of, &scaled);
            for k in 0..law_amplitudes() {
                let tau2 = 4.0_f64.powi(k) / (16.0 * usual);
                let (fall, spread) = ridge.at(tau2);
                let fall = fall + constant;
                let price = data.of(less(chi2, fall)) - data.of(chi2) + spread + paid;
                found.push((price, fall, smooth, tau2));
            }
        }
        let price = mean(found.iter().map(|one| (one.0, 1.0)));
        let best = found.into_iter().least_by(|a| a.0);
        let (_, fall, smooth, tau2) = best.unwrap_or((0.0, 0.0, 1.0, 0.0));
        Evidence { price, fall, smooth, tau2 }
    }

    /// The likeliest errors by a law of these variables, of which `evidence` is known: those of the
    /// posterior mean of `b`. None where they cannot be had.
    pub fn likeliest(&self, variables: &[&Variable], evidence: &Evidence) -> Option<Likeliest> {
        let basis = Basis::of(variables, self.square.len(), &self.apart);
        let (square, gradient) = self.normal(&basis);
        let m = basis.degrees.len();
        let sd = |j: usize| evidence.tau2.sqrt() * basis.degrees[j].powf(-evidence.smooth);
        let whole = DMatrix::from_fn(m, m, |i, j| {
            sd(i) * square[(i, j)] * sd(j) + if i == j { 1.0 } else { 0.0 }
        });
        let right = DVector::from_fn(m, |j, _| sd(j) * gradient[j]);
        let root = whole.cholesky()?;
        let b = root.solve(&right);
        let error = |values: &[f64]| -> f64 {
            values.iter().enumerate().map(|(j, value)| value * sd(j) * b[j]).sum()
        };
        Some(Likeliest {
            errors: basis.values.chunks_exact(m).map(error).collect(),
            told: m as f64 - root.inverse().trace(),
        })
    }

    /// `M` and `u` of (71) for these columns, one after the other in each sample; without what no law has a part of.
    pub(super) fn normal_of(
        &self,
        columns: usize,
        values: Vec<f64>,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let basis = Basis { degrees: vec![1.0; columns], values };
        self.normal(&basis.without(&self.apart))
    }

    /// `M` and `u` of (71) for the columns of a basis.
    fn normal(&self, basis: &Basis) -> (DMatrix<f64>, DVector<f64>) {
        let m = basis.degrees.len();
        let values = MatRef::from_row_major_slice(&basis.values, self.square.len(), m);
        let weighted = Mat::from_fn(values.nrows(), m, |p, j| self.square[p] * values[(p, j)]);
        let taken = &self.absorbed * values;
        let square = values.transpose() * weighted - taken.transpose() * &taken;
        let gradient = values.transpose() * ColRef::from_slice(&self.gradient);
        // Both halves are the same to the bit.
        let square = DMatrix::from_fn(m, m, |i, j| square[(i.min(j), i.max(j))]);
        (square, DVector::from_fn(m, |j, _| gradient[j]))
    }

    /// A column of (71), given by its value in each sample; without what no law has a part of.
    pub(super) fn column(&self, mut values: Vec<f64>) -> Column {
        let whole = values.iter().zip(&self.square).map(|(v, square)| v * v * square).sum();
        for way in &self.apart {
            let part = dot(&values, way);
            add_scaled(&mut values, -part, way);
        }
        let taken = &self.absorbed * ColRef::from_slice(&values);
        Column {
            plain: whole,
            along: dot(&values, &self.gradient),
            taken: taken.iter().copied().collect(),
            values,
        }
    }

    /// An entry of `M` of (71).
    pub(super) fn entry(&self, a: &Column, b: &Column) -> f64 {
        let both = a.values.iter().zip(&b.values).zip(&self.square);
        both.map(|((a, b), square)| a * b * square).sum::<f64>() - dot(&a.taken, &b.taken)
    }
}

/// `M = Q T Qᵀ` with a tridiagonal `T`, and `Qᵀ u`: the sums of (115) are those of `I + τ² T`, at every amplitude,
/// and need no eigenvalues.
struct Ridge {
    diagonal: DVector<f64>,
    off_diagonal: DVector<f64>,
    along: DVector<f64>,
}

impl Ridge {
    fn of(m: DMatrix<f64>, u: &DVector<f64>) -> Self {
        let (q, diagonal, off_diagonal) = SymmetricTridiagonal::new(m).unpack();
        Self { diagonal, off_diagonal, along: q.tr_mul(u) }
    }

    /// `Σ τ² u_k² / (1 + τ² m_k)` and `Σ ln(1 + τ² m_k)`, by the factors `L D Lᵀ` of `I + τ² T`.
    fn at(&self, tau2: f64) -> (f64, f64) {
        let (mut fall, mut spread) = (0.0, 0.0);
        let (mut pivot, mut y) = (1.0, 0.0);
        for (k, u) in self.along.iter().enumerate() {
            let entry = if k > 0 { tau2 * self.off_diagonal[k - 1] } else { 0.0 };
            let factor = entry / pivot;
            // No less than 1, but for rounding: `M` has no negative direction.
            pivot = (1.0 + tau2 * self.diagonal[k] - factor * entry).clamp(1.0, f64::INFINITY);
            y = u - factor * y;
            fall += tau2 * y * y / pivot;
            spread += pivot.ln();
        }
        (fall, spread)
    }
}

/// A function of the samples, and what the fit takes of it.
pub(super) struct Column {
    values: Vec<f64>,
    /// `Qᵀ z`
    taken: Vec<f64>,
    /// `Σ a²` of it, before the fit takes its part.
    pub(super) plain: f64,
    /// Its entry of `u`.
    pub(super) along: f64,
}

/// How likely a law is.
#[derive(Debug, Clone, Copy)]
pub struct Evidence {
    /// `-2 ln L`, over that of no law.
    pub price: f64,
    /// By how much χ² falls with the likeliest amplitude.
    pub fall: f64,
    /// The likeliest smoothness `s`.
    pub smooth: f64,
    /// The square of the likeliest amplitude.
    pub tau2: f64,
}

/// The likeliest errors by a law.
#[derive(Debug, Clone, PartialEq)]
pub struct Likeliest {
    /// Of each sample, in the unit of readings.
    pub errors: Vec<f64>,
    /// What data tell of it, in parameters: `Σ τ² m_k / (1 + τ² m_k)`.
    pub told: f64,
}

impl Likeliest {
    /// Root mean square of the errors.
    pub fn size(&self) -> f64 {
        let squares: f64 = self.errors.iter().map(|e| e * e).sum();
        (squares / self.errors.len().max(1) as f64).sqrt()
    }
}

/// Functions of one or two variables, the constant left out.
struct Basis {
    /// Their degrees.
    degrees: Vec<f64>,
    /// Their values, sample by sample.
    values: Vec<f64>,
}

impl Basis {
    fn of(variables: &[&Variable], samples: usize, apart: &[Vec<f64>]) -> Self {
        let most = if variables.len() == 1 { degree() } else { degree_of_two() };
        let one = |function: Option<&Function>, p: usize| function.map_or(1.0, |f| f.values[p]);
        let degree = |function: Option<&Function>| function.map_or(0, |f| f.degree);
        // Of each variable its functions, and none of them.
        let of = |v: usize| {
            let own = variables.get(v).map_or(&[][..], |variable| &variable.functions);
            std::iter::once(None).chain(own.iter().map(Some))
        };
        let pairs: Vec<[Option<&Function>; 2]> = of(0)
            .flat_map(|a| of(1).map(move |b| [a, b]))
            .filter(|[a, b]| (1..=most).contains(&(degree(*a) + degree(*b))))
            .collect();
        let mut values = Vec::with_capacity(samples * pairs.len());
        for p in 0..samples {
            values.extend(pairs.iter().map(|[a, b]| one(*a, p) * one(*b, p)));
        }
        let degrees = pairs.iter().map(|[a, b]| (degree(*a) + degree(*b)) as f64).collect();
        Self { degrees, values }.without(apart)
    }

    /// The same functions without what they have of some orthonormal ones.
    fn without(mut self, apart: &[Vec<f64>]) -> Self {
        let m = self.degrees.len();
        for (j, way) in (0..m).flat_map(|j| apart.iter().map(move |way| (j, way))) {
            let column = || (0..way.len()).map(|p| p * m + j);
            let part: f64 = column().zip(way).map(|(k, w)| self.values[k] * w).sum();
            column().zip(way).for_each(|(k, w)| self.values[k] -= part * w);
        }
        self
    }
}

#[cfg(test)]
pub(super) mod tests {
    use faer::Mat;
    use nalgebra::{DMatrix, DVector};

    use super::{Basis, Errors, SMOOTH, law_amplitudes};
    use crate::diagnosis::price::{Data, Scale, charge};
    use crate::diagnosis::unknown_law::variables::{Quantity, Variable};

    /// Weight of what is fitted: its variance is without bound.
    const FITTED: f64 = 1e8;

    /// `-2 ln N(r; 0, C)`, but for a constant.
    fn gaussian(r: &DVector<f64>, cover: &DMatrix<f64>) -> f64 {
        let Some(root) = cover.clone().cholesky() else { return f64::NAN };
        let log: f64 = root.l().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
        r.dot(&root.solve(r)) + log
    }

    /// Errors of one equation a sample, with one direction that a fit has absorbed, and all that they
    /// are of.
    pub(in super::super) fn errors(n: usize) -> (Errors, DVector<f64>, DVector<f64>, DVector<f64>) {
        let at = |p: usize, pace: f64| (pace * p as f64 + 0.3).sin();
        let a = DVector::from_fn(n, |p, _| 1.5 + at(p, 1.7));
        let q = DVector::from_fn(n, |p, _| 1.0 + 0.5 * at(p, 0.4)).normalize();
        let r = DVector::from_fn(n, |p, _| 3.0 * at(p, 5.1));
        let r = &r - &q * q.dot(&r);
        let errors = Errors {
            square: a.iter().map(|a| a * a).collect(),
            gradient: a.iter().zip(&r).map(|(a, r)| a * r).collect(),
            absorbed: Mat::from_fn(1, n, |_, p| a[p] * q[p]),
            apart: Vec::new(),
            constant: None,
        };
        (errors, a, q, r)
    }

    #[test]
    fn columns_by_themselves_are_those_of_a_basis() {
        let (n, m) = (12, 3);
        let (errors, ..) = errors(n);
        let values: Vec<f64> = (0..n * m).map(|k| (0.7 * k as f64 + 0.2).cos()).collect();
        let (square, gradient) =
            errors.normal(&Basis { degrees: vec![1.0; m], values: values.clone() });
        let column = |j: usize| values.iter().skip(j).step_by(m).copied().collect();
        let columns: Vec<_> = (0..m).map(|j| errors.column(column(j))).collect();
        for (i, a) in columns.iter().enumerate() {
            // Sums of a dozen products of about ten.
            assert!((a.along - gradient[i]).abs() < 1e-12);
            let same = |(j, b)| (errors.entry(a, b) - square[(i, j)]).abs() < 1e-12;
            assert!(columns.iter().enumerate().all(same));
        }
    }

    #[test]
    fn a_law_has_no_part_of_what_is_apart() {
        let n = 12;
        let waves: Vec<f64> = (0..n).map(|p| (0.9 * p as f64 + 0.3).sin()).collect();
        let x = Variable::of(Quantity::Theta(0), waves).expect("what changes");
        let apart = DVector::from_vec(x.values.clone()).normalize();
        let basis = Basis::of(&[&x], n, &[apart.as_slice().to_vec()]);
        let m = basis.degrees.len();
        let columns = DMatrix::from_row_slice(n, m, &basis.values);
        // Sums of a dozen products of about one.
        assert!((columns.transpose() * &apart).amax() < 1e-13);
        assert!(columns.column(0).norm() < 1e-13, "what is linear alone is gone");
        assert!(columns.column(1).norm() > 1.0, "what bends is not");
    }

    #[test]
    fn it_is_the_density_of_the_residuals_with_their_whole_covariance() {
        let n = 12;
        let at = |p: usize, pace: f64| (pace * p as f64 + 0.3).sin();
        let waves = |pace: f64| (0..n).map(|p| at(p, pace)).collect::<Vec<f64>>();
        let x = Variable::of(Quantity::Theta(0), waves(0.9)).expect("what changes");
        let y = Variable::of(Quantity::Theta(1), waves(2.3)).expect("what changes");
        let plays = Variable::of_plays(Quantity::Play(1), vec![waves(3.1), waves(4.4)]);
        let plays = plays.expect("two that differ");
        let (_, a, q, r) = errors(n);
        let data = Data { scale: Scale::Known(f64::INFINITY), dof: n as f64 };
        let plain = DMatrix::identity(n, n) + &q * q.transpose() * FITTED;
        let constant = &plain + &a * a.transpose() * FITTED;
        // One that shows: half of the scatter of the residuals.
        let shows = &r + &a * 2.0;
        let shows = &shows - &q * q.dot(&shows);
        // What is fitted has a variance without bound.
        let fall = gaussian(&shows, &plain) - gaussian(&shows, &constant)
            + (constant.determinant() / plain.determinant()).ln();
        for (beside, r, plain) in [(false, r, plain), (true, shows, constant)] {
            let (errors, ..) = errors(n);
            let gradient = a.iter().zip(&r).map(|(a, r)| a * r).collect();
            let errors = Errors { gradient, ..errors };
            let errors = if beside { errors.beside_a_constant(0.5) } else { errors };
            let paid = if beside { charge(1.0, fall) + 0.5 - fall } else { 0.0 };
            for variables in [vec![&x], vec![&x, &y], vec![&plays], vec![&x, &plays]] {
                let got = errors.evidence(&variables, &data, r.norm_squared()).price - paid;
                let basis = Basis::of(&variables, n, &[]);
                let m = basis.degrees.len();
                let z = DMatrix::from_fn(n, m, |p, j| a[p] * basis.values[p * m + j]);
                let usual = a.norm_squared() / n as f64;
                let mut sum = 0.0;
                for s in SMOOTH {
                    for k in 0..law_amplitudes() {
                        let tau = 0.25 * 2.0_f64.powi(k) / usual.sqrt();
                        let sd = |j: usize| tau * basis.degrees[j].powf(-s);
                        let prior =
                            DMatrix::from_fn(m, m, |i, j| if i == j { sd(i).powi(2) } else { 0.0 });
                        let cover = &plain + &z * prior * z.transpose();
                        sum += (-0.5 * (gaussian(&r, &cover) - gaussian(&r, &plain))).exp();
                    }
                }
                let many = SMOOTH.len() as f64 * f64::from(law_amplitudes());
                let wanted = -2.0 * (sum / many).ln();
                // The fitted directions have a variance of 1e8 there, and no bound here.
                assert!((got - wanted).abs() < 1e-4, "{got} for {wanted}");
            }
        }
    }
}
