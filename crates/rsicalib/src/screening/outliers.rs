//! Single bad samples among the repeats of a pose, and poses that moved meanwhile.
//!
//! Repeats of one pose differ by noise alone, whatever the model lacks, so a
//! sample that stands off its siblings is judged before anything else:
//!
//! ```text
//! t = (n_p - 1)/n_p |r_ps - r̄_p without s|²,    (t/K) / ((S - t)/(ν - K)) ~ F(K, ν - K)   (81)
//! ```
//!
//! with `S` the scatter within poses and `ν` its degrees of freedom, as in (61). Where several
//! samples of a pose are off alike none stands off the others, but the pose does: it moved while
//! it was sampled. With `S_p` its own scatter, of `ν_p`,
//!
//! ```text
//! (S_p/ν_p) / ((S - S_p)/(ν - ν_p)) ~ F(ν_p, ν - ν_p)                                     (84)
//! ```
//!
//! and fewer degrees of freedom where samples resemble their neighbours in the other poses.

use crate::estimate::noise::rounding::{is_quiet, of_steadied, steadied_alike};
use crate::estimate::noise::scatter::{Groups, Scatter};
use crate::estimate::noise::seating::contrasts;
use crate::estimate::noise::source::LEAST_DOF;
use crate::estimate::{Fit, Observations};
use crate::numerics::distributions;
use crate::numerics::order::Ends;
use crate::screening::blame::Blame;
use crate::screening::excluded::{Cause, Excluded};

/// Probability of accusing any sample of a clean session.
const ALPHA: f64 = 0.0015;

/// The same of any pose that moved.
const MOVED: f64 = 0.0005;

/// A pose that moved scatters by so many times the variance of the others: noise may differ
/// between poses, and not by so much.
const TIMES: f64 = 4.0;

/// Finds samples that stand off their pose, and poses that moved, worst first, and leaves them
/// out of the session; each time the scatter is that of the others.
pub fn samples(observations: &mut Observations, fit: &Fit) -> Vec<Excluded> {
    let mut excluded = Vec::new();
    if !observations.readings.held || fit.noise.still {
        return excluded;
    }
    let poses = observations.readings.rows_of_poses();
    // That some samples of a pose read the next code is no fault of theirs.
    let groups = Groups { rows: poses.clone(), order: 1 };
    let lasts: Vec<bool> = (0..observations.readings.channels)
        .map(|c| fit.noise.lasting[c] || is_quiet(&groups, observations, c))
        .collect();
    let sigma = &fit.noise.weighed;
    let residuals = steadied_alike(observations, &poses, &fit.residuals, sigma, |c| lasts[c]);
    // All samples of a pose have one play: they differ by their readings.
    let residuals = match fit.noise.measured.iter().any(|factor| *factor > 0.0) {
        true => residuals,
        false => contrasts(&groups, &residuals, (sigma, &[])).into_owned(),
    };
    let fit = &Fit { residuals: residuals.into(), ..fit.clone() };
    let told = |row: usize| fit.residuals.directions_of(row) as f64;
    // A channel may be declared noisier than its repeats are, and the others are not then; where all of
    // them stay on their codes, nothing else shows the noise of rounding.
    let known = observations.options.noise.is_some() || lasts.contains(&true);
    let declared = match lasts.iter().all(|lasts| *lasts) {
        true => of_steadied(observations, sigma),
        false => f64::from(u8::from(known)),
    };
    let siblings = |rows: &Vec<usize>, weights: &[f64]| -> Vec<usize> {
        rows.iter().copied().filter(|&r| weights[r] > 0.0).collect()
    };
    let in_use = |weights: &[f64]| -> Vec<Vec<usize>> {
        poses.iter().map(|rows| siblings(rows, weights)).collect()
    };
    let whole = in_use(&observations.weights);
    loop {
        let groups = in_use(&observations.weights);
        let (mut scatter, mut dof, mut tests) = (0.0, 0.0, 0.0);
        let mut worst: Option<(usize, usize, f64)> = None;
        for (pose, rows) in groups.iter().enumerate().filter(|(_, rows)| rows.len() >= 2) {
            let share = (rows.len() - 1) as f64 / rows.len() as f64;
            dof += told(rows[0]) * (rows.len() - 1) as f64;
            let mean = mean_of(fit, rows);
            for &row in rows {
                // Of the mean of all, itself included: (n_p - 1)/n_p times that of the others.
                let off: f64 =
                    of_row(fit, row).iter().zip(&mean).map(|(r, m)| (r - m).powi(2)).sum();
                scatter += off;
                if rows.len() >= 3 {
                    tests += 1.0;
                    if worst.is_none_or(|w| off / share > w.2) {
                        worst = Some((pose, row, off / share));
                    }
                }
            }
        }
        let stands_off = worst.filter(|(_, row, far)| {
            let k = told(*row);
            let typical = ((scatter - far) / (dof - k)).max(declared);
            distributions::f_tail(far / k / typical, k, dof - k) * tests <= ALPHA
        });
        let Some((pose, row, far)) = stands_off else {
            let Some((pose, times)) = moved(observations, fit, &groups, declared) else {
                return excluded;
            };
            groups[pose].iter().for_each(|&row| observations.weights[row] = 0.0);
            let cause = Cause::Unsteady { times };
            excluded.push(Excluded::of(Some(pose), groups[pose].len(), cause));
            continue;
        };
        let typical = ((scatter - far) / (dof - told(row))).max(declared);
        if 2 * (groups[pose].len() - 1) <= whole[pose].len() {
            // No half of a pose says that the other one is wrong.
            let rows = &whole[pose];
            rows.iter().for_each(|&row| observations.weights[row] = 0.0);
            excluded.retain(|found| found.pose != Some(pose));
            let own = Groups { rows: vec![rows.clone()], order: 1 }.scatter(&fit.residuals, 0.0);
            let times = (own.within / own.dof / typical).sqrt();
            excluded.push(Excluded::of(Some(pose), rows.len(), Cause::Unsteady { times }));
            continue;
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

/// The pose whose samples differ most, if by more than chance makes of those of the others by
/// (84), and how many times more.
fn moved(
    observations: &Observations,
    fit: &Fit,
    groups: &[Vec<usize>],
    declared: f64,
) -> Option<(usize, f64)> {
    let of = |rows: Vec<Vec<usize>>| Groups { rows, order: 1 }.scatter(&fit.residuals, 0.0);
    let own: Vec<Scatter> = groups.iter().map(|rows| of(vec![rows.clone()])).collect();
    let (all, dof) = own.iter().fold((0.0, 0.0), |sum, s| (sum.0 + s.within, sum.1 + s.dof));
    let several = || (0..own.len()).filter(|&pose| own[pose].dof > 0.0);
    let mean = |pose: usize| own[pose].within / own[pose].dof;
    let pose = several().greatest_by(|&a| mean(a))?;
    let Scatter { within, dof: free, .. } = own[pose];
    let typical = ((all - within) / (dof - free)).max(declared);
    let times = mean(pose) / typical;
    // What a pose that moved makes of neighbours is no correlation of the noise.
    let rest = of(groups.iter().filter(|rows| **rows != groups[pose]).cloned().collect());
    let independent = (rest.effective / rest.dof).min(1.0);
    let (free, others) = (free * independent, rest.dof * independent);
    if times < TIMES || others < LEAST_DOF {
        return None;
    }
    let p_value = distributions::f_tail(times, free, others) * several().count() as f64;
    (p_value <= MOVED && observations.readings.held).then(|| (pose, times.sqrt()))
}

/// Whitened residuals of a row.
fn of_row(fit: &Fit, row: usize) -> &[f64] {
    let k = fit.residuals.equations;
    &fit.residuals.whitened[row * k..(row + 1) * k]
}

/// Mean residual of rows.
fn mean_of(fit: &Fit, rows: &[usize]) -> Vec<f64> {
    let mut mean = vec![0.0; fit.residuals.equations];
    for &row in rows {
        mean.iter_mut().zip(of_row(fit, row)).for_each(|(sum, r)| *sum += r);
    }
    mean.iter_mut().for_each(|sum| *sum /= rows.len() as f64);
    mean
}

/// Residual of a row less the mean of its siblings.
fn apart(fit: &Fit, row: usize, rows: &[usize]) -> Vec<f64> {
    let others: Vec<usize> = rows.iter().copied().filter(|&r| r != row).collect();
    of_row(fit, row).iter().zip(mean_of(fit, &others)).map(|(r, m)| r - m).collect()
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
