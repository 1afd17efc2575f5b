//! Derivatives of where a fit puts the platform, or the points that chains carry.
//!
//! With the misclosure's derivatives `A` by readings and `X` by parameters, `S = A Σ Aᵀ + Π`, and
//! those of carried points, `P_a` and `P_β`,
//!
//! ```text
//! ∂â/∂a = 1 - Σ Aᵀ S⁻¹ A,    ∂â/∂β = -Σ Aᵀ S⁻¹ X          of (52), to first order
//! ∂p/∂a = P_a ∂â/∂a,         ∂p/∂β = P_β + P_a ∂â/∂β                      (100)
//! ```
//!
//! and a platform with points `q` about its origin, at rotation `R`, follows them by
//! `(ΣCᵀC)⁻¹ ΣCᵀ δp`, `C = [1, -(R q)×]`.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Rotation3, Vector3};

use crate::Error;
use crate::apply::poses::{Platform, settled_blocks};
use crate::estimate::Noise;
use crate::mechanism::{Closure, Mechanism, Point};
use crate::model::{Model, Want, Workspace};
use crate::readings::Readings;

/// Derivatives of the coordinates of one sample.
#[derive(Clone)]
pub(crate) struct Slopes {
    /// The sample.
    pub row: usize,
    /// Coordinate by coordinate, one column for each parameter.
    pub by_parameter: DMatrix<f64>,
    /// Coordinate by coordinate, one column for each channel.
    pub by_reading: DMatrix<f64>,
    /// Where the points are whose coordinates these are; none of a platform.
    pub points: Vec<Vector3<f64>>,
}

impl Slopes {
    /// How coordinates move with a change of these parameters.
    pub(crate) fn moved(&self, change: &[(usize, f64)]) -> DVector<f64> {
        let none = DVector::zeros(self.by_parameter.nrows());
        change
            .iter()
            .fold(none, |moved, (column, by)| moved + self.by_parameter.column(*column) * *by)
    }
}

/// Of `x y z rx ry rz` of the platform, in every `stride`-th block of readings.
///
/// # Errors
///
/// As [`Model::like`].
pub(crate) fn platform_slopes(
    model: &Model,
    readings: &Readings,
    beta: &[f64],
    noise: &Noise,
    stride: usize,
) -> Result<Vec<Slopes>, Error> {
    let platform = Platform::of(&model.mechanism);
    let held = Held::new(model, readings, &platform.points)?;
    let (mut ws, mut points) = (Workspace::default(), Workspace::default());
    let want = Want { x: true, a: true };
    let play = noise.of_closures(model).whole();
    let mut slopes = Vec::new();
    for (block, a) in settled_blocks(model, readings, beta, noise, stride) {
        model.evaluate(readings, block, &a, beta, want, &mut ws);
        held.model.evaluate(readings, block, &a, beta, want, &mut points);
        let meta = &readings.blocks()[block];
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            let (loops, _) = lane_of(model, &ws, meta.group, lane, 0..model.equations());
            let (moved, at) = lane_of(&held.model, &points, meta.group, lane, held.rows());
            let moved = moved.on_closures(&loops, &noise.sigma, &play);
            let follows = follows(&platform.places, &at);
            slopes.push(Slopes {
                row,
                by_parameter: &follows * moved.by_parameter,
                by_reading: &follows * moved.by_reading,
                points: Vec::new(),
            });
        }
    }
    Ok(slopes)
}

/// Of `x y z` of all points that chains carry, point by point, the readings as they are, in every
/// `stride`-th block.
///
/// # Errors
///
/// As [`Model::like`].
pub(crate) fn carried_slopes(
    model: &Model,
    readings: &Readings,
    beta: &[f64],
    stride: usize,
) -> Result<Vec<Slopes>, Error> {
    let points = &model.mechanism.points;
    let carried: Vec<usize> = (0..points.len()).filter(|&p| points[p].chain.is_some()).collect();
    let held = Held::new(model, readings, &carried)?;
    let mut ws = Workspace::default();
    let mut slopes = Vec::new();
    for (block, meta) in readings.blocks().iter().enumerate().step_by(stride) {
        let want = Want { x: true, a: true };
        held.model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            let (Moves { by_parameter, by_reading }, at) =
                lane_of(&held.model, &ws, meta.group, lane, held.rows());
            let points = at.chunks_exact(3).map(Vector3::from_column_slice).collect();
            slopes.push(Slopes { row, by_parameter, by_reading, points });
        }
    }
    Ok(slopes)
}

/// A model with some points held at the origin of the base as well: what is left open there is
/// where they are.
struct Held {
    model: Model,
    /// The first equation of those points.
    first: usize,
}

impl Held {
    fn new(model: &Model, readings: &Readings, points: &[usize]) -> Result<Self, Error> {
        let mut mechanism: Mechanism = model.mechanism.clone();
        let first = mechanism.equations();
        // A name that no file has.
        let origin = "the origin of the base".to_owned();
        let at = Some([0.0; 3]);
        mechanism.points.push(Point { name: origin.clone(), at, ..Point::default() });
        for &point in points {
            let name = mechanism.points[point].name.clone();
            let where_it_is = format!("where {name} is");
            mechanism.closures.push(Closure::touch(where_it_is, [name, origin.clone()]));
        }
        Ok(Self { model: model.with_closures_of(&mechanism, readings)?, first })
    }

    fn rows(&self) -> std::ops::Range<usize> {
        self.first..self.model.equations()
    }
}

/// Derivatives of some equations of one sample.
struct Moves {
    by_parameter: DMatrix<f64>,
    by_reading: DMatrix<f64>,
}

/// One lane of some equations: their derivatives, and what they are.
fn lane_of(
    model: &Model,
    ws: &Workspace,
    group: usize,
    lane: usize,
    rows: std::ops::Range<usize>,
) -> (Moves, Vec<f64>) {
    let (width, channels) = (model.width(), model.scales.len());
    let mut by_parameter = DMatrix::zeros(rows.len(), model.parameters);
    for (i, e) in rows.clone().enumerate() {
        for (&column, x) in model.columns()[group].iter().zip(&ws.x[e * width..]) {
            by_parameter[(i, column)] = x.0[lane];
        }
    }
    let first = rows.start;
    let by_reading =
        DMatrix::from_fn(rows.len(), channels, |i, c| ws.a[(first + i) * channels + c].0[lane]);
    (Moves { by_parameter, by_reading }, rows.map(|e| ws.f[e].0[lane]).collect())
}

impl Moves {
    /// (100), of points whose readings are moved onto the closures.
    fn on_closures(self, loops: &Self, sigma: &[f64], play: &[f64]) -> Self {
        let (a, channels) = (&loops.by_reading, sigma.len());
        let weighted = DMatrix::from_fn(channels, a.nrows(), |c, e| a[(e, c)] * sigma[c].powi(2));
        let mut s = a * &weighted;
        play.iter().enumerate().for_each(|(e, play)| s[(e, e)] += play);
        // Σ Aᵀ S⁻¹; equations that say the same have no inverse.
        let gain = match s.clone().cholesky() {
            Some(factor) => factor.solve(&weighted.transpose()).transpose(),
            None => {
                let inverse = s.pseudo_inverse(f64::EPSILON * weighted.norm());
                &weighted * inverse.unwrap_or_else(|_| DMatrix::zeros(a.nrows(), a.nrows()))
            }
        };
        let along = &self.by_reading * gain;
        let by_parameter = self.by_parameter - &along * &loops.by_parameter;
        let by_reading = self.by_reading - along * a;
        Self { by_parameter, by_reading }
    }
}

/// How `x y z rx ry rz` of a platform follow its points, in least squares: `at` holds their places
/// one after another, `q` those about its origin.
fn follows(q: &[Vector3<f64>], at: &[f64]) -> DMatrix<f64> {
    let r: Vec<Vector3<f64>> = at.chunks_exact(3).map(Vector3::from_column_slice).collect();
    let pose = crate::kinematics::rigid::rigid_fit(q, &r);
    let rotation = Rotation3::from_euler_angles(pose[3], pose[4], pose[5]);
    let mut c = DMatrix::zeros(at.len(), 6);
    for (k, q) in q.iter().enumerate() {
        c.fixed_view_mut::<3, 3>(3 * k, 0).fill_with_identity();
        c.fixed_view_mut::<3, 3>(3 * k, 3).copy_from(&-(rotation * q).cross_matrix());
    }
    let square: Matrix6<f64> = (c.transpose() * &c).fixed_view::<6, 6>(0, 0).into();
    let inverse = square.try_inverse().unwrap_or_else(Matrix6::zeros);
    // Turns about the axes of the base as rates of roll, pitch and yaw: R = Rz Ry Rx.
    let (_, pitch, yaw) = rotation.euler_angles();
    let turn = Rotation3::from_euler_angles(0.0, 0.0, yaw);
    let axes = [
        turn * Rotation3::from_euler_angles(0.0, pitch, 0.0) * Vector3::x(),
        turn * Vector3::y(),
        Vector3::z_axis().into_inner(),
    ];
    let rates = Matrix3::from_columns(&axes).try_inverse().unwrap_or_else(Matrix3::zeros);
    let mut of = Matrix6::identity();
    of.fixed_view_mut::<3, 3>(3, 3).copy_from(&rates);
    let follows = of * inverse;
    DMatrix::from_fn(6, 6, |i, j| follows[(i, j)]) * c.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_platform_follows_its_points() {
        let q = [[1.0, 0.2, 0.1], [-0.4, 0.9, 0.0], [-0.6, -1.1, 0.3], [0.1, 0.0, -0.7]];
        let q = q.map(Vector3::from);
        let turned = Rotation3::from_euler_angles(0.3, -0.5, 1.1);
        let place = |k: usize| turned * q[k] + Vector3::new(0.4, -0.2, 2.0);
        let at: Vec<f64> =
            (0..4).flat_map(|k| place(k).iter().copied().collect::<Vec<_>>()).collect();
        let slopes = follows(&q, &at);
        let pose = |at: &[f64]| {
            let r: Vec<_> = at.chunks_exact(3).map(Vector3::from_column_slice).collect();
            crate::kinematics::rigid::rigid_fit(&q, &r)
        };
        let step = 1e-5;
        for k in 0..12 {
            let moved = |by: f64| {
                let mut at = at.clone();
                at[k] += by;
                pose(&at)
            };
            let (up, down) = (moved(step), moved(-step));
            for i in 0..6 {
                let difference = (up[i] - down[i]) / (2.0 * step);
                // Central differences: the cube of the step, and rounding over the step.
                assert!((slopes[(i, k)] - difference).abs() < 1e-8, "{i} by {k}");
            }
        }
    }
}
