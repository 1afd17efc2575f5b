//! Laws that couple joints, at the stage of loads.
//!
//! A law sees the coordinates `q` that the sensors' stage leaves, as loads do, and adds to one
//! coordinate: of a joint, or an amount of its own by which a frame moves or a distance changes,
//!
//! ```text
//! q'_j = q_j + Σ L(r, q, β)                                               (45)
//! ∂f/∂β += (∂f/∂q'_j) ∂L/∂β,   ∂f/∂q += (∂f/∂q'_j) ∂L/∂q,   ∂f/∂r += (∂f/∂q'_j) ∂L/∂r
//! ```

use crate::kinematics::elements::{Source, Way, Weight};
use crate::kinematics::posture::{Carried, Lever, Posture};
use crate::mechanism::{MOST_PARAMETERS, MOST_VARIABLES, Variable};
use crate::model::compiled::{CompiledClosure, Model};
use crate::model::law_at::{Joint, LawAt, LawRoom};
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, Vec3, dot, minus};
use crate::readings::Readings;
use crate::readings::way::Memory;
use crate::terms::law::of_channel;
use crate::terms::term::Site;

/// How chains hang before loads, and what their levers carry.
struct Hung<'a> {
    postures: &'a [Posture],
    carried: &'a [Vec<Carried>],
    gates: &'a [Lanes],
}

impl Model {
    /// Computes what each law adds, and its derivatives.
    #[inline(always)]
    pub(crate) fn take_laws(
        &self,
        readings: &Readings,
        block: usize,
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        ws.angles.resize(self.scales.len() + self.amounts, Lanes::ZERO);
        self.hang(beta, ws);
        let room = &mut ws.laws;
        room.values.clear();
        room.by_parameter.clear();
        room.by_joint.clear();
        room.by_reading.clear();
        let meta = &readings.blocks()[block];
        let mut site = self.site(readings, block, &ws.corrected);
        let mut out = [Lanes::ZERO; 1 + MOST_PARAMETERS + MOST_VARIABLES];
        for (l, law) in self.laws.iter().enumerate() {
            site.channel = law.joint.channel.unwrap_or_default();
            let term = law.term;
            let hung = Hung { postures: &ws.unloaded, carried: &ws.carried, gates: &ws.gates };
            let mut seen = [Lanes::ZERO; MOST_VARIABLES];
            for (k, seen) in seen.iter_mut().enumerate().take(term.variables.len()) {
                *seen = self.seen_by(law, k, (readings, block), &site, &ws.angles, &hung);
            }
            let p = &beta[law.first..law.first + term.width];
            let input = |k: usize| match k.checked_sub(p.len()) {
                None => Lanes::splat(p[k]),
                Some(k) => seen[k],
            };
            let within = law.session.map_or(Lanes::ONE, |s| meta.within(s));
            if !(want.x || want.a) {
                room.values.push(term.value(input) * within);
                continue;
            }
            let out = &mut out[..1 + term.width + term.variables.len()];
            term.derivatives(input, out);
            out.iter_mut().for_each(|value| *value = *value * within);
            room.values.push(out[0]);
            for k in 0..term.width {
                room.by_parameter.push((law.first + k, l, out[1 + k]));
            }
            for (k, slope) in out[1 + term.width..].iter().enumerate() {
                self.turn_with(law, (l, k), *slope, site.channel, &hung, room);
            }
        }
    }

    /// A variable of a law.
    #[inline(always)]
    fn seen_by(
        &self,
        law: &LawAt,
        k: usize,
        (readings, block): (&Readings, usize),
        site: &Site,
        angles: &[Lanes],
        hung: &Hung,
    ) -> Lanes {
        let (variable, of) = (&law.term.variables[k], law.of[k]);
        let remembered = |memory| readings.remembered(block, of, memory);
        match variable {
            Variable::Theta(_) | Variable::Coordinate(_) => angles[of],
            Variable::Column(_) => readings.columns(block)[of],
            Variable::Travelled(_) => remembered(Memory::Travelled) * self.scales[of].gain.abs(),
            Variable::SinceTurn(_) => remembered(Memory::SinceTurn) * self.scales[of].gain,
            Variable::Play(_, width) => {
                let gain = self.scales[of].gain;
                remembered(Memory::Play { width: width.value() / gain.abs() }) * gain.signum()
            }
            Variable::Length => self.length_of(law, readings.columns(block), angles),
            Variable::Reach => reach(law.hangs_at(k), hung.postures, hung.carried),
            Variable::Torque | Variable::TorqueOf(_) => {
                let joint = law.hangs_at(k);
                match (&self.drives, joint.channel) {
                    (Some(drives), Some(c)) => drives.at(block, law.whose, c),
                    _ => self.torque(joint, law.whose, hung.postures, hung.carried),
                }
            }
            own => of_channel(*own, site),
        }
    }

    /// What moves a law through one of its variables, by which it changes so much.
    #[inline(always)]
    fn turn_with(
        &self,
        law: &LawAt,
        (l, k): (usize, usize),
        slope: Lanes,
        channel: usize,
        hung: &Hung,
        room: &mut LawRoom,
    ) {
        let scale = &self.scales[channel];
        let mut by_reading = |by: f64| room.by_reading.push((channel, l, slope * by));
        match law.term.variables[k] {
            Variable::Reading => by_reading(1.0),
            Variable::U => by_reading(1.0 / scale.half_range),
            Variable::Phi => by_reading(scale.gain),
            Variable::Theta(_) | Variable::Coordinate(_) => {
                room.by_joint.push((law.of[k], l, slope));
            }
            Variable::Length => {
                if let Some(channel) = self.closure_of(law).and_then(|c| c.channel) {
                    room.by_joint.push((channel, l, slope));
                }
            }
            Variable::Torque | Variable::TorqueOf(_) if self.drives.is_some() => {}
            Variable::Torque | Variable::TorqueOf(_) => {
                self.through_posture(law.hangs_at(k), Some(law.whose), l, slope, hung, room);
            }
            Variable::Reach => self.through_posture(law.hangs_at(k), None, l, slope, hung, room),
            _ => {}
        }
    }

    /// The closure of a law, as compiled.
    #[inline(always)]
    fn closure_of(&self, law: &LawAt) -> Option<&CompiledClosure> {
        self.closures.iter().find(|closure| closure.laws.contains(&law.to))
    }

    /// `length` of a law: what its closure gives as the value, before terms and laws add to it.
    #[inline(always)]
    fn length_of(&self, law: &LawAt, columns: &[Lanes], angles: &[Lanes]) -> Lanes {
        let Some(closure) = self.closure_of(law) else { return Lanes::ZERO };
        match (closure.channel, closure.column) {
            (Some(channel), _) => angles[channel],
            (None, Some(column)) => columns[column],
            (None, None) => Lanes::splat(closure.value),
        }
    }

    /// The chains under no load, where a law needs to know how they hang.
    #[inline(always)]
    fn hang(&self, beta: &[f64], ws: &mut Workspace) {
        let hangs = |chain: usize| self.laws.iter().any(|law| law.sees_hang(chain));
        if !(0..self.steps.len()).any(hangs) {
            return;
        }
        ws.unloaded.resize_with(self.steps.len(), Posture::new);
        ws.carried.resize_with(2 * self.steps.len(), Vec::new);
        for (chain, (posture, steps)) in ws.unloaded.iter_mut().zip(&self.steps).enumerate() {
            if hangs(chain) {
                posture.take(steps, &ws.angles, beta, &ws.gates);
                for whose in [Weight::Tip, Weight::Links] {
                    posture.carried(whose, &mut ws.carried[2 * chain + whose as usize]);
                }
            }
        }
    }

    /// Torque of gravity about a joint: that of its channel, which may drive several.
    #[inline(always)]
    fn torque(
        &self,
        joint: Joint,
        whose: Weight,
        hung: &[Posture],
        carried: &[Vec<Carried>],
    ) -> Lanes {
        let mut torque = Lanes::ZERO;
        for j in own_levers(joint, hung) {
            let carried = &carried[2 * joint.chain + whose as usize];
            torque += dot(&carried[j].moved_by(&hung[joint.chain].levers[j]), &self.gravity);
        }
        torque
    }

    /// Derivatives of a law through the torque of a joint by somebody's weight, or through its reach.
    #[inline(always)]
    fn through_posture(
        &self,
        joint: Joint,
        weight: Option<Weight>,
        l: usize,
        slope: Lanes,
        hung: &Hung,
        room: &mut LawRoom,
    ) {
        let Hung { postures: hung, carried, gates } = *hung;
        let Some(own) = own_levers(joint, hung).next() else { return };
        let levers = &hung[joint.chain].levers;
        let (whose, arm) = match weight {
            Some(whose) => (whose, None),
            None => (Weight::Tip, Some(arm(joint, hung, carried))),
        };
        let carried = &carried[2 * joint.chain + whose as usize];
        for (s, by) in levers.iter().enumerate() {
            let change = match &arm {
                None => {
                    let mut change = Lanes::ZERO;
                    for j in own_levers(joint, hung) {
                        change += self.torque_slope(levers, carried, j, s);
                    }
                    change
                }
                Some((point, along)) => reach_slope(levers, point, along, own, s),
            };
            match by.source {
                Source::Channel(c) => room.by_joint.push((c, l, slope * change)),
                Source::Parameter(p) => room.by_parameter.push((p, l, slope * change)),
                Source::Gated(p, gate) => {
                    room.by_parameter.push((p, l, slope * change * gates[gate]));
                }
                Source::Law(_) => {}
            }
        }
    }

    /// Eq. (45): adds what the laws add.
    #[inline(always)]
    pub(crate) fn add_laws(&self, ws: &mut Workspace) {
        for (law, value) in self.laws.iter().zip(&ws.laws.values) {
            ws.angles[law.to] += *value;
        }
    }

    /// Holds `∂f/∂L` before the loads turn `∂f/∂q'` to `∂f/∂q`.
    #[inline(always)]
    pub(crate) fn hold_laws(&self, ws: &mut Workspace) {
        let channels = self.scales.len();
        ws.laws.pulls.clear();
        for k in 0..self.equations {
            for law in &self.laws {
                ws.laws.pulls.push(match law.to.checked_sub(channels) {
                    None => ws.g[k * channels + law.to],
                    Some(amount) => ws.laws.h[k * self.amounts + amount],
                });
            }
        }
    }

    /// The chain rule through the laws.
    #[inline(always)]
    pub(crate) fn turn_laws(&self, want: Want, ws: &mut Workspace) {
        let (channels, width, laws) = (self.scales.len(), self.width(), self.laws.len());
        let room = &mut ws.laws;
        room.direct.clear();
        room.direct.resize(self.equations * channels, Lanes::ZERO);
        for k in 0..self.equations {
            let pulls = &room.pulls[k * laws..(k + 1) * laws];
            if want.x {
                for &(column, law, slope) in &room.by_parameter {
                    ws.x[k * width + column] += pulls[law] * slope;
                }
            }
            for &(channel, law, slope) in &room.by_joint {
                ws.g[k * channels + channel] += pulls[law] * slope;
            }
            for &(channel, law, slope) in &room.by_reading {
                room.direct[k * channels + channel] += pulls[law] * slope;
            }
        }
    }
}

/// The levers of a joint.
#[inline(always)]
fn own_levers(joint: Joint, hung: &[Posture]) -> impl Iterator<Item = usize> {
    let source = joint.channel.map(Source::Channel);
    // Of a mechanism without chains no channel moves a joint.
    let levers = hung.get(joint.chain).into_iter().flat_map(|hung| hung.levers.iter().enumerate());
    levers.filter(move |(_, lever)| Some(lever.source) == source).map(|(j, _)| j)
}

/// The middle of the points that the chain of a joint carries, and the direction to it from the
/// joint.
#[inline(always)]
fn arm(joint: Joint, hung: &[Posture], carried: &[Vec<Carried>]) -> (Vec3, Vec3) {
    let levers = &hung[joint.chain].levers;
    let tip = &carried[2 * joint.chain + Weight::Tip as usize];
    let (Some(j), Some(last)) = (own_levers(joint, hung).next(), tip.last()) else {
        return ([Lanes::ZERO; 3], [Lanes::ZERO; 3]);
    };
    let mut along = minus(&last.moment, &levers[j].origin);
    let length = dot(&along, &along).sqrt().map(|l| l.max(f64::MIN_POSITIVE));
    along.iter_mut().for_each(|a| *a = *a / length);
    (last.moment, along)
}

/// `reach` of a joint.
#[inline(always)]
fn reach(joint: Joint, hung: &[Posture], carried: &[Vec<Carried>]) -> Lanes {
    let (point, along) = arm(joint, hung, carried);
    let Some(j) = own_levers(joint, hung).next() else { return Lanes::ZERO };
    dot(&along, &minus(&point, &hung[joint.chain].levers[j].origin))
}

/// Derivative of the reach from lever `j` by lever `s`: what is before the joint moves both ends.
#[inline(always)]
fn reach_slope(levers: &[Lever], point: &Vec3, along: &Vec3, j: usize, s: usize) -> Lanes {
    let turns = levers[s].way == Way::Turn;
    if s < j || (s == j && turns) {
        return Lanes::ZERO;
    }
    dot(along, &levers[s].moves(point))
}
