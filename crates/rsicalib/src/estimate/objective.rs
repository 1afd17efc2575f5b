//! The two objectives: the paper's, and maximum likelihood.
//!
//! ```text
//! algebraic       ½ Σ fᵀ f                                                (11)
//! implicit loop   ½ Σ wᵀ S⁻¹ w,   S = A Σ Aᵀ + Π,   w = f(â) + A (a - â)  (51)
//!                 â = a - Σ Aᵀ S⁻¹ w,   repeated until â stands still     (52)
//! ```
//!
//! | symbol | here | |
//! |---|---|---|
//! | a, â | `raw`, `adjusted` | readings, and what they would be without noise |
//! | Σ, Π | [`Noise`] | noise of the readings, and of the closure itself (play) |
//! | S, L | `whiten` | covariance of the misclosure, and its Cholesky factor |
//!
//! Where (52) has converged, (51) equals `½ Σ eᵀ Σ⁻¹ e` over the noise `e = a - â`
//! exactly, and `Xᵀ S⁻¹ w` is its exact gradient (the weight is differentiated
//! too: by the envelope theorem nothing else is left). That is the full
//! Gauss-Helmert estimate; `L⁻¹ X` serves as its Jacobian in [`crate::lm`].

use crate::model::{Model, Prior};
use crate::numerics::lanes::Lanes;
use crate::numerics::linearization::{Curvature, Linearization};
use crate::numerics::schur::islands;
use crate::readings::Readings;

/// Readings with the model that they are to fit.
#[derive(Debug, Clone, Copy)]
pub struct Part<'a> {
    /// The model; all parts share its parameters.
    pub model: &'a Model,
    /// The readings.
    pub readings: &'a Readings,
    /// How much each sample counts: the root of what its variance is divided by;
    /// zero for a sample that is left out. None: each counts once.
    pub weights: Option<&'a [f64]>,
}

impl Part<'_> {
    /// How much each sample of a block counts.
    #[inline(always)]
    pub(crate) fn weight(&self, block: usize) -> Lanes {
        let meta = &self.readings.blocks()[block];
        Lanes(std::array::from_fn(|lane| {
            let live = lane < meta.live;
            let weight = self.weights.map_or(1.0, |w| w[meta.rows[lane]]);
            if live { weight } else { 0.0 }
        }))
    }
}

/// Noise of the readings and of the closure.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Standard deviation of one reading of each channel, in its unit.
    pub sigma: Vec<f64>,
    /// Multiplies Π, the play that the mechanism declares.
    pub play: f64,
}

/// Adds the observations that priors are; then it is known which unknown points meet.
pub(crate) fn add_priors(here: &mut Linearization, priors: &[Prior], model: &Model, x: &[f64]) {
    let Curvature::Gram(gram) = &mut here.curvature else { return };
    for prior in priors {
        let off = prior.off(x);
        let slopes = prior.slopes(x);
        here.cost += 0.5 * off * off;
        for &(i, slope) in &slopes {
            here.gradient[i] += slope * off;
            for &(j, other) in &slopes {
                gram[(i, j)] += slope * other;
            }
        }
    }
    here.islands = islands(gram, model.term_parameters);
}
