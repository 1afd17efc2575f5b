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

use std::sync::Mutex;

use crate::arrow::islands;
use crate::lanes::{Lanes, WIDTH, dispatch};
use crate::lm::{Curvature, Linearization, Problem};
use crate::model::{Model, Want, Workspace};
use crate::readings::Readings;
use crate::sums::{Sums, Total, over_chunks};
use crate::terms::Scale;

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
    fn weight(&self, block: usize) -> Lanes {
        let meta = &self.readings.blocks()[block];
        Lanes(std::array::from_fn(|lane| {
            let live = lane < meta.live;
            let weight = self.weights.map_or(1.0, |w| w[meta.rows[lane]]);
            if live { weight } else { 0.0 }
        }))
    }
}

/// What is known without readings, to a standard deviation `sd`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Prior {
    /// A parameter has this mean.
    Parameter {
        /// The parameter.
        column: usize,
        /// Its expectation.
        mean: f64,
        /// How far it may be from it.
        sd: f64,
    },
    /// Two unknown points are this far apart.
    Apart {
        /// First parameter of each point.
        points: [usize; 2],
        /// Their distance.
        value: f64,
        /// How well it is known.
        sd: f64,
    },
}

impl Prior {
    /// How far parameters `x` are off, in standard deviations.
    #[must_use]
    pub fn off(&self, x: &[f64]) -> f64 {
        match *self {
            Self::Parameter { column, mean, sd } => (x[column] - mean) / sd,
            Self::Apart { points: [a, b], value, sd } => (apart(x, a, b).1 - value) / sd,
        }
    }

    /// Derivatives of [`Prior::off`] by the parameters that it depends on.
    #[must_use]
    pub fn slopes(&self, x: &[f64]) -> Vec<(usize, f64)> {
        match *self {
            Self::Parameter { column, sd, .. } => vec![(column, 1.0 / sd)],
            Self::Apart { points: [a, b], sd, .. } => {
                let (d, length) = apart(x, a, b);
                let along = |k: usize| d[k] / length.max(f64::MIN_POSITIVE) / sd;
                (0..3).flat_map(|k| [(a + k, along(k)), (b + k, -along(k))]).collect()
            }
        }
    }
}

/// Difference and distance of two points among the parameters.
fn apart(x: &[f64], a: usize, b: usize) -> ([f64; 3], f64) {
    let d = std::array::from_fn(|k| x[a + k] - x[b + k]);
    (d, d.iter().map(|d| d * d).sum::<f64>().sqrt())
}

/// Noise of the readings and of the closure.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// Standard deviation of one reading of each channel, in its unit.
    pub sigma: Vec<f64>,
    /// Multiplies Π, the play that the mechanism declares.
    pub play: f64,
}

/// The paper's objective (11), with priors.
#[derive(Debug)]
pub struct Algebraic<'a> {
    part: Part<'a>,
    priors: &'a [Prior],
    /// For each equation, the parameters that it depends on.
    active: Vec<Vec<usize>>,
}

impl<'a> Algebraic<'a> {
    /// Of readings under a model.
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
                    let mut sums = Sums::new(model.term_parameters, width);
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

/// Adds the observations that priors are; then it is known which unknown points meet.
fn add_priors(here: &mut Linearization, priors: &[Prior], model: &Model, x: &[f64]) {
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

/// The maximum-likelihood objective (51), with priors.
#[derive(Debug)]
pub struct Implicit<'a> {
    parts: Vec<(Part<'a>, Noise)>,
    priors: &'a [Prior],
    /// `â` of every part, kept from one linearisation to the next.
    adjusted: Mutex<Vec<Vec<Lanes>>>,
}

/// How often (52) is repeated at the most, and when it has converged.
const INNER: usize = 20;
/// Parameters that are cheap enough to differentiate in every repeat.
const FEW: usize = 40;
/// Change of `â`, in standard deviations of a reading, that counts as none.
const STILL: f64 = 1e-9;

/// Residuals at a solution, sample by sample.
#[derive(Debug, Clone, Default)]
pub struct Residuals {
    /// Equations of one sample.
    pub equations: usize,
    /// `L⁻¹ w`, sample by sample: standard normal if the model is right.
    pub whitened: Vec<f64>,
    /// Misclosure of the raw readings, in length units, sample by sample.
    pub lengths: Vec<f64>,
    /// `L⁻¹ A`, sample by sample, equation by equation, one per channel.
    pub by_reading: Vec<f64>,
    /// `L⁻¹ X`, sample by sample, equation by equation, one per parameter; if asked for.
    pub by_parameter: Vec<f64>,
    /// Iterations of (52) that the slowest block needed; [`INNER`] where one did not settle.
    pub inner: usize,
}

impl<'a> Implicit<'a> {
    /// Of readings under a model, with their noise; `rest` parts share the parameters.
    #[must_use]
    pub fn new(parts: Vec<(Part<'a>, Noise)>, priors: &'a [Prior]) -> Self {
        let raw = |part: &Part| {
            (0..part.readings.blocks().len())
                .flat_map(|b| part.readings.raw(b).to_vec())
                .collect::<Vec<_>>()
        };
        let adjusted = Mutex::new(parts.iter().map(|(part, _)| raw(part)).collect());
        Self { parts, priors, adjusted }
    }

    /// Residuals of the first part at `x`; `by_parameter` only where asked for.
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
                    for (e, x) in room.ws.x.chunks_exact(model.width()).enumerate() {
                        for (column, value) in model.columns()[meta.group].iter().zip(x) {
                            out.by_parameter[(row * k + e) * p + column] = value.0[lane] * weight;
                        }
                    }
                }
            }
        }
        out
    }

    /// Readings of one block without their noise, at `x`.
    #[must_use]
    pub fn settled(&self, block: usize, x: &[f64]) -> Vec<Lanes> {
        let (part, noise) = &self.parts[0];
        let mut a_hat = part.readings.raw(block).to_vec();
        Room::new(part.model, noise).settle(part, block, x, &mut a_hat, false);
        a_hat
    }

    /// Readings without their noise, row by row, as of the last linearisation.
    #[must_use]
    pub fn adjusted(&self) -> Vec<f64> {
        let (part, _) = &self.parts[0];
        let c = part.readings.channels;
        let adjusted = lock(&self.adjusted);
        let mut out = vec![0.0; part.readings.samples * c];
        for (block, meta) in part.readings.blocks().iter().enumerate() {
            for (row, lane) in meta.rows.iter().zip(0..meta.live) {
                for channel in 0..c {
                    out[row * c + channel] = adjusted[0][block * c + channel].0[lane];
                }
            }
        }
        out
    }
}

/// The state of a search; a panic elsewhere leaves it usable.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

impl Implicit<'_> {
    /// Visits every block of the first part at `x`: its group, whitened misclosure and
    /// whitened `X`, equation by equation, both weighted, in the order of the blocks.
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
                        let mut sums = Sums::new(model.term_parameters, model.width());
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

/// Room to settle the readings of one block.
struct Room {
    ws: Workspace,
    /// Whitened misclosure, `L⁻¹ w`.
    w: Vec<Lanes>,
    /// Cholesky factor of `S`, row by row, full square.
    l: Vec<Lanes>,
    lambda: Vec<Lanes>,
    variance: Vec<f64>,
    play: Vec<f64>,
    still: Vec<f64>,
}

/// [`STILL`] in the unit of a channel, but not finer than what rounding of the
/// misclosure leaves of a reading: a quiet encoder would never stand still.
fn still((sigma, scale): (&f64, &Scale)) -> f64 {
    let largest = scale.span.iter().fold(1.0 / scale.gain.abs(), |m, a| m.max(a.abs()));
    (STILL * sigma).max(64.0 * f64::EPSILON * largest)
}

impl Room {
    fn new(model: &Model, noise: &Noise) -> Self {
        let k = model.equations();
        Self {
            ws: Workspace::default(),
            w: vec![Lanes::ZERO; k],
            l: vec![Lanes::ZERO; k * k],
            lambda: vec![Lanes::ZERO; k],
            variance: noise.sigma.iter().map(|s| s * s).collect(),
            play: model.play().iter().map(|p| p * noise.play).collect(),
            still: noise.sigma.iter().zip(&model.scales).map(still).collect(),
        }
    }

    /// Repeats (52) until the readings stand still, then whitens `w` and, if
    /// wanted, `X`. Returns how often it was repeated.
    fn settle(
        &mut self,
        part: &Part,
        block: usize,
        x: &[f64],
        a_hat: &mut [Lanes],
        want_x: bool,
    ) -> usize {
        let (model, readings) = (part.model, part.readings);
        let raw = readings.raw(block);
        if a_hat.iter().any(|a| a.0.iter().any(|a| !a.is_finite())) {
            a_hat.copy_from_slice(raw);
        }
        let mut repeats = 0;
        loop {
            repeats += 1;
            // Many parameters are differentiated once, where `â` already stands still.
            let want = Want { x: want_x && model.width() <= FEW, a: true };
            model.evaluate(readings, block, a_hat, x, want, &mut self.ws);
            if !self.step(raw, a_hat) || repeats == INNER {
                break;
            }
        }
        if want_x {
            if model.width() > FEW {
                let want = Want { x: true, a: true };
                model.evaluate(readings, block, a_hat, x, want, &mut self.ws);
            }
            self.whiten_parameters(model.width());
        }
        repeats
    }

    /// One repeat of (52); true where the readings moved.
    fn step(&mut self, raw: &[Lanes], a_hat: &mut [Lanes]) -> bool {
        dispatch(
            #[inline(always)]
            || {
                self.misclosure(raw, a_hat);
                self.factor();
                self.adjust(raw, a_hat)
            },
        )
    }

    /// `w = f(â) + A (a - â)`
    #[inline(always)]
    fn misclosure(&mut self, raw: &[Lanes], a_hat: &[Lanes]) {
        let c = raw.len();
        for (k, w) in self.w.iter_mut().enumerate() {
            *w = self.ws.f[k];
            for i in 0..c {
                *w += self.ws.a[k * c + i] * (raw[i] - a_hat[i]);
            }
        }
    }

    /// `S = A Σ Aᵀ + Π = L Lᵀ`, then `w ← L⁻¹ w`.
    #[inline(always)]
    fn factor(&mut self) {
        let (n, c) = (self.w.len(), self.variance.len());
        for i in 0..n {
            for j in 0..=i {
                let mut s = if i == j { Lanes::splat(self.play[i]) } else { Lanes::ZERO };
                for (m, variance) in self.variance.iter().enumerate() {
                    s += self.ws.a[i * c + m] * self.ws.a[j * c + m] * *variance;
                }
                for m in 0..j {
                    s -= self.l[i * n + m] * self.l[j * n + m];
                }
                self.l[i * n + j] = if i == j { s.sqrt() } else { s / self.l[j * n + j] };
            }
        }
        for i in 0..n {
            for m in 0..i {
                self.w[i] = self.w[i] - self.l[i * n + m] * self.w[m];
            }
            self.w[i] = self.w[i] / self.l[i * n + i];
        }
    }

    /// `â ← a - Σ Aᵀ L⁻ᵀ (L⁻¹ w)`; true where it moved.
    #[inline(always)]
    fn adjust(&mut self, raw: &[Lanes], a_hat: &mut [Lanes]) -> bool {
        let (n, c) = (self.w.len(), raw.len());
        for i in (0..n).rev() {
            let mut value = self.w[i];
            for m in i + 1..n {
                value -= self.l[m * n + i] * self.lambda[m];
            }
            self.lambda[i] = value / self.l[i * n + i];
        }
        let mut moved = false;
        for i in 0..c {
            let mut e = Lanes::ZERO;
            for k in 0..n {
                e += self.ws.a[k * c + i] * self.lambda[k];
            }
            let next = raw[i] - e * self.variance[i];
            let change = (next - a_hat[i]).map(f64::abs);
            let limit = self.still[i];
            for lane in 0..WIDTH {
                moved |= change.0[lane] > limit;
            }
            a_hat[i] = next;
        }
        moved
    }

    /// `X ← L⁻¹ X`
    fn whiten_parameters(&mut self, columns: usize) {
        let (l, n, x) = (&self.l, self.w.len(), &mut self.ws.x);
        dispatch(
            #[inline(always)]
            || whiten_rows(l, n, x, columns),
        );
    }

    /// `A ← L⁻¹ A`
    fn whiten_readings(&mut self) {
        let (l, n, a) = (&self.l, self.w.len(), &mut self.ws.a);
        let columns = self.variance.len();
        dispatch(
            #[inline(always)]
            || whiten_rows(l, n, a, columns),
        );
    }
}

/// Forward substitution on every column of `rows`, equation by equation.
#[inline(always)]
fn whiten_rows(l: &[Lanes], n: usize, rows: &mut [Lanes], columns: usize) {
    for i in 0..n {
        for m in 0..i {
            let factor = l[i * n + m];
            let (above, here) = rows.split_at_mut(i * columns);
            for (value, known) in here[..columns].iter_mut().zip(&above[m * columns..]) {
                *value -= factor * *known;
            }
        }
        let inverse = Lanes::ONE / l[i * n + i];
        for value in &mut rows[i * columns..(i + 1) * columns] {
            *value = *value * inverse;
        }
    }
}
