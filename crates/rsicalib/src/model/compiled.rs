//! A mechanism with terms, compiled for its readings.

use std::ops::Range;

use nalgebra::Vector3;

use crate::kinematics::elements::{Element, Source, Way, Weight};
use crate::kinematics::posture::Lever;
use crate::mechanism::{ClosureKind, Mechanism, Target};
use crate::model::drives::Drives;
use crate::model::ends::{Attached, End, Knock, Measured, MovedEnd, Moving, Only};
use crate::model::instance::Instance;
use crate::model::law_at::LawAt;
use crate::model::numbering::{Owned, Unknown};
use crate::model::prior::Prior;
use crate::numerics::lanes::{Lanes, Vec3};
use crate::readings::course::Followed;
use crate::readings::{Block, Readings};
use crate::terms::term::{Electronics, Role, Scale, Sensor, Site, Surface};

/// A parameter that is added to the value of a distance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Added {
    pub(crate) parameter: usize,
    /// Number of its gate; none where the parameter acts in all samples.
    pub(crate) gate: Option<usize>,
}

/// What a column says of the distance between an unknown point and another one, in the samples that touch it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeasuredLink {
    pub(crate) closure: usize,
    /// Number of the point among what is unknown.
    pub(crate) point: usize,
    pub(crate) sum: f64,
    pub(crate) count: f64,
}

/// The shape of a plane or a line, by one term.
#[derive(Clone, Copy)]
pub(crate) struct ShapeAt {
    pub(crate) term: &'static dyn Surface,
    pub(crate) first: usize,
    pub(crate) width: usize,
    /// Number of its gate; none where it acts in all samples.
    pub(crate) gate: Option<usize>,
    /// The place that has this shape; none where all have it.
    pub(crate) only: Option<Only>,
}

/// Where a plane or a line is touched: axes along it, and middle and half extent along each of them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patch {
    pub(crate) axes: [[f64; 3]; 2],
    pub(crate) middle: [f64; 2],
    pub(crate) half: [f64; 2],
}

#[derive(Clone)]
pub(crate) struct CompiledClosure {
    pub(crate) kind: ClosureKind,
    /// Its number among the closures of the mechanism.
    pub(crate) number: usize,
    /// Scalar equations where none is left out.
    pub(super) all: usize,
    pub(crate) ends: [End; 2],
    /// Known value; for a measured distance the mean of its column.
    pub(crate) value: f64,
    pub(crate) column: Option<usize>,
    /// What its column counts from: the offset of a known plane.
    pub(crate) from: f64,
    /// The channel that reads the value.
    pub(crate) channel: Option<usize>,
    /// Number of the unknown plane or line that its point is on, among what is unknown.
    pub(crate) on: Option<usize>,
    /// What terms add to the value.
    pub(crate) added: Vec<Added>,
    /// Ends that terms move.
    pub(crate) moved: Vec<MovedEnd>,
    /// Shapes of its plane or line.
    pub(crate) shapes: Vec<ShapeAt>,
    /// Coordinates of the laws of this closure.
    pub(crate) laws: Vec<usize>,
    /// Number of the first equation.
    pub(crate) equation: usize,
    /// Directions along which points that touch must coincide, one equation each; none: the
    /// three axes of the base. Fewer than three where nothing can violate the others, or where they
    /// follow from other equations; empty for a distance that does.
    pub(crate) along: Option<Vec<[f64; 3]>>,
    /// Play, in length units.
    pub(crate) noise: f64,
    /// Where its plane or line is touched in the samples of each group; empty where no term asks for it.
    pub(crate) patches: Vec<Patch>,
}

impl CompiledClosure {
    /// Scalar equations of one sample.
    #[inline(always)]
    pub(crate) fn equations(&self) -> usize {
        self.along.as_ref().map_or(self.all, Vec::len)
    }

    /// What is unknown and stands at its ends: numbers among what is unknown.
    pub(crate) fn unknowns(&self) -> impl Iterator<Item = usize> {
        let ends = self.ends.iter().filter_map(|end| match end {
            End::Unknown(number, ..) | End::Seen(_, Measured::Unknown(number), _) => Some(*number),
            _ => None,
        });
        ends.chain(self.on)
    }

    /// True for coordinates that are equal, whatever their unit.
    pub(crate) fn is_of_coordinates(&self) -> bool {
        matches!(self.ends[0], End::Coordinate(_))
    }

    /// True where the value is read with every sample: by a channel, or in a column of its own.
    #[inline(always)]
    pub(crate) fn is_measured(&self) -> bool {
        self.channel.is_some() || self.column.is_some()
    }

    /// Change of an equation per change of a length.
    pub(crate) fn per_length(&self) -> f64 {
        let value = Some(self.value).filter(|_| !self.is_measured());
        self.kind.facts().per_length(value)
    }
}

/// A term of a sensor or of electronics, at a channel.
#[derive(Clone, Copy)]
pub(crate) struct TermAt<T> {
    pub(crate) term: T,
    pub(crate) channel: usize,
    pub(crate) place: usize,
    /// The session in which the term acts, where there are several.
    pub(crate) session: Option<usize>,
    pub(crate) first: usize,
    pub(crate) width: usize,
}

/// By what a motion of geometry is multiplied in each sample.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gate {
    /// Number of the instance that moves.
    pub(super) instance: usize,
    pub(super) acts: Gating,
}

/// How much of a motion acts in a sample.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Gating {
    /// All of it from one pose on, nothing before.
    Since { place: usize },
    /// In proportion to the temperature above the mean of the session.
    Temperature,
}

impl Gate {
    /// The factor in each sample of a block.
    #[inline(always)]
    pub(crate) fn of(&self, block: &Block) -> Lanes {
        match self.acts {
            Gating::Since { place } => {
                block.pose.map(|p| if p >= place as f64 { 1.0 } else { 0.0 })
            }
            Gating::Temperature => block.temperature,
        }
    }
}

#[derive(Debug, Clone)]
pub(crate) struct LoadAt {
    pub(crate) whose: Weight,
    pub(crate) chain: usize,
    /// The joint that gives; `None`: every joint of the chain.
    pub(super) channel: Option<usize>,
    pub(crate) parameter: usize,
}

impl LoadAt {
    /// Index of the sums of weights that the levers carry.
    #[inline(always)]
    pub(crate) fn slot(&self) -> usize {
        2 * self.chain + self.whose as usize
    }

    /// True for a joint of the chain that gives under this load.
    #[inline(always)]
    pub(crate) fn asks(&self, channel: usize) -> bool {
        self.channel.is_none_or(|own| own == channel)
    }

    /// Channel of a lever that gives under this load.
    #[inline(always)]
    pub(crate) fn gives(&self, lever: &Lever) -> Option<usize> {
        match lever.source {
            Source::Channel(c) if self.asks(c) => Some(c),
            _ => None,
        }
    }
}

/// A mechanism with terms, compiled for readings.
#[derive(Clone)]
pub struct Model {
    /// The mechanism.
    pub mechanism: Mechanism,
    /// The terms at their targets.
    pub instances: Vec<Instance>,
    /// First parameter of each instance.
    pub first: Vec<usize>,
    /// Number of parameters of the terms. The coordinates of the unknown points come after them.
    pub term_parameters: usize,
    /// Number of all parameters.
    pub parameters: usize,
    /// Constants of each channel.
    pub scales: Vec<Scale>,
    /// Unknown points, planes, lines and frames among the columns of `X`.
    pub(crate) owned: Vec<Owned>,
    /// For each combination of keys, the parameters of its samples.
    pub(super) columns: Vec<Vec<usize>>,
    /// What is unknown and no term, one per combination of keys.
    pub unknowns: Vec<Unknown>,
    /// For each of them, the axes from which a plane or a line leans.
    pub(crate) axes: Vec<[[f64; 3]; 3]>,
    /// Points and bodies that are somewhere else in each pose.
    pub(crate) posed: Moving,
    /// Points that terms move on the chain or the body that carries them, sorted by their numbers.
    pub(crate) attached: Vec<Attached>,
    /// What columns say of distances between unknown points.
    pub(crate) measured_links: Vec<MeasuredLink>,
    /// Knocks of instruments, closure by closure.
    pub(crate) knocks: Vec<Knock>,
    pub(crate) equations: usize,
    pub(crate) steps: Vec<Vec<Element>>,
    pub(crate) closures: Vec<CompiledClosure>,
    /// Coordinates of unknown points that null equations determine.
    pub(crate) held: Vec<Prior>,
    pub(crate) sensors: Vec<TermAt<&'static dyn Sensor>>,
    pub(crate) electronics: Vec<TermAt<&'static dyn Electronics>>,
    pub(crate) gates: Vec<Gate>,
    pub(crate) loads: Vec<LoadAt>,
    /// Torques where loops are closed and some joints have no drive.
    pub(crate) drives: Option<Drives>,
    pub(crate) laws: Vec<LawAt>,
    /// Laws that move a frame or change a distance: each has a coordinate of its own.
    pub(crate) amounts: usize,
    /// Largest torque of each load in these readings, by the drawing.
    pub(crate) torques: Vec<f64>,
    pub(crate) gravity: Vec3,
    /// For each of what is unknown, the mean of the points that it sees as a frame.
    pub(super) seen: Vec<Vector3<f64>>,
    /// True where a step turns unknown frames about the axes of the base, [`Model::turning`].
    pub(super) turning: bool,
    /// True where a term asks for directions or velocities.
    pub(super) moving: bool,
}

impl std::fmt::Debug for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Model").field("instances", &self.instances).finish_non_exhaustive()
    }
}

impl Model {
    /// What terms see of the samples of a block, whose readings are `a`: of channel 0, at place 0.
    #[inline(always)]
    pub(crate) fn site<'a>(
        &'a self,
        readings: &'a Readings,
        block: usize,
        a: &'a [Lanes],
    ) -> Site<'a> {
        let meta = &readings.blocks()[block];
        let [approach, velocity] = self.motion(readings, block);
        Site {
            readings: a,
            channel: 0,
            scales: &self.scales,
            time: meta.time,
            temperature: meta.temperature,
            approach,
            velocity,
            course: readings.course(block).filter(|_| self.moving),
            late: 0.0,
            followed: Followed::default(),
            pose: meta.pose,
            place: 0,
        }
    }

    /// Directions of approach and velocities in a block; empty where no term asks for them.
    #[inline(always)]
    fn motion<'a>(&self, readings: &'a Readings, block: usize) -> [&'a [Lanes]; 2] {
        match self.moving {
            true => [readings.approach(block), readings.velocity(block)],
            false => [&[], &[]],
        }
    }

    /// True where the samples of a group touch a place.
    #[inline(always)]
    pub(crate) fn touches(&self, only: Option<Only>, group: usize) -> bool {
        only.is_none_or(|only| self.owned[only.thing].numbers[group] == only.place)
    }

    /// Numbers the equations, of which each closure has as many as it has directions.
    pub(crate) fn number_equations(&mut self) {
        let mut equation = 0;
        for closure in &mut self.closures {
            closure.equation = equation;
            equation += closure.equations();
        }
        self.equations = equation;
    }

    /// The closure of the mechanism that an equation is of.
    #[must_use]
    pub(crate) fn closure_at(&self, equation: usize) -> Option<usize> {
        let own =
            |c: &&CompiledClosure| (c.equation..c.equation + c.equations()).contains(&equation);
        self.closures.iter().find(own).map(|c| c.number)
    }

    /// Scalar equations that one closure of the mechanism gives one sample.
    #[must_use]
    pub fn equations_of(&self, closure: usize) -> usize {
        let mechanism = &self.mechanism;
        let before = mechanism.closures[..closure].iter().filter(|c| !mechanism.is_link(c));
        let compiled = self.closures.get(before.count());
        compiled
            .filter(|_| !mechanism.is_link(&mechanism.closures[closure]))
            .map_or(0, |c| c.equations())
    }

    /// Number of scalar equations of one sample that say something of the parameters: what is unknown
    /// in one pose alone takes one equation for each of its coordinates.
    #[must_use]
    pub fn equations(&self) -> usize {
        self.equations.saturating_sub(self.pose_unknowns())
    }

    /// Number of scalar equations that one row of these readings gives, where closures that do not hold
    /// in it give none: as [`Model::equations`], which is where all hold.
    #[must_use]
    pub fn told(&self, readings: &Readings, row: usize) -> usize {
        if readings.holding.is_whole() {
            return self.equations();
        }
        let mut touched = vec![false; self.posed.points.len()];
        let mut equations = 0;
        for closure in self.closures.iter().filter(|c| readings.holding.holds(row, c.number)) {
            equations += closure.equations();
            for end in &closure.ends {
                if let End::Posed(number) = end {
                    touched[*number] = true;
                }
            }
        }
        let Moving { points, bodies, .. } = &self.posed;
        let own = || points.iter().zip(&touched).filter(|(_, touched)| **touched);
        let of_points = own().flat_map(|(posed, _)| &posed.slots);
        let bodies = bodies.iter().enumerate();
        let bodies = bodies.filter(|(body, _)| own().any(|(posed, _)| posed.body == Some(*body)));
        let slots = of_points.chain(bodies.flat_map(|(_, body)| &body.slots));
        equations.saturating_sub(slots.filter(|slot| slot.is_some()).count())
    }

    /// The same of all rows with a weight above zero.
    #[must_use]
    pub fn told_by(&self, readings: &Readings, weights: &[f64]) -> usize {
        let live = (0..readings.samples).filter(|&row| weights[row] > 0.0);
        match readings.holding.is_whole() {
            true => self.equations() * live.count(),
            false => live.map(|row| self.told(readings, row)).sum(),
        }
    }

    /// Misclosures of one row: the equations of the closures that hold in it.
    #[must_use]
    pub fn misclosures(&self, readings: &Readings, row: usize) -> usize {
        let holds = |c: &&CompiledClosure| readings.holding.holds(row, c.number);
        self.closures.iter().filter(holds).map(CompiledClosure::equations).sum()
    }

    /// For each equation, one in the lanes of a block in which its closure does not hold, zero in the
    /// others; nothing where all closures hold in all rows.
    pub(crate) fn absent(&self, readings: &Readings, block: usize, into: &mut Vec<Lanes>) {
        into.clear();
        for closure in &self.closures {
            let Some(holds) = readings.holding.of_block(block, closure.number) else { return };
            into.extend(std::iter::repeat_n(Lanes::ONE - holds, closure.equations()));
        }
    }

    /// Number of scalar equations of one sample, before what is unknown in its pose is eliminated.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.equations
    }

    /// Number of coordinates that are unknown in one pose alone.
    #[must_use]
    pub fn pose_unknowns(&self) -> usize {
        self.posed.unknowns
    }

    /// What a sample has: a reading of each channel, then the coordinates of its own pose.
    #[must_use]
    pub fn stride(&self) -> usize {
        self.scales.len() + self.pose_unknowns()
    }

    /// First parameter of something unknown, in the samples of a group.
    #[inline(always)]
    pub(crate) fn unknown_first(&self, number: usize, group: usize) -> usize {
        self.term_parameters + self.unknowns[self.owned[number].numbers[group]].first
    }

    /// First column of something unknown.
    #[inline(always)]
    pub(crate) fn unknown_column(&self, number: usize) -> usize {
        self.term_parameters + self.owned[number].column
    }

    /// For each group of the readings, the parameters of the columns of `X`: those of the terms,
    /// then three for each unknown point that the group touches.
    ///
    /// The number of columns does not grow with the number of unknown points.
    #[must_use]
    pub fn columns(&self) -> &[Vec<usize>] {
        &self.columns
    }

    /// Number of columns of `X`, the same for every group.
    #[must_use]
    pub fn width(&self) -> usize {
        self.term_parameters + self.owned.iter().map(|o| o.width).sum::<usize>()
    }

    /// The first parameter of the term `id` at a channel; `None` without such an instance.
    #[must_use]
    pub fn column(&self, role: Role, channel: usize) -> Option<usize> {
        let at = |i: &Instance| i.target == Target::Channel(channel) && i.term.role() == role;
        self.instances.iter().position(at).map(|k| self.first[k])
    }

    /// Parameters of all gains of a channel: its own, and what it shares.
    pub(crate) fn gains_of(&self, channel: usize) -> impl Iterator<Item = usize> {
        let instances = self.instances.iter().zip(&self.first);
        let own = move |i: &Instance| {
            i.term.role() == Role::Gain
                && self.mechanism.has_part(i.target, Target::Channel(channel))
        };
        instances.filter(move |(i, _)| own(i)).map(|(_, first)| *first)
    }

    /// For each equation, the columns of `X` that are not always zero, ascending.
    #[must_use]
    pub fn active(&self) -> Vec<Vec<usize>> {
        let mut active = Vec::with_capacity(self.equations);
        // What a law says of one chain or closure may depend on any channel.
        let seen: Vec<usize> = self.laws.iter().flat_map(LawAt::coordinates).collect();
        for closure in &self.closures {
            let mut columns: Vec<usize> = closure.added.iter().map(|a| a.parameter).collect();
            columns.extend(closure.shapes.iter().flat_map(|s| s.first..s.first + s.width));
            columns.extend(closure.moved.iter().flat_map(|m| m.by.first..m.by.first + 3));
            self.columns_of_channels(&seen, None, &mut columns);
            for joint in self.laws.iter().flat_map(|law| law.hangs.iter().flatten()) {
                let channels = self.mechanism.channels_of(joint.chain);
                self.columns_of_channels(&channels, Some(joint.chain), &mut columns);
            }
            let laws = self.laws.iter().filter(|law| closure.laws.contains(&law.to));
            columns.extend(laws.flat_map(|law| law.first..law.first + law.term.width));
            let own = |number: usize| {
                let first = self.unknown_column(number);
                first..first + self.owned[number].width
            };
            columns.extend(closure.on.into_iter().flat_map(own));
            if let Some(channel) = closure.channel {
                self.columns_of_channels(&[channel], None, &mut columns);
            }
            let moves = |[from, to]: [usize; 2]| {
                let own = self.attached[from..to].iter();
                own.flat_map(|own| own.by.first..own.by.first + 3)
            };
            for end in &closure.ends {
                match end {
                    End::Carried(chain, _, moved_by) => {
                        columns.extend(moves(*moved_by));
                        let channels = self.mechanism.channels_of(*chain);
                        self.columns_of_channels(&channels, Some(*chain), &mut columns);
                    }
                    End::Unknown(number, ..) => columns.extend(own(*number)),
                    End::Seen(_, frame, [from, to]) => {
                        if let Measured::Unknown(number) = frame {
                            columns.extend(own(*number));
                        }
                        let knocks = &self.knocks[*from..*to];
                        columns.extend(knocks.iter().flat_map(Knock::columns));
                    }
                    End::Coordinate(c) => self.columns_of_channels(&[*c], None, &mut columns),
                    End::Posed(number) => {
                        columns.extend(moves(self.posed.points[*number].moved_by));
                    }
                    End::Fixed(_) => {}
                }
            }
            columns.sort_unstable();
            columns.dedup();
            active.extend(std::iter::repeat_n(columns, closure.equations()));
        }
        active
    }

    /// Columns of the terms of some channels, and of the chain that they are of.
    fn columns_of_channels(
        &self,
        channels: &[usize],
        chain: Option<usize>,
        columns: &mut Vec<usize>,
    ) {
        for (instance, &first) in self.instances.iter().zip(&self.first) {
            let on_chain = match instance.target {
                Target::Channel(c) => channels.contains(&c),
                Target::Chain(c) | Target::Row(c, _) => Some(c) == chain,
                Target::All => true,
                Target::Closure(_) => false,
                shared => self.mechanism.parts(shared).into_iter().any(|part| match part {
                    Target::Channel(c) => channels.contains(&c),
                    Target::Chain(c) | Target::Row(c, _) => Some(c) == chain,
                    _ => false,
                }),
            };
            if on_chain {
                columns.extend(first..first + instance.width());
            }
        }
    }

    /// The parameters of the mechanism as drawn: zeros, and what is unknown where it is drawn.
    #[must_use]
    pub fn nominal(&self) -> Vec<f64> {
        let mut beta = vec![0.0; self.parameters];
        for unknown in &self.unknowns {
            let own = &mut beta[self.term_parameters + unknown.first..][..unknown.width];
            own.copy_from_slice(&unknown.thing.drawn(&self.mechanism));
        }
        beta
    }

    /// Factor from the misclosure of each equation to a length.
    #[must_use]
    pub fn lengths(&self) -> Vec<f64> {
        let mut lengths = Vec::with_capacity(self.equations);
        for closure in &self.closures {
            let scale = 1.0 / closure.per_length();
            lengths.extend(std::iter::repeat_n(scale, closure.equations()));
        }
        lengths
    }

    /// Unit of the misclosure: of length where any closure is of lengths, else of the coordinates
    /// that are equal.
    #[must_use]
    pub fn misclosure_unit(&self) -> &str {
        let coordinate = self.closures.iter().find_map(|closure| match closure.ends {
            [End::Coordinate(channel), _] => Some(channel),
            _ => None,
        });
        match coordinate {
            Some(channel) if !self.is_of_lengths() => {
                self.mechanism.coordinate_unit(Target::Channel(channel))
            }
            _ => &self.mechanism.length_unit,
        }
    }

    /// True where any closure is of lengths.
    pub(crate) fn is_of_lengths(&self) -> bool {
        self.closures.iter().any(|closure| !closure.is_of_coordinates())
    }

    /// For each equation whether its misclosure is in the [unit](Self::misclosure_unit) of all.
    #[must_use]
    pub fn in_one_unit(&self) -> Vec<bool> {
        let lengths = self.is_of_lengths();
        let own = |closure: &CompiledClosure| closure.is_of_coordinates() != lengths;
        let rows = |closure| std::iter::repeat_n(own(closure), closure.equations());
        self.closures.iter().flat_map(rows).collect()
    }

    /// The equations of each closure that takes part in samples.
    pub(crate) fn equations_by_closure(&self) -> impl Iterator<Item = Range<usize>> {
        self.closures.iter().map(|closure| closure.equation..closure.equation + closure.equations())
    }

    /// Closures whose length, or point, stands in columns of the readings: their numbers, and their equations.
    pub(crate) fn lengths_read(&self) -> impl Iterator<Item = (usize, usize)> {
        let seen = |closure: &CompiledClosure| {
            closure.column.is_some() || closure.ends.iter().any(|e| matches!(e, End::Seen(..)))
        };
        let all = self.closures.iter().zip(self.equations_by_closure()).enumerate();
        all.filter(move |(_, (closure, _))| seen(closure))
            .flat_map(|(k, (_, equations))| equations.map(move |equation| (k, equation)))
    }

    /// True where another instrument measures something of a closure: a length, or where a point is.
    pub(crate) fn measures(&self) -> bool {
        let seen = |end: &End| matches!(end, End::Seen(..));
        self.closures.iter().any(|it| it.is_measured() || it.ends.iter().any(seen))
    }

    /// The kind of each closure that takes part in samples and declares no play, by kind and by what
    /// its ends are; none for rigid distances of a mechanism, for joints between chains, and for closures that
    /// do. A bar or a surface somewhere is set up and touched, and its seating is as unknown as it is.
    pub(crate) fn undeclared(&self) -> Vec<Option<(ClosureKind, [u8; 2])>> {
        let end = |end: &End| match end {
            End::Carried(..) => 0,
            End::Fixed(_) => 1,
            End::Unknown(..) => 2,
            End::Coordinate(_) => 0,
            End::Posed(_) | End::Seen(..) => 3,
        };
        let kind = |closure: &CompiledClosure| {
            let ends = [end(&closure.ends[0]), end(&closure.ends[1])];
            // Two chains that touch are one mechanism, with a joint there.
            let set_up = ends.contains(&2) || closure.on.is_some();
            let rigid = closure.kind.has_value() && !set_up;
            let rigid = rigid || ends == [0, 0] || self.pose_unknowns() > 0;
            let open = !rigid && closure.noise == 0.0;
            open.then_some((closure.kind, ends))
        };
        self.closures.iter().map(kind).collect()
    }

    /// How each joint that a channel senses moves, and the channel.
    pub(crate) fn joints(&self) -> impl Iterator<Item = (Way, usize)> {
        self.steps.iter().flatten().filter_map(|step| match step {
            Element::Move(_, way, Source::Channel(c)) | Element::Geared(way, c, _) => {
                Some((*way, *c))
            }
            _ => None,
        })
    }

    /// Variance of each equation by play, in units of `f²`.
    #[must_use]
    pub fn play(&self) -> Vec<f64> {
        let mut play = Vec::with_capacity(self.equations);
        for closure in &self.closures {
            let variance = (closure.noise * closure.per_length()).powi(2);
            play.extend(std::iter::repeat_n(variance, closure.equations()));
        }
        play
    }
}
