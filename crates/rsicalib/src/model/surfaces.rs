//! How unknown planes and lines face, and where surfaces are touched, as drawn.

use crate::mechanism::around;
use crate::model::compiled::{Model, Patch};
use crate::model::lean::cross;
use crate::model::thing::Thing;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::minus;
use crate::readings::Readings;

/// The normal of a plane that has none.
const UP: [f64; 3] = [0.0, 0.0, 1.0];

/// A surface: the closure that a known one is of, or the number of an unknown one.
type Surface = (Option<usize>, usize);

impl Model {
    /// Lets unknown planes and lines lean from that axis of the base which is nearest to the normal or
    /// the direction of their points, where none is drawn.
    pub(crate) fn face_undrawn(&mut self, readings: &Readings) {
        let undrawn = |thing: Thing| thing.faces_anywhere(&self.mechanism);
        if !self.unknowns.iter().any(|unknown| undrawn(unknown.thing)) {
            return;
        }
        let beta = self.nominal();
        for (number, points) in self.points_on(readings, &beta).into_iter().enumerate() {
            let thing = self.unknowns[number].thing;
            if let Some([faces, _]) = thing.nearest(&points)
                && undrawn(thing)
            {
                let axis = faces.iamax();
                self.axes[number] = around(std::array::from_fn(|i| f64::from(u8::from(i == axis))));
            }
        }
    }

    /// Finds where each plane or line with a shape is touched, as drawn.
    pub(crate) fn find_patches(&mut self, readings: &Readings) {
        if self.closures.iter().all(|closure| closure.shapes.is_empty()) {
            return;
        }
        let mut beta = self.nominal();
        self.place_unknowns(readings, &mut beta);
        let mut ws = Workspace::default();
        // What is unknown is one surface for all that touch it; a known one is that of its closure.
        let surface = |k: usize, group: usize| match self.closures[k].on {
            Some(on) => (None, self.owned[on].numbers[group]),
            None => (Some(k), 0),
        };
        let axes = |k: usize, group: usize| {
            let closure = &self.closures[k];
            let [n, u, v] = match (closure.on, closure.along.as_deref()) {
                (Some(on), _) => self.axes[self.owned[on].numbers[group]],
                (None, Some([u, v])) => [cross(u, v), *u, *v],
                (None, known) => around(known.and_then(|k| k.first().copied()).unwrap_or(UP)),
            };
            if self.mechanism.is_on_line(closure.number) { [n, u] } else { [u, v] }
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
                let [one, other] =
                    closure.ends.map(|end| self.end_point(&end, meta.group, seen, &beta, &ws));
                let at = minus(&one, &other);
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
}
