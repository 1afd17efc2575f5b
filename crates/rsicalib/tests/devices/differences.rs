//! Analytic derivatives of a model against differences.

use std::ops::Range;

use rsicalib::model::{Model, Want, Workspace};
use rsicalib::numerics::lanes::Lanes;
use rsicalib::readings::Readings;

use super::devices::derivative;

/// Terms of every stage; those that a device has no data for are left out.
pub const EVERY_STAGE: [&str; 14] = [
    "reference_temperature",
    "channel_skew",
    "crosstalk",
    "offset",
    "gain",
    "curvature",
    "hysteresis",
    "slip",
    "link_length",
    "joint_tilt",
    "base_tilt",
    "sag",
    "joint_compliance",
    "distance",
];

/// A free curve stays as it is beyond the span of the readings, where its second derivative jumps:
/// the span is made wider by more than steps and lags, so that no difference goes over that corner.
fn away_from_corners(model: &Model) -> Model {
    let mut model = model.clone();
    for scale in &mut model.scales {
        let [low, high] = scale.span;
        scale.span = [low - 0.5 * (high - low), high + 0.5 * (high - low)];
    }
    model
}

/// Checks columns of `X` in every sample.
pub fn check_parameters(model: &Model, readings: &Readings, beta: &[f64], columns: Range<usize>) {
    let model = &away_from_corners(model);
    let workspaces = every_block(model, readings, beta);
    let places = every_place(model, readings, beta);
    check_active(model, &workspaces);
    for column in columns {
        let blocks = workspaces.iter().zip(readings.blocks());
        let analytic: Vec<f64> = blocks
            .flat_map(|(ws, block)| {
                let here = model.columns()[block.group].iter().position(|c| *c == column);
                let row = |k: usize| here.map_or(Lanes::ZERO, |i| ws.x[k * model.width() + i]);
                (0..model.rows()).flat_map(|k| row(k).0).collect::<Vec<_>>()
            })
            .collect();
        let largest = largest(&analytic);
        // A step that moves a length by 1e-4 in, or twice the size of the parameter: some f are
        // areas, others lengths.
        let (lengths, lanes) = (model.lengths(), Lanes::ZERO.0.len());
        let of_length = analytic.iter().enumerate().fold(0.0_f64, |most, (i, slope)| {
            most.max(slope.abs() * lengths[i / lanes % lengths.len()])
        });
        // The phase of a wave turns by its order times some radians: not by more than 0.02 of these.
        let h = (1e-4 / of_length).min(2.0 * beta[column].abs()).min(0.02);
        let moved = |by: f64| {
            let mut beta = beta.to_vec();
            beta[column] += by;
            misclosure(model, readings, &places, &beta, (0, 0.0))
        };
        // Of angles h is near 1e-4: h⁴/480 of the fifth derivative is below 1e-10
        // of the first even through a free curve; rounding of f, 1e-13 in², over h too.
        // What begins as the root of its parameter asks for a smaller step.
        let far_at = |h: f64| {
            let tolerance = 1e-8 * largest + 1e-12 / h;
            let pairs = analytic.iter().zip(derivative(moved, h)).enumerate();
            let far = |(_, (analytic, difference)): &(usize, (&f64, f64))| {
                let off = (*analytic - difference).abs();
                off.is_nan() || off > tolerance
            };
            pairs.filter(far).map(|(i, (_, difference))| (i, difference)).collect::<Vec<_>>()
        };
        let far = far_at(h);
        if far.is_empty() {
            continue;
        }
        let still: Vec<usize> = far_at(h / 16.0).iter().map(|(i, _)| *i).collect();
        for (i, difference) in far {
            assert!(
                !still.contains(&i),
                "{}, {}: {} should be {difference}, h = {h:e}",
                model.mechanism.name,
                called(model, column),
                analytic[i],
            );
        }
    }
}

/// Checks that no column of an equation is left out of those that the model says it has.
fn check_active(model: &Model, workspaces: &[Workspace]) {
    let active = model.active();
    for ws in workspaces {
        for (k, row) in ws.x.chunks_exact(model.width().max(1)).enumerate() {
            for (column, x) in row.iter().enumerate().filter(|(c, _)| !active[k].contains(c)) {
                assert!(x.0.iter().all(|x| *x == 0.0), "{}, {k}, {column}", model.mechanism.name);
            }
        }
    }
}

/// Checks `A` in every sample, and `B`.
pub fn check_readings(model: &Model, readings: &Readings, beta: &[f64]) {
    let model = &away_from_corners(model);
    let workspaces = every_block(model, readings, beta);
    let places = every_place(model, readings, beta);
    for own in 0..model.stride() {
        let coordinate = own.checked_sub(readings.channels);
        let entries = |ws: &Workspace| -> Vec<f64> {
            let (all, column, width) = match coordinate {
                None => (&ws.a, own, readings.channels),
                Some(k) => (&ws.b, k, model.pose_unknowns()),
            };
            all.iter().skip(column).step_by(width).flat_map(|lanes| lanes.0).collect()
        };
        let analytic: Vec<f64> = workspaces.iter().flat_map(entries).collect();
        // 2e-4 rad, of the shortest wave of a free curve 3e-3 of its period: h⁴/480 of the fifth
        // derivative stays below 1e-10, as does rounding of f over h; so it does for a distance
        // between points that are a twentieth of an arm apart.
        let per = coordinate.map_or_else(|| model.scales[own].gain.abs(), |_| 1.0);
        let h = 2e-4 / per;
        let tolerance = 1e-8 * largest(&analytic);
        let at = |h: f64| derivative(|by| misclosure(model, readings, &places, beta, (own, by)), h);
        let differences = at(h);
        let near = |(a, d): (&f64, &f64)| (a - d).abs() <= tolerance;
        // A step may go over the place at which a load changes its side: a hundredth of it seldom does, and rounding
        // of f over that is 1e-7.
        let (differences, tolerance) = match analytic.iter().zip(&differences).all(near) {
            true => (differences, tolerance),
            false => (at(0.01 * h), 1e-7 * largest(&analytic)),
        };
        for (analytic, difference) in analytic.iter().zip(differences) {
            assert!(
                (analytic - difference).abs() <= tolerance,
                "{}, {own} of a sample: {analytic} should be {difference}",
                model.mechanism.name
            );
        }
    }
}

/// What a column belongs to.
fn called(model: &Model, column: usize) -> String {
    let Some(k) = model.first.iter().rposition(|first| *first <= column) else {
        return format!("point, column {column}");
    };
    let instance = &model.instances[k];
    let (id, target) = (instance.term.info().id, instance.target.name(&model.mechanism));
    format!("{id}@{target}, {}", column - model.first[k])
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, v| v.abs().max(m))
}

/// Misclosure and all derivatives of one block.
pub fn evaluated(
    model: &Model,
    readings: &Readings,
    block: usize,
    a: &[Lanes],
    beta: &[f64],
) -> Workspace {
    let mut ws = Workspace::default();
    model.evaluate(readings, block, a, beta, Want { x: true, a: true }, &mut ws);
    ws
}

/// Readings of a block, and after them where that is which is somewhere else in each pose: differences
/// leave it there.
pub fn placed(model: &Model, readings: &Readings, block: usize, beta: &[f64]) -> Vec<Lanes> {
    let mut ws = Workspace::default();
    let raw = readings.raw(block);
    model.evaluate(readings, block, raw, beta, Want { x: false, a: false }, &mut ws);
    [raw, &ws.xi].concat()
}

/// The same of every block.
fn every_place(model: &Model, readings: &Readings, beta: &[f64]) -> Vec<Vec<Lanes>> {
    (0..readings.blocks().len()).map(|block| placed(model, readings, block, beta)).collect()
}

fn every_block(model: &Model, readings: &Readings, beta: &[f64]) -> Vec<Workspace> {
    let blocks = 0..readings.blocks().len();
    blocks.map(|b| evaluated(model, readings, b, readings.raw(b), beta)).collect()
}

/// The misclosure of every sample, with one reading or coordinate of a pose by so much another.
fn misclosure(
    model: &Model,
    readings: &Readings,
    places: &[Vec<Lanes>],
    beta: &[f64],
    (own, by): (usize, f64),
) -> Vec<f64> {
    let mut f = Vec::new();
    let mut ws = Workspace::default();
    for (block, place) in places.iter().enumerate() {
        let mut a = place.clone();
        a[own] += Lanes::splat(by);
        model.evaluate(readings, block, &a, beta, Want { x: false, a: false }, &mut ws);
        f.extend(ws.f.iter().flat_map(|f| f.0));
    }
    f
}
