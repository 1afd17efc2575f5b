//! What a kind of closure is.

use crate::numerics::lanes::{Lanes, Vec3, dot};

/// A closure at eight samples.
#[derive(Debug, Clone, Copy)]
pub struct At<'a> {
    /// From the second end to the first, in base coordinates.
    pub apart: Vec3,
    /// The value, with what terms add to it, in length units.
    pub value: Lanes,
    /// How what is counted from changes in each equation as the first end moves: the shape of a surface.
    pub shape: Option<[Vec3; 2]>,
    /// True for a value that a channel reads.
    pub measured: bool,
    /// Directions along which the equations count; none: the three axes of the base.
    pub along: Option<&'a [[f64; 3]]>,
}

/// What an end of a closure is the name of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A point.
    Point,
    /// A plane, whose second end is the origin of the base, and whose value is its offset.
    Plane,
    /// A line, whose second end is a point of it.
    Line,
    /// A channel, whose end is the coordinate of its joint.
    Channel,
}

impl Part {
    /// The word for it, in files and messages.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Point => "point",
            Self::Plane => "plane",
            Self::Line => "line",
            Self::Channel => "channel",
        }
    }
}

/// The value that a closure is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Given {
    /// None.
    Nothing,
    /// A number, a column of the readings, or a channel.
    Value,
    /// None, but what it is between has one: terms can add to it.
    Offset,
}

impl At<'_> {
    /// What a vector is along the direction of an equation.
    #[inline(always)]
    #[must_use]
    pub fn along(&self, row: usize, vector: &Vec3) -> Lanes {
        match self.along {
            None => vector[row],
            Some(all) => {
                vector[0] * all[row][0] + vector[1] * all[row][1] + vector[2] * all[row][2]
            }
        }
    }

    /// The same of the way that a point moves, from a surface with a shape.
    #[inline(always)]
    #[must_use]
    pub fn from_surface(&self, row: usize, moved: &Vec3) -> Lanes {
        let across = self.along(row, moved);
        self.shape.map_or(across, |shape| across - dot(&shape[row], moved))
    }
}

/// What is true of a kind of closure.
#[derive(Debug)]
pub struct Facts {
    /// What it holds, in words.
    pub words: &'static str,
    /// Scalar equations of one sample.
    pub equations: usize,
    /// What it is between.
    pub between: [Part; 2],
    /// The value that it has.
    pub given: Given,
    /// True for equations that are the components of one vector: they may be taken along any
    /// directions, and those left out that say nothing.
    pub is_vector: bool,
    /// How often a length is multiplied in an equation: 2 where it is an area.
    pub dimension: i32,
}

impl Facts {
    /// Change of an equation per change of a length, to first order, where the closure has this value;
    /// `None` where a channel measures it.
    #[must_use]
    pub fn per_length(&self, value: Option<f64>) -> f64 {
        let power = |value: f64| f64::from(self.dimension) * value.powi(self.dimension - 1);
        value.map_or(1.0, power)
    }
}

/// One kind of closure: its facts, and its equations for eight samples.
///
/// The equations are inlined into the kernel of the model, and so take no `self`.
pub trait Kind {
    /// What is true of it.
    const FACTS: Facts;

    /// Misclosure of an equation: where a kind says nothing else, how far the ends are apart along a
    /// direction.
    #[inline(always)]
    fn misclosure(at: &At, row: usize) -> Lanes {
        at.along(row, &at.apart)
    }

    /// Change of an equation as the first end moves by `moved`; the second end counts with the
    /// opposite sign. `sign` multiplies it.
    #[inline(always)]
    fn by_end(at: &At, row: usize, moved: &Vec3, sign: f64) -> Lanes {
        at.along(row, moved) * sign
    }

    /// Derivative of an equation by the value: zero where there is none.
    #[inline(always)]
    fn by_value(_at: &At, _row: usize) -> Lanes {
        Lanes::ZERO
    }
}
