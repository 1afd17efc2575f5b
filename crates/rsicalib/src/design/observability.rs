//! What the poses can and cannot tell apart.

use faer::Mat;

use crate::Error;
use crate::design::bound::information;
use crate::error::index_of;
use crate::estimate::directions::{Direction, Directions, Label, describe};
use crate::estimate::paper::Paper;
use crate::mechanism::Mechanism;

/// The measures of Table VIII for singular values `s` of a scaled Jacobian.
///
/// | measure | of | |
/// |---|---|---|
/// | O1 | Borm & Menq 1991 | geometric mean of the singular values, over √rows |
/// | O2 | Driels & Pathre 1990 | smallest over largest |
/// | O3 | Nahvi et al. 1994 | smallest |
/// | O4 | Nahvi & Hollerbach 1996 | smallest squared over largest |
/// | O5 | Sun & Hollerbach 2008 | harmonic mean of the squares, `1/Σ 1/s²` |
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Measures {
    /// Observability index of Borm & Menq.
    pub o1: f64,
    /// Inverse condition number.
    pub o2: f64,
    /// Smallest singular value.
    pub o3: f64,
    /// Noise amplification index.
    pub o4: f64,
    /// Inverse of the summed variances.
    pub o5: f64,
    /// Largest over smallest.
    pub condition: f64,
}

impl Measures {
    /// Of singular values in any order, of a Jacobian of so many rows.
    #[must_use]
    pub fn of(singular: &[f64], rows: usize) -> Self {
        let low = singular.iter().copied().fold(f64::INFINITY, f64::min);
        let high = singular.iter().copied().fold(0.0, f64::max);
        let logs: f64 = singular.iter().map(|s| s.ln()).sum();
        Self {
            o1: (logs / singular.len() as f64).exp() / (rows as f64).sqrt(),
            o2: low / high,
            o3: low,
            o4: low * low / high,
            o5: 1.0 / singular.iter().map(|s| 1.0 / (s * s)).sum::<f64>(),
            condition: high / low,
        }
    }
}

/// How the columns of a Jacobian are scaled before its singular values mean anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scaling {
    /// As they are: rad beside rad/count.
    None,
    /// To length one.
    UnitColumns,
    /// By what each parameter does to the points that the closures hold: root
    /// mean square over poses and points (Schröer 1993, as the paper uses it).
    Points,
}

/// Names of the scalings, as users write them.
pub const SCALINGS: [(&str, Scaling); 3] = [
    ("none", Scaling::None),
    ("unit_columns", Scaling::UnitColumns),
    ("wrist_position", Scaling::Points),
];

impl Scaling {
    /// The scaling of a name.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] with the names there are.
    pub fn find(name: &str) -> Result<Self, Error> {
        Ok(SCALINGS[index_of(&SCALINGS, |s| s.0, "scaling", name)?].1)
    }
}

/// What the poses of a session can tell of the paper's offsets and gains.
#[derive(Debug, Clone, PartialEq)]
pub struct Observability {
    /// Singular values of the scaled Jacobian (12), largest first.
    pub singular_values: Vec<f64>,
    /// The measures.
    pub measures: Measures,
    /// Directions that the poses cannot tell.
    pub unobservable: Vec<Direction>,
    /// Directions that they hardly tell.
    pub weak: Vec<Direction>,
}

/// Observability of offsets and gains by eq. (10), all closures alike.
///
/// # Errors
///
/// As [`Paper::new`].
pub fn observability(
    mechanism: &Mechanism,
    counts: &[f64],
    offsets: &[f64],
    gains: &[f64],
    scaling: Scaling,
) -> Result<Observability, Error> {
    let paper = Paper::new(mechanism, counts)?;
    let (rows, columns) = (paper.equations(), offsets.len() + gains.len());
    let jacobian = paper.jacobian(offsets, gains)?;
    let at = |i: usize, j: usize| jacobian[i * columns + j];
    let scale: Vec<f64> = match scaling {
        Scaling::None => vec![1.0; columns],
        Scaling::UnitColumns => {
            let norm = |j| (0..rows).map(|i| at(i, j).powi(2)).sum::<f64>().sqrt();
            (0..columns).map(norm).collect()
        }
        Scaling::Points => paper.point_effects(offsets, gains)?,
    };
    let by = |j: usize| if scale[j] > 0.0 { 1.0 / scale[j] } else { 0.0 };
    let scaled = Mat::from_fn(rows, columns, |i, j| at(i, j) * by(j));
    let mut singular: Vec<f64> = match scaled.singular_values() {
        Ok(values) => values,
        Err(_) => vec![f64::NAN; columns.min(rows)],
    };
    singular.resize(columns, 0.0); // fewer equations than parameters
    let labels: Vec<Label> = ["offset", "gain"]
        .iter()
        .flat_map(|term| mechanism.channels.iter().map(move |c| (*term, c)))
        .map(|(term, c)| Label {
            name: format!("{term} {}", c.name),
            unit: if term == "gain" { format!("rad/{}", c.unit) } else { "rad".into() },
        })
        .collect();
    // In words: what one unit of noise per reading leaves open.
    let sigma: Vec<f64> = mechanism.channels.iter().map(|c| c.noise.unwrap_or(1.0)).collect();
    let told = information(mechanism, counts, offsets, gains, &sigma)?;
    let Directions { unobservable, weak, .. } = describe(&told, &labels);
    Ok(Observability {
        measures: Measures::of(&singular, rows),
        singular_values: singular,
        unobservable,
        weak,
    })
}
