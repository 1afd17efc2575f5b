//! Unknown frames that turn about the axes of the base.
//!
//! Roll and yaw turn a frame about the same axis where its pitch is a quarter turn: no step of `rx ry rz`
//! then turns it about the third. While a start is looked for, a step `s` of these is a rotation vector,
//!
//! ```text
//! R ← exp(s) R                                                            (170)
//! ```
//!
//! which has no such place.

use nalgebra::{Rotation3, Vector3};

use crate::model::compiled::Model;
use crate::model::ends::turn_axes;
use crate::model::thing::Thing;

impl Model {
    /// The same with steps (170); itself where no frame is unknown.
    pub(crate) fn turning(&self) -> Self {
        Self { turning: true, ..self.clone() }
    }

    /// The axes about which the derivatives by its turns have an unknown frame turn.
    #[inline(always)]
    pub(super) fn axes_of_turns(&self, rpy: &[f64]) -> [[f64; 3]; 3] {
        match self.turning {
            true => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            false => turn_axes(rpy),
        }
    }

    /// Parameters a step away.
    pub(crate) fn moved(&self, beta: &[f64], step: &[f64]) -> Vec<f64> {
        let mut there: Vec<f64> = beta.iter().zip(step).map(|(b, s)| b + s).collect();
        let is_frame = |thing: Thing| matches!(thing, Thing::Frame(_));
        for frame in self.unknowns.iter().filter(|u| self.turning && is_frame(u.thing)) {
            let own =
                self.term_parameters + frame.first + 3..self.term_parameters + frame.first + 6;
            let (rpy, by) = (&beta[own.clone()], Vector3::from_column_slice(&step[own.clone()]));
            let turned = Rotation3::new(by) * Rotation3::from_euler_angles(rpy[0], rpy[1], rpy[2]);
            let (rx, ry, rz) = turned.euler_angles();
            there[own].copy_from_slice(&[rx, ry, rz]);
        }
        there
    }
}
