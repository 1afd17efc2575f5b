//! Names and texts of users, as messages show them.

/// Longer texts are cut.
const LONGEST: usize = 40;

/// A text in quotation marks, of which no more than a line is shown.
#[must_use]
pub fn quoted(text: &str) -> String {
    let whole = text.chars().count();
    if whole <= LONGEST {
        return format!("{text:?}");
    }
    let start: String = text.chars().take(LONGEST).collect();
    format!("{start:?}… ({whole} characters)")
}

/// Texts in quotation marks, with commas between them.
#[must_use]
pub fn listed(texts: &[String]) -> String {
    texts.iter().map(|text| quoted(text)).collect::<Vec<_>>().join(", ")
}

/// A text without controls, as a basic string of TOML.
#[must_use]
pub fn in_toml(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// A character in quotation marks.
#[must_use]
pub fn character(one: char) -> String {
    format!("{one:?}")
}

/// A number with all its digits and no more zeros than a reader counts.
#[must_use]
pub fn number(value: f64) -> String {
    format!("{value:?}")
}

/// The same as people write it: no `.0` behind a whole number, and no row of zeros.
#[must_use]
pub fn brief(value: f64) -> String {
    let (written, exact) = (value.to_string(), number(value));
    if written.len() <= exact.len() { written } else { exact }
}

/// A number rounded to so many digits, without zeros at its end: `0.0529`, `1.2e-05`.
#[must_use]
pub fn significant(value: f64, digits: usize) -> String {
    let trimmed = |text: &str| match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text.to_owned(),
    };
    let rounded = format!("{value:.*e}", digits - 1);
    let Some((mantissa, power)) = rounded.split_once('e') else { return rounded };
    let power: i32 = power.parse().unwrap_or_default();
    match usize::try_from(digits as i32 - 1 - power) {
        Ok(places) if power >= -4 => trimmed(&format!("{value:.places$}")),
        _ => {
            let sign = if power < 0 { '-' } else { '+' };
            format!("{}e{sign}{:02}", trimmed(mantissa), power.abs())
        }
    }
}

/// Numbers in brackets, with commas between them.
#[must_use]
pub fn listed_numbers(values: &[f64]) -> String {
    let each: Vec<String> = values.iter().map(|value| number(*value)).collect();
    format!("[{}]", each.join(", "))
}

/// The word for a choice without values of its own, as files have it.
#[must_use]
pub fn word(choice: &dyn std::fmt::Debug) -> String {
    format!("{choice:?}").to_lowercase()
}

/// The known name that may have been meant, in brackets; empty where none is near.
///
/// `known` are the names with commas between them. A name is near that differs by a third of its
/// letters at most: one left out, one too many, one wrong, or two that changed places.
#[must_use]
pub fn meant(found: &str, known: &str) -> String {
    let near = known.split(", ").map(|name| (distance(found, name), name));
    // No more letters are compared than `distance` looks at.
    let letters = |text: &str| text.chars().take(2 * LONGEST).count();
    let near = near.filter(|(d, name)| *d > 0 && 3 * d <= letters(found).max(letters(name)));
    near.min_by_key(|(d, _)| *d)
        .map_or(String::new(), |(_, name)| format!(" (did you mean {}?)", quoted(name)))
}

/// The same by a message in which names stand between backticks: the one that was found, then those that
/// are known.
#[must_use]
pub fn meant_by(message: &str) -> String {
    let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    names.split_first().map_or(String::new(), |(found, known)| meant(found, &known.join(", ")))
}

/// What was found and what is expected by a message of a library that reads files, in words of a user; none where it
/// does not say both.
#[cfg(feature = "serde")]
pub(crate) fn found_and_expected(message: &str) -> Option<(String, String)> {
    let (found, expected) = message.split_once(", expected ")?;
    Some((plain(found), plain(expected)))
}

/// The words of these libraries for a value, in those of a user.
#[cfg(feature = "serde")]
fn plain(words: &str) -> String {
    let words = words.trim_start_matches("invalid type: ").trim_start_matches("invalid value: ");
    for length in ["invalid length ", "an array of length "] {
        if let Some(length) = words.strip_prefix(length) {
            return format!("a list of {length}");
        }
    }
    let (kind, rest) = words.split_once(' ').unwrap_or((words, ""));
    match (kind, rest) {
        ("f64", _) => "a number".into(),
        ("u64" | "usize" | "i64", _) => "a whole number".into(),
        ("string", rest) => format!("text {rest}"),
        ("a" | "borrowed", "string" | "str") => "text".into(),
        ("map" | "struct", _) => "an object".into(),
        ("sequence", _) => "a list".into(),
        ("a", "sequence") => "a list".into(),
        ("a", "map") => "an object".into(),
        ("integer" | "boolean", rest) => rest.trim_matches('`').into(),
        ("floating", rest) => rest.trim_start_matches("point ").trim_matches('`').into(),
        _ => words.to_owned(),
    }
}

/// Letters left out, added, exchanged or changed between two names (optimal string alignment).
fn distance(a: &str, b: &str) -> usize {
    let a: Vec<char> = a.chars().take(2 * LONGEST).collect();
    let b: Vec<char> = b.chars().take(2 * LONGEST).collect();
    let width = b.len() + 1;
    let mut cost = vec![0; (a.len() + 1) * width];
    for i in 0..=a.len() {
        for j in 0..=b.len() {
            let at = |i: usize, j: usize| cost[i * width + j];
            cost[i * width + j] = if i == 0 || j == 0 {
                i + j
            } else {
                let differs = usize::from(a[i - 1] != b[j - 1]);
                let best = (at(i - 1, j) + 1).min(at(i, j - 1) + 1).min(at(i - 1, j - 1) + differs);
                let swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
                if swapped { best.min(at(i - 2, j - 2) + 1) } else { best }
            };
        }
    }
    cost[a.len() * width + b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_number_is_a_row_of_zeros() {
        for (value, text) in [
            (4095.0, "4095"),
            (-0.25, "-0.25"),
            (1e300, "1e300"),
            (-2.5e-60, "-2.5e-60"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(brief(value), text);
        }
    }

    #[test]
    fn significant_digits_are_written_as_python_writes_them() {
        // `f"{value:.{digits}g}"` of Python 3.11.
        for (value, digits, text) in [
            (0.052_94, 3, "0.0529"),
            (1.0, 3, "1"),
            (-1234.0, 3, "-1.23e+03"),
            (999.6, 3, "1e+03"),
            (100.0, 3, "100"),
            (0.000_123_4, 2, "0.00012"),
            (0.000_012_34, 2, "1.2e-05"),
            (0.0, 3, "0"),
        ] {
            assert_eq!(significant(value, digits), text);
        }
    }

    #[test]
    fn a_name_with_a_slip_is_recognised() {
        let known = "offset, gain, curvature, link_length";
        for (found, name) in [("ofset", "offset"), ("curvatre", "curvature"), ("gian", "gain")] {
            assert_eq!(meant(found, known), format!(" (did you mean \"{name}\"?)"));
        }
        assert_eq!(meant("nonsense", known), "");
        assert_eq!(meant(&"z".repeat(100_000), known), "");
        assert_eq!(meant("", known), "");
    }

    #[test]
    fn a_long_text_is_cut() {
        assert_eq!(quoted("a\n"), "\"a\\n\"");
        assert!(quoted(&"x".repeat(200_000)).len() < 80);
    }
}
