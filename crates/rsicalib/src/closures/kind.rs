//! What a kind of closure is.

use crate::numerics::lanes::{Lanes, Vec3};

/// A closure at eight samples.
#[derive(Debug, Clone, Copy)]
pub struct At<'a> {
    /// From the second end to the first, in base coordinates.
    pub apart: Vec3,
    /// The value, with what terms add to it, in length units.
    pub value: Lanes,
    /// Directions along which the equations count; none: the three axes of the base.
    pub along: Option<&'a [[f64; 3]]>,
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
}

/// One kind of closure: its facts, and its equations for eight samples.
///
/// The equations are inlined into the kernel of the model, and so take no `self`.
pub trait Kind: Sync {
    /// Scalar equations of one sample.
    fn equations(&self) -> usize;

    /// True for a kind with a value, to which terms can add: a length.
    fn has_value(&self) -> bool;

    /// True for equations that are the components of one vector: they may be taken along any
    /// directions, and those left out that say nothing.
    fn is_vector(&self) -> bool {
        false
    }

    /// Change of an equation per change of a length, where the closure has this value.
    fn per_length(&self, value: f64) -> f64;

    /// How often a length is multiplied in an equation: 2 where it is an area.
    fn dimension(&self) -> i32 {
        1
    }

    /// What it holds, in words.
    fn words(&self) -> &'static str;

    /// Misclosure of an equation.
    fn misclosure(at: &At, row: usize) -> Lanes
    where
        Self: Sized;

    /// Change of an equation as the first end moves by `moved`; the second end counts with the
    /// opposite sign. `sign` multiplies it.
    fn by_end(at: &At, row: usize, moved: &Vec3, sign: f64) -> Lanes
    where
        Self: Sized;

    /// Derivative of an equation by the value.
    fn by_value(at: &At, row: usize) -> Lanes
    where
        Self: Sized;
}
