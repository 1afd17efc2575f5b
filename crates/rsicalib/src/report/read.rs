//! Results read back: a text is refused by the place at which it is no result.

use serde::Deserialize;

use crate::report::document::{Calibration, FORMATS, Parameter, Parts, Trace};

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
    let head: Head = parse(text)?;
    let format = head.format.as_str().unwrap_or_default().to_owned();
    if format == FORMATS[0] {
        return Ok(Document::Calibration(Box::new(checked(text)?)));
    }
    if format == FORMATS[1] {
        return Ok(Document::Trace(Box::new(checked(text)?)));
    }
    let found = if format.is_empty() { head.format.to_string() } else { format!("{format:?}") };
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
        let (found, expected) = match message.split_once(", expected ") {
            Some((found, expected)) => (plain(found), plain(expected)),
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

/// Words of the JSON library in those of a user.
fn plain(words: &str) -> String {
    let words = words.trim_start_matches("invalid type: ").trim_start_matches("invalid value: ");
    let (kind, rest) = words.split_once(' ').unwrap_or((words, ""));
    match (kind, rest) {
        ("f64", _) => "a number".into(),
        ("u64" | "usize" | "i64", _) => "a whole number".into(),
        ("string", rest) => format!("text {rest}"),
        ("map" | "struct", _) => "an object".into(),
        ("sequence", _) => "a list".into(),
        ("a", "sequence") => "a list".into(),
        ("a", "map") => "an object".into(),
        ("integer" | "boolean", rest) => rest.trim_matches('`').into(),
        ("floating", rest) => rest.trim_start_matches("point ").trim_matches('`').into(),
        _ => words.to_owned(),
    }
}

/// A result whose parts agree.
fn checked<'de, T: Deserialize<'de> + Parts>(text: &'de str) -> Result<T, Refused> {
    let read: T = parse(text)?;
    check(&read)?;
    Ok(read)
}

/// Checks that names are not doubled, and that covariance, noise and reference fit each other.
fn check(result: &impl Parts) -> Result<(), Refused> {
    let (parameters, covariance) = (result.parameters(), result.covariance());
    let refuse =
        |place: String, found: String, expected: String| Err(Refused { place, found, expected });
    let key = |p: &Parameter| (p.term.clone(), p.target.clone(), p.place.clone(), p.name.clone());
    let mut seen = std::collections::HashSet::new();
    for (k, p) in parameters.iter().enumerate() {
        if !seen.insert(key(p)) {
            let found = format!("{} {} {} again", p.term, p.target, p.name);
            return refuse(format!("parameters[{k}]"), found, "each parameter once".into());
        }
        if p.sd.is_some_and(|sd| sd < 0.0) {
            let found = format!("{:?}", p.sd.unwrap_or_default());
            return refuse(format!("parameters[{k}].sd"), found, "0 or more, or null".into());
        }
    }
    let n = parameters.len();
    let square = covariance.len() == n && covariance.iter().all(|row| row.len() == n);
    if !square {
        let found = format!("{} rows", covariance.len());
        return refuse("covariance".into(), found, format!("{n} rows of {n} numbers"));
    }
    let (Some(noise), Some(reference)) = (result.noise(), result.reference()) else {
        return Ok(());
    };
    let channels = noise.sigma.len();
    for (place, found) in
        [("reference.centre", reference.centre.len()), ("reference.span", reference.span.len())]
    {
        if found != channels {
            let expected = format!("{channels}, one for each channel of noise.sigma");
            return refuse(place.into(), format!("{found} entries"), expected);
        }
    }
    match noise.sigma.iter().find(|(_, sigma)| **sigma <= 0.0 || !sigma.is_finite()) {
        Some((name, sigma)) => {
            refuse(format!("noise.sigma.{name}"), sigma.to_string(), "a number above 0".into())
        }
        None => Ok(()),
    }
}
