//! Mechanisms and terms.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use pyo3::prelude::*;
use pyo3::types::{PyAny, PyDict};
use pythonize::pythonize;
use rsicalib::diagnosis::options::Rule;
use rsicalib::estimate::paper::Layout;
use rsicalib::mechanism::{Law, Mechanism};
use rsicalib::model::check_names;
use rsicalib::report::warned::of_drawing;
use rsicalib::terms::targets::{shared, targets};
use rsicalib::terms::term::Class;
use serde::Serialize;

use crate::error::PyError;
use crate::values::from_values;

/// A mechanism: channels, chains, points, closures, platform, rest.
#[pyclass(frozen, eq, skip_from_py_object, name = "Mechanism", module = "rsicalib")]
#[derive(Clone, PartialEq)]
pub struct PyMechanism(pub Mechanism, Prepared);

/// What follows from a mechanism and is computed once.
#[derive(Default)]
struct Prepared(OnceLock<Arc<Layout>>);

impl Clone for Prepared {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PartialEq for Prepared {
    fn eq(&self, _other: &Self) -> bool {
        true
    }
}

impl From<Mechanism> for PyMechanism {
    fn from(mechanism: Mechanism) -> Self {
        Self(mechanism, Prepared::default())
    }
}

impl PyMechanism {
    /// The paper's problem of this mechanism.
    pub fn layout(&self) -> Result<Arc<Layout>, rsicalib::Error> {
        if let Some(layout) = self.1.0.get() {
            return Ok(layout.clone());
        }
        let layout = Arc::new(Layout::new(&self.0)?);
        Ok(self.1.0.get_or_init(|| layout).clone())
    }
}

/// A sensor: `angle = gain * reading + offset`.
#[pyclass(frozen, get_all, skip_from_py_object, name = "Channel", module = "rsicalib")]
#[derive(Clone)]
pub struct PyChannel {
    /// Column of the readings.
    name: String,
    /// What people call it.
    label: Option<String>,
    /// Unit of a reading: `count`, `rad`, `m`, ...
    unit: String,
    /// Lowest and highest reading, if bounded.
    range: Option<(f64, f64)>,
    /// Nominal joint coordinate per reading: rad, or length.
    gain: f64,
    /// Nominal joint coordinate at reading zero.
    offset: f64,
    /// Joint limits, in the joint's coordinate.
    limits: Option<(f64, f64)>,
    /// Standard deviation of one reading, where it is known.
    noise: Option<f64>,
    /// True for a joint that has no drive.
    passive: bool,
    /// Column of the readings with the torque of its drive.
    torque: Option<String>,
    /// What its drive carries, in proportion to others of a loop with more drives than motions.
    share: Option<f64>,
}

impl From<&rsicalib::mechanism::Channel> for PyChannel {
    fn from(c: &rsicalib::mechanism::Channel) -> Self {
        Self {
            name: c.name.clone(),
            label: c.label.clone(),
            unit: c.unit.clone(),
            range: c.range.map(Into::into),
            gain: c.gain,
            offset: c.offset,
            limits: c.limits.map(Into::into),
            noise: c.noise,
            passive: c.passive,
            torque: c.torque.clone(),
            share: c.share,
        }
    }
}

#[pymethods]
impl PyChannel {
    fn __repr__(&self) -> String {
        format!("Channel({:?}, unit={:?}, gain={:e})", self.name, self.unit, self.gain)
    }
}

#[pymethods]
impl PyMechanism {
    /// Takes a mechanism from a name, a path, TOML text or plain values: see `load_mechanism`.
    #[new]
    fn new(py: Python<'_>, source: &Bound<'_, PyAny>) -> PyResult<Self> {
        // Files and URDF are read in Python.
        let load = py.import("rsicalib.io.mechanisms")?.getattr("load_mechanism")?;
        Ok(load.call1((source,))?.cast::<Self>()?.get().clone())
    }

    /// The RSI 6-DOF hand controller.
    #[staticmethod]
    fn rsi() -> Self {
        Mechanism::rsi().into()
    }

    /// Reads a mechanism from TOML text; chains in rows, not as URDF.
    #[staticmethod]
    fn from_toml(text: &str) -> Result<Self, PyError> {
        let mechanism = Mechanism::from_toml(text)?;
        check_names(&mechanism)?;
        Ok(mechanism.into())
    }

    /// Takes a mechanism from plain values, keys and units as in the TOML.
    #[staticmethod]
    fn from_dict(values: &Bound<'_, PyAny>) -> Result<Self, PyError> {
        Self::checked(from_values::<Mechanism>(values)?.from_written_units())
    }

    /// Takes a mechanism from the values that a pickle holds.
    #[staticmethod]
    fn _restored(values: &Bound<'_, PyAny>) -> Result<Self, PyError> {
        Self::checked(from_values(values)?)
    }

    /// Copies and pickles by the plain values.
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyAny>,))> {
        let values = pythonize(slf.py(), &slf.get().0)?;
        Ok((slf.get_type().getattr("_restored")?, (values,)))
    }

    /// The mechanism as TOML text that `from_toml` reads back.
    fn to_toml(&self) -> String {
        self.0.to_toml()
    }

    /// The mechanism as plain values, keys and units as in the TOML.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize(py, &self.0.clone().in_written_units())?)
    }

    /// What people call it.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Unit of every length.
    #[getter]
    fn length_unit(&self) -> &str {
        &self.0.length_unit
    }

    /// Its sensors, in the order of the columns of readings.
    #[getter]
    fn channels(&self) -> Vec<PyChannel> {
        self.0.channels.iter().map(PyChannel::from).collect()
    }

    /// The same mechanism with sensors of another gain and offset: `{name: (gain, offset)}`.
    fn with_sensors(&self, sensors: HashMap<String, (f64, f64)>) -> Result<Self, PyError> {
        let mut mechanism = self.0.clone();
        for (name, (gain, offset)) in sensors {
            let c = mechanism.channel_index(&name)?;
            (mechanism.channels[c].gain, mechanism.channels[c].offset) = (gain, offset);
        }
        mechanism.validate()?;
        Ok(mechanism.into())
    }

    /// The same mechanism with more terms of its own.
    fn with_terms(&self, terms: Vec<PyRef<'_, PyTerm>>) -> Result<Self, PyError> {
        let mut mechanism = self.0.clone();
        mechanism.laws.extend(terms.iter().map(|term| term.0.clone()));
        mechanism.validate()?;
        check_names(&mechanism)?;
        Ok(mechanism.into())
    }

    /// Its terms beside those of the catalogue.
    #[getter]
    fn terms(&self) -> Vec<PyTerm> {
        self.0.laws.iter().cloned().map(PyTerm).collect()
    }

    /// Scalar equations of one sample.
    #[getter]
    fn equations(&self) -> usize {
        self.0.equations()
    }

    /// Text columns of the readings that its unknown points need.
    #[getter]
    fn key_columns(&self) -> Vec<String> {
        self.0.key_columns()
    }

    /// What is suspicious of it as it is declared, in words.
    #[getter]
    fn doubts(&self) -> Vec<String> {
        of_drawing(&self.0).into_iter().map(|warned| warned.text).collect()
    }

    /// Columns of the readings that hold measured distances.
    #[getter]
    fn distance_columns(&self) -> Vec<String> {
        self.0.distance_columns()
    }

    /// Columns of the readings with numbers that its closures, points and laws need.
    #[getter]
    fn value_columns(&self) -> Vec<String> {
        self.0.value_columns()
    }

    /// Columns of the readings that an instrument gives: coordinates of the points that it sees.
    #[getter]
    fn instrument_columns(&self) -> Vec<String> {
        self.0.instrument_columns()
    }

    /// Columns of numbers that no closure has of its own: what laws and drives use.
    #[getter]
    fn law_columns(&self) -> Vec<String> {
        self.0.law_columns()
    }

    /// Units of the columns that are declared for laws, by their names.
    #[getter]
    fn column_units(&self) -> HashMap<String, String> {
        let declared = self.0.columns.iter();
        declared.filter_map(|column| Some((column.name.clone(), column.unit.clone()?))).collect()
    }

    /// Columns of numbers that laws alone follow: readings may lack them.
    #[getter]
    fn optional_columns(&self) -> Vec<String> {
        self.0.optional_columns()
    }

    /// For each closure that samples take part in, the columns of its own: where one of them is blank in a row, the closure
    /// does not hold there.
    #[getter]
    fn own_columns(&self) -> Vec<Vec<String>> {
        let mechanism = &self.0;
        let closures = mechanism.closures.iter().enumerate();
        let sampled = closures.filter(|(_, closure)| !mechanism.is_link(closure));
        sampled.map(|(k, _)| mechanism.own_columns(k)).collect()
    }

    /// Joint coordinates that hold the platform at a pose, one per channel [rad].
    fn inverse(&self, pose: [f64; 6]) -> Result<Vec<f64>, PyError> {
        Ok(rsicalib::model::assembly::inverse(&self.0, &pose)?)
    }

    fn __repr__(&self) -> String {
        let Mechanism { name, length_unit, channels, chains, closures, .. } = &self.0;
        let count = |n: usize, word: &str| format!("{n} {word}{}", if n == 1 { "" } else { "s" });
        format!(
            "<Mechanism '{name}': {}, {}, {}, lengths in {length_unit}>",
            count(channels.len(), "channel"),
            count(chains.len(), "chain"),
            count(closures.len(), "closure"),
        )
    }

    /// What a notebook shows.
    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("rsicalib.io.mechanisms")?.getattr("mechanism_html")?.call1((slf,))
    }
}

impl PyMechanism {
    fn checked(mechanism: Mechanism) -> Result<Self, PyError> {
        mechanism.validate()?;
        check_names(&mechanism)?;
        Ok(mechanism.into())
    }
}

/// A term that is written as a formula: an entry `[[term]]` of a mechanism file.
#[pyclass(frozen, eq, skip_from_py_object, name = "Term", module = "rsicalib")]
#[derive(Clone, PartialEq)]
pub struct PyTerm(pub Law);

#[pymethods]
impl PyTerm {
    /// Takes the keys of such an entry; `class` is `klass` here.
    #[new]
    #[pyo3(signature = (id, *, klass, per, parameters, correction=None, moves=None, amount=None,
                        doc=None))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    fn new(
        py: Python<'_>,
        id: &str,
        klass: &str,
        per: &str,
        parameters: std::collections::BTreeMap<String, f64>,
        correction: Option<&str>,
        moves: Option<&str>,
        amount: Option<&str>,
        doc: Option<&str>,
    ) -> PyResult<Self> {
        let values = PyDict::new(py);
        let words =
            [("id", id), ("class", klass), ("per", per)].map(|(key, word)| (key, Some(word)));
        let more = [("correction", correction), ("moves", moves), ("amount", amount), ("doc", doc)];
        for (key, word) in words.into_iter().chain(more) {
            word.map(|word| values.set_item(key, word)).transpose()?;
        }
        values.set_item("parameters", parameters)?;
        Ok(Self::from_dict(&values)?)
    }

    /// Takes a term from plain values, keys as in the TOML.
    #[staticmethod]
    fn from_dict(values: &Bound<'_, PyAny>) -> Result<Self, PyError> {
        let law: Law = from_values(values)?;
        law.check()?;
        Ok(Self(law))
    }

    /// Copies and pickles by the plain values.
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyAny>,))> {
        let values = pythonize(slf.py(), &slf.get().0)?;
        Ok((slf.get_type().getattr("from_dict")?, (values,)))
    }

    /// The term as plain values, keys as in the TOML.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(pythonize(py, &self.0)?)
    }

    /// What scripts call it.
    #[getter]
    fn id(&self) -> &str {
        &self.0.id
    }

    fn __repr__(&self) -> String {
        let (key, text) = self.0.text();
        format!("Term({:?}, {key}={text:?})", self.0.id)
    }
}

#[derive(Serialize)]
struct ParameterView {
    name: &'static str,
    unit: &'static str,
    typical: f64,
}

#[derive(Serialize)]
struct TermView {
    id: &'static str,
    class: Class,
    doc: String,
    needs: &'static str,
    place: Option<&'static str>,
    parameters: Vec<ParameterView>,
    targets: Vec<String>,
}

/// Names of the rules of the search that can be switched off, to see what each is worth.
#[pyfunction]
pub fn rules() -> Vec<&'static str> {
    Rule::ALL.iter().map(|(name, _)| *name).collect()
}

/// Every term there is, with its targets in a mechanism.
#[pyfunction]
pub fn terms<'py>(py: Python<'py>, mechanism: &PyMechanism) -> PyResult<Bound<'py, PyAny>> {
    let views: Vec<TermView> = rsicalib::terms::all(&mechanism.0)
        .into_iter()
        .map(|term| {
            let info = term.info();
            let lines = info.doc.lines().map(|l| l.strip_prefix(' ').unwrap_or(l));
            TermView {
                id: info.id,
                class: info.class,
                doc: lines.collect::<Vec<_>>().join("\n"),
                needs: info.needs.words(),
                place: term.placed().words(),
                parameters: info
                    .parameters
                    .iter()
                    .map(|p| ParameterView { name: p.name, unit: p.unit, typical: p.typical })
                    .collect(),
                targets: targets(term, &mechanism.0)
                    .iter()
                    .chain(&shared(term, &mechanism.0))
                    .map(|t| t.name(&mechanism.0))
                    .collect(),
            }
        })
        .collect();
    Ok(pythonize(py, &views)?)
}
