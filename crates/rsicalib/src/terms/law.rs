//! Terms of laws that users write.
//!
//! A law of nothing but its own channel is a term of a sensor like the compiled ones. A law that
//! couples joints, of geometry, or of a closure acts at the stage of loads: see [`Coupled`].

use std::sync::{Mutex, PoisonError};

use crate::Error;
use crate::mechanism::{Class, Formula, Law, Mechanism, Moves, Target, Variable};
use crate::numerics::formula::Program;
use crate::numerics::lanes::Lanes;
use crate::terms::coupled::Coupled;
use crate::terms::term::{Acts, Declared, Info, Needs, Parameter, Sensor, Site, Term};
use crate::text::word;

/// The terms of laws so far. Terms live as long as the program, so there is one for each law that
/// differs from all others, however often its mechanism is read.
static KNOWN: Mutex<Vec<(Law, &'static LawTerm)>> = Mutex::new(Vec::new());

/// The term of a law.
///
/// # Errors
///
/// [`Error::Mechanism`] for a formula that cannot be read.
pub fn term_of(law: &Law) -> Result<&'static dyn Term, Error> {
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, term)) = known.iter().find(|(its, _)| its == law) {
        return Ok(*term);
    }
    let term: &'static LawTerm = Box::leak(Box::new(LawTerm::new(law)?));
    known.push((law.clone(), term));
    Ok(term)
}

/// The law of a term of the catalogue that is one formula.
///
/// # Panics
///
/// For a formula that cannot be read: the tests of every term read its own.
pub(crate) fn of_catalogue(info: &Info, moves: Option<Moves>, text: &str) -> Coupled {
    let text = Some(text.to_string());
    let (correction, amount) = if moves.is_none() { (text, None) } else { (None, text) };
    let law = Law {
        id: info.id.into(),
        class: info.class,
        per: info.per,
        parameters: info.parameters.iter().map(|p| (p.name.into(), p.typical)).collect(),
        correction,
        moves,
        amount,
        doc: String::new(),
    };
    match law.formula() {
        Ok(formula) => Coupled::new(&law, formula),
        Err(error) => panic!("{error}"),
    }
}

/// A law as a term.
struct LawTerm {
    info: &'static Info,
    acts: Acts,
    variables: Vec<Variable>,
}

impl LawTerm {
    fn new(law: &Law) -> Result<Self, Error> {
        let formula = law.formula()?;
        let variables = formula.variables.clone();
        let needs = variables.iter().map(|v| needs(*v)).max_by_key(|needs| *needs as usize);
        let parameters = law.parameters.iter().enumerate().map(|(k, (name, typical))| Parameter {
            name: leaked(name),
            unit: leaked(&unit(law, &formula, k)),
            typical: *typical,
        });
        let info = Box::leak(Box::new(Info {
            id: leaked(&law.id),
            class: law.class,
            per: law.per,
            // What needs an order starts again in each session, whatever else it needs.
            needs: match variables.contains(&Variable::Time) {
                true => Needs::Order,
                false => needs.unwrap_or(Needs::Nothing),
            },
            parameters: Box::leak(parameters.collect()),
            doc: leaked(&doc(law)),
            penalised: false,
            broad: false,
            law: true,
        }));
        let alone = law.moves.is_none()
            && law.class != Class::Closure
            && !variables.iter().any(|v| v.couples());
        let acts = match alone {
            true => Acts::Sensor(Box::leak(Box::new(Alone::new(law, formula)))),
            false => Acts::Coupled(Box::leak(Box::new(Coupled::new(law, formula)))),
        };
        Ok(Self { info, acts, variables })
    }
}

fn leaked(text: &str) -> &'static str {
    Box::leak(text.to_string().into_boxed_str())
}

/// The description with the formula.
fn doc(law: &Law) -> String {
    let (key, text) = law.text();
    let moves = law.moves.map_or(String::new(), |m| format!("moves {}, ", word(&m)));
    format!("{}\n\n{moves}{key} = {text}", law.doc.trim())
}

/// Data that a variable needs.
fn needs(variable: Variable) -> Needs {
    match variable {
        Variable::Time => Needs::Order,
        Variable::Temperature => Needs::Temperature,
        Variable::Direction => Needs::Approach,
        Variable::Velocity => Needs::Motion,
        Variable::Travelled(_) | Variable::SinceTurn(_) | Variable::Play(..) => Needs::Way,
        Variable::Torque | Variable::TorqueOf(_) => Needs::Gravity,
        _ => Needs::Nothing,
    }
}

/// Unit of parameter `k`: of the correction, where that changes with the parameter by a number or
/// in proportion to one variable that has a unit.
fn unit(law: &Law, formula: &Formula, k: usize) -> String {
    let turns = matches!(law.moves, None | Some(Moves::Rx | Moves::Ry | Moves::Rz));
    let whole = if turns && law.class != Class::Closure { "rad" } else { "length" };
    let mut graph = formula.graph.clone();
    let slope = graph.derivative(formula.value, k);
    let first = law.parameters.len();
    let with_unit = |v: Variable| match v {
        Variable::Reading => Some("reading"),
        Variable::Temperature => Some("K"),
        Variable::Velocity => Some("(reading/s)"),
        Variable::Torque | Variable::TorqueOf(_) => Some("torque"),
        Variable::Reach | Variable::Length => Some("length"),
        Variable::Column(name) => Some(name),
        _ => None,
    };
    let inputs = graph.inputs(slope);
    let mut its = inputs.iter().filter_map(|input| {
        Some((*input, with_unit(formula.variables[input.checked_sub(first)?])?))
    });
    match (its.next(), its.next()) {
        (None, _) => whole.into(),
        (Some((input, unit)), None) => {
            let program = Program::new(&graph, &[slope]);
            let at = |factor: f64| {
                program.value(|k| {
                    Lanes::splat(0.3 + 0.1 * k as f64) * if k == input { factor } else { 1.0 }
                })
            };
            match (at(2.0).0[0] - 2.0 * at(1.0).0[0]).abs() <= 1e-12 * at(2.0).0[0].abs() {
                true => format!("{whole}/{unit}"),
                false => "unit of the law".into(),
            }
        }
        _ => "unit of the law".into(),
    }
}

impl Declared for LawTerm {
    fn info(&self) -> &'static Info {
        self.info
    }

    fn acts(&self) -> Acts {
        self.acts
    }
}

impl Term for LawTerm {
    fn needs(&self) -> Vec<Needs> {
        self.variables.iter().map(|v| needs(*v)).collect()
    }

    fn suits(&self, mechanism: &Mechanism, channel: usize) -> bool {
        if !self.knows_its_names(mechanism) {
            return false;
        }
        match mechanism.chain_of(channel) {
            Some(chain) => self.has_joints(mechanism, chain),
            None => self.variables.iter().all(|v| v.without_joint()),
        }
    }

    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        if !self.knows_its_names(mechanism) {
            return false;
        }
        let of_joint = self.variables.iter().any(|v| v.of_joint());
        match target {
            Target::Row(chain, row) => {
                let senses = mechanism.chains[chain].rows[row].channel.is_some();
                self.has_joints(mechanism, chain) && (senses || !of_joint)
            }
            Target::Chain(chain) => self.has_joints(mechanism, chain),
            _ => true,
        }
    }
}

impl LawTerm {
    /// True for a mechanism with all columns and channels that the law refers to.
    fn knows_its_names(&self, mechanism: &Mechanism) -> bool {
        self.variables.iter().all(|variable| match variable {
            Variable::Column(name) => mechanism.value_columns().iter().any(|own| own == name),
            Variable::TorqueOf(name) => {
                mechanism.channel_index(name).is_ok_and(|c| mechanism.moves_joint(c))
            }
            of => of.channel().is_none_or(|name| mechanism.channel_index(name).is_ok()),
        })
    }

    /// True for a chain with all joints that the law refers to.
    fn has_joints(&self, mechanism: &Mechanism, chain: usize) -> bool {
        let joints = mechanism.channels_of(chain).len();
        joints > 0 && self.variables.iter().all(|v| !matches!(v, Variable::Theta(k) if *k > joints))
    }
}

/// A law of nothing but its own channel.
struct Alone {
    variables: Vec<Variable>,
    value: Program,
    partials: Program,
    slope: Program,
}

impl Alone {
    fn new(law: &Law, formula: Formula) -> Self {
        let Formula { mut graph, value, variables } = formula;
        let width = law.parameters.len();
        let partials: Vec<usize> = (0..width).map(|k| graph.derivative(value, k)).collect();
        // By the reading: `u` and `phi` are proportional to it. What they are per reading differs
        // from channel to channel, so it enters as inputs after those of the formula.
        let mut slope = graph.constant(0.0);
        for (k, variable) in variables.iter().enumerate() {
            let factor = match variable {
                Variable::Reading => graph.constant(1.0),
                Variable::U => graph.input(width + variables.len()),
                Variable::Phi => graph.input(width + variables.len() + 1),
                _ => continue,
            };
            let own = graph.derivative(value, width + k);
            let own = graph.product(own, factor);
            slope = graph.sum(slope, own);
        }
        Self {
            value: Program::new(&graph, &[value]),
            partials: Program::new(&graph, &partials),
            slope: Program::new(&graph, &[slope]),
            variables,
        }
    }

    #[inline(always)]
    fn input(&self, p: &[f64], site: &Site, k: usize) -> Lanes {
        match k.checked_sub(p.len()) {
            None => Lanes::splat(p[k]),
            Some(k) if k < self.variables.len() => of_channel(self.variables[k], site),
            Some(k) if k == self.variables.len() => Lanes::splat(1.0 / site.scale().half_range),
            Some(_) => Lanes::splat(site.scale().gain),
        }
    }
}

/// A variable that a channel has without its chain.
#[inline(always)]
pub(crate) fn of_channel(variable: Variable, site: &Site) -> Lanes {
    match variable {
        Variable::Reading => site.reading(),
        Variable::U => site.u(),
        Variable::Phi => site.phi(),
        Variable::Time => site.time,
        Variable::Temperature => site.temperature,
        Variable::Direction => site.approach[site.channel],
        Variable::Velocity => site.velocity[site.channel],
        Variable::Theta(_) | Variable::Coordinate(_) | Variable::Column(_) => Lanes::ZERO,
        Variable::Travelled(_) | Variable::SinceTurn(_) | Variable::Play(..) => Lanes::ZERO,
        Variable::TorqueOf(_) => Lanes::ZERO,
        Variable::Torque | Variable::Reach | Variable::Length => Lanes::ZERO,
    }
}

impl Sensor for Alone {
    fn correction(&self, p: &[f64], site: &Site) -> Lanes {
        self.value.value(|k| self.input(p, site, k))
    }

    fn partials(&self, p: &[f64], site: &Site, out: &mut [Lanes]) {
        self.partials.run(|k| self.input(p, site, k), out);
    }

    fn slope(&self, p: &[f64], site: &Site) -> Lanes {
        self.slope.value(|k| self.input(p, site, k))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanism::Per;
    use crate::terms::laws;

    /// Laws of every class and of every variable: class, target, axis, formula.
    const LAWS: [(Class, Per, Option<Moves>, &str); 23] = [
        (Class::Sensor, Per::Channel, None, "a*sin(3*phi) + b*(cos(3*phi) - 1)"),
        (Class::Sensor, Per::Channel, None, "a*u^3 + b*reading*1e-4"),
        (Class::Sensor, Per::Channel, None, "a*temperature*u + b*t"),
        (Class::Sensor, Per::Channel, None, "a*direction*(1 + 0.2*u)"),
        (Class::Sensor, Per::Channel, None, "a*tanh(velocity)"),
        (Class::Sensor, Per::Channel, None, "a*sin(theta[1])*theta[2]"),
        (Class::Electronics, Per::All, None, "a*u*abs(u)"),
        (Class::Sensor, Per::Chain, None, "a*cos(theta[2])"),
        (Class::Load, Per::Channel, None, "a*torque*(1 + 0.3*u)"),
        (Class::Load, Per::All, None, "a*torque*reach"),
        (Class::Geometry, Per::Row, Some(Moves::Tx), "a*theta[2] + b*u"),
        (Class::Geometry, Per::Row, Some(Moves::Ry), "a*torque"),
        (Class::Geometry, Per::Chain, Some(Moves::Tz), "a*sin(theta[1]) + b*reach"),
        (Class::Closure, Per::Closure, None, "a*t"),
        (Class::Sensor, Per::Channel, None, "a*theta[q12]*(1 + 0.3*u)"),
        (Class::Geometry, Per::Row, Some(Moves::Rx), "a*bar*theta[q32] + b*u"),
        (Class::Closure, Per::Closure, None, "a*length + b*bar*t"),
        (Class::Closure, Per::All, None, "a*theta[q21]*length^2"),
        (Class::Sensor, Per::Channel, None, "a*(1 - exp(-travelled[q21]))*(1 + 0.3*u)"),
        (Class::Closure, Per::Closure, None, "a*since_turn[q12] + b*travelled[q21]"),
        (Class::Sensor, Per::Channel, None, "a*torque[q21]*(1 + 0.3*u)"),
        (Class::Sensor, Per::Channel, None, "a*play[q21, 0.05] + b*play[q21, 0.2]*u"),
        (Class::Geometry, Per::Chain, Some(Moves::Tz), "a*torque[q12]*torque + b*reach"),
    ];

    fn terms() -> impl Iterator<Item = &'static dyn Term> {
        LAWS.iter().enumerate().map(|(k, (class, per, moves, text))| {
            let text = Some((*text).to_string());
            let (correction, amount) = if moves.is_some() { (None, text) } else { (text, None) };
            let parameters = ["a", "b"].iter().filter(|p| LAWS[k].3.contains(&format!("{p}*")));
            let law = Law {
                id: format!("law_{k}"),
                class: *class,
                per: *per,
                correction,
                moves: *moves,
                amount,
                parameters: parameters.map(|p| ((*p).to_string(), 3e-3)).collect(),
                doc: String::new(),
            };
            term_of(&law).expect("a law")
        })
    }

    #[test]
    fn zero_parameters_change_nothing() {
        terms().for_each(laws::zero_parameters_change_nothing);
    }

    #[test]
    fn partials_match_differences() {
        terms().for_each(laws::partials_match_differences);
    }

    #[test]
    fn reading_derivatives_match_differences() {
        terms().for_each(laws::reading_derivatives_match_differences);
    }

    #[test]
    fn a_law_that_is_read_again_is_the_same_term() {
        let once: Vec<*const ()> = terms().map(|t| std::ptr::from_ref(t).cast()).collect();
        let again: Vec<*const ()> = terms().map(|t| std::ptr::from_ref(t).cast()).collect();
        assert_eq!(once, again);
    }

    #[test]
    fn a_parameter_has_the_unit_of_the_correction_over_that_of_its_factor() {
        let units: Vec<&str> = terms().map(|t| t.info().parameters[0].unit).collect();
        let expected = [
            "rad",
            "rad",
            "rad/K",
            "rad",
            "unit of the law",
            "rad",
            "rad",
            "rad",
            "rad/torque",
            "unit of the law",
            "length",
            "rad/torque",
            "length",
            "length",
            "rad",
            "rad/bar",
            "length/length",
            "unit of the law",
            "rad",
            "length",
            "rad/torque",
            "rad",
            "unit of the law",
        ];
        assert_eq!(units, expected);
    }
}
