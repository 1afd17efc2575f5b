//! The paper's objective (11), with priors.

use crate::estimate::objective::{Part, add_priors};
use crate::model::{Prior, Want, Workspace};
use crate::numerics::lanes::dispatch;
use crate::numerics::linearization::{Linearization, Problem};
use crate::numerics::normal_equations::{NormalEquations, Total, over_chunks};

/// The paper's objective (11), with priors.
#[derive(Debug)]
pub struct Algebraic<'a> {
    part: Part<'a>,
    priors: &'a [Prior],
    /// For each equation, the parameters that it depends on.
    active: Vec<Vec<usize>>,
}

impl<'a> Algebraic<'a> {
    /// The objective of readings and their model.
    #[must_use]
    pub fn new(part: Part<'a>, priors: &'a [Prior]) -> Self {
        let active = part.model.active();
        Self { part, priors, active }
    }
}

impl Problem for Algebraic<'_> {
    fn parameters(&self) -> usize {
        self.part.model.parameters
    }

    fn linearize(&self, x: &[f64]) -> Linearization {
        let Part { model, readings, .. } = self.part;
        let width = model.width();
        let mut blocks = vec![(); readings.blocks().len()];
        let one = |first: usize, chunk: &mut [()]| {
            dispatch(
                #[inline(always)]
                || {
                    let mut ws = Workspace::default();
                    let mut sums = NormalEquations::new(model.term_parameters, width);
                    let want = Want { x: true, a: false };
                    for block in first..first + chunk.len() {
                        model.evaluate(readings, block, readings.raw(block), x, want, &mut ws);
                        let weight = self.part.weight(block);
                        let group = readings.blocks()[block].group;
                        for (k, active) in self.active.iter().enumerate() {
                            let row = &mut ws.x[k * width..(k + 1) * width];
                            for &i in active {
                                row[i] = row[i] * weight;
                            }
                            sums.add_active(group, ws.f[k] * weight, row, active);
                        }
                    }
                    sums
                },
            )
        };
        let mut total = Total::new(model.parameters);
        if let Some(sums) = over_chunks(&mut blocks, 1, one, |a, b| a.merge(&b)) {
            total.add(&sums, model.columns());
        }
        let mut here = total.finish();
        add_priors(&mut here, self.priors, model, x);
        here
    }
}
