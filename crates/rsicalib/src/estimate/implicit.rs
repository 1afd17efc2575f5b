//! The maximum-likelihood objective (51), with priors.

use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::estimate::noise::seating::Seatings;
use crate::estimate::objective::{Noise, Part, add_priors};
use crate::estimate::residuals::{Residuals, Sizes};
use crate::estimate::settle::{Closing, Room};
use crate::model::{Model, Prior, Want};
use crate::numerics::lanes::{Lanes, WIDTH, dispatch};
use crate::numerics::linearization::{Linearization, Problem};
use crate::numerics::normal_equations::{NormalEquations, Total, over_chunks};
use crate::numerics::workers::lock;

/// The maximum-likelihood objective (51), with priors.
#[derive(Debug)]
pub struct Implicit<'a> {
    parts: Vec<(Part<'a>, Noise)>,
    /// The seatings of every part.
    seatings: Vec<Seatings>,
    priors: &'a [Prior],
    /// `â` of every part, the start of the next linearisation; empty before the first.
    adjusted: Mutex<Vec<Vec<Lanes>>>,
    /// True for linearisations at readings that have not quite settled.
    coarse: bool,
    /// Variance of each equation beside that of the noise, while a start is looked for.
    slack: &'a [f64],
}

impl<'a> Implicit<'a> {
    /// The objective of one part, without priors.
    #[must_use]
    pub(crate) fn of(part: Part<'a>, noise: Noise) -> Self {
        Self::new(vec![(part, noise)], &[])
    }

    /// The objective of readings, their model and their noise. All parts share the parameters of
    /// the first part.
    #[must_use]
    pub fn new(parts: Vec<(Part<'a>, Noise)>, priors: &'a [Prior]) -> Self {
        let adjusted = Mutex::new(vec![Vec::new(); parts.len()]);
        let seatings = parts.iter().map(|(part, noise)| Seatings::of(part, noise)).collect();
        Self { parts, seatings, priors, adjusted, coarse: false, slack: &[] }
    }

    /// The same, with `â` of the first part from earlier to start at.
    #[must_use]
    pub(crate) fn from(mut self, adjusted: Option<Vec<Lanes>>) -> Self {
        if let Some(earlier) = adjusted {
            self.adjusted.get_mut().unwrap_or_else(PoisonError::into_inner)[0] = earlier;
        }
        self
    }

    /// `â` of every part: the readings as they are, before they have been settled.
    fn adjusted(&self) -> MutexGuard<'_, Vec<Vec<Lanes>>> {
        let mut adjusted = lock(&self.adjusted);
        for ((part, _), adjusted) in self.parts.iter().zip(adjusted.iter_mut()) {
            if adjusted.is_empty() {
                *adjusted = part.starts();
            }
        }
        adjusted
    }

    /// The same, for a search: a minimum is looked for with readings that have not quite settled.
    #[must_use]
    pub(crate) fn coarse(self) -> Self {
        Self { coarse: true, ..self }
    }

    /// The same, at settled readings again.
    #[must_use]
    pub(crate) fn precise(self) -> Self {
        Self { coarse: false, ..self }
    }

    /// The same with so much more variance of each equation, in its own unit.
    #[must_use]
    pub(crate) fn eased(self, slack: &'a [f64]) -> Self {
        Self { slack, ..self }
    }

    /// `â` of the first part.
    #[must_use]
    pub(crate) fn into_adjusted(self) -> Vec<Lanes> {
        self.adjusted.into_inner().unwrap_or_else(PoisonError::into_inner).swap_remove(0)
    }

    /// Takes the other place of what is unknown in a pose, (169), where the objective at `x` is less there by
    /// more than chance; true where it has taken one.
    pub(crate) fn crosses(&self, x: &[f64]) -> bool {
        let mut adjusted = self.adjusted();
        let parts = self.parts.iter().zip(&self.seatings).zip(adjusted.iter_mut());
        let crossed = parts.map(|(((part, noise), seatings), adjusted)| {
            let one = |first: usize, chunk: &mut [Lanes]| {
                let mut room = Room::new(part.model, noise);
                let mut crossed = false;
                for (block, at) in (first..).zip(chunk.chunks_exact_mut(part.stride())) {
                    room.seat(seatings.of_block(part.readings, block));
                    crossed |= !part.leaves_out(block) && room.cross(part, block, x, at);
                }
                crossed
            };
            over_chunks(adjusted, part.stride(), one, |all, one| *all |= one).unwrap_or_default()
        });
        // Every part is looked at.
        crossed.fold(false, |all, one| all | one)
    }

    /// Residuals of the first part at `x`, with [`Residuals::by_parameter`] on request.
    #[must_use]
    pub fn residuals(&self, x: &[f64], by_parameter: bool) -> Residuals {
        self.residuals_keeping(x, by_parameter, None)
    }

    /// The same, with [`Residuals::by_reading`] of the samples `kept` alone, ascending, where some
    /// are named.
    #[must_use]
    pub(crate) fn residuals_keeping(
        &self,
        x: &[f64],
        by_parameter: bool,
        kept: Option<&[usize]>,
    ) -> Residuals {
        let (part, _) = &self.parts[0];
        let sizes = Sizes::of(part.model, part.readings.channels, by_parameter);
        self.gather(x, &sizes, kept)
    }

    /// Residuals with all that a variance of closures needs, [`Residuals::by_closure`].
    #[must_use]
    pub(crate) fn residuals_by_closure(&self, x: &[f64]) -> Residuals {
        let (part, _) = &self.parts[0];
        let sizes = Sizes::of(part.model, part.readings.channels, true).with_closures();
        self.gather(x, &sizes, None)
    }

    fn gather(&self, x: &[f64], sizes: &Sizes, kept: Option<&[usize]>) -> Residuals {
        let (part, noise) = &self.parts[0];
        let (model, readings) = (part.model, part.readings);
        let channels = part.stride();
        let mut out = Residuals::zero(sizes, readings.samples, kept);
        let mut adjusted = self.adjusted();
        // So many blocks at a time: their residuals stand beside those of all rows until they are
        // put in their places.
        for (wave, some) in adjusted[0].chunks_mut(WAVE * channels).enumerate() {
            let one = |first: usize, chunk: &mut [Lanes]| {
                let blocks = chunk.len() / channels;
                let mut room = Room::new(model, noise);
                let mut here = Residuals::zero(sizes, blocks * WIDTH, None);
                for (i, a_hat) in chunk.chunks_exact_mut(channels).enumerate() {
                    let block = wave * WAVE + first + i;
                    room.seat(self.seatings[0].of_block(readings, block));
                    here.take(part, &mut room, sizes, i, block, x, a_hat);
                }
                vec![(wave * WAVE + first, here)]
            };
            let parts = over_chunks(some, channels, one, Vec::extend).unwrap_or_default();
            for (first, here) in parts {
                out.place(&here, sizes, &readings.blocks()[first..]);
            }
        }
        if !readings.holding.is_whole() {
            out.directions = (0..readings.samples).map(|row| model.told(readings, row)).collect();
        }
        out
    }
}

/// Blocks whose residuals are found at a time.
const WAVE: usize = 4096;

/// What some rows leave.
#[derive(Debug, Clone, Copy, Default)]
pub struct Misfit {
    /// χ².
    pub chi2: f64,
    /// Sum of the squares of the misclosures, length units.
    pub square: f64,
    /// Equations, without those that what is unknown in a pose takes up.
    pub equations: f64,
    /// Misclosures: the equations with them.
    pub misclosures: f64,
}

impl Implicit<'_> {
    /// What the rows of the first part leave at `x` that count.
    #[must_use]
    pub fn misfit(&self, x: &[f64], counts: impl Fn(usize) -> bool + Sync) -> Misfit {
        let (part, _) = &self.parts[0];
        let (model, readings) = (part.model, part.readings);
        let lengths = model.lengths();
        let look = |sum: &mut Misfit, block: usize, room: &mut Room| {
            let meta = &readings.blocks()[block];
            let lanes = (0..meta.live).filter(|&lane| counts(meta.rows[lane]));
            let weight = part.weight(block);
            let bare = Want { x: false, a: false };
            model.evaluate(readings, block, readings.raw(block), x, bare, &mut room.ws);
            for lane in lanes {
                for w in &room.w {
                    sum.chi2 += (w.0[lane] * weight.0[lane]).powi(2);
                }
                for (f, length) in room.ws.f.iter().zip(&lengths) {
                    sum.square += (f.0[lane] * length).powi(2);
                }
                sum.equations += model.told(readings, meta.rows[lane]) as f64;
                sum.misclosures += model.misclosures(readings, meta.rows[lane]) as f64;
            }
        };
        self.over_blocks(x, &counts, look, |sum: &mut Misfit, other| {
            sum.chi2 += other.chi2;
            sum.square += other.square;
            sum.equations += other.equations;
            sum.misclosures += other.misclosures;
        })
    }

    /// Visits the blocks of the first part in which some rows count, settled at `x`, and merges what
    /// was found in their order.
    pub(crate) fn over_blocks<S: Send + Default>(
        &self,
        x: &[f64],
        counts: impl Fn(usize) -> bool + Sync,
        visit: impl Fn(&mut S, usize, &mut Room) + Sync,
        merge: impl FnMut(&mut S, S),
    ) -> S {
        let (part, noise) = &self.parts[0];
        let channels = part.stride();
        let mut adjusted = self.adjusted();
        let one = |first: usize, chunk: &mut [Lanes]| {
            let mut room = Room::new(part.model, noise);
            let mut found = S::default();
            for (block, a_hat) in (first..).zip(chunk.chunks_exact_mut(channels)) {
                let meta = &part.readings.blocks()[block];
                if meta.rows[..meta.live].iter().any(|&row| counts(row)) {
                    room.seat(self.seatings[0].of_block(part.readings, block));
                    room.settle(part, block, x, a_hat, false);
                    visit(&mut found, block, &mut room);
                }
            }
            found
        };
        over_chunks(&mut adjusted[0], channels, one, merge).unwrap_or_default()
    }

    /// Visits every block of the first part, in order. A model at its parameters `beta` settles the
    /// readings, and the model of the part, which has terms more that are zero in `x`, is linearised
    /// there. `visit` gets the block's group and the weighted `L⁻¹ w` and `L⁻¹ X`, equation by
    /// equation.
    pub(crate) fn sweep<S: Send>(
        &self,
        (model, beta): (&Model, &[f64]),
        x: &[f64],
        zero: impl Fn() -> S + Sync,
        visit: impl Fn(&mut S, usize, &[Lanes], &[Lanes]) + Sync,
        finish: impl Fn(&mut S) + Sync,
        merge: impl FnMut(&mut S, S),
    ) -> Option<S> {
        let (part, noise) = &self.parts[0];
        let own = Part { model, ..*part };
        let readings = part.readings;
        let moved = Closing::noise(&own, noise);
        let mut adjusted = self.adjusted();
        let one = |first: usize, chunk: &mut [Lanes]| {
            dispatch(
                #[inline(always)]
                || {
                    let mut settling = Room::new(own.model, noise);
                    let mut room = Room::new(part.model, noise);
                    let mut closing = moved.as_ref().map(|noise| Closing::new(own.model, noise));
                    let mut sums = zero();
                    for (block, a_hat) in (first..).zip(chunk.chunks_exact_mut(part.stride())) {
                        let seated = self.seatings[0].of_block(readings, block);
                        settling.seat(seated);
                        room.seat(seated);
                        settling.settle(&own, block, beta, a_hat, false);
                        let at = match &mut closing {
                            Some(closing) => closing.close(&own, block, beta, a_hat),
                            None => a_hat,
                        };
                        room.linearise(part, block, readings.raw(block), x, at, 0);
                        room.weigh(part.weight(block));
                        visit(&mut sums, readings.blocks()[block].group, &room.w, &room.ws.x);
                    }
                    finish(&mut sums);
                    sums
                },
            )
        };
        over_chunks(&mut adjusted[0], part.stride(), one, merge)
    }
}

impl Problem for Implicit<'_> {
    fn parameters(&self) -> usize {
        self.parts[0].0.model.parameters
    }

    fn moved(&self, x: &[f64], step: &[f64]) -> Vec<f64> {
        self.parts[0].0.model.moved(x, step)
    }

    fn linearize(&self, x: &[f64]) -> Linearization {
        let mut total = Total::new(self.parameters());
        let mut adjusted = self.adjusted();
        let parts = self.parts.iter().zip(&self.seatings);
        for (((part, noise), seatings), adjusted) in parts.zip(adjusted.iter_mut()) {
            let (model, readings, channels) = (part.model, part.readings, part.stride());
            let one = |first: usize, chunk: &mut [Lanes]| {
                dispatch(
                    #[inline(always)]
                    || {
                        let mut room = match self.coarse {
                            true => Room::coarse(model, noise),
                            false => Room::new(model, noise),
                        };
                        room.ease(self.slack);
                        let mut sums = NormalEquations::new(model.term_parameters, model.width());
                        for (i, a_hat) in chunk.chunks_exact_mut(channels).enumerate() {
                            let block = first + i;
                            if part.leaves_out(block) {
                                continue;
                            }
                            room.seat(seatings.of_block(readings, block));
                            room.settle(part, block, x, a_hat, true);
                            room.weigh(part.weight(block));
                            let group = readings.blocks()[block].group;
                            sums.add(group, &room.w, &room.ws.x);
                        }
                        sums
                    },
                )
            };
            if let Some(sums) = over_chunks(adjusted, channels, one, |a, b| a.merge(&b)) {
                total.add(&sums, model.columns());
            }
        }
        let mut here = total.finish();
        add_priors(&mut here, self.priors, self.parts[0].0.model, x);
        here
    }
}
