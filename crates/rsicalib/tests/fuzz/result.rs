//! Results as JSON.

use rsicalib::diagnosis::options::SearchOptions;
use rsicalib::mechanism::Mechanism;
use rsicalib::readings::Table;
use rsicalib::report::read::{Document, read};
use rsicalib::report::traced;
use rsicalib::{FitOptions, Observations};
use serde_json::Value;

use crate::{cases, damaged};

/// A trace of twelve poses, as the command writes it.
fn result() -> String {
    let mechanism = Mechanism::rsi();
    let wave = |row: usize, c: usize| 2048.0 + 700.0 * ((1 + row * 9 + c) as f64 * 1.7).sin();
    let values = (0..12 * 9).map(|k| wave(k / 9, k % 9).round()).collect();
    let table = Table { values, ..Table::default() };
    let options = FitOptions { noise: Some(vec![1.0; 9]), ..FitOptions::default() };
    let observations = Observations::new(&mechanism, table, None, options).expect("readings");
    let report = traced::report(&observations, &SearchOptions::default(), None).expect("a trace");
    let mut value = serde_json::to_value(&report).expect("a document");
    for (key, text) in [("format", "rsicalib.trace/1"), ("version", "0"), ("mechanism", "m")] {
        value[key] = text.into();
    }
    value["length_unit"] = "in".into();
    value["readings"] = serde_json::json!({"poses": 12, "samples": 12, "sha256": "0"});
    value["reference"] = serde_json::json!({
        "centre": vec![2048.0; 9], "span": vec![[0.0, 4095.0]; 9], "temperature": null,
    });
    value.to_string()
}

/// Every number of a document that stands in another at the same place, or the place where not.
fn missing(out: &Value, given: &Value, place: &str) -> Option<String> {
    match (out, given) {
        (Value::Object(out), Value::Object(given)) => out.iter().find_map(|(key, value)| {
            let place = format!("{place}.{key}");
            // A key that was not given has its default, which is no number.
            given
                .get(key)
                .map_or(value.is_number().then(|| place.clone()), |g| missing(value, g, &place))
        }),
        (Value::Array(out), Value::Array(given)) if out.len() == given.len() => {
            let both = out.iter().zip(given).enumerate();
            both.into_iter().find_map(|(k, (o, g))| missing(o, g, &format!("{place}[{k}]")))
        }
        (Value::Number(out), Value::Number(given)) if out.as_f64() == given.as_f64() => None,
        (out, given) => (out != given).then(|| place.to_owned()),
    }
}

#[test]
fn a_damaged_result_is_refused_by_its_place_or_read_as_it_stands() {
    let whole = result();
    assert!(read(&whole).is_ok(), "{:?}", read(&whole).err());
    cases(|drawn| {
        let text = damaged(&whole, drawn)?;
        match read(&text) {
            Err(refused) => {
                assert!(!refused.place.is_empty() && !refused.expected.is_empty(), "{refused}");
            }
            Ok(document) => {
                let out = match document {
                    Document::Calibration(result) => serde_json::to_value(result),
                    Document::Trace(result) => serde_json::to_value(result),
                }
                .expect("a result is JSON");
                // A key that a later version may have added can hold a number beyond all others.
                let Ok(given) = serde_json::from_str::<Value>(&text) else { return Ok(()) };
                assert_eq!(missing(&out, &given, ""), None, "{text}");
            }
        }
        Ok(())
    });
}
