//! Random closed configurations that paths join to where a mechanism has been.
//!
//! Loops can be closed in ways that no motion joins: a four-bar linkage open or crossed, a platform in
//! a plane as it is or mirrored. A random place is closed where it can be. A path leads towards it ([`walks`]) from
//! the nearest of the places where the mechanism has been. Where the path ends all loops are closed, and it goes
//! on to there. Later paths may begin there as well.

use crate::numerics::order::Ends;
use std::ops::Range;

use crate::Error;
use crate::model::compiled::Model;
use crate::model::configurations::{Closed, Configurations, Open, ROWS, Under};
use crate::model::loops::{Coordinates, Loops, Place, holds};
use crate::model::walk::{lead_to, walks};
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::WIDTH;
use crate::numerics::random::Random;
use crate::numerics::workers;
use crate::readings::Readings;

/// Where a mechanism has been.
pub(crate) struct Been<'a> {
    configurations: &'a Configurations,
    coordinates: Coordinates,
    /// What is unknown, told apart by keys, holds the mechanism.
    keyed: bool,
    /// Each with its combination of keys.
    places: Vec<(usize, Place)>,
}

impl<'a> Been<'a> {
    /// At the rows of readings with a weight above zero, of many some; none where it has been at none,
    /// or nothing holds the mechanism at work.
    pub(crate) fn new(
        configurations: &'a Configurations,
        (model, readings, beta): (&Model, &Readings, &[f64]),
        weights: &[f64],
    ) -> Option<Self> {
        let mut holding = model.closures.iter().filter(|closure| holds(closure)).peekable();
        holding.peek()?;
        let mut been = Self {
            configurations,
            coordinates: Coordinates::of(configurations, model),
            keyed: holding.any(|closure| closure.unknowns().next().is_some()),
            places: Vec::new(),
        };
        let counted: Vec<usize> = (0..readings.samples).filter(|&row| weights[row] > 0.0).collect();
        let some = counted.iter().step_by(counted.len().div_ceil(ROWS).max(1));
        been.places = been.at_rows((model, readings, beta), &some.copied().collect::<Vec<_>>());
        (!been.places.is_empty()).then_some(been)
    }

    /// Places of rows of readings.
    fn at_rows(
        &self,
        (model, readings, beta): (&Model, &Readings, &[f64]),
        rows: &[usize],
    ) -> Vec<(usize, Place)> {
        let mut found = Vec::with_capacity(rows.len());
        let mut ws = Workspace::default();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let lanes = (0..meta.live).filter(|&lane| rows.contains(&meta.rows[lane]));
            let lanes: Vec<usize> = lanes.collect();
            if lanes.is_empty() {
                continue;
            }
            let raw = readings.raw(block);
            model.evaluate(readings, block, raw, beta, Want { x: false, a: false }, &mut ws);
            for lane in lanes {
                let key = self.configurations.key_of(readings, meta.rows[lane]).unwrap_or_default();
                let values = raw.iter().chain(&ws.xi).map(|a| a.0[lane]);
                found.push((key, self.coordinates.place(values)));
            }
        }
        found
    }

    /// One configuration for each of these keys; none where it has not been at a place with these keys, or
    /// the path does not lead on to where all loops are closed.
    ///
    /// # Errors
    ///
    /// As [`Configurations::open`].
    pub(crate) fn draw(
        &mut self,
        keys: &[usize],
        random: &mut Random,
        under: &Under<'_>,
    ) -> Result<Vec<Option<Closed>>, Error> {
        let configurations = self.configurations;
        self.draw_towards(keys, |rows| configurations.opened(&keys[rows], random, under))
    }

    /// The same on the way to these readings, row by row, one row for each key.
    ///
    /// # Errors
    ///
    /// As [`Configurations::open`].
    pub(crate) fn draw_to(
        &mut self,
        (keys, goals): (&[usize], &[f64]),
        random: &mut Random,
        under: &Under<'_>,
    ) -> Result<Vec<Option<Closed>>, Error> {
        let configurations = self.configurations;
        let width = configurations.mechanism().channels.len();
        self.draw_towards(keys, |rows| {
            let values = goals[rows.start * width..rows.end * width].to_vec();
            configurations.opened_at(&keys[rows], values, random, under)
        })
    }

    /// The same on the way to what `open` makes of a range of the keys.
    fn draw_towards(
        &mut self,
        keys: &[usize],
        mut open: impl FnMut(Range<usize>) -> Result<Open, Error>,
    ) -> Result<Vec<Option<Closed>>, Error> {
        let mut found = Vec::with_capacity(keys.len());
        while found.len() < keys.len() {
            // As many as there are places, so that later paths begin at new ones.
            let end = keys.len().min(found.len() + self.places.len().max(WIDTH));
            let rows = found.len()..end;
            let keys = &keys[rows.clone()];
            let drawn = self.walk(keys, &open(rows)?);
            let places = keys.iter().zip(&drawn).filter_map(|(key, closed)| {
                Some((*key, self.coordinates.place(closed.as_ref()?.coordinates())))
            });
            self.places.extend(places.collect::<Vec<_>>());
            found.extend(drawn);
        }
        Ok(found)
    }

    /// The same from places that are known.
    fn walk(&self, keys: &[usize], open: &Open) -> Vec<Option<Closed>> {
        let loops = Loops::new(self.configurations, open, &self.coordinates);
        let blocks = workers::map(0..open.readings.blocks().len(), |block| {
            let meta = &open.readings.blocks()[block];
            let drawn = self.walk_block(open, &loops, (block, keys[meta.rows[0]]), meta.live);
            meta.rows.into_iter().zip(drawn).collect::<Vec<_>>()
        });
        let mut found = vec![None; keys.len()];
        for (row, closed) in blocks.into_iter().flatten() {
            found[row] = closed;
        }
        found
    }

    /// Of the samples of one block.
    fn walk_block(
        &self,
        open: &Open,
        loops: &Loops<'_>,
        (block, key): (usize, usize),
        live: usize,
    ) -> Vec<Option<Closed>> {
        let (mut ws, of) = (Workspace::default(), &self.coordinates);
        let drawn = self.configurations.start(open, block, &mut ws);
        let goals = self.configurations.close_block(open, block, drawn.clone());
        let place = |closed: &Option<Closed>| Some(of.place(closed.as_ref()?.coordinates()));
        let way = |lane: usize| {
            let drawn = || of.place(drawn.iter().map(|a| a.0[lane]));
            let goal = place(&goals[lane]).unwrap_or_else(drawn);
            // Whole turns nearer, so that the path leads to within the limits.
            let from = &goal - of.way(self.nearest(key, &goal)?, &goal);
            Some((from, goal))
        };
        let Some(ways) = (0..live).map(way).collect() else { return vec![None; live] };
        let mut walks = walks(loops, block, ways, &mut ws);
        let ends: Vec<Place> = walks.iter().map(|walk| walk.corrected()).collect();
        let mut closed = self.configurations.close_block(open, block, of.lanes(&ends));
        let places: Vec<Option<Place>> = closed.iter().map(place).collect();
        let joined = lead_to(loops, block, &mut walks, &places, &mut ws);
        for (closed, _) in closed.iter_mut().zip(joined).filter(|(_, joined)| !joined) {
            *closed = None;
        }
        closed
    }

    /// The place that is nearest to a random one, of the same keys where these matter.
    fn nearest(&self, key: usize, goal: &Place) -> Option<&Place> {
        let own = self.places.iter().filter(|(own, _)| !self.keyed || *own == key);
        let far = own.map(|(_, at)| (self.coordinates.way(at, goal).norm_squared(), at));
        far.least_by(|a| a.0).map(|(_, at)| at)
    }
}
