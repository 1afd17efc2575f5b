//! Which closed configurations a path joins to those where a mechanism has been.
//!
//! Loops can be closed in ways that no motion joins: a four-bar linkage open or crossed, a platform in
//! a plane as it is or mirrored. A path goes from a configuration `q` to a near one `k` by steps of at most
//! `h`, within limits. With `G = ∂f/∂q = U S Vᵀ`:
//!
//! ```text
//! q ← q + min(1, h / |k - q|) (1 - V Vᵀ) (k - q),  then (44)
//! det(Vᵀ V') det(Uᵀ U') > ½  between two steps                                   (174)
//! ```
//!
//! The determinants are those of the directions in which the loops are stiff, before a step and after
//! it. Across a singular configuration, where several ways to close the loops meet, their product is
//! negative. Elsewhere it comes close to one as steps become short: a step that fails is halved.
//! Configurations that paths join are groups, which further paths join, until what is left is apart.
//!
//! What touches something in the base is lifted off between two poses: nothing is closed there.

use nalgebra::{DMatrix, DVector};

use crate::Error;
use crate::closures::kind::Given;
use crate::model::compiled::{CompiledClosure, Model};
use crate::model::configurations::{Closed, Configurations, Under, closes};
use crate::model::ends::End;
use crate::model::near::RANK;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::numerics::random::Random;
use crate::numerics::workers;
use crate::readings::Readings;

/// Longest step [rad, or as [`Configurations::per_step`]].
const LONGEST: f64 = 0.25;

/// Shortest step.
const SHORTEST: f64 = 0.01;

/// Steps of one path, those that fail as well.
const STEPS: usize = 30;

/// Newton steps after each of them.
const CORRECTIONS: usize = 3;

/// Newton steps of a configuration where the mechanism has been.
const SETTLING: usize = 20;

/// Misclosure along a path, as a fraction of the reach.
const NEARLY: f64 = 1e-6;

/// Least product of the determinants of (174).
const ALIKE: f64 = 0.5;

/// Largest correction of a step, as a part of the step.
const CORRECTED: f64 = 0.5;

/// A path is at its end where its direction is this little along the closed configurations.
const ALONG: f64 = 0.1;

/// Nearest configurations to which a path is looked for.
const NEAREST: usize = 8;

/// Paths that are looked for from one group of joined configurations to others.
const ROUNDS: usize = 6;

/// Configurations that are joined to one another at a time.
const TOGETHER: usize = 1024;

/// Most configurations of a session.
const BEEN: usize = 64;

/// Coordinates in steps of about one, and which of the combinations of keys.
#[derive(Debug, Clone)]
struct Place {
    key: usize,
    at: Vec<f64>,
}

/// The loops of a mechanism at work, and where it has been.
pub(crate) struct Joined {
    /// One row for each combination of keys, with its block.
    readings: Readings,
    blocks: Vec<usize>,
    /// With those closures alone that hold at work.
    model: Model,
    beta: Vec<f64>,
    /// What is unknown, told apart by keys, holds the mechanism.
    keyed: bool,
    /// What each equation is divided by, and a step of one of each coordinate.
    sizes: Vec<f64>,
    units: Vec<f64>,
    /// Lowest and highest value of each coordinate, in its steps.
    limits: Vec<[f64; 2]>,
    /// What each coordinate may differ by at one place: whole turns of a joint without limits.
    turns: Vec<f64>,
    been: Vec<Place>,
}

impl Joined {
    /// Of configurations; none where nothing holds the mechanism at work, or where it has been at
    /// no row of these readings with a weight above zero.
    ///
    /// # Errors
    ///
    /// As [`Configurations::open`].
    pub(crate) fn new(
        configurations: &Configurations,
        under: &Under<'_>,
        (whole, readings, beta): (&Model, &Readings, &[f64]),
        weights: &[f64],
    ) -> Result<Option<Self>, Error> {
        if !whole.closures.iter().any(holds) {
            return Ok(None);
        }
        let every: Vec<usize> = (0..configurations.combinations()).collect();
        let own = configurations.open(&every, &mut Random::new(0))?;
        let (mut model, own_beta) = under(&own)?;
        model.closures.retain(holds);
        model.number_equations();
        let units = configurations.units(&model);
        let mut joined = Self {
            blocks: own.lane_of_rows().into_iter().map(|(block, _)| block).collect(),
            keyed: model.closures.iter().any(|c| c.unknowns().next().is_some()),
            sizes: configurations.sizes(&model),
            turns: configurations.turns(&units),
            limits: configurations.ends(&units),
            units,
            readings: own,
            beta: own_beta,
            model,
            been: Vec::new(),
        };
        let key = |row: usize| configurations.key_of(readings, row).unwrap_or_default();
        let rows = joined.rows((whole, readings, beta), weights, &key);
        joined.been = joined.settled(rows);
        Ok((!joined.been.is_empty()).then_some(joined))
    }

    /// Places of the rows of readings with a weight above zero, of many some.
    fn rows(
        &self,
        (model, readings, beta): (&Model, &Readings, &[f64]),
        weights: &[f64],
        key: &dyn Fn(usize) -> usize,
    ) -> Vec<Place> {
        let counted: Vec<usize> = (0..readings.samples).filter(|&row| weights[row] > 0.0).collect();
        let chosen = counted.iter().step_by(counted.len().div_ceil(BEEN).max(1));
        let chosen: Vec<usize> = chosen.copied().collect();
        let mut found = Vec::with_capacity(chosen.len());
        let mut ws = Workspace::default();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let lanes: Vec<usize> =
                (0..meta.live).filter(|&lane| chosen.contains(&meta.rows[lane])).collect();
            if lanes.is_empty() {
                continue;
            }
            let raw = readings.raw(block);
            model.evaluate(readings, block, raw, beta, Want { x: false, a: false }, &mut ws);
            for lane in lanes {
                let values = raw.iter().chain(&ws.xi).map(|a| a.0[lane]);
                found.push(self.place(key(meta.rows[lane]), values));
            }
        }
        found
    }

    fn place(&self, key: usize, values: impl Iterator<Item = f64>) -> Place {
        Place { key, at: values.zip(&self.units).map(|(value, unit)| value / unit).collect() }
    }

    /// Those that close, moved onto the loops.
    fn settled(&self, places: Vec<Place>) -> Vec<Place> {
        let mut found = Vec::with_capacity(places.len());
        let mut ws = Workspace::default();
        for place in places {
            let block = self.blocks[place.key];
            let settled = self.settle(block, vec![place.at], SETTLING, &mut ws);
            let ats = settled.into_iter().flatten().map(|(at, _)| Place { key: place.key, at });
            found.extend(ats);
        }
        found
    }

    /// Leaves those of the configurations that paths join to where the mechanism has been, which then
    /// has been there as well; and how many are taken out.
    pub(crate) fn keep(&mut self, keys: &[usize], closed: &mut [Option<Closed>]) -> usize {
        let told = |key: usize| !self.keyed || self.been.iter().any(|place| place.key == key);
        let place = |(k, closed): (usize, &Option<Closed>)| {
            let closed = closed.as_ref().filter(|_| told(keys[k]))?;
            Some((k, self.place(keys[k], closed.coordinates())))
        };
        let drawn: Vec<(usize, Place)> = closed.iter().enumerate().filter_map(place).collect();
        let mut apart = 0;
        for piece in drawn.chunks(TOGETHER) {
            for ((row, place), joined) in piece.iter().zip(self.join(piece)) {
                if !joined {
                    closed[*row] = None;
                    apart += 1;
                } else if self.been.len() < TOGETHER {
                    self.been.push(place.clone());
                }
            }
        }
        apart
    }

    /// Which of some places paths join to where the mechanism has been.
    fn join(&self, drawn: &[(usize, Place)]) -> Vec<bool> {
        let first = self.been.len();
        let all: Vec<Place> =
            self.been.iter().chain(drawn.iter().map(|(_, place)| place)).cloned().collect();
        let mut groups = Groups::new(first, self.neighbours(&all, first));
        for _ in 0..ROUNDS {
            let ways = groups.ways_out();
            if ways.is_empty() {
                break;
            }
            let arrived = self.walks(&all, &ways);
            for (way, _) in ways.iter().zip(arrived).filter(|(_, arrived)| *arrived) {
                groups.join(*way);
            }
        }
        (first..all.len()).map(|k| groups.root(k) == 0).collect()
    }

    /// Of each place from the first one on, the nearest others, of the same keys where these matter, with
    /// squares of how far they are.
    fn neighbours(&self, all: &[Place], first: usize) -> Vec<Vec<(f64, usize)>> {
        workers::map(first..all.len(), |a| {
            let other = |b: &usize| *b != a && !(self.keyed && all[*b].key != all[a].key);
            let far = |b: usize| (self.far(&all[a].at, &all[b].at), b);
            let mut near: Vec<(f64, usize)> = (0..all.len()).filter(other).map(far).collect();
            let nearer =
                |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
            if near.len() > NEAREST {
                near.select_nth_unstable_by(NEAREST, nearer);
                near.truncate(NEAREST);
            }
            near.sort_unstable_by(nearer);
            near
        })
    }

    /// A way to a place, without whole turns.
    fn way(&self, from: &[f64], goal: &[f64]) -> impl Iterator<Item = f64> {
        let ways = goal.iter().zip(from).zip(&self.turns);
        ways.map(|((goal, from), turn)| {
            let way = goal - from;
            if *turn > 0.0 { way - turn * (way / turn).round() } else { way }
        })
    }

    /// Square of the length of that way.
    fn far(&self, from: &[f64], goal: &[f64]) -> f64 {
        self.way(from, goal).map(|way| way * way).sum()
    }

    /// Which of the paths between these places arrive.
    fn walks(&self, all: &[Place], ways: &[(usize, usize)]) -> Vec<bool> {
        let key = |way: usize| all[ways[way].0].key;
        let mut order: Vec<usize> = (0..ways.len()).collect();
        order.sort_by_key(|&way| key(way));
        let together = order.chunk_by(|&a, &b| key(a) == key(b));
        let pieces: Vec<&[usize]> = together.flat_map(|same| same.chunks(WIDTH)).collect();
        let found = workers::map(&pieces, |piece| {
            let ends = piece.iter().map(|&way| ways[way]);
            let ends = ends.map(|(from, goal)| (&all[from].at[..], &all[goal].at[..]));
            self.walk(self.blocks[key(piece[0])], ends.collect())
        });
        let mut arrived = vec![false; ways.len()];
        for (&way, one) in pieces.concat().iter().zip(found.concat()) {
            arrived[way] = one;
        }
        arrived
    }

    /// Which of at most eight paths arrive.
    fn walk(&self, block: usize, ways: Vec<(&[f64], &[f64])>) -> Vec<bool> {
        let mut ws = Workspace::default();
        let starts = ways.iter().map(|(from, _)| from.to_vec()).collect();
        let starts = self.settle(block, starts, CORRECTIONS, &mut ws);
        let mut walks: Vec<Walk<'_>> = Vec::with_capacity(ways.len());
        for ((from, goal), start) in ways.into_iter().zip(starts) {
            let goal = from.iter().zip(self.way(from, goal)).map(|(from, way)| from + way);
            let goal = goal.collect();
            walks.push(Walk { from, goal, here: start, step: LONGEST, arrived: false });
        }
        for _ in 0..STEPS {
            let next = walks.iter().enumerate().filter_map(|(k, walk)| Some((k, walk.next()?)));
            let next: Vec<(usize, Next)> = next.collect();
            if next.is_empty() {
                break;
            }
            let trials = next.iter().map(|(_, next)| next.trial.clone()).collect();
            let settled = self.settle(block, trials, CORRECTIONS, &mut ws);
            for ((k, next), settled) in next.iter().zip(settled) {
                walks[*k].take(next, settled, &self.limits);
            }
        }
        walks.iter().map(|walk| walk.arrived).collect()
    }

    /// Newton's method from at most eight places; none where it does not close.
    fn settle(
        &self,
        block: usize,
        mut at: Vec<Vec<f64>>,
        steps: usize,
        ws: &mut Workspace,
    ) -> Vec<Option<(Vec<f64>, Stiff)>> {
        let mut stiff = self.look(block, &at, ws);
        for _ in 0..steps {
            let mut moved = false;
            for (at, stiff) in at.iter_mut().zip(&stiff).filter(|(_, stiff)| !stiff.is_closed()) {
                stiff.correct(at);
                moved = true;
            }
            if !moved {
                break;
            }
            stiff = self.look(block, &at, ws);
        }
        at.into_iter().zip(stiff).map(|found| found.1.is_closed().then_some(found)).collect()
    }

    /// The loops at places.
    fn look(&self, block: usize, at: &[Vec<f64>], ws: &mut Workspace) -> Vec<Stiff> {
        let lane = |c: usize| {
            let value = |lane: usize| at[lane.min(at.len() - 1)][c] * self.units[c];
            Lanes(std::array::from_fn(value))
        };
        let a: Vec<Lanes> = (0..self.units.len()).map(lane).collect();
        let want = Want { x: false, a: true };
        self.model.evaluate_at(&self.readings, block, &a, &self.beta, want, ws);
        (0..at.len()).map(|lane| self.stiff(ws, lane)).collect()
    }

    fn stiff(&self, ws: &Workspace, lane: usize) -> Stiff {
        let (m, n) = (self.sizes.len(), self.units.len());
        let places = ws.xi.len();
        let channels = n - places;
        let f = DVector::from_fn(m, |i, _| ws.f[i].0[lane] / self.sizes[i]);
        let g = DMatrix::from_fn(m, n, |i, c| {
            let by = match c < channels {
                true => ws.a[i * channels + c],
                false => ws.b[i * places + c - channels],
            };
            by.0[lane] * self.units[c] / self.sizes[i]
        });
        Stiff::of(f, g)
    }
}

/// A closure that holds at work. What touches something in the base is lifted off it, as is a chain from
/// the ball at the other end of a bar; rods, legs and belts stay.
fn holds(closure: &CompiledClosure) -> bool {
    let base = |end: &End| matches!(end, End::Fixed(_) | End::Unknown(..));
    let carried = |end: &End| matches!(end, End::Carried(..));
    let stays = closure.kind.facts().given == Given::Value && !closure.ends.iter().any(carried);
    closes(closure) && closure.equations() > 0 && (stays || !closure.ends.iter().any(base))
}

/// Misclosure of the loops, and the directions in which they are stiff: `G = U S Vᵀ`.
struct Stiff {
    f: DVector<f64>,
    u: DMatrix<f64>,
    s: Vec<f64>,
    v: DMatrix<f64>,
}

impl Stiff {
    fn of(f: DVector<f64>, g: DMatrix<f64>) -> Self {
        let (m, n) = g.shape();
        if g.iter().chain(f.iter()).any(|g| !g.is_finite()) {
            let f = DVector::from_element(m, f64::INFINITY);
            return Self { f, u: DMatrix::zeros(m, 0), s: vec![], v: DMatrix::zeros(n, 0) };
        }
        let eigen = (&g * g.transpose()).symmetric_eigen();
        let least = RANK * RANK * eigen.eigenvalues.max();
        let kept: Vec<usize> = (0..m).filter(|&k| eigen.eigenvalues[k] > least).collect();
        let s: Vec<f64> = kept.iter().map(|&k| eigen.eigenvalues[k].sqrt()).collect();
        let u = eigen.eigenvectors.select_columns(&kept);
        let mut v = g.transpose() * &u;
        v.column_iter_mut().zip(&s).for_each(|(mut v, s)| v /= *s);
        Self { f, u, s, v }
    }

    fn is_closed(&self) -> bool {
        self.f.amax() < NEARLY
    }

    /// The shortest step that closes.
    fn correct(&self, at: &mut [f64]) {
        let mut along = self.u.tr_mul(&self.f);
        along.iter_mut().zip(&self.s).for_each(|(along, s)| *along /= s);
        let step = &self.v * along;
        at.iter_mut().zip(step.iter()).for_each(|(at, step)| *at -= step);
    }

    /// The part of a way along which the loops are not stiff.
    fn free(&self, way: &DVector<f64>) -> DVector<f64> {
        way - &self.v * self.v.tr_mul(way)
    }

    /// The product of (174).
    fn alike(&self, other: &Self) -> f64 {
        if self.s.len() != other.s.len() {
            return 0.0;
        }
        self.v.tr_mul(&other.v).determinant() * self.u.tr_mul(&other.u).determinant()
    }
}

/// Configurations that paths join.
struct Groups {
    /// Of each configuration another one of its group that comes before it, or itself. Those
    /// where the mechanism has been are one group.
    before: Vec<usize>,
    first: usize,
    /// The nearest of each from the first one on.
    near: Vec<Vec<(f64, usize)>>,
}

impl Groups {
    fn new(first: usize, near: Vec<Vec<(f64, usize)>>) -> Self {
        let alone = first..first + near.len();
        Self { before: std::iter::repeat_n(0, first).chain(alone).collect(), first, near }
    }

    /// The first of a group.
    fn root(&self, mut k: usize) -> usize {
        while self.before[k] != k {
            k = self.before[k];
        }
        k
    }

    fn join(&mut self, (a, b): (usize, usize)) {
        let (a, b) = (self.root(a), self.root(b));
        self.before[a.max(b)] = a.min(b);
    }

    /// The shortest way that leads out of each group but the one where the mechanism has been. It is taken once.
    fn ways_out(&mut self) -> Vec<(usize, usize)> {
        let roots: Vec<usize> = (0..self.before.len()).map(|k| self.root(k)).collect();
        let mut shortest: Vec<Option<(f64, usize, usize)>> = vec![None; roots.len()];
        for (k, near) in self.near.iter_mut().enumerate() {
            let a = self.first + k;
            near.retain(|(_, b)| roots[*b] != roots[a]);
            let best = &mut shortest[roots[a]];
            if let Some(&(far, b)) = near.first().filter(|_| roots[a] != 0)
                && best.is_none_or(|(least, ..)| far < least)
            {
                *best = Some((far, a, b));
            }
        }
        let ways: Vec<(usize, usize)> =
            shortest.into_iter().flatten().map(|(_, a, b)| (a, b)).collect();
        for (a, b) in &ways {
            self.near[a - self.first].retain(|(_, other)| other != b);
        }
        ways
    }
}

/// One path.
struct Walk<'a> {
    from: &'a [f64],
    goal: Vec<f64>,
    /// Where it is; none where it cannot begin.
    here: Option<(Vec<f64>, Stiff)>,
    step: f64,
    arrived: bool,
}

/// A step of a path: where it leads along the loops, and what is tried.
struct Next {
    along: Vec<f64>,
    trial: Vec<f64>,
    last: bool,
}

impl Walk<'_> {
    /// The next step; none where it has arrived, or no way leads on.
    fn next(&self) -> Option<Next> {
        let (here, stiff) = self.here.as_ref()?;
        if self.arrived || self.step < SHORTEST {
            return None;
        }
        let way =
            DVector::from_iterator(here.len(), self.goal.iter().zip(here).map(|(g, h)| g - h));
        let (far, free) = (way.norm(), stiff.free(&way));
        if free.norm() < ALONG * far {
            return None;
        }
        let last = far <= self.step;
        let part = if last { 1.0 } else { self.step / far };
        let along: Vec<f64> =
            here.iter().zip(free.iter()).map(|(h, free)| h + part * free).collect();
        let trial = if last { self.goal.clone() } else { along.clone() };
        Some(Next { along, trial, last })
    }

    /// Takes a step where it is one along the loops and within limits, or else halves it.
    fn take(&mut self, next: &Next, settled: Option<(Vec<f64>, Stiff)>, limits: &[[f64; 2]]) {
        let Some((here, stiff)) = &self.here else { return };
        let far = |a: &[f64], b: &[f64]| -> f64 {
            a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        let good = |(at, after): &(Vec<f64>, Stiff)| {
            far(at, &next.along) <= CORRECTED * far(&next.along, here)
                && stiff.alike(after) > ALIKE
                && self.within(at, limits)
        };
        match settled.filter(good) {
            Some(there) => {
                self.here = Some(there);
                self.step = (2.0 * self.step).min(LONGEST);
                self.arrived = next.last;
            }
            None => self.step *= 0.5,
        }
    }

    /// True within limits, beyond which a path may begin and end.
    fn within(&self, at: &[f64], limits: &[[f64; 2]]) -> bool {
        at.iter().zip(limits).enumerate().all(|(c, (at, [low, high]))| {
            let (a, b) = (self.from[c], self.goal[c]);
            *at >= low.min(a).min(b) && *at <= high.max(a).max(b)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two lines that cross: `x y = 0`.
    fn cross(x: f64, y: f64) -> Stiff {
        Stiff::of(DVector::from_element(1, x * y), DMatrix::from_row_slice(1, 2, &[y, x]))
    }

    /// The same with one equation that follows from the other.
    fn twice(x: f64, y: f64) -> Stiff {
        let g = DMatrix::from_row_slice(2, 2, &[y, x, -2.0 * y, -2.0 * x]);
        Stiff::of(DVector::from_vec(vec![x * y, -2.0 * x * y]), g)
    }

    #[test]
    fn a_singular_configuration_is_seen_from_both_sides() {
        for of in [cross, twice] {
            assert!((of(-0.2, 0.0).alike(&of(-0.1, 0.0)) - 1.0).abs() < 1e-12);
            assert!((of(-0.1, 0.0).alike(&of(0.1, 0.0)) + 1.0).abs() < 1e-12);
            assert!(of(-0.1, 0.0).alike(&of(0.0, 0.1)).abs() < 1e-12);
        }
    }

    #[test]
    fn groups_are_joined_by_their_shortest_ways() {
        // Where it has been: 0 and 1. Then 2 and 3 beside each other, and 4, which is near 2.
        let near = vec![vec![(1.0, 3), (2.0, 4), (5.0, 1)], vec![(1.0, 2)], vec![(2.0, 2)]];
        let mut groups = Groups::new(2, near);
        assert_eq!(groups.ways_out(), [(2, 3), (3, 2), (4, 2)]);
        groups.join((2, 3));
        groups.join((3, 2));
        assert_eq!(groups.ways_out(), [(2, 4)]);
        assert_eq!(groups.ways_out(), [(2, 1)]);
        groups.join((2, 1));
        assert_eq!([1, 2, 3, 4].map(|k| groups.root(k)), [0, 0, 0, 4]);
        assert_eq!(groups.ways_out(), []);
    }

    #[test]
    fn a_correction_is_the_shortest_step_that_closes() {
        // x² + y² = 1, from (2, 0): the slope is 4, the misclosure 3.
        let stiff =
            Stiff::of(DVector::from_element(1, 3.0), DMatrix::from_row_slice(1, 2, &[4.0, 0.0]));
        let mut at = [2.0, 0.0];
        stiff.correct(&mut at);
        assert!((at[0] - 1.25).abs() < 1e-12 && at[1] == 0.0);
        assert_eq!(
            stiff.free(&DVector::from_vec(vec![1.0, 2.0])),
            DVector::from_vec(vec![0.0, 2.0])
        );
    }
}
