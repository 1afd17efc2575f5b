//! Forward kinematics of one chain, and the derivatives of its points by each motion.
//!
//! A chain is compiled to [`Element`]s: rigid transformations, and rotations about or translations
//! along the axes of the current frame, driven by a channel or by a parameter of the geometry. A
//! point `p` that the chain carries moves with motion `s` as
//!
//! ```text
//! ∂p/∂s = z_s × (p - o_s)    turn about the axis z_s through o_s          (21)
//! ∂p/∂s = z_s                slide along z_s                              (22)
//! ```

use crate::kinematics::elements::{Axis, Element, Source, Way, Weight as Whose};
use crate::numerics::lanes::{Lanes, Vec3, cross, minus};

/// A frame of eight samples: three axes and an origin, in base coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// The axes.
    pub axes: [Vec3; 3],
    /// The origin.
    pub origin: Vec3,
}

/// The axis of a motion, in base coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Lever {
    /// Rotation or translation.
    pub way: Way,
    /// Source of the motion's coordinate.
    pub source: Source,
    /// Direction of the axis; of a geared joint times its ratio, so that derivatives by the motion
    /// are those by the coordinate of the channel.
    pub axis: Vec3,
    /// A point on the axis.
    pub origin: Vec3,
}

impl Lever {
    /// Derivative of a carried point by the motion, eqs. (21, 22).
    #[inline(always)]
    #[must_use]
    pub fn moves(&self, point: &Vec3) -> Vec3 {
        match self.way {
            Way::Turn => cross(&self.axis, &minus(point, &self.origin)),
            Way::Slide => self.axis,
        }
    }
}

/// A weight on a chain, in base coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Weight {
    /// Kind of the weight.
    pub whose: Whose,
    /// Centre of the weight.
    pub at: Vec3,
    /// Size of the weight.
    pub weight: f64,
    /// Levers before this index carry the weight.
    pub levers: usize,
}

/// Sum of the weights that a lever carries.
#[derive(Debug, Clone, Copy)]
pub struct Carried {
    /// Sum of the weights.
    pub weight: f64,
    /// Sum of weight times centre.
    pub moment: Vec3,
}

impl Carried {
    /// Sum over the weights of weight times [`Lever::moves`].
    #[inline(always)]
    #[must_use]
    pub fn moved_by(&self, lever: &Lever) -> Vec3 {
        let mut moved = lever.axis;
        match lever.way {
            Way::Turn => {
                let mut arm = self.moment;
                for (arm, origin) in arm.iter_mut().zip(&lever.origin) {
                    *arm -= *origin * self.weight;
                }
                moved = cross(&lever.axis, &arm);
            }
            Way::Slide => moved.iter_mut().for_each(|m| *m = *m * self.weight),
        }
        moved
    }
}

/// A chain at eight samples.
#[derive(Debug, Clone)]
pub struct Posture {
    /// The frame at the end of the chain.
    pub tip: Frame,
    /// One lever per motion, base first.
    pub levers: Vec<Lever>,
    /// Weights on the chain.
    pub weights: Vec<Weight>,
}

impl Frame {
    /// The base.
    pub const BASE: Self = Self {
        axes: [
            [Lanes::ONE, Lanes::ZERO, Lanes::ZERO],
            [Lanes::ZERO, Lanes::ONE, Lanes::ZERO],
            [Lanes::ZERO, Lanes::ZERO, Lanes::ONE],
        ],
        origin: [Lanes::ZERO; 3],
    };

    /// A point of this frame, in base coordinates.
    #[inline(always)]
    #[must_use]
    pub fn point(&self, at: &[f64; 3]) -> Vec3 {
        // A loop and not `array::from_fn`, which calls its closure: a call leaves the vector
        // instructions of `lanes::dispatch`.
        let [x, y, z] = &self.axes;
        let mut point = self.origin;
        for (i, p) in point.iter_mut().enumerate() {
            *p = *p + x[i] * at[0] + y[i] * at[1] + z[i] * at[2];
        }
        point
    }

    /// A frame at a place that is the same in all samples.
    #[inline(always)]
    fn fixed(rotation: &[f64; 9], translation: &[f64; 3]) -> Self {
        let mut frame = Self::BASE;
        for i in 0..3 {
            frame.origin[i] = Lanes::splat(translation[i]);
            for j in 0..3 {
                frame.axes[j][i] = Lanes::splat(rotation[3 * i + j]);
            }
        }
        frame
    }

    #[inline(always)]
    fn place(&mut self, rotation: &[f64; 9], translation: &[f64; 3]) {
        let [x, y, z] = self.axes;
        for (axis, by) in self.axes.iter().zip(translation) {
            if *by != 0.0 {
                for (origin, along) in self.origin.iter_mut().zip(axis) {
                    *origin += *along * *by;
                }
            }
        }
        // Most places of a drawing turn about one axis or not at all.
        const SAME: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        if *rotation == SAME {
            return;
        }
        for (j, axis) in self.axes.iter_mut().enumerate() {
            match [rotation[j], rotation[3 + j], rotation[6 + j]] {
                [1.0, 0.0, 0.0] => *axis = x,
                [0.0, 1.0, 0.0] => *axis = y,
                [0.0, 0.0, 1.0] => *axis = z,
                [a, b, c] => {
                    for i in 0..3 {
                        axis[i] = x[i] * a + y[i] * b + z[i] * c;
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn turn(&mut self, axis: Axis, angle: Lanes) {
        let (sin, cos) = angle.sin_cos_as_compiled();
        let (a, b) = match axis {
            Axis::X => (1, 2),
            Axis::Y => (2, 0),
            Axis::Z => (0, 1),
        };
        for i in 0..3 {
            let (u, v) = (self.axes[a][i], self.axes[b][i]);
            self.axes[a][i] = u.mul_add(cos, v * sin);
            self.axes[b][i] = v.mul_add(cos, -(u * sin));
        }
    }

    #[inline(always)]
    fn slide(&mut self, axis: Axis, by: Lanes) {
        let along = self.axes[axis as usize];
        for (origin, along) in self.origin.iter_mut().zip(along) {
            *origin += along * by;
        }
    }
}

impl Posture {
    /// An empty posture, filled by [`Posture::take`].
    #[must_use]
    pub fn new() -> Self {
        Self { tip: Frame::BASE, levers: Vec::new(), weights: Vec::new() }
    }

    /// Computes the posture from the elements of a chain, base first.
    ///
    /// `angles` holds one joint coordinate per channel of the mechanism, then the amounts by which
    /// laws move, `parameters` the parameters of the model, `gates` the samples in which gated
    /// parameters act.
    #[inline(always)]
    pub fn take(
        &mut self,
        steps: &[Element],
        angles: &[Lanes],
        parameters: &[f64],
        gates: &[Lanes],
    ) {
        let (mut frame, steps) = match steps {
            [Element::Rigid(rotation, translation), rest @ ..] => {
                (Frame::fixed(rotation, translation), rest)
            }
            _ => (Frame::BASE, steps),
        };
        self.levers.clear();
        self.levers.reserve(steps.len());
        self.weights.clear();
        for step in steps {
            match step {
                Element::Rigid(rotation, translation) => frame.place(rotation, translation),
                Element::Move(axis, way, source) => {
                    self.levers.push(Lever {
                        way: *way,
                        source: *source,
                        axis: frame.axes[*axis as usize],
                        origin: frame.origin,
                    });
                    let by = match *source {
                        Source::Channel(c) | Source::Law(c) => angles[c],
                        // Most parameters of a geometry that may differ are as drawn.
                        Source::Parameter(p) if parameters[p] == 0.0 => continue,
                        Source::Parameter(p) => Lanes::splat(parameters[p]),
                        Source::Gated(p, gate) => gates[gate] * parameters[p],
                    };
                    match way {
                        Way::Turn => frame.turn(*axis, by),
                        Way::Slide => frame.slide(*axis, by),
                    }
                }
                Element::Geared(way, channel, ratio) => {
                    self.levers.push(Lever {
                        way: *way,
                        source: Source::Channel(*channel),
                        axis: frame.axes[Axis::Z as usize].map(|z| z * *ratio),
                        origin: frame.origin,
                    });
                    let by = angles[*channel] * *ratio;
                    match way {
                        Way::Turn => frame.turn(Axis::Z, by),
                        Way::Slide => frame.slide(Axis::Z, by),
                    }
                }
                Element::Mass(whose, at, weight) => self.weights.push(Weight {
                    whose: *whose,
                    at: frame.point(at),
                    weight: *weight,
                    levers: self.levers.len(),
                }),
            }
        }
        self.tip = frame;
    }
}

impl Posture {
    /// Sum of the weights of one kind that each lever carries.
    #[inline(always)]
    pub fn carried(&self, whose: Whose, out: &mut Vec<Carried>) {
        out.clear();
        out.resize(self.levers.len(), Carried { weight: 0.0, moment: [Lanes::ZERO; 3] });
        for weight in self.weights.iter().filter(|w| w.whose == whose && w.levers > 0) {
            let last = &mut out[weight.levers - 1];
            last.weight += weight.weight;
            for (moment, at) in last.moment.iter_mut().zip(&weight.at) {
                *moment += *at * weight.weight;
            }
        }
        // Each lever also carries the weights of all levers after it.
        for j in (1..out.len()).rev() {
            let next = out[j];
            let own = &mut out[j - 1];
            own.weight += next.weight;
            for (moment, more) in own.moment.iter_mut().zip(&next.moment) {
                *moment += *more;
            }
        }
    }
}

impl Default for Posture {
    fn default() -> Self {
        Self::new()
    }
}
