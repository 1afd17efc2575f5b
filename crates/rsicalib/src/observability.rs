//! What the poses can and cannot tell apart.

use faer::{Mat, Side};

use crate::fit::Fit;
use crate::result::parameter_names;
use crate::session::Session;

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
    let n = fit.gram.nrows();
    let norms: Vec<f64> = (0..n).map(|i| fit.gram[(i, i)].max(0.0).sqrt()).collect();
    let unit = unit_gram(&fit.gram, &norms);
    let names = parameter_names(session, fit);
    let mut out = Directions::default();
    for (k, norm) in norms.iter().enumerate() {
        if *norm == 0.0 {
            out.unobservable.push(format!(
                "{} {}: the readings do not depend on it",
                names[k].term, names[k].target
            ));
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
        let largest = moves.first().map_or(1.0, |m| m.1.abs());
        let shares: Vec<String> = moves
            .iter()
            .filter(|(_, v)| v.abs() > 0.2 * largest)
            .take(6)
            .map(|&(i, v)| {
                let by = v / norms[i] / (moves[0].1 / norms[moves[0].0]);
                let p = &names[i];
                format!("{:+.3} {} {} {}", by, p.unit, p.term, p.target)
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
                "{words}: {} {} may be off by {:.2e} {} (2 sd) and the rest with it",
                p.term, p.target, far, p.unit
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

/// Measures of a Jacobian given by its Gram matrix, columns scaled by `scale`.
#[must_use]
pub fn measures(gram: &Mat<f64>, scale: &[f64], rows: usize) -> Measures {
    let n = gram.nrows();
    let scaled = Mat::from_fn(n, n, |i, j| gram[(i, j)] * scale[i] * scale[j]);
    let s: Vec<f64> = match scaled.self_adjoint_eigen(Side::Lower) {
        Ok(eigen) => (0..n).map(|k| eigen.S().column_vector()[k].max(0.0).sqrt()).collect(),
        Err(_) => vec![f64::NAN; n],
    };
    let (low, high) = (s[0], s[n - 1]);
    Measures {
        o1: (s.iter().map(|s| s.ln()).sum::<f64>() / n as f64).exp() / (rows as f64).sqrt(),
        o2: low / high,
        o3: low,
        o4: low * low / high,
        o5: 1.0 / s.iter().map(|s| 1.0 / (s * s)).sum::<f64>(),
        condition: high / low,
    }
}
