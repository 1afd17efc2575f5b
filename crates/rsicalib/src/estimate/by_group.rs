//! What changes from group to group: placements, or sessions.
//!
//! An arm is not the same at every placement: what its model lacks bends differently there, and what
//! carries it gives. Beside one vector `β` of parameters each group has shifts `b_g` of a stated set
//! of them, those of offsets, of carried points, and of what several groups touch,
//!
//! ```text
//! r_g = X_g (β - β̂) + X_g E b_g + e,    b_g ~ N(0, τ² S)                    (130)
//! ```
//!
//! where `S` has the squares of their typical sizes. (131) gives `τ`; then estimates have, and what
//! they say of another group has,
//!
//! ```text
//! V = φ N⁻¹ + τ² Σ A_g S A_gᵀ,    A_g = N⁻¹ X_gᵀX_g E;    V + τ² E S Eᵀ     (132)
//! ```
//!
//! with `N` of the fit, priors included.

use std::sync::Arc;

use faer::Mat;

use crate::estimate::as_near::as_near;
use crate::estimate::between::{Between, Grouping, Halves};
use crate::estimate::fitted::Fit;
use crate::estimate::implicit::Implicit;
use crate::estimate::mirrors::without_mirrors;
use crate::estimate::objective::Part;
use crate::estimate::observations::Observations;
use crate::estimate::suspicion::Suspicion;
use crate::estimate::unlike::exchanged;
use crate::mechanism::Target;
use crate::model::{Model, Thing};
use crate::numerics::component::{Component, Contrasts};
use crate::numerics::symmetric::{dot, invert};
use crate::readings::{Readings, along, ascending};
use crate::terms::PointPosition;
use crate::terms::term::{Placed, Role, Spot};

/// Contrasts of a half of the groups of which no component of its own is told.
const FEW: usize = 3;

/// A fit without a better place in a mirror, with what changes from group to group of its session, and what a device keeps of its
/// drawing; of a long recording neither is looked for.
#[must_use]
pub fn with_groups(fit: Fit, observations: &Observations) -> Fit {
    if !fit.converged() || observations.is_long() {
        return fit;
    }
    let mut fit = without_mirrors(fit, observations);
    fit.warnings.retain(|warning| !matches!(warning, Suspicion::Unlike { .. }));
    fit.warnings.extend(exchanged(&fit));
    let between = between(observations, &fit).map(Arc::new);
    as_near(observations, Fit { between, ..fit })
}

/// Of a fit; none where there are no groups, or where nothing that may change is estimated.
fn between(observations: &Observations, fit: &Fit) -> Option<Between> {
    let (grouping, of_row, names) = numbered_groups(observations, &fit.model)?;
    let sums = Sums::of(observations, fit, &of_row, names.len());
    let changing = changing(&fit.model, &sums);
    let all: Vec<usize> = (0..names.len()).collect();
    let order = groups_along(observations, &of_row);
    let order: Vec<usize> = order.into_iter().filter(|g| *g < names.len()).collect();
    let here = Told { fit, sums: &sums, changing: &changing, order };
    let inverse = fit.inverse();
    let component = here.component(&inverse, &all, here.left(&inverse, &all))?;
    let covariance = here.covariance(&inverse, &all, &component);
    let halves = here.halves(&component);
    Some(Between { grouping, groups: names, changing, component, covariance, halves })
}

/// Group of each row, and the names of the groups; none where there are not two.
#[must_use]
pub fn numbered_groups(
    observations: &Observations,
    model: &Model,
) -> Option<(Grouping, Vec<usize>, Vec<String>)> {
    let Observations { readings, weights, .. } = observations;
    // A row names what it touches by the first key that is not blank.
    let key = |row: usize| {
        let mut own = readings.table.keys.iter().filter_map(|keys| keys.get(row));
        own.find(|name| !name.is_empty()).cloned()
    };
    let by_key = || {
        let mut seen = Vec::new();
        (0..readings.samples).map(|row| place_in(&mut seen, key(row))).collect()
    };
    let placements = model.placements(readings).unwrap_or_else(by_key);
    let sessions = readings.pose.iter().map(|pose| readings.session_of_pose[*pose]).collect();
    let session =
        |row: usize| Some(format!("{}", readings.session_of_pose[readings.pose[row]] + 1));
    let numbered = |raw: Vec<usize>, name: &dyn Fn(usize) -> Option<String>| {
        let (mut seen, mut names) = (Vec::new(), Vec::new());
        let live = |row: &usize| weights[*row] > 0.0;
        for row in (0..raw.len()).filter(live) {
            if place_in(&mut seen, raw[row]) == names.len() {
                names.push(name(row).unwrap_or_default());
            }
        }
        let of_row = raw.into_iter().map(|g| place_in(&mut seen, g)).collect();
        (names.len() > 1).then_some((of_row, names))
    };
    let placed = numbered(placements, &key).map(|(rows, names)| (Grouping::Placement, rows, names));
    placed.or_else(|| {
        numbered(sessions, &session).map(|(rows, names)| (Grouping::Session, rows, names))
    })
}

/// The groups along the direction in which readings vary most, by the means of their poses: every other
/// one of them is a half that spans what the session spans, and does not depend on the order of rows.
#[must_use]
pub fn groups_along(observations: &Observations, of_row: &[usize]) -> Vec<usize> {
    let Observations { readings, weights, .. } = observations;
    let counted = readings.rows_of_poses().into_iter();
    let firsts: Vec<usize> =
        counted.filter_map(|rows| rows.into_iter().find(|row| weights[*row] > 0.0)).collect();
    let n = readings.channels;
    let values = |row: &usize| &readings.table.values[row * n..(row + 1) * n];
    let places = along(firsts.iter().map(values));
    let count = of_row.iter().max().map_or(0, |last| last + 1);
    let mut sums = vec![[0.0; 2]; count];
    for (row, place) in firsts.iter().zip(places) {
        let [sum, poses] = &mut sums[of_row[*row]];
        (*sum, *poses) = (*sum + place, *poses + 1.0);
    }
    let means: Vec<f64> = sums.iter().map(|[sum, poses]| sum / poses).collect();
    ascending(&means)
}

/// Number of a value among those seen, itself included.
fn place_in<T: PartialEq>(seen: &mut Vec<T>, value: T) -> usize {
    seen.iter().position(|s| *s == value).unwrap_or_else(|| {
        seen.push(value);
        seen.len() - 1
    })
}

/// Columns that may change from group to group, with typical sizes.
fn changing(model: &Model, sums: &Sums) -> Vec<(usize, f64)> {
    let mut changing = Vec::new();
    for (instance, &first) in model.instances.iter().zip(&model.first) {
        let term = instance.term;
        let sits = term.placed() == Placed::Once && term.moves_only(&[Spot::Tip]);
        if term.role() == Role::Offset || sits {
            let sizes = model.typical_at(instance.term, instance.target);
            changing.extend(sizes.into_iter().enumerate().map(|(k, size)| (first + k, size)));
        }
    }
    // What is touched in several groups may have been moved between them.
    let size = model.typical_at(&PointPosition, Target::All).first().copied();
    for unknown in model.unknowns.iter().filter(|u| matches!(u.thing, Thing::Point(_))) {
        let columns = model.term_parameters + unknown.first..;
        for column in columns.take(unknown.width) {
            if sums.0.iter().filter(|sum| sum.square(column) > 0.0).count() > 1 {
                changing.extend(size.map(|size| (column, size)));
            }
        }
    }
    changing
}

/// What one group tells, in units of the noise: of the parameters that it tells of.
struct Sum {
    /// These parameters, ascending: what other groups touch is none of them.
    used: Vec<usize>,
    /// `X_gᵀX_g` of these.
    gram: Mat<f64>,
    /// `X_gᵀr_g` of these.
    pull: Vec<f64>,
    /// `r_gᵀr_g`
    squares: f64,
    /// Equations.
    told: f64,
    /// Its share of what repeats scatter.
    repeats: f64,
}

impl Sum {
    fn place(&self, column: usize) -> Option<usize> {
        self.used.binary_search(&column).ok()
    }

    /// The diagonal of `X_gᵀX_g` at a parameter.
    fn square(&self, column: usize) -> f64 {
        self.place(column).map_or(0.0, |k| self.gram[(k, k)])
    }
}

/// What each group tells.
struct Sums(Vec<Sum>);

impl Sums {
    fn of(observations: &Observations, fit: &Fit, of_row: &[usize], groups: usize) -> Self {
        let Observations { readings, weights, .. } = observations;
        let part = Part { model: &fit.model, readings, weights: Some(weights) };
        let residuals = Implicit::of(part, fit.assumed()).residuals(&fit.beta, true);
        let (n, k) = (fit.model.parameters, residuals.equations);
        let live = (0..readings.samples).filter(|row| weights[*row] > 0.0);
        let repeats = repeats(readings, live.clone(), of_row, groups);
        let slopes = |equation: usize| &residuals.by_parameter[equation * n..(equation + 1) * n];
        let (mut used, mut told) = (vec![vec![false; n]; groups], vec![0.0; groups]);
        for row in live.clone() {
            told[of_row[row]] += residuals.directions_of(row) as f64;
            for equation in row * k..(row + 1) * k {
                let used = used[of_row[row]].iter_mut().zip(slopes(equation));
                used.for_each(|(used, slope)| *used |= *slope != 0.0);
            }
        }
        let empty = |group: usize| {
            let used: Vec<usize> = (0..n).filter(|&i| used[group][i]).collect();
            let (gram, pull) = (Mat::zeros(used.len(), used.len()), vec![0.0; used.len()]);
            Sum { used, gram, pull, squares: 0.0, told: told[group], repeats: repeats[group] }
        };
        let mut sums: Vec<Sum> = (0..groups).map(empty).collect();
        for equation in live.flat_map(|row| row * k..(row + 1) * k) {
            let sum = &mut sums[of_row[equation / k]];
            let (own, x) = (residuals.whitened[equation], slopes(equation));
            sum.squares += own.powi(2);
            let x: Vec<f64> = sum.used.iter().map(|&i| x[i]).collect();
            let told: Vec<usize> = (0..x.len()).filter(|&i| x[i] != 0.0).collect();
            for &i in &told {
                sum.pull[i] += x[i] * own;
                told.iter().for_each(|&j| sum.gram[(i, j)] += x[i] * x[j]);
            }
        }
        Self(sums)
    }
}

/// The share of each group of what repeats scatter.
fn repeats(
    readings: &Readings,
    live: impl Iterator<Item = usize>,
    of_row: &[usize],
    groups: usize,
) -> Vec<f64> {
    let [mut rows, mut poses] = [0, 1].map(|_| vec![0.0; groups]);
    let mut seen = vec![false; readings.poses()];
    for row in live {
        rows[of_row[row]] += 1.0;
        if !std::mem::replace(&mut seen[readings.pose[row]], true) {
            poses[of_row[row]] += 1.0;
        }
    }
    // Where no pose repeats, rows of a recording repeat their neighbours.
    let more = rows.iter().zip(&poses).map(|(rows, poses)| rows - poses).collect::<Vec<f64>>();
    let more = if more.iter().any(|m| *m > 0.0) { more } else { rows };
    let all: f64 = more.iter().sum();
    more.iter().map(|more| more / all).collect()
}

/// What groups tell at a fit.
struct Told<'a> {
    fit: &'a Fit,
    sums: &'a Sums,
    changing: &'a [(usize, f64)],
    /// The groups, in an order of their readings.
    order: Vec<usize>,
}

impl Told<'_> {
    /// `N` of some groups, priors included.
    fn normal(&self, groups: &[usize]) -> Mat<f64> {
        let mut normal = self.fit.gram.clone();
        for (_, sum) in self.sums.0.iter().enumerate().filter(|(g, _)| !groups.contains(g)) {
            for (l, &j) in sum.used.iter().enumerate() {
                sum.used.iter().enumerate().for_each(|(k, &i)| normal[(i, j)] -= sum.gram[(k, l)]);
            }
        }
        normal
    }

    /// `N⁻¹` times the slope of ½χ² of some groups, priors included: a step away from their minimum.
    fn step(&self, inverse: &Mat<f64>, groups: &[usize]) -> Vec<f64> {
        let n = inverse.nrows();
        let mut slope = vec![0.0; n];
        for prior in &self.fit.priors {
            let off = prior.off(&self.fit.beta);
            prior.slopes(&self.fit.beta).into_iter().for_each(|(i, by)| slope[i] += by * off);
        }
        for sum in groups.iter().map(|&g| &self.sums.0[g]) {
            sum.used.iter().zip(&sum.pull).for_each(|(&i, pull)| slope[i] += pull);
        }
        (0..n).map(|i| (0..n).map(|j| inverse[(i, j)] * slope[j]).sum()).collect()
    }

    /// χ² between the poses of some groups at their own minimum, and its degrees of freedom: of all, those of
    /// the fit.
    fn left(&self, inverse: &Mat<f64>, groups: &[usize]) -> [f64; 2] {
        let Fit { chi2, total, within, noise, .. } = self.fit;
        // What repeats scatter was taken out where they tell the noise.
        let scattered = if *within > 0.0 { total - chi2 * noise.inflation } else { 0.0 };
        let inflation = if *within > 0.0 { noise.inflation } else { 1.0 };
        let step = self.step(inverse, groups);
        let (mut squares, mut dof, mut repeats) = (0.0, 0.0, 0.0);
        for sum in groups.iter().map(|&g| &self.sums.0[g]) {
            squares += sum.squares;
            dof += sum.told;
            repeats += sum.repeats;
            let own: Vec<f64> = sum.used.iter().map(|&i| step[i]).collect();
            for (k, &i) in sum.used.iter().enumerate() {
                let (column, inverse) = (sum.gram.col_as_slice(k), inverse.col_as_slice(i));
                squares += own[k] * (dot(column, &own) - 2.0 * sum.pull[k]);
                dof -= sum.used.iter().zip(column).map(|(&j, gram)| inverse[j] * gram).sum::<f64>();
            }
        }
        let chi2 = (squares - scattered * repeats).clamp(0.0, f64::INFINITY) / inflation;
        [chi2, dof - within * repeats]
    }

    /// `X_gᵀX_g E S^½`
    fn columns(&self, group: usize) -> Mat<f64> {
        let (sum, n) = (&self.sums.0[group], self.fit.model.parameters);
        let mut columns = Mat::zeros(n, self.changing.len());
        for (k, (column, typical)) in self.changing.iter().enumerate() {
            let Some(own) = sum.place(*column) else { continue };
            let told = sum.used.iter().enumerate();
            told.for_each(|(at, &i)| columns[(i, k)] = sum.gram[(at, own)] * typical);
        }
        columns
    }

    /// (131) of some groups, whose `N⁻¹`, χ² and degrees of freedom are given.
    fn component(
        &self,
        inverse: &Mat<f64>,
        groups: &[usize],
        [chi2, dof]: [f64; 2],
    ) -> Option<Component> {
        let (m, n) = (self.changing.len(), inverse.nrows());
        if m == 0 || groups.len() < 2 {
            return None;
        }
        let count = groups.len() * m;
        let step = self.step(inverse, groups);
        let mut wide = Mat::<f64>::zeros(n, count);
        let mut own = Mat::<f64>::zeros(count, count);
        let mut left = vec![0.0; count];
        for (at, &g) in groups.iter().enumerate() {
            let columns = self.columns(g);
            wide.subcols_mut(at * m, m).copy_from(&columns);
            for (k, (column, typical)) in self.changing.iter().enumerate() {
                let taken: f64 = (0..n).map(|i| columns[(i, k)] * step[i]).sum();
                let sum = &self.sums.0[g];
                let pull = sum.place(*column).map_or(0.0, |at| sum.pull[at]);
                left[at * m + k] = pull * typical - taken;
                for l in 0..m {
                    own[(at * m + k, at * m + l)] = columns[(*column, l)] * typical;
                }
            }
        }
        let c = own - wide.transpose() * (inverse * &wide);
        let noise = &self.fit.noise;
        // Noise that changes slowly counts as so much more of it.
        let slow = noise.slow;
        let c = Mat::from_fn(count, count, |i, j| c[(i, j)] / slow);
        left.iter_mut().for_each(|u| *u /= slow);
        let least = if noise.judges() { 1.0 } else { 0.0 };
        Contrasts::of(c.as_ref(), &left, [chi2, dof, least])?.component()
    }

    /// `V` (132) of some groups.
    fn covariance(&self, inverse: &Mat<f64>, groups: &[usize], component: &Component) -> Mat<f64> {
        let n = inverse.nrows();
        let noise = self.fit.noise.slow * component.noise;
        let mut covariance = Mat::from_fn(n, n, |i, j| inverse[(i, j)] * noise);
        for &g in groups {
            let moved = inverse * self.columns(g);
            covariance += faer::Scale(component.variance) * &moved * moved.transpose();
        }
        covariance
    }

    /// Every other group against the rest; none of a single group.
    fn halves(&self, all: &Component) -> Option<Halves> {
        let halves = [0, 1].map(|first| {
            let mut half: Vec<usize> = self.order.iter().copied().skip(first).step_by(2).collect();
            half.sort_unstable();
            half
        });
        let n = self.fit.model.parameters;
        let inverses = halves.each_ref().map(|half| invert(&self.normal(half)).0);
        // Few contrasts tell a component by its limits more than by themselves.
        let told = |h: usize| self.changing.len() * halves[h].len().saturating_sub(1) > FEW;
        let own = [0, 1].map(|h| {
            let left = self.left(&inverses[h], &halves[h]);
            self.component(&inverses[h], &halves[h], left).filter(|_| told(h))
        });
        let steps = [0, 1].map(|h| self.step(&inverses[h], &halves[h]));
        let of = |h: usize| {
            let component = own[h].unwrap_or(*all);
            let within = Component { variance: 0.0, ..component };
            [within, component].map(|c| self.covariance(&inverses[h], &halves[h], &c))
        };
        let ([within, between], [other_within, other_between]) = (of(0), of(1));
        // What priors say is the same in both.
        let mut priors = self.normal(&[]);
        priors = &inverses[0] * &priors * &inverses[1];
        let shared = &priors + priors.transpose();
        Some(Halves {
            difference: (0..n).map(|i| steps[1][i] - steps[0][i]).collect(),
            within: within + other_within - &shared,
            between: between + other_between - shared,
            own: own.iter().all(Option::is_some),
            groups: halves,
        })
    }
}
