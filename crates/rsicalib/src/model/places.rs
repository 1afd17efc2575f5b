//! Where things are that are unknown in one pose alone, and how unknown planes face.
//!
//! In each sample, at readings `a` and parameters `β`, `ξ` is where the closures are nearest to
//! closed, all lengths alike:
//!
//! ```text
//! ξ = argmin Σ (f / length)²                                              (58)
//! ```
//!
//! This is where a fit starts; it then settles `ξ` with the weights of the noise, (59). Of mirror
//! solutions the one is taken that the search finds from where the mechanism's file looks for it.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use crate::mechanism::around;
use crate::model::compiled::{Model, Patch};
use crate::model::ends::End;
use crate::model::evaluation::{Want, Workspace};
use crate::model::numbering::Thing;
use crate::numerics::lanes::{Lanes, WIDTH};
use crate::readings::Readings;

/// The one rule of rank for what is unknown in one pose: a direction that moves the equations less
/// than this part of what the strongest does is not determined there.
pub(crate) const RANK: f64 = 1e-6;

/// Steps towards (58).
const STEPS: usize = 60;

/// A step of this part of the place is none.
const STILL: f64 = 1e-13;

/// The other of two solutions is taken where it leaves less than this part of the squares.
const CLEARLY: f64 = 0.25;

/// A surface: the closure that a known one is of, or the number of an unknown one.
type Surface = (Option<usize>, usize);

/// Squares of the equations of eight samples at a place, with `f` and `B`.
struct Near {
    xi: Vec<Lanes>,
    f: Vec<Lanes>,
    b: Vec<Lanes>,
    cost: [f64; WIDTH],
}

impl Model {
    /// The readings of a block, and after them what is unknown in each of its poses, (58).
    pub(crate) fn placed(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        ws: &mut Workspace,
    ) -> Vec<Lanes> {
        let drawn = self.posed.iter().flat_map(|p| p.slots.iter().zip(p.at));
        let drawn = drawn.filter(|(slot, _)| slot.is_some()).map(|(_, at)| Lanes::splat(at));
        let mut best = self.nearest(readings, block, a, beta, drawn.collect(), ws);
        let among = self.among(readings, block, beta, ws);
        let other = self.nearest(readings, block, a, beta, among, ws);
        for lane in 0..WIDTH {
            let size: f64 = best.xi.iter().map(|x| x.0[lane].abs()).fold(0.0, f64::max);
            let closed = best.cost[lane] < (1e-9 * size).powi(2);
            let better = other.cost[lane] < CLEARLY * best.cost[lane] || best.cost[lane].is_nan();
            if !closed && better {
                for (best, other) in best.xi.iter_mut().zip(&other.xi) {
                    best.0[lane] = other.0[lane];
                }
            }
        }
        a[..self.scales.len()].iter().copied().chain(best.xi).collect()
    }

    /// Amid the ends that hold each point.
    fn among(&self, readings: &Readings, block: usize, beta: &[f64], ws: &Workspace) -> Vec<Lanes> {
        let (group, seen) = (readings.blocks()[block].group, readings.columns(block));
        let mut sums = vec![[Lanes::ZERO; 3]; self.posed.len()];
        let mut counts = vec![0.0; self.posed.len()];
        for closure in self.closures.iter().filter(|c| c.kind.is_between_points()) {
            let (number, other) = match closure.ends {
                [End::Posed(number), other] | [other, End::Posed(number)] => (number, other),
                _ => continue,
            };
            if matches!(other, End::Posed(_)) {
                continue;
            }
            let at = self.end_point(&other, group, seen, beta, ws);
            sums[number].iter_mut().zip(at).for_each(|(sum, at)| *sum += at);
            counts[number] += 1.0;
        }
        let mut xi = Vec::with_capacity(self.pose_unknowns);
        for ((posed, sum), count) in self.posed.iter().zip(&sums).zip(counts) {
            for ((slot, sum), at) in posed.slots.iter().zip(sum).zip(posed.at) {
                if slot.is_some() {
                    let none = count == 0.0;
                    xi.push(if none { Lanes::splat(at) } else { *sum * (1.0 / count) });
                }
            }
        }
        xi
    }

    /// Damped least squares from a start, lane by lane.
    fn nearest(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        start: Vec<Lanes>,
        ws: &mut Workspace,
    ) -> Near {
        let lengths = self.lengths();
        let mut look = |xi: &[Lanes]| {
            let at: Vec<Lanes> = a[..self.scales.len()].iter().chain(xi).copied().collect();
            self.evaluate(readings, block, &at, beta, Want { x: false, a: true }, ws);
            let mut cost = [0.0; WIDTH];
            for (f, length) in ws.f.iter().zip(&lengths) {
                cost.iter_mut().zip(f.0).for_each(|(cost, f)| *cost += (f * length).powi(2));
            }
            Near { xi: xi.to_vec(), f: ws.f.clone(), b: ws.b.clone(), cost }
        };
        let mut here = look(&start);
        let mut damping = [1e-3; WIDTH];
        for _ in 0..STEPS {
            let mut xi = here.xi.clone();
            let mut moved = false;
            for (lane, damping) in damping.iter().enumerate() {
                let Some(step) = here.step(lane, *damping, &lengths) else { continue };
                for (x, step) in xi.iter_mut().zip(step.iter()) {
                    moved |= step.abs() > STILL * (1.0 + x.0[lane].abs());
                    x.0[lane] += step;
                }
            }
            if !moved {
                break;
            }
            let there = look(&xi);
            for (lane, damping) in damping.iter_mut().enumerate() {
                if there.cost[lane] < here.cost[lane] {
                    here.take(&there, lane);
                    *damping *= 0.1;
                } else {
                    *damping = (*damping * 10.0).min(1e12);
                }
            }
        }
        here
    }

    /// Leaves as drawn what no closure determines of the points that are somewhere else in each pose.
    pub(crate) fn leave_out_loose_coordinates(&mut self, readings: &Readings) {
        if self.pose_unknowns == 0 {
            return;
        }
        let (n, lengths, beta) = (self.pose_unknowns, self.lengths(), self.nominal());
        let mut ws = Workspace::default();
        let mut kept: Vec<usize> = Vec::new();
        let all = readings.blocks().len();
        for block in [0, all / 2, all - 1] {
            let want = Want { x: false, a: true };
            self.evaluate(readings, block, readings.raw(block), &beta, want, &mut ws);
            let b = DMatrix::from_fn(self.equations, n, |k, j| ws.b[k * n + j].0[0] * lengths[k]);
            let here = independent(&b);
            if here.len() > kept.len() {
                kept = here;
            }
        }
        if kept.len() == n {
            return;
        }
        for slot in self.posed.iter_mut().flat_map(|p| &mut p.slots) {
            *slot = slot.and_then(|own| kept.iter().position(|k| *k == own));
        }
        self.pose_unknowns = kept.len();
    }

    /// Lets the normals of unknown planes lean from that axis of the base that their points are most
    /// nearly across, where no normal is drawn.
    pub(crate) fn face_planes(&mut self, readings: &Readings) {
        let undrawn = |thing: Thing| match thing {
            Thing::Plane(p) => self.mechanism.planes[p].normal.is_none(),
            _ => false,
        };
        if !self.unknowns.iter().any(|unknown| undrawn(unknown.thing)) {
            return;
        }
        let beta = self.nominal();
        for (number, points) in self.points_on_planes(readings, &beta).into_iter().enumerate() {
            if let Some((normal, _)) = plane_through(&points)
                && undrawn(self.unknowns[number].thing)
            {
                let axis = normal.iamax();
                self.axes[number] = around(std::array::from_fn(|i| f64::from(u8::from(i == axis))));
            }
        }
    }

    /// Finds where each plane with a shape is touched, as drawn.
    pub(crate) fn find_patches(&mut self, readings: &Readings) {
        if self.closures.iter().all(|closure| closure.shapes.is_empty()) {
            return;
        }
        let mut beta = self.nominal();
        self.place_unknowns(readings, &mut beta);
        let mut ws = Workspace::default();
        // An unknown plane is one surface for all that touch it; a known one is that of its closure.
        let surface = |k: usize, group: usize| match self.closures[k].plane {
            Some(plane) => (None, self.owned[plane].numbers[group]),
            None => (Some(k), 0),
        };
        let axes = |k: usize, group: usize| {
            let closure = &self.closures[k];
            let known = closure.along.as_ref().and_then(|along| along.first().copied());
            let [_, u, v] = match closure.plane {
                Some(plane) => self.axes[self.owned[plane].numbers[group]],
                None => around(known.unwrap_or([0.0, 0.0, 1.0])),
            };
            [u, v]
        };
        let mut ends: Vec<(Surface, [[f64; 2]; 2])> = Vec::new();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let want = Want { x: false, a: false };
            self.evaluate(readings, block, readings.raw(block), &beta, want, &mut ws);
            for (k, closure) in self.closures.iter().enumerate() {
                if closure.shapes.is_empty() {
                    continue;
                }
                let seen = readings.columns(block);
                let at = self.end_point(&closure.ends[0], meta.group, seen, &beta, &ws);
                let (own, axes) = (surface(k, meta.group), axes(k, meta.group));
                let known = ends.iter().position(|(of, _)| *of == own);
                let known = known.unwrap_or_else(|| {
                    ends.push((own, [[f64::INFINITY, f64::NEG_INFINITY]; 2]));
                    ends.len() - 1
                });
                for (range, axis) in ends[known].1.iter_mut().zip(axes) {
                    for lane in readings.lanes(block, closure.number) {
                        let along: f64 = (0..3).map(|i| axis[i] * at[i].0[lane]).sum();
                        *range = [range[0].min(along), range[1].max(along)];
                    }
                }
            }
        }
        let patch = |k: usize, group: usize| {
            let own = ends.iter().find(|(of, _)| *of == surface(k, group));
            let ranges = own.map_or([[-1.0, 1.0]; 2], |(_, ranges)| *ranges);
            let half = ranges.map(|[low, high]| (0.5 * (high - low)).max(f64::MIN_POSITIVE));
            Patch { axes: axes(k, group), middle: ranges.map(|[l, h]| 0.5 * (l + h)), half }
        };
        let patches: Vec<Vec<Patch>> = (0..self.closures.len())
            .map(|k| match self.closures[k].shapes.is_empty() {
                true => Vec::new(),
                false => (0..readings.groups.len()).map(|group| patch(k, group)).collect(),
            })
            .collect();
        for (closure, patches) in self.closures.iter_mut().zip(patches) {
            closure.patches = patches;
        }
    }

    /// For each unknown, the points that chains carry onto it, where it is a plane.
    pub(crate) fn points_on_planes(
        &self,
        readings: &Readings,
        beta: &[f64],
    ) -> Vec<Vec<Vector3<f64>>> {
        let mut points = vec![Vec::new(); self.unknowns.len()];
        let mut ws = Workspace::default();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let want = Want { x: false, a: false };
            self.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
            for closure in &self.closures {
                let Some(plane) = closure.plane else { continue };
                if matches!(closure.ends[0], End::Posed(_)) {
                    continue;
                }
                let seen = readings.columns(block);
                let at = self.end_point(&closure.ends[0], meta.group, seen, beta, &ws);
                let own = &mut points[self.owned[plane].numbers[meta.group]];
                let lanes = readings.lanes(block, closure.number);
                own.extend(lanes.map(|lane| Vector3::from_fn(|i, _| at[i].0[lane])));
            }
        }
        points
    }
}

impl Near {
    /// The damped step of one lane; none where nothing is to be had.
    fn step(&self, lane: usize, damping: f64, lengths: &[f64]) -> Option<DVector<f64>> {
        let n = self.xi.len();
        let mut gram = DMatrix::<f64>::zeros(n, n);
        let mut slope = DVector::<f64>::zeros(n);
        for (k, length) in lengths.iter().enumerate() {
            let row = |j: usize| self.b[k * n + j].0[lane] * length;
            for i in 0..n {
                slope[i] -= row(i) * self.f[k].0[lane] * length;
                for j in 0..n {
                    gram[(i, j)] += row(i) * row(j);
                }
            }
        }
        let least = RANK * RANK * gram.diagonal().max();
        for i in 0..n {
            gram[(i, i)] += damping * gram[(i, i)].max(least);
        }
        let step = gram.cholesky()?.solve(&slope);
        step.iter().all(|s| s.is_finite()).then_some(step)
    }

    fn take(&mut self, other: &Self, lane: usize) {
        let pairs = [(&mut self.xi, &other.xi), (&mut self.f, &other.f), (&mut self.b, &other.b)];
        for (own, other) in pairs {
            own.iter_mut().zip(other).for_each(|(own, other)| own.0[lane] = other.0[lane]);
        }
        self.cost[lane] = other.cost[lane];
    }
}

/// Columns of a matrix that are independent of those before them.
fn independent(columns: &DMatrix<f64>) -> Vec<usize> {
    let largest = columns.column_iter().map(|c| c.norm()).fold(0.0, f64::max);
    let mut kept = Vec::new();
    let mut base: Vec<DVector<f64>> = Vec::new();
    for (k, column) in columns.column_iter().enumerate() {
        let mut left = column.into_owned();
        for direction in base.iter().chain(&base) {
            left -= direction * direction.dot(&left);
        }
        if left.norm() > RANK * largest {
            kept.push(k);
            base.push(left.normalize());
        }
    }
    kept
}

/// The plane nearest to points: its unit normal, towards the positive side of the axis that it is
/// nearest to, and its offset; none for fewer than three points.
pub(crate) fn plane_through(points: &[Vector3<f64>]) -> Option<(Vector3<f64>, f64)> {
    if points.len() < 3 {
        return None;
    }
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let square = |p: &Vector3<f64>| (p - mean) * (p - mean).transpose();
    let squares: Matrix3<f64> = points.iter().map(square).sum();
    let eigen = squares.symmetric_eigen();
    let mut normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    if normal[normal.iamax()] < 0.0 {
        normal = -normal;
    }
    normal.iter().all(|v| v.is_finite()).then(|| (normal, normal.dot(&mean)))
}
