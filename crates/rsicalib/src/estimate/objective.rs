//! The two objectives: least squares of the misclosure (the paper), and maximum likelihood.
//!
//! ```text
//! algebraic       ½ Σ fᵀ f                                                (11)
//! implicit loop   ½ Σ wᵀ S⁻¹ w,   S = A Σ Aᵀ + Π,   w = f(â) + A (a - â)  (51)
//!                 â = a - Σ Aᵀ S⁻¹ w,   repeated until â stands still     (52)
//! ```
//!
//! | symbol | here | |
//! |---|---|---|
//! | a, â | `raw`, `adjusted` | readings, and estimated readings without noise |
//! | Σ, Π | [`Noise`] | noise of the readings, and of the closure itself (play) |
//! | S, L | `whiten` | covariance of the misclosure, and its Cholesky factor |
//!
//! Where (52) has converged, (51) equals `½ Σ eᵀ Σ⁻¹ e` over the noise `e = a - â`
//! exactly, and `Xᵀ S⁻¹ w` is its exact gradient: by the envelope theorem, the derivatives of the
//! weight cancel. The minimum is the full Gauss-Helmert estimate. `L⁻¹ X` is the Jacobian that
//! [`crate::numerics::lm`] uses.

use crate::model::{Model, Prior, Want, Workspace, add_squares};
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::numerics::linearization::{Curvature, Linearization};
use crate::numerics::normal_equations::over_chunks;
use crate::numerics::schur::islands;
use crate::readings::Readings;

/// Readings and their model.
#[derive(Debug, Clone, Copy)]
pub struct Part<'a> {
    /// The model; all parts share its parameters.
    pub model: &'a Model,
    /// The readings.
    pub readings: &'a Readings,
    /// Weight of each sample: the variance of a sample is divided by the square of its weight. Zero
    /// for a sample that is left out; `None`: weights of one.
    pub weights: Option<&'a [f64]>,
}

impl Part<'_> {
    /// Entries of one block of what a fit settles: readings, and what is unknown in their poses.
    pub(crate) fn stride(&self) -> usize {
        self.model.stride()
    }

    /// A block before it is settled: its readings as they are, and nothing known of its poses.
    pub(crate) fn start(&self, block: usize) -> Vec<Lanes> {
        let raw = self.readings.raw(block).iter().copied();
        raw.chain(vec![Lanes::splat(f64::NAN); self.stride() - self.readings.channels]).collect()
    }

    /// All blocks before they are settled.
    pub(crate) fn starts(&self) -> Vec<Lanes> {
        match self.stride() == self.readings.channels {
            true => self.readings.all_raw().to_vec(),
            false => (0..self.readings.blocks().len()).flat_map(|b| self.start(b)).collect(),
        }
    }

    /// Weight of each sample of a block.
    #[inline(always)]
    pub(crate) fn weight(&self, block: usize) -> Lanes {
        let meta = &self.readings.blocks()[block];
        Lanes(std::array::from_fn(|lane| {
            let live = lane < meta.live;
            let weight = self.weights.map_or(1.0, |w| w[meta.rows[lane]]);
            if live { weight } else { 0.0 }
        }))
    }

    /// True for a block of which no sample counts.
    pub(crate) fn leaves_out(&self, block: usize) -> bool {
        let meta = &self.readings.blocks()[block];
        self.weights.is_some_and(|w| meta.rows[..meta.live].iter().all(|row| w[*row] == 0.0))
    }

    /// Mean square of the misclosure of each equation by the readings as they are and the parameters
    /// `beta`, in its own unit, over the samples that count.
    #[must_use]
    pub fn mean_squares(&self, beta: &[f64]) -> Vec<f64> {
        let Self { model, readings, .. } = self;
        let mut blocks = vec![(); readings.blocks().len()];
        // The sum of each equation, and then the number of its samples.
        let one = |first: usize, chunk: &mut [()]| {
            let mut ws = Workspace::default();
            let mut sums = vec![0.0; 2 * model.rows()];
            let mut absent = Vec::new();
            for block in first..first + chunk.len() {
                let weight = self.weight(block);
                let bare = Want { x: false, a: false };
                model.evaluate(readings, block, readings.raw(block), beta, bare, &mut ws);
                model.absent(readings, block, &mut absent);
                for lane in (0..WIDTH).filter(|&lane| weight.0[lane] > 0.0) {
                    let squares = ws.f.iter().map(|f| f.0[lane] * f.0[lane]);
                    let holds = (0..model.rows())
                        .map(|e| absent.get(e).map_or(1.0, |absent: &Lanes| 1.0 - absent.0[lane]));
                    sums.iter_mut().zip(squares.chain(holds)).for_each(|(sum, own)| *sum += own);
                }
            }
            sums
        };
        let add = |all: &mut Vec<f64>, own: Vec<f64>| {
            all.iter_mut().zip(own).for_each(|(all, own)| *all += own);
        };
        let mut sums = over_chunks(&mut blocks, 1, one, add).unwrap_or_default();
        let counts = sums.split_off((sums.len()).min(model.rows()));
        sums.into_iter().zip(counts).map(|(sum, count)| sum / count.max(1.0)).collect()
    }

    /// The same in length units.
    #[must_use]
    pub fn mean_square_lengths(&self, beta: &[f64]) -> Vec<f64> {
        let squares = self.mean_squares(beta).into_iter().zip(self.model.lengths());
        squares.map(|(square, length)| square * length * length).collect()
    }

    /// Root mean square of the misclosure over the equations of one unit; zero where there are none.
    pub(crate) fn rms_misclosure(&self, beta: &[f64]) -> f64 {
        let squares = self.mean_square_lengths(beta).into_iter().zip(self.model.in_one_unit());
        let counted: Vec<f64> =
            squares.filter_map(|(square, counts)| counts.then_some(square)).collect();
        (counted.iter().sum::<f64>() / counted.len().max(1) as f64).sqrt()
    }
}

/// Noise of the readings and of the closure.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Standard deviation of one reading of each channel, in its unit.
    pub sigma: Vec<f64>,
    /// Factor on Π, the variance of the play.
    pub play: f64,
    /// Variance of each closure of the model beside what it declares, length units squared: of the seating
    /// of one that declares none, and what repeats of a length show beyond its declared noise, which is
    /// negative where they show less. Empty where all are as declared.
    pub seating: Vec<f64>,
    /// Of each closure of the model, the factor on its noise where that is drawn anew for each sample,
    /// as of a length that is measured in each; zero where it is of the seating. Empty: of none.
    pub measured: Vec<f64>,
}

/// Variance of each equation by the closures themselves, in units of `f²`.
#[derive(Debug, Clone, PartialEq)]
pub struct Play {
    /// Π: one draw for each seating.
    pub of_seating: Vec<f64>,
    /// One draw for each sample.
    pub of_sample: Vec<f64>,
}

impl Play {
    /// Of one sample.
    #[must_use]
    pub fn whole(&self) -> Vec<f64> {
        self.of_seating.iter().zip(&self.of_sample).map(|(a, b)| a + b).collect()
    }
}

impl Noise {
    /// Noise of the readings beside closures as they are declared.
    #[must_use]
    pub fn declared(sigma: Vec<f64>) -> Self {
        Self { sigma, play: 1.0, seating: Vec::new(), measured: Vec::new() }
    }

    /// The same where closures of these names hold so well, length units or as coordinates count:
    /// each has the variance `sd²` in place of what the mechanism declares of it.
    #[must_use]
    pub(crate) fn with_closures(self, model: &Model, closures: &[(String, f64)]) -> Self {
        let declared = Self { seating: Vec::new(), ..self.clone() }.by_closure(model);
        let names = model.mechanism.closures.iter().map(|closure| &closure.name);
        let own = |(name, declared): (&String, f64)| {
            let known = closures.iter().find(|(of, _)| of == name);
            known.map_or(0.0, |(_, sd)| sd * sd - declared * declared)
        };
        Self { seating: names.zip(declared).map(own).collect(), ..self }
    }

    /// Standard deviation of each closure of a model, in length units or as coordinates count.
    pub(crate) fn by_closure(&self, model: &Model) -> Vec<f64> {
        let (whole, lengths) = (self.of_closures(model).whole(), model.lengths());
        let of = |mut own: std::ops::Range<usize>| {
            own.next().map_or(0.0, |e| whole[e].sqrt() * lengths[e])
        };
        model.equations_by_closure().map(of).collect()
    }

    /// Variance of each equation that is drawn for each sample, length units squared; empty where none
    /// is.
    pub(crate) fn measured_lengths(&self, model: &Model) -> Vec<f64> {
        if model.pose_unknowns() > 0 || self.measured.iter().all(|factor| *factor == 0.0) {
            return Vec::new();
        }
        let play = self.of_closures(model).of_sample;
        play.iter().zip(model.lengths()).map(|(f, length)| f * length * length).collect()
    }

    /// Variance of each equation of a model by its closures.
    #[must_use]
    pub fn of_closures(&self, model: &Model) -> Play {
        let mut of_seating = model.play();
        let mut of_sample = vec![0.0; of_seating.len()];
        let lengths = model.lengths();
        for (k, equations) in model.equations_by_closure().enumerate() {
            let seating = self.seating.get(k).copied().unwrap_or(0.0);
            let measured = self.measured.get(k).copied().unwrap_or(0.0);
            for e in equations {
                let variance = of_seating[e] + seating / lengths[e].powi(2);
                (of_seating[e], of_sample[e]) = match measured > 0.0 {
                    true => (0.0, self.play * measured * variance),
                    false => (self.play * variance, 0.0),
                };
            }
        }
        Play { of_seating, of_sample }
    }
}

/// Adds the priors as observations, and then finds the islands of the unknown points.
pub(crate) fn add_priors(here: &mut Linearization, priors: &[Prior], model: &Model, x: &[f64]) {
    let Curvature::Gram(gram) = &mut here.curvature else { return };
    for prior in priors {
        let off = prior.off(x);
        let slopes = prior.slopes(x);
        here.cost += 0.5 * off * off;
        slopes.iter().for_each(|(i, slope)| here.gradient[*i] += slope * off);
        add_squares(gram, &slopes);
    }
    here.islands = islands(gram, model.term_parameters);
}
