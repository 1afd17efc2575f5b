//! Codes and faults of converters.

use std::borrow::Cow;

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rsicalib::readings::codes;
use rsicalib::screening::converter::of_codes;
use rsicalib::screening::fault::FaultKind;

/// Stuck bits `[(bit, value)]`, and the code at which it is clipped, with its poses.
type PyFault = (usize, Vec<(u32, bool)>, Option<(f64, Vec<usize>)>);

/// Faults of converters: channel, stuck bits and their values, clipped at and in which poses.
///
/// `values` has shape (n, channels), `counts` says which are read in whole counts, `pose` numbers
/// the pose of each row from 0.
#[pyfunction]
pub fn faults(
    values: PyReadonlyArray2<'_, f64>,
    counts: Vec<bool>,
    pose: PyReadonlyArray1<'_, usize>,
    held: bool,
) -> Vec<PyFault> {
    let pose = pose.as_array().to_vec();
    let found = of_codes(&in_rows(&values), &counts, &pose, held).into_iter();
    found
        .map(|fault| match fault.kind {
            FaultKind::StuckBits(bits) => (fault.channel, bits, None),
            FaultKind::Clipped { at, poses } => (fault.channel, Vec::new(), Some((at, poses))),
        })
        .collect()
}

/// The step of each channel, shape (channels,): of a counter a count or more; zero where readings
/// lie on no grid.
///
/// `values` has shape (n, channels), `counts` says which are read in whole counts.
#[pyfunction]
pub fn steps(values: PyReadonlyArray2<'_, f64>, counts: Vec<bool>) -> Vec<f64> {
    codes::steps(&in_rows(&values), &counts)
}

/// The numbers of an array, row by row: as it holds them, where it does.
fn in_rows<'a>(values: &'a PyReadonlyArray2<'_, f64>) -> Cow<'a, [f64]> {
    let copied = || values.as_array().iter().copied().collect();
    values.as_array().to_slice().map_or_else(copied, Cow::Borrowed)
}
