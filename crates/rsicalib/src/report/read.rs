//! Results read back: a text is refused by the place at which it is no result.

use faer::{Mat, Side};
use serde::Deserialize;

use crate::estimate::directions::ParameterReport;
use crate::estimate::noise::source::Source;
use crate::numerics::bounds;
use crate::report::document::{Calibration, FORMATS, Parts, Trace};
use crate::text::{found_and_expected, quoted};

/// Numbers of a result that are one agree to this: they are written with all their digits, and
/// computed one from the other.
const AGREE: f64 = 1e-6;

/// A result read back from its JSON.
#[derive(Debug, Clone, PartialEq)]
pub enum Document {
    /// Of `rsicalib.calibration/1`.
    Calibration(Box<Calibration>),
    /// Of `rsicalib.trace/1`.
    Trace(Box<Trace>),
}

/// Why a text is not a result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{place}: found {found}, expected {expected}")]
pub struct Refused {
    /// Path of the entry: `parameters[3].value`; `line 7, column 12` where the text is no JSON.
    pub place: String,
    /// What stands there.
    pub found: String,
    /// What could stand there.
    pub expected: String,
}

impl Document {
    /// What both have.
    pub(crate) fn parts(&self) -> &dyn Parts {
        match self {
            Self::Calibration(result) => &**result,
            Self::Trace(result) => &**result,
        }
    }

    /// The trace, where it is one.
    pub(crate) fn trace(&self) -> Option<&Trace> {
        match self {
            Self::Calibration(_) => None,
            Self::Trace(result) => Some(result),
        }
    }
}

#[derive(Deserialize)]
struct Head {
    #[serde(default)]
    format: serde_json::Value,
}

/// Reads a result, and checks that its parts agree.
///
/// # Errors
///
/// [`Refused`] with the place.
pub fn read(text: &str) -> Result<Document, Refused> {
    let read = written(text)?;
    check(read.parts())?;
    Ok(read)
}

/// Reads a result that a program holds, as it wrote it: parts that were changed since need not agree.
///
/// # Errors
///
/// [`Refused`] with the place.
pub fn written(text: &str) -> Result<Document, Refused> {
    let head: Head = parse(text)?;
    let format = head.format.as_str().unwrap_or_default().to_owned();
    if format == FORMATS[0] {
        return Ok(Document::Calibration(Box::new(completed(text)?)));
    }
    if format == FORMATS[1] {
        return Ok(Document::Trace(Box::new(completed(text)?)));
    }
    let found = if format.is_empty() { head.format.to_string() } else { quoted(&format) };
    Err(Refused { place: "format".into(), found, expected: FORMATS.join(" or ") })
}

fn parse<'de, T: Deserialize<'de>>(text: &'de str) -> Result<T, Refused> {
    let mut from = serde_json::Deserializer::from_str(text);
    let read = serde_path_to_error::deserialize(&mut from).map_err(|error| {
        let (path, inner) = (error.path().to_string(), error.inner());
        let at = format!("line {}, column {}", inner.line(), inner.column());
        let message = inner.to_string();
        let message = message.split(" at line ").next().unwrap_or_default().to_owned();
        let message = if inner.is_data() { message } else { format!("not JSON ({message})") };
        let (found, expected) = match found_and_expected(&message) {
            Some(both) => both,
            None => (message, "a result of `rsicalib calibrate --json` or `trace --json`".into()),
        };
        let place = if path == "." { at } else { format!("{path} ({at})") };
        Refused { place, found, expected }
    })?;
    from.end().map_err(|error| Refused {
        place: format!("line {}, column {}", error.line(), error.column()),
        found: "text after the result".into(),
        expected: "the end".into(),
    })?;
    Ok(read)
}

/// A result with what an earlier version did not write.
fn completed<'de, T: Deserialize<'de> + Parts>(text: &'de str) -> Result<T, Refused> {
    let mut read: T = parse(text)?;
    if let Some(noise) = read.noise_mut().filter(|noise| noise.kind.is_none()) {
        noise.kind = source_of(&noise.source);
    }
    Ok(read)
}

/// How results begin to say where their noise is from that have no `kind`.
///
/// They were written by versions that are no longer changed: these are no words of this one.
const SOURCES: [(&str, Source); 5] = [
    ("declared", Source::Declared),
    ("misclosure of repeats", Source::Repeats),
    ("misclosure of neighbouring rows", Source::Neighbours),
    ("quantisation", Source::Quantisation),
    ("the fit itself", Source::Fit),
];

/// Where the noise is from of a result that has the words alone.
fn source_of(said: &str) -> Option<Source> {
    SOURCES.into_iter().find(|(start, _)| said.starts_with(start)).map(|(_, source)| source)
}

/// Checks that the parts of a result agree, and that each is what it can be.
fn check(result: &dyn Parts) -> Result<(), Refused> {
    check_parameters(result)?;
    let sd = |p: &ParameterReport| p.sd;
    check_covariance("covariance", result.parameters(), result.covariance(), sd)?;
    check_between(result)?;
    check_fit(result)?;
    let (Some(noise), Some(reference)) = (result.noise(), result.reference()) else {
        return Ok(());
    };
    let channels = noise.sigma.0.len();
    for (place, found) in
        [("reference.centre", reference.centre.len()), ("reference.span", reference.span.len())]
    {
        if found != channels {
            let expected = format!("{channels}, one for each channel of noise.sigma");
            return refuse(place, format!("{found} entries"), expected);
        }
    }
    for (k, (centre, [low, high])) in reference.centre.iter().zip(&reference.span).enumerate() {
        let room = 1e-9 * (1.0 + low.abs().max(high.abs())); // a mean may be rounded
        if !(low - room <= *centre && *centre <= high + room || *centre == 0.0) {
            let place = format!("reference.centre[{k}]");
            return refuse(&place, centre.to_string(), format!("0, or {low} to {high}, its span"));
        }
    }
    for (key, held) in [("sigma", &noise.sigma), ("closures", &noise.closures)] {
        if let Some((name, sd)) = held.0.iter().find(|(_, sd)| !bounds::positive(*sd)) {
            return refuse(&format!("noise.{key}.{name}"), sd.to_string(), "a number above 0");
        }
    }
    Ok(())
}

fn refuse<T>(
    place: &str,
    found: impl Into<String>,
    expected: impl Into<String>,
) -> Result<T, Refused> {
    Err(Refused { place: place.into(), found: found.into(), expected: expected.into() })
}

/// Refuses a parameter that stands twice, and numbers that none can have.
fn check_parameters(result: &dyn Parts) -> Result<(), Refused> {
    let key =
        |p: &ParameterReport| (p.term.clone(), p.target.clone(), p.place.clone(), p.name.clone());
    let mut seen = std::collections::HashSet::new();
    for (k, p) in result.parameters().iter().enumerate() {
        if !seen.insert(key(p)) {
            let found = format!("{} {} {} again", p.term, p.target, p.name);
            return refuse(&format!("parameters[{k}]"), found, "each parameter once");
        }
        if !(p.value.is_nan() || bounds::usable(p.value)) {
            let place = format!("parameters[{k}].value");
            return refuse(&place, p.value.to_string(), bounds::expected(p.value));
        }
        if let Some(sd) = p.sd.filter(|sd| !(*sd >= 0.0 && bounds::usable(*sd))) {
            return refuse(&format!("parameters[{k}].sd"), sd.to_string(), "0 or more, or null");
        }
        let [low, high] = p.interval.unwrap_or_default().map(|bound| bound.filter(|b| !b.is_nan()));
        let apart = low.is_some_and(|low| low > p.value) || high.is_some_and(|high| high < p.value);
        if apart || [low, high].into_iter().flatten().any(|bound| !bounds::usable(bound)) {
            let text = |bound: Option<f64>| bound.map_or("null".into(), |b| b.to_string());
            let expected = format!("bounds on both sides of {}, or null", p.value);
            return refuse(
                &format!("parameters[{k}].interval"),
                format!("{} to {}", text(low), text(high)),
                expected,
            );
        }
    }
    Ok(())
}

/// Refuses changes from group to group that nothing has.
fn check_between(result: &dyn Parts) -> Result<(), Refused> {
    let Some(between) = result.between() else { return Ok(()) };
    let sd = |p: &ParameterReport| p.sd_between;
    check_covariance("between.covariance", result.parameters(), &between.covariance, sd)?;
    if !(0.0..=1.0).contains(&between.p_value) {
        return refuse("between.p_value", between.p_value.to_string(), "0 to 1");
    }
    let [low, high] = between.interval;
    if !(0.0 <= low && low <= between.sd && between.sd <= high && bounds::usable(high)) {
        let expected = format!("from 0 or more to no less than {}, the sd", between.sd);
        return refuse("between.interval", format!("{low} to {high}"), expected);
    }
    match between.parameters.iter().find(|p| !(p.sd >= 0.0 && bounds::usable(p.sd))) {
        Some(p) => refuse("between.parameters.sd", p.sd.to_string(), "0 or more"),
        None => Ok(()),
    }
}

/// Refuses a covariance that no parameters have: not square, not symmetric, not positive, or not
/// of these standard deviations.
fn check_covariance(
    name: &str,
    parameters: &[ParameterReport],
    covariance: &[Vec<Option<f64>>],
    sd: impl Fn(&ParameterReport) -> Option<f64>,
) -> Result<(), Refused> {
    let n = parameters.len();
    if covariance.len() != n || covariance.iter().any(|row| row.len() != n) {
        let found = format!("{} rows", covariance.len());
        return refuse(name, found, format!("{n} rows of {n} numbers"));
    }
    let at = |i: usize, j: usize| covariance[i][j];
    let known: Vec<usize> = (0..n).filter(|&i| at(i, i).is_some()).collect();
    for &i in &known {
        let variance = at(i, i).unwrap_or_default();
        let sd = sd(&parameters[i]).unwrap_or(variance.max(0.0).sqrt());
        if variance < 0.0 || (sd * sd - variance).abs() > AGREE * variance {
            let expected = format!("{}, the square of the standard deviation", sd * sd);
            return refuse(&format!("{name}[{i}][{i}]"), variance.to_string(), expected);
        }
    }
    let scale =
        |i: usize, j: usize| (at(i, i).unwrap_or_default() * at(j, j).unwrap_or_default()).sqrt();
    for (i, j) in (0..n).flat_map(|i| (0..i).map(move |j| (i, j))) {
        let (here, there) = (at(i, j), at(j, i));
        let same = match (here, there) {
            (Some(a), Some(b)) => (a - b).abs() <= AGREE * scale(i, j),
            (a, b) => a == b,
        };
        if !same || here.is_some_and(|c| c.abs() > (1.0 + AGREE) * scale(i, j)) {
            let text = |c: Option<f64>| c.map_or("null".into(), |c| c.to_string());
            let expected = format!("the same as in [{j}][{i}], at most {}", scale(i, j));
            return refuse(&format!("{name}[{i}][{j}]"), text(here), expected);
        }
    }
    let spread: Vec<usize> = known.into_iter().filter(|&i| scale(i, i) > 0.0).collect();
    let unit = Mat::from_fn(spread.len(), spread.len(), |i, j| {
        at(spread[i], spread[j]).unwrap_or_default() / scale(spread[i], spread[j])
    });
    let least = unit.self_adjoint_eigenvalues(Side::Lower).ok();
    let least = least.and_then(|all| all.first().copied()).unwrap_or(0.0);
    if least < -AGREE * n as f64 {
        let found = format!("a variance of {least:.3} in units of its own along some direction");
        return refuse(name, found, "none below 0");
    }
    Ok(())
}

/// Refuses numbers that no fit has.
fn check_fit(result: &dyn Parts) -> Result<(), Refused> {
    for (place, fit) in result.fits() {
        if let Some(p) = fit.p_value.filter(|p| !(0.0..=1.0).contains(p)) {
            return refuse(&format!("{place}.p_value"), p.to_string(), "0 to 1, or null");
        }
        let sizes = [("chi2", fit.chi2), ("dof", fit.dof), ("rms_misclosure", fit.rms_misclosure)];
        for (name, value) in sizes {
            if let Some(value) = value.filter(|v| *v < 0.0) {
                let place = format!("{place}.{name}");
                return refuse(&place, value.to_string(), "0 or more, or null");
            }
        }
    }
    let Some(noise) = result.noise() else { return Ok(()) };
    if let Some(dof) = noise.dof.filter(|dof| *dof <= 0.0) {
        return refuse("noise.dof", dof.to_string(), "a number above 0, or null");
    }
    if let Some(rho) = noise.correlation.filter(|rho| !(-1.0..=1.0).contains(rho)) {
        return refuse("noise.correlation", rho.to_string(), "-1 to 1, or null");
    }
    for (k, step) in result.steps().iter().enumerate() {
        if !step.curve_sd.is_empty() && step.curve_sd.len() != step.curve.len() {
            let (found, expected) = (step.curve_sd.len(), step.curve.len());
            let expected = format!("{expected}, one for each row of the curve, or none");
            return refuse(&format!("steps[{k}].curve_sd"), format!("{found} entries"), expected);
        }
    }
    Ok(())
}
