//! A session as it would be without a mistake.

use std::f64::consts::{PI, TAU};

use crate::Error;
use crate::estimate::observations::Observations;
use crate::model::Model;
use crate::readings::{Readings, Table};
use crate::terms::term::Role;

/// The observations, and the readings that a search uses, as they would be without a mistake.
#[derive(Debug, Clone)]
pub(super) struct Rewired {
    /// The readings of the poses.
    pub(super) readings: Readings,
    /// The observations, for the reading of the rest pose.
    pub(super) observations: Observations,
}

impl Rewired {
    /// Every row changed by `undo`; an error where a reading is beyond its channel's range then.
    pub(super) fn new(
        observations: &Observations,
        readings: &Readings,
        undo: impl Fn(&mut [f64]),
    ) -> Result<Self, Error> {
        let mut observations = observations.clone();
        let mut table = readings.table.clone();
        table.change(readings.channels, &undo);
        let readings = Readings::beside(&observations.mechanism, table, &observations.readings)?;
        if let Some(rest) = &mut observations.rest {
            undo(rest);
        }
        if let (Some((held, readings)), Some(rest)) = (&mut observations.held, &observations.rest) {
            *readings = Readings::new(held, Table { values: rest.clone(), ..Table::default() })?;
        }
        Ok(Self { readings, observations })
    }

    /// The same with the readings of each channel from other poses.
    pub(super) fn of_other_poses(&self) -> Result<Self, Error> {
        let Readings { samples, channels, pose, table: own, .. } = &self.readings;
        let mut poses: Vec<Vec<usize>> = Vec::new();
        for row in 0..*samples {
            poses.resize_with(poses.len().max(pose[row] + 1), Vec::new);
            poses[pose[row]].push(row);
        }
        let mut table = own.clone();
        for (number, rows) in poses.iter().enumerate() {
            for channel in 0..*channels {
                let away = (channel + 1) * poses.len() / (channels + 1);
                let others = poses[(number + away) % poses.len()].iter().cycle();
                for (row, other) in rows.iter().zip(others) {
                    table.values[row * channels + channel] = own.values[other * channels + channel];
                }
            }
        }
        let observations = self.observations.clone();
        let readings = Readings::beside(&observations.mechanism, table, &self.readings)?;
        Ok(Self { readings, observations })
    }
}

/// Part by which offsets in another unit may differ from what is declared: a machine is built to a
/// few hundredths of a radian, and an offset is of the size of one.
pub(crate) const NEAR: f64 = 0.05;

/// True where a fit from one set of offsets ends at offsets near them: a start elsewhere may lead to
/// any minimum, and these offsets are what it is about.
pub(super) fn stays(model: &Model, channels: &[usize], [from, to]: [&[f64]; 2]) -> bool {
    let columns = channels.iter().filter_map(|&c| model.column(Role::Offset, c));
    columns.into_iter().all(|column| apart(from[column], to[column]) <= NEAR * PI)
}

/// Angle between two directions.
pub(crate) fn apart(a: f64, b: f64) -> f64 {
    let turn = (a - b).rem_euclid(TAU);
    turn.min(TAU - turn)
}
