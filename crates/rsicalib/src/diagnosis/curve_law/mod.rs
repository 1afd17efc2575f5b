//! The law behind a free curve: which closed form explains as much, if any does.
//!
//! Beside the fit without the curve each form is scored by (72), its shape (an order, a place, a
//! width) searched for on a grid and then refined. A form may be the law where waves of any shape
//! explain no more than chance would have them explain. Of these the one that explains most is named, parameters and
//! search paid for.

mod forms;

use self::forms::{FORMS, Form, Joints, Measures, WIDEST, any};
use crate::diagnosis::price::charge;
use crate::diagnosis::score::room::{LawScore, Room};
use crate::diagnosis::score::scored::Judge;
use crate::estimate::angles::Angles;
use crate::estimate::at_fit::AtFit;
use crate::estimate::directions::unit;
use crate::estimate::{Fit, Observations};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::credible_set::AS_WELL;
use crate::numerics::order;
use crate::numerics::order::Ends;
use crate::numerics::search::{edge, highest};
use crate::readings::Block;
use crate::terms::term::Over;

/// The closed form behind a free curve.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct CurveLaw {
    /// Name of the form; null where no form that is known is the law.
    pub form: Option<String>,
    /// What the curve does, in words.
    pub text: String,
    /// What was searched for, then the amplitudes.
    #[cfg_attr(feature = "serde", serde(default))]
    pub parameters: Vec<LawParameter>,
    /// Other forms that fit as well.
    #[cfg_attr(feature = "serde", serde(default))]
    pub also_fits: Vec<String>,
}

/// A number of a closed form.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct LawParameter {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Values between which it lies with 95 % probability.
    pub interval: [f64; 2],
    /// Unit of all three.
    pub unit: String,
}

/// Places that samples are gathered at, at the most: a recording has many that are alike.
const PLACES: usize = 1024;

/// Waves that make any smooth curve, twice as short as those of the free curve.
const WAVES: usize = 12;

/// What is left beside a form is noise where chance leaves as much this often.
const LEFT: f64 = 0.01;

/// By how much χ² rises where an interval of 95 % probability ends.
const WITHIN: f64 = 3.84;

/// Standard deviations to either side of 95 % probability.
const SIDES: f64 = 1.96;

/// The closed form behind a free curve of one channel; none where the instance is no such curve.
///
/// `without` is the fit of the session without the curve.
pub(crate) fn curve_law(
    observations: &Observations,
    without: &Fit,
    judge: &Judge,
    curve: &Instance,
) -> Option<CurveLaw> {
    let Target::Channel(channel) = curve.target else { return None };
    let over = curve.term.over().filter(|_| curve.term.info().penalised)?;
    let scale = Abscissa::new(observations, without, channel, over)?;
    let room = &scale.room;
    let joints = match observations.mechanism.slides_at(curve.target) {
        true => Joints::Sliding,
        false => Joints::Turning,
    };
    let there = |form: &&Form| form.over == over && [Joints::Any, joints].contains(&form.joints);
    let fitted = FORMS.iter().filter(there).map(|form| Fitted::new(&scale, form));
    let waves = room.score(WAVES, |x, out| any((x - room.low) / (room.high - room.low), out));
    let mut laws: Vec<Fitted> = fitted.filter(|law| law.left(&waves, judge) > LEFT).collect();
    order::descending(&mut laws, |a| a.value);
    let Some(first) = laws.first() else {
        let text = "no closed form that is known here is its law".into();
        return Some(CurveLaw { form: None, text, parameters: Vec::new(), also_fits: Vec::new() });
    };
    let as_well = laws[1..].iter().filter(|other| other.value > first.value - AS_WELL);
    Some(CurveLaw {
        form: Some(first.form.name.into()),
        text: first.form.words.into(),
        parameters: first.parameters(observations, curve),
        also_fits: as_well.map(|other| other.form.name.into()).collect(),
    })
}

/// What a curve runs over, and its samples along that.
struct Abscissa {
    room: Room,
    /// Readings from the middle of the range in one unit of `x`; 1 over time.
    per_x: f64,
    /// The reading at `x = 0`; 0 over time.
    zero: f64,
}

impl Abscissa {
    /// None where the channel's readings are all alike.
    fn new(observations: &Observations, without: &Fit, channel: usize, over: Over) -> Option<Self> {
        let Observations { readings, weights, .. } = observations;
        let angles = Angles::of(&observations.readings, &without.model, &without.beta);
        let live: Vec<usize> = (0..readings.samples).filter(|&row| weights[row] > 0.0).collect();
        let slope = live.iter().map(|&r| angles.slope(r, channel)).sum::<f64>() / live.len() as f64;
        let middle = without.model.scales[channel].middle;
        let (per_x, zero) = match over {
            Over::Reading => (slope.recip(), middle),
            Over::Time => (1.0, 0.0),
        };
        let samples: Vec<(f64, usize)> = match over {
            Over::Reading => {
                let x = |row: usize| (readings.row(row)[channel] - middle) * slope;
                live.iter().map(|&row| (x(row), row)).collect()
            }
            Over::Time => {
                let of = |b: &Block| {
                    let rows = b.rows.iter().take(b.live).enumerate();
                    rows.map(|(lane, &row)| (b.time.0[lane], row)).collect::<Vec<_>>()
                };
                let all = readings.blocks().iter().flat_map(of);
                all.filter(|(_, row)| weights[*row] > 0.0).collect()
            }
        };
        let at = AtFit::new(observations, without);
        let room = Room::new(&at, &angles, channel, samples, PLACES)?;
        per_x.is_finite().then_some(Self { room, per_x, zero })
    }
}

/// A form at its best shape.
struct Fitted<'a> {
    scale: &'a Abscissa,
    form: &'a Form,
    grid: Vec<Vec<f64>>,
    shape: Vec<f64>,
    scored: LawScore,
    /// The score, parameters and search paid for.
    value: f64,
}

impl<'a> Fitted<'a> {
    /// The form at the shape that explains most: on the grid, then between its neighbours.
    fn new(scale: &'a Abscissa, form: &'a Form) -> Self {
        let room = &scale.room;
        let grid = (form.grid)(room.low, room.high);
        let shapes = product(&grid);
        let tried = shapes.len();
        let score = |shape: &Vec<f64>| at(room, form, shape).score;
        let best = shapes.into_iter().map(|shape| (score(&shape), shape));
        let (_, shape) = best.greatest_by(|a| a.0).unwrap_or_default();
        let mut fitted =
            Self { scale, form, grid, scored: at(room, form, &shape), shape, value: 0.0 };
        // Entry by entry; each time the others have moved.
        for _ in 0..fitted.shape.len() {
            (0..fitted.shape.len()).for_each(|k| fitted.refine(k));
        }
        let parameters = (form.amplitudes.len() + fitted.shape.len()) as f64;
        let score = fitted.scored.score;
        fitted.value = score - charge(parameters, score) - 2.0 * (tried as f64).ln();
        fitted
    }

    /// Moves one entry of the shape to where the score is highest between its neighbours.
    fn refine(&mut self, k: usize) {
        let (value, score) = highest(|v| self.with(k, v), self.around(k));
        if score > self.scored.score {
            self.shape[k] = value;
            self.scored = at(&self.scale.room, self.form, &self.shape);
        }
    }

    /// The values of the grid on both sides of an entry.
    fn around(&self, k: usize) -> [f64; 2] {
        let below = self.grid[k].iter().copied().filter(|v| *v < self.shape[k]);
        let above = self.grid[k].iter().copied().filter(|v| *v > self.shape[k]);
        [below.fold(f64::NAN, f64::max), above.fold(f64::NAN, f64::min)]
            .map(|end| if end.is_nan() { self.shape[k] } else { end })
    }

    /// The score with another value of one entry.
    fn with(&self, k: usize, value: f64) -> f64 {
        let mut shape = self.shape.clone();
        shape[k] = value;
        at(&self.scale.room, self.form, &shape).score
    }

    /// Probability that chance makes waves explain so much more than the form. Not both together:
    /// where the form is the law, waves repeat it nearly, and their sum hangs on small differences.
    fn left(&self, waves: &LawScore, judge: &Judge) -> f64 {
        let more = (waves.score - self.scored.score).max(0.0);
        judge.p_value(more, (waves.rank - self.scored.rank).max(1.0))
    }

    /// The shape and the amplitudes, with their intervals and units.
    fn parameters(&self, observations: &Observations, curve: &Instance) -> Vec<LawParameter> {
        let unit = |of: &str| unit(observations, curve, of);
        let shape = self.form.shape.iter().enumerate().map(|(k, &(name, measures))| {
            let value = self.shape[k];
            let inside = |v: f64| self.with(k, v) > self.scored.score - WITHIN;
            let (first, last) = (self.grid[k][0], self.grid[k][self.grid[k].len() - 1]);
            let ends = [edge(inside, value, first.min(last)), edge(inside, value, first.max(last))];
            let scaled = |v: f64| self.scaled(measures, v);
            let mut interval = ends.map(scaled);
            order::sort(&mut interval);
            let unit = match (measures, self.form.over) {
                (Measures::PerTurn, _) => "1/turn".into(),
                (Measures::Phase, _) => "1".into(),
                (_, Over::Reading) => unit("reading"),
                (_, Over::Time) => "session".into(),
            };
            LawParameter { name: name.into(), value: scaled(value), interval, unit }
        });
        let amplitudes = self.form.amplitudes.iter().zip(&self.scored.amplitudes);
        let amplitudes = amplitudes.map(|(name, &[value, sd])| LawParameter {
            name: (*name).into(),
            value,
            interval: [value - SIDES * sd, value + SIDES * sd],
            unit: match (*name, self.form.over) {
                ("c2", _) => unit("1/rad"),
                ("c3", _) => unit("1/rad²"),
                ("slope" | "low" | "high", Over::Reading) => "1".into(),
                _ => unit("rad"),
            },
        });
        shape.chain(amplitudes).collect()
    }

    /// An entry of a shape in the units that users read.
    fn scaled(&self, measures: Measures, value: f64) -> f64 {
        match measures {
            Measures::Place => self.scale.zero + value * self.scale.per_x,
            Measures::Extent => value * self.scale.per_x.abs(),
            Measures::PerTurn | Measures::Phase => value,
        }
    }
}

fn at(room: &Room, form: &Form, shape: &[f64]) -> LawScore {
    let width = form.amplitudes.len();
    debug_assert!(width <= WIDEST);
    room.score(width, |x, out| (form.columns)(x, shape, out))
}

/// All combinations of one value of each; one empty combination of nothing.
fn product(values: &[Vec<f64>]) -> Vec<Vec<f64>> {
    values.iter().fold(vec![Vec::new()], |all, entry| {
        let longer = |head: &Vec<f64>| {
            let with = |v: &f64| head.iter().copied().chain([*v]).collect();
            entry.iter().map(with).collect::<Vec<Vec<f64>>>()
        };
        all.iter().flat_map(longer).collect()
    })
}
