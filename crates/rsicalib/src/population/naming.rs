//! Which errors of the drawing devices share.

use crate::numerics::order::Ends;
use faer::Mat;

use crate::model::Spec;
use crate::numerics::distributions::f_tail;
use crate::numerics::symmetric::dot;
use crate::numerics::symmetric::invert;
use crate::population::joint::Joint;
use crate::terms::term::Term;

/// Probability of naming any error of the drawing in a fleet that has none.
const FALSE: f64 = 0.01;

/// What explains the fleet as well: χ² within this of the one that is named, as of rivals of a trace.
const AS_WELL: f64 = 6.0;

/// Parameters that a drawing may have wrong by the same amount.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Term and target: `link_length@each/3`; without a target, all channels.
    pub spec: Spec,
    /// Name of the parameter.
    pub name: String,
    /// The parameters.
    pub columns: Vec<usize>,
}

impl Candidate {
    /// Of a term at a target.
    pub(super) fn of(
        term: &dyn Term,
        target: Option<&str>,
        name: &str,
        columns: Vec<usize>,
    ) -> Self {
        let target = target.map(String::from);
        let spec = Spec { term: term.info().id.into(), target, place: None };
        Self { spec, name: name.into(), columns }
    }
}

/// An error of the drawing that the devices share.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Named {
    /// Which candidate.
    pub(super) candidate: usize,
    /// Its size in tolerances.
    pub(super) size: f64,
    /// Standard deviation of its size, in tolerances.
    pub(super) sd: f64,
    /// Probability of as much by chance, for all candidates together.
    pub(super) p_value: f64,
    /// Other candidates that explain the fleet as well.
    pub(super) also_fits: Vec<usize>,
}

/// Names errors of the drawing one after the other, the most significant first.
///
/// With the columns `A` of those named and a candidate `a`, all in tolerances,
///
/// ```text
/// G = (AᵀSA + I)⁻¹,   p = a - A G AᵀS a,   z² = (pᵀ s)² / max(pᵀ S a, Σ_d (pᵀ r_d)² D/(D-1))   (125)
/// ```
///
/// where `S = Σ Λ_d`, `s = Σ b_d` and `r_d = b_d - Λ_d γ` is what device `d` leaves: the spread of the
/// devices themselves bounds the sum, whatever the noise and `T` are taken for. `z²` is judged
/// by `F(1, D-1)`, at 1 % for all candidates together.
pub(super) fn named(joint: &Joint, candidates: &[Candidate]) -> Vec<Named> {
    let mut found: Vec<Named> = Vec::new();
    let mut chosen: Vec<usize> = Vec::new();
    let fleet = Fleet { joint, candidates };
    let dof = joint.devices_used() as f64 - 1.0;
    while chosen.len() < joint.tolerances.len() && dof >= 1.0 {
        let left = (0..candidates.len()).filter(|c| !chosen.contains(c));
        let scores: Vec<(usize, f64)> = left.map(|c| (c, fleet.score(&chosen, c))).collect();
        let best = scores.iter().filter(|s| s.1.is_finite()).greatest_by(|a| a.1);
        let Some(&(best, z2)) = best else { break };
        let p_value = (f_tail(z2, 1.0, dof) * candidates.len() as f64).min(1.0);
        if p_value > FALSE {
            break;
        }
        let as_well = |(c, own): &(usize, f64)| *c != best && z2 - own < AS_WELL;
        let also_fits = scores.iter().filter(|s| as_well(s)).map(|s| s.0).collect();
        chosen.push(best);
        found.push(Named { candidate: best, size: f64::NAN, sd: f64::NAN, p_value, also_fits });
    }
    let (sizes, covariance) = fleet.sizes(&chosen);
    for (k, one) in found.iter_mut().enumerate() {
        let wider = fleet.spread_over_expected(&chosen, one.candidate);
        (one.size, one.sd) = (sizes[k], (covariance[(k, k)] * wider).sqrt());
    }
    found
}

struct Fleet<'a> {
    joint: &'a Joint,
    candidates: &'a [Candidate],
}

impl Fleet<'_> {
    fn column(&self, candidate: usize) -> Vec<f64> {
        let mut column = vec![0.0; self.joint.tolerances.len()];
        self.candidates[candidate].columns.iter().for_each(|&k| column[k] = 1.0);
        column
    }

    /// Sizes of the chosen, and their covariance `G`.
    fn sizes(&self, chosen: &[usize]) -> (Vec<f64>, Mat<f64>) {
        let columns: Vec<Vec<f64>> = chosen.iter().map(|&c| self.column(c)).collect();
        let through: Vec<Vec<f64>> = columns.iter().map(|a| self.joint.lambda_times(a)).collect();
        let m = chosen.len();
        let normal =
            Mat::from_fn(m, m, |i, j| dot(&columns[i], &through[j]) + f64::from(u8::from(i == j)));
        let g = invert(&normal).0;
        let rhs: Vec<f64> = columns.iter().map(|a| dot(a, &self.joint.b)).collect();
        let size = |i: usize| (0..m).map(|j| g[(i, j)] * rhs[j]).sum();
        ((0..m).map(size).collect(), g)
    }

    /// The candidate without what those chosen explain of it.
    fn projected(&self, chosen: &[usize], candidate: usize) -> Vec<f64> {
        let (_, g) = self.sizes(chosen);
        let mut own = self.column(candidate);
        let columns: Vec<Vec<f64>> = chosen.iter().map(|&c| self.column(c)).collect();
        let through = self.joint.lambda_times(&own);
        let with: Vec<f64> = columns.iter().map(|a| dot(a, &through)).collect();
        for (i, column) in columns.iter().enumerate() {
            let by: f64 = (0..with.len()).map(|j| g[(i, j)] * with[j]).sum();
            own.iter_mut().zip(column).for_each(|(p, a)| *p -= by * a);
        }
        own
    }

    /// Variance of `pᵀ s` by the spread of the devices, over what `T` and the noise make of it.
    fn spread_over_expected(&self, chosen: &[usize], candidate: usize) -> f64 {
        let others: Vec<usize> = chosen.iter().copied().filter(|c| *c != candidate).collect();
        let p = self.projected(&others, candidate);
        let expected = dot(&p, &self.joint.lambda_times(&self.column(candidate)));
        let with = [&others[..], &[candidate]].concat();
        (self.spread(&p, &with) / expected).max(1.0)
    }

    /// `Σ_d (pᵀ r_d)² D/(D-1)` with what `chosen` explain taken out.
    fn spread(&self, p: &[f64], chosen: &[usize]) -> f64 {
        let (sizes, _) = self.sizes(chosen);
        let mut shift = vec![0.0; self.joint.tolerances.len()];
        for (&c, size) in chosen.iter().zip(&sizes) {
            shift.iter_mut().zip(self.column(c)).for_each(|(s, a)| *s += size * a);
        }
        let rows: Vec<f64> = self.joint.left_by(&shift).map(|r| dot(p, &r)).collect();
        let devices = rows.len() as f64;
        rows.iter().map(|r| r * r).sum::<f64>() * devices / (devices - 1.0)
    }

    fn score(&self, chosen: &[usize], candidate: usize) -> f64 {
        let p = self.projected(chosen, candidate);
        let expected = dot(&p, &self.joint.lambda_times(&self.column(candidate)));
        // What the fleet knows no better than the drawing does, it cannot correct.
        if expected < 1.0 {
            return 0.0;
        }
        let with = [chosen, &[candidate]].concat();
        dot(&p, &self.joint.b).powi(2) / expected.max(self.spread(&p, &with))
    }
}
