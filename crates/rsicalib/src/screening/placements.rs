//! Damage of readings that touch unknown points: a placement that does not fit its
//! siblings, a tool or a point that moved half-way, a single bad sample.
//!
//! Each is scored against a fit of all others, worst first; what is found is left out,
//! and the rest fitted again. With `H = X (XᵀX)⁻¹ Xᵀ` of what is fitted, a sample `r`
//! of `K` equations, and the columns `Z` of a point, or of the tool, from one row on,
//!
//! ```text
//! single    rᵀ (I - H)⁻¹ r                        ~ s² χ²(K)                        (82)
//! moved     uᵀ M⁻¹ u  as (71, 72)                 ~ s² χ²(rank M)                   (83)
//! ```
//!
//! Samples of a held pose read one seating: their mean is the sample then.
//!
//! `s²` is from the median over all samples, and over all runs, which damage hardly
//! moves: what a model lacks makes neighbouring rows alike in every run. A run that scatters more than
//! that by itself, as where an arm differs from placement to placement, has an `s²` of its own. None is less than
//! the noise by which the fit itself is judged, where there is one: what is within it is not wrong.

use crate::Error;
use crate::estimate::at_fit::AtFit;
use crate::estimate::on_closures::means;
use crate::estimate::{Fit, FitOptions, Noise, Observations};
use crate::mechanism::Target;
use crate::numerics::median::median;
use crate::numerics::order::Ends;
use crate::numerics::{distributions, symmetric};
use crate::screening::excluded::{Cause, Excluded};
use crate::screening::steps::{SIDE, StepScore, StepSums};
use crate::terms::term::{Acts, Placed, Spot};

/// Probability of accusing anything in a clean session.
const ALPHA: f64 = 0.002;

/// A placement whose typical residual is this many times the usual one does not fit.
const STRANGE: f64 = 3.0;

/// Placements, or runs, that it takes to say what is usual.
const SIBLINGS: usize = 4;

/// A move scores as much as this many single samples of the same run, or they are it.
const SINGLES_PER_MOVE: f64 = 3.0;

/// What is left on both sides of a move is at most this many times what is usual.
const HEALED: f64 = 2.0;

/// Of all samples no more than this share is taken for damage.
const MOST_DAMAGED: f64 = 0.2;

/// What is wrong, with the rows that it takes out.
pub struct Damage {
    /// What it is.
    pub found: Excluded,
    /// Its rows that counted.
    pub rows: Vec<usize>,
}

/// Finds damage, worst first, and leaves it out of the session.
///
/// # Errors
///
/// As [`crate::estimate::fit`].
pub fn find(observations: &mut Observations, fit: &Fit) -> Result<Vec<Damage>, Error> {
    if fit.model.placements(&observations.readings).is_none() {
        return Ok(Vec::new());
    }
    let declared = f64::from(u8::from(fit.noise.judges()));
    let readings = observations.readings.clone();
    if !readings.held || readings.samples == readings.poses() {
        return found_in(observations, fit, declared);
    }
    // All samples of a pose read one seating: a pose is one sample then, however many it has.
    let poses = readings.rows_of_poses();
    let mut seatings = of_seatings(observations, fit)?;
    let there = crate::estimate::fit(&seatings, fit.model.instances.clone(), Some(fit))?;
    let mut excluded = Vec::new();
    for Damage { found, rows: seats } in found_in(&mut seatings, &there, declared)? {
        let rows = seats.iter().flat_map(|&pose| poses[pose].iter().copied());
        let rows: Vec<usize> = rows.filter(|&row| observations.weights[row] > 0.0).collect();
        rows.iter().for_each(|&row| observations.weights[row] = 0.0);
        let placement = found.placement.and_then(|pose| poses[pose].first().copied());
        let found = Excluded { placement, row: None, samples: rows.len(), ..found };
        excluded.push(Damage { found, rows });
    }
    Ok(excluded)
}

/// The session with the mean of its samples in place of each pose.
fn of_seatings(observations: &Observations, fit: &Fit) -> Result<Observations, Error> {
    let mut seatings = observations.clone();
    let (readings, counts) = means(observations, fit)?;
    seatings.readings = readings.into();
    let usual = counts.iter().copied().fold(1.0, f64::max);
    seatings.weights = counts.into_iter().map(|n| (n / usual).sqrt()).collect();
    let Noise { sigma, play, seating, measured } =
        fit.noise.of_means(fit.noise.inflation / usual, true);
    let options = observations.options.clone();
    let (noise, measured) = (Some(sigma), Some(measured));
    seatings.options = FitOptions { noise, play, seating, measured, ..options };
    seatings.judged = true;
    Ok(seatings)
}

/// Damage, worst first; `declared` is the least `s²`.
fn found_in(
    observations: &mut Observations,
    fit: &Fit,
    declared: f64,
) -> Result<Vec<Damage>, Error> {
    let placements = fit.model.placements(&observations.readings).unwrap_or_default();
    let mut current = fit.clone();
    let mut excluded: Vec<Damage> = Vec::new();
    let all = observations.weights.iter().filter(|w| **w > 0.0).count() as f64;
    let mut left_out = 0;
    while let Some(damage) = Looking::at(observations, &current, &placements, declared).worst() {
        left_out += damage.rows.len();
        if left_out as f64 > MOST_DAMAGED * all && damage.found.placement.is_none() {
            break;
        }
        damage.rows.iter().for_each(|&r| observations.weights[r] = 0.0);
        excluded.push(damage);
        fold(&mut excluded, &placements);
        current =
            crate::estimate::fit(observations, current.model.instances.clone(), Some(&current))?;
    }
    Ok(excluded)
}

/// Where a placement is left out whole last, what was left out of it before is part of it.
fn fold(excluded: &mut Vec<Damage>, placements: &[usize]) {
    let Some(Damage { found, mut rows }) = excluded.pop() else { return };
    if let Some(row) = found.placement {
        let here = |it: &Damage| it.rows.iter().all(|&r| placements[r] == placements[row]);
        let (own, others) = std::mem::take(excluded).into_iter().partition(here);
        *excluded = others;
        rows.extend(own.into_iter().flat_map(|it: Damage| it.rows));
    }
    excluded.push(Damage { found: Excluded { samples: rows.len(), ..found }, rows });
}

/// A fit, as far as damage shows in it.
struct Looking<'a> {
    at: AtFit<'a>,
    placements: &'a [usize],
    /// The rows in use that touch the same points, in their order.
    runs: Vec<Vec<usize>>,
    /// (82) of every row; zero of those not in use.
    single: Vec<f64>,
    /// The least `s²`.
    declared: f64,
    /// `s²` of all samples.
    typical: f64,
    /// `s²` of every row: that of its run, where that is more.
    usual: Vec<f64>,
}

/// A move that was found: of which run, from which of its rows on.
struct Displacement {
    run: usize,
    at: usize,
    score: f64,
    /// How far, in length units.
    by: f64,
    /// True for the tool.
    tool: bool,
}

impl<'a> Looking<'a> {
    fn at(
        observations: &'a Observations,
        fit: &'a Fit,
        placements: &'a [usize],
        declared: f64,
    ) -> Self {
        let readings = &observations.readings;
        let mut runs = vec![Vec::new(); readings.groups.len()];
        for block in readings.blocks() {
            let live = block.rows[..block.live].iter().filter(|&&r| observations.weights[r] > 0.0);
            runs[block.group].extend(live);
        }
        runs.iter_mut().for_each(|rows| rows.sort_unstable());
        runs.retain(|rows| !rows.is_empty());
        let mut looking = Self {
            at: AtFit::new(observations, fit),
            placements,
            single: vec![0.0; readings.samples],
            runs,
            declared,
            typical: 0.0,
            usual: vec![0.0; readings.samples],
        };
        for row in looking.runs.concat() {
            looking.single[row] = looking.single_sample(row);
        }
        let scale = |row: usize| {
            let told = looking.at.residuals.directions_of(row).max(1);
            looking.single[row] / distributions::chi2_quantile(0.5, told as f64)
        };
        // A sample alone at its point tells nothing of the scatter.
        let of = |rows: &[usize]| {
            median(rows.iter().copied().map(scale).filter(|scale| *scale > 0.0).collect())
        };
        let typical = of(&looking.runs.concat()).max(declared).max(f64::MIN_POSITIVE);
        // A median of few rows is one of them, which may be the one that is wrong.
        let own = |rows: &Vec<usize>| match rows.len() >= 2 * SIDE {
            true => of(rows).max(typical),
            false => typical,
        };
        let own: Vec<f64> = looking.runs.iter().map(own).collect();
        for (rows, own) in looking.runs.iter().zip(own) {
            rows.iter().for_each(|&row| looking.usual[row] = own);
        }
        looking.typical = typical;
        looking
    }

    /// The worst damage above chance, and the rows that it takes out.
    fn worst(&self) -> Option<Damage> {
        let (moved, single) = (self.moved(), self.worst_single());
        if let Some(placement) = self.strange() {
            // Half of a run that moved looks strange, too, but heals where it is parted.
            let here = |m: &Displacement| self.placements[self.runs[m.run][0]] == placement.0;
            if !moved.as_ref().is_some_and(here) {
                // So does a placement with a sample that stands off its own siblings.
                let own = single.filter(|(row, _)| self.placements[*row] == placement.0);
                return Some(match own {
                    Some((row, _)) if self.stands_off(row) => self.one_row(row),
                    _ => self.whole_placement(placement),
                });
            }
        }
        match (single, moved) {
            // A move shows in many samples, each of which stands off a little.
            (Some((row, score)), Some(m)) if SINGLES_PER_MOVE * score > m.score => {
                Some(self.one_row(row))
            }
            (_, Some(m)) => Some(self.all_from_there_on(&m)),
            (Some((row, _)), None) => Some(self.one_row(row)),
            (None, None) => None,
        }
    }

    fn whitened(&self, row: usize) -> &[f64] {
        &self.at.residuals.whitened[self.at.equations(row)]
    }

    /// Eq. (82).
    fn single_sample(&self, row: usize) -> f64 {
        let scored = symmetric::left_out(&self.at.hat(row), self.whitened(row));
        scored.map_or(0.0, |(score, _)| score)
    }

    /// The row that stands off most, if above chance, and (82) in units of what is usual there.
    fn worst_single(&self) -> Option<(usize, f64)> {
        let rows = self.runs.concat();
        let score = |row: usize| self.single[row] / self.usual[row];
        let row = *rows.iter().greatest_by(|a| score(**a))?;
        let k = self.at.residuals.directions_of(row).max(1) as f64;
        // The scale is an estimate from as many samples: F, not χ².
        let dof = (k * rows.len() as f64 - self.at.fit.model.term_parameters as f64).max(k);
        let p = distributions::f_tail(score(row) / k, k, dof) * rows.len() as f64;
        (p <= 0.5 * ALPHA).then_some((row, score(row)))
    }

    /// True where a sample stands off the others of its placement as a placement must stand off
    /// its siblings.
    fn stands_off(&self, row: usize) -> bool {
        let own = |r: &usize| *r != row && self.placements[*r] == self.placements[row];
        let rows: Vec<usize> = self.runs.concat().into_iter().filter(own).collect();
        let usual = median(rows.iter().map(|&r| self.single[r]).collect());
        rows.len() >= 2 * SIDE && self.single[row] > STRANGE * STRANGE * usual
    }

    /// The placement whose samples typically stand off most, and how many times more.
    fn strange(&self) -> Option<(usize, f64)> {
        let mut sizes: Vec<(usize, Vec<f64>)> = Vec::new();
        for row in self.runs.concat() {
            let placement = self.placements[row];
            match sizes.iter_mut().find(|s| s.0 == placement) {
                Some(own) => own.1.push(self.single[row]),
                None => sizes.push((placement, vec![self.single[row]])),
            }
        }
        let sizes: Vec<(usize, f64)> =
            sizes.into_iter().map(|(p, all)| (p, median(all).sqrt())).collect();
        let told = self.at.residuals.equations as f64;
        let declared = (self.declared * distributions::chi2_quantile(0.5, told)).sqrt();
        let usual = median(sizes.iter().map(|s| s.1).collect()).max(declared);
        let worst = *sizes.iter().greatest_by(|a| a.1)?;
        (sizes.len() >= SIBLINGS && worst.1 > STRANGE * usual).then_some((worst.0, worst.1 / usual))
    }

    /// The best move of all runs, if it is above chance and heals its run.
    fn moved(&self) -> Option<Displacement> {
        let best: Vec<Displacement> =
            (0..self.runs.len()).filter_map(|run| self.moved_in(run)).collect();
        if best.len() < SIBLINGS {
            return None;
        }
        let times: f64 =
            self.runs.iter().map(|r| (r.len() + 1).saturating_sub(2 * SIDE) as f64).sum();
        // The largest of a run's scores is about this by chance.
        let each = times / best.len() as f64;
        let expected = distributions::chi2_quantile(0.5 / (1.0 + 0.5 * each), 3.0);
        let scale = (median(best.iter().map(|m| m.score).collect()) / expected).max(1.0);
        let whole = |rows: &Vec<usize>| self.spread([rows, &[]]);
        let usual = median(self.runs.iter().map(whole).collect()).max(f64::MIN_POSITIVE);
        let beside_its_run = |m: Displacement| {
            let left = self.spread(self.runs[m.run].split_at(m.at).into()) / usual;
            (left <= HEALED * HEALED).then(|| Displacement { score: m.score / left.max(1.0), ..m })
        };
        let healed = best.into_iter().filter_map(beside_its_run);
        let worst = healed.greatest_by(|a| a.score)?;
        let p = distributions::chi2_tail(worst.score / scale, 3.0) * 2.0 * times;
        (p <= 0.5 * ALPHA).then_some(worst)
    }

    /// Eq. (83): the best move of a run, of its point or of the tool, beside what is off in the whole run: arms
    /// differ from placement to placement.
    fn moved_in(&self, run: usize) -> Option<Displacement> {
        let rows = &self.runs[run];
        let mut best: Option<Displacement> = None;
        for (tool, columns) in self.movable(rows[0]) {
            // Scores of the first rows, of ever more of them, or of the last. Rows that do not tell all three
            // may be any move.
            let scores = |rows: &mut dyn Iterator<Item = &usize>| -> Vec<Option<StepScore>> {
                let mut sums = StepSums::new(self.at.rank(), columns.len());
                let mut with = |row: &usize| {
                    for e in self.at.equations(*row) {
                        let (x, r) = (self.at.by_parameter(e), self.at.residuals.whitened[e]);
                        sums.add(self.at.q(e), &columns.map(|c| x[c]), r);
                    }
                    sums.score(&self.at.pull).filter(|s| s.rank == columns.len())
                };
                rows.map(&mut with).collect()
            };
            let (first, last) = (scores(&mut rows.iter()), scores(&mut rows.iter().rev()));
            let score = |of: &Option<StepScore>| of.as_ref().map_or(0.0, |s| s.score);
            let whole = last.last().map_or(0.0, score);
            for at in SIDE..(rows.len() + 1).saturating_sub(SIDE) {
                let (before, after) = (&first[at - 1], &last[rows.len() - at - 1]);
                let Some(found) = after else { continue };
                let score = (found.score + score(before) - whole) / self.typical;
                if best.as_ref().is_none_or(|b| score > b.score) {
                    best = Some(Displacement { run, at, score, by: found.by, tool });
                }
            }
        }
        best
    }

    /// What may move half-way, with the columns that do it: the point, and the tool
    /// where its place is a term of the model.
    fn movable(&self, row: usize) -> Vec<(bool, [usize; 3])> {
        let group = self.at.observations.readings.blocks().iter().find(|b| b.rows.contains(&row));
        let own = group.map_or_else(Vec::new, |b| self.at.fit.model.free_points(b.group));
        let points = own.into_iter().map(|first| (false, [first, first + 1, first + 2]));
        let tip = |acts: Acts| match acts {
            Acts::Geometry(freedoms) => {
                freedoms.iter().all(|f| f.0 == Spot::Tip) && freedoms.len() == 3
            }
            _ => false,
        };
        let tools = self
            .at
            .fit
            .model
            .instances
            .iter()
            .zip(&self.at.fit.model.first)
            .filter(|(i, _)| i.term.placed() == Placed::Once)
            .filter(|(i, _)| matches!(i.target, Target::Chain(_)) && tip(i.term.acts()));
        points.chain(tools.map(|(_, f)| (true, [*f, f + 1, f + 2]))).collect()
    }

    /// What rows scatter, squared, each side of a move about its own mean: the median.
    fn spread(&self, sides: [&[usize]; 2]) -> f64 {
        let k = self.at.residuals.equations;
        let about_its_mean = |rows: &[usize]| -> Vec<f64> {
            let mean = |e: usize| {
                rows.iter().map(|&r| self.whitened(r)[e]).sum::<f64>() / rows.len() as f64
            };
            let means: Vec<f64> = (0..k).map(mean).collect();
            let off = |r: &usize| {
                self.whitened(*r).iter().zip(&means).map(|(r, m)| (r - m).powi(2)).sum()
            };
            rows.iter().map(off).collect()
        };
        median(sides.into_iter().flat_map(about_its_mean).collect())
    }

    fn whole_placement(&self, (placement, times): (usize, f64)) -> Damage {
        let rows: Vec<usize> = (0..self.placements.len())
            .filter(|&r| self.placements[r] == placement && self.at.observations.weights[r] > 0.0)
            .collect();
        let cause = Cause::Placement { times };
        let placement = rows.first().copied();
        Damage { found: Excluded { placement, ..Excluded::of(None, rows.len(), cause) }, rows }
    }

    fn all_from_there_on(&self, m: &Displacement) -> Damage {
        let rows = &self.runs[m.run];
        let out = &rows[m.at..];
        let between = [self.place(rows[m.at - 1]), self.place(rows[m.at])];
        let cause = Cause::Moved { tool: m.tool, by: m.by, between };
        let pose = Some(self.at.observations.readings.pose[out[0]]);
        Damage { found: Excluded::of(pose, out.len(), cause), rows: out.to_vec() }
    }

    fn one_row(&self, row: usize) -> Damage {
        let off = self.at.misclosure(row);
        let sigmas = (self.single[row] / self.usual[row]).sqrt();
        let cause = Cause::Sample { number: self.place(row), off, sigmas };
        let pose = Some(self.at.observations.readings.pose[row]);
        let row_of_pose = self.at.observations.readings.held.then_some(row);
        let found = Excluded { row: row_of_pose, ..Excluded::of(pose, 1, cause) };
        Damage { found, rows: vec![row] }
    }

    /// Which of the samples that touch the same points a row is, those left out included.
    fn place(&self, row: usize) -> usize {
        let keys = &self.at.observations.readings.table.keys;
        let same = |r: &usize| keys.iter().all(|key| key[*r] == key[row]);
        (0..row).filter(same).count()
    }
}
