//! What the shapes of results are, as JSON Schema and as lists of keys.

use std::collections::BTreeMap;

pub use schemars::Schema;

use crate::report::document::{Calibration, FORMATS, Trace};
use crate::report::evidence::shapes::Evidence;

/// JSON Schema of the documents, by format.
#[must_use]
pub fn schemas() -> Vec<(&'static str, Schema)> {
    let calibration = schemars::schema_for!(Calibration);
    let trace = schemars::schema_for!(Trace);
    vec![(FORMATS[0], calibration), (FORMATS[1], trace)]
}

/// JSON Schema of the evidence that a report is drawn from.
#[must_use]
pub fn evidence() -> Schema {
    schemars::schema_for!(Evidence)
}

/// For each type of a document, the keys that are always written: the others are left out where
/// nothing is known.
#[must_use]
pub fn written_keys() -> Vec<(String, Vec<String>)> {
    let settings = schemars::generate::SchemaSettings::draft2020_12().for_serialize();
    let mut generator = settings.into_generator();
    let roots = [
        generator.root_schema_for::<Calibration>().to_value(),
        generator.root_schema_for::<Trace>().to_value(),
        generator.root_schema_for::<Evidence>().to_value(),
    ];
    let required = |schema: &serde_json::Value| -> Vec<String> {
        let keys = schema["required"].as_array().map_or(&[][..], Vec::as_slice);
        keys.iter().filter_map(|k| k.as_str().map(str::to_owned)).collect()
    };
    let mut all = BTreeMap::new();
    for root in &roots {
        let name = root["title"].as_str().unwrap_or_default();
        all.insert(name.to_owned(), required(root));
        for (name, schema) in root["$defs"].as_object().into_iter().flatten() {
            all.insert(name.clone(), required(schema));
        }
    }
    all.into_iter().collect()
}
