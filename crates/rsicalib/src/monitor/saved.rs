//! A watch that goes on where another one ended.

use nalgebra::DMatrix;

use crate::Error;
use crate::monitor::alarm::Alarm;
use crate::monitor::drift::Drift;
use crate::monitor::kept::{Bytes, Keep, fields, keep};
use crate::monitor::open::{Kind, Kinds, Open, Suspected};
use crate::monitor::watching::Monitor;

impl Monitor {
    /// All that the watch knows, beside what [`Monitor::new`] was given.
    pub fn state(&mut self) -> Vec<u8> {
        let mut bytes = Bytes::new();
        self.keep(&mut bytes);
        bytes.written()
    }

    /// Goes on where the watch ended whose [`Monitor::state`] this is: it must have been made from
    /// the same mechanism, result and options. The next rows raise the alarms that they would have
    /// raised there, to the bit.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] for bytes that are damaged or of another watch; this one is of no use then.
    pub fn restore(&mut self, state: Vec<u8>) -> Result<(), Error> {
        let mut bytes = Bytes::of(state)?;
        let shape = self.shape();
        self.keep(&mut bytes);
        bytes.whole()?;
        let own = self.watched.uncertain;
        let size = self.state.size;
        let fits = own <= self.watched.order.len()
            && self.windows.fits()
            && size == own
            && self.state.mean.len() == size
            && self.state.covariance.len() == size * size
            && self.held < self.waiting.len()
            && self.stuck.iter().all(|channel| *channel < self.watched.under.model.scales.len())
            && self.unsteady.iter().all(|one| one.place < self.watched.places.len())
            && self.open.as_ref().is_none_or(|open| self.holds(open));
        if shape != self.shape() || !fits {
            return Err(Error::option("state", "that of another watch", "one of this calibration"));
        }
        Ok(())
    }

    /// Lengths that a state cannot change.
    fn shape(&self) -> Vec<usize> {
        let watched = &self.watched;
        let mut shape = vec![watched.at.len(), watched.order.len(), watched.scale.len()];
        shape.extend(watched.candidates.iter().map(|c| c.columns.len()));
        shape.push(watched.drifts.len());
        shape.extend(self.order.lengths());
        shape.extend(self.whitening.lengths());
        shape.extend(self.windows.lengths());
        shape.extend(self.recent.lengths());
        shape.extend(self.tails.lengths());
        shape.extend(self.runs.lengths());
        shape.push(self.score.turned.len());
        shape
    }

    /// True where a change whose name is open is one of what is watched.
    fn holds(&self, open: &Open) -> bool {
        let all = self.watched.candidates.len();
        open.named.each().all(|kind| kind.candidate < all)
            && open.suspects.iter().all(|s| s.candidate < all)
            && open.was.len() == self.watched.at.len()
            && open.places.len() == open.width.len()
            && open.places.iter().all(|place| *place < self.state.size)
            && open.known.nrows() == open.known.ncols()
    }
}

impl Keep for Monitor {
    fn keep(&mut self, bytes: &mut Bytes) {
        let watched = &mut self.watched;
        fields!(bytes, watched.at, watched.order, watched.scale, watched.uncertain);
        for candidate in &mut watched.candidates {
            candidate.columns.keep(bytes);
        }
        watched.factors.iter_mut().for_each(|factor| factor.own.keep(bytes));
        watched.drifts.iter_mut().for_each(|drift| drift.keep(bytes));
        fields!(bytes, self.order, self.counts, self.whitening, self.windows, self.seen);
        fields!(bytes, self.state.size, self.state.mean, self.state.covariance);
        fields!(bytes, self.runs, self.stuck, self.unsteady, self.lately, self.silent, self.out);
        fields!(bytes, self.spread, self.scale, self.dof, self.waiting, self.held, self.age);
        fields!(bytes, self.recent, self.open, self.tails, self.score.turned);
    }
}

keep!(Drift: own, base, since);
keep!(Kind: candidate, drifts);
keep!(Kinds: first, second);
keep!(Suspected: candidate, columns, drifts);

impl Default for Open {
    fn default() -> Self {
        Self {
            suspects: Vec::new(),
            named: Kinds::default(),
            places: Vec::new(),
            width: Vec::new(),
            was: Vec::new(),
            known: DMatrix::zeros(0, 0),
            alarm: Alarm::default(),
            left: None,
        }
    }
}

keep!(Open: suspects, named, places, width, was, known, alarm);
