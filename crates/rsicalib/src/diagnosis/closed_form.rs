//! The law behind a free curve: which closed form explains as much, if any does.
//!
//! At the fit without the curve, a form with columns `g(x; θ)` of the joint coordinate has whitened
//! columns `Z = L⁻¹ (∂f/∂q) g`, scored by (71, 72). The shape `θ` (an order, a place, a width) is
//! searched for on a grid and then refined. Forms are charged for their parameters and for the
//! search. Where waves of any shape still score above chance beside the best form, none is the law.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use crate::diagnosis::score::scored::CHARGE;
use crate::estimate::{Fit, Implicit, Observations, Part};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::credible_set::AS_WELL;
use crate::numerics::distributions::chi2_tail;
use crate::numerics::symmetric::invert;
use crate::terms::term::Over;

/// A closed form that explains what a free curve does.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ClosedForm {
    /// Its name: `n_per_turn`, `kink`, ...; `none` where no form is the law.
    pub form: String,
    /// What was searched for: an order, a place, a width.
    pub shape: Vec<Shape>,
    /// Other forms that fit as well.
    pub also_fits: Vec<String>,
}

/// A parameter of a form that was searched for.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Shape {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Values between which it lies with 95 % probability.
    pub interval: [f64; 2],
    /// Unit of all three.
    pub unit: String,
}

/// A form: its name, and the columns for a shape.
struct Form {
    name: &'static str,
    /// Names and units of the shape.
    shape: &'static [(&'static str, &'static str)],
    /// Values to try of each entry of the shape, by the span of `x`.
    grid: fn(Span) -> Vec<Vec<f64>>,
    /// Columns at `x`.
    columns: fn(f64, &[f64]) -> Vec<f64>,
}

/// Where a curve runs: the lowest and the highest `x`.
#[derive(Clone, Copy)]
struct Span {
    low: f64,
    high: f64,
}

impl Span {
    /// So many values inside, evenly.
    fn inside(self, count: usize) -> Vec<f64> {
        let step = (self.high - self.low) / (count + 1) as f64;
        (1..=count).map(|k| self.low + step * k as f64).collect()
    }

    /// Values between two parts of the span, in steps of a factor.
    fn scaled(self, from: f64, to: f64, factor: f64) -> Vec<f64> {
        let width = self.high - self.low;
        let mut values = vec![from * width];
        while values[values.len() - 1] < to * width {
            values.push(values[values.len() - 1] * factor);
        }
        values
    }
}

/// Forms over the angle that a channel reads [rad, or length].
const OVER_READING: [Form; 8] = [
    Form {
        name: "parabola",
        shape: &[],
        grid: |_| Vec::new(),
        columns: |x, _| vec![x * x],
    },
    Form {
        name: "cubic",
        shape: &[],
        grid: |_| Vec::new(),
        columns: |x, _| vec![x * x, x * x * x],
    },
    Form {
        name: "n_per_turn",
        shape: &[("n", "1")],
        // From a third of a wave over the span to a wave in a twentieth of it, in steps of 1 %.
        grid: |span| {
            let width = span.high - span.low;
            let turns = std::f64::consts::TAU / width;
            let unit = Span { low: 0.0, high: 1.0 };
            vec![unit.scaled(0.33, 20.0, 1.01).into_iter().map(|waves| waves * turns).collect()]
        },
        columns: |x, shape| vec![(shape[0] * x).sin(), (shape[0] * x).cos()],
    },
    Form {
        name: "kink",
        shape: &[("at", "rad")],
        grid: |span| vec![span.inside(63)],
        columns: |x, shape| vec![(x - shape[0]).max(0.0)],
    },
    Form {
        name: "step",
        shape: &[("at", "rad")],
        grid: |span| vec![span.inside(127)],
        columns: |x, shape| vec![f64::from(u8::from(x >= shape[0]))],
    },
    Form {
        name: "dead_band",
        shape: &[("at", "rad"), ("width", "rad")],
        grid: |span| vec![span.inside(31), span.scaled(0.02, 0.5, 1.3)],
        columns: |x, shape| vec![(x - shape[0]).clamp(-0.5 * shape[1], 0.5 * shape[1])],
    },
    Form {
        name: "saturation",
        shape: &[("from", "rad")],
        grid: |span| vec![span.scaled(0.1, 0.48, 1.05)],
        columns: |x, shape| vec![(x.abs() - shape[0]).max(0.0) * x.signum()],
    },
    Form {
        name: "coarse_code",
        shape: &[("step", "rad"), ("phase", "1")],
        grid: |span| {
            let phases = (0..16).map(|k| f64::from(k) / 16.0).collect();
            vec![span.scaled(0.01, 0.34, 1.01), phases]
        },
        columns: |x, shape| {
            let place = x / shape[0] + shape[1];
            vec![place - place.floor()]
        },
    },
];

/// Forms over time, 0 to 1.
const OVER_TIME: [Form; 4] = [
    Form { name: "line", shape: &[], grid: |_| Vec::new(), columns: |t, _| vec![t] },
    Form {
        name: "warm_up",
        shape: &[("time_constant", "session")],
        grid: |span| vec![span.scaled(0.01, 2.0, 1.1)],
        columns: |t, shape| vec![(-t / shape[0]).exp()],
    },
    Form {
        name: "step",
        shape: &[("at", "session")],
        grid: |span| vec![span.inside(127)],
        columns: |t, shape| vec![f64::from(u8::from(t >= shape[0]))],
    },
    Form {
        name: "wave",
        shape: &[("waves", "1/session")],
        grid: |_| vec![Span { low: 0.0, high: 1.0 }.scaled(0.33, 20.0, 1.02)],
        columns: |t, shape| {
            let angle = std::f64::consts::TAU * shape[0] * t;
            vec![angle.sin(), angle.cos()]
        },
    },
];

/// Waves that any shape would need, to see what a form leaves.
const WAVES: usize = 12;

/// What is left beside a form is noise where chance leaves as much this often.
const LEFT: f64 = 0.01;

/// χ² within which a shape lies with 95 % probability.
const WITHIN: f64 = 3.84;

/// The closed form behind a free curve of one channel; none where the instance is no such curve.
///
/// `without` is the fit without the curve, with the same noise.
#[must_use]
pub fn closed_form(
    observations: &Observations,
    without: &Fit,
    curve: &Instance,
) -> Option<ClosedForm> {
    let Target::Channel(channel) = curve.target else { return None };
    let over = curve.term.over().filter(|_| curve.term.info().penalised)?;
    let forms: &[Form] = if over == Over::Reading { &OVER_READING } else { &OVER_TIME };
    let room = Room::new(observations, without, channel, over);
    let mut best: Vec<Fitted> = forms.iter().map(|form| room.fitted(form)).collect();
    best.sort_by(|a, b| b.value.total_cmp(&a.value));
    let first = best.first()?;
    let enough = room.left_beside(first) > LEFT;
    if !enough {
        return Some(ClosedForm { form: "none".into(), shape: Vec::new(), also_fits: Vec::new() });
    }
    let as_well = best[1..].iter().filter(|other| other.value > first.value - AS_WELL);
    Some(ClosedForm {
        form: first.form.name.into(),
        also_fits: as_well.map(|other| other.form.name.into()).collect(),
        shape: room.shape_of(first),
    })
}

/// A form at its best shape.
struct Fitted<'a> {
    form: &'a Form,
    shape: Vec<f64>,
    score: f64,
    /// The score, parameters and search paid for.
    value: f64,
}

/// One session in which forms are tried at one channel.
struct Room {
    /// Where each sample is.
    x: Vec<f64>,
    span: Span,
    equations: usize,
    /// `L⁻¹ ∂f/∂q`, whitened residuals, fitted columns: sample by sample, equation by equation.
    by_joint: Vec<f64>,
    residual: Vec<f64>,
    fitted: Mat<f64>,
    /// `(XᵀX)⁻¹` with priors.
    inverse: Mat<f64>,
}

impl Room {
    fn new(observations: &Observations, without: &Fit, channel: usize, over: Over) -> Self {
        let Observations { readings, weights, .. } = observations;
        let part = Part { model: &without.model, readings, weights: Some(weights) };
        let there =
            Implicit::new(vec![(part, without.assumed())], &[]).residuals(&without.beta, true);
        let scale = &without.model.scales[channel];
        let (k, c, n) = (there.equations, readings.channels, without.model.parameters);
        let mut x = vec![0.0; readings.samples];
        for meta in readings.blocks() {
            for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
                x[row] = match over {
                    Over::Reading => (readings.row(row)[channel] - scale.middle) * scale.gain,
                    Over::Time => meta.time.0[lane],
                };
            }
        }
        let live = |row: &usize| weights[*row] > 0.0;
        let low = (0..x.len()).filter(live).map(|r| x[r]).fold(f64::INFINITY, f64::min);
        let high = (0..x.len()).filter(live).map(|r| x[r]).fold(f64::NEG_INFINITY, f64::max);
        let rows = readings.samples * k;
        // Of a small correction: a radian moves the loop as 1/gain of a reading does.
        let by_joint = (0..rows).map(|i| there.by_reading[i * c + channel] / scale.gain).collect();
        Self {
            x,
            span: Span { low, high },
            equations: k,
            by_joint,
            residual: there.whitened,
            fitted: Mat::from_fn(rows, n, |i, j| there.by_parameter[i * n + j]),
            inverse: invert(&without.gram).0,
        }
    }

    /// Columns of a function of `x`, projected off what is fitted.
    fn projected(&self, columns: impl Fn(f64) -> Vec<f64>) -> Mat<f64> {
        let by_sample: Vec<Vec<f64>> = self.x.iter().map(|x| columns(*x)).collect();
        let width = by_sample.first().map_or(0, Vec::len);
        let raw = Mat::from_fn(self.by_joint.len(), width, |i, j| {
            self.by_joint[i] * by_sample[i / self.equations][j]
        });
        let absorbed = &self.inverse * (self.fitted.transpose() * &raw);
        &raw - &self.fitted * absorbed
    }

    /// `T` of (72) of projected columns on a residual.
    fn score(columns: &Mat<f64>, residual: &Mat<f64>) -> f64 {
        let square = columns.transpose() * columns;
        let gradient = columns.transpose() * residual;
        let (inverse, ..) = invert(&square);
        (gradient.transpose() * inverse * &gradient)[(0, 0)]
    }

    fn residual(&self) -> Mat<f64> {
        Mat::from_fn(self.residual.len(), 1, |i, _| self.residual[i])
    }

    fn at(&self, form: &Form, shape: &[f64]) -> f64 {
        Self::score(&self.projected(|x| (form.columns)(x, shape)), &self.residual())
    }

    /// The form at the shape that explains most: on the grid, then between its neighbours.
    fn fitted<'a>(&self, form: &'a Form) -> Fitted<'a> {
        let grid = (form.grid)(self.span);
        let mut tried = 1.0;
        let mut shape: Vec<f64> = Vec::new();
        let mut score = f64::NEG_INFINITY;
        for candidate in product(&grid) {
            let found = self.at(form, &candidate);
            tried += 1.0;
            if found > score {
                (score, shape) = (found, candidate);
            }
        }
        for (k, values) in grid.iter().enumerate() {
            let place = values.iter().position(|v| *v == shape[k]).unwrap_or(0);
            let ends = [values[place.saturating_sub(1)], values[(place + 1).min(values.len() - 1)]];
            let along = |value: f64| {
                let mut near = shape.clone();
                near[k] = value;
                self.at(form, &near)
            };
            let (value, found) = highest(along, ends);
            if found > score {
                (score, shape[k]) = (found, value);
            }
        }
        let width = (form.columns)(self.span.low, &shape).len() + shape.len();
        let searched = if grid.is_empty() { 0.0 } else { 2.0 * f64::ln(tried) };
        Fitted { form, shape, score, value: score - CHARGE * width as f64 - searched }
    }

    /// Probability that chance leaves as much as waves of any shape find beside a form.
    fn left_beside(&self, fitted: &Fitted) -> f64 {
        let width = self.span.high - self.span.low;
        let with_waves = |x: f64| {
            let mut columns = (fitted.form.columns)(x, &fitted.shape);
            let angle = std::f64::consts::PI * (x - self.span.low) / width;
            columns.extend((1..=WAVES).map(|k| (k as f64 * angle).cos()));
            columns
        };
        let more = Self::score(&self.projected(with_waves), &self.residual()) - fitted.score;
        chi2_tail(more.max(0.0), WAVES as f64)
    }

    /// The shape with its intervals: where the score falls by [`WITHIN`].
    fn shape_of(&self, fitted: &Fitted) -> Vec<Shape> {
        let grid = (fitted.form.grid)(self.span);
        let names = fitted.form.shape.iter().enumerate();
        names
            .map(|(k, (name, unit))| {
                let along = |value: f64| {
                    let mut near = fitted.shape.clone();
                    near[k] = value;
                    self.at(fitted.form, &near)
                };
                let values = &grid[k];
                let best = fitted.shape[k];
                let inside = |v: f64| along(v) > fitted.score - WITHIN;
                let (low, high) = (values[0], values[values.len() - 1]);
                Shape {
                    name: (*name).into(),
                    value: best,
                    interval: [edge(inside, best, low), edge(inside, best, high)],
                    unit: (*unit).into(),
                }
            })
            .collect()
    }
}

/// All combinations of one value of each; one empty combination of nothing.
fn product(values: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut all = vec![Vec::new()];
    for entry in values {
        all = all
            .iter()
            .flat_map(|head: &Vec<f64>| {
                entry.iter().map(move |v| head.iter().copied().chain([*v]).collect())
            })
            .collect();
    }
    all
}

/// Golden section for the highest value of a function between two ends.
fn highest(f: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2]) -> (f64, f64) {
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    for _ in 0..24 {
        let (a, b) = (high - golden * (high - low), low + golden * (high - low));
        if f(a) > f(b) { high = b } else { low = a }
    }
    let middle = 0.5 * (low + high);
    (middle, f(middle))
}

/// Where a property ends between a value that has it and another one.
fn edge(holds: impl Fn(f64) -> bool, from: f64, to: f64) -> f64 {
    // In growing steps first: far away it may hold again.
    let (mut inside, mut outside) = (from, to);
    for k in (1..=12).rev() {
        let step = from + (to - from) * 0.5_f64.powi(k);
        if !holds(step) {
            outside = step;
            break;
        }
        inside = step;
    }
    for _ in 0..20 {
        let middle = 0.5 * (inside + outside);
        if holds(middle) { inside = middle } else { outside = middle }
    }
    0.5 * (inside + outside)
}
