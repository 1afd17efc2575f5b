//! Tables of readings and of known poses, as Python holds them.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rsicalib::monitor::closing::SomePoses;
use rsicalib::readings::Table;
use rsicalib::report::result::Known;

/// One table of readings, as Python holds it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PyTable<'py> {
    values: PyReadonlyArray2<'py, f64>,
    pose: Option<PyReadonlyArray1<'py, i64>>,
    time: Option<PyReadonlyArray1<'py, f64>>,
    temperature: Option<PyReadonlyArray1<'py, f64>>,
    session: Option<Vec<usize>>,
    keys: Vec<Vec<String>>,
    columns: Vec<Vec<f64>>,
    /// Which rows count; `None`: all.
    used: Option<Vec<usize>>,
}

impl PyTable<'_> {
    /// The rows that count, owned by Rust: part of all.
    pub fn table(&self) -> Table {
        let all = self.all();
        match &self.used {
            Some(rows) => all.some(self.values.as_array().ncols(), rows),
            None => all,
        }
    }

    fn all(&self) -> Table {
        let column =
            |c: &Option<PyReadonlyArray1<'_, f64>>| c.as_ref().map(|c| c.as_array().to_vec());
        Table {
            values: self.values.as_array().iter().copied().collect(),
            pose: self.pose.as_ref().map(|p| p.as_array().to_vec()),
            time: column(&self.time),
            temperature: column(&self.temperature),
            session: self.session.clone(),
            keys: self.keys.clone(),
            columns: self.columns.clone(),
            part: None,
        }
    }
}

impl PyTable<'_> {
    /// Those of its rows, owned by Rust, by which the loops are looked at: of a recording not all.
    pub fn some_poses(&self) -> SomePoses {
        if self.used.is_some() {
            return SomePoses::of_table(&self.table(), self.values.as_array().ncols());
        }
        let pose = self.pose.as_ref().map(|p| p.as_array().to_vec());
        let samples = self.values.as_array().nrows();
        SomePoses::of(pose.as_deref(), samples, |rows| {
            rows.map_or_else(|| self.table(), |r| self.rows(r))
        })
    }

    /// Some rows, owned by Rust.
    fn rows(&self, rows: &[usize]) -> Table {
        let column = |c: &Option<PyReadonlyArray1<'_, f64>>| {
            c.as_ref().map(|c| rows.iter().map(|&row| c.as_array()[row]).collect())
        };
        let values = self.values.as_array();
        Table {
            values: rows.iter().flat_map(|&row| values.row(row).to_vec()).collect(),
            pose: self.pose.as_ref().map(|p| rows.iter().map(|&row| p.as_array()[row]).collect()),
            time: column(&self.time),
            temperature: column(&self.temperature),
            session: self.session.as_ref().map(|s| rows.iter().map(|&row| s[row]).collect()),
            keys: self.keys.iter().map(|k| rows.iter().map(|&r| k[r].clone()).collect()).collect(),
            columns: self.columns.iter().map(|c| rows.iter().map(|&r| c[r]).collect()).collect(),
            part: None,
        }
    }
}

/// Poses, row by row.
pub fn poses_of(poses: &PyReadonlyArray2<'_, f64>) -> Vec<[f64; 6]> {
    poses.as_array().rows().into_iter().map(|r| std::array::from_fn(|i| r[i])).collect()
}

/// Known poses as Python gives them: a table, the poses, row by row, their standard deviations, the point whose
/// places they are, and whether the table says what closures touch and measure.
pub type PyKnown<'py> = (PyTable<'py>, PyReadonlyArray2<'py, f64>, [f64; 2], Option<String>, bool);

/// The same, owned by Rust.
pub fn known_of((table, poses, noise, point, closes): PyKnown<'_>, align: bool) -> Known {
    Known { table: table.table(), poses: poses_of(&poses), noise, point, align, closes }
}
