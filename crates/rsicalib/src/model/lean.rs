//! How planes and lines that lean from an axis hold points, and which are nearest to points.

use nalgebra::{Matrix3, SymmetricEigen, U3, Vector3};

/// Directions along which a plane or a line holds points, one for each equation, and their derivatives by two tilts.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Lean {
    /// Number of the equations.
    pub(crate) rows: usize,
    pub(crate) along: [[f64; 3]; 2],
    /// By each tilt, those of all directions.
    pub(crate) by_tilt: [[[f64; 3]; 2]; 2],
}

impl Lean {
    /// Along the normal of a plane.
    #[inline(always)]
    pub(crate) fn of_plane(axes: &[[f64; 3]; 3], tilts: [f64; 2]) -> Self {
        let [n, by_one, by_other] = leaning(axes, tilts);
        let one = |first| [first, [0.0; 3]];
        Self { rows: 1, along: one(n), by_tilt: [one(by_one), one(by_other)] }
    }

    /// Across a line of direction `n`.
    ///
    /// ```text
    /// w = e₂ - n (n · e₂),   u = w / |w|,   v = n × u
    /// ```
    #[inline(always)]
    pub(crate) fn of_line(axes: &[[f64; 3]; 3], tilts: [f64; 2]) -> Self {
        let [n, by_one, by_other] = leaning(axes, tilts);
        let e2 = &axes[1];
        let part = dot(&n, e2);
        let mut w = [0.0; 3];
        for i in 0..3 {
            w[i] = e2[i] - n[i] * part;
        }
        let by = 1.0 / dot(&w, &w).sqrt();
        let u = w.map(|w| w * by);
        let mut lean = Self { rows: 2, along: [u, cross(&n, &u)], by_tilt: [[[0.0; 3]; 2]; 2] };
        for (out, turn) in lean.by_tilt.iter_mut().zip([&by_one, &by_other]) {
            let part_by = dot(turn, e2);
            let mut dw = [0.0; 3];
            for i in 0..3 {
                dw[i] = -(turn[i] * part + n[i] * part_by);
            }
            let along = dot(&u, &dw);
            for i in 0..3 {
                out[0][i] = (dw[i] - u[i] * along) * by;
            }
            let (turned, moved) = (cross(turn, &u), cross(&n, &out[0]));
            for i in 0..3 {
                out[1][i] = turned[i] + moved[i];
            }
        }
        lean
    }
}

/// A unit vector that leans from the first axis of a frame by two tilts, and its derivatives by them.
///
/// ```text
/// m = e₁ + τ₁ e₂ + τ₂ e₃,   n = m / |m|,   ∂n/∂τ = (e - n (n · e)) / |m|          (48)
/// ```
#[inline(always)]
fn leaning(axes: &[[f64; 3]; 3], tilts: [f64; 2]) -> [[f64; 3]; 3] {
    let [e1, e2, e3] = axes;
    let mut m = [0.0; 3];
    let mut square = 0.0;
    for i in 0..3 {
        m[i] = e1[i] + tilts[0] * e2[i] + tilts[1] * e3[i];
        square += m[i] * m[i];
    }
    let by = 1.0 / square.sqrt();
    let n = [m[0] * by, m[1] * by, m[2] * by];
    let mut out = [n, [0.0; 3], [0.0; 3]];
    for (k, e) in [(1, e2), (2, e3)] {
        let along = n[0] * e[0] + n[1] * e[1] + n[2] * e[2];
        for i in 0..3 {
            out[k][i] = (e[i] - n[i] * along) * by;
        }
    }
    out
}

#[inline(always)]
fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(crate) fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// How points are spread about their middle.
pub(crate) struct Spread {
    middle: Vector3<f64>,
    eigen: SymmetricEigen<f64, U3>,
}

impl Spread {
    /// Of so many points at least.
    pub(crate) fn of(points: &[Vector3<f64>], fewest: usize) -> Option<Self> {
        if points.len() < fewest {
            return None;
        }
        let middle = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        let square = |p: &Vector3<f64>| (p - middle) * (p - middle).transpose();
        let squares: Matrix3<f64> = points.iter().map(square).sum();
        let eigen = squares.symmetric_eigen();
        eigen.eigenvectors.iter().all(|v| v.is_finite()).then_some(Self { middle, eigen })
    }

    /// The direction in which they are spread least, and their middle.
    pub(crate) fn least(self) -> [Vector3<f64>; 2] {
        let least = self.eigen.eigenvalues.imin();
        self.along(least)
    }

    /// The direction in which they are spread most, and their middle.
    pub(crate) fn most(self) -> [Vector3<f64>; 2] {
        let most = self.eigen.eigenvalues.imax();
        self.along(most)
    }

    fn along(self, axis: usize) -> [Vector3<f64>; 2] {
        [self.eigen.eigenvectors.column(axis).into_owned(), self.middle]
    }
}
