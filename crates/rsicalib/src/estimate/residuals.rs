//! Residuals at a solution and their derivatives, block by block.

use crate::estimate::objective::Part;
use crate::estimate::settle::Room;
use crate::model::{Model, Want};
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::readings::Block;

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

/// Entries of one sample.
pub(super) struct Sizes {
    equations: usize,
    by_reading: usize,
    by_parameter: usize,
    /// Unit of each equation.
    lengths: Vec<f64>,
}

impl Sizes {
    pub(super) fn of(model: &Model, channels: usize, by_parameter: bool) -> Self {
        let equations = model.equations();
        let parameters = if by_parameter { model.parameters } else { 0 };
        let (by_reading, by_parameter) = (equations * channels, equations * parameters);
        Self { equations, by_reading, by_parameter, lengths: model.lengths() }
    }
}

impl Residuals {
    pub(super) fn zero(sizes: &Sizes, samples: usize) -> Self {
        Self {
            equations: sizes.equations,
            whitened: vec![0.0; samples * sizes.equations],
            lengths: vec![0.0; samples * sizes.equations],
            by_reading: vec![0.0; samples * sizes.by_reading],
            by_parameter: vec![0.0; samples * sizes.by_parameter],
            inner: 0,
        }
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
        let bare = Want { x: false, a: false };
        model.evaluate(readings, block, readings.raw(block), x, bare, &mut room.ws);
        for (sample, lane) in (i * WIDTH..).zip(0..meta.live) {
            for (e, length) in sizes.lengths.iter().enumerate() {
                self.lengths[sample * k + e] = room.ws.f[e].0[lane] * length;
            }
        }
        self.inner = self.inner.max(room.settle(part, block, x, a_hat, by_parameter));
        room.whiten_readings();
        let weight = part.weight(block);
        for (sample, lane) in (i * WIDTH..).zip(0..meta.live) {
            let weight = weight.0[lane];
            for e in 0..k {
                self.whitened[sample * k + e] = room.w[e].0[lane] * weight;
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
        let count = here.whitened.len() / (WIDTH * sizes.equations).max(1);
        for (i, meta) in blocks.iter().take(count).enumerate() {
            for (sample, &row) in (i * WIDTH..).zip(&meta.rows[..meta.live]) {
                let copy = |into: &mut [f64], from: &[f64], size: usize| {
                    let from = &from[sample * size..(sample + 1) * size];
                    into[row * size..(row + 1) * size].copy_from_slice(from);
                };
                copy(&mut self.whitened, &here.whitened, sizes.equations);
                copy(&mut self.lengths, &here.lengths, sizes.equations);
                copy(&mut self.by_reading, &here.by_reading, sizes.by_reading);
                copy(&mut self.by_parameter, &here.by_parameter, sizes.by_parameter);
            }
        }
    }
}
