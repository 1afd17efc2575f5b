//! Laws that couple joints, move frames, or change distances.

use crate::kinematics::elements::{Axis, Way};
use crate::mechanism::{Formula, Law, Moves, Variable};
use crate::numerics::formula::Program;
use crate::numerics::lanes::Lanes;

/// A law that acts at the stage of loads: of the coordinates of several joints, of geometry, or
/// of a closure.
pub struct Coupled {
    /// The axis that moves, of a law of geometry.
    pub moves: Option<(Axis, Way)>,
    /// The variables: inputs after the parameters.
    pub variables: Vec<Variable>,
    /// Number of parameters.
    pub width: usize,
    value: Program,
    /// The value, its derivatives by the parameters, then by the variables.
    whole: Program,
}

impl Coupled {
    /// The law of a formula.
    #[must_use]
    pub(crate) fn new(law: &Law, formula: Formula) -> Self {
        let Formula { mut graph, value, variables } = formula;
        let width = law.parameters.len();
        let slopes = (0..width + variables.len()).map(|k| graph.derivative(value, k));
        let all: Vec<usize> = std::iter::once(value).chain(slopes.collect::<Vec<_>>()).collect();
        let moves = law.moves.map(|moves| match moves {
            Moves::Tx => (Axis::X, Way::Slide),
            Moves::Ty => (Axis::Y, Way::Slide),
            Moves::Tz => (Axis::Z, Way::Slide),
            Moves::Rx => (Axis::X, Way::Turn),
            Moves::Ry => (Axis::Y, Way::Turn),
            Moves::Rz => (Axis::Z, Way::Turn),
        });
        let (whole, value) = (Program::new(&graph, &all), Program::new(&graph, &[value]));
        Self { moves, variables, width, value, whole }
    }

    /// The correction; `input` gives parameters, then variables.
    #[inline(always)]
    pub fn value(&self, input: impl Fn(usize) -> Lanes) -> Lanes {
        self.value.value(input)
    }

    /// The correction and its derivatives by parameters and variables: one more than there are.
    #[inline(always)]
    pub fn derivatives(&self, input: impl Fn(usize) -> Lanes, out: &mut [Lanes]) {
        self.whole.run(input, out);
    }

    /// The channels on whose torques the law depends: `own`, and those that it names.
    pub(crate) fn weighed(
        &self,
        own: Vec<usize>,
        index: impl Fn(&str) -> Option<usize>,
    ) -> Vec<usize> {
        let of = |variable: &Variable| match variable {
            Variable::Torque => own.clone(),
            Variable::TorqueOf(name) => index(name).into_iter().collect(),
            _ => Vec::new(),
        };
        self.variables.iter().flat_map(of).collect()
    }

    /// True where the law depends on a torque.
    #[must_use]
    pub fn weighs(&self) -> bool {
        self.variables.iter().any(|v| matches!(v, Variable::Torque | Variable::TorqueOf(_)))
    }
}
