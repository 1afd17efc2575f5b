//! Python bindings: conversions only.

mod apply;
mod design;
mod devices;
mod documents;
mod error;
mod experiments;
mod history;
mod mechanism;
mod monitor;
mod numbers;
mod observations;
mod options;
mod population;
mod raw;
mod tables;
mod threads;
mod values;

use pyo3::PyClass;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use rsicalib::design::criterion::CRITERIA;
use rsicalib::design::identifiability::COMPLETE;
use rsicalib::design::observability::SCALINGS;
use rsicalib::design::plan::MARGIN;
use rsicalib::diagnosis::verdict::Verdict;
use rsicalib::model::UNKNOWN_THINGS;
use rsicalib::monitor::MonitorOptions;

/// The compiled core of rsicalib.
#[pymodule]
mod _core {
    use super::*;

    #[pymodule_export]
    use super::{
        apply::{
            calibrated_sensors, check, compared, declared, exported, fixture, joint_coordinates,
            judged_open_loop, lasting, places, spec, unit_of_key, units_of,
        },
        design::{
            bound_at, further, guided_done, identifiable, needed_poses, plan, traceable, workspace,
        },
        devices::calibrate_devices,
        documents::{
            certify, evidence_schema, mechanism_schema, read_result, schemas, written_keys,
        },
        experiments::{
            angles_at, bound, jacobian, means_of_samples, minimize, misclosure, observability,
            readings_at, rsi_angles, rsi_poses, within_limits,
        },
        history::history,
        mechanism::{rules, terms},
        monitor::{expects_more, open_loops, rms_misclosure},
        numbers::plain_numbers,
        population::{
            beyond_chance, centre_of_population, common_shifts, distances, population, shares,
            standing_out, summed, usual,
        },
        raw::{still_stretches, suspects, unlabelled},
    };

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        let verdicts: Vec<(&str, u8)> =
            Verdict::ALL.iter().map(|v| (v.id(), v.exit_code())).collect();
        module.add("VERDICTS", verdicts)?;
        module.add("COMPLETE", PyTuple::new(module.py(), COMPLETE)?)?;
        module.add("UNKNOWN_THINGS", PyTuple::new(module.py(), UNKNOWN_THINGS)?)?;
        module.add("CRITERIA", PyTuple::new(module.py(), CRITERIA.map(|c| c.0))?)?;
        module.add("MARGIN", MARGIN)?;
        module.add("LARGEST", rsicalib::numerics::bounds::LARGEST)?;
        module.add("FALSE_ALARMS", MonitorOptions::default().false_alarms)?;
        module.add("SCALINGS", PyTuple::new(module.py(), SCALINGS.map(|s| s.0))?)?;
        add_class::<mechanism::PyMechanism>(module)?;
        add_class::<mechanism::PyChannel>(module)?;
        add_class::<mechanism::PyTerm>(module)?;
        add_class::<observations::PyObservations>(module)?;
        add_class::<observations::PyFit>(module)?;
        add_class::<observations::PyEvidenceSource>(module)?;
        add_class::<monitor::PyMonitor>(module)?;
        add_class::<apply::PyPlacer>(module)?;
        Ok(())
    }
}

/// Adds a class whose values lie where Python's allocator puts an object.
///
/// Python aligns an object to two words, whatever its fields ask for: a value of more alignment, as
/// one with vector lanes in it, lies wrong in memory, and its aligned loads end the process. Such a
/// field is boxed.
fn add_class<T: PyClass>(module: &Bound<'_, PyModule>) -> PyResult<()> {
    const { assert!(align_of::<T>() <= 2 * size_of::<usize>(), "box the field with vector lanes") };
    module.add_class::<T>()
}
