//! Joint coordinates of readings under parameters of a fit.

use crate::model::{Model, Want, Workspace};
use crate::readings::Readings;

/// Joint coordinates after all corrections, and their slopes by the readings, row by row, one per
/// channel.
pub struct Angles {
    channels: usize,
    angles: Vec<f64>,
    slopes: Vec<f64>,
}

impl Angles {
    pub fn of(readings: &Readings, model: &Model, beta: &[f64]) -> Self {
        let channels = readings.channels;
        let mut slopes = vec![f64::NAN; readings.samples * channels];
        let mut angles = slopes.clone();
        let mut ws = Workspace::default();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let want = Want { x: false, a: true };
            model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
            for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
                for c in 0..channels {
                    angles[row * channels + c] = ws.angles[c].0[lane];
                    slopes[row * channels + c] = model.slopes(&ws)[c].0[lane];
                }
            }
        }
        Self { channels, angles, slopes }
    }

    /// Coordinates of all joints, row by row (rad or length units).
    pub fn all(self) -> Vec<f64> {
        self.angles
    }

    /// Coordinate of the joint that a channel reads (rad or length units).
    #[cfg_attr(not(feature = "document"), expect(dead_code, reason = "only reports show angles"))]
    pub fn at(&self, row: usize, channel: usize) -> f64 {
        self.angles[row * self.channels + channel]
    }

    /// Its derivative by the reading.
    pub fn slope(&self, row: usize, channel: usize) -> f64 {
        self.slopes[row * self.channels + channel]
    }
}
