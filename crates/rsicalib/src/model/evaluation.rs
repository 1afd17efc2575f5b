//! Evaluation of the model: misclosure and derivatives of readings.
//!
//! For one sample with readings `a` and parameters `β`,
//!
//! ```text
//! r = a + Σ δ_electronics(a)                                              (41)
//! q = k0 r + θ0 + Σ δ_sensor(r)                                           (42)
//! q' = q + Σ compliance · torque(q)                                       (43)
//! f = |p_a(q') - p_b(q')|² - d²      or      p_a - p_b                    (10)
//! ```
//!
//! with the derivatives by the chain rule,
//!
//! ```text
//! A = ∂f/∂a = G (∂q'/∂q) diag(∂q/∂r) (∂r/∂a)          G = ∂f/∂q'          (44)
//! X = ∂f/∂β                                                               (12)
//! ```
//!
//! All terms of one stage see the state that enters the stage, and their corrections add up, so
//! their order does not matter. Eight samples are computed at a time.

use crate::closures::kind::At;
use crate::kinematics::elements::{Element, Source};
use crate::kinematics::posture::Posture;
use crate::mechanism::MOST_PARAMETERS;
use crate::model::compiled::{CompiledClosure, Model, Patch};
use crate::model::drives::Drives;
use crate::model::ends::{End, Measured, moves_of, rotate, seen_from, turn_axes, turned, unit};
use crate::model::lean::Lean;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, Vec3, cross, dispatch, dot, minus};
use crate::readings::course::{Followed, Late, Moved};
use crate::readings::{Block, Readings};
use crate::terms::term::Site;

/// True for the parameters of a term that changes nothing: a law that every term keeps. Most terms
/// of a model that looks for what is missing are so, and cost their derivatives only.
#[inline(always)]
fn absent(parameters: &[f64]) -> bool {
    parameters.iter().all(|p| *p == 0.0)
}

/// A point of a frame, in base coordinates.
#[inline(always)]
fn moved(rotation: &[f64; 9], origin: &[f64; 3], point: &Vec3) -> Vec3 {
    let mut out = rotate(rotation, point);
    for (out, origin) in out.iter_mut().zip(origin) {
        *out += Lanes::splat(*origin);
    }
    out
}

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

impl Model {
    /// Misclosure and derivatives of one block at readings `a`, what is unknown in one pose alone
    /// included: see [`Model::evaluate`].
    ///
    /// This is the only place where the kernel is dispatched, so that there is one copy of the
    /// kernel for each vector width.
    pub(super) fn evaluate_at(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        dispatch(
            #[inline(always)]
            || self.evaluate_as_compiled(readings, block, a, beta, want, ws),
        );
    }

    /// [`Model::evaluate`] with the instructions that the caller is compiled for.
    #[doc(hidden)]
    #[inline(always)]
    pub fn evaluate_as_compiled(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        let (a, xi) = a.split_at(self.scales.len());
        ws.xi.clear();
        ws.xi.extend_from_slice(xi);
        self.joint_angles(readings, block, a, beta, want, ws);
        ws.gates.clear();
        ws.gates.extend(self.gates_in(&readings.blocks()[block]));
        if !self.laws.is_empty() {
            self.take_laws(readings, block, beta, want, ws);
        }
        if !self.loads.is_empty() {
            self.bend(block, beta, ws);
        }
        if !self.laws.is_empty() {
            self.add_laws(ws);
        }
        ws.postures.resize_with(self.steps.len(), Posture::new);
        for (posture, steps) in ws.postures.iter_mut().zip(&self.steps) {
            posture.take(steps, &ws.angles, beta, &ws.gates);
        }
        self.close(readings, block, beta, want, ws);
        if want.x || want.a {
            self.chain_rule(block, beta, want, ws);
        }
        // Amounts of laws are coordinates here only.
        ws.angles.truncate(self.scales.len());
    }

    /// Eqs. (41, 42): joint coordinates before load, and their derivatives.
    #[inline(always)]
    fn joint_angles(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        let channels = self.scales.len();
        let meta = &readings.blocks()[block];
        let mut site = self.site(readings, block, a);
        let mut out = [Lanes::ZERO; MOST_PARAMETERS];

        ws.moved.clear();
        ws.corrected.clear();
        ws.corrected.extend_from_slice(a);
        ws.electric.clear();
        if !self.electronics.is_empty() {
            ws.mix.clear();
            ws.mix.resize(channels * channels, Lanes::ZERO);
        }
        for e in &self.electronics {
            let p = &beta[e.first..e.first + e.width];
            site.place = e.place;
            let channel = e.channel;
            site.channel = channel;
            if let Some(own) = e.term.late(p).filter(|_| want.x || !absent(p)) {
                site.followed = self.followed(&site, beta, (e.first, own), want.x, &mut ws.moved);
            }
            let row = &mut ws.mix[channel * channels..(channel + 1) * channels];
            match e.session.map(|s| meta.within(s)) {
                _ if absent(p) => {}
                None => {
                    ws.corrected[channel] += e.term.correction(p, &site);
                    e.term.slopes(p, &site, row);
                }
                Some(within) => {
                    ws.corrected[channel] += e.term.correction(p, &site) * within;
                    let mut slopes = vec![Lanes::ZERO; channels];
                    e.term.slopes(p, &site, &mut slopes);
                    row.iter_mut().zip(slopes).for_each(|(r, s)| *r += s * within);
                }
            }
            if want.x {
                e.term.partials(p, &site, &mut out[..e.width]);
                let within = e.session.map_or(Lanes::ONE, |s| meta.within(s));
                for (k, partial) in out[..e.width].iter().enumerate() {
                    ws.electric.push((e.first + k, channel, *partial * within));
                }
            }
        }

        // Room for all at once: a session of a few blocks would pay more for growing vectors.
        ws.angles.clear();
        ws.angles.reserve(channels + self.amounts);
        ws.slopes.clear();
        ws.slopes.reserve(channels);
        for (scale, reading) in self.scales.iter().zip(&ws.corrected) {
            ws.angles.push(scale.nominal(*reading));
            ws.slopes.push(Lanes::splat(scale.gain));
        }
        ws.partials.clear();
        ws.partials.reserve(if want.x { self.term_parameters } else { 0 });
        site.readings = &ws.corrected;
        for s in &self.sensors {
            let p = &beta[s.first..s.first + s.width];
            site.channel = s.channel;
            site.place = s.place;
            if !ws.moved.is_empty() {
                site.late = self.late(beta, s.channel, 0)[1].lag;
            }
            let within = s.session.map_or(Lanes::ONE, |s| meta.within(s));
            if !absent(p) {
                ws.angles[s.channel] += s.term.correction(p, &site) * within;
                if want.x || want.a {
                    ws.slopes[s.channel] += s.term.slope(p, &site) * within;
                }
            }
            if want.x {
                s.term.partials(p, &site, &mut out[..s.width]);
                for (k, partial) in out[..s.width].iter().enumerate() {
                    ws.partials.push((s.first + k, s.channel, *partial * within));
                }
            }
        }
    }

    /// How a channel follows by the terms before the one with this parameter, and by all.
    pub(crate) fn late(&self, beta: &[f64], channel: usize, before: usize) -> [Late; 2] {
        let own = self.electronics.iter().filter(|e| e.channel == channel);
        own.fold([Late::default(); 2], |[sum, all], e| {
            let late = e.term.late(&beta[e.first..e.first + e.width]).unwrap_or_default();
            [if e.first < before { sum + late } else { sum }, all + late]
        })
    }

    /// What the samples of a channel followed, by its term with a parameter and those before it. Most are asked
    /// for by several terms: what was found is kept in `moved`.
    fn followed(
        &self,
        site: &Site,
        beta: &[f64],
        (first, own): (usize, Late),
        derivatives: bool,
        moved: &mut Vec<(usize, Late, Moved)>,
    ) -> Followed {
        let Some(course) = site.course else { return Followed::default() };
        let channel = site.channel;
        let [before, all] = self.late(beta, channel, first);
        // Where one of them asks for time constants, all do: two ways to write zero are one.
        let none = Late { lag: 0.0, square: all.square.map(|_| 0.0) };
        let mut to = |late: Late| {
            let kept = moved.iter().find(|(c, l, _)| (*c, *l) == (channel, late));
            let kept = kept.map(|(.., to)| *to);
            kept.unwrap_or_else(|| {
                let to = course.moved(channel, late);
                moved.push((channel, late, to));
                to
            })
        };
        let all = derivatives.then(|| to(all + none));
        let mut unless_nothing = |late: Late| (!late.is_nothing()).then(|| to(late + none));
        Followed { before: unless_nothing(before), with: unless_nothing(before + own), all }
    }

    /// Eq. (43): joints give under gravity.
    #[inline(always)]
    fn bend(&self, block: usize, beta: &[f64], ws: &mut Workspace) {
        if let Some(drives) = &self.drives {
            for load in self.loads.iter().filter(|load| beta[load.parameter] != 0.0) {
                for channel in drives.joints(load.chain).filter(|c| load.asks(*c)) {
                    let torque = drives.at(block, load.whose, channel);
                    ws.angles[channel] += torque * beta[load.parameter];
                }
            }
            return;
        }
        ws.unloaded.resize_with(self.steps.len(), Posture::new);
        for (posture, steps) in ws.unloaded.iter_mut().zip(&self.steps) {
            posture.take(steps, &ws.angles, beta, &ws.gates);
        }
        // The sums of weights are the same for all loads of one kind on one chain.
        ws.carried.resize_with(2 * self.steps.len(), Vec::new);
        for (k, load) in self.loads.iter().enumerate() {
            if k == 0 || self.loads[k - 1].slot() != load.slot() {
                let carried = &mut ws.carried[load.slot()];
                ws.unloaded[load.chain].carried(load.whose, carried);
            }
        }
        for load in self.loads.iter().filter(|load| beta[load.parameter] != 0.0) {
            let (posture, carried) = (&ws.unloaded[load.chain], &ws.carried[load.slot()]);
            for (j, lever) in posture.levers.iter().enumerate() {
                if let Some(channel) = load.gives(lever) {
                    let torque = dot(&carried[j].moved_by(lever), &self.gravity);
                    ws.angles[channel] += torque * beta[load.parameter];
                }
            }
        }
    }

    /// Largest torque of gravity of each load in these readings, by the drawing.
    pub(crate) fn largest_torques(&self, readings: &Readings) -> Vec<f64> {
        let mut largest = vec![0.0_f64; self.loads.len()];
        if largest.is_empty() {
            return largest;
        }
        if let Some(drives) = &self.drives {
            for (load, largest) in self.loads.iter().zip(&mut largest) {
                for (block, meta) in readings.blocks().iter().enumerate() {
                    let each = drives
                        .joints(load.chain)
                        .filter(|c| load.asks(*c))
                        .map(|c| drives.at(block, load.whose, c));
                    let most = |torque: Lanes| {
                        torque.0[..meta.live].iter().fold(0.0, |m: f64, t| m.max(t.abs()))
                    };
                    *largest = each.map(most).fold(*largest, f64::max);
                }
            }
            return largest;
        }
        // As drawn, nothing but the joints moves.
        let moves = |step: &&Element| match step {
            Element::Move(_, _, source) => matches!(source, Source::Channel(_)),
            _ => true,
        };
        let drawn = self.steps.iter().map(|steps| steps.iter().filter(moves).cloned().collect());
        let drawn: Vec<Vec<Element>> = drawn.collect();
        let mut postures = vec![Posture::new(); drawn.len()];
        let mut carried = Vec::new();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let angles: Vec<Lanes> = (self.scales.iter().zip(readings.raw(block)))
                .map(|(scale, reading)| scale.nominal(*reading))
                .collect();
            for (posture, steps) in postures.iter_mut().zip(&drawn) {
                dispatch(
                    #[inline(always)]
                    || posture.take(steps, &angles, &[], &[]),
                );
            }
            for (k, (load, largest)) in self.loads.iter().zip(&mut largest).enumerate() {
                let posture = &postures[load.chain];
                if k == 0 || self.loads[k - 1].slot() != load.slot() {
                    posture.carried(load.whose, &mut carried);
                }
                for (lever, carried) in posture.levers.iter().zip(&carried) {
                    if load.gives(lever).is_some() {
                        let torque = dot(&carried.moved_by(lever), &self.gravity);
                        let live = &torque.0[..meta.live];
                        *largest = live.iter().fold(*largest, |most, t| most.max(t.abs()));
                    }
                }
            }
        }
        largest
    }

    /// Eq. (10), `G` and the columns of geometry, closures and unknown points.
    #[inline(always)]
    fn close(
        &self,
        readings: &Readings,
        block: usize,
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        let (channels, width) = (self.scales.len(), self.width());
        ws.f.clear();
        ws.f.resize(self.equations, Lanes::ZERO);
        if want.x || want.a {
            ws.g.clear();
            ws.g.resize(self.equations * channels, Lanes::ZERO);
            ws.laws.clear_slopes(self.equations * self.amounts);
        }
        if want.x {
            ws.x.clear();
            ws.x.resize(self.equations * width, Lanes::ZERO);
        }
        if self.pose_unknowns() > 0 && (want.x || want.a) {
            ws.b.clear();
            ws.b.resize(self.equations * self.pose_unknowns(), Lanes::ZERO);
        }
        let (group, seen) = (readings.blocks()[block].group, readings.columns(block));
        for closure in self.closures.iter().filter(|closure| closure.equations() > 0) {
            // Not `map`, which calls its closure: that is not compiled for vector instructions.
            let [one, other] = &closure.ends;
            let placed = [
                self.end_point(one, group, seen, beta, ws),
                self.end_point(other, group, seen, beta, ws),
            ];
            let mut ends = placed;
            for moved in closure.moved.iter().filter(|m| self.touches(m.only, group)) {
                let acts = moved.by.acts(&ws.gates);
                for (axis, at) in ends[moved.end].iter_mut().enumerate() {
                    *at += acts * beta[moved.by.first + axis];
                }
            }
            let apart = minus(&ends[0], &ends[1]);
            let mut distance = closure.column.map_or(Lanes::splat(closure.value), |column| {
                seen[column] + Lanes::splat(closure.from)
            });
            for added in &closure.added {
                distance +=
                    added.gate.map_or(Lanes::splat(1.0), |g| ws.gates[g]) * beta[added.parameter];
            }
            closure.laws.iter().for_each(|&to| distance += ws.angles[to]);
            closure.channel.iter().for_each(|&channel| distance += ws.angles[channel]);
            let mut lean = Lean::default();
            let mut along = closure.along.as_deref();
            // What the equations of a surface count from, beside the value.
            let mut from = [Lanes::ZERO; 2];
            if let Some(on) = closure.on {
                let (thing, first) = (&self.owned[on], self.unknown_first(on, group));
                let axes = &self.axes[thing.numbers[group]];
                lean = thing.thing.leans(axes, [beta[first], beta[first + 1]]);
                for (row, from) in from.iter_mut().enumerate().take(lean.rows) {
                    *from = Lanes::splat(beta[first + 2 + row]);
                }
                along = Some(&lean.along[..lean.rows]);
            }
            let mut shape = None;
            let mut place = [Lanes::ZERO; 2];
            if let Some(patch) = closure.patches.get(group) {
                place = patch.place(&apart);
                let mut steep = [[Lanes::ZERO; 3]; 2];
                for row in 0..closure.equations() {
                    let mut slopes = [Lanes::ZERO; 2];
                    for term in closure.shapes.iter().filter(|s| self.touches(s.only, group)) {
                        let p = &beta[term.first..term.first + term.width];
                        let acts = term.gate.map_or(Lanes::ONE, |g| ws.gates[g]);
                        from[row] += term.term.correction(p, place, row) * acts;
                        let by = term.term.slopes(p, place, row);
                        slopes[0] += by[0] * acts;
                        slopes[1] += by[1] * acts;
                    }
                    steep[row] = patch.slope(slopes);
                }
                shape = Some(steep);
            }
            let measured = closure.is_measured();
            let at = At { apart, value: distance, shape, measured, along };
            for row in 0..closure.equations() {
                ws.f[closure.equation + row] = closure.kind.misclosure(&at, row);
            }
            for (row, from) in from.iter().enumerate().take(closure.equations()) {
                ws.f[closure.equation + row] -= *from;
            }
            let holds = readings.holding.of_block(block, closure.number);
            if let Some(holds) = holds {
                let own = closure.equation..closure.equation + closure.equations();
                ws.f[own].iter_mut().for_each(|f| *f = *f * holds);
            }
            if !(want.x || want.a) {
                continue;
            }
            let bare = closure.added.is_empty() && closure.laws.is_empty();
            if !(bare && closure.channel.is_none()) {
                self.add_value_columns(closure, &at, want, ws);
            }
            let here = |only| want.x && self.touches(only, group);
            for term in closure.shapes.iter().filter(|s| here(s.only)) {
                let acts = term.gate.map_or(Lanes::ONE, |g| ws.gates[g]);
                for row in 0..closure.equations() {
                    let mut out = [Lanes::ZERO; MOST_PARAMETERS];
                    term.term.partials(place, row, &mut out[..term.width]);
                    let first = (closure.equation + row) * width + term.first;
                    for (k, partial) in out[..term.width].iter().enumerate() {
                        ws.x[first + k] -= *partial * acts;
                    }
                }
            }
            if let Some(on) = closure.on.filter(|_| want.x) {
                let column = self.unknown_column(on);
                for row in 0..lean.rows {
                    let first = (closure.equation + row) * width + column;
                    for (tilt, by) in lean.by_tilt.iter().enumerate() {
                        let leaned = At { along: Some(by), ..at };
                        ws.x[first + tilt] += leaned.along(row, &apart);
                    }
                    ws.x[first + 2 + row] -= Lanes::ONE;
                }
            }
            for moved in closure.moved.iter().filter(|m| here(m.only)) {
                let sign = [1.0, -1.0][moved.end];
                for axis in 0..3 {
                    self.add_column(
                        closure,
                        moved.by.source(axis),
                        &unit(axis),
                        &at,
                        sign,
                        want,
                        ws,
                    );
                }
            }
            for (end, sign) in closure.ends.iter().zip([1.0, -1.0]) {
                match end {
                    End::Fixed(_) => {}
                    End::Carried(chain, _, moved_by) => {
                        let point = if sign > 0.0 { &ends[0] } else { &ends[1] };
                        for lever in 0..ws.postures[*chain].levers.len() {
                            let lever = &ws.postures[*chain].levers[lever];
                            if lever.source.is_parameter() && !want.x {
                                continue;
                            }
                            let (source, moved) = (lever.source, lever.moves(point));
                            self.add_column(closure, source, &moved, &at, sign, want, ws);
                        }
                        let axes = ws.postures[*chain].tip.axes;
                        self.add_attached(closure, *moved_by, &axes, &at, sign, want, ws);
                    }
                    End::Unknown(number, _, free) => {
                        let mut source = self.unknown_column(*number);
                        for (axis, free) in free.iter().enumerate() {
                            if *free {
                                let unit = unit(axis);
                                let parameter = Source::Parameter(source);
                                self.add_column(closure, parameter, &unit, &at, sign, want, ws);
                                source += 1;
                            }
                        }
                    }
                    End::Posed(number) => {
                        let point = if sign > 0.0 { &placed[0] } else { &placed[1] };
                        for (slot, moved) in self.posed.moves(*number, point, &ws.xi) {
                            for row in 0..closure.equations() {
                                let entry = (closure.equation + row) * self.pose_unknowns() + slot;
                                ws.b[entry] += closure.kind.by_end(&at, row, &moved, sign);
                            }
                        }
                        let moved_by = self.posed.points[*number].moved_by;
                        if moved_by[0] < moved_by[1] {
                            let axes = self.posed.axes(*number, &ws.xi);
                            self.add_attached(closure, moved_by, &axes, &at, sign, want, ws);
                        }
                    }
                    End::Seen(columns, frame, [from, to]) => {
                        if let Measured::Unknown(number) = frame {
                            let first = self.unknown_first(*number, group);
                            let source = self.unknown_column(*number);
                            let mut arm = if sign > 0.0 { placed[0] } else { placed[1] };
                            for (axis, arm) in arm.iter_mut().enumerate() {
                                *arm -= Lanes::splat(beta[first + axis]);
                                let parameter = Source::Parameter(source + axis);
                                self.add_column(
                                    closure,
                                    parameter,
                                    &unit(axis),
                                    &at,
                                    sign,
                                    want,
                                    ws,
                                );
                            }
                            let axes = self.axes_of_turns(&beta[first + 3..first + 6]);
                            for (turn, axis) in axes.iter().enumerate() {
                                let moved = cross(&axis.map(Lanes::splat), &arm);
                                let parameter = Source::Parameter(source + 3 + turn);
                                self.add_column(closure, parameter, &moved, &at, sign, want, ws);
                            }
                        }
                        for knock in self.knocks[*from..*to].iter().filter(|_| want.x) {
                            let axes = self.axes_of(frame, group, beta);
                            let turns = &beta[knock.first + 3..knock.first + 6];
                            let read = columns.map(|column| seen[column]);
                            let arm = knock.turned(&read, beta);
                            for (k, about) in turn_axes(turns).iter().enumerate() {
                                let by = rotate(&axes, &cross(&about.map(Lanes::splat), &arm));
                                let along = rotate(&axes, &unit(k));
                                let own = [(k, along), (3 + k, by)];
                                for (k, moved) in own {
                                    self.add_column(
                                        closure,
                                        knock.source(k),
                                        &moved,
                                        &at,
                                        sign,
                                        want,
                                        ws,
                                    );
                                }
                            }
                        }
                    }
                    End::Coordinate(channel) => {
                        let source = Source::Channel(*channel);
                        self.add_column(closure, source, &unit(0), &at, sign, want, ws);
                    }
                }
            }
            if let Some(holds) = holds {
                self.hold(closure, holds, want, ws);
            }
        }
    }

    /// Leaves zero of all derivatives of a closure where it does not hold.
    fn hold(&self, closure: &CompiledClosure, holds: Lanes, want: Want, ws: &mut Workspace) {
        let own = closure.equation..closure.equation + closure.equations();
        let only = |all: &mut [Lanes], width: usize| {
            let rows = all.get_mut(own.start * width..own.end * width).unwrap_or_default();
            rows.iter_mut().for_each(|entry| *entry = *entry * holds);
        };
        only(&mut ws.g, self.scales.len());
        only(&mut ws.laws.h, self.amounts);
        only(&mut ws.b, self.pose_unknowns());
        if want.x {
            only(&mut ws.x, self.width());
        }
    }

    /// Adds to a column of a closure what its end moves by, in the direction in which the closure
    /// counts it.
    ///
    /// A function, not a closure: only that is compiled with the vector instructions for certain.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "the state of one loop")]
    fn add_column(
        &self,
        closure: &CompiledClosure,
        source: Source,
        moved: &Vec3,
        at: &At,
        sign: f64,
        want: Want,
        ws: &mut Workspace,
    ) {
        for row in 0..closure.equations() {
            let value = closure.kind.by_end(at, row, moved, sign);
            self.add_entry(closure.equation + row, source, value, want, ws);
        }
    }

    /// Adds what terms and laws change of a closure by its value.
    #[inline(always)]
    fn add_value_columns(
        &self,
        closure: &CompiledClosure,
        at: &At,
        want: Want,
        ws: &mut Workspace,
    ) {
        for row in 0..closure.equations() {
            let slope = closure.kind.by_value(at, row);
            for added in &closure.added {
                let source = match added.gate {
                    Some(gate) => Source::Gated(added.parameter, gate),
                    None => Source::Parameter(added.parameter),
                };
                self.add_entry(closure.equation + row, source, slope, want, ws);
            }
            for &to in &closure.laws {
                self.add_entry(closure.equation + row, Source::Law(to), slope, want, ws);
            }
            if let Some(channel) = closure.channel {
                self.add_entry(closure.equation + row, Source::Channel(channel), slope, want, ws);
            }
        }
    }

    #[inline(always)]
    fn add_entry(
        &self,
        equation: usize,
        source: Source,
        value: Lanes,
        want: Want,
        ws: &mut Workspace,
    ) {
        let (channels, width) = (self.scales.len(), self.width());
        match source {
            Source::Channel(c) => ws.g[equation * channels + c] += value,
            Source::Parameter(p) if want.x => ws.x[equation * width + p] += value,
            Source::Gated(p, gate) if want.x => {
                ws.x[equation * width + p] += value * ws.gates[gate];
            }
            Source::Parameter(_) | Source::Gated(..) => {}
            Source::Law(to) => ws.laws.h[equation * self.amounts + to - channels] += value,
        }
    }

    /// A point that some of the attached moves move along these axes.
    #[inline(always)]
    fn moved_along(
        &self,
        mut point: Vec3,
        [from, to]: [usize; 2],
        axes: &[Vec3; 3],
        beta: &[f64],
        gates: &[Lanes],
    ) -> Vec3 {
        for own in &self.attached[from..to] {
            own.by.along(&mut point, axes, beta, gates);
        }
        point
    }

    /// Where a point is that is somewhere else in each pose.
    #[inline(always)]
    pub(crate) fn posed_point(
        &self,
        number: usize,
        xi: &[Lanes],
        beta: &[f64],
        gates: &[Lanes],
    ) -> Vec3 {
        let (at, moved_by) = (self.posed.place(number, xi), self.posed.points[number].moved_by);
        if moved_by[0] == moved_by[1] {
            return at;
        }
        self.moved_along(at, moved_by, &self.posed.axes(number, xi), beta, gates)
    }

    /// How much of each motion acts in the samples of a block.
    #[inline(always)]
    pub(crate) fn gates_in(&self, block: &Block) -> impl Iterator<Item = Lanes> {
        self.gates.iter().map(move |gate| gate.of(block))
    }

    /// Columns of what moves an attached point along these axes.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "the state of one loop")]
    fn add_attached(
        &self,
        closure: &CompiledClosure,
        [from, to]: [usize; 2],
        axes: &[Vec3; 3],
        at: &At,
        sign: f64,
        want: Want,
        ws: &mut Workspace,
    ) {
        for own in self.attached[from..to].iter().filter(|_| want.x) {
            for (k, axis) in axes.iter().enumerate() {
                self.add_column(closure, own.by.source(k), axis, at, sign, want, ws);
            }
        }
    }

    /// The rotation of the frame in which an instrument measures, row by row.
    #[inline(always)]
    fn axes_of(&self, frame: &Measured, group: usize, beta: &[f64]) -> [f64; 9] {
        match frame {
            Measured::Base => [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            Measured::Known(rotation, _) => *rotation,
            Measured::Unknown(number) => {
                let first = self.unknown_first(*number, group);
                turned(&beta[first + 3..first + 6])
            }
        }
    }

    #[inline(always)]
    pub(crate) fn end_point(
        &self,
        end: &End,
        group: usize,
        seen: &[Lanes],
        beta: &[f64],
        ws: &Workspace,
    ) -> Vec3 {
        match end {
            End::Carried(chain, at, moved_by) => {
                let tip = &ws.postures[*chain].tip;
                self.moved_along(tip.point(at), *moved_by, &tip.axes, beta, &ws.gates)
            }
            End::Fixed(at) => at.map(Lanes::splat),
            End::Unknown(number, at, free) => {
                let mut point = at.map(Lanes::splat);
                let mut parameter = self.unknown_first(*number, group);
                for (point, free) in point.iter_mut().zip(free) {
                    if *free {
                        *point = Lanes::splat(beta[parameter]);
                        parameter += 1;
                    }
                }
                point
            }
            End::Posed(number) => self.posed_point(*number, &ws.xi, beta, &ws.gates),
            End::Seen(columns, frame, [from, to]) => {
                let read = [seen[columns[0]], seen[columns[1]], seen[columns[2]]];
                let mut point = read;
                for knock in &self.knocks[*from..*to] {
                    let acts = knock.acts(&ws.gates);
                    let there = knock.turned(&read, beta);
                    for (axis, at) in point.iter_mut().enumerate() {
                        let along = Lanes::splat(beta[knock.first + axis]);
                        *at += acts * (there[axis] - read[axis] + along);
                    }
                }
                match frame {
                    Measured::Base => point,
                    Measured::Known(rotation, origin) => moved(rotation, origin, &point),
                    Measured::Unknown(number) => {
                        let first = self.unknown_first(*number, group);
                        let origin = [beta[first], beta[first + 1], beta[first + 2]];
                        moved(&turned(&beta[first + 3..first + 6]), &origin, &point)
                    }
                }
            }
            End::Coordinate(channel) => [ws.angles[*channel], Lanes::ZERO, Lanes::ZERO],
        }
    }

    /// What an instrument would read of a place in base coordinates.
    pub(crate) fn seen_from(
        &self,
        frame: &Measured,
        group: usize,
        beta: &[f64],
        at: [f64; 3],
    ) -> [f64; 3] {
        match frame {
            Measured::Base => at,
            Measured::Known(rotation, origin) => seen_from(rotation, origin, at),
            Measured::Unknown(number) => {
                let pose = &beta[self.unknown_first(*number, group)..][..6];
                seen_from(&turned(&pose[3..]), &pose[..3], at)
            }
        }
    }

    /// Eq. (44), and the columns of `X` that act through joint coordinates.
    #[inline(always)]
    fn chain_rule(&self, block: usize, beta: &[f64], want: Want, ws: &mut Workspace) {
        let (channels, width) = (self.scales.len(), self.width());
        if !self.laws.is_empty() {
            self.hold_laws(ws);
        }
        if !self.loads.is_empty() {
            match &self.drives {
                Some(drives) if want.x => self.driven_back(drives, block, ws),
                Some(_) => {}
                None => self.bend_back(beta, want, ws),
            }
        }
        if !self.laws.is_empty() {
            self.turn_laws(want, ws);
        }
        if want.x {
            for &(column, channel, partial) in &ws.partials {
                for k in 0..self.equations {
                    ws.x[k * width + column] += ws.g[k * channels + channel] * partial;
                }
            }
            for &(column, channel, partial) in &ws.electric {
                let slope = ws.slopes[channel] * partial;
                for k in 0..self.equations {
                    ws.x[k * width + column] += ws.g[k * channels + channel] * slope;
                }
                if !self.laws.is_empty() {
                    for k in 0..self.equations {
                        ws.x[k * width + column] +=
                            ws.laws.direct[k * channels + channel] * partial;
                    }
                }
            }
        }
        if want.a {
            ws.a.clear();
            ws.a.reserve(self.equations * channels);
            for k in 0..self.equations {
                for c in 0..channels {
                    ws.a.push(ws.g[k * channels + c] * ws.slopes[c]);
                }
            }
            if !self.laws.is_empty() {
                ws.a.iter_mut().zip(&ws.laws.direct).for_each(|(a, direct)| *a += *direct);
            }
            if !self.electronics.is_empty() {
                for k in 0..self.equations {
                    let row = &mut ws.a[k * channels..(k + 1) * channels];
                    ws.turned.clear();
                    ws.turned.extend_from_slice(row);
                    for (turned, mix) in ws.turned.iter().zip(ws.mix.chunks_exact(channels)) {
                        for (slope, share) in row.iter_mut().zip(mix) {
                            *slope += *turned * *share;
                        }
                    }
                }
            }
        }
    }

    /// The columns of load terms where torques are those of drives, (46).
    #[inline(always)]
    fn driven_back(&self, drives: &Drives, block: usize, ws: &mut Workspace) {
        let (channels, width) = (self.scales.len(), self.width());
        for load in &self.loads {
            for channel in drives.joints(load.chain).filter(|c| load.asks(*c)) {
                let torque = drives.at(block, load.whose, channel);
                for k in 0..self.equations {
                    ws.x[k * width + load.parameter] += ws.g[k * channels + channel] * torque;
                }
            }
        }
    }

    /// `G ← G ∂q'/∂q`, the columns of load terms, and the change of torques by geometry terms.
    #[inline(always)]
    fn bend_back(&self, beta: &[f64], want: Want, ws: &mut Workspace) {
        let (channels, width) = (self.scales.len(), self.width());
        ws.turned.clear();
        ws.turned.extend_from_slice(&ws.g);
        for load in &self.loads {
            let (posture, carried) = (&ws.unloaded[load.chain], &ws.carried[load.slot()]);
            for (j, lever) in posture.levers.iter().enumerate() {
                let Some(channel) = load.gives(lever) else { continue };
                if want.x {
                    let torque = dot(&carried[j].moved_by(lever), &self.gravity);
                    for k in 0..self.equations {
                        ws.x[k * width + load.parameter] +=
                            ws.turned[k * channels + channel] * torque;
                    }
                }
                if beta[load.parameter] == 0.0 {
                    continue;
                }
                for (s, by) in posture.levers.iter().enumerate() {
                    let slope = self.torque_slope(&posture.levers, carried, j, s);
                    let slope = slope * beta[load.parameter];
                    for k in 0..self.equations {
                        let change = ws.turned[k * channels + channel] * slope;
                        match by.source {
                            Source::Channel(c) => ws.g[k * channels + c] += change,
                            Source::Parameter(p) if want.x => ws.x[k * width + p] += change,
                            Source::Gated(p, gate) if want.x => {
                                ws.x[k * width + p] += change * ws.gates[gate];
                            }
                            Source::Parameter(_) | Source::Gated(..) | Source::Law(_) => {}
                        }
                    }
                }
            }
        }
    }

    /// Positions of the mechanism's points in one block, in base coordinates, one per point; `None`
    /// for an unknown point.
    ///
    /// `ws` comes from [`Model::evaluate`] with these parameters.
    #[must_use]
    pub fn points(&self, ws: &Workspace, beta: &[f64]) -> Vec<Option<Vec3>> {
        let points = self.mechanism.points.iter().enumerate();
        points
            .map(|(number, point)| match (&point.chain, point.at) {
                (Some(chain), Some(at)) => {
                    let chain = self.mechanism.chain_index(chain).ok()?;
                    let (tip, moved_by) =
                        (&ws.postures[chain].tip, moves_of(&self.attached, number));
                    Some(self.moved_along(tip.point(&at), moved_by, &tip.axes, beta, &ws.gates))
                }
                (None, Some(at)) => Some(at.map(Lanes::splat)),
                _ => None,
            })
            .collect()
    }

    /// Slope of each joint coordinate by its reading, `diag(∂q/∂r)` of (44), one per channel.
    ///
    /// `ws` comes from [`Model::evaluate`] with derivatives.
    #[must_use]
    pub fn slopes<'a>(&self, ws: &'a Workspace) -> &'a [Lanes] {
        &ws.slopes
    }
}
