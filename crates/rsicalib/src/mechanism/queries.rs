//! Questions to a mechanism: who is called what, and what belongs together.

use crate::Error;
use crate::mechanism::drawing::{Closure, Mechanism, Motion, Point, Value};
use crate::mechanism::hand_controller;

impl Mechanism {
    /// Index of a channel.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] with the names there are.
    pub fn channel_index(&self, name: &str) -> Result<usize, Error> {
        index(&self.channels, |c| &c.name, "channel", name)
    }

    /// Index of a chain. Errors as [`Mechanism::channel_index`].
    pub fn chain_index(&self, name: &str) -> Result<usize, Error> {
        index(&self.chains, |c| &c.name, "chain", name)
    }

    /// Index of a point. Errors as [`Mechanism::channel_index`].
    pub fn point_index(&self, name: &str) -> Result<usize, Error> {
        index(&self.points, |p| &p.name, "point", name)
    }

    /// Index of a closure. Errors as [`Mechanism::channel_index`].
    pub fn closure_index(&self, name: &str) -> Result<usize, Error> {
        index(&self.closures, |c| &c.name, "closure", name)
    }

    /// Scalar equations that one sample gives.
    #[must_use]
    pub fn equations(&self) -> usize {
        self.closures.iter().filter(|c| !self.is_link(c)).map(|c| c.kind.equations()).sum()
    }

    /// True for a distance between unknown points of one group, which no sample
    /// takes part in: `between = ["socket[at=socket0]", "socket[at=socket1]"]`.
    #[must_use]
    pub fn is_link(&self, closure: &Closure) -> bool {
        let named = |end: &String| self.points.iter().any(|p| p.name == *end);
        closure.between.iter().all(|end| !named(end) && end.ends_with(']'))
    }

    /// `socket[at=socket0]` as a point and the values of some of its columns.
    ///
    /// A value may hold anything: where it ends is told by the names of the columns.
    #[must_use]
    pub fn unknown_end(&self, text: &str) -> Option<(usize, Vec<(usize, String)>)> {
        let inside = |p: &Point| {
            let keys = text.strip_prefix(p.name.as_str())?.strip_prefix('[')?.strip_suffix(']')?;
            keys_of(keys, &p.unknown)
        };
        self.points.iter().enumerate().find_map(|(i, p)| Some((i, inside(p)?)))
    }

    /// Text columns of the readings that the unknown points need.
    #[must_use]
    pub fn key_columns(&self) -> Vec<String> {
        let mut columns: Vec<String> = Vec::new();
        for column in self.points.iter().flat_map(|p| &p.unknown) {
            if !columns.contains(column) {
                columns.push(column.clone());
            }
        }
        columns
    }

    /// Columns of the readings that hold measured distances.
    #[must_use]
    pub fn value_columns(&self) -> Vec<String> {
        let mut columns: Vec<String> = Vec::new();
        for closure in &self.closures {
            if let Some(Value::Column(column)) = &closure.value
                && !columns.contains(column)
            {
                columns.push(column.clone());
            }
        }
        columns
    }

    /// The same mechanism with only the closures named.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] for a name that no closure bears.
    pub fn with_closures(&self, names: &[String]) -> Result<Self, Error> {
        for name in names {
            self.closure_index(name)?;
        }
        let mut some = self.clone();
        some.closures.retain(|c| names.contains(&c.name));
        Ok(some)
    }

    /// The channels of one chain, base first.
    #[must_use]
    pub fn channels_of(&self, chain: usize) -> Vec<usize> {
        let names = self.chains[chain].rows.iter().filter_map(|r| r.channel.as_ref());
        names.filter_map(|n| self.channels.iter().position(|c| c.name == *n)).collect()
    }

    /// True where nothing ties the mechanism to its base: a single chain that touches
    /// unknown points alone. Turning the whole world changes no reading.
    #[must_use]
    pub fn floats(&self) -> bool {
        let fixed = |end: &String| {
            let mut points = self.points.iter();
            points.any(|p| p.name == *end && p.chain.is_none() && p.unknown.is_empty())
        };
        self.chains.len() == 1 && !self.closures.iter().any(|c| c.between.iter().any(fixed))
    }

    /// True for a channel whose joint slides: its coordinate is a length.
    #[must_use]
    pub fn slides(&self, channel: usize) -> bool {
        let name = &self.channels[channel].name;
        let mut rows = self.chains.iter().flat_map(|c| &c.rows);
        rows.any(|r| r.channel.as_ref() == Some(name) && r.joint == Motion::Prismatic)
    }

    /// Workspace of a mechanism that comes along: lowest and highest x, y, z
    /// [length unit], rx, ry, rz [rad].
    #[must_use]
    pub fn workspace(&self) -> Option<[[f64; 2]; 6]> {
        (self.name == "rsi").then_some(hand_controller::WORKSPACE)
    }

    /// The chain that a channel belongs to.
    #[must_use]
    pub fn chain_of(&self, channel: usize) -> Option<usize> {
        (0..self.chains.len()).find(|&c| self.channels_of(c).contains(&channel))
    }

    /// True where a channel senses joints that turn, so that whole turns make no difference.
    #[must_use]
    pub fn turns(&self, channel: usize) -> bool {
        let name = Some(&self.channels[channel].name);
        let rows = self.chains.iter().flat_map(|c| &c.rows);
        rows.filter(|row| row.channel.as_ref() == name).all(|row| row.joint == Motion::Revolute)
    }
}

/// `at=socket0,group=front` as the index of each column and its value.
fn keys_of(text: &str, columns: &[String]) -> Option<Vec<(usize, String)>> {
    let column_at = |i: usize| {
        let rest = text[i..].trim_start();
        let named = |c: &String| rest.strip_prefix(c.as_str())?.strip_prefix('=');
        columns.iter().enumerate().find_map(|(k, c)| Some((k, named(c)?)))
    };
    let after_commas = text.match_indices(',').map(|(i, _)| i + 1);
    let starts: Vec<usize> =
        std::iter::once(0).chain(after_commas).filter(|i| column_at(*i).is_some()).collect();
    if starts.first() != Some(&0) {
        return None;
    }
    let ends = starts.iter().skip(1).map(|i| i - 1).chain([text.len()]);
    let value = |(start, end): (&usize, usize)| {
        let (k, rest) = column_at(*start)?;
        let beyond = text.len() - end;
        Some((k, rest[..rest.len() - beyond].trim().to_string()))
    };
    starts.iter().zip(ends).map(value).collect()
}

pub(crate) fn list<'a>(names: impl Iterator<Item = &'a String>) -> String {
    names.map(String::as_str).collect::<Vec<_>>().join(", ")
}

fn index<T>(
    all: &[T],
    name: impl Fn(&T) -> &String,
    kind: &'static str,
    wanted: &str,
) -> Result<usize, Error> {
    all.iter().position(|t| name(t) == wanted).ok_or_else(|| Error::Unknown {
        kind,
        found: wanted.into(),
        known: list(all.iter().map(name)),
    })
}
