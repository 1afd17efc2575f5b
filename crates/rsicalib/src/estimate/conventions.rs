//! Directions that no reading could ever show.
//!
//! A turn of an arm about its first axis, together with all that it touches, does nothing where the
//! loops are closed: a drawing says where the first joint is at zero, and no reading does. With random
//! configurations of the same device, closed at the estimates, such directions `v = (v_d, v_u)` of
//! the device and of what is unknown have
//!
//! ```text
//! P X_t v_d = 0  and  X_g v = 0                                           (112)
//! ```
//!
//! with `X_t` the columns of the device at other unknown places, `P` the projection that leaves
//! those places free, and `X_g` at the places that were touched. Noise and play open the loops, and
//! there a fit seems to tell such a direction: its Gram matrix is projected onto the others.
//!
//! What explains a session may act in some poses only, or give what stands a shape or a move. It is no
//! part of the device: it follows as places do, and is at zero where directions are looked for. A shape
//! is drawn along axes that stay while the whole turns, so that it seems to tell a little of where the
//! whole is.

use faer::linalg::solvers::Svd;
use faer::{Mat, Side};

use crate::Error;
use crate::estimate::implicit::Implicit;
use crate::estimate::objective::{Noise, Part};
use crate::estimate::observations::Observations;
use crate::estimate::sparse::{LISTED, Row, reduced};
use crate::mechanism::Mechanism;
use crate::model::configurations::{Configurations, linear};
use crate::model::{Instance, Model, Prior, Unknown};
use crate::numerics::linearization::Problem;
use crate::numerics::random::Random;
use crate::numerics::rank::{Spaces, eliminated, scaled, unit};
use crate::numerics::symmetric::{eigenvalues, invert};
use crate::readings::Readings;
use crate::terms::term::{Acts, Placed, Term};

/// The most that misclosures, a thousandth of the machine at the most, tell of a convention: unit
/// columns, squared.
pub(crate) const OPENED: f64 = 1e-6;

/// Standard deviation of an angle of which nothing is known but that it lies within a turn, π/√3 [rad].
pub(crate) const ANY_ANGLE: f64 = 1.813_799_364_234_217_8;

/// A direction shows itself by more than this part of what its parameters would, did they not cancel:
/// the root of how well a Gram matrix tells a direction, with room for condition.
const SHOWN: f64 = 1e-4;

/// Directions that no reading could show, and that neither a drawing with a standard deviation nor a
/// rest pose tells.
#[derive(Debug, Clone, Default)]
pub(crate) struct Conventions {
    /// Each with the parameter that stays as drawn.
    pub(crate) rows: Vec<Row>,
    /// Length of the column of each parameter; one where it is zero.
    norms: Vec<f64>,
    /// An orthonormal basis of the directions, in these lengths.
    basis: Vec<Vec<f64>>,
    /// Parameters that move no reading, and of which a typical size alone says anything.
    presumed: Vec<usize>,
    /// Of each of the rows that turns one frame about all that it sees, the angle [rad] by which a change of its
    /// parameter of one turns it; none for the others.
    turns: Vec<Option<f64>>,
}

/// A fit at which conventions are looked for.
#[derive(Clone, Copy)]
pub(crate) struct Here<'a> {
    pub(crate) observations: &'a Observations,
    pub(crate) model: &'a Model,
    pub(crate) priors: &'a [Prior],
    pub(crate) beta: &'a [f64],
    /// The noise of its Gram matrix, but for a common factor.
    pub(crate) noise: &'a Noise,
    /// Random configurations that are closed already; none where they are to be made.
    pub(crate) configurations: Option<&'a OtherConfigurations>,
}

/// Random configurations of a device, closed at the estimates, at other unknown places.
#[derive(Debug)]
pub(crate) struct OtherConfigurations {
    others: Configurations,
    readings: Readings,
}

impl OtherConfigurations {
    /// As many as so many parameters of the device need.
    pub(crate) fn of(
        here: Here<'_>,
        parameters: usize,
        random: &mut Random,
    ) -> Result<Self, Error> {
        let Observations { mechanism, readings, .. } = here.observations;
        let others = Configurations::of_others(mechanism, readings)?.about(readings);
        let free = others.mechanism().clone();
        let under = |readings: &Readings| here.under(&free, readings);
        let others = others.with_places(random, &under)?;
        let each = 6 + (3 * parameters).div_ceil(2 * others.combinations());
        let readings = others.closed_by(each, random, &under)?;
        Ok(Self { others, readings })
    }
}

impl Here<'_> {
    /// The same model for other readings of a mechanism, at the estimates of what is of the device.
    fn under(
        &self,
        mechanism: &Mechanism,
        readings: &Readings,
    ) -> Result<(Model, Vec<f64>), Error> {
        let model = Model::like(self.model, mechanism, readings)?;
        let mut beta = model.nominal();
        let terms = model.term_parameters;
        beta[..terms].copy_from_slice(&self.beta[..terms]);
        followers(self.model).into_iter().for_each(|i| beta[i] = 0.0);
        Ok((model, beta))
    }

    /// Parameters that typical sizes alone hold: without these priors a Gram matrix has nothing of them.
    fn presumed(&self) -> Vec<usize> {
        let sized = self.model.held_by_size();
        let of_size =
            |prior: &Prior| matches!(prior, Prior::Parameter { .. }) && sized.contains(prior);
        if !self.priors.iter().any(of_size) {
            return Vec::new();
        }
        let told: Vec<Prior> = self.priors.iter().filter(|p| !of_size(p)).copied().collect();
        let Observations { readings, weights, .. } = self.observations;
        let part = Part { model: self.model, readings, weights: Some(weights) };
        let problem = Implicit::new(vec![(part, self.noise.clone())], &told);
        let gram = problem.linearize(self.beta).gram();
        let lone = |prior: &Prior| match *prior {
            Prior::Parameter { column, sd, .. } => {
                (gram[(column, column)] * sd * sd < OPENED).then_some(column)
            }
            _ => None,
        };
        self.priors.iter().filter(|p| of_size(p)).filter_map(lone).collect()
    }

    /// The Gram matrix where all that stands has the shape that it is drawn with; none where it has.
    fn without_shapes(&self) -> Option<Mat<f64>> {
        let shapes = columns_of(self.model, |term| matches!(term.acts(), Acts::Surface(_)));
        if shapes.iter().all(|i| self.beta[*i] == 0.0) {
            return None;
        }
        let mut beta = self.beta.to_vec();
        shapes.into_iter().for_each(|i| beta[i] = 0.0);
        let Observations { readings, weights, .. } = self.observations;
        let part = Part { model: self.model, readings, weights: Some(weights) };
        let problem = Implicit::new(vec![(part, self.noise.clone())], self.priors);
        Some(problem.linearize(&beta).gram())
    }
}

impl Conventions {
    /// Those of a fit with this Gram matrix; none where random configurations cannot be closed.
    ///
    /// A typical size tells nothing of a parameter that moves no reading, as of where a tool is out of the plane
    /// in which a machine moves, or of what a joint gives whose axis is vertical.
    pub(crate) fn of(here: Here<'_>, gram: &Mat<f64>) -> Self {
        let presumed = here.presumed();
        let of = |prior: &Prior| match prior {
            Prior::Parameter { column, .. } => presumed.contains(column),
            _ => false,
        };
        let told: Vec<Prior> = here.priors.iter().filter(|p| !of(p)).copied().collect();
        let n = gram.nrows();
        let own = |i: usize, j: usize| match presumed.contains(&i) || presumed.contains(&j) {
            true => 0.0,
            false => gram[(i, j)],
        };
        let gram = Mat::from_fn(n, n, own);
        let found = Self::of_told(Here { priors: &told, ..here }, &gram);
        Self { presumed, ..found }
    }

    fn of_told(here: Here<'_>, gram: &Mat<f64>) -> Self {
        let n = gram.nrows();
        let norm = |i: usize| gram[(i, i)].max(0.0).sqrt();
        if (0..n).any(|i| !norm(i).is_finite()) {
            return Self::default();
        }
        let norms: Vec<f64> = (0..n).map(|i| if norm(i) > 0.0 { norm(i) } else { 1.0 }).collect();
        let scaled =
            |gram: &Mat<f64>| Mat::from_fn(n, n, |i, j| gram[(i, j)] / (norms[i] * norms[j]));
        let shaped = here.without_shapes();
        let one = scaled(shaped.as_ref().unwrap_or(gram));
        let weak = |values: &[f64]| values.first() < values.last().map(|v| OPENED * v).as_ref();
        if !one.self_adjoint_eigenvalues(Side::Lower).is_ok_and(|values| weak(&values)) {
            return Self::default();
        }
        let whole = shaped.map(|_| scaled(gram));
        let mut found = Self { norms, ..Self::default() };
        let random = &mut Random::new(0);
        found.of_places(here, &one, random).unwrap_or_default();
        found.of_device(here, &one, random).unwrap_or_default();
        if let Some(whole) = whole {
            found.with_shapes(here.model, &whole);
        }
        found.without_what_is_told(here);
        // What follows holds nothing.
        let followers = followers(here.model);
        let terms = 0..here.model.term_parameters;
        let device: Vec<usize> = terms.filter(|i| !followers.contains(i)).collect();
        found.rows = reduced(found.basis.clone(), &device, &[]);
        found.turns = found.rows.iter().map(|row| found.turn(row, here)).collect();
        found
    }

    /// True for a parameter that a typical size alone holds.
    pub(crate) fn presumes(&self, parameter: usize) -> bool {
        self.presumed.contains(&parameter)
    }

    /// How far a direction turns a frame about all that it sees, for a change of its parameter of one; none where
    /// it is another direction, or one of more than that frame.
    fn turn(&self, (pivot, row): &Row, here: Here<'_>) -> Option<f64> {
        let terms = here.model.term_parameters;
        let of = |u: &Unknown| terms + u.first..terms + u.first + u.width;
        let frame = here.model.unknowns.iter().position(|u| of(u).contains(pivot))?;
        let own = of(&here.model.unknowns[frame]);
        let most = row.iter().map(|v| v.abs()).fold(0.0, f64::max);
        let other = |i: usize| !own.contains(&i) && row[i].abs() > LISTED * most;
        if (terms..row.len()).any(other) {
            return None;
        }
        let one = self.norms[*pivot];
        let step: Vec<f64> = row.iter().zip(&self.norms).map(|(v, norm)| v / norm * one).collect();
        here.model.turn_in_place(frame, here.beta, &step)
    }

    /// How many turn a frame about all that it sees: play, which joints and the frame both see, tells them.
    pub(crate) fn number_of_turns(&self) -> usize {
        self.turns.iter().flatten().count()
    }

    /// Those that turn a frame about all that it sees, and the others.
    pub(crate) fn turns_and_others(&self) -> [Vec<&Row>; 2] {
        let rows = self.rows.iter().zip(&self.turns);
        let (turns, others): (Vec<_>, Vec<_>) = rows.partition(|(_, turn)| turn.is_some());
        [turns, others].map(|some| some.into_iter().map(|(row, _)| row).collect())
    }

    /// How many there are, but for what moves no reading at all.
    pub(crate) fn number(&self) -> usize {
        let alone = self.rows.iter().filter(|(pivot, _)| self.presumed.contains(pivot));
        self.basis.len() - alone.count()
    }

    /// A Gram matrix without what it seems to tell of them.
    pub(crate) fn out_of(&self, gram: Mat<f64>) -> Mat<f64> {
        if self.basis.is_empty() {
            return gram;
        }
        let n = gram.nrows();
        let norms = &self.norms;
        let one = Mat::from_fn(n, n, |i, j| gram[(i, j)] / (norms[i] * norms[j]));
        let one = self.projected(&one);
        Mat::from_fn(n, n, |i, j| 0.5 * (one[(i, j)] + one[(j, i)]) * norms[i] * norms[j])
    }

    /// A covariance with a parameter of each where it is drawn: an S-transformation (Baarda 1973). Where the
    /// whole hardly moves what is touched, as a turn about the normal of a table, what the direction shares
    /// with others is small, and without it their noise would be on the parameter that stays.
    pub(crate) fn held_in(&self, covariance: &Mat<f64>) -> Mat<f64> {
        if self.rows.is_empty() {
            return covariance.clone();
        }
        let n = covariance.nrows();
        let mut left = Mat::<f64>::identity(n, n);
        for (pivot, row) in &self.rows {
            for (i, part) in row.iter().enumerate() {
                left[(i, *pivot)] -= part * self.norms[*pivot] / self.norms[i];
            }
        }
        let held = &left * covariance * left.transpose();
        Mat::from_fn(n, n, |i, j| 0.5 * (held[(i, j)] + held[(j, i)]))
    }

    /// A Gram matrix that tells each of them as well as one parameter alone: what it leaves open then
    /// is something else.
    pub(crate) fn told_beside(&self, gram: &Mat<f64>) -> Mat<f64> {
        let n = gram.nrows();
        let own = |i: usize, j: usize| -> f64 {
            self.basis.iter().map(|b| b[i] * self.norms[i] * b[j] * self.norms[j]).sum()
        };
        Mat::from_fn(n, n, |i, j| gram[(i, j)] + own(i, j))
    }

    /// What holds a parameter of each where it is drawn while a minimum is looked for, places where
    /// they are in `x`. It tells nothing of anything else. A frame that turns about all that it sees is held as
    /// little as an angle of which nothing is known: two instruments see how far touches are from one line, or
    /// from one point, and at a wrong angle they would disagree.
    pub(crate) fn holds(&self, model: &Model, x: &[f64]) -> Vec<Prior> {
        let drawn = |p: usize| if p < model.term_parameters { 0.0 } else { x[p] };
        let hold = |(&(column, _), turn): (&Row, &Option<f64>)| Prior::Parameter {
            column,
            mean: drawn(column),
            sd: turn.map_or_else(|| self.norms[column].recip(), |turn| ANY_ANGLE / turn),
        };
        self.rows.iter().zip(&self.turns).map(hold).collect()
    }

    /// Those of their parameters that terms have.
    pub(crate) fn stay(&self, model: &Model) -> Vec<Stays> {
        let of = |&(column, _): &Row| {
            let own = |(instance, &first): (&Instance, &usize)| {
                let number = column.checked_sub(first).filter(|n| *n < instance.width())?;
                Some(Stays { of: *instance, number, norm: self.norms[column] })
            };
            model.instances.iter().zip(&model.first).find_map(own)
        };
        self.rows.iter().filter_map(of).collect()
    }

    /// True where a combination of the parameters changes along one of them.
    pub(crate) fn moves(&self, row: &[f64]) -> bool {
        let parts = || row.iter().zip(&self.norms).map(|(row, norm)| row / norm);
        let whole: f64 = parts().map(f64::abs).sum();
        let along = |basis: &Vec<f64>| parts().zip(basis).map(|(part, b)| part * b).sum::<f64>();
        self.basis.iter().any(|basis| along(basis).abs() > SHOWN * whole)
    }

    /// Parameters moved along them to what holds them.
    pub(crate) fn moved(&self, x: &[f64], holds: &[Prior]) -> Vec<f64> {
        let mut there = x.to_vec();
        for ((pivot, row), hold) in self.rows.iter().zip(holds) {
            let off = hold.off(x) / self.norms[*pivot];
            for (i, there) in there.iter_mut().enumerate() {
                *there -= off * row[i] * self.norms[*pivot] / self.norms[i];
            }
        }
        there
    }

    /// `P A P` with `P` the projection onto all other directions.
    fn projected(&self, one: &Mat<f64>) -> Mat<f64> {
        let n = one.nrows();
        let left = Mat::from_fn(n, n, |i, j| {
            f64::from(u8::from(i == j)) - self.basis.iter().map(|b| b[i] * b[j]).sum::<f64>()
        });
        &left * one * &left
    }

    /// Adds a direction to the basis, unless the data do tell it, whatever random configurations say.
    fn add(&mut self, column: Vec<f64>, one: &Mat<f64>) {
        let n = column.len();
        let Some(column) = self.along(column) else { return };
        let told = |i: usize| (0..n).map(|j| one[(i, j)] * column[j]).sum::<f64>() * column[i];
        if (0..n).map(told).sum::<f64>() < OPENED {
            self.basis.push(column);
        }
    }

    /// Shapes turn with the whole: what follows each direction with the least that the data tell of it.
    fn with_shapes(&mut self, model: &Model, whole: &Mat<f64>) {
        let n = whole.nrows();
        let columns = followers(model).into_iter().chain(model.term_parameters..n).collect();
        // A little of each, so that no direction takes back itself.
        let ridge = |i: usize, j: usize| f64::from(u8::from(i == j)) * OPENED;
        let held = Mat::from_fn(n, n, |i, j| whole[(i, j)] + ridge(i, j));
        let follow = Follow::of(columns, &held);
        let moved = follow.by(whole, &(0..n).collect::<Vec<_>>());
        for mut column in std::mem::take(&mut self.basis) {
            let of = |k: usize| (0..n).map(|j| moved[(k, j)] * column[j]).sum::<f64>();
            let step: Vec<f64> = (0..follow.columns.len()).map(of).collect();
            follow.columns.iter().zip(step).for_each(|(&i, step)| column[i] -= step);
            self.along(column).into_iter().for_each(|column| self.basis.push(column));
        }
    }

    /// The part of a direction that the basis has not, of length one; none where there is none.
    fn along(&self, mut column: Vec<f64>) -> Option<Vec<f64>> {
        // Twice, as rounding is of the length that it had.
        for other in self.basis.iter().chain(&self.basis) {
            let along: f64 = column.iter().zip(other).map(|(a, b)| a * b).sum();
            column.iter_mut().zip(other).for_each(|(a, b)| *a -= along * b);
        }
        let length = column.iter().map(|v| v * v).sum::<f64>().sqrt();
        column.iter_mut().for_each(|v| *v /= length);
        (length > 0.0).then_some(column)
    }

    /// Directions of what is unknown alone: the second of (112) with `v_d = 0`.
    fn of_places(
        &mut self,
        here: Here<'_>,
        one: &Mat<f64>,
        random: &mut Random,
    ) -> Result<(), Error> {
        let (terms, n) = (here.model.term_parameters, one.nrows());
        // What no sample touches is not to be known, and no convention.
        let live: Vec<usize> = (terms..n).filter(|&i| one[(i, i)] > 0.0).collect();
        let follow = Follow::of(followers(here.model), one);
        let pulled = follow.by(one, &live);
        let own = Mat::from_fn(live.len(), live.len(), |i, j| {
            let moved = |(k, &f): (usize, &usize)| one[(live[i], f)] * pulled[(k, j)];
            one[(live[i], live[j])] - follow.columns.iter().enumerate().map(moved).sum::<f64>()
        });
        let own = Mat::from_fn(live.len(), live.len(), |i, j| 0.5 * (own[(i, j)] + own[(j, i)]));
        let Some((values, vectors)) = eigenvalues(own.as_ref()) else { return Ok(()) };
        let lost: Vec<usize> = (0..live.len()).filter(|&k| values[k] < OPENED).collect();
        if lost.is_empty() {
            return Ok(());
        }
        let mut candidates = Mat::zeros(n, lost.len());
        for (k, &lost) in lost.iter().enumerate() {
            live.iter().enumerate().for_each(|(i, &p)| {
                candidates[(p, k)] = vectors[(i, lost)] / self.norms[p];
            });
            for (f, &p) in follow.columns.iter().enumerate() {
                let moved = (0..live.len()).map(|i| pulled[(f, i)] * vectors[(i, lost)]);
                candidates[(p, k)] = -moved.sum::<f64>() / self.norms[p];
            }
        }
        let readings = &here.observations.readings;
        let mechanism = &here.observations.mechanism;
        let touched = Configurations::of_keys(mechanism, readings.groups.clone()).about(readings);
        let under = |readings: &Readings| {
            let (model, mut beta) = here.under(touched.mechanism(), readings)?;
            shared(here.model, &model).for_each(|(own, there)| beta[own] = here.beta[there]);
            Ok((model, beta))
        };
        let readings = touched.closed_by(4 + lost.len(), random, &under)?;
        let (model, beta) = under(&readings)?;
        let x = touched.slopes(&model, &readings, &beta);
        let mut there = Mat::zeros(model.parameters, lost.len());
        for (own, of) in shared(here.model, &model) {
            (0..lost.len()).for_each(|k| there[(own, k)] = candidates[(of, k)]);
        }
        for blind in blind(&x, &there) {
            let of = |i: usize| -> f64 {
                (0..lost.len()).map(|k| candidates[(i, k)] * blind[k]).sum::<f64>() * self.norms[i]
            };
            let column = (0..n).map(of).collect();
            self.add(column, one);
        }
        Ok(())
    }

    /// Directions of the device, which what is unknown follows.
    fn of_device(
        &mut self,
        here: Here<'_>,
        one: &Mat<f64>,
        random: &mut Random,
    ) -> Result<(), Error> {
        let (terms, n) = (here.model.term_parameters, one.nrows());
        let followers = followers(here.model);
        let own: Vec<usize> = (0..terms).filter(|i| !followers.contains(i)).collect();
        let made;
        let OtherConfigurations { others, readings } = match here.configurations {
            Some(closed) => closed,
            None => {
                made = OtherConfigurations::of(here, own.len(), random)?;
                &made
            }
        };
        let (model, mut beta) = here.under(others.mechanism(), readings)?;
        others.put(&model, &mut beta);
        let x = others.slopes(&model, readings, &beta);
        let device = Mat::from_fn(x.nrows(), own.len(), |i, j| x[(i, own[j])]);
        let unknown = x.subcols(terms, x.ncols() - terms).to_owned();
        let by = unit(&device);
        let Some(seen) = eliminated(scaled(&device, &by), &unknown) else { return Ok(()) };
        let Some(spaces) = Spaces::of(&seen) else { return Ok(()) };
        // What is unknown follows the device, but not along directions of its own.
        let projected = self.projected(one);
        let follow = Follow::of(followers.into_iter().chain(terms..n).collect(), &projected);
        let pulled = follow.by(&projected, &own);
        for k in 0..spaces.null.ncols() {
            let mut column = vec![0.0; n];
            for (j, &i) in own.iter().enumerate() {
                let by = if by[j] > 0.0 { by[j] } else { 1.0 };
                column[i] = spaces.null[(j, k)] * by * self.norms[i];
            }
            for (f, &i) in follow.columns.iter().enumerate() {
                let moved = own.iter().enumerate().map(|(k, &j)| pulled[(f, k)] * column[j]);
                column[i] = -moved.sum::<f64>();
            }
            self.add(column, one);
        }
        Ok(())
    }

    /// Leaves those that neither a rest pose nor a drawing with a standard deviation tells. Known
    /// distances between unknown points are closures: (112) has them.
    fn without_what_is_told(&mut self, here: Here<'_>) {
        let mut rows: Vec<Vec<f64>> = Vec::new();
        for prior in here.priors.iter().filter(|p| !matches!(p, Prior::Apart { .. })) {
            let mut row = vec![0.0; self.norms.len()];
            for (i, slope) in prior.slopes(here.beta) {
                row[i] += slope / self.norms[i];
            }
            rows.push(row);
        }
        if let Ok(Some((model, readings))) = held(here.observations, here.model) {
            let (_, x) = linear(&model, readings, here.beta);
            for k in 0..x.nrows() {
                let mut row = vec![0.0; self.norms.len()];
                let terms = here.model.term_parameters.min(x.ncols());
                (0..terms).for_each(|i| row[i] = x[(k, i)] / self.norms[i]);
                rows.push(row);
            }
        }
        let m = self.basis.len();
        if rows.is_empty() || m == 0 {
            return;
        }
        for row in &mut rows {
            let length = row.iter().map(|v| v * v).sum::<f64>().sqrt();
            row.iter_mut().for_each(|v| *v /= length.max(f64::MIN_POSITIVE));
        }
        let seen = Mat::from_fn(rows.len(), m, |k, b| {
            rows[k].iter().zip(&self.basis[b]).map(|(row, v)| row * v).sum::<f64>()
        });
        let square = seen.transpose() * &seen;
        let Some((values, vectors)) = eigenvalues(square.as_ref()) else { return };
        let untold = (0..m).filter(|&k| values[k] < SHOWN * SHOWN);
        let made = |k: usize| -> Vec<f64> {
            let of = |i: usize| (0..m).map(|b| vectors[(b, k)] * self.basis[b][i]).sum();
            (0..self.norms.len()).map(of).collect()
        };
        self.basis = untold.map(made).collect();
    }
}

/// A parameter that holds a convention where it is while a search tries what may be added: along what no
/// reading shows, no explanation may run away.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Stays {
    of: Instance,
    /// Its number there.
    number: usize,
    /// Length of its column.
    norm: f64,
}

impl Stays {
    /// What holds it in another model where it is in `x`; none where it is no parameter there.
    pub(crate) fn held(&self, model: &Model, x: &[f64]) -> Option<Prior> {
        let k = model.instances.iter().position(|i| *i == self.of)?;
        let column = model.first[k] + self.number;
        Some(Prior::Parameter { column, mean: x[column], sd: self.norm.recip() })
    }
}

/// Columns that follow others, and the pseudo-inverse of their Gram matrix.
struct Follow {
    columns: Vec<usize>,
    inverse: Mat<f64>,
}

impl Follow {
    fn of(columns: Vec<usize>, one: &Mat<f64>) -> Self {
        let n = columns.len();
        let own = Mat::from_fn(n, n, |i, j| one[(columns[i], columns[j])]);
        Self { inverse: invert(&own).0, columns }
    }

    /// How far they follow each of these columns, with the other sign.
    fn by(&self, one: &Mat<f64>, moved: &[usize]) -> Mat<f64> {
        let cross =
            Mat::from_fn(self.columns.len(), moved.len(), |i, j| one[(self.columns[i], moved[j])]);
        &self.inverse * cross
    }
}

/// A model of the rest pose, and its reading; none where it is not part of the fit.
pub(crate) fn held<'a>(
    observations: &'a Observations,
    model: &Model,
) -> Result<Option<(Model, &'a Readings)>, Error> {
    let held = observations.held.as_ref();
    held.map(|(mechanism, readings)| Ok((Model::like(model, mechanism, readings)?, readings)))
        .transpose()
}

/// Combinations of columns of `directions` that `X` does not see.
fn blind(x: &Mat<f64>, directions: &Mat<f64>) -> Vec<Vec<f64>> {
    let m = directions.ncols();
    let norms: Vec<f64> = x.col_iter().map(|column| column.norm_l2()).collect();
    let most = |k: usize| -> f64 {
        norms.iter().enumerate().map(|(i, norm)| norm * directions[(i, k)].abs()).sum()
    };
    let by: Vec<f64> = (0..m).map(|k| if most(k) > 0.0 { most(k).recip() } else { 1.0 }).collect();
    let y = scaled(&(x * directions), &by);
    if y.nrows() < m {
        return Vec::new();
    }
    let Ok(svd) = Svd::new_thin(y.as_ref()) else { return Vec::new() };
    let (values, v) = (svd.S().column_vector(), svd.V());
    let unseen = (0..m).filter(|&k| values[k] <= SHOWN);
    unseen.map(|k| (0..m).map(|j| by[j] * v[(j, k)]).collect()).collect()
}

/// Parameters of what is unknown that two models share: of `model`, and of `other`.
fn shared<'a>(other: &'a Model, model: &'a Model) -> impl Iterator<Item = (usize, usize)> + 'a {
    model.unknowns.iter().flat_map(|one| {
        let same = other.unknowns.iter().find(|u| u.thing == one.thing && u.keys == one.keys);
        let first = |there: usize, k: usize| {
            (model.term_parameters + one.first + k, other.term_parameters + there + k)
        };
        same.into_iter().flat_map(move |there| (0..one.width).map(move |k| first(there.first, k)))
    })
}

/// Parameters of what is no part of the device: it acts in some poses only, or by more than readings,
/// or gives what stands a shape or a move.
fn followers(model: &Model) -> Vec<usize> {
    columns_of(model, |term| {
        let device = term.of_pose()
            && term.placed() == Placed::Once
            && !matches!(term.acts(), Acts::Surface(_) | Acts::End);
        !device
    })
}

/// Parameters of some terms.
fn columns_of(model: &Model, some: impl Fn(&dyn Term) -> bool) -> Vec<usize> {
    let instances = model.instances.iter().zip(&model.first).filter(|(i, _)| some(i.term));
    instances.flat_map(|(i, &first)| first..first + i.width()).collect()
}
