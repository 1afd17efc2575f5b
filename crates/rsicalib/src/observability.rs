//! What the poses can and cannot tell apart.

use faer::{Mat, Side};

use crate::algebraic::Paper;
use crate::fit::Fit;
use crate::plan::Candidates;
use crate::result::parameter_names;
use crate::session::Session;
use crate::{Error, Mechanism};

/// Directions in the space of parameters, in words.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Directions {
    /// Those along which the data change nothing.
    pub unobservable: Vec<String>,
    /// Those that are known a hundred times worse than the best.
    pub weak: Vec<String>,
}

/// Names the directions that these poses cannot, or hardly, tell.
///
/// Eigenvectors of the Gram matrix with unit columns; each is described by the
/// parameters that take part, in the proportions of their own units.
#[must_use]
pub fn directions(session: &Session, fit: &Fit) -> Directions {
    let names: Vec<Label> = parameter_names(session, fit)
        .into_iter()
        .map(|p| Label { name: format!("{} {}", p.term, p.target), unit: p.unit })
        .collect();
    describe(&fit.gram, &names)
}

/// What a parameter is called, and its unit.
#[derive(Debug, Clone, PartialEq)]
struct Label {
    name: String,
    unit: String,
}

/// The same of a Gram matrix whose parameters have these names.
fn describe(gram: &Mat<f64>, names: &[Label]) -> Directions {
    let n = gram.nrows();
    let norms: Vec<f64> = (0..n).map(|i| gram[(i, i)].max(0.0).sqrt()).collect();
    let unit = unit_gram(gram, &norms);
    let mut out = Directions::default();
    for (k, norm) in norms.iter().enumerate() {
        if *norm == 0.0 {
            let name = &names[k].name;
            out.unobservable.push(format!("{name}: the readings do not depend on it"));
        }
    }
    let Ok(eigen) = unit.self_adjoint_eigen(Side::Lower) else { return out };
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    for k in 0..n {
        let relative = values[k] / values[n - 1];
        if relative > 1e-4 {
            break;
        }
        // Per unit of data: how far each parameter moves along this direction.
        let mut moves: Vec<(usize, f64)> =
            (0..n).filter(|&i| norms[i] > 0.0).map(|i| (i, vectors[(i, k)])).collect();
        moves.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        if moves.is_empty() {
            break; // nothing depends on anything: said above
        }
        let largest = moves.first().map_or(1.0, |m| m.1.abs());
        let shares: Vec<String> = moves
            .iter()
            .filter(|(_, v)| v.abs() > 0.2 * largest)
            .take(6)
            .map(|&(i, v)| {
                let by = v / norms[i] / (moves[0].1 / norms[moves[0].0]);
                let p = &names[i];
                let by = match by.abs() {
                    0.01..1e4 => format!("{by:+.3}"),
                    _ => format!("{by:+.2e}"),
                };
                format!("{by} {} {}", p.unit, p.name)
            })
            .collect();
        let words = shares.join(", ");
        if relative < 1e-11 {
            out.unobservable.push(format!("together: {words}"));
        } else {
            let i = moves[0].0;
            let far = 2.0 * (moves[0].1 / norms[i]).abs() / values[k].sqrt();
            let p = &names[i];
            out.weak.push(format!(
                "{words}: {} may be off by {:.2e} {} (2 sd) and the rest with it",
                p.name, far, p.unit
            ));
        }
    }
    out.weak.truncate(5);
    out
}

fn unit_gram(gram: &Mat<f64>, norms: &[f64]) -> Mat<f64> {
    let n = norms.len();
    Mat::from_fn(n, n, |i, j| {
        let norm = norms[i] * norms[j];
        if norm > 0.0 { gram[(i, j)] / norm } else { 0.0 }
    })
}

/// Condition number of the whitened Jacobian with unit columns, offsets at reading zero.
#[must_use]
pub fn uncentred_condition(fit: &Fit) -> f64 {
    let n = fit.gram.nrows();
    // X_uncentred = X T: the gain column gains the centre times the offset column.
    let mut map = Mat::<f64>::identity(n, n);
    for (c, scale) in fit.model.scales.iter().enumerate() {
        if let (Some(offset), Some(gain)) =
            (fit.model.column("offset", c), fit.model.column("gain", c))
        {
            map[(offset, gain)] = scale.centre;
        }
    }
    let gram = map.transpose() * &fit.gram * &map;
    crate::fit::invert(&gram).2
}

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
        SCALINGS.iter().find(|s| s.0 == name).map(|s| s.1).ok_or_else(|| Error::Unknown {
            kind: "scaling",
            found: name.into(),
            known: SCALINGS.map(|s| s.0).join(", "),
        })
    }
}

/// What the poses of a session can tell of the paper's offsets and gains.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Observability {
    /// Singular values of the scaled Jacobian (12), largest first.
    pub singular_values: Vec<f64>,
    /// The measures.
    pub measures: Measures,
    /// Directions that the poses cannot tell, in words.
    pub unobservable: Vec<String>,
    /// Directions that they hardly tell, in words.
    pub weak: Vec<String>,
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
    let told = Candidates::new(mechanism, counts.to_vec(), offsets, gains, &sigma)?;
    let Directions { unobservable, weak } = describe(&told.gram(), &labels);
    Ok(Observability {
        measures: Measures::of(&singular, rows),
        singular_values: singular,
        unobservable,
        weak,
    })
}
