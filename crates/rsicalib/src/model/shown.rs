//! Where a session shows that a mechanism can be.
//!
//! Belts, legs and slides end somewhere that no drawing tells. Where the file declares neither `limits` nor `range`
//! of such a channel, it is taken to reach what it has read in the session, and a tenth of that beyond either end.
//! The same holds of what is unknown in one pose alone. A point that measured lengths hold stays
//! between their other ends, or where it has been.

use crate::model::compiled::Model;
use crate::model::ends::End;
use crate::model::workspace::{Want, Workspace};
use crate::readings::Readings;

/// How far beyond what a session shows, as a share of that.
const BEYOND: f64 = 0.1;

/// Lowest and highest value.
type Span = [f64; 2];

/// Where a mechanism has been, and a little beyond.
#[derive(Debug, Clone)]
pub(crate) struct Shown {
    /// Lowest and highest reading of each channel; none where it is declared, or a joint turns.
    pub(crate) channels: Vec<Option<Span>>,
    /// Lowest and highest of each coordinate that is unknown in one pose alone.
    pub(crate) places: Vec<Span>,
}

impl Shown {
    /// By the rows of a session with a weight above zero; none where no channel reads a length, and the file tells how
    /// far all goes.
    pub(crate) fn by(
        model: &Model,
        (readings, weights): (&Readings, &[f64]),
        beta: &[f64],
    ) -> Option<Self> {
        let mechanism = &model.mechanism;
        let count = mechanism.channels.len();
        if !(0..count).any(|c| mechanism.measures(c) || mechanism.goes_anywhere(c)) {
            return None;
        }
        let mut been = vec![NOWHERE; model.stride()];
        let mut ends = vec![NOWHERE; model.pose_unknowns()];
        let mut ws = Workspace::default();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let raw = readings.raw(block);
            model.evaluate(readings, block, raw, beta, Want { x: false, a: false }, &mut ws);
            let rows = meta.rows.iter().enumerate().take(meta.live);
            for (lane, _) in rows.filter(|(_, row)| weights[**row] > 0.0) {
                let at = raw.iter().chain(&ws.xi).map(|at| at.0[lane]);
                been.iter_mut().zip(at).for_each(|(span, at)| *span = with(*span, at));
            }
            for (slot, at) in model.held_between(readings, block, beta, &ws) {
                ends[slot] = with(ends[slot], at);
            }
        }
        let places = been.split_off(count);
        let channel = |(c, span): (usize, Span)| {
            mechanism.goes_anywhere(c).then(|| beyond(span, BEYOND * long(&span)))
        };
        let channels = been.into_iter().enumerate().map(channel).collect();
        // A nozzle on a bed moves along it: of alike coordinates the one that moved most tells the margin.
        let turns = model.posed.turns();
        let most = |turned: bool| {
            let alike = (0..places.len()).filter(|k| turns.contains(k) == turned);
            alike.map(|k| long(&places[k])).fold(0.0, f64::max)
        };
        let margins = [false, true].map(|turned| BEYOND * most(turned));
        let place = |(k, (span, ends)): (usize, (&Span, &Span))| {
            let [low, high] = beyond(*span, margins[usize::from(turns.contains(&k))]);
            match ends[0] <= ends[1] {
                true => [low.max(span[0].min(ends[0])), high.min(span[1].max(ends[1]))],
                false => [low, high],
            }
        };
        let places = places.iter().zip(&ends).enumerate().map(place).collect();
        Some(Self { channels, places })
    }

    /// True where what is unknown in a pose is within what was shown.
    pub(crate) fn holds(&self, mut places: impl Iterator<Item = f64>) -> bool {
        self.places.iter().all(|[low, high]| places.next().is_none_or(|v| v >= *low && v <= *high))
    }
}

impl Model {
    /// Coordinates of a pose, and where along them the ends are that stand still of the measured lengths that
    /// hold the point.
    fn held_between(
        &self,
        readings: &Readings,
        block: usize,
        beta: &[f64],
        ws: &Workspace,
    ) -> Vec<(usize, f64)> {
        let (group, seen) = (readings.blocks()[block].group, readings.columns(block));
        let mut found = Vec::new();
        for closure in self.closures.iter().filter(|c| c.channel.is_some()) {
            let (number, other) = match closure.ends {
                [End::Posed(number), other] | [other, End::Posed(number)] => (number, other),
                _ => continue,
            };
            let posed = &self.posed.points[number];
            if posed.body.is_none() && matches!(other, End::Fixed(_) | End::Unknown(..)) {
                let at = self.end_point(&other, group, seen, beta, ws);
                let slots = posed.slots.iter().zip(at);
                found.extend(slots.filter_map(|(slot, at)| Some(((*slot)?, at.0[0]))));
            }
        }
        found
    }
}

/// No value yet.
const NOWHERE: Span = [f64::INFINITY, f64::NEG_INFINITY];

/// Lowest and highest of these values, and a tenth of what is between them beyond either end.
pub(crate) fn reaching(values: impl Iterator<Item = f64>) -> Span {
    let span = values.fold(NOWHERE, with);
    beyond(span, BEYOND * long(&span))
}

fn with([low, high]: Span, value: f64) -> Span {
    [low.min(value), high.max(value)]
}

fn long([low, high]: &Span) -> f64 {
    (high - low).max(0.0)
}

fn beyond([low, high]: Span, margin: f64) -> Span {
    [low - margin, high + margin]
}
