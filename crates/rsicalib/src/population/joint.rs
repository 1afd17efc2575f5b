//! The joint estimate (121) to (124) of a fleet.

use faer::Mat;

use crate::numerics::distributions::chi2_tail;
use crate::numerics::symmetric::invert;
use crate::population::vectors::{dot, minus, times};

/// Probability of leaving out any device of a fleet of alike ones.
const FALSE: f64 = 0.01;

/// Rounds of (124), and of leaving devices out.
const ROUNDS: usize = 500;

/// Variances between devices change by less than this, in parts, where (124) has converged.
const CONVERGED: f64 = 1e-4;

/// Least variance that is expected of devices, in tolerances squared: a hundredth of the tolerance.
pub(super) const LEAST: f64 = 1e-4;

/// What the fleet tells, in tolerances: parameters are divided by the `sd` of the drawing.
#[derive(Debug, Clone)]
pub struct Joint {
    /// Standard deviation of the drawing of each parameter, in its unit.
    pub tolerances: Vec<f64>,
    /// Standard deviation between devices, one for each class, in its unit divided by the tolerance.
    pub between: Vec<f64>,
    /// Number of deviations that determined each of `between`.
    pub known: Vec<f64>,
    /// Common shift `γ`, in tolerances.
    pub shift: Vec<f64>,
    /// Its covariance `C`.
    pub covariance: Mat<f64>,
    /// `Σ Λ_d`.
    pub lambda: Mat<f64>,
    /// `Σ b_d`.
    pub b: Vec<f64>,
    /// Each device.
    pub devices: Vec<Device>,
}

/// One device beside the others, in tolerances.
#[derive(Debug, Clone)]
pub struct Device {
    /// `Λ`: what it tells of the common shift.
    lambda: Mat<f64>,
    /// `b`, in the same units.
    b: Vec<f64>,
    /// Its parameters `m_d - β₀` with what the others tell; empty where it is an outlier.
    pub mean: Vec<f64>,
    /// Standard deviation of each.
    pub sd: Vec<f64>,
    /// `(b - Λγ)ᵀ Λ⁺ (b - Λγ)`.
    pub distance: f64,
    /// Probability of as much by chance.
    pub p_value: f64,
    /// True for a device unlike the others: it takes no part in the sums.
    pub outlier: bool,
}

impl Joint {
    /// Number of devices that take part.
    #[must_use]
    pub fn devices_used(&self) -> usize {
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
    fn left(&self, shift: &[f64]) -> Vec<f64> {
        self.b.iter().zip(times(&self.lambda, shift)).map(|(b, l)| b - l).collect()
    }
}

/// Solves (121) to (123), with the variances between devices by restricted maximum likelihood, and
/// again without the devices that are unlike the others.
///
/// `information[d]` and `told[d]` are `H` and `h` of a device in the units of the parameters,
/// `class[k]` numbers the variance that parameter `k` has. At the maximum, with `û` and `Var u` the
/// deviation `V(h - Hγ)` of a device and its variance `V + VHCHV`,
///
/// ```text
/// τ² = Σ û² / Σ (1 - Var u / τ²)                                                  (124)
/// ```
///
/// over the parameters of a class and all devices, which is iterated (MacKay 1992).
#[must_use]
pub fn solve(
    information: &[Mat<f64>],
    told: &[Vec<f64>],
    tolerances: &[f64],
    class: &[usize],
) -> Joint {
    let n = tolerances.len();
    let scale = |h: &Mat<f64>| Mat::from_fn(n, n, |i, j| h[(i, j)] * tolerances[i] * tolerances[j]);
    let by = |h: &Vec<f64>| h.iter().zip(tolerances).map(|(h, t)| h * t).collect();
    let information: Vec<Mat<f64>> = information.iter().map(scale).collect();
    let told: Vec<Vec<f64>> = told.iter().map(by).collect();
    let same =
        |_: &[bool]| Told { information: information.clone(), told: told.clone(), variance: None };
    solve_told(told.len(), tolerances, class, same)
}

/// What devices tell, in tolerances.
pub(super) struct Told {
    pub(super) information: Vec<Mat<f64>>,
    pub(super) told: Vec<Vec<f64>>,
    /// Variance between devices of each class, where it is known; it is estimated where not.
    pub(super) variance: Option<Vec<f64>>,
}

/// As [`solve`], of `count` devices that tell `told` where those take part that it is called with.
pub(super) fn solve_told(
    count: usize,
    tolerances: &[f64],
    class: &[usize],
    mut told: impl FnMut(&[bool]) -> Told,
) -> Joint {
    let mut used = vec![true; count];
    let mut seen = Vec::new();
    loop {
        let joint = Fleet { own: told(&used), tolerances, class }.joint(&used);
        let limit = FALSE / count.max(1) as f64;
        let next: Vec<bool> = joint.devices.iter().map(|d| d.p_value >= limit).collect();
        let left = next.iter().filter(|used| **used).count();
        if next == used || seen.contains(&next) || left < 2 {
            return joint;
        }
        seen.push(std::mem::replace(&mut used, next));
    }
}

struct Fleet<'a> {
    own: Told,
    tolerances: &'a [f64],
    class: &'a [usize],
}

/// `γ` and `C` with the sums that they are from.
struct Sums {
    lambda: Mat<f64>,
    b: Vec<f64>,
    shift: Vec<f64>,
    covariance: Mat<f64>,
}

/// `V`, `Λ` and `b` of a device.
struct Held {
    v: Mat<f64>,
    lambda: Mat<f64>,
    b: Vec<f64>,
}

impl Fleet<'_> {
    fn held(&self, d: usize, variance: &[f64]) -> Held {
        let (h, n) = (&self.own.information[d], self.class.len());
        let root: Vec<f64> = self.class.iter().map(|&c| variance[c].sqrt()).collect();
        let inner =
            Mat::from_fn(n, n, |i, j| root[i] * h[(i, j)] * root[j] + f64::from(u8::from(i == j)));
        let inner = invert(&inner).0;
        let v = Mat::from_fn(n, n, |i, j| root[i] * inner[(i, j)] * root[j]);
        let hv = h * &v;
        let lambda = h - &hv * h;
        let b = self.own.told[d]
            .iter()
            .zip(times(&hv, &self.own.told[d]))
            .map(|(h, l)| h - l)
            .collect();
        Held { v, lambda, b }
    }

    fn sums(&self, all: &[Held], used: &[bool]) -> Sums {
        let n = self.class.len();
        let (mut lambda, mut b) = (Mat::<f64>::zeros(n, n), vec![0.0; n]);
        for (one, _) in all.iter().zip(used).filter(|(_, used)| **used) {
            lambda += &one.lambda;
            b.iter_mut().zip(&one.b).for_each(|(sum, b)| *sum += b);
        }
        let covariance = invert(&(&lambda + Mat::<f64>::identity(n, n))).0;
        let shift = times(&covariance, &b);
        Sums { lambda, b, shift, covariance }
    }

    fn joint(&self, used: &[bool]) -> Joint {
        let classes = self.class.iter().max().map_or(0, |c| c + 1);
        let given = self.own.variance.as_ref();
        let start = |given: &Vec<f64>| given.iter().map(|v| v.clamp(LEAST, 1e6)).collect();
        let mut variance = given.map_or_else(|| vec![1.0; classes], start);
        let mut known = vec![0.0; classes];
        for _ in 0..ROUNDS {
            let all: Vec<Held> = (0..used.len()).map(|d| self.held(d, &variance)).collect();
            let sums = self.sums(&all, used);
            let (squares, determined) = self.deviations(&all, &sums, used, &variance);
            let mut moved: f64 = 0.0;
            let estimated = variance.iter_mut().enumerate().filter(|_| given.is_none());
            for (c, old) in estimated {
                let next = (squares[c] / determined[c].max(f64::MIN_POSITIVE)).clamp(LEAST, 1e6);
                moved = moved.max((next / *old).ln().abs());
                *old = next;
            }
            known = determined;
            if moved < CONVERGED {
                break;
            }
        }
        let all: Vec<Held> = (0..used.len()).map(|d| self.held(d, &variance)).collect();
        let Sums { lambda, b, shift, covariance } = self.sums(&all, used);
        let device = |(d, held): (usize, Held)| {
            self.device(d, held, used[d], &variance, &shift, &covariance)
        };
        let devices = all.into_iter().enumerate().map(device).collect();
        let between = variance.iter().map(|v| v.sqrt()).collect();
        let tolerances = self.tolerances.to_vec();
        Joint { tolerances, between, known, shift, covariance, lambda, b, devices }
    }

    /// `Σ û²` and `Σ (1 - Var u / τ²)` of each class.
    fn deviations(
        &self,
        all: &[Held],
        sums: &Sums,
        used: &[bool],
        variance: &[f64],
    ) -> (Vec<f64>, Vec<f64>) {
        let (mut squares, mut known) = (vec![0.0; variance.len()], vec![0.0; variance.len()]);
        for (d, held) in all.iter().enumerate().filter(|(d, _)| used[*d]) {
            let u = times(
                &held.v,
                &minus(&self.own.told[d], &times(&self.own.information[d], &sums.shift)),
            );
            let k = &held.v * &self.own.information[d];
            let through = &k * &sums.covariance;
            for (i, &c) in self.class.iter().enumerate() {
                let shared: f64 = (0..u.len()).map(|j| through[(i, j)] * k[(i, j)]).sum();
                squares[c] += u[i] * u[i];
                known[c] += 1.0 - (held.v[(i, i)] + shared) / variance[c];
            }
        }
        (squares, known)
    }

    fn device(
        &self,
        d: usize,
        held: Held,
        used: bool,
        variance: &[f64],
        shift: &[f64],
        covariance: &Mat<f64>,
    ) -> Device {
        let n = self.class.len();
        let Held { v, lambda, b } = held;
        let left = minus(&b, &times(&lambda, shift));
        let (inverse, _, _) = invert(&lambda);
        let rank: f64 =
            (0..n).map(|i| (0..n).map(|j| inverse[(i, j)] * lambda[(j, i)]).sum::<f64>()).sum();
        let distance = dot(&left, &times(&inverse, &left));
        let p_value = chi2_tail(distance, rank.round());
        let (mut mean, mut sd) = (Vec::new(), Vec::new());
        if used {
            let from = |k: usize| variance[self.class[k]].recip();
            let told: Vec<f64> = (0..n).map(|k| self.own.told[d][k] + from(k) * shift[k]).collect();
            mean = times(&v, &told);
            let lent = Mat::from_fn(n, n, |i, j| v[(i, j)] * from(j));
            let shared = &lent * covariance * lent.transpose();
            sd = (0..n).map(|k| (v[(k, k)] + shared[(k, k)]).max(0.0).sqrt()).collect();
        }
        Device { lambda, b, mean, sd, distance, p_value, outlier: !used }
    }
}
