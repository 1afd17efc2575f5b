//! Profile likelihood: how far a combination of parameters can go before the cost, at its least over all
//! others, has risen by a quantile.
//!
//! With the estimate `x̂`, a row `l` and the least cost `c(v)` where `lᵀx = lᵀx̂ + v`, the ends of an
//! interval are
//!
//! ```text
//! 2 (c(v) - c(0)) = t²                                                    (151)
//! ```
//!
//! in units of the noise. Of a linear problem they are `± t sd`. The plane is left exactly: one parameter
//! follows from the others.

use faer::Mat;

use crate::numerics::linearization::{Curvature, Linearization, Problem};
use crate::numerics::lm::{self, SolverOptions};
use crate::numerics::symmetric::dot;

/// An end that is off by this part of itself. Beside a tail of 2.5 % of a normal distribution, with the density
/// `φ(1.96)`, that is `1.96 φ(1.96) · 0.044 = 0.5 %`: an interval of 95 % with two such ends holds the truth
/// in 94 to 96 %.
pub(crate) const OFF: f64 = 0.044;

/// An end beyond so many linear ones is none: the readings do not bound the parameter there.
const OPEN: f64 = 32.0;

/// Places that are tried for one end: a bracket halves at the worst, from 1 to `OFF` of a step.
const TRIED: usize = 16;

/// What is held, and how the parameters follow it where the problem is linear.
#[derive(Debug, Clone)]
pub struct Along {
    /// The combination `l` of the parameters.
    pub row: Vec<f64>,
    /// The parameter that follows from the others, one with an entry in the row.
    pub pivot: usize,
    /// Change of every parameter with a unit of the combination.
    pub slope: Vec<f64>,
    /// Half of the linear interval.
    pub half: f64,
}

/// Ends (151) of a combination at the minimum `x` of a problem, where it costs `cost`, as differences from the
/// estimate, low and high, where the cost is higher by half of `rise`; infinite where it stays below. `None` where
/// both are those of the linear interval, to 4.4 % of them.
#[must_use]
pub fn ends(
    problem: &impl Problem,
    x: &[f64],
    cost: f64,
    along: &Along,
    rise: f64,
) -> Option<[f64; 2]> {
    if !cost.is_finite() || ![along.half, rise].iter().all(|v| v.is_finite() && *v > 0.0) {
        return None;
    }
    let profile = Profile { problem, x, along, rise, cost };
    let up = profile.first(1.0);
    // What bends a cost to first order does so by as much on the other side.
    if up.off() < 0.5 * OFF {
        return None;
    }
    let down = profile.first(-1.0);
    if up.off() <= OFF && down.off() <= OFF {
        return None;
    }
    let [low, high] = [(-1.0, down), (1.0, up)].map(|(side, first)| profile.end(side, first));
    Some([-low * along.half, high * along.half])
}

/// A place of the profile: linear half widths away, the root of the rise over the wanted one, and the
/// parameters there.
#[derive(Clone)]
struct Place {
    away: f64,
    root: f64,
    x: Vec<f64>,
    /// True where it was looked for from afar.
    doubted: bool,
}

impl Place {
    /// True for one that may be of another minimum.
    fn is_doubted(&self) -> bool {
        self.doubted && self.root > 2.0
    }

    /// How far the root is from that of a linear problem.
    fn off(&self) -> f64 {
        (self.root / self.away - 1.0).abs()
    }
}

/// Steps along a profile from which it is told from another minimum, in parts of the way so far.
const NEAR: f64 = 1.1;

struct Profile<'a, P> {
    problem: &'a P,
    x: &'a [f64],
    along: &'a Along,
    rise: f64,
    cost: f64,
}

impl<P: Problem> Profile<'_, P> {
    /// The end of the linear interval.
    fn first(&self, side: f64) -> Place {
        self.at(side, 1.0, &self.linear(side))
    }

    /// The parameters so many linear half widths away, were the problem linear.
    fn linear(&self, away: f64) -> Vec<f64> {
        let by = away * self.along.half;
        self.x.iter().zip(&self.along.slope).map(|(x, slope)| x + by * slope).collect()
    }

    /// So many times as far from the estimate as a place.
    fn beyond(&self, place: &[f64], times: f64) -> Vec<f64> {
        self.x.iter().zip(place).map(|(x, there)| x + times * (there - x)).collect()
    }

    /// The profile so far away, looked for from a start.
    fn at(&self, side: f64, away: f64, start: &[f64]) -> Place {
        let Along { row, pivot, half, .. } = self.along;
        let value = dot(row, self.x) + side * away * half;
        let plane = Plane { problem: self.problem, row, pivot: *pivot, value };
        // A step that would change the end by a quarter of what counts is not taken.
        let options = SolverOptions {
            ptol: 0.25 * OFF * self.rise,
            max_iterations: 50,
            ..SolverOptions::default()
        };
        let found = lm::minimize(&plane, &plane.without(start), &options);
        let rise = 2.0 * (found.cost - self.cost);
        let root =
            if rise.is_finite() { (rise.max(0.0) / self.rise).sqrt() } else { f64::INFINITY };
        Place { away, root, x: plane.whole(&found.x), doubted: true }
    }

    /// How far away the end is, from what the end of the linear interval says.
    fn end(&self, side: f64, first: Place) -> f64 {
        let mut low = Place { away: 0.0, root: 0.0, x: self.x.to_vec(), doubted: false };
        let (mut high, mut place): (Option<Place>, _) = (None, first);
        let mut near = false;
        for tried in 0..TRIED {
            if (place.root - 1.0).abs() < 0.25 * OFF {
                return place.away;
            }
            match place.root < 1.0 {
                true => low = place,
                // What was found from afar may be another minimum: it is looked at again from nearby.
                false => high = Some(Place { doubted: !near, ..place }),
            }
            let again = high.take_if(|high| high.is_doubted() && NEAR * low.away >= high.away);
            let away = match (&again, &high) {
                (Some(again), _) => again.away,
                (None, Some(high)) => between(&low, high, tried),
                (None, None) => low.away * (1.0 / low.root).clamp(NEAR, 2.0),
            };
            if away > OPEN {
                return f64::INFINITY;
            }
            // Along the curve of the profile, as it went from the estimate to the last place below the end.
            let finite = high.as_ref().filter(|high| low.away == 0.0 && high.root.is_finite());
            let last = finite.unwrap_or(&low);
            let start = match last.away > 0.0 {
                true => self.beyond(&last.x, away / last.away),
                false => self.linear(side * away),
            };
            near = low.away > 0.0 && away <= NEAR * low.away;
            place = self.at(side, away, &start);
        }
        place.away
    }
}

/// Where a bracket is looked into: where a line between its ends has the end, never in their outer
/// tenths; in its middle every other time, for ends of which a line says little.
fn between(low: &Place, high: &Place, tried: usize) -> f64 {
    let part = (1.0 - low.root) / (high.root - low.root);
    let part = if part.is_finite() && (tried < 2 || tried.is_multiple_of(2)) {
        part.clamp(0.1, 0.9)
    } else {
        0.5
    };
    low.away + part * (high.away - low.away)
}

/// A problem on the plane `lᵀx = value`.
struct Plane<'a, P> {
    problem: &'a P,
    row: &'a [f64],
    pivot: usize,
    value: f64,
}

impl<P> Plane<'_, P> {
    /// The other parameters.
    fn without(&self, x: &[f64]) -> Vec<f64> {
        let mut x = x.to_vec();
        x.remove(self.pivot);
        x
    }

    /// All parameters.
    fn whole(&self, others: &[f64]) -> Vec<f64> {
        let mut x = others.to_vec();
        x.insert(self.pivot, 0.0);
        x[self.pivot] = (self.value - dot(self.row, &x)) / self.row[self.pivot];
        x
    }
}

impl<P: Problem> Problem for Plane<'_, P> {
    fn parameters(&self) -> usize {
        self.problem.parameters() - 1
    }

    fn linearize(&self, x: &[f64]) -> Linearization {
        let whole = self.problem.linearize(&self.whole(x));
        let (gram, p) = (whole.gram(), self.pivot);
        let of = |i: usize| if i < p { i } else { i + 1 };
        // How the pivot follows.
        let follows: Vec<f64> = (0..x.len()).map(|i| -self.row[of(i)] / self.row[p]).collect();
        let gradient = (0..x.len()).map(|i| whole.gradient[of(i)] + follows[i] * whole.gradient[p]);
        let entry = |i: usize, j: usize| {
            let (a, b) = (follows[i], follows[j]);
            let own = gram[(of(i), of(j))];
            if a == 0.0 && b == 0.0 {
                return own;
            }
            own + a * gram[(p, of(j))] + b * gram[(of(i), p)] + a * b * gram[(p, p)]
        };
        let mixed = |island: &Vec<usize>| island.iter().any(|i| *i != p && self.row[*i] != 0.0);
        let islands = match whole.islands.iter().any(mixed) {
            true => Vec::new(),
            false => (whole.islands.iter().map(|island| self.shifted(island)))
                .filter(|island| !island.is_empty())
                .collect(),
        };
        Linearization {
            cost: whole.cost,
            gradient: gradient.collect(),
            curvature: Curvature::Gram(Mat::from_fn(x.len(), x.len(), entry)),
            islands,
        }
    }
}

impl<P> Plane<'_, P> {
    /// An island without the pivot.
    fn shifted(&self, island: &[usize]) -> Vec<usize> {
        let left = island.iter().filter(|i| **i != self.pivot);
        left.map(|i| i - usize::from(*i > self.pivot)).collect()
    }
}
