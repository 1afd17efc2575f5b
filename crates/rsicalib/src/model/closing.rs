//! The closures of one block: misclosure (10), `G`, and the columns of geometry, closures and what is unknown.

use crate::closures::kind::At;
use crate::kinematics::elements::Source;
use crate::mechanism::MOST_PARAMETERS;
use crate::model::compiled::{CompiledClosure, Model, Patch, ShapeAt};
use crate::model::ends::{End, Measured, MovedEnd, rotate, turn_axes, unit};
use crate::model::lean::Lean;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, Vec3, cross, minus};
use crate::readings::Readings;
use crate::terms::term::OfInstrument;

impl Patch {
    /// Where a point is on the patch, ±1 at its edges.
    #[inline(always)]
    fn place(&self, point: &Vec3) -> [Lanes; 2] {
        let mut place = [Lanes::ZERO; 2];
        for (k, place) in place.iter_mut().enumerate() {
            let axis = &self.axes[k];
            let along = point[0] * axis[0] + point[1] * axis[1] + point[2] * axis[2];
            *place = (along - Lanes::splat(self.middle[k])) * (1.0 / self.half[k]);
        }
        place
    }

    /// A derivative by that place as one by the point.
    #[inline(always)]
    fn slope(&self, by: [Lanes; 2]) -> Vec3 {
        let mut slope = [Lanes::ZERO; 3];
        for (i, slope) in slope.iter_mut().enumerate() {
            for (k, by) in by.iter().enumerate() {
                *slope += *by * (self.axes[k][i] / self.half[k]);
            }
        }
        slope
    }
}

/// One closure in one block at parameters `β`.
///
/// Its parts are functions, not closures: only those are compiled with vector instructions for certain.
struct Closing<'a> {
    model: &'a Model,
    closure: &'a CompiledClosure,
    group: usize,
    seen: &'a [Lanes],
    beta: &'a [f64],
    want: Want,
}

/// An end of a closure.
struct Side<'a> {
    end: &'a End,
    /// Where the end is.
    placed: Vec3,
    /// Where terms of the closure move that place to.
    moved: Vec3,
    /// 1 for the first end, -1 for the second.
    sign: f64,
}

/// The shape of a surface where its point is.
struct Shaped {
    /// Where the point is on the surface, ±1 at its edges.
    place: [Lanes; 2],
    /// What each equation counts from.
    from: [Lanes; 2],
    /// How that changes as the point moves.
    steep: Option<[Vec3; 2]>,
}

impl Model {
    /// Eq. (10), `G` and the columns of geometry, closures and unknown points.
    #[inline(always)]
    pub(super) fn close(
        &self,
        readings: &Readings,
        block: usize,
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        self.clear(want, ws);
        let (group, seen) = (readings.blocks()[block].group, readings.columns(block));
        for closure in self.closures.iter().filter(|closure| closure.equations() > 0) {
            let here = Closing { model: self, closure, group, seen, beta, want };
            let sides = here.sides(ws);
            let apart = minus(&sides[0].moved, &sides[1].moved);
            let lean = here.lean();
            let shaped = here.shaped(&lean, &apart, &ws.gates);
            let at = At {
                apart,
                value: here.value(ws),
                shape: shaped.steep,
                measured: closure.is_measured(),
                along: match closure.on {
                    Some(_) => Some(&lean.along[..lean.rows]),
                    None => closure.along.as_deref(),
                },
            };
            here.misclosure(&at, &shaped, ws);
            if want.x || want.a {
                here.columns_of_value(&at, ws);
                here.columns_of_surface(&at, &lean, &shaped, ws);
                here.columns_of_moves(&at, ws);
                for side in &sides {
                    here.columns_of_end(&at, side, ws);
                }
            }
            if let Some(holds) = readings.holding.of_block(block, closure.number) {
                here.hold(holds, ws);
            }
        }
    }

    /// Room for all closures of a block.
    #[inline(always)]
    fn clear(&self, want: Want, ws: &mut Workspace) {
        let equations = self.equations;
        let zeros = |room: &mut Vec<Lanes>, width: usize| {
            room.clear();
            room.resize(equations * width, Lanes::ZERO);
        };
        zeros(&mut ws.f, 1);
        if want.x || want.a {
            zeros(&mut ws.g, self.scales.len());
            ws.laws.clear_slopes(equations * self.amounts);
            if self.pose_unknowns() > 0 {
                zeros(&mut ws.b, self.pose_unknowns());
            }
        }
        if want.x {
            zeros(&mut ws.x, self.width());
        }
    }
}

impl<'a> Closing<'a> {
    /// Where both ends are.
    #[inline(always)]
    fn sides(&self, ws: &Workspace) -> [Side<'a>; 2] {
        let [one, other] = &self.closure.ends;
        [self.side(one, 0, ws), self.side(other, 1, ws)]
    }

    #[inline(always)]
    fn side(&self, end: &'a End, number: usize, ws: &Workspace) -> Side<'a> {
        let placed = self.model.end_point(end, self.group, self.seen, self.beta, ws);
        let mut moved = placed;
        for own in self.moves().filter(|own| own.end == number) {
            let acts = own.by.acts(&ws.gates);
            for (axis, at) in moved.iter_mut().enumerate() {
                *at += acts * self.beta[own.by.first + axis];
            }
        }
        Side { end, placed, moved, sign: [1.0, -1.0][number] }
    }

    /// What moves ends of this closure in these samples.
    #[inline(always)]
    fn moves(&self) -> impl Iterator<Item = &'a MovedEnd> + use<'a> {
        let (model, group) = (self.model, self.group);
        self.closure.moved.iter().filter(move |own| model.touches(own.only, group))
    }

    /// The terms that shape its surface in these samples.
    #[inline(always)]
    fn shapes(&self) -> impl Iterator<Item = &'a ShapeAt> + use<'a> {
        let (model, group) = (self.model, self.group);
        self.closure.shapes.iter().filter(move |own| model.touches(own.only, group))
    }

    /// The value, with what terms, laws and a channel add.
    #[inline(always)]
    fn value(&self, ws: &Workspace) -> Lanes {
        let closure = self.closure;
        let mut value = match closure.column {
            Some(column) => self.seen[column] + Lanes::splat(closure.from),
            None => Lanes::splat(closure.value),
        };
        for added in &closure.added {
            let acts = added.gate.map_or(Lanes::ONE, |gate| ws.gates[gate]);
            value += acts * self.beta[added.parameter];
        }
        for &coordinate in closure.laws.iter().chain(&closure.channel) {
            value += ws.angles[coordinate];
        }
        value
    }

    /// How its unknown plane or line leans; no row where there is none.
    #[inline(always)]
    fn lean(&self) -> Lean {
        let Some(on) = self.closure.on else { return Lean::default() };
        let (owned, first) = (&self.model.owned[on], self.model.unknown_first(on, self.group));
        let axes = &self.model.axes[owned.numbers[self.group]];
        owned.thing.leans(axes, [self.beta[first], self.beta[first + 1]])
    }

    /// What the equations of a surface count from, beside the value.
    #[inline(always)]
    fn shaped(&self, lean: &Lean, apart: &Vec3, gates: &[Lanes]) -> Shaped {
        let mut shaped = Shaped { place: [Lanes::ZERO; 2], from: [Lanes::ZERO; 2], steep: None };
        if let Some(on) = self.closure.on {
            let first = self.model.unknown_first(on, self.group) + 2;
            for (row, from) in shaped.from.iter_mut().enumerate().take(lean.rows) {
                *from = Lanes::splat(self.beta[first + row]);
            }
        }
        let Some(patch) = self.closure.patches.get(self.group) else { return shaped };
        let place = patch.place(apart);
        let mut steep = [[Lanes::ZERO; 3]; 2];
        for (row, steep) in steep.iter_mut().enumerate().take(self.closure.equations()) {
            let mut slopes = [Lanes::ZERO; 2];
            for own in self.shapes() {
                let p = &self.beta[own.first..own.first + own.width];
                let acts = own.gate.map_or(Lanes::ONE, |gate| gates[gate]);
                shaped.from[row] += own.term.correction(p, place, row) * acts;
                let by = own.term.slopes(p, place, row);
                slopes[0] += by[0] * acts;
                slopes[1] += by[1] * acts;
            }
            *steep = patch.slope(slopes);
        }
        Shaped { place, steep: Some(steep), ..shaped }
    }

    /// Eq. (10).
    #[inline(always)]
    fn misclosure(&self, at: &At, shaped: &Shaped, ws: &mut Workspace) {
        let first = self.closure.equation;
        for row in 0..self.closure.equations() {
            ws.f[first + row] = self.closure.kind.misclosure(at, row);
        }
        for (row, from) in shaped.from.iter().enumerate().take(self.closure.equations()) {
            ws.f[first + row] -= *from;
        }
    }

    /// What terms, laws and a channel change by the value.
    #[inline(always)]
    fn columns_of_value(&self, at: &At, ws: &mut Workspace) {
        let closure = self.closure;
        if closure.added.is_empty() && closure.laws.is_empty() && closure.channel.is_none() {
            return;
        }
        for row in 0..closure.equations() {
            let slope = closure.kind.by_value(at, row);
            for added in &closure.added {
                let source = match added.gate {
                    Some(gate) => Source::Gated(added.parameter, gate),
                    None => Source::Parameter(added.parameter),
                };
                self.add_entry(row, source, slope, ws);
            }
            for &to in &closure.laws {
                self.add_entry(row, Source::Law(to), slope, ws);
            }
            if let Some(channel) = closure.channel {
                self.add_entry(row, Source::Channel(channel), slope, ws);
            }
        }
    }

    /// The tilts and offsets of its unknown surface, and the terms that shape it.
    #[inline(always)]
    fn columns_of_surface(&self, at: &At, lean: &Lean, shaped: &Shaped, ws: &mut Workspace) {
        if !self.want.x {
            return;
        }
        let (equation, width) = (self.closure.equation, self.model.width());
        for own in self.shapes() {
            let acts = own.gate.map_or(Lanes::ONE, |gate| ws.gates[gate]);
            for row in 0..self.closure.equations() {
                let mut out = [Lanes::ZERO; MOST_PARAMETERS];
                own.term.partials(shaped.place, row, &mut out[..own.width]);
                let first = (equation + row) * width + own.first;
                for (k, partial) in out[..own.width].iter().enumerate() {
                    ws.x[first + k] -= *partial * acts;
                }
            }
        }
        let Some(on) = self.closure.on else { return };
        for row in 0..lean.rows {
            let first = (equation + row) * width + self.model.unknown_column(on);
            for (tilt, by) in lean.by_tilt.iter().enumerate() {
                let leaned = At { along: Some(by), ..*at };
                ws.x[first + tilt] += leaned.along(row, &at.apart);
            }
            ws.x[first + 2 + row] -= Lanes::ONE;
        }
    }

    /// What moves its ends along the axes of the base.
    #[inline(always)]
    fn columns_of_moves(&self, at: &At, ws: &mut Workspace) {
        if !self.want.x {
            return;
        }
        for own in self.moves() {
            for axis in 0..3 {
                let sign = [1.0, -1.0][own.end];
                self.add_column(at, sign, own.by.source(axis), &unit(axis), ws);
            }
        }
    }

    /// All that moves an end.
    #[inline(always)]
    fn columns_of_end(&self, at: &At, side: &Side, ws: &mut Workspace) {
        let sign = side.sign;
        match side.end {
            End::Fixed(_) => {}
            End::Carried(chain, _, moved_by) => {
                for lever in 0..ws.postures[*chain].levers.len() {
                    let lever = &ws.postures[*chain].levers[lever];
                    if lever.source.is_parameter() && !self.want.x {
                        continue;
                    }
                    let (source, moved) = (lever.source, lever.moves(&side.moved));
                    self.add_column(at, sign, source, &moved, ws);
                }
                let axes = ws.postures[*chain].tip.axes;
                self.columns_of_attached(at, sign, *moved_by, &axes, ws);
            }
            End::Unknown(number, _, free) => {
                let axes = (0..3).filter(|axis| free[*axis]);
                for (column, axis) in (self.model.unknown_column(*number)..).zip(axes) {
                    self.add_column(at, sign, Source::Parameter(column), &unit(axis), ws);
                }
            }
            End::Posed(number) => self.columns_of_posed(at, side, *number, ws),
            End::Seen(columns, frame, knocks) => {
                if let Measured::Unknown(number) = frame {
                    self.columns_of_frame(at, side, *number, ws);
                }
                if self.want.x {
                    let read = columns.map(|column| self.seen[column]);
                    self.columns_of_knocks(at, sign, &read, (frame, *knocks), ws);
                }
            }
            End::Coordinate(channel) => {
                self.add_column(at, sign, Source::Channel(*channel), &unit(0), ws);
            }
        }
    }

    /// What moves an attached point along these axes.
    #[inline(always)]
    fn columns_of_attached(
        &self,
        at: &At,
        sign: f64,
        [from, to]: [usize; 2],
        axes: &[Vec3; 3],
        ws: &mut Workspace,
    ) {
        for own in self.model.attached[from..to].iter().filter(|_| self.want.x) {
            for (k, axis) in axes.iter().enumerate() {
                self.add_column(at, sign, own.by.source(k), axis, ws);
            }
        }
    }

    /// `B` of a point that is somewhere else in each pose, and what moves it on its body.
    #[inline(always)]
    fn columns_of_posed(&self, at: &At, side: &Side, number: usize, ws: &mut Workspace) {
        let (posed, width) = (&self.model.posed, self.model.pose_unknowns());
        for (slot, moved) in posed.moves(number, &side.placed, &ws.xi) {
            for row in 0..self.closure.equations() {
                let by = self.closure.kind.by_end(at, row, &moved, side.sign);
                ws.b[(self.closure.equation + row) * width + slot] += by;
            }
        }
        let moved_by = posed.points[number].moved_by;
        if moved_by[0] < moved_by[1] {
            let axes = posed.axes(number, &ws.xi);
            self.columns_of_attached(at, side.sign, moved_by, &axes, ws);
        }
    }

    /// Origin and turns of the unknown frame of an instrument.
    #[inline(always)]
    fn columns_of_frame(&self, at: &At, side: &Side, number: usize, ws: &mut Workspace) {
        let first = self.model.unknown_first(number, self.group);
        let column = self.model.unknown_column(number);
        let mut arm = side.placed;
        for (axis, arm) in arm.iter_mut().enumerate() {
            *arm -= Lanes::splat(self.beta[first + axis]);
            self.add_column(at, side.sign, Source::Parameter(column + axis), &unit(axis), ws);
        }
        let axes = self.model.axes_of_turns(&self.beta[first + 3..first + 6]);
        for (turn, axis) in axes.iter().enumerate() {
            let moved = cross(&axis.map(Lanes::splat), &arm);
            self.add_column(at, side.sign, Source::Parameter(column + 3 + turn), &moved, ws);
        }
    }

    /// What knocked the instrument that read a point, or changed its scale.
    #[inline(always)]
    fn columns_of_knocks(
        &self,
        at: &At,
        sign: f64,
        read: &Vec3,
        (frame, [from, to]): (&Measured, [usize; 2]),
        ws: &mut Workspace,
    ) {
        for knock in &self.model.knocks[from..to] {
            let axes = self.model.axes_of(frame, self.group, self.beta);
            if knock.of == OfInstrument::Scale {
                self.add_column(at, sign, knock.by.source(0), &rotate(&axes, read), ws);
                continue;
            }
            let arm = knock.turned(read, self.beta);
            let turns = turn_axes(&self.beta[knock.columns()][3..]);
            for (k, about) in turns.iter().enumerate() {
                let along = rotate(&axes, &unit(k));
                self.add_column(at, sign, knock.by.source(k), &along, ws);
                let by = rotate(&axes, &cross(&about.map(Lanes::splat), &arm));
                self.add_column(at, sign, knock.by.source(3 + k), &by, ws);
            }
        }
    }

    /// Adds to a column what an end moves by, in the direction in which the closure counts it.
    #[inline(always)]
    fn add_column(&self, at: &At, sign: f64, source: Source, moved: &Vec3, ws: &mut Workspace) {
        for row in 0..self.closure.equations() {
            let value = self.closure.kind.by_end(at, row, moved, sign);
            self.add_entry(row, source, value, ws);
        }
    }

    #[inline(always)]
    fn add_entry(&self, row: usize, source: Source, value: Lanes, ws: &mut Workspace) {
        let (channels, width) = (self.model.scales.len(), self.model.width());
        let equation = self.closure.equation + row;
        match source {
            Source::Channel(c) => ws.g[equation * channels + c] += value,
            Source::Parameter(p) if self.want.x => ws.x[equation * width + p] += value,
            Source::Gated(p, gate) if self.want.x => {
                ws.x[equation * width + p] += value * ws.gates[gate];
            }
            Source::Parameter(_) | Source::Gated(..) => {}
            Source::Law(to) => ws.laws.h[equation * self.model.amounts + to - channels] += value,
        }
    }

    /// Leaves zero of the misclosure and of all derivatives where the closure does not hold.
    fn hold(&self, holds: Lanes, ws: &mut Workspace) {
        let first = self.closure.equation;
        let own = first..first + self.closure.equations();
        let only = |all: &mut [Lanes], width: usize| {
            let rows = all.get_mut(own.start * width..own.end * width).unwrap_or_default();
            rows.iter_mut().for_each(|entry| *entry = *entry * holds);
        };
        only(&mut ws.f, 1);
        let Want { x, a } = self.want;
        if x || a {
            only(&mut ws.g, self.model.scales.len());
            only(&mut ws.laws.h, self.model.amounts);
            only(&mut ws.b, self.model.pose_unknowns());
        }
        if x {
            only(&mut ws.x, self.model.width());
        }
    }
}
