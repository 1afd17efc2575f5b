//! Residuals at a solution and their derivatives, block by block.

use std::ops::Range;

use crate::estimate::objective::Part;
use crate::estimate::settle::Room;
use crate::model::Model;
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::readings::Block;

/// Residuals at a solution, sample by sample.
#[derive(Debug, Clone, Default)]
pub struct Residuals {
    /// Number of equations of one sample.
    pub equations: usize,
    /// `L⁻¹ w`, sample by sample, equation by equation: standard normal for a correct model.
    pub whitened: Vec<f64>,
    /// `L⁻¹ A`, sample by sample, equation by equation, one entry per channel; of a long recording
    /// it is three times the readings, and kept while a fit needs it of [`Residuals::kept`] alone.
    pub by_reading: Vec<f64>,
    /// Samples whose `by_reading` is kept, ascending; `None` where it is kept of all.
    pub kept: Option<Vec<usize>>,
    /// Share of the variance of `whitened` that is from the readings, play aside, by the noise that
    /// whitens it.
    pub readings_share: f64,
    /// Sum of the squares of the weights of all equations, of which that is a share.
    weights: f64,
    /// True where play is part of the noise that whitens it.
    pub play: bool,
    /// Number of directions in which each sample's residual is told, the first of its equations; empty
    /// where it is told in all.
    pub directions: Vec<usize>,
    /// `L⁻¹ X`, sample by sample, equation by equation, one entry per parameter; empty unless
    /// requested.
    pub by_parameter: Vec<f64>,
    /// `L⁻¹ ∂f/∂x` by a length that each equation errs by, sample by sample, equation by equation;
    /// without weights, and empty unless requested.
    pub by_closure: Vec<f64>,
    /// Largest number of repeats of (52) in any block; 20, the maximum, where (52) did not converge.
    pub inner: usize,
}

/// Entries of one sample.
pub(super) struct Sizes {
    equations: usize,
    by_reading: usize,
    by_parameter: usize,
    by_closure: usize,
}

impl Sizes {
    /// With what closures do, too.
    pub(super) fn with_closures(self) -> Self {
        Self { by_closure: self.equations * self.equations, ..self }
    }

    pub(super) fn of(model: &Model, channels: usize, by_parameter: bool) -> Self {
        let equations = model.equations();
        let parameters = if by_parameter { model.parameters } else { 0 };
        let (by_reading, by_parameter) = (equations * channels, equations * parameters);
        Self { equations, by_reading, by_parameter, by_closure: 0 }
    }
}

impl Residuals {
    /// Zero, with room for derivatives by readings of the samples `kept`, or of all.
    pub(super) fn zero(sizes: &Sizes, samples: usize, kept: Option<&[usize]>) -> Self {
        let with_readings = kept.map_or(samples, <[usize]>::len);
        Self {
            equations: sizes.equations,
            whitened: vec![0.0; samples * sizes.equations],
            by_reading: vec![0.0; with_readings * sizes.by_reading],
            kept: kept.map(<[usize]>::to_vec),
            readings_share: 0.0,
            weights: 0.0,
            play: false,
            directions: Vec::new(),
            by_parameter: vec![0.0; samples * sizes.by_parameter],
            by_closure: vec![0.0; samples * sizes.by_closure],
            inner: 0,
        }
    }

    /// Number of directions in which a sample's residual is told.
    #[must_use]
    pub fn directions_of(&self, row: usize) -> usize {
        self.directions.get(row).copied().unwrap_or(self.equations)
    }

    /// The equations in which a sample's residual is told: the first, but for those that are zero because
    /// their closures do not hold.
    #[must_use]
    pub fn told(&self, row: usize) -> Vec<usize> {
        let (k, count) = (self.equations, self.directions_of(row));
        let zero = |e: &usize| count < k && self.whitened[row * k + e] == 0.0;
        let mut all: Vec<usize> = (0..k).filter(|e| !zero(e)).collect();
        // Of a sample that closes to the last digit all are zero.
        if all.len() < count {
            all = (0..k).collect();
        }
        all.truncate(count);
        all
    }

    /// Takes the derivatives by some parameters out of `by_parameter`, and gives them, equation by equation.
    pub(super) fn take_parameters(&mut self, of: Range<usize>) -> Vec<f64> {
        if of.is_empty() || self.whitened.is_empty() {
            return Vec::new();
        }
        let width = self.by_parameter.len() / self.whitened.len().max(1);
        let (mut taken, mut rest) = (Vec::new(), Vec::new());
        for row in self.by_parameter.chunks_exact(width) {
            taken.extend_from_slice(&row[of.clone()]);
            rest.extend_from_slice(&row[..of.start]);
            rest.extend_from_slice(&row[of.end..]);
        }
        self.by_parameter = rest;
        taken
    }

    /// Place of a sample among those whose `by_reading` is kept.
    fn place_of(&self, row: usize) -> Option<usize> {
        self.kept.as_ref().map_or(Some(row), |kept| kept.binary_search(&row).ok())
    }

    /// `L⁻¹ A` of a sample, equation by equation, one entry for each of so many channels; empty where
    /// it is not kept.
    #[must_use]
    pub fn by_reading_of(&self, row: usize, channels: usize) -> &[f64] {
        let size = self.equations * channels;
        let kept = self.place_of(row).map(|k| k * size..(k + 1) * size);
        kept.and_then(|kept| self.by_reading.get(kept)).unwrap_or_default()
    }

    /// Takes the samples of a block, lane by lane, as number `i` of some blocks.
    #[expect(clippy::too_many_arguments, reason = "a block at a point, and the room to find it in")]
    pub(super) fn take(
        &mut self,
        part: &Part,
        room: &mut Room,
        sizes: &Sizes,
        i: usize,
        block: usize,
        x: &[f64],
        a_hat: &mut [Lanes],
    ) {
        let (model, readings, k) = (part.model, part.readings, sizes.equations);
        let by_parameter = sizes.by_parameter > 0;
        let meta = &readings.blocks()[block];
        let weight = part.weight(block);
        self.inner = self.inner.max(room.settle(part, block, x, a_hat, by_parameter));
        room.whiten_readings();
        if sizes.by_closure > 0 {
            room.whiten_closures();
        }
        self.play |= room.plays();
        let told = |lane: usize| model.told(readings, meta.rows[lane]) as f64;
        let weights: f64 = (0..meta.live).map(|lane| told(lane) * (weight * weight).0[lane]).sum();
        self.weights += weights;
        if self.weights > 0.0 {
            let own = room.variance_of_readings(weight, meta.live) - weights * self.readings_share;
            self.readings_share += own / self.weights;
        }
        for (sample, lane) in (i * WIDTH..).zip(0..meta.live) {
            let weight = weight.0[lane];
            for e in 0..k {
                self.whitened[sample * k + e] = room.w[e].0[lane] * weight;
            }
            for (j, value) in room.by_closure.iter().enumerate().take(sizes.by_closure) {
                self.by_closure[sample * sizes.by_closure + j] = value.0[lane];
            }
            for (j, value) in room.ws.a.iter().enumerate() {
                self.by_reading[sample * sizes.by_reading + j] = value.0[lane] * weight;
            }
            if by_parameter {
                let p = model.parameters;
                for (e, x) in room.ws.x.chunks_exact(model.width().max(1)).enumerate() {
                    for (column, value) in model.columns()[meta.group].iter().zip(x) {
                        let at = sample * sizes.by_parameter + e * p + column;
                        self.by_parameter[at] = value.0[lane] * weight;
                    }
                }
            }
        }
    }

    /// Puts the samples of some blocks, lane by lane, at the rows of these.
    pub(super) fn place(&mut self, here: &Self, sizes: &Sizes, blocks: &[Block]) {
        self.inner = self.inner.max(here.inner);
        self.play |= here.play;
        self.weights += here.weights;
        if self.weights > 0.0 {
            let own = here.readings_share - self.readings_share;
            self.readings_share += here.weights * own / self.weights;
        }
        let count = here.whitened.len() / (WIDTH * sizes.equations).max(1);
        for (i, meta) in blocks.iter().take(count).enumerate() {
            for (sample, &row) in (i * WIDTH..).zip(&meta.rows[..meta.live]) {
                let place = self.place_of(row);
                let copy = |into: &mut [f64], to: usize, from: &[f64], size: usize| {
                    let from = &from[sample * size..(sample + 1) * size];
                    into[to * size..(to + 1) * size].copy_from_slice(from);
                };
                copy(&mut self.whitened, row, &here.whitened, sizes.equations);
                if let Some(place) = place {
                    copy(&mut self.by_reading, place, &here.by_reading, sizes.by_reading);
                }
                copy(&mut self.by_parameter, row, &here.by_parameter, sizes.by_parameter);
                copy(&mut self.by_closure, row, &here.by_closure, sizes.by_closure);
            }
        }
    }
}
