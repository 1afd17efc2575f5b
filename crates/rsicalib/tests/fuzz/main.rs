//! Damaged input: never a panic, never a value that the input did not hold, a refusal has a place.
//!
//! Each target damages valid input by edits drawn from seeded bytes, a case for each seed.
//! `RSICALIB_FUZZ_CASES` sets the number of cases, 1000 where not given:
//!
//! ```sh
//! RSICALIB_FUZZ_CASES=10000000 cargo test --release --all-features --test fuzz
//! ```
//!
//! A failure names its case; `RSICALIB_FUZZ_FIRST` begins there.

use arbitrary::{Result, Unstructured};

mod mechanism;
mod readings;
mod result;

/// Runs a target once for each case.
fn cases(target: impl Fn(&mut Unstructured<'_>) -> Result<()>) {
    let number = |name: &str, default: u64| {
        std::env::var(name).ok().map_or(default, |text| text.parse().expect("a number of cases"))
    };
    let first = number("RSICALIB_FUZZ_FIRST", 0);
    for case in first..first + number("RSICALIB_FUZZ_CASES", 1000) {
        let bytes = bytes(case);
        let mut drawn = Unstructured::new(&bytes);
        let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| target(&mut drawn)));
        // Too few bytes left to draw from is the end of a case, not a failure.
        assert!(outcome.is_ok(), "case {case}: RSICALIB_FUZZ_FIRST={case} runs it first");
    }
}

/// Seeded bytes: SplitMix64.
fn bytes(seed: u64) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mut next = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    };
    (0..64).flat_map(|_| next().to_le_bytes()).collect()
}

/// What is written in place of a part of a text.
const PIECES: [&str; 24] = [
    "",
    "0",
    "-1",
    "1e308",
    "-1e308",
    "1e999",
    "nan",
    "inf",
    "null",
    "true",
    "\"\"",
    "\"x\"",
    "[]",
    "{}",
    "[[[[[[",
    "}",
    "\n",
    "\0",
    "é",
    "\u{202e}",
    "9223372036854775808",
    "1e-320",
    "=",
    ",",
];

/// A text with some of its parts replaced, removed or doubled.
fn damaged(text: &str, drawn: &mut Unstructured<'_>) -> Result<String> {
    let mut text = text.to_owned();
    for _ in 0..drawn.int_in_range(1..=4)? {
        let boundary = |at: usize| (0..=at).rev().find(|&k| text.is_char_boundary(k)).unwrap_or(0);
        let start = boundary(drawn.int_in_range(0..=text.len())?);
        // Whole values are replaced more often than arbitrary stretches.
        let stretch = if drawn.ratio(2, 3)? {
            let ends = |c: char| matches!(c, ',' | '\n' | ']' | '}' | '=' | ':');
            text[start..].find(ends).unwrap_or(0)
        } else {
            drawn.int_in_range(0..=40)?
        };
        let end = boundary((start + stretch).min(text.len())).max(start);
        let piece = match drawn.int_in_range(0..=2)? {
            0 => text[start..end].repeat(2),
            _ => (*drawn.choose(&PIECES)?).to_owned(),
        };
        text.replace_range(start..end, &piece);
    }
    Ok(text)
}
