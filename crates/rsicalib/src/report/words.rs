//! Causes in words: the one place where what the core found becomes sentences.

use crate::apply::misread::Misread;
use crate::diagnosis::doubt::{Doubt, Doubted};
use crate::diagnosis::localisation::{Residual, Share, Structure};
use crate::diagnosis::location::Location;
use crate::diagnosis::options::LEVEL;
use crate::diagnosis::plausibility::Absurdity;
use crate::diagnosis::search::rivals::Explanation;
use crate::diagnosis::unknown_law::UnknownLaw;
use crate::diagnosis::unknown_law::formula::Written;
use crate::diagnosis::unknown_law::variables::Quantity;
use crate::estimate::degrees::degrees_in;
use crate::estimate::directions::{Direction, Directions, Moves};
use crate::estimate::noise::source::{NoiseEstimate, Source};
use crate::estimate::significance::NORMAL_95;
use crate::estimate::suspicion::{Closes, InDegrees, Measure, Scaled, Shown, Suspicion, Witness};
use crate::estimate::tried::{Gains, Origin};
use crate::estimate::{AnchorKind, Fit, Observations};
use crate::mechanism::{Closure, Law, Mechanism, Plane, Target, Value};
use crate::model::Instance;
use crate::model::known::Declared;
use crate::monitor::closing::OpenLoops;
use crate::numerics::lm::Termination;
use crate::readings::Readings;
use crate::screening::blame::Blame;
use crate::screening::excluded::Cause;
use crate::screening::fault::FaultKind;
use crate::text::{in_toml, significant, word};

/// Where the noise is from.
#[must_use]
pub fn noise(estimate: &NoiseEstimate) -> String {
    let source = self::source(estimate.source);
    let apart = if estimate.apart > 0 { ", by channel" } else { "" };
    match estimate.largest_seating() {
        Some(seating) => {
            format!("{source}{apart}; seatings {}, of the fit itself", significant(seating, 3))
        }
        None => format!("{source}{apart}"),
    }
}

/// A source of the noise in words.
fn source(source: Source) -> &'static str {
    match source {
        Source::Declared => "declared",
        Source::Presumed => "presumed: play alone is declared",
        Source::Repeats => "misclosure of repeats",
        Source::Neighbours => "misclosure of neighbouring rows",
        Source::Quantisation => "quantisation",
        Source::Fit => "the fit itself",
    }
}

/// Why a search of the solver ended, and what to do next.
#[must_use]
pub fn termination(termination: Termination) -> &'static str {
    match termination {
        Termination::Gradient => "converged: the gradient vanishes",
        Termination::Step => "converged: the parameters stand still",
        Termination::Cost => "converged: the cost no longer decreases",
        Termination::Stalled => "converged to rounding: no step decreases the cost",
        Termination::MaxIterations => {
            "the iterations ran out: start nearer, or record poses that determine more"
        }
        Termination::NotFinite => "the residual is not a number at the start: check the start",
    }
}

/// Where a start began.
#[must_use]
pub fn origin(origin: Origin) -> String {
    let anchor = |kind| match kind {
        AnchorKind::Rest => "rest",
        AnchorKind::Nominal => "nominal",
        AnchorKind::NominalOffsets => "nominal offsets",
        AnchorKind::RestAtHalfRange => "rest at half range",
    };
    match origin {
        Origin::Anchor(kind) => anchor(kind).into(),
        Origin::Tied(kind, Gains::Times(factor)) => {
            format!("{}, offsets tied, gains × {factor}", anchor(kind))
        }
        Origin::Tied(kind, Gains::Scattered(n)) => {
            format!("{}, offsets tied, gains scattered #{n}", anchor(kind))
        }
    }
}

/// Offsets that stay as drawn, by the fit with them and the one with what was found.
#[must_use]
pub fn as_drawn(names: &[String], fits: [&Fit; 2]) -> String {
    let [free, drawn] =
        fits.map(|f| format!("χ² {:.4} for {:.0} degrees of freedom", f.chi2, f.dof));
    format!(
        "offsets of {} stay as drawn: what was found explains the readings as well without them \
         ({drawn}) as they do ({free}), and offsets that take up an error of a surface put the arm \
         elsewhere. Known points decide (--check), or a surface that is known to be flat",
        names.join(", "),
    )
}

/// Rows that are left out, since a delay puts them beyond an end of the recording.
#[must_use]
pub fn unread(rows: usize) -> String {
    let (are, them) = if rows == 1 { ("row is", "it") } else { ("rows are", "them") };
    format!(
        "{rows} {are} left out: with the delay that was found, what belongs to {them} is beyond an end \
         of the recording, or in a pause of it"
    )
}

/// That the loops of some readings do not close under a result as in its own session. `edited`: whether its
/// numbers were edited, where that is known.
#[must_use]
pub fn open_loops(
    mechanism: &Mechanism,
    source: &str,
    found: &OpenLoops,
    edited: Option<bool>,
) -> String {
    let OpenLoops { rms_misclosure, own, .. } = found;
    let length = |v: f64| format!("{} {}", significant(v, 2), mechanism.length_unit);
    let as_own = own.map(|own| format!(", in the session of the result it was {}", length(own)));
    let others = match edited {
        Some(false) => " or they are of another device",
        _ => ", they are of another device, or the result's numbers were edited",
    };
    let away = match mechanism.may_leave() {
        true => ", unless the arm was away from what it was held at",
        false => "",
    };
    format!(
        "the loops of {source} do not close under this result: misclosure {}{}. Something has changed \
         since{others}{away}: identify again with --calibration, which says what has changed",
        length(*rms_misclosure),
        as_own.unwrap_or_default(),
    )
}

/// That loops close too well for a result without a digest.
#[must_use]
pub fn quieter_loops(source: &str) -> String {
    format!(
        "loops of {source} close better than the noise of this result lets them, and it has no `digest` that says \
         whether its noise is as it was written: poses come from it, too. The noise was edited, or these readings are \
         means of many: identify again"
    )
}

/// That no clock tells when known poses were read, and what follows.
#[must_use]
pub fn clocks() -> String {
    "column time_s of the check poses: it begins anew, or that of a session does, so these poses count as \
     taken after the last session; give all files one clock, or dates"
        .into()
}

/// How known poses were misread, and what to do.
#[must_use]
pub fn misread(misread: Misread, length_unit: &str) -> String {
    match misread {
        Misread::Degrees => "known poses look like degrees: with rx, ry and rz taken for degrees \
                             they are where the calibration puts them; known angles are in radians"
            .into(),
        Misread::Lengths(times) => format!(
            "known positions are {} times those where the calibration puts them: known poses are in \
             the unit of the mechanism, {length_unit}",
            significant(times, 4),
        ),
        Misread::Moved => "known poses are of an instrument that stands elsewhere: moved rigidly, all of \
                           them together, they are where the calibration puts them; give --align (align)"
            .into(),
        Misread::Order => {
            "known poses are in another order than their readings: each is where the \
                           calibration puts another one; readings and pose stand in one row"
                .into()
        }
    }
}

/// What looks wrong with the wiring, and what to do.
#[must_use]
pub fn suspicion(mechanism: &Mechanism, suspicion: &Suspicion) -> String {
    let name = |c: usize| mechanism.channels[c].name.as_str();
    let pairs = |of: &[[usize; 2]]| {
        let two = of.iter().map(|[a, b]| format!("{} and {}", name(*a), name(*b)));
        two.collect::<Vec<_>>().join(", or ")
    };
    match suspicion {
        Suspicion::Reversed { channels, closes } => {
            let names: Vec<&str> = channels.iter().map(|&c| name(c)).collect();
            let several = names.len() > 1;
            let (verb, gains) =
                if several { ("read", "their gains") } else { ("reads", "its gain") };
            format!(
                "{} {verb} the wrong way round: with {gains} reversed {}; reverse {gains} in the \
                 mechanism, or turn the sensor round (a potentiometer: exchange its outer wires)",
                names.join(", "),
                loop_closes(*closes),
            )
        }
        Suspicion::EitherReversed { channels, closes } => {
            let names: Vec<&str> = channels.iter().map(|&c| name(c)).collect();
            format!(
                "{} reads the wrong way round, and the readings do not say which: with the gain of either reversed \
                 {}, and one is the machine in a mirror; see which one counts against its joint, and reverse its gain \
                 in the mechanism, or turn the sensor round (a potentiometer: exchange its outer wires)",
                names.join(" or "),
                loop_closes(*closes),
            )
        }
        Suspicion::Zeros { channels, closes } => {
            let names: Vec<&str> = channels.iter().map(|&c| name(c)).collect();
            let (zeros, are) =
                if names.len() > 1 { ("the zeros", "are") } else { ("the zero", "is") };
            format!(
                "or {zeros} of {} {are} far from where the mechanism has {}: with readings as they are and offsets \
                 that far from what is declared {}, too; move one joint at a time, see whether each counts as drawn, and \
                 declare its offset",
                names.join(", "),
                if names.len() > 1 { "them" } else { "it" },
                loop_closes(*closes),
            )
        }
        Suspicion::Exchanged { channels, closes, late } => {
            let follow = channels.iter().flatten().all(|c| mechanism.leader_of(*c).is_some());
            format!(
                "{}{} look exchanged: with their readings swapped{} {}; check the wiring, or the \
             names of the columns",
                pairs(channels),
                if follow { ", or their leaders," } else { "" },
                if *late { ", beside a delay of all followers," } else { "" },
                loop_closes(*closes)
            )
        }
        Suspicion::Unlike { channels, off, with } => {
            let unit = &mechanism.length_unit;
            let [off, with] = [off, with].map(|rms| significant(*rms, 2));
            format!(
                "{} look exchanged: the loops close with any names, but the anchors that are found are \
                 not shaped as drawn. Distances between them differ from the drawing by {off} {unit} rms, \
                 and by {with} {unit} with two of them exchanged; check the wiring, the names of the \
                 columns, or the places of the points",
                pairs(channels)
            )
        }
        Suspicion::Gap { channel, shown, rows, of, closes } => {
            let shown = match shown {
                Shown::AtEnd => "reads an end of its range".into(),
                Shown::Jump { below, above } => {
                    format!("jumps between {below:.0} and {above:.0} with nothing in between")
                }
            };
            format!(
                "{} {shown}: without such rows ({rows} of {of} looked at) {}; the gap of its track \
                 lies within the range of motion, turn it on its shaft",
                name(*channel),
                loop_closes(*closes)
            )
        }
        Suspicion::Stuck { channel, reads, first, rows, of, poses, closes } => {
            let place = match poses {
                Some([from, to]) => format!("poses {from} to {to}"),
                None => format!("rows {} to {}", first + 1, first + rows),
            };
            format!(
                "{} is stuck: it reads {} in {rows} of {of} rows ({place}) while others move, and without \
                 them {}; check its sensor and its wire, and leave these rows out",
                name(*channel),
                significant(*reads, 6),
                loop_closes(*closes)
            )
        }
        Suspicion::SameReadings { poses, of } => format!(
            "{poses} of {of} poses have the same readings as others, digit by digit: given twice, \
             they count once{}",
            if 2 * poses > *of {
                format!(", and {} differ; record other poses", of - poses)
            } else {
                String::new()
            }
        ),
        Suspicion::Follow { closures } => {
            let names: Vec<&str> =
                closures.iter().map(|&k| mechanism.closures[k].name.as_str()).collect();
            format!(
                "{} follow{} from the other closures in every pose: {} not used, and an error \
                 there does not show",
                names.join(", "),
                if names.len() == 1 { "s" } else { "" },
                if names.len() == 1 { "it is" } else { "they are" },
            )
        }
        Suspicion::Unused { closures } => {
            let ends = |k: &usize| {
                let Closure { name, between: [one, other], .. } = &mechanism.closures[*k];
                format!(
                    "the distance of {name} is not used: no readings touch both {one} and {other}"
                )
            };
            let each: Vec<String> = closures.iter().map(ends).collect();
            format!("{}. Is a label written otherwise in the readings?", each.join("; "))
        }
        Suspicion::Knowledge { of, off, sd } => knowledge(mechanism, *of, *off, *sd),
        Suspicion::Mirrored { point, name, at, image } => {
            let unit = &mechanism.length_unit;
            let [here, there] = [at, image].map(|at| at.map(|v| format!("{v:.4}")).join(", "));
            let free = mechanism.points[*point].frees();
            let free: Vec<&str> = (["x", "y", "z"].into_iter().zip(free))
                .filter_map(|(a, f)| f.then_some(a))
                .collect();
            let alike = match free[..] {
                [one] => format!("have one {one}"),
                [_, _] => "lie on one line".into(),
                _ => "lie on one plane".into(),
            };
            let which = match mechanism.points[*point].at {
                Some(_) => {
                    "The one nearer to `at` of the mechanism is given; check that it is the right \
                     one, or record a place elsewhere"
                }
                None => {
                    "Nothing says which is right: give `at` in the mechanism, or record a place \
                     elsewhere"
                }
            };
            format!(
                "{name} at ({there}) {unit} fits as well as at ({here}): all places from which its \
                 distance is read {alike}. {which}"
            )
        }
        Suspicion::Degrees { channels, of } => {
            let names: Vec<&str> = channels.iter().map(|&c| name(c)).collect();
            match gains_in_degrees(mechanism, channels) {
                Some(text) if of.is_of_readings() => text,
                _ => in_degrees(&names.join(", "), *of),
            }
        }
        Suspicion::Gains { channels, times } => {
            let names: Vec<&str> = channels.iter().map(|&c| name(c)).collect();
            format!(
                "gains of {} are all some {} times what is declared: are readings of another \
                 converter (10 bits where 12 are declared make it 4), or in another unit?",
                names.join(", "),
                significant(*times, 3),
            )
        }
        Suspicion::MeasuredInUnit { channels, times } => {
            let names: Vec<&str> = channels.iter().map(|&c| name(c)).collect();
            format!(
                "no loop closes, and readings of {} times {} would be about as long as the drawing and the other \
                 readings are: are they in another unit than {}?",
                names.join(", "),
                significant(*times, 4),
                mechanism.length_unit
            )
        }
        Suspicion::Length { at, size, times, closes } => {
            let (target, what) = length(mechanism, *at);
            let (size, unit) = (significant(*size, 4), &mechanism.length_unit);
            format!(
                "{what} of {target} is {size} {unit}, and with {} times that {}: is it in another \
                 unit than the other lengths?",
                significant(*times, 4),
                loop_closes(*closes)
            )
        }
        Suspicion::LeftHanded { point, closes } => {
            let point = &mechanism.points[*point];
            format!(
                "{} of {} are left-handed: with one of them reversed {}; are two of them exchanged, \
                 or has one the other sign?",
                point.columns.as_ref().map_or(String::new(), |columns| columns.join(", ")),
                point.name,
                loop_closes(*closes)
            )
        }
        Suspicion::SeenInUnit { point, times, closes } => {
            let point = &mechanism.points[*point];
            format!(
                "{} of {} are declared in {}, and with {} times these {}: are they in another unit?",
                point.columns.as_ref().map_or(String::new(), |columns| columns.join(", ")),
                point.name,
                mechanism.length_unit,
                significant(*times, 4),
                loop_closes(*closes)
            )
        }
        Suspicion::Shifted { columns, later, closes } => format!(
            "{} look like those of the pose {} each: shifted by one pose {}; see which rows belong together, and where \
             one was lost or came late",
            columns.join(", "),
            if *later { "before" } else { "after" },
            loop_closes(*closes),
        ),
        Suspicion::Coarse { channel, step, share } => format!(
            "{} reads in steps of {} {}: rounding, step/√12, is {:.0} % of the variance of its noise",
            name(*channel),
            if step.fract() == 0.0 { step.to_string() } else { significant(*step, 4) },
            mechanism.channels[*channel].unit,
            100.0 * share
        ),
        Suspicion::Noise { by, factor, play } => declared_noise(*by, *factor, *play),
        Suspicion::Play { closures, factor } => declared_play(mechanism, closures, *factor),
        Suspicion::LengthNoise { closure, by, declared, factor } => format!(
            "{} declares noise = {} {}: {} show {} times as much, which is used",
            mechanism.closures[*closure].name,
            significant(*declared, 3),
            mechanism.length_unit,
            shown_by(*by),
            significant(*factor, 3)
        ),
        Suspicion::NoStart { tried } => format!(
            "none of {tried} starts led to a fit in which every joint moves: check the wiring, the \
             rest reading and the nominal gains, or record poses that differ more"
        ),
        Suspicion::Lost { name, open } => format!(
            "frame {name} was not found: loops are open by {} {} where the fit ended. Give `pose` of the frame, \
             where it is to within half a radian, or more closures that tell the poses without it",
            significant(*open, 3),
            mechanism.length_unit
        ),
    }
}

/// Of what a length of a drawing is, and what it is there.
pub(crate) fn length(mechanism: &Mechanism, at: Measure) -> (String, String) {
    let row = |chain: usize, row: usize| {
        let name = &mechanism.chains[chain].name;
        format!("{name}/{}", row + 1)
    };
    let axes = ["x", "y", "z"];
    match at {
        Measure::A { chain, row: k } => (row(chain, k), "a".into()),
        Measure::D { chain, row: k } => (row(chain, k), "d".into()),
        Measure::Along { chain, row: k, axis } => (row(chain, k), axes[axis].into()),
        Measure::At { point, axis } => (mechanism.points[point].name.clone(), axes[axis].into()),
        Measure::Distance { closure } => {
            (mechanism.closures[closure].name.clone(), "the distance".into())
        }
    }
}

/// That gains are declared as degrees in a radian, or the other way round; none where they are not.
fn gains_in_degrees(mechanism: &Mechanism, channels: &[usize]) -> Option<String> {
    let written = |c: &usize| {
        let channel = &mechanism.channels[*c];
        let gain = channel.gain.abs();
        if channel.is_in_degrees() { gain.to_degrees() } else { gain }
    };
    let mixed = channels.iter().all(|c| degrees_in(written(c)).is_some());
    let names: Vec<&str> = channels.iter().map(|&c| mechanism.channels[c].name.as_str()).collect();
    mixed.then(|| {
        format!(
            "gains of {} are declared as {}, degrees in a radian or the other way round: a sensor \
             that reads its joint has gain = 1.0, with unit = \"rad\" and with unit = \"deg\"",
            names.join(", "),
            significant(written(&channels[0]), 4),
        )
    })
}

/// A known plane whose offset is no distance, as its normal has another length than 1; none of another.
pub(super) fn long_normal(plane: &Plane, unit: &str) -> Option<String> {
    let long = plane.scales_offset()?;
    let offset = plane.offset?;
    let [long, offset, at, other] =
        [long, offset, offset / long, offset * long].map(|v| significant(v, 6));
    Some(format!(
        "plane {}: its normal has length {long}, and normal · p = offset puts it at {at} {unit} from the \
         origin of the base; if {offset} {unit} is meant, give a normal of length 1, or offset = {other}",
        plane.name,
    ))
}

/// What is off by the degrees in a radian.
fn in_degrees(names: &str, of: InDegrees) -> String {
    match of {
        InDegrees::Readings => format!(
            "readings of {names} span more than their joints can move in radians, and not in \
             degrees: if they are degrees, declare unit = \"deg\" in the mechanism"
        ),
        InDegrees::Loop { what: Scaled::Readings, times, closes } => format!(
            "{names}: with readings times {times:.3} {}; they are in {}, and the mechanism declares \
             the other unit",
            loop_closes(closes),
            if times > 1.0 { "radians" } else { "degrees" },
        ),
        InDegrees::Loop { what: Scaled::Offsets, times, closes } => format!(
            "{names}: with the declared offsets times {times:.3} {}; an offset is in degrees for a \
             channel with unit = \"deg\", else in radians",
            loop_closes(closes),
        ),
        InDegrees::LimitsInRadians => format!(
            "readings of {names} span more than the limits allow, and would not if the limits were \
             in radians: all keys of a channel with unit = \"deg\" are in degrees, its limits, too"
        ),
        InDegrees::LimitsInDegrees => format!(
            "limits of {names} are whole numbers and more than a turn in radians, as if they were \
             meant in degrees: limits are in radians, unless a channel has unit = \"deg\""
        ),
        InDegrees::Gain => format!(
            "gains of {names} are 57.3 times what is declared, or the other way round: one of \
             reading and joint is in degrees, and is declared in radians"
        ),
        InDegrees::Offset => format!(
            "offsets of {names} are 57.3 times what is declared, or the other way round: an offset \
             is in degrees for a channel with unit = \"deg\", else in radians"
        ),
    }
}

/// What shows a noise, in the plural.
fn shown_by(by: Witness) -> &'static str {
    match by {
        Witness::Repeats => "repeats",
        Witness::Neighbours => "neighbouring rows",
        Witness::Fit => "residuals",
    }
}

/// Declared noise that is not what the readings show.
fn declared_noise(by: Witness, factor: f64, play: bool) -> String {
    let (what, is) = if play { ("noise and play", "are") } else { ("noise", "is") };
    let size = if factor < 1.0 { "large" } else { "small" };
    let unit = match degrees_in(factor) {
        Some(_) => ": is one of them in degrees, and the other in radians?",
        None => "",
    };
    let (smaller, factor) = (factor < 1.0, significant(factor, 3));
    let words = match by {
        Witness::Repeats | Witness::Neighbours => format!(
            "the declared {what} {is} too {size}: {} show {factor} times as much, which is used",
            shown_by(by)
        ),
        Witness::Fit if smaller => format!(
            "the declared {what} {is} too large: the residual is smaller than chance allows, and \
             {factor} times as much would fit"
        ),
        Witness::Fit => format!(
            "the residual is larger than the declared {what} allows: something is left, or the \
             declared {what} {is} too small, and {factor} times as much would fit"
        ),
    };
    words + unit
}

/// What is declared as known, and the readings have elsewhere.
fn knowledge(mechanism: &Mechanism, of: Declared, off: f64, sd: f64) -> String {
    let times = significant((off / sd).abs(), 2);
    match of {
        Declared::Distance(closure) => {
            let Closure { name, value, sd: declared, noise, .. } = &mechanism.closures[closure];
            let by = match declared.or(*noise) {
                Some(_) => "its declared standard deviation",
                None => "a thousandth of it, which is taken where no `sd` is declared",
            };
            let unit = &mechanism.length_unit;
            let said = match value {
                Some(Value::Known(value)) => format!(
                    "is declared as {} {unit}, and the readings have {} {unit}: they differ by",
                    significant(*value, 6),
                    significant(value + off, 6)
                ),
                _ => format!("is {} {unit} off what its column says: that is", significant(off, 3)),
            };
            format!(
                "the distance of {name} {said} {times} times {by}. Measure it again, or declare its `sd`"
            )
        }
        Declared::Term(instance) => {
            let (term, target) = (instance.term.info().id, instance.target.name(mechanism));
            format!(
                "{term} of {target} is {times} times as far from what is drawn as its declared sd of {} \
                 lets expect: that sd is too small, or the drawing is of another device",
                significant(sd, 3)
            )
        }
    }
}

/// Declared play of which less is left.
fn declared_play(mechanism: &Mechanism, closures: &[usize], factor: f64) -> String {
    let would_fit = |&closure: &usize| {
        let Closure { name, noise, .. } = &mechanism.closures[closure];
        let noise = significant(noise.unwrap_or_default() * factor, 2);
        format!("noise = {noise} of {name}")
    };
    let times = significant(factor, 2);
    format!(
        "the declared play is too large: the residual is smaller than chance allows, and {times} \
         times as much would fit ({})",
        closures.iter().map(would_fit).collect::<Vec<_>>().join(", ")
    )
}

fn loop_closes(Closes { with, declared }: Closes) -> String {
    if declared.is_finite() {
        format!("the loop closes (χ² per equation {with:.1}, as declared {declared:.0})")
    } else {
        format!("the loop closes (χ² per equation {with:.1}; as declared, no start does)")
    }
}

/// Whose reading is wrong.
#[must_use]
pub fn blame(mechanism: &Mechanism, blame: &Blame) -> String {
    let name = |c: usize| &mechanism.channels[c].name;
    if let Some(channel) = blame.channel {
        return format!("channel {} reads wrong", name(channel));
    }
    if blame.likely.is_empty() {
        return "a channel reads wrong; these equations cannot tell which".into();
    }
    let likely = blame.likely.iter().map(|&(c, p)| format!("{} ({:.0} %)", name(c), 100.0 * p));
    let likely: Vec<String> = likely.collect();
    format!("one channel reads wrong, and these equations hardly tell which: {}", likely.join(", "))
}

/// A fault of a converter, without the name of its channel.
#[must_use]
pub fn fault(kind: &FaultKind) -> String {
    match kind {
        FaultKind::StuckBits(bits) => {
            let one = |(bit, high): &(u32, bool)| {
                format!("bit {bit} (worth {}) is always {}", 1_u64 << bit, u8::from(*high))
            };
            let listed: Vec<String> = bits.iter().map(one).collect();
            format!("{}, while higher bits change", listed.join(", "))
        }
        FaultKind::Clipped { at, poses } => {
            format!("{} poses read exactly {at}, and none beyond: clipped", poses.len())
        }
    }
}

/// A sample that touches something else than what its row names.
#[must_use]
pub fn touches(named: &str) -> String {
    format!("; it touches {named}, by its joints: see whether its label is right")
}

/// A probability as people write one; what no double tells from zero is less than the smallest that is written.
fn probability(p: f64) -> String {
    if p < 1e-99 { "p < 1e-99".into() } else { format!("p = {p:.1e}") }
}

/// Why readings were left out; rows of a session of `held` poses are named by their pose.
#[must_use]
pub fn cause(mechanism: &Mechanism, cause: &Cause, samples: usize, held: bool) -> String {
    let unit = &mechanism.length_unit;
    match cause {
        Cause::StuckBits { kind, error } => {
            format!("{}; {error:.1} counts of error taken into its noise", fault(kind))
        }
        Cause::Clipped { kind, whole } => {
            format!("{}{}", fault(kind), if *whole { "; left out" } else { "" })
        }
        Cause::Outlier { sigmas, blame: by } => {
            format!("{sigmas:.0} σ off the other samples of its pose: {}", blame(mechanism, by))
        }
        Cause::Unsteady { times } => {
            format!(
                "it moved while it was sampled: its samples differ {times:.1} times as much as \
                 those of the other poses"
            )
        }
        Cause::Reading(by) => blame(mechanism, by),
        Cause::Pose { p_value } => format!(
            "no single channel explains it ({}): several readings are wrong, or {}",
            probability(*p_value),
            if samples > 1 { "it moved while sampled" } else { "something stood elsewhere" },
        ),
        Cause::Placement { times } => format!(
            "the placement does not fit its siblings: its residual is {times:.1} times theirs; \
             {samples} samples left out"
        ),
        Cause::Moved { tool, by, between: [before, after] } => format!(
            "{} moved by {} {unit}, or a sensor slipped, {}: left out from there on, {samples} \
             samples",
            if *tool { "its tool" } else { "the point it touches" },
            significant(*by, 3),
            match held {
                true => "before this pose".into(),
                false => format!("between its samples {before} and {after} (counted from 0)"),
            },
        ),
        Cause::Sample { number, off, sigmas } => {
            let which = match held {
                true => "it".into(),
                false => format!("sample {number} of its run (counted from 0)"),
            };
            format!("{which} stands {} {unit} off, {sigmas:.1} σ", significant(*off, 3))
        }
    }
}

/// A direction that the data cannot, or hardly, tell.
#[must_use]
pub fn direction(direction: &Direction) -> String {
    let together = |moves: &[Moves]| {
        let one = |m: &Moves| {
            let by = match m.by.abs() {
                0.01..1e4 => format!("{:+.3}", m.by),
                _ => format!("{:+.2e}", m.by),
            };
            match m.label.unit.as_str() {
                "1" => format!("{by} {}", m.label.name),
                unit => format!("{by} {unit} {}", m.label.name),
            }
        };
        moves.iter().map(one).collect::<Vec<_>>().join(", ")
    };
    match direction {
        Direction::Absent(label) => format!("{}: the readings do not depend on it", label.name),
        Direction::Together(moves) => format!("together: {}", together(moves)),
        Direction::Weak { moves, off } => {
            let label = &moves[0].label;
            format!(
                "{}: {} may be off by {} {} (2 sd) and the rest with it",
                together(moves),
                label.name,
                significant(*off, 3),
                label.unit
            )
        }
    }
}

/// What the data cannot tell: what other poses could, then what no reading could, then what play alone tells.
#[must_use]
pub fn directions(directions: &Directions) -> Vec<String> {
    let held = |one: &Direction| match one {
        Direction::Absent(label) => label.name.clone(),
        Direction::Together(moves) | Direction::Weak { moves, .. } => moves[0].label.name.clone(),
    };
    let convention = |one: &Direction| {
        format!("{}; no reading can tell: {} stays as drawn", direction(one), held(one))
    };
    let turn = |one: &Direction| {
        format!(
            "{}; places on one line or at one point do not tell it: {} is where the play at them puts it",
            direction(one),
            held(one)
        )
    };
    let open = directions.unobservable.iter().map(direction);
    let conventions = directions.conventions.iter().map(convention);
    open.chain(conventions).chain(directions.turns.iter().map(turn)).collect()
}

/// What could not be looked for, where rows do not tell their order.
#[must_use]
pub fn not_looked_for(readings: &Readings) -> Option<String> {
    (!readings.ordered).then(|| {
        "What happened once, as the slip of a sensor, was not looked for: rows of each place in one \
         piece do not tell the order in which they were recorded. A column `time_s` does"
            .to_owned()
    })
}

/// What is left of the residual: the target, where there is one, and a sentence.
#[must_use]
pub fn residual(mechanism: &Mechanism, residual: &Residual) -> (Option<String>, String) {
    match residual {
        Residual::Noise { nearest: None } => (None, "nothing left above the noise".into()),
        Residual::Noise { nearest: Some((instance, p)) } => {
            let nearest = of(mechanism, instance);
            let text = match *p <= LEVEL {
                true => format!(
                    "no more left than the noise that is declared, but a part of it is no chance: \
                     nearest to it is {nearest} ({}). Record poses again at other \
                     times, which shows what of it is noise",
                    probability(*p)
                ),
                false => format!(
                    "nothing left above the noise; nearest to it is {nearest}, as chance \
                     makes one with p = {p:.2}"
                ),
            };
            (None, text)
        }
        Residual::Unjudged { nothing_left, seatings } => {
            let text = match (nothing_left, seatings) {
                (true, _) => "nothing is left to check the parameters with: record other poses",
                (false, true) => {
                    "lack of fit cannot be judged, since the fit alone says how well things touch: declare \
                     the noise of those closures, or touch the same place anew in the same posture"
                }
                (false, false) => {
                    "lack of fit cannot be judged: record each pose several times, or declare \
                     the noise"
                }
            };
            (None, text.into())
        }
        Residual::Doubtful(doubted) => {
            let (target, text) = self::doubted(mechanism, doubted);
            (Some(target), format!("nothing left above the noise, but {text}"))
        }
        Residual::UnknownLaw(law) => {
            let text = match law.replaces.is_empty() {
                true => "no more left than the noise, but a part of it is no chance",
                false => {
                    "nothing left above the noise, but what was found may stand for a law that no \
                     term has"
                }
            };
            (Some(law.whose.target.name(mechanism)), text.into())
        }
        Residual::Follows(law) => {
            let text = "structure is left that no effect of the catalogue explains";
            (Some(law.whose.target.name(mechanism)), text.into())
        }
        Residual::Isolated { target, location: at, p_value } => {
            let name = target.name(mechanism);
            let next = match target {
                Target::Closure(_) => {
                    "Look for play or bending there, and record more poses.".to_owned()
                }
                _ => range_sentence(&name),
            };
            let text = format!(
                "errors of {name} alone explain what is left{}: without it all else closes within \
                 its noise (p = {p_value:.2}). But no effect of the catalogue has their law. {next}",
                in_brackets(mechanism, at)
            );
            (Some(name), text)
        }
        Residual::Louder { factor, repeats } => {
            let how = match repeats {
                true => {
                    "Touch the same place anew in the same posture, which shows how well things touch, or declare \
                     the noise of closures as it is"
                }
                false => {
                    "Record each pose several times, which shows the noise, or declare it as it is"
                }
            };
            let text = format!(
                "more is left than the declared noise allows, and no effect of the catalogue and \
                 no one channel explains it as well as {factor:.2} times that noise does. {how}"
            );
            (None, text)
        }
        Residual::Structure(Structure { share, likely, location: at, .. })
            if !likely.is_empty() =>
        {
            let name = match *share {
                Share::Channel(c) => mechanism.channels[c].name.clone(),
                Share::Chain(c) => mechanism.chains[c].name.clone(),
            };
            let (last, before) = self::likely(mechanism, likely);
            let which = if before.is_empty() { last } else { format!("{before} or {last}") };
            let text = format!(
                "structure is left that no effect of the catalogue explains; with one equation a \
                 pose any channel would take up all of it, and the likeliest to have made it is \
                 {which}{}. {}",
                in_brackets(mechanism, at),
                range_sentence(&name)
            );
            (Some(name), text)
        }
        Residual::Structure(Structure { share, percent, location: at, .. }) => {
            let (name, what) = match *share {
                Share::Channel(c) => {
                    let name = mechanism.channels[c].name.clone();
                    (name.clone(), format!("errors of {name}"))
                }
                Share::Chain(c) => {
                    let name = mechanism.chains[c].name.clone();
                    (name.clone(), format!("errors of several joints of {name}, or of its tip,"))
                }
            };
            let text = format!(
                "structure is left that no effect of the catalogue explains; {what} would take up \
                 {percent:.0} % of it{}. {}",
                in_brackets(mechanism, at),
                range_sentence(&name)
            );
            (Some(name), text)
        }
    }
}

/// Channels with their probabilities: the last, and those before it.
fn likely(mechanism: &Mechanism, likely: &[(usize, f64)]) -> (String, String) {
    let one = |(c, probability): &(usize, f64)| {
        format!("{} ({:.0} %)", mechanism.channels[*c].name, 100.0 * probability)
    };
    let mut names: Vec<String> = likely.iter().map(one).collect();
    (names.pop().unwrap_or_default(), names.join(", "))
}

/// An explanation that fits as well and puts the platform elsewhere: how far, and what is predicted.
#[must_use]
pub fn another(mechanism: &Mechanism, rival: &Explanation, apart: f64, predicted: f64) -> String {
    let names: Vec<String> = rival.effects.iter().map(|i| of(mechanism, i)).collect();
    let names = match names.is_empty() {
        true => "what was asked for alone".into(),
        false => and_between(&names),
    };
    let what = if mechanism.platform.is_empty() { "carried points" } else { "the platform" };
    let unit = &mechanism.length_unit;
    let [apart, predicted] = [apart, predicted].map(|length| significant(length, 3));
    format!(
        "{names} would fit as well and put {what} {apart} {unit} elsewhere, more than the \
         {predicted} {unit} that are predicted"
    )
}

/// An effect as people read it: `base tilt of tower a`.
fn of(mechanism: &Mechanism, instance: &Instance) -> String {
    format!("{} of {}", spoken(instance.term.info().id), instance.target.name(mechanism))
}

/// The id of a term as people read it.
fn spoken(id: &str) -> String {
    id.replace('_', " ")
}

/// Several statements, a sentence each; one alone stays as it is.
#[must_use]
pub fn sentences(statements: &[String]) -> String {
    let one = |text: &String| {
        let (first, rest) = text.split_at(text.chars().next().map_or(0, char::len_utf8));
        format!("{}{}.", first.to_uppercase(), rest.trim_end_matches('.'))
    };
    match statements {
        [alone] => alone.clone(),
        several => several.iter().map(one).collect::<Vec<_>>().join(" "),
    }
}

/// A law that no term has, and what it depends on.
#[must_use]
pub fn unknown_law(mechanism: &Mechanism, law: &UnknownLaw) -> String {
    let one = |(variable, also): &(Quantity, Vec<Quantity>)| -> String {
        let all = std::iter::once(variable).chain(also.iter().take(TOLD_APART));
        all.map(|v| quantity(mechanism, *v)).collect::<Vec<_>>().join(" or ")
    };
    let on: Vec<String> = law.variables.iter().map(one).collect();
    let others = law.also_of.iter().filter(|other| **other != law.whose);
    let places = std::iter::once(&law.whose).chain(others).take(1 + TOLD_APART);
    let name = places.map(|place| place.name(mechanism)).collect::<Vec<_>>().join(" or ");
    let mut next: Vec<String> =
        law.variables.iter().map(|(v, _)| tells(mechanism, *v, law.whose.target)).collect();
    next.dedup();
    let how = match () {
        () if law.replaces.is_empty() => "may explain it",
        () if law.better() => "explains it better than what was found",
        () => "explains it as well as what was found",
    };
    let formula = law.written.as_ref().map_or(String::new(), formula);
    format!(
        "a law that no term has, of {name}, that depends on {}, {how}: an error of {} {} root \
         mean square{formula}. What would tell: {}",
        on.join(" and on "),
        significant(law.size, 2),
        law.whose.unit(mechanism),
        next.join("; ")
    )
}

/// A formula with its numbers.
fn formula(written: &Written) -> String {
    let parameters = written.law.parameters.keys().zip(&written.values);
    let each: Vec<String> = parameters
        .map(|(name, [value, sd])| {
            format!("{name} = {} ± {}", significant(*value, 3), significant(NORMAL_95 * sd, 2))
        })
        .collect();
    format!(
        ", by {} with {} ({:.0} % likely)",
        written.law.text().1,
        each.join(", "),
        100.0 * written.probability
    )
}

/// A law as the lines of a mechanism file.
#[must_use]
pub fn as_term(law: &Law) -> String {
    let sizes: Vec<String> =
        law.parameters.iter().map(|(name, size)| format!("{name} = {size:e}")).collect();
    let (key, text) = law.text();
    let moves = law.moves.map(|m| format!("moves = {}\n", in_toml(&word(&m))));
    format!(
        "[[term]]\nid = {}\nclass = {}\nper = {}\nparameters = {{ {} }}\n{}{key} = {}\n",
        in_toml(&law.id),
        in_toml(&word(&law.class)),
        in_toml(&word(&law.per)),
        sizes.join(", "),
        moves.unwrap_or_default(),
        in_toml(text)
    )
}

/// A variable in words.
fn quantity(mechanism: &Mechanism, variable: Quantity) -> String {
    let name = |c: usize| mechanism.channels[c].name.as_str();
    match variable {
        Quantity::Theta(c) => format!("where {} is", name(c)),
        Quantity::Direction(c) => format!("the direction in which {} came", name(c)),
        Quantity::Travelled(c) => format!("the path that {} has travelled", name(c)),
        Quantity::SinceTurn(c) => format!("how far {} is from where it turned last", name(c)),
        Quantity::Play(c) => format!("the last turns of {}", name(c)),
        Quantity::Velocity(c) => format!("the velocity of {}", name(c)),
        Quantity::SinceMove(c) => format!("the time since {} moved last", name(c)),
        Quantity::Torque(c) => format!("the torque about {}", name(c)),
        Quantity::Column(k) => mechanism.value_columns().swap_remove(k),
        Quantity::Time => "time".into(),
        Quantity::Temperature => "the temperature".into(),
    }
}

/// What to record to see whether errors of a target depend on a variable.
fn tells(mechanism: &Mechanism, variable: Quantity, target: Target) -> String {
    let name = |c: usize| mechanism.channels[c].name.as_str();
    let own = target.name(mechanism);
    match variable {
        Quantity::Theta(c) => match target {
            Target::Channel(own_channel) if own_channel != c => {
                format!("poses that move {} through its range, {own} held", name(c))
            }
            _ => format!("more poses that move {} through its range, all else held", name(c)),
        },
        Quantity::Direction(c) => format!("the same poses, {} come from its other side", name(c)),
        Quantity::SinceTurn(c) | Quantity::Play(c) => {
            format!("the same poses, {} come from nearer by and from farther away", name(c))
        }
        Quantity::Velocity(c) => format!("the same motion with {} at another pace", name(c)),
        Quantity::SinceMove(c) => format!("the same poses, {} held longer and shorter", name(c)),
        Quantity::Travelled(_) | Quantity::Time => "the first poses once more at the end".into(),
        Quantity::Torque(c) => format!("the same poses with another weight on {}", name(c)),
        Quantity::Column(_) => {
            format!("the same poses with another value of {}", quantity(mechanism, variable))
        }
        Quantity::Temperature => "the same poses, warmer or colder".into(),
    }
}

/// Variables that are named beside the likeliest one; all stand in the JSON.
const TOLD_APART: usize = 2;

fn range_sentence(name: &str) -> String {
    format!(
        "Record more poses that move {name} through its range, alone, slowly, in both directions."
    )
}

fn in_brackets(mechanism: &Mechanism, at: &Location) -> String {
    let words = location(mechanism, at);
    if words.is_empty() { words } else { format!(" ({words})") }
}

/// Where errors of a channel would lie; empty where they would lie anywhere.
#[must_use]
pub fn location(mechanism: &Mechanism, at: &Location) -> String {
    let Some(channel) = at.channel else { return String::new() };
    let (name, unit) = (&mechanism.channels[channel].name, &mechanism.channels[channel].unit);
    let mut words = Vec::new();
    if let Some(([first, last], share)) = at.labels {
        let what = if at.held { "poses" } else { "rows" };
        words.push(format!("{share:.0} % of it in {what} {first} to {last}"));
    }
    if let Some(([low, high], share)) = at.readings {
        let digits = if mechanism.channels[channel].counts() { 0 } else { 3 };
        words.push(format!(
            "{share:.0} % of it where {name} reads {low:.digits$} to {high:.digits$} {unit}"
        ));
    }
    if at.sided {
        words.push(format!("its sign is that of the direction in which {name} came"));
    }
    words.join(", ")
}

/// What is doubtful of the effects found: a target, and why.
fn doubted(mechanism: &Mechanism, doubted: &Doubted) -> (String, String) {
    let id = spoken(doubted.instance.term.info().id);
    let (target, what) = match doubted.doubt {
        Doubt::Faint { rise } => {
            let target = doubted.instance.target.name(mechanism);
            let what = format!(
                "{id} of {target} is faint beside the others (χ² would rise by {rise:.0} without it)"
            );
            (target, what)
        }
        Doubt::AgainInChain(chain) => {
            let name = mechanism.chains[chain].name.clone();
            (name.clone(), format!("{id} is named more than once in {name}"))
        }
        Doubt::InChains(count) => ("all".to_owned(), format!("{id} is named in {count} chains")),
        Doubt::TwoLaws(other) => {
            let target = doubted.instance.target.name(mechanism);
            let other = spoken(other.term.info().id);
            let what = format!("{target} has errors of two laws, {other} and {id}");
            (target, what)
        }
    };
    let text = format!(
        "{what}: together they may stand for one effect that the catalogue lacks. Record more \
         poses, and see whether all of them are found again."
    );
    (target, text)
}

/// Data that leave nothing to check a fit with.
#[must_use]
pub fn nothing_left(parameters: usize, poses: usize) -> String {
    format!(
        "{parameters} parameters from {poses} different poses leave nothing to check them with; \
         record other poses"
    )
}

/// True where the same is to be said of two channels.
pub(crate) fn are_alike(observations: &Observations, one: &Absurdity, other: &Absurdity) -> bool {
    let unit = |channel: usize| &observations.mechanism.channels[channel].unit;
    match (*one, *other) {
        (
            Absurdity::Noise { channel: a, sigma: sigma_a, span: span_a },
            Absurdity::Noise { channel: b, sigma: sigma_b, span: span_b },
        ) => {
            unit(a) == unit(b) && noise_and_span(sigma_a, span_a) == noise_and_span(sigma_b, span_b)
        }
        _ => false,
    }
}

/// Noise and span of a channel with the digits that are shown.
fn noise_and_span(sigma: f64, span: f64) -> [String; 2] {
    [significant(sigma, 3), significant(span, 4)]
}

/// Names with commas, and a word before the last.
fn and_between(names: &[String]) -> String {
    match names {
        [others @ .., last] if !others.is_empty() => format!("{} and {last}", others.join(", ")),
        _ => names.concat(),
    }
}

/// What is absurd beside the size of the mechanism.
#[must_use]
pub fn absurdity(observations: &Observations, absurdity: &Absurdity, targets: &[String]) -> String {
    let mechanism = &observations.mechanism;
    let unit = &mechanism.length_unit;
    match *absurdity {
        Absurdity::Noise { channel, sigma, span } => {
            let [sigma, span] = noise_and_span(sigma, span);
            format!(
                "noise of {sigma} {unit} in {}, whose joint{} can move by {span} {unit}: these \
                 readings are not of this mechanism, or not in its units",
                and_between(targets),
                if targets.len() > 1 { "s" } else { "" },
                unit = mechanism.channels[channel].unit
            )
        }
        Absurdity::Misclosure { rms, length } => format!(
            "a misclosure of {rms:.3} {unit} where the smallest length of the loop is \
             {length:.3} {unit}: these readings are not of this mechanism, or not in its units"
        ),
        Absurdity::Limits { channel, span } => {
            let channel = &mechanism.channels[channel];
            let [from, to] = span.map(|end| significant(end, 4));
            let [low, high] = channel.limits.unwrap_or(span).map(|end| significant(end, 4));
            format!(
                "the offset of {} puts its joint from {from} to {to}, and its limits are {low} and {high}: \
                 is the sign of a channel reversed, or are two exchanged? A machine and its image in a mirror \
                 close alike",
                and_between(targets),
            )
        }
        Absurdity::Effect { instance, parameter, value, typical } => {
            let info = instance.term.info();
            let of = &info.parameters[parameter];
            format!(
                "{} of {}: {} = {value:.3} {}, {:.0} times what occurs in practice: the effect \
                 stands for something else",
                info.id,
                and_between(targets),
                of.name,
                crate::estimate::directions::unit(observations, &instance, of.unit),
                value.abs() / typical
            )
        }
    }
}
