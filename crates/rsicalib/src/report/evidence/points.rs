//! Joints and carried points of a mechanism in base coordinates, row by row.

use nalgebra::Vector3;

use crate::estimate::settle::settled;
use crate::estimate::{Noise, Part};
use crate::kinematics::elements::Source;
use crate::kinematics::rigid::rigid_fit;
use crate::model::{Model, Want, Workspace};
use crate::numerics::lanes::Vec3;
use crate::readings::Readings;

/// One row: its number, the coordinates of all nodes, and the place of what is carried.
pub struct Row {
    pub row: usize,
    pub nodes: Vec<[f64; 3]>,
    pub place: [f64; 3],
}

/// True where the closures place what is carried: on a platform. Elsewhere each chain places its
/// own points.
pub fn has_platform(model: &Model) -> bool {
    !model.mechanism.platform.is_empty() && model.unknowns.is_empty()
}

/// Nodes in every `stride`-th block: for each chain its joints, base first, then the points that
/// it carries; then the points between closures. Under a platform, and where points are somewhere
/// else in each pose, readings are first moved onto the closures, as far as their noise allows.
pub fn points(
    model: &Model,
    readings: &Readings,
    beta: &[f64],
    noise: &Noise,
    stride: usize,
) -> Vec<Row> {
    let part = Part { model, readings, weights: None };
    let mechanism = &model.mechanism;
    let between = model.between_closures();
    let mut rows = Vec::new();
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate().step_by(stride) {
        let on_closures = match has_platform(model) || !model.posed.points.is_empty() {
            true => settled(&part, noise, block, beta),
            false => readings.raw(block).to_vec(),
        };
        model.evaluate(readings, block, &on_closures, beta, Want { x: false, a: false }, &mut ws);
        let carried = model.points(&ws, beta);
        let mut nodes: Vec<Vec3> = Vec::new();
        for (chain, posture) in ws.postures.iter().enumerate() {
            let joints = posture.levers.iter();
            let read = joints.filter(|lever| matches!(lever.source, Source::Channel(_)));
            nodes.extend(read.map(|lever| lever.origin));
            nodes.extend(of_chain(model, chain).filter_map(|p| carried[p]));
        }
        let between =
            between.iter().map(|b| (b, model.end_point(&b.end, meta.group, &[], beta, &ws)));
        let between: Vec<_> = between.collect();
        let moving = between.iter().find(|(b, _)| b.moves()).map(|(_, at)| *at);
        nodes.extend(between.iter().map(|(_, at)| *at));
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            let at = |v: &Vec3| v.map(|coordinate| coordinate.0[lane]);
            let on_platform = mechanism.points.iter().zip(&carried).filter_map(|(point, v)| {
                let own = mechanism.platform.get(&point.name)?;
                Some((Vector3::from(*own), Vector3::from(at(v.as_ref()?))))
            });
            let (own, there): (Vec<_>, Vec<_>) = on_platform.unzip();
            let place = match (own.is_empty(), moving) {
                (false, _) => rigid_fit(&own, &there)[..3].try_into().unwrap_or([f64::NAN; 3]),
                (true, Some(moving)) => at(&moving),
                (true, None) => {
                    let first = (0..mechanism.chains.len()).flat_map(|c| of_chain(model, c)).next();
                    first.and_then(|p| carried[p]).map_or([f64::NAN; 3], |v| at(&v))
                }
            };
            rows.push(Row { row, nodes: nodes.iter().map(at).collect(), place });
        }
    }
    rows
}

/// The points that a chain carries.
pub fn of_chain(model: &Model, chain: usize) -> impl Iterator<Item = usize> + '_ {
    let mechanism = &model.mechanism;
    let name = &mechanism.chains[chain].name;
    let carried = move |&p: &usize| {
        let point = &mechanism.points[p];
        point.chain.as_ref() == Some(name) && point.at.is_some()
    };
    (0..mechanism.points.len()).filter(carried)
}
