//! Whitened misclosure and its derivatives, eight rows at a time.

use crate::estimate::settle::Room;
use crate::estimate::{Noise, Part};
use crate::model::Want;
use crate::monitor::watched::Watched;
use crate::numerics::lanes::{Lanes, WIDTH};

/// Up to eight rows on their way to the test.
pub(crate) struct Rows {
    room: Room,
    raw: Vec<Lanes>,
    adjusted: Vec<Lanes>,
    /// Parameters about which they are linearised: those of this row.
    at: Vec<f64>,
    row: u64,
    /// Samples of which each lane is the mean, all of one seating.
    seats: Lanes,
}

impl Rows {
    pub(crate) fn new(watched: &Watched, noise: &Noise) -> Self {
        let model = &watched.under.model;
        let none = vec![Lanes::ZERO; model.scales.len()];
        let adjusted = vec![Lanes::ZERO; model.stride()];
        let at = vec![0.0; model.parameters];
        Self { room: Room::new(model, noise), raw: none, adjusted, at, row: 0, seats: Lanes::ONE }
    }

    /// Puts a row into a lane and all after it.
    pub(crate) fn put(&mut self, lane: usize, readings: &[f64]) {
        for (lanes, value) in self.raw.iter_mut().zip(readings) {
            lanes.0[lane..WIDTH].fill(*value);
        }
    }

    /// The reading of a channel in a lane.
    pub(crate) fn reading(&self, channel: usize, lane: usize) -> f64 {
        self.raw[channel].0[lane]
    }

    /// The readings in a lane.
    pub(crate) fn in_lane(&self, lane: usize) -> impl Iterator<Item = f64> {
        self.raw.iter().map(move |lanes| lanes.0[lane])
    }

    /// Linearises all lanes about the present parameters in a row, (51) and (52).
    pub(crate) fn linearise(&mut self, watched: &Watched, row: u64) {
        let under = &watched.under;
        self.row = row;
        watched.put_in_row(&watched.at, row, &mut self.at);
        let part = Part { model: &under.model, readings: &under.readings, weights: None };
        match under.model.pose_unknowns() {
            0 => self.adjusted.copy_from_slice(&self.raw),
            _ => {
                let (readings, ws) = (&under.readings, &mut self.room.ws);
                self.adjusted = under.model.placed(readings, 0, &self.raw, &self.at, ws);
            }
        }
        self.room.seat(self.seats);
        self.room.linearise(&part, 0, &self.raw, &self.at, &mut self.adjusted, 1);
    }

    /// Lets the first lanes be means of so many samples, which share a seating: `r` and `G` of one
    /// of them, (67).
    pub(crate) fn seat(&mut self, samples: &[f64]) {
        for (lane, samples) in self.seats.0.iter_mut().zip(samples) {
            *lane = *samples;
        }
    }

    /// Gives `take` the place, `r` and `G` of one row after the other, which have these numbers and
    /// readings.
    pub(crate) fn each(
        &mut self,
        watched: &Watched,
        rows: &[(u64, &[f64])],
        mut take: impl FnMut(usize, &mut [f64], &mut [f64]),
    ) {
        let equations = watched.under.model.equations();
        let (mut r, mut g) = (vec![0.0; equations], vec![0.0; equations * watched.order.len()]);
        for (block, rows) in rows.chunks(WIDTH).enumerate() {
            for (lane, (_, readings)) in rows.iter().enumerate() {
                self.put(lane, readings);
            }
            self.linearise(watched, rows[0].0);
            for (lane, (row, _)) in rows.iter().enumerate() {
                self.read(lane, watched, *row, &mut r, &mut g);
                take(block * WIDTH + lane, &mut r, &mut g);
            }
        }
    }

    /// Sum of squares of the misclosure of the raw readings in the first lanes, in length units.
    pub(crate) fn misclosure(&mut self, watched: &Watched, lengths: &[f64], live: usize) -> f64 {
        let (model, readings) = (&watched.under.model, &watched.under.readings);
        let want = Want { x: false, a: false };
        model.evaluate(readings, 0, &self.raw, &watched.at, want, &mut self.room.ws);
        let lanes = |f: &Lanes| f.0[..live].iter().map(|f| f * f).sum::<f64>();
        self.room.ws.f.iter().zip(lengths).map(|(f, length)| lanes(f) * length * length).sum()
    }

    /// `r` and `G` of one lane, which holds this row; `G` row by row, one entry per column that is
    /// watched.
    #[inline(always)]
    pub(crate) fn read(
        &self,
        lane: usize,
        watched: &Watched,
        row: u64,
        r: &mut [f64],
        g: &mut [f64],
    ) {
        let columns = watched.order.len();
        let width = watched.under.model.width();
        let x = self.room.ws.x.chunks_exact(width.max(1));
        for (((r, w), g), x) in
            r.iter_mut().zip(&self.room.w).zip(g.chunks_exact_mut(columns)).zip(x)
        {
            *r = w.0[lane];
            for ((g, column), scale) in g.iter_mut().zip(&watched.order).zip(&watched.scale) {
                *g = x.get(*column).map_or(0.0, |x| -x.0[lane] * scale);
            }
        }
        for factor in &watched.factors {
            let x = self.room.ws.x.chunks_exact(width.max(1));
            for (g, x) in g.chunks_exact_mut(columns).zip(x) {
                let parts = factor.parts.iter();
                let along: f64 =
                    parts.map(|(part, by)| x.get(*part).map_or(0.0, |x| x.0[lane]) * by).sum();
                g[factor.own] = -along * watched.scale[factor.own];
            }
        }
        for drift in &watched.drifts {
            let (Some(age), Some(here)) = (drift.age(row), drift.age(self.row)) else { continue };
            let rate = watched.at[watched.order[drift.own]] / watched.scale[drift.own];
            for (r, g) in r.iter_mut().zip(g.chunks_exact_mut(columns)) {
                g[drift.own] = age * g[drift.base];
                *r -= rate * (age - here) * g[drift.base];
            }
        }
    }
}
