//! The paper's problem: offsets and gains of every channel by least squares of the misclosure.
//!
//! ```text
//! θ = k a + θ_off                                                          (9)
//! f = |r_a - r_b|² - d²                                                   (10)
//! min ½ fᵀf   over the offsets and gains                                  (11)
//! ```
//!
//! The parameters are those of the paper, offsets at reading zero and absolute gains, so that
//! starts, tolerances and condition numbers can be compared with the paper. This module has no
//! statistics, no second start and no other terms; [`crate::fit()`] has them.
//!
//! The gain column of the Jacobian is the offset column times the count, which makes this path
//! fast: with `G = ∂f/∂θ` and `s_ij = Σ_e G_ei G_ej` of one sample, the normal equations are sums
//! of
//!
//! ```text
//! s_ij    s_ij a_j    a_i s_ij    a_i s_ij a_j                            (53)
//! ```

use std::sync::{Arc, Mutex};

use faer::Mat;

use crate::Error;
use crate::closures::kind::{At, Given};
use crate::kinematics::elements::{Element, Source, Way, push_rigid};
use crate::kinematics::posture::Posture;
use crate::mechanism::{Channel, ClosureKind, Mechanism, Motion, Value};
use crate::numerics::bounds::LARGEST;
use crate::numerics::lanes::{Lanes, Vec3, WIDTH, dispatch, dot, minus};
use crate::numerics::linearization::{Curvature, Linearization, Problem};
use crate::numerics::lm::{self, Termination};
use crate::numerics::workers;
use crate::numerics::workers::lock;

/// Blocks per task; the sums of the tasks are added up in order.
const CHUNK: usize = 64;

/// Buffers that a layout keeps: a longer recording makes the others anew, and works long on each.
const SPARE: usize = 64;

/// Readings under the model `[offset, gain]`, in the paper's parametrisation.
#[derive(Debug, Clone)]
pub struct Paper {
    layout: Arc<Layout>,
    samples: usize,
    /// Counts: [`WIDTH`] samples of every channel, block by block.
    counts: Vec<Lanes>,
}

/// The problem of a mechanism, whatever its readings: for many fits of one mechanism.
#[derive(Debug)]
pub struct Layout {
    /// Name and range of each channel.
    names: Vec<(String, [f64; 2])>,
    channels: usize,
    equations: usize,
    chains: Vec<Vec<Element>>,
    ends: Vec<End>,
    closures: Vec<Pair>,
    /// Pairs of channels `i ≥ j` that take part in one equation, and those equations.
    pairs: Vec<Together>,
    /// The equations of the pairs, one after another.
    shared: Vec<usize>,
    /// Buffers of earlier linearisations, for reuse.
    spare: Mutex<Vec<(Room, Normal)>>,
}

/// An end of a closure: on a chain, or fixed in the base.
#[derive(Debug, Clone, PartialEq)]
struct End {
    chain: Option<usize>,
    at: [f64; 3],
}

/// A closure between two of the ends.
#[derive(Debug, Clone)]
struct Pair {
    kind: ClosureKind,
    ends: [usize; 2],
    /// `d`; zero where there is none.
    value: f64,
    equation: usize,
}

/// Channels `i ≥ j`, and the place in `shared` of the equations in which both take part.
#[derive(Debug, Clone)]
struct Together {
    i: usize,
    j: usize,
    equations: std::ops::Range<usize>,
}

/// End of the minimisation.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum {
    /// `θ_off`, one per channel (rad).
    pub offsets: Vec<f64>,
    /// `k`, one per channel (rad/reading).
    pub gains: Vec<f64>,
    /// `½ fᵀf`
    pub cost: f64,
    /// Number of linearisations.
    pub iterations: usize,
    /// Reason for the end.
    pub termination: Termination,
}

impl Layout {
    /// The problem of a mechanism.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`] for a mechanism with unknown points or measured distances, which this
    /// problem does not have.
    pub fn new(mechanism: &Mechanism) -> Result<Self, Error> {
        let of = |channel: &Channel| {
            (channel.name.clone(), channel.range.unwrap_or([-LARGEST, LARGEST]))
        };
        let mut layout = Self {
            names: mechanism.channels.iter().map(of).collect(),
            channels: mechanism.channels.len(),
            equations: mechanism.equations(),
            chains: Vec::with_capacity(mechanism.chains.len()),
            ends: Vec::new(),
            closures: Vec::with_capacity(mechanism.closures.len()),
            pairs: Vec::new(),
            shared: Vec::new(),
            spare: Mutex::new(Vec::new()),
        };
        layout.compile_chains(mechanism)?;
        layout.compile_closures(mechanism)?;
        Ok(layout)
    }

    fn compile_chains(&mut self, mechanism: &Mechanism) -> Result<(), Error> {
        for chain in &mechanism.chains {
            let mut steps = Vec::with_capacity(2 * chain.rows.len() + 1);
            for row in &chain.rows {
                if row.theta != 0.0 {
                    let turn = nalgebra::Isometry3::rotation(nalgebra::Vector3::z() * row.theta);
                    push_rigid(&mut steps, &turn);
                }
                if let Some(name) = &row.channel {
                    let way = match row.joint {
                        Motion::Revolute => Way::Turn,
                        Motion::Prismatic => Way::Slide,
                    };
                    let channel = mechanism.channel_index(name)?;
                    steps.push(Element::joint(way, channel, row.ratio));
                }
                push_rigid(&mut steps, &row.body());
            }
            self.chains.push(steps);
        }
        Ok(())
    }

    fn compile_closures(&mut self, mechanism: &Mechanism) -> Result<(), Error> {
        let missing = |needs, why| Error::missing(&mechanism.name, needs, why);
        let mut equation = 0;
        for closure in &mechanism.closures {
            if !closure.kind.is_between_points() {
                let why = "the paper's problem has distances and touches alone";
                return Err(missing("closure of its kinds", why));
            }
            let mut ends = [0; 2];
            for (end, name) in ends.iter_mut().zip(&closure.between) {
                let point = &mechanism.points[mechanism.point_index(name)?];
                let at = point.at.ok_or_else(|| {
                    missing("place for every point", "the paper's problem has no unknown points")
                })?;
                let chain = match &point.chain {
                    Some(chain) => Some(mechanism.chain_index(chain)?),
                    None => None,
                };
                let found = End { chain, at };
                *end = self.ends.iter().position(|e| *e == found).unwrap_or_else(|| {
                    self.ends.push(found);
                    self.ends.len() - 1
                });
            }
            let value = match (closure.kind.facts().given, &closure.value) {
                (Given::Value, Some(Value::Known(d))) => *d,
                (Given::Nothing, _) => 0.0,
                _ => {
                    let why = "the paper's problem has no measured distances";
                    return Err(missing("constant value for every distance", why));
                }
            };
            self.closures.push(Pair { kind: closure.kind, ends, value, equation });
            equation += closure.kind.equations();
        }
        let mut takes_part = vec![false; self.closures.len() * self.channels];
        for (pair, parts) in self.closures.iter().zip(takes_part.chunks_exact_mut(self.channels)) {
            for chain in pair.ends.iter().filter_map(|&end| self.ends[end].chain) {
                sources(&self.chains[chain]).for_each(|c| parts[c] = true);
            }
        }
        for i in 0..self.channels {
            for j in 0..=i {
                let first = self.shared.len();
                for (pair, parts) in
                    self.closures.iter().zip(takes_part.chunks_exact(self.channels))
                {
                    if parts[i] && parts[j] {
                        self.shared.extend(pair.equation..pair.equation + pair.kind.equations());
                    }
                }
                let equations = first..self.shared.len();
                if !equations.is_empty() {
                    self.pairs.push(Together { i, j, equations });
                }
            }
        }
        Ok(())
    }

    /// Buffers for one part of the sums, which are those of before.
    fn room(&self) -> (Room, Normal) {
        lock(&self.spare).pop().unwrap_or_else(|| (Room::new(self), Normal::new(self)))
    }
}

impl Paper {
    /// The problem of a mechanism and its readings: `counts` holds them row by row, one per channel.
    ///
    /// # Errors
    ///
    /// As [`Layout::new`] and [`Paper::of`].
    pub fn new(mechanism: &Mechanism, counts: &[f64]) -> Result<Self, Error> {
        Self::of(Arc::new(Layout::new(mechanism)?), counts)
    }

    /// The problem of readings of a mechanism: `counts` holds them row by row, one per channel.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`], [`Error::Empty`] and [`Error::Reading`] for readings
    /// that cannot be used.
    pub fn of(layout: Arc<Layout>, counts: &[f64]) -> Result<Self, Error> {
        let channels = layout.channels;
        let samples = counts.len() / channels.max(1);
        if counts.len() != samples * channels {
            return Err(Error::shape("counts", counts.len(), (samples + 1) * channels));
        }
        if samples == 0 {
            return Err(Error::Empty("the table has no rows".into()));
        }
        for (c, (name, [low, high])) in layout.names.iter().enumerate() {
            let (low, high) = (*low, *high);
            let outside = |found: f64| !(found.is_finite() && found >= low && found <= high);
            let mut column = counts[c..].iter().step_by(channels);
            if let Some(row) = column.position(|found| outside(*found)) {
                let (channel, found) = (name.clone(), counts[row * channels + c]);
                return Err(Error::Reading { row, channel, found, low, high });
            }
        }
        let mut blocks = vec![Lanes::ZERO; samples.div_ceil(WIDTH) * channels];
        let rows = counts.chunks(WIDTH * channels);
        for (block, rows) in blocks.chunks_exact_mut(channels).zip(rows) {
            for lane in 0..WIDTH {
                // The last sample fills up the last block; its weight there is zero.
                let first = (lane * channels).min(rows.len() - channels);
                for (lanes, count) in block.iter_mut().zip(&rows[first..first + channels]) {
                    lanes.0[lane] = *count;
                }
            }
        }
        Ok(Self { layout, samples, counts: blocks })
    }

    /// Number of equations of all samples.
    #[must_use]
    pub fn equations(&self) -> usize {
        self.samples * self.layout.equations
    }

    /// Minimises (11) from a start: one offset (rad) and one gain (rad/reading) per channel.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] unless there is one offset and one gain per channel.
    pub fn minimize(
        &self,
        offsets: &[f64],
        gains: &[f64],
        options: &lm::SolverOptions,
    ) -> Result<Minimum, Error> {
        let start = self.parameters(offsets, gains)?;
        let outcome = lm::minimize(self, &start, options);
        let (offsets, gains) = outcome.x.split_at(self.layout.channels);
        Ok(Minimum {
            offsets: offsets.to_vec(),
            gains: gains.to_vec(),
            cost: outcome.cost,
            iterations: outcome.iterations,
            termination: outcome.termination,
        })
    }

    /// `f`, eq. (10), sample by sample, equation by equation, in squared length units for a distance.
    ///
    /// # Errors
    ///
    /// As [`Paper::minimize`].
    pub fn misclosure(&self, offsets: &[f64], gains: &[f64]) -> Result<Vec<f64>, Error> {
        let beta = self.parameters(offsets, gains)?;
        let mut f = vec![0.0; self.equations()];
        self.visit(&beta, |row, lane, room| {
            for (e, value) in room.f.iter().enumerate() {
                f[row * self.layout.equations + e] = value.0[lane];
            }
        });
        Ok(f)
    }

    /// `∂f/∂(offsets, gains)`, eq. (12): sample by sample, equation by equation, the offsets of all
    /// channels and then their gains.
    ///
    /// # Errors
    ///
    /// As [`Paper::minimize`].
    pub fn jacobian(&self, offsets: &[f64], gains: &[f64]) -> Result<Vec<f64>, Error> {
        let beta = self.parameters(offsets, gains)?;
        let (k, c) = (self.layout.equations, self.layout.channels);
        let mut jacobian = vec![0.0; self.equations() * 2 * c];
        self.visit(&beta, |row, lane, room| {
            let counts = self.block(row / WIDTH);
            for e in 0..k {
                let line = &mut jacobian[(row * k + e) * 2 * c..(row * k + e + 1) * 2 * c];
                for i in 0..c {
                    let slope = room.g[e * c + i].0[lane];
                    line[i] = slope;
                    line[c + i] = slope * counts[i].0[lane];
                }
            }
        });
        Ok(jacobian)
    }

    /// Effect of each offset and then of each gain on the points that the closures hold: length
    /// per unit of the parameter, root mean square over the samples and the points that move.
    ///
    /// # Errors
    ///
    /// As [`Paper::minimize`].
    pub fn point_effects(&self, offsets: &[f64], gains: &[f64]) -> Result<Vec<f64>, Error> {
        let beta = self.parameters(offsets, gains)?;
        let c = self.layout.channels;
        let (mut sums, mut moved) = (vec![0.0; 2 * c], vec![0_usize; c]);
        self.visit(&beta, |row, lane, room| {
            let counts = self.block(row / WIDTH);
            for (i, by) in room.ends.iter().flat_map(|(_, moves)| moves) {
                let square = dot(by, by).0[lane];
                sums[*i] += square;
                sums[c + i] += square * counts[*i].0[lane].powi(2);
                moved[*i] += 1;
            }
        });
        let mean = |(i, sum): (usize, f64)| (sum / moved[i % c].max(1) as f64).sqrt();
        Ok(sums.into_iter().enumerate().map(mean).collect())
    }

    /// `½ fᵀf`, its gradient and its Gram matrix, without scaling.
    ///
    /// # Errors
    ///
    /// As [`Paper::minimize`].
    pub fn linearization(&self, offsets: &[f64], gains: &[f64]) -> Result<Linearization, Error> {
        Ok(self.linearize(&self.parameters(offsets, gains)?))
    }

    fn parameters(&self, offsets: &[f64], gains: &[f64]) -> Result<Vec<f64>, Error> {
        for (what, given) in [("offsets", offsets), ("gains", gains)] {
            Error::same(what, given.len(), self.layout.channels)?;
        }
        Ok([offsets, gains].concat())
    }

    fn block(&self, block: usize) -> &[Lanes] {
        &self.counts[block * self.layout.channels..(block + 1) * self.layout.channels]
    }

    /// Evaluates every block and calls `see(row, lane, room)` for each sample.
    fn visit(&self, beta: &[f64], mut see: impl FnMut(usize, usize, &Room)) {
        let mut room = Room::new(&self.layout);
        for block in 0..self.samples.div_ceil(WIDTH) {
            dispatch(
                #[inline(always)]
                || self.evaluate(self.block(block), beta, &mut room),
            );
            for row in block * WIDTH..((block + 1) * WIDTH).min(self.samples) {
                see(row, row % WIDTH, &room);
            }
        }
    }

    /// Eqs. (9), (10) and `G = ∂f/∂θ` of one block.
    #[inline(always)]
    fn evaluate(&self, counts: &[Lanes], beta: &[f64], room: &mut Room) {
        let (offsets, gains) = beta.split_at(self.layout.channels);
        for (c, angle) in room.angles.iter_mut().enumerate() {
            *angle = counts[c] * gains[c] + Lanes::splat(offsets[c]); // (9)
        }
        for (posture, steps) in room.postures.iter_mut().zip(&self.layout.chains) {
            posture.take(steps, &room.angles, &[], &[]);
        }
        for (end, (at, moves)) in self.layout.ends.iter().zip(&mut room.ends) {
            moves.clear();
            let Some(chain) = end.chain else { continue };
            let posture = &room.postures[chain];
            *at = posture.tip.point(&end.at);
            for lever in &posture.levers {
                if let Source::Channel(c) = lever.source {
                    moves.push((c, lever.moves(at)));
                }
            }
        }
        room.g.fill(Lanes::ZERO);
        for pair in &self.layout.closures {
            let [(from, ahead), (to, behind)] = pair.ends.map(|end| &room.ends[end]);
            let apart = minus(from, to);
            let sides = [(ahead, 1.0), (behind, -1.0)];
            let row = pair.equation * self.layout.channels;
            let value = Lanes::splat(pair.value);
            let at = At { apart, value, shape: None, measured: false, along: None };
            for e in 0..pair.kind.equations() {
                room.f[pair.equation + e] = pair.kind.misclosure(&at, e); // (10)
                for (moves, sign) in sides {
                    for (c, moved) in moves {
                        room.g[row + e * self.layout.channels + c] +=
                            pair.kind.by_end(&at, e, moved, sign);
                    }
                }
            }
        }
    }

    /// Adds one block to the sums (53).
    #[inline(always)]
    fn add(&self, counts: &[Lanes], live: usize, room: &mut Room, sums: &mut Normal) {
        let c = self.layout.channels;
        if live < WIDTH {
            let weight = Lanes(std::array::from_fn(|lane| if lane < live { 1.0 } else { 0.0 }));
            for value in room.f.iter_mut().chain(&mut room.g) {
                *value = *value * weight;
            }
        }
        for f in &room.f {
            sums.cost += *f * *f;
        }
        for (i, sum) in sums.gradient.iter_mut().enumerate() {
            let mut h = Lanes::ZERO;
            for (e, f) in room.f.iter().enumerate() {
                h += room.g[e * c + i] * *f;
            }
            sum[0] += h;
            sum[1] += h * counts[i];
        }
        for (Together { i, j, equations }, sum) in self.layout.pairs.iter().zip(&mut sums.gram) {
            let mut s = Lanes::ZERO;
            for e in &self.layout.shared[equations.clone()] {
                s = room.g[e * c + i].mul_add(room.g[e * c + j], s);
            }
            let by_i = s * counts[*i];
            sum[0] += s;
            sum[1] += by_i;
            sum[2] = s.mul_add(counts[*j], sum[2]);
            sum[3] = by_i.mul_add(counts[*j], sum[3]);
        }
    }

    /// The sums as `JᵀJ` and `Jᵀf`.
    fn linearization_of(&self, sums: &mut Normal, room: Option<Linearization>) -> Linearization {
        let n = 2 * self.layout.channels;
        let mut here = match room {
            Some(Linearization { gradient, curvature: Curvature::Gram(gram), islands, .. })
                if gram.nrows() == n =>
            {
                Linearization { cost: 0.0, gradient, curvature: Curvature::Gram(gram), islands }
            }
            _ => Linearization {
                cost: 0.0,
                gradient: vec![0.0; n],
                curvature: Curvature::Gram(Mat::zeros(n, n)),
                islands: Vec::new(),
            },
        };
        dispatch(
            #[inline(always)]
            || self.add_lanes(sums),
        );
        here.cost = 0.5 * sums.cost.sum();
        for (i, gradient) in here.gradient.iter_mut().enumerate() {
            *gradient = sums.gradient[i % self.layout.channels][i / self.layout.channels].sum();
        }
        if let Curvature::Gram(gram) = &mut here.curvature {
            for (j, column) in sums.whole.chunks_exact(n).enumerate() {
                gram.col_as_slice_mut(j).copy_from_slice(column);
            }
        }
        here
    }

    /// Adds up the lanes of (53), and puts them in both triangles.
    #[inline(always)]
    fn add_lanes(&self, sums: &mut Normal) {
        let c = self.layout.channels;
        let n = 2 * c;
        for (Together { i, j, .. }, sum) in self.layout.pairs.iter().zip(&sums.gram) {
            let [plain, by_i, by_j, by_both] = Lanes::sums(sum);
            for (row, column, by_row, by_column) in [(*i, *j, by_i, by_j), (*j, *i, by_j, by_i)] {
                let (upper, lower) = sums.whole.split_at_mut(c * n);
                let at = row * n + column;
                upper[at] = plain;
                upper[at + c] = by_column;
                lower[at] = by_row;
                lower[at + c] = by_both;
            }
        }
    }
}

impl Problem for Paper {
    fn parameters(&self) -> usize {
        2 * self.layout.channels
    }

    fn linearize(&self, beta: &[f64]) -> Linearization {
        self.linearize_in(beta, None)
    }

    fn linearize_in(&self, beta: &[f64], room: Option<Linearization>) -> Linearization {
        let one = |first: usize, blocks: &[Lanes]| {
            let (mut room, mut sums) = self.layout.room();
            dispatch(
                #[inline(always)]
                || {
                    sums.clear();
                    for (i, counts) in blocks.chunks_exact(self.layout.channels).enumerate() {
                        let live = (self.samples - (first + i) * WIDTH).min(WIDTH);
                        self.evaluate(counts, beta, &mut room);
                        self.add(counts, live, &mut room, &mut sums);
                    }
                },
            );
            (room, sums)
        };
        let size = CHUNK * self.layout.channels;
        let mut parts = if self.counts.len() <= 2 * size {
            vec![one(0, &self.counts)]
        } else {
            let job = |(k, blocks): (usize, &[Lanes])| one(k * CHUNK, blocks);
            workers::map(self.counts.chunks(size).enumerate(), job)
        };
        if let Some(((_, sum), rest)) = parts.split_first_mut() {
            rest.iter().for_each(|(_, part)| sum.merge(part));
        }
        let here = self.linearization_of(&mut parts[0].1, room);
        let mut spare = lock(&self.layout.spare);
        spare.append(&mut parts);
        spare.truncate(SPARE);
        here
    }
}

/// The channels that move a chain.
fn sources(steps: &[Element]) -> impl Iterator<Item = usize> {
    steps.iter().filter_map(|step| match step {
        Element::Move(_, _, Source::Channel(c)) | Element::Geared(_, c, _) => Some(*c),
        _ => None,
    })
}

/// Buffers for one block.
#[derive(Debug)]
struct Room {
    angles: Vec<Lanes>,
    postures: Vec<Posture>,
    /// Position of each end, and its derivative by each channel.
    ends: Vec<(Vec3, Vec<(usize, Vec3)>)>,
    f: Vec<Lanes>,
    /// `G`, equation by equation, one entry per channel.
    g: Vec<Lanes>,
}

impl Room {
    fn new(layout: &Layout) -> Self {
        Self {
            angles: vec![Lanes::ZERO; layout.channels],
            postures: vec![Posture::new(); layout.chains.len()],
            ends: layout.ends.iter().map(|e| (e.at.map(Lanes::splat), Vec::new())).collect(),
            f: vec![Lanes::ZERO; layout.equations],
            g: vec![Lanes::ZERO; layout.equations * layout.channels],
        }
    }
}

/// `fᵀf`, `Jᵀf` by offset and gain, and (53), lane by lane.
#[derive(Debug)]
struct Normal {
    cost: Lanes,
    gradient: Vec<[Lanes; 2]>,
    gram: Vec<[Lanes; 4]>,
    /// `JᵀJ`, row by row.
    whole: Vec<f64>,
}

impl Normal {
    fn new(layout: &Layout) -> Self {
        Self {
            cost: Lanes::ZERO,
            gradient: vec![[Lanes::ZERO; 2]; layout.channels],
            gram: vec![[Lanes::ZERO; 4]; layout.pairs.len()],
            whole: vec![0.0; 4 * layout.channels * layout.channels],
        }
    }

    /// For code that [`dispatch`] compiles: elsewhere these loops take as long as a block of samples.
    #[inline(always)]
    fn clear(&mut self) {
        self.cost = Lanes::ZERO;
        for sum in self.gradient.as_flattened_mut() {
            *sum = Lanes::ZERO;
        }
        for sum in self.gram.as_flattened_mut() {
            *sum = Lanes::ZERO;
        }
    }

    fn merge(&mut self, other: &Self) {
        self.cost += other.cost;
        let gradient = self.gradient.as_flattened_mut().iter_mut();
        for (a, b) in gradient.zip(other.gradient.as_flattened()) {
            *a += *b;
        }
        let gram = self.gram.as_flattened_mut().iter_mut();
        for (a, b) in gram.zip(other.gram.as_flattened()) {
            *a += *b;
        }
    }
}
