//! What a parameter has done over the results of a device, by one price.

use crate::history::past::Past;
use crate::history::regression::{Shape, fitted, likeliest, unbiased};
use crate::numerics::distributions::{f_tail, normal_quantile, student_quantile};
use crate::numerics::order::Ends;

/// Probability with which chance pays the price of a part of (127).
const LEVEL: f64 = 0.01;

/// What a parameter has done.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Course {
    /// Its parts that are worth their price.
    pub kind: CourseKind,
    /// Level at the last date and its standard deviation.
    pub level: (f64, f64),
    /// Rate per day, between the jumps; zero is not what it says where `kind` has no drift. None where no two dates are
    /// between the same jumps.
    pub rate: Option<f64>,
    /// Standard deviation of the rate.
    pub rate_sd: Option<f64>,
    /// Probability of such a rate by chance.
    pub p_value: Option<f64>,
    /// Jumps, in order.
    pub jumps: Vec<Jump>,
    /// Standard deviation of the scatter beside what the results state.
    pub scatter: f64,
    /// Half width of an interval of 95 % in standard deviations: Student's where there is scatter.
    pub wide: f64,
}

impl Course {
    /// Its parts but for scatter.
    pub(super) fn shape(&self) -> Shape {
        let line = matches!(self.kind, CourseKind::Drift | CourseKind::DriftAndJump);
        Shape { line, jumps: self.jumps.iter().map(|jump| jump.from - 1).collect() }
    }
}

/// Parts of what a parameter has done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum CourseKind {
    /// None.
    Still,
    /// A rate.
    Drift,
    /// Jumps.
    Jump,
    /// Both.
    #[cfg_attr(feature = "serde", serde(rename = "drift and jump"))]
    DriftAndJump,
}

/// A new level.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Jump {
    /// The result from which on it holds, from 0.
    pub from: usize,
    /// How far the level jumped.
    pub value: f64,
    /// Standard deviation.
    pub sd: f64,
    /// True where a result itself says that something changed there.
    pub told: bool,
}

/// The parts of (127) that are worth their price, the cheapest first.
///
/// The price of a shape is `-2 ln L` plus a charge for each part: what chance pays with a probability
/// of 1 %, for all of `tests` parameters together. With `q` that quantile of `|z|`, of one choice for a rate, of all `n - 1` places for a jump, of
/// one for a jump that a result has told (`told`: the results from which on), and one-sided for scatter,
/// the charge is
///
/// ```text
/// q²  without scatter,    n ln(1 + t²/(n - k))  with it                           (128)
/// ```
///
/// where `t` is Student's quantile of the same probability: what a likelihood with an unknown
/// scale gains by it.
///
/// None for fewer than two dates, or for a deviation that is not above 0.
#[must_use]
pub fn course(past: &[Past], told: &[usize], tests: usize) -> Option<Course> {
    let usable = |p: &Past| p.value.is_finite() && p.sd.is_finite() && p.sd > 0.0;
    let dates = past.windows(2).filter(|two| two[1].day > two[0].day).count();
    if dates == 0 || !past.iter().all(usable) {
        return None;
    }
    // From the last estimate on: a parameter that stands still has a rate of zero, not of rounding.
    let base = past.last()?.value;
    let past: Vec<Past> = past.iter().map(|p| Past { value: p.value - base, ..*p }).collect();
    let life = Life { past: &past, told, level: LEVEL / tests.max(1) as f64 };
    let shapes = [false, true].map(|line| life.with_jumps(line));
    let best = shapes.into_iter().least_by(|a| a.price)?;
    let found = life.concluded(&best);
    Some(Course { level: (found.level.0 + base, found.level.1), ..found })
}

struct Life<'a> {
    past: &'a [Past],
    told: &'a [usize],
    /// Probability with which chance pays for a part.
    level: f64,
}

/// A shape with its price and the scatter that it has.
#[derive(Clone)]
struct Priced {
    shape: Shape,
    scatter: bool,
    price: f64,
}

impl Life<'_> {
    fn is_told(&self, jump: usize) -> bool {
        self.told.contains(&(jump + 1))
    }

    fn charge(&self, shape: &Shape, scatter: bool) -> f64 {
        let n = self.past.len() as f64;
        let dof = n - shape.width() as f64;
        let part = |level: f64| {
            if scatter {
                let t = student_quantile(1.0 - 0.5 * level, dof.max(1.0));
                n * (t * t / dof.max(1.0)).ln_1p()
            } else {
                normal_quantile(1.0 - 0.5 * level).powi(2)
            }
        };
        let places = (n - 1.0).max(1.0);
        let jump = |&j: &usize| if self.is_told(j) { self.level } else { self.level / places };
        let jumps: f64 = shape.jumps.iter().map(|j| part(jump(j))).sum();
        let line = if shape.line { part(self.level) } else { 0.0 };
        let scattered = if scatter { normal_quantile(1.0 - self.level).powi(2) } else { 0.0 };
        jumps + line + scattered
    }

    fn priced(&self, shape: Shape) -> Priced {
        let cost = |tau2| fitted(self.past, &shape, tau2).cost;
        let tau2 = likeliest(self.past, &shape);
        let still = cost(0.0) + self.charge(&shape, false);
        // Scatter takes the place of what the results leave; one result more than parts tells it.
        let known = self.past.len() > shape.width() + 1;
        let loose = if known && tau2 > 0.0 {
            cost(tau2) + self.charge(&shape, true)
        } else {
            f64::INFINITY
        };
        let scatter = loose < still;
        Priced { shape, scatter, price: loose.min(still) }
    }

    /// The cheapest shape with a line or without, jump after jump, one more than pays: two jumps may
    /// pay where one does not. Then without those that do not.
    fn with_jumps(&self, line: bool) -> Priced {
        let mut here = self.priced(Shape { line, jumps: Vec::new() });
        let mut best = here.clone();
        // Two results for each part, but for a jump that a result has told itself.
        let found = self.past.len().saturating_sub(2 + usize::from(line)) / 2;
        let told = (0..self.past.len() - 1).filter(|&j| self.is_told(j)).count();
        let most = (found + told).min(self.past.len().saturating_sub(1 + usize::from(line)));
        for _ in 0..most {
            let tau2 = if here.scatter { likeliest(self.past, &here.shape) } else { 0.0 };
            let free = |j: &usize| {
                !here.shape.jumps.contains(j) && self.past[*j].day < self.past[j + 1].day
            };
            let with = |j: usize| {
                let mut jumps = here.shape.jumps.clone();
                jumps.push(j);
                jumps.sort_unstable();
                Shape { line, jumps }
            };
            let price = |j: usize| {
                let shape = with(j);
                fitted(self.past, &shape, tau2).cost + self.charge(&shape, here.scatter)
            };
            let untold = here.shape.jumps.iter().filter(|&&j| !self.is_told(j)).count();
            let places = (0..self.past.len() - 1)
                .filter(free)
                .filter(|&j| self.is_told(j) || untold < found);
            let scored: Vec<(usize, f64)> = places.map(|j| (j, price(j))).collect();
            let Some(next) = scored.iter().least_by(|a| a.1) else { break };
            here = self.priced(with(next.0));
            if here.price < best.price {
                best = here.clone();
            } else if here.shape.jumps.len() > best.shape.jumps.len() + 1 {
                break;
            }
        }
        self.pruned(best)
    }

    fn pruned(&self, mut best: Priced) -> Priced {
        let mut k = 0;
        while k < best.shape.jumps.len() {
            let mut shape = best.shape.clone();
            shape.jumps.remove(k);
            let without = self.priced(shape);
            if without.price < best.price {
                (best, k) = (without, 0);
            } else {
                k += 1;
            }
        }
        best
    }

    fn concluded(&self, best: &Priced) -> Course {
        let tau2 = |shape: &Shape| if best.scatter { unbiased(self.past, shape) } else { 0.0 };
        let shape = &best.shape;
        let own = fitted(self.past, shape, tau2(shape));
        let sd = |k: usize| own.covariance[(k, k)].max(0.0).sqrt();
        let first = 1 + usize::from(shape.line);
        let jump = |(k, &j): (usize, &usize)| Jump {
            from: j + 1,
            value: own.x[first + k],
            sd: sd(first + k),
            told: self.is_told(j),
        };
        let dof = |shape: &Shape| match best.scatter {
            true => shape.dof(self.past.len()).max(1.0),
            false => f64::INFINITY,
        };
        let lined = Shape { line: true, ..shape.clone() };
        let rated = lined.tells_rate(self.past).then(|| {
            let rated = fitted(self.past, &lined, tau2(&lined));
            let (rate, sd) = (rated.x[1], rated.covariance[(1, 1)].max(0.0).sqrt());
            (rate, sd, f_tail((rate / sd).powi(2), 1.0, dof(&lined)))
        });
        let wide = match best.scatter {
            true => student_quantile(0.975, dof(shape)),
            false => normal_quantile(0.975),
        };
        Course {
            kind: match (shape.line, shape.jumps.is_empty()) {
                (false, true) => CourseKind::Still,
                (true, true) => CourseKind::Drift,
                (false, false) => CourseKind::Jump,
                (true, false) => CourseKind::DriftAndJump,
            },
            level: (own.x[0], sd(0)),
            rate: rated.map(|it| it.0),
            rate_sd: rated.map(|it| it.1),
            p_value: rated.map(|it| it.2),
            jumps: shape.jumps.iter().enumerate().map(jump).collect(),
            scatter: tau2(shape).sqrt(),
            wide,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::random::Random;

    fn normal(random: &mut Random) -> f64 {
        // The sum of twelve uniform numbers: its tails end at 6, which no test here needs.
        (0..12).map(|_| random.uniform(-0.5, 0.5)).sum()
    }

    fn life(seed: u64, rate: f64, jump: f64, scatter: f64) -> Vec<Past> {
        let random = &mut Random::new(seed);
        let at = 6 + random.below(12);
        let value = |i: usize, random: &mut Random| {
            let level = if i >= at { jump } else { 0.0 };
            rate * i as f64 / 23.0 + level + (1.0 + scatter * scatter).sqrt() * normal(random)
        };
        (0..24).map(|i| Past { day: 30.0 * i as f64, value: value(i, random), sd: 1.0 }).collect()
    }

    fn named(kind: CourseKind, rate: f64, jump: f64, scatter: f64) -> usize {
        let of = |seed: u64| course(&life(seed, rate, jump, scatter), &[], 1);
        (0..60).filter(|&seed| of(seed).is_some_and(|c| c.kind == kind)).count()
    }

    #[test]
    fn a_jump_between_two_results_tells_no_rate() {
        let at = |day: f64, value: f64| Past { day, value, sd: 1.0 };
        let past = [at(0.0, 0.0), at(100.0, 10.0)];
        let found = course(&past, &[1], 1).expect("two dates");
        assert_eq!(found.kind, CourseKind::Jump);
        assert_eq!((found.rate, found.rate_sd, found.p_value), (None, None, None));
        assert!((found.jumps[0].value - 10.0).abs() < 1e-9);
        // A third result tells a rate, from its own part alone: 0.02 a day, by deviations of sqrt(2)/50.
        let past = [at(0.0, 0.0), at(100.0, 10.0), at(150.0, 11.0)];
        let found = course(&past, &[1], 1).expect("three dates");
        let (rate, sd) = (found.rate.expect("told"), found.rate_sd.expect("told"));
        assert!((rate - 0.02).abs() < 1e-9 && (sd - 2.0_f64.sqrt() / 50.0).abs() < 1e-9);
    }

    #[test]
    fn lives_are_called_what_they_are() {
        // 95 of 100 are asked; of 60 lives fewer than 52 come by chance once in 500 runs then.
        assert!(named(CourseKind::Still, 0.0, 0.0, 0.0) >= 52);
        assert!(named(CourseKind::Still, 0.0, 0.0, 3.0) >= 52);
        assert!(named(CourseKind::Drift, 12.0, 0.0, 0.0) >= 52);
        assert!(named(CourseKind::Jump, 0.0, 12.0, 0.0) >= 52);
        assert!(named(CourseKind::DriftAndJump, 12.0, 12.0, 0.0) >= 52);
    }

    #[test]
    fn a_jump_that_a_result_tells_needs_less_to_be_one() {
        let steps = |size: f64| -> Vec<Past> {
            let value = |i: usize| if i >= 4 { size } else { 0.0 };
            (0..8).map(|i| Past { day: i as f64, value: value(i), sd: 1.0 }).collect()
        };
        // The difference of two means of four has the standard deviation √(1/4 + 1/4): 2 are z = 2.83,
        // above 2.58 of one place and below 3.19 of seven. A line explains .76 of its square, 2.47².
        let found = course(&steps(2.0), &[4], 1).map(|c| (c.kind, c.jumps.len()));
        assert_eq!(found, Some((CourseKind::Jump, 1)));
        assert_eq!(course(&steps(2.0), &[], 1).map(|c| c.kind), Some(CourseKind::Still));
        let told = course(&steps(9.0), &[4], 1).and_then(|c| c.jumps.first().copied());
        assert!(told.is_some_and(|jump| jump.told && (jump.value - 9.0).abs() < 1e-9));
    }

    #[test]
    fn of_a_few_results_a_jump_is_one_where_a_result_tells_it() {
        let of = |values: &[f64], told: &[usize]| {
            let past = values.iter().enumerate();
            let past: Vec<Past> =
                past.map(|(i, value)| Past { day: i as f64, value: *value, sd: 1.0 }).collect();
            course(&past, told, 1).map(|c| (c.kind, c.jumps.first().map(|jump| jump.from)))
        };
        let jump = |from: usize| Some((CourseKind::Jump, Some(from)));
        assert_eq!(of(&[0.0, 90.0], &[1]), jump(1));
        assert_eq!(of(&[0.0, 90.0, 90.5], &[1]), jump(1));
        assert_eq!(of(&[0.0, 0.5, 90.0], &[2]), jump(2));
        // Told, and by no more than chance.
        assert_eq!(of(&[0.0, 1.0], &[1]), Some((CourseKind::Still, None)));
        // Where nothing was told three results that scatter are no jump.
        assert_eq!(of(&[0.0, 90.0, 60.0], &[]), Some((CourseKind::Still, None)));
    }

    #[test]
    fn one_date_has_no_course() {
        let past = [Past { day: 1.0, value: 1.0, sd: 1.0 }; 3];
        assert!(course(&past, &[], 1).is_none() && course(&[], &[], 1).is_none());
    }
}
