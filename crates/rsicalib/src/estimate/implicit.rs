//! The maximum-likelihood objective (51), with priors.

use std::sync::Mutex;

use crate::estimate::objective::{Noise, Part, add_priors};
use crate::estimate::settle::Room;
use crate::model::{Prior, Want};
use crate::numerics::lanes::{Lanes, dispatch};
use crate::numerics::linearization::{Linearization, Problem};
use crate::numerics::normal_equations::{NormalEquations, Total, over_chunks};
use crate::numerics::workers::lock;

/// The maximum-likelihood objective (51), with priors.
#[derive(Debug)]
pub struct Implicit<'a> {
    parts: Vec<(Part<'a>, Noise)>,
    priors: &'a [Prior],
    /// `â` of every part, the start of the next linearisation.
    adjusted: Mutex<Vec<Vec<Lanes>>>,
}

/// Residuals at a solution, sample by sample.
#[derive(Debug, Clone, Default)]
pub struct Residuals {
    /// Number of equations of one sample.
    pub equations: usize,
    /// `L⁻¹ w`, sample by sample, equation by equation: standard normal for a correct model.
    pub whitened: Vec<f64>,
    /// Misclosure of the raw readings, in length units, sample by sample, equation by equation.
    pub lengths: Vec<f64>,
    /// `L⁻¹ A`, sample by sample, equation by equation, one entry per channel; a fit of a long
    /// recording does not keep it.
    pub by_reading: Vec<f64>,
    /// `L⁻¹ X`, sample by sample, equation by equation, one entry per parameter; empty unless
    /// requested.
    pub by_parameter: Vec<f64>,
    /// Largest number of repeats of (52) in any block; 20, the maximum, where (52) did not converge.
    pub inner: usize,
}

impl<'a> Implicit<'a> {
    /// The objective of readings, their model and their noise. All parts share the parameters of
    /// the first part.
    #[must_use]
    pub fn new(parts: Vec<(Part<'a>, Noise)>, priors: &'a [Prior]) -> Self {
        let adjusted = parts.iter().map(|(part, _)| part.readings.all_raw().to_vec()).collect();
        let adjusted = Mutex::new(adjusted);
        Self { parts, priors, adjusted }
    }

    /// Residuals of the first part at `x`, with [`Residuals::by_parameter`] on request.
    #[must_use]
    pub fn residuals(&self, x: &[f64], by_parameter: bool) -> Residuals {
        let (part, noise) = &self.parts[0];
        let (model, readings) = (part.model, part.readings);
        let (k, c, p) = (model.equations(), readings.channels, model.parameters);
        let lengths = model.lengths();
        let mut out = Residuals {
            equations: k,
            whitened: vec![0.0; readings.samples * k],
            lengths: vec![0.0; readings.samples * k],
            by_reading: vec![0.0; readings.samples * k * c],
            by_parameter: if by_parameter {
                vec![0.0; readings.samples * k * p]
            } else {
                Vec::new()
            },
            inner: 0,
        };
        let mut adjusted = lock(&self.adjusted);
        let mut room = Room::new(model, noise);
        for block in 0..readings.blocks().len() {
            let a_hat = &mut adjusted[0][block * c..(block + 1) * c];
            let raw = readings.raw(block);
            let meta = &readings.blocks()[block];
            let bare = Want { x: false, a: false };
            model.evaluate(readings, block, raw, x, bare, &mut room.ws);
            for (row, lane) in meta.rows.iter().zip(0..meta.live) {
                for (e, length) in lengths.iter().enumerate() {
                    out.lengths[row * k + e] = room.ws.f[e].0[lane] * length;
                }
            }
            out.inner = out.inner.max(room.settle(part, block, x, a_hat, by_parameter));
            room.whiten_readings();
            let weight = part.weight(block);
            for (row, lane) in meta.rows.iter().zip(0..meta.live) {
                let weight = weight.0[lane];
                for e in 0..k {
                    out.whitened[row * k + e] = room.w[e].0[lane] * weight;
                }
                for (i, value) in room.ws.a.iter().enumerate() {
                    out.by_reading[row * k * c + i] = value.0[lane] * weight;
                }
                if by_parameter {
                    for (e, x) in room.ws.x.chunks_exact(model.width().max(1)).enumerate() {
                        for (column, value) in model.columns()[meta.group].iter().zip(x) {
                            out.by_parameter[(row * k + e) * p + column] = value.0[lane] * weight;
                        }
                    }
                }
            }
        }
        out
    }
}

/// What some rows leave.
#[derive(Debug, Clone, Copy, Default)]
pub struct Misfit {
    /// χ².
    pub chi2: f64,
    /// Sum of the squares of the misclosures, length units.
    pub square: f64,
    /// Equations.
    pub equations: f64,
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
                for ((w, f), length) in room.w.iter().zip(&room.ws.f).zip(&lengths) {
                    sum.chi2 += (w.0[lane] * weight.0[lane]).powi(2);
                    sum.square += (f.0[lane] * length).powi(2);
                }
                sum.equations += room.w.len() as f64;
            }
        };
        self.over_blocks(x, &counts, look, |sum: &mut Misfit, other| {
            sum.chi2 += other.chi2;
            sum.square += other.square;
            sum.equations += other.equations;
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
        let channels = part.readings.channels;
        let mut adjusted = lock(&self.adjusted);
        let one = |first: usize, chunk: &mut [Lanes]| {
            let mut room = Room::new(part.model, noise);
            let mut found = S::default();
            for (block, a_hat) in (first..).zip(chunk.chunks_exact_mut(channels)) {
                let meta = &part.readings.blocks()[block];
                if meta.rows[..meta.live].iter().any(|&row| counts(row)) {
                    room.settle(part, block, x, a_hat, false);
                    visit(&mut found, block, &mut room);
                }
            }
            found
        };
        over_chunks(&mut adjusted[0], channels, one, merge).unwrap_or_default()
    }

    /// Visits every block of the first part at `x`, in order. `visit` gets the block's group and the
    /// weighted `L⁻¹ w` and `L⁻¹ X`, equation by equation.
    pub(crate) fn sweep<S: Send>(
        &self,
        x: &[f64],
        zero: impl Fn() -> S + Sync,
        visit: impl Fn(&mut S, usize, &[Lanes], &[Lanes]) + Sync,
        merge: impl FnMut(&mut S, S),
    ) -> Option<S> {
        let (part, noise) = &self.parts[0];
        let channels = part.readings.channels;
        let mut adjusted = lock(&self.adjusted);
        let one = |first: usize, chunk: &mut [Lanes]| {
            dispatch(
                #[inline(always)]
                || {
                    let mut room = Room::new(part.model, noise);
                    let mut sums = zero();
                    for (i, a_hat) in chunk.chunks_exact_mut(channels).enumerate() {
                        room.settle(part, first + i, x, a_hat, true);
                        let weight = part.weight(first + i);
                        for value in room.ws.x.iter_mut().chain(&mut room.w) {
                            *value = *value * weight;
                        }
                        let group = part.readings.blocks()[first + i].group;
                        visit(&mut sums, group, &room.w, &room.ws.x);
                    }
                    sums
                },
            )
        };
        over_chunks(&mut adjusted[0], channels, one, merge)
    }
}

impl Problem for Implicit<'_> {
    fn parameters(&self) -> usize {
        self.parts[0].0.model.parameters
    }

    fn linearize(&self, x: &[f64]) -> Linearization {
        let mut total = Total::new(self.parameters());
        let mut adjusted = lock(&self.adjusted);
        for ((part, noise), adjusted) in self.parts.iter().zip(adjusted.iter_mut()) {
            let (model, readings, channels) = (part.model, part.readings, part.readings.channels);
            let one = |first: usize, chunk: &mut [Lanes]| {
                dispatch(
                    #[inline(always)]
                    || {
                        let mut room = Room::new(model, noise);
                        let mut sums = NormalEquations::new(model.term_parameters, model.width());
                        for (i, a_hat) in chunk.chunks_exact_mut(channels).enumerate() {
                            let block = first + i;
                            room.settle(part, block, x, a_hat, true);
                            let weight = part.weight(block);
                            for value in room.ws.x.iter_mut().chain(&mut room.w) {
                                *value = *value * weight;
                            }
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
