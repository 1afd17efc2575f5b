//! Terms: the physical effects that a model is made of.
//!
//! The paper's model is the list `[offset, gain]`; a trace adds terms to that list. Each term acts
//! at one of four stages. The term sees the state of that stage for one sample, and the context
//! of the sample, and adds its own correction. No term depends on another term:
//!
//! ```text
//! readings → electronics → sensor → geometry and load → closure
//! ```
//!
//! A term is one file in this folder and one line in the registry at the end of this file. The
//! parameters of a term are zero where the effect is absent.

use crate::Error;
use crate::error::index_of;
use crate::mechanism::Mechanism;
use crate::terms::term::Term;

#[macro_use]
pub mod term;
pub mod coupled;
mod follows;
pub mod law;
pub mod targets;

/// Lists the terms, and makes the tests of the laws that each must pass.
macro_rules! registry {
    ($($module:ident::$name:ident),* $(,)?) => {
        $(pub use $module::$name;)*

        /// Every term, in the order of the stages.
        pub static ALL: &[&dyn Term] = &[$(&$name),*];

        #[cfg(test)]
        mod contract {
            $(mod $module {
                use crate::terms::laws;
                const TERM: &dyn crate::terms::term::Term = &crate::terms::$name;

                #[test]
                fn is_named_after_its_module() {
                    assert_eq!(TERM.info().id, stringify!($module));
                    laws::says_what_it_is(TERM);
                }
                #[test]
                fn zero_parameters_change_nothing() {
                    laws::zero_parameters_change_nothing(TERM);
                }
                #[test]
                fn partials_match_differences() {
                    laws::partials_match_differences(TERM);
                }
                #[test]
                fn reading_derivatives_match_differences() {
                    laws::reading_derivatives_match_differences(TERM);
                }
                #[test]
                fn simulated_alone_it_is_found_again() {
                    laws::simulated_alone_it_is_found_again(TERM);
                }
            })*
        }
    };
}

/// The term with an id.
///
/// # Errors
///
/// [`Error::Unknown`] with the known ids.
pub fn find(id: &str) -> Result<&'static dyn Term, Error> {
    Ok(ALL[index_of(ALL, |term| term.info().id, "term", id)?])
}

/// Every term of a mechanism: the catalogue, then its own laws.
#[must_use]
pub fn all(mechanism: &Mechanism) -> Vec<&'static dyn Term> {
    // A law that cannot be read is refused where its mechanism is checked.
    let laws = mechanism.laws.iter().filter_map(|law| law::term_of(law).ok());
    ALL.iter().copied().chain(laws).collect()
}

/// The term of a mechanism with an id: of the catalogue, or one of its own laws.
///
/// # Errors
///
/// [`Error::Unknown`] with the known ids.
pub fn find_in(mechanism: &Mechanism, id: &str) -> Result<&'static dyn Term, Error> {
    if mechanism.laws.is_empty() {
        return find(id);
    }
    let all = all(mechanism);
    Ok(all[index_of(&all, |term| term.info().id, "term", id)?])
}

#[cfg(test)]
mod laws;

// One `mod` and one registry line per term; the `mod`s stand outside the macro
// because rustfmt does not look inside.
mod anchor_position;
mod attachment_position;
mod attachment_slip;
mod bad_reading;
mod base_bearing;
mod base_position;
mod base_slip;
mod base_tilt;
mod channel_skew;
mod counterbalance;
mod crosstalk;
mod cubic;
mod curvature;
mod distance;
mod distance_growth;
mod distance_slip;
mod drag;
mod drift;
mod frame_slip;
mod free_curve;
mod gain;
mod gear_play;
mod hysteresis;
mod instrument_scale;
mod joint_compliance;
mod joint_sag;
mod joint_tilt;
mod lag;
mod line_bend;
mod line_slip;
mod link_frame;
mod link_growth;
mod link_length;
mod link_offset;
mod link_side;
mod n_per_turn;
mod offset;
mod once_per_turn;
mod plane_bend;
mod plane_slip;
mod point_position;
mod point_slip;
mod ratio;
mod reference_drift;
mod reference_temperature;
mod reference_wander;
mod sag;
mod servo;
mod slip;
mod temperature_gain;
mod temperature_offset;
mod tool_slip;
mod twice_per_turn;
mod wander;
mod waves;
registry! {
    reference_drift::ReferenceDrift,
    reference_temperature::ReferenceTemperature,
    reference_wander::ReferenceWander,
    channel_skew::ChannelSkew,
    crosstalk::Crosstalk,
    lag::Lag,
    servo::Servo,
    bad_reading::BadReading,
    offset::Offset,
    gain::Gain,
    curvature::Curvature,
    cubic::Cubic,
    once_per_turn::OncePerTurn,
    twice_per_turn::TwicePerTurn,
    n_per_turn::NPerTurn,
    free_curve::FreeCurve,
    hysteresis::Hysteresis,
    drag::Drag,
    drift::Drift,
    wander::Wander,
    slip::Slip,
    temperature_offset::TemperatureOffset,
    temperature_gain::TemperatureGain,
    link_length::LinkLength,
    link_growth::LinkGrowth,
    link_offset::LinkOffset,
    link_side::LinkSide,
    joint_tilt::JointTilt,
    link_frame::LinkFrame,
    ratio::Ratio,
    base_position::BasePosition,
    base_tilt::BaseTilt,
    base_bearing::BaseBearing,
    base_slip::BaseSlip,
    point_position::PointPosition,
    tool_slip::ToolSlip,
    sag::Sag,
    joint_sag::JointSag,
    joint_compliance::JointCompliance,
    counterbalance::Counterbalance,
    gear_play::GearPlay,
    distance::Distance,
    distance_growth::DistanceGrowth,
    distance_slip::DistanceSlip,
    plane_bend::PlaneBend,
    plane_slip::PlaneSlip,
    line_bend::LineBend,
    line_slip::LineSlip,
    anchor_position::AnchorPosition,
    attachment_position::AttachmentPosition,
    attachment_slip::AttachmentSlip,
    point_slip::PointSlip,
    frame_slip::FrameSlip,
    instrument_scale::InstrumentScale,
}
