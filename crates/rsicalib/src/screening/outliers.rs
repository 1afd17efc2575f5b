//! Single bad samples among the repeats of a pose.
//!
//! Repeats of one pose differ by noise alone, whatever the model lacks, so a
//! sample that stands off its siblings is judged before anything else:
//!
//! ```text
//! t = (n_p - 1)/n_p |r_ps - r̄_p without s|²,    (t/K) / ((S - t)/(ν - K)) ~ F(K, ν - K)   (81)
//! ```
//!
//! with `S` the scatter within poses and `ν` its degrees of freedom, as in (61).

use crate::estimate::{Fit, Observations};
use crate::numerics::distributions;
use crate::screening::blame::Blame;
use crate::screening::excluded::{Cause, Excluded};

/// Probability of accusing any sample of a clean session.
const ALPHA: f64 = 0.0015;

/// Finds samples that stand off their pose, worst first, and leaves them out of the
/// session; each time the scatter is that of the others.
pub fn samples(observations: &mut Observations, fit: &Fit) -> Vec<Excluded> {
    let k = fit.residuals.equations as f64;
    let poses = observations.readings.rows_of_poses();
    let mut excluded = Vec::new();
    if !observations.readings.held {
        return excluded;
    }
    // A channel may be declared noisier than its repeats are, and the others are not then.
    let declared = f64::from(u8::from(observations.options.noise.is_some()));
    loop {
        let siblings = |rows: &Vec<usize>| -> Vec<usize> {
            rows.iter().copied().filter(|&r| observations.weights[r] > 0.0).collect()
        };
        let groups: Vec<Vec<usize>> = poses.iter().map(siblings).collect();
        let (mut scatter, mut dof, mut tests) = (0.0, 0.0, 0.0);
        let mut worst: Option<(usize, usize, f64)> = None;
        for (pose, rows) in groups.iter().enumerate().filter(|(_, rows)| rows.len() >= 2) {
            let share = (rows.len() - 1) as f64 / rows.len() as f64;
            dof += k * (rows.len() - 1) as f64;
            for &row in rows {
                let off: f64 = apart(fit, row, rows).iter().map(|v| v * v).sum();
                scatter += off * share * share; // of the mean of all, itself included
                if rows.len() >= 3 {
                    tests += 1.0;
                    if worst.is_none_or(|w| off * share > w.2) {
                        worst = Some((pose, row, off * share));
                    }
                }
            }
        }
        let Some((pose, row, far)) = worst else { return excluded };
        let typical = ((scatter - far) / (dof - k)).max(declared);
        if distributions::f_tail(far / k / typical, k, dof - k) * tests > ALPHA {
            return excluded;
        }
        let blame = culprit(observations, fit, row, &apart(fit, row, &groups[pose]), typical);
        observations.weights[row] = 0.0;
        let far = (far / typical).sqrt();
        excluded.push(Excluded {
            row: Some(row),
            channel: blame.channel,
            chain: blame.chain,
            ..Excluded::of(Some(pose), 1, Cause::Outlier { sigmas: far, blame })
        });
    }
}

/// Residual of a row less the mean of its siblings.
fn apart(fit: &Fit, row: usize, rows: &[usize]) -> Vec<f64> {
    let k = fit.residuals.equations;
    let at = |row: usize, e: usize| fit.residuals.whitened[row * k + e];
    let others = (rows.len() - 1) as f64;
    let mean =
        |e: usize| rows.iter().filter(|&&r| r != row).map(|&r| at(r, e)).sum::<f64>() / others;
    (0..k).map(|e| at(row, e) - mean(e)).collect()
}

/// The channel whose error would move the misclosure so, as far as it can be told.
fn culprit(observations: &Observations, fit: &Fit, row: usize, off: &[f64], typical: f64) -> Blame {
    let (k, c) = (off.len(), observations.readings.channels);
    let score = |channel: usize| {
        let a = |e: usize| fit.residuals.by_reading[(row * k + e) * c + channel];
        let along: f64 = (0..k).map(|e| a(e) * off[e]).sum();
        let length: f64 = (0..k).map(|e| a(e) * a(e)).sum();
        if length > 0.0 { along * along / length / typical } else { 0.0 }
    };
    let scores: Vec<(f64, usize)> = (0..c).map(|i| (score(i), i)).collect();
    Blame::of(&scores, &observations.mechanism)
}
