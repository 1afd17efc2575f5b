//! What the largest error of a result is made of, and how large it may be: a budget by GUM.
//!
//! The error of a place, one reading taken there, is to first order
//!
//! ```text
//! e = J δ + (∂p/∂h - J A) h + N ε + ζ                                            (142)
//! ```
//!
//! with the derivatives `J` by the reported parameters, `N` by the readings (100): errors `δ` of the
//! parameters, one effect `h` that nobody named (141), of which the parameters have absorbed `A h`,
//! noise `ε` of the reading, and play `ζ`. `δ` and `h` are one draw for all places, `ε` and `ζ` are
//! new at each. That is why variances of places do not bound the largest error: it is drawn, as
//! JCGM 101 does, and the expanded uncertainty is the quantile of
//!
//! ```text
//! max over places |e|                                                            (143)
//! ```
//!
//! Of a result that leaves something unexplained `δ` and `h` of a draw are taken `s` times, (146): as large as
//! errors at known poses show, as far as these are places like any other. Each draw has its own `s`, and a
//! weight, since what it makes at the known poses is known beside what it makes elsewhere.
//!
//! Beyond the readings at which a shape was seen it is held. What it would change by going on, of one that
//! was found or of one that nobody named, is drawn as well: `N(0, 1)` times as much, alike at all places.
//!
//! The rows of the budget are of the place that is known least: `u² = tr var e`, source by source,
//! so that squares add up, and degrees of freedom are those of Welch and Satterthwaite.

use crate::numerics::order::Ends;
use nalgebra::{DMatrix, DVector, Vector3};

use crate::Error;
use crate::apply::accuracy::rigid_motions;
use crate::apply::check::PAIRS;
use crate::apply::earlier::{Applied, Reported, Under, opened, outlasts};
use crate::apply::places::Placed;
use crate::apply::poses::short_way;
use crate::apply::scale::Sizes;
use crate::apply::slopes::{Slopes, carried_slopes, platform_slopes};
use crate::apply::unseen::Unseen;
use crate::mechanism::Mechanism;
use crate::model::{Spec, instances_of, is_unknown_thing};
use crate::numerics::draws::{Draws, square_root};
use crate::numerics::order;
use crate::readings::{Readings, Table};
use crate::terms;
use crate::terms::targets::provided;
use crate::terms::term::{Outlasts, Per};

/// What is asked of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Length of the error of a position.
    Position,
    /// Length of the errors of roll, pitch and yaw together, of a platform.
    Orientation,
}

/// What is known of the errors of a result.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// Covariance of its parameters, row by row.
    pub covariance: Vec<f64>,
    /// What is added to it elsewhere: variances of what changes between placements or sessions,
    /// parameter by parameter; empty where nothing does.
    pub between: Vec<f64>,
    /// Degrees of freedom of the noise that scales it; infinite where it was declared.
    pub dof: f64,
    /// Standard deviation of each coordinate by play [length unit].
    pub play: f64,
    /// What its session leaves open of effects that were not found.
    pub unseen: Vec<(Spec, Unseen)>,
    /// What check points show of a result that is not understood; none where it predicts its error.
    pub checked: Option<Checked>,
}

/// Errors at known poses that were not fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// The mean readings in them, row by row.
    pub table: Table,
    /// Which point they are of, among those that chains carry; none: the platform, or the only one.
    pub point: Option<usize>,
    /// Mean square of a coordinate of what is asked for.
    pub square: f64,
    /// The same by the noise of the readings.
    pub noise: f64,
    /// True where the motion of the instrument was taken out.
    pub aligned: bool,
}

/// How the largest error is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawing {
    /// What is asked.
    pub quantity: Quantity,
    /// Probability with which the largest error is within the expanded uncertainty.
    pub confidence: f64,
    /// Number of draws: their quantile has a relative standard error of 1 to 2 %.
    pub draws: usize,
    /// Seed of the draws.
    pub seed: u64,
}

/// A source of the budget.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Share {
    /// `parameters`, `between placements`, `noise`, `play`, `held shapes` or `unseen`.
    pub source: &'static str,
    /// The effect, of those that are unseen.
    pub effect: Option<String>,
    /// Standard uncertainty of the source itself, in its own unit; none where it has several.
    pub size: Option<f64>,
    /// Unit of the size.
    pub size_unit: Option<String>,
    /// Standard uncertainty of the place for one unit of the size.
    pub sensitivity: Option<f64>,
    /// How it is distributed.
    pub distribution: Distribution,
    /// Standard uncertainty of the place that is known least [length unit or rad].
    pub u: f64,
    /// Its degrees of freedom; none: infinitely many.
    pub dof: Option<f64>,
}

impl Share {
    fn new(source: &'static str, u: f64, dof: Option<f64>) -> Self {
        let distribution = match dof {
            Some(_) => Distribution::Student,
            None if source == UNSEEN => Distribution::Mixture,
            None => Distribution::Normal,
        };
        let (size, size_unit, sensitivity) = (None, None, None);
        Self { source, effect: None, size, size_unit, sensitivity, distribution, u, dof }
    }

    /// The same of a source of this size.
    fn of_size(self, size: f64, unit: &str) -> Self {
        let sensitivity = (size > 0.0).then(|| self.u / size);
        Self { size: Some(size), size_unit: Some(unit.into()), sensitivity, ..self }
    }
}

const UNSEEN: &str = "unseen";

/// How a source of a budget is distributed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub enum Distribution {
    /// Normal.
    #[cfg_attr(feature = "serde", serde(rename = "normal"))]
    Normal,
    /// Student's, of its degrees of freedom.
    Student,
    /// One of several effects, each normal.
    #[cfg_attr(feature = "serde", serde(rename = "mixture"))]
    Mixture,
}

/// A budget of uncertainty.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Budget {
    /// The sources, the largest effects that are unseen one by one, the others together.
    pub budget: Vec<Share>,
    /// Their root sum of squares.
    pub u: f64,
    /// Its degrees of freedom by Welch and Satterthwaite; none: infinitely many.
    pub dof: Option<f64>,
    /// The largest error is not beyond it, with the probability that was asked for.
    pub expanded: f64,
    /// `expanded / u`: above 2, because the largest error of all places counts.
    pub coverage_factor: f64,
    /// Median of the largest error.
    pub median: f64,
    /// Noise and play alone make the largest error at least so large, with the same probability.
    pub least: f64,
    /// How much larger what is not noise is than predicted, by known poses: the median of `s` of (146).
    pub times: f64,
    /// Row of the place that is known least.
    pub row: usize,
    /// Number of places.
    pub places: usize,
    /// Effects of the result that are bound to its session, and are not applied elsewhere.
    pub of_its_session: Vec<String>,
}

/// Effects that have a row of their own.
const ROWS: usize = 6;

/// Draws are taken again so often at the most, while those that count are fewer than this part of
/// those that are asked for.
const ROUNDS: usize = 8;
const FEW: f64 = 0.25;

/// The budget of a result, of the largest error over the rows of a table.
///
/// # Errors
///
/// As [`crate::apply::places::places`]; [`Error::Missing`] of an orientation without a platform,
/// [`Error::Shape`] where the covariance or an effect is of other parameters.
pub fn budget(
    mechanism: &Mechanism,
    applied: &Applied,
    errors: &Errors,
    table: Table,
    drawing: &Drawing,
) -> Result<Budget, Error> {
    let mut places = Places::new(mechanism, applied, errors, table, drawing.quantity)?;
    let known = errors.checked.as_ref().map(|checked| {
        let own = (mechanism, applied, errors);
        Known::new(own, checked, drawing.quantity)
    });
    let known = known.transpose()?;
    let draws = places.draws(errors, known.as_ref(), drawing);
    if known.is_some() {
        places.after(&draws);
    }
    let (row, shares) = places.least_known(errors);
    let u = shares.iter().map(|s| s.u * s.u).sum::<f64>().sqrt();
    let fourth = shares.iter().filter_map(|s| Some(s.u.powi(4) / s.dof?)).sum::<f64>();
    let largest = |p| quantile(&draws, |drawn| drawn.largest, p);
    let expanded = largest(drawing.confidence);
    Ok(Budget {
        budget: shares,
        u,
        dof: (fourth > 0.0).then(|| u.powi(4) / fourth),
        expanded,
        coverage_factor: expanded / u,
        median: largest(0.5),
        least: quantile(&draws, |drawn| drawn.by_noise, 1.0 - drawing.confidence),
        times: places.times,
        row: places.all[row].row,
        places: places.all.len(),
        of_its_session: of_its_session(mechanism, applied)?,
    })
}

/// Effects of a result of which nothing outlasts its session: a drift, not a slip.
fn of_its_session(mechanism: &Mechanism, applied: &Applied) -> Result<Vec<String>, Error> {
    let mut found: Vec<String> = Vec::new();
    for Reported { spec, .. } in &applied.parameters {
        let bound = outlasts(mechanism, spec)? == Outlasts::Nothing;
        let name = spec.to_string();
        if bound && !is_unknown_thing(&spec.term) && !found.contains(&name) {
            found.push(name);
        }
    }
    Ok(found)
}

/// How the error of a place follows its sources: three coordinates each.
struct Place {
    row: usize,
    /// Which point it is of, and where it is.
    point: usize,
    at: Vector3<f64>,
    /// By the independent errors of the parameters, one standard deviation each.
    parameters: DMatrix<f64>,
    /// By what changes between placements, in the same way.
    between: DMatrix<f64>,
    /// By the parameters of all unseen effects, one after the other.
    effects: DMatrix<f64>,
    /// What the shapes of the result, and those of unseen effects, would change by going on: empty
    /// where none is held.
    held: Vec<f64>,
    effects_held: DMatrix<f64>,
    /// By the noise of each channel, one standard deviation each.
    noise: DMatrix<f64>,
}

struct Places {
    all: Vec<Place>,
    /// Names of the effects that are unseen, their probability and their mean with the root of their covariance.
    effects: Vec<Effect>,
    play: (f64, String),
    /// Root mean square noise of a channel, where all have one unit.
    read: Option<(f64, String)>,
    /// How much larger what is not noise is than predicted, and by how many degrees of freedom that is known.
    times: f64,
    times_dof: Option<f64>,
}

/// What known poses say of draws.
struct Known {
    places: Places,
    motions: DMatrix<f64>,
    sizes: Sizes,
}

/// What is one draw for all places, as it is predicted.
struct Common {
    parameters: Vec<f64>,
    between: Vec<f64>,
    /// Number of the effect that is there.
    effect: Option<usize>,
    /// Its first parameter among all, and its parameters.
    first: usize,
    own: Vec<f64>,
    /// How much of what held shapes would change by going on.
    on: f64,
}

/// One draw.
struct Drawn {
    largest: f64,
    by_noise: f64,
    effect: Option<usize>,
    times: f64,
    weight: f64,
}

struct Effect {
    name: String,
    probability: f64,
    /// Its columns among all.
    first: usize,
    mean: Vec<f64>,
    root: DMatrix<f64>,
}

impl Effect {
    /// Mean square of what it does, where places follow from the parameters of all effects so.
    fn square(&self, by: &DMatrix<f64>) -> f64 {
        let by = by.columns(self.first, self.mean.len());
        let mean = by * DMatrix::from_column_slice(self.mean.len(), 1, &self.mean);
        mean.norm_squared() + (by * &self.root).norm_squared()
    }

    /// One draw of its parameters.
    fn drawn(&self, random: &mut Draws) -> Vec<f64> {
        let z: Vec<f64> = self.mean.iter().map(|_| random.normal()).collect();
        let by_root = |i: usize| (0..z.len()).map(|j| self.root[(i, j)] * z[j]).sum::<f64>();
        self.mean.iter().enumerate().map(|(i, mean)| mean + by_root(i)).collect()
    }
}

/// How the parameters of the model move.
struct Moves {
    /// With draws of the parameters of a result.
    by_root: DMatrix<f64>,
    /// With what changes between placements, in units of its standard deviations.
    by_change: DMatrix<f64>,
    /// With the parameters of all effects that are unseen.
    by_effects: DMatrix<f64>,
    effects: Vec<Effect>,
}

impl Moves {
    /// `acting` are the effects that act in these readings.
    fn of(
        mechanism: &Mechanism,
        under: &Under,
        errors: &Errors,
        beta: &[f64],
        acting: &[Spec],
    ) -> Result<Self, Error> {
        let map = under.by_reported(beta);
        let n = map.ncols();
        let root = square_root(&DMatrix::from_row_slice(n, n, &errors.covariance));
        let changes_by: Vec<f64> = errors.between.iter().map(|v| v.max(0.0).sqrt()).collect();
        let expected = if changes_by.is_empty() { 0 } else { n };
        Error::same("between placements", changes_by.len(), expected)?;
        let changing: Vec<usize> = (0..changes_by.len()).filter(|&k| changes_by[k] > 0.0).collect();
        let by_change = DMatrix::from_fn(beta.len(), changing.len(), |i, k| {
            map[(i, changing[k])] * changes_by[changing[k]]
        });
        let width = errors.unseen.iter().map(|(_, u)| u.mean.len()).sum();
        let mut by_effects = DMatrix::<f64>::zeros(beta.len(), width);
        let (mut effects, mut first) = (Vec::with_capacity(errors.unseen.len()), 0);
        for (spec, unseen) in &errors.unseen {
            let d = unseen.mean.len();
            Error::same("covariance of an effect", unseen.covariance.concat().len(), d * d)?;
            let known = unseen.moves.len().min(n);
            Error::same("moves of an effect", unseen.moves.concat().len(), unseen.moves.len() * d)?;
            for k in 0..d {
                for (i, row) in unseen.moves.iter().take(known).enumerate() {
                    by_effects.column_mut(first + k).axpy(-row[k], &map.column(i), 1.0);
                }
            }
            if acting.contains(spec) {
                for instance in instances_of(mechanism, &under.readings, spec)? {
                    let at = under.model.instances.iter().position(|i| *i == instance);
                    if let Some(column) = at.map(|i| under.model.first[i]) {
                        (0..d).for_each(|k| by_effects[(column + k, first + k)] += 1.0);
                    }
                }
            }
            let covariance = DMatrix::from_row_slice(d, d, &unseen.covariance.concat());
            effects.push(Effect {
                name: spec.to_string(),
                probability: unseen.probability,
                first,
                mean: unseen.mean.clone(),
                root: square_root(&covariance),
            });
            first += d;
        }
        Ok(Self { by_root: &map * root, by_change, by_effects, effects })
    }
}

impl Places {
    fn new(
        mechanism: &Mechanism,
        applied: &Applied,
        errors: &Errors,
        table: Table,
        quantity: Quantity,
    ) -> Result<Self, Error> {
        let posed = !mechanism.platform.is_empty();
        if quantity == Quantity::Orientation && !posed {
            let why = "points have no orientation";
            return Err(Error::missing(&mechanism.name, "platform", why));
        }
        let n = applied.parameters.len();
        Error::same("covariance", errors.covariance.len(), n * n)?;
        let acting =
            acting(mechanism, &errors.unseen, &table, applied.reference.temperature, posed)?;
        let build = if posed { Under::new } else { Under::open };
        let mut under = build(mechanism, applied, table, &acting)?;
        let beta = under.internal(&under.values);
        let slopes = slopes_of(&under, &beta, posed)?;
        let what = if posed { Placed::Platform } else { Placed::Carried };
        let at = what.of_all(&under, &under.values);
        let going_on = match under.beyond().contains(&true) {
            true => {
                under.hold_shapes(false);
                let on = what.of_all(&under, &under.values);
                let slopes = slopes_of(&under, &beta, posed)?;
                under.hold_shapes(true);
                Some((on, slopes))
            }
            false => None,
        };
        let moves = Moves::of(mechanism, &under, errors, &beta, &acting)?;
        let angles = quantity == Quantity::Orientation;
        let from = if angles { 3 } else { 0 };
        let width = at.len() / under.readings.samples.max(1);
        let to = if posed { from + 3 } else { width };
        let place = |(k, s): (usize, &Slopes), first: usize| {
            let here = &at[s.row * width..(s.row + 1) * width];
            let slopes = s.by_parameter.rows(first, 3);
            let mut noise = s.by_reading.rows(first, 3).into_owned();
            for (c, sigma) in applied.sigma.iter().enumerate() {
                noise.column_mut(c).scale_mut(*sigma);
            }
            let (held, effects_held) = match &going_on {
                Some((on, on_slopes)) => {
                    let of = |i: usize| {
                        let apart = on[s.row * width + i] - here[i];
                        if angles { short_way(apart) } else { apart }
                    };
                    let more = on_slopes[k].by_parameter.rows(first, 3) - slopes;
                    ((first..first + 3).map(of).collect(), more * &moves.by_effects)
                }
                None => (Vec::new(), DMatrix::zeros(3, 0)),
            };
            Place {
                row: s.row,
                point: first / 3,
                at: Vector3::from_row_slice(&here[first - from..first - from + 3]),
                parameters: slopes * &moves.by_root,
                between: slopes * &moves.by_change,
                effects: slopes * &moves.by_effects,
                held,
                effects_held,
                noise,
            }
        };
        let each = slopes.iter().enumerate();
        let all: Vec<Place> = each
            .flat_map(|slopes| (from..to).step_by(3).map(move |first| (slopes, first)))
            .map(|(slopes, first)| place(slopes, first))
            .collect();
        if all.is_empty() {
            return Err(Error::Empty("no place is left to be certain of".into()));
        }
        let play = if quantity == Quantity::Position { errors.play } else { 0.0 };
        let play = (play, mechanism.length_unit.clone());
        let square = applied.sigma.iter().map(|s| s * s).sum::<f64>();
        let unit = mechanism.channels.first().map(|c| c.unit.clone());
        let alike = unit.filter(|unit| mechanism.channels.iter().all(|c| c.unit == *unit));
        let read = alike.map(|unit| ((square / applied.sigma.len() as f64).sqrt(), unit));
        Ok(Self { all, effects: moves.effects, play, read, times: 1.0, times_dof: None })
    }

    /// What known poses have shown: how much larger errors are than predicted, and which effect is there.
    fn after(&mut self, draws: &[Drawn]) {
        let whole: f64 = draws.iter().map(|drawn| drawn.weight).sum();
        for (k, effect) in self.effects.iter_mut().enumerate() {
            let with = draws.iter().filter(|drawn| drawn.effect == Some(k));
            effect.probability = with.map(|drawn| drawn.weight).sum::<f64>() / whole;
        }
        let [low, middle, high] = [0.159, 0.5, 0.841].map(|p| quantile(draws, |d| d.times, p));
        // JCGM 100, G.3, of the relative uncertainty of an uncertainty.
        let spread = (high - low) / (2.0 * middle);
        self.times = middle;
        self.times_dof = (spread > 0.0).then(|| 0.5 / (spread * spread));
    }

    /// The place that is known least, and what its uncertainty is made of.
    fn least_known(&self, errors: &Errors) -> (usize, Vec<Share>) {
        let of = |k: usize| self.shares(&self.all[k], errors);
        let size = |shares: &[Share]| shares.iter().map(|s| s.u * s.u).sum::<f64>();
        let all = (0..self.all.len()).map(|k| (k, of(k)));
        let (row, shares) = all.greatest_by(|a| size(&a.1)).unwrap_or_else(|| (0, Vec::new()));
        (row, shares)
    }

    fn shares(&self, place: &Place, errors: &Errors) -> Vec<Share> {
        let dof = Some(errors.dof).filter(|dof| dof.is_finite());
        let (by_check, times) = (self.times_dof, self.times);
        let parameters = times * place.parameters.norm();
        let noise = Share::new("noise", place.noise.norm(), dof);
        let mut shares = vec![
            Share::new("parameters", parameters, by_check.or(dof)),
            match &self.read {
                Some((sigma, unit)) => noise.of_size(*sigma, unit),
                None => noise,
            },
        ];
        if place.between.ncols() > 0 {
            let between = times * place.between.norm();
            shares.push(Share::new("between placements", between, by_check));
        }
        let (play, unit) = &self.play;
        if *play > 0.0 {
            shares.push(Share::new("play", play * 3.0_f64.sqrt(), None).of_size(*play, unit));
        }
        let held = place.held.iter().map(|v| v * v).sum::<f64>().sqrt();
        if held > 0.0 {
            shares.push(Share::new("held shapes", times * held, by_check));
        }
        let of_effect = |effect: &Effect| {
            let square: f64 = [&place.effects, &place.effects_held]
                .into_iter()
                .filter(|by| by.ncols() > 0)
                .map(|by| effect.square(by))
                .sum();
            let u = times * (effect.probability * square).sqrt();
            Share { effect: Some(effect.name.clone()), ..Share::new(UNSEEN, u, by_check) }
        };
        let mut unseen: Vec<Share> = self.effects.iter().map(of_effect).collect();
        order::descending(&mut unseen, |a| a.u);
        let others: f64 = unseen.iter().skip(ROWS).map(|s| s.u * s.u).sum();
        unseen.truncate(ROWS);
        shares.extend(unseen);
        if others > 0.0 {
            shares.push(Share::new(UNSEEN, others.sqrt(), by_check));
        }
        shares
    }

    /// Draws of (143). Where known poses speak against most of them, more are taken.
    fn draws(&self, errors: &Errors, known: Option<&Known>, drawing: &Drawing) -> Vec<Drawn> {
        let mut random = Draws::new(drawing.seed);
        let mut draws = Vec::new();
        let mut enough = false;
        for _ in 0..ROUNDS {
            draws.extend((0..drawing.draws).map(|_| self.one(errors, known, &mut random)));
            let sum = |of: &dyn Fn(&Drawn) -> f64| draws.iter().map(of).sum::<f64>();
            let (weight, squares) = (sum(&|d| d.weight), sum(&|d| d.weight * d.weight));
            enough = weight > 0.0 && weight * weight >= FEW * drawing.draws as f64 * squares;
            if enough {
                break;
            }
        }
        if !enough {
            // Hardly any is as small as what was seen: what is predicted stands.
            draws.iter_mut().for_each(|drawn| drawn.weight = 1.0);
        }
        draws
    }

    /// One draw of the largest error, and of that by noise and play alone.
    fn one(&self, errors: &Errors, known: Option<&Known>, random: &mut Draws) -> Drawn {
        let widths = self
            .all
            .first()
            .map_or([0; 2], |first| [first.parameters.ncols(), first.between.ncols()]);
        // Noise that is estimated is itself uncertain: Student's distribution.
        let scale = random.student_scale(errors.dof);
        let mut normal = |n: usize| -> Vec<f64> { (0..n).map(|_| random.normal()).collect() };
        let parameters = normal(widths[0]).into_iter().map(|z| scale * z).collect();
        let between = normal(widths[1]);
        let effect = self.pick(random);
        let there = effect.map(|k| &self.effects[k]);
        let (first, own) = there.map_or((0, Vec::new()), |it| (it.first, it.drawn(random)));
        let holds = |places: &Self| places.all.first().is_some_and(|p| !p.held.is_empty());
        let held = holds(self) || known.is_some_and(|known| holds(&known.places));
        let on = if held { random.normal() } else { 0.0 };
        let common = Common { parameters, between, effect, first, own, on };
        let (times, weight) = known.map_or((1.0, 1.0), |known| known.times(&common, random));
        let mut reading: Vec<f64> = Vec::new();
        let (mut row, mut largest, mut by_noise) = (usize::MAX, 0.0_f64, 0.0_f64);
        for place in &self.all {
            if place.row != row {
                row = place.row;
                reading = (0..place.noise.ncols()).map(|_| scale * random.normal()).collect();
            }
            let (mut square, mut noise) = (0.0, 0.0);
            for i in 0..3 {
                let mut new = sum(&place.noise, i, 0, &reading);
                if self.play.0 > 0.0 {
                    new += self.play.0 * random.normal();
                }
                square += (new + times * common.does(place, i)).powi(2);
                noise += new * new;
            }
            largest = largest.max(square);
            by_noise = by_noise.max(noise);
        }
        let (largest, by_noise) = (largest.sqrt(), by_noise.sqrt());
        Drawn { largest, by_noise, effect, times, weight }
    }

    /// One of the unseen effects, by their probabilities.
    fn pick(&self, random: &mut Draws) -> Option<usize> {
        let mut left = random.uniform();
        self.effects.iter().position(|effect| {
            left -= effect.probability;
            left < 0.0
        })
    }
}

impl Common {
    /// What it does to a coordinate of a place.
    fn does(&self, place: &Place, i: usize) -> f64 {
        let unseen = |by: &DMatrix<f64>| match self.effect {
            Some(_) => sum(by, i, self.first, &self.own),
            None => 0.0,
        };
        let named = sum(&place.parameters, i, 0, &self.parameters)
            + sum(&place.between, i, 0, &self.between);
        let on = place.held.get(i).map_or(0.0, |held| held + unseen(&place.effects_held));
        named + unseen(&place.effects) + self.on * on
    }
}

impl Known {
    fn new(
        (mechanism, applied, errors): (&Mechanism, &Applied, &Errors),
        checked: &Checked,
        quantity: Quantity,
    ) -> Result<Self, Error> {
        let mut places = Places::new(mechanism, applied, errors, checked.table.clone(), quantity)?;
        places.all.retain(|place| checked.point.is_none_or(|point| place.point == point));
        // A motion of the instrument is found from places alone.
        let moved = checked.aligned && quantity == Quantity::Position && places.all.len() >= PAIRS;
        let at: Vec<_> = places.all.iter().filter(|_| moved).map(|place| place.at).collect();
        let (motions, coordinates) = (rigid_motions(&at), 3.0 * places.all.len() as f64);
        // Of a coordinate that is left, as many as no motion takes up.
        let free = (coordinates - motions.ncols() as f64).max(1.0);
        let part = coordinates / free;
        let sizes = Sizes::of(checked.square * part, checked.noise * part, free);
        Ok(Self { places, motions, sizes })
    }

    /// How much larger a draw is than predicted, and its weight.
    fn times(&self, common: &Common, random: &mut Draws) -> (f64, f64) {
        let coordinates = 3 * self.places.all.len();
        let of = |k: usize, _| common.does(&self.places.all[k / 3], k % 3);
        let mut made = DVector::from_fn(coordinates, of);
        if self.motions.nrows() == coordinates {
            made -= &self.motions * (self.motions.transpose() * &made);
        }
        let made = made.norm_squared();
        if made > 0.0 {
            ((self.sizes.draw(made, random) / made).sqrt(), self.sizes.weight(made))
        } else {
            (1.0, self.sizes.weight(0.0))
        }
    }
}

/// One coordinate, by causes from a first one on.
fn sum(by: &DMatrix<f64>, i: usize, first: usize, causes: &[f64]) -> f64 {
    causes.iter().enumerate().map(|(k, z)| by[(i, first + k)] * z).sum()
}

/// Quantile of draws with weights.
fn quantile(draws: &[Drawn], of: impl Fn(&Drawn) -> f64, p: f64) -> f64 {
    let mut sorted: Vec<[f64; 2]> = draws.iter().map(|drawn| [of(drawn), drawn.weight]).collect();
    order::ascending(&mut sorted, |a| a[0]);
    let whole: f64 = sorted.iter().map(|[_, weight]| weight).sum();
    let mut below = 0.0;
    let at = sorted.iter().find(|[_, weight]| {
        below += weight;
        // As many as are asked for, but for the rounding of sums.
        below >= (p - 1e-12) * whole
    });
    at.or(sorted.last()).map_or(f64::NAN, |[value, _]| *value)
}

/// Derivatives of a pose, or of the points that chains carry.
fn slopes_of(under: &Under, beta: &[f64], posed: bool) -> Result<Vec<Slopes>, Error> {
    match posed {
        true => platform_slopes(&under.model, &under.readings, beta, &under.noise, 1),
        false => carried_slopes(&under.model, &under.readings, beta, 1),
    }
}

/// Unseen effects that act on these readings as well, beside a session whose mean temperature was `warmth`:
/// what is bound to its session does not.
fn acting(
    mechanism: &Mechanism,
    unseen: &[(Spec, Unseen)],
    table: &Table,
    warmth: Option<f64>,
    posed: bool,
) -> Result<Vec<Spec>, Error> {
    if unseen.is_empty() {
        return Ok(Vec::new());
    }
    let bare;
    let (mechanism, table) = match posed {
        true => (mechanism, table.clone()),
        false => {
            bare = opened(mechanism)?;
            (&bare, Table { keys: Vec::new(), columns: Vec::new(), ..table.clone() })
        }
    };
    let mut readings = Readings::new(mechanism, table)?;
    if let Some(mean) = warmth {
        readings.count_temperature_from(mean);
    }
    let mut found = Vec::new();
    for (spec, _) in unseen {
        let term = terms::find_in(mechanism, &spec.term)?;
        let at_end = !posed && term.info().per == Per::Closure;
        let whole = outlasts(mechanism, spec)? == Outlasts::Whole;
        if whole && !at_end && provided(term, mechanism, &readings).is_ok() {
            found.push(spec.clone());
        }
    }
    Ok(found)
}
