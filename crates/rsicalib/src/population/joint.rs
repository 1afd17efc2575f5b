//! The joint estimate (121) to (123) of a fleet at the variances of its levels, without devices that are
//! unlike the others.

use faer::Mat;

use crate::Error;
use crate::numerics::distributions::chi2_tail;
use crate::numerics::symmetric::dot;
use crate::numerics::symmetric::invert;
use crate::population::levels::{Held, Levels};
use crate::population::vectors::{minus, times};

/// Probability of leaving out any device of a fleet of alike ones.
const FALSE: f64 = 0.01;

/// What the fleet tells, in tolerances: parameters are divided by the `sd` of the drawing.
#[derive(Debug, Clone)]
pub(super) struct Joint {
    /// Standard deviation of the drawing of each parameter, in its unit.
    pub(super) tolerances: Vec<f64>,
    /// Common shift `γ`, in tolerances.
    pub(super) shift: Vec<f64>,
    /// Its covariance `C`.
    pub(super) covariance: Mat<f64>,
    /// `Σ Λ_d`.
    pub(super) lambda: Mat<f64>,
    /// `Σ b_d`.
    pub(super) b: Vec<f64>,
    /// Each device.
    pub(super) devices: Vec<Device>,
}

/// One device beside the others, in tolerances.
#[derive(Debug, Clone)]
pub(super) struct Device {
    /// `Λ`: what it tells of the common shift.
    lambda: Mat<f64>,
    /// `b`, in the same units.
    b: Vec<f64>,
    /// Its parameters `m_d - β₀` with what the others tell; empty where it is an outlier.
    pub(super) mean: Vec<f64>,
    /// Standard deviation of each.
    pub(super) sd: Vec<f64>,
    /// Probability of as large a `(b - Λγ)ᵀ Λ⁺ (b - Λγ)` by chance.
    p_value: f64,
    /// True for a device unlike the others: it takes no part in the sums.
    pub(super) outlier: bool,
}

/// Solves (121) to (124), and again without the devices that are unlike the others: the joint estimate,
/// and the levels of the devices that take part, both in tolerances.
///
/// `information[u]` and `told[u]` are `H` and `h` of a unit in the units of the parameters, `class[k]`
/// numbers the variance that parameter `k` has. The largest groups of the levels are the devices; without
/// levels each unit is one.
///
/// # Errors
///
/// As of [`Levels::new`]; [`Error::Option`] for levels that cross.
pub(super) fn solve(
    information: &[Mat<f64>],
    told: &[Vec<f64>],
    tolerances: &[f64],
    class: &[usize],
    levels: &[Vec<usize>],
) -> Result<(Joint, Levels), Error> {
    let n = tolerances.len();
    let scale = |h: &Mat<f64>| Mat::from_fn(n, n, |i, j| h[(i, j)] * tolerances[i] * tolerances[j]);
    let by = |h: &Vec<f64>| h.iter().zip(tolerances).map(|(h, t)| h * t).collect();
    let information: Vec<Mat<f64>> = information.iter().map(scale).collect();
    let told: Vec<Vec<f64>> = told.iter().map(by).collect();
    let all = Levels::new(&information, &told, class, levels, 1.0)?;
    if !all.nests() {
        let expected = "levels that nest, for what devices share";
        return Err(Error::option("levels", "levels that cross", expected));
    }
    let count = all.largest().iter().max().map_or(0, |d| d + 1);
    let limit = FALSE / count.max(1) as f64;
    let (mut used, mut seen) = (vec![true; count], Vec::new());
    let mut levels = all.clone();
    loop {
        let joint = Joint::of(&all, &levels, &used, tolerances);
        let next: Vec<bool> = joint.devices.iter().map(|d| d.p_value >= limit).collect();
        let left = next.iter().filter(|used| **used).count();
        if next == used || seen.contains(&next) || left < 2 {
            return Ok((joint, levels));
        }
        seen.push(std::mem::replace(&mut used, next));
        let out: Vec<bool> = used.iter().map(|used| !used).collect();
        levels = all.without(&out);
    }
}

impl Joint {
    /// Of `all` devices, at the variances and the mean of those that are `used`.
    fn of(all: &Levels, at: &Levels, used: &[bool], tolerances: &[f64]) -> Self {
        let n = tolerances.len();
        let (shift, covariance) = at.mean();
        let (mut lambda, mut b) = (Mat::<f64>::zeros(n, n), vec![0.0; n]);
        let mut devices = Vec::with_capacity(used.len());
        for (held, &used) in all.held(at).into_iter().zip(used) {
            if used {
                lambda += &held.lambda;
                b.iter_mut().zip(&held.b).for_each(|(sum, b)| *sum += b);
            }
            devices.push(Device::of(held, used, &shift, &covariance));
        }
        Self { tolerances: tolerances.to_vec(), shift, covariance, lambda, b, devices }
    }

    /// Number of devices that take part.
    pub(super) fn devices_used(&self) -> usize {
        self.devices.iter().filter(|d| !d.outlier).count()
    }

    pub(super) fn lambda_times(&self, x: &[f64]) -> Vec<f64> {
        times(&self.lambda, x)
    }

    /// `b_d - Λ_d γ` of the devices that take part.
    pub(super) fn left_by(&self, shift: &[f64]) -> impl Iterator<Item = Vec<f64>> {
        let shift = shift.to_vec();
        self.devices.iter().filter(|d| !d.outlier).map(move |d| d.left(&shift))
    }
}

impl Device {
    fn of(held: Held, used: bool, shift: &[f64], covariance: &Mat<f64>) -> Self {
        let n = shift.len();
        let Held { v, lent, lambda, b, told } = held;
        let (mut mean, mut sd) = (Vec::new(), Vec::new());
        if used {
            let (own, others) = (times(&v, &told), times(&lent, shift));
            mean = own.iter().zip(others).map(|(own, others)| own + others).collect();
            let shared = &lent * covariance * lent.transpose();
            sd = (0..n).map(|k| (v[(k, k)] + shared[(k, k)]).max(0.0).sqrt()).collect();
        }
        let mut found = Self { lambda, b, mean, sd, p_value: 1.0, outlier: !used };
        found.p_value = found.as_far(shift);
        found
    }

    /// Probability of being as far from the mean of the others.
    fn as_far(&self, shift: &[f64]) -> f64 {
        let (n, left) = (shift.len(), self.left(shift));
        let (inverse, _, _) = invert(&self.lambda);
        let product = |ij: usize| inverse[(ij / n, ij % n)] * self.lambda[(ij % n, ij / n)];
        let rank: f64 = (0..n * n).map(product).sum();
        chi2_tail(dot(&left, &times(&inverse, &left)), rank.round())
    }

    fn left(&self, shift: &[f64]) -> Vec<f64> {
        minus(&self.b, &times(&self.lambda, shift))
    }
}
