//! Queries of a mechanism: indices of names, columns that it needs, channels of a chain.

use crate::Error;
use crate::closures::kind::{Given, Part};
use crate::error::index_of;
use crate::mechanism::drawing::{Channel, Closure, Mechanism, Motion, Point, Value};
use crate::mechanism::places::{Frame, Line, Plane};

impl Closure {
    /// True where the coordinates of two channels are equal.
    pub(crate) fn is_of_channels(&self) -> bool {
        self.kind.facts().between == [Part::Channel; 2]
    }
}

impl Mechanism {
    /// Index of a channel.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] with the known names.
    pub fn channel_index(&self, name: &str) -> Result<usize, Error> {
        index_of(&self.channels, |c| &c.name, "channel", name)
    }

    /// Index of a chain.
    ///
    /// # Errors
    ///
    /// As [`Mechanism::channel_index`].
    pub fn chain_index(&self, name: &str) -> Result<usize, Error> {
        index_of(&self.chains, |c| &c.name, "chain", name)
    }

    /// Index of a point.
    ///
    /// # Errors
    ///
    /// As [`Mechanism::channel_index`].
    pub fn point_index(&self, name: &str) -> Result<usize, Error> {
        index_of(&self.points, |p| &p.name, "point", name)
    }

    /// Index of a closure.
    ///
    /// # Errors
    ///
    /// As [`Mechanism::channel_index`].
    pub fn closure_index(&self, name: &str) -> Result<usize, Error> {
        index_of(&self.closures, |c| &c.name, "closure", name)
    }

    /// Index of a plane.
    ///
    /// # Errors
    ///
    /// As [`Mechanism::channel_index`].
    pub fn plane_index(&self, name: &str) -> Result<usize, Error> {
        index_of(&self.planes, |p| &p.name, "plane", name)
    }

    /// Index of a line.
    ///
    /// # Errors
    ///
    /// As [`Mechanism::channel_index`].
    pub fn line_index(&self, name: &str) -> Result<usize, Error> {
        index_of(&self.lines, |l| &l.name, "line", name)
    }

    /// Index of what an end of a closure names.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] where there is nothing of that name.
    pub(crate) fn index_of(&self, part: Part, name: &str) -> Result<usize, Error> {
        match part {
            Part::Point => self.point_index(name),
            Part::Plane => self.plane_index(name),
            Part::Line => self.line_index(name),
            Part::Channel => self.channel_index(name),
        }
    }

    /// Index of a frame.
    ///
    /// # Errors
    ///
    /// As [`Mechanism::channel_index`].
    pub fn frame_index(&self, name: &str) -> Result<usize, Error> {
        index_of(&self.frames, |f| &f.name, "frame", name)
    }

    /// Number of scalar equations of one sample.
    #[must_use]
    pub fn equations(&self) -> usize {
        self.closures.iter().filter(|c| !self.is_link(c)).map(|c| c.kind.equations()).sum()
    }

    /// True for a distance between two unknown points of one group:
    /// `between = ["socket[at=socket0]", "socket[at=socket1]"]`. No sample takes part in such a
    /// closure.
    #[must_use]
    pub fn is_link(&self, closure: &Closure) -> bool {
        let named = |end: &String| self.points.iter().any(|p| p.name == *end);
        closure.between.iter().all(|end| !named(end) && end.ends_with(']'))
    }

    /// Index of the point, and pairs of a column's index and its value, of a text such as
    /// `socket[at=socket0]`; `None` where the text does not have this form.
    ///
    /// A value may contain commas: the name of the next column ends the value.
    #[must_use]
    pub fn unknown_end(&self, text: &str) -> Option<(usize, Vec<(usize, String)>)> {
        let inside = |p: &Point| {
            let keys = text.strip_prefix(p.name.as_str())?.strip_prefix('[')?.strip_suffix(']')?;
            keys_of(keys, p.keys())
        };
        self.points.iter().enumerate().find_map(|(i, p)| Some((i, inside(p)?)))
    }

    /// The body that carries a point: one that is somewhere else in each pose.
    pub(crate) fn body_of(&self, point: &Point) -> Option<usize> {
        let frame = point.frame.as_ref().filter(|_| point.columns.is_none())?;
        self.frames.iter().position(|f| f.name == *frame && f.moves())
    }

    /// True for a point that is somewhere else in each pose, by itself or with a body.
    pub(crate) fn is_moving(&self, point: &Point) -> bool {
        point.moves() || self.body_of(point).is_some()
    }

    /// Key columns of the readings, which tell unknown things apart, in the order of the things.
    #[must_use]
    pub fn key_columns(&self) -> Vec<String> {
        let points = self.points.iter().flat_map(Point::keys);
        let planes = self.planes.iter().flat_map(Plane::keys);
        let lines = self.lines.iter().flat_map(Line::keys);
        let frames = self.frames.iter().flat_map(Frame::keys);
        each_once(points.chain(planes).chain(lines).chain(frames))
    }

    /// Columns of the readings which hold measured distances, in the order of the closures.
    #[must_use]
    pub fn distance_columns(&self) -> Vec<String> {
        let lengths = |c: &&Closure| c.kind.facts().given == Given::Value;
        each_once(self.closures.iter().filter(lengths).filter_map(column_of))
    }

    /// Columns of the readings that an instrument gives: coordinates of the points that it sees.
    #[must_use]
    pub fn instrument_columns(&self) -> Vec<String> {
        each_once(self.points.iter().filter_map(|p| p.columns.as_ref()).flatten())
    }

    /// Columns of the readings with numbers: measured distances, heights above planes, coordinates of
    /// measured points, and what laws use.
    #[must_use]
    pub fn value_columns(&self) -> Vec<String> {
        let measured = self.distance_columns();
        let heights = self.closures.iter().filter_map(column_of);
        let points = self.instrument_columns();
        let declared = self.columns.iter().map(|column| &column.name);
        let torques = self.channels.iter().filter_map(|channel| channel.torque.as_ref());
        each_once(measured.iter().chain(heights).chain(&points).chain(declared).chain(torques))
    }

    /// Columns of numbers that laws alone follow: a table that has not one of them says nothing of these laws.
    #[must_use]
    pub fn optional_columns(&self) -> Vec<String> {
        let used = Self { columns: Vec::new(), ..self.clone() }.value_columns();
        let declared = self.columns.iter().map(|column| &column.name);
        declared.filter(|name| !used.contains(name)).cloned().collect()
    }

    /// True where the mechanism says of drives what an open chain does not: which joints have none, or
    /// what one does.
    pub(crate) fn tells_of_drives(&self) -> bool {
        self.channels.iter().any(|channel| channel.passive || channel.torque.is_some())
    }

    /// The channels that read the length of a distance.
    pub(crate) fn measures(&self, channel: usize) -> bool {
        let name = self.channels.get(channel).map(|c| &c.name);
        self.closures.iter().any(|c| c.channel.is_some() && c.channel.as_ref() == name)
    }

    /// True where some length is known beside what channels read: of a link, between points, or between
    /// places in the base. What is drawn of a point that is unknown in part is no such length.
    pub(crate) fn has_scale(&self) -> bool {
        self.has_scale_beside(&[])
    }

    /// The same beside the values of some closures.
    pub(crate) fn has_scale_beside(&self, closures: &[usize]) -> bool {
        let rows = self.chains.iter().flat_map(|c| &c.rows);
        let mut links = rows.map(|row| row.body().translation.vector.norm());
        let values = self.closures.iter().enumerate().filter(|(k, _)| !closures.contains(k));
        let mut values = values.filter_map(|(_, c)| c.value.as_ref());
        let fixed = self.points.iter().filter(|p| p.chain.is_none() && !p.is_unknown());
        let mut places = fixed.filter_map(|p| p.at);
        let first = places.next();
        links.any(|long| long > 0.0)
            || values.any(|value| value.known().is_some())
            || places.any(|at| Some(at) != first)
            || self.points.iter().any(|p| p.columns.is_some())
    }

    /// The channels that read lengths.
    pub(crate) fn measuring(&self) -> Vec<usize> {
        (0..self.channels.len()).filter(|&c| self.measures(c)).collect()
    }

    /// The reading at which the offset of a channel is defined: the middle of its readings, and zero
    /// where it reads a length, which begins there.
    pub(crate) fn centre(&self, channel: usize, mean: f64) -> f64 {
        if self.measures(channel) { 0.0 } else { mean }
    }

    /// True for a closure whose value the drawing alone says.
    pub(crate) fn is_drawn(&self, closure: usize) -> bool {
        let closure = &self.closures[closure];
        match closure.kind.facts().between[1] {
            Part::Plane => {
                let mut planes = self.planes.iter();
                planes.any(|p| p.name == closure.between[1] && p.unknown.is_none())
            }
            Part::Line => {
                let mut lines = self.lines.iter();
                lines.any(|l| l.name == closure.between[1] && l.unknown.is_none())
            }
            Part::Channel => false,
            Part::Point => closure.channel.is_none(),
        }
    }

    /// True for a length that is read by no channel, and is no place of a plane.
    pub(crate) fn slips(&self, closure: usize) -> bool {
        let closure = &self.closures[closure];
        closure.channel.is_none() && closure.kind.is_between_points()
    }

    /// The one end of a closure between points that stands: on no chain, and not anew in each pose.
    pub(crate) fn standing_end(&self, closure: usize) -> Option<usize> {
        let closure = &self.closures[closure];
        if !closure.kind.is_between_points() || self.is_link(closure) {
            return None;
        }
        let stands = closure.between.each_ref().map(|name| {
            let point = self.points.iter().find(|point| point.name == *name);
            point.is_some_and(|point| point.chain.is_none() && !self.is_moving(point))
        });
        match stands {
            [true, false] => Some(0),
            [false, true] => Some(1),
            _ => None,
        }
    }

    /// True for a chain that nothing but its point at what stands closes: an arm at a ball bar, at a socket, or on a
    /// table, which can leave it. Distances between what stands close nothing.
    pub(crate) fn may_leave(&self) -> bool {
        let carried =
            |name: &String| self.points.iter().any(|p| p.name == *name && p.chain.is_some());
        let closes = self.closures.iter().enumerate().filter(|(_, c)| !self.is_link(c));
        let at_stand = |(k, c): (usize, &Closure)| match self.is_on_plane(k) || self.is_on_line(k) {
            true => carried(&c.between[0]),
            false => self.standing_end(k).is_some_and(|end| carried(&c.between[1 - end])),
        };
        self.chains.len() == 1 && self.platform.is_empty() && closes.into_iter().all(at_stand)
    }

    /// Where the points are counted that an instrument sees at the end of a closure whose other end moves, on a body
    /// or a chain: a frame, or the base.
    fn seen_from(&self, closure: usize) -> Option<Option<&String>> {
        let own = &self.closures[closure];
        let named = |name: &String| self.points.iter().find(|point| point.name == *name);
        let standing = self.standing_end(closure)?;
        let seen = named(&own.between[standing]).filter(|point| point.columns.is_some())?;
        let other = named(&own.between[1 - standing])?;
        (other.chain.is_some() || self.body_of(other).is_some()).then_some(seen.frame.as_ref())
    }

    /// True where one instrument sees what is at the ends of both closures.
    pub(crate) fn seen_alike(&self, one: usize, other: usize) -> bool {
        let own = self.seen_from(one);
        own.is_some() && own == self.seen_from(other)
    }

    /// True for the first closure at whose end this instrument sees what moves.
    pub(crate) fn first_seen(&self, closure: usize) -> bool {
        self.seen_from(closure).is_some()
            && !(0..closure).any(|earlier| self.seen_alike(closure, earlier))
    }

    /// The point at which a closure ends that is one of several of a rigid body, by its number: of a moving body, or
    /// of what a chain carries. None where no end, or each, is such a point, and where an earlier closure ends at it.
    pub(crate) fn attachment(&self, closure: usize) -> Option<usize> {
        let between_points = |c: &&Closure| c.kind.is_between_points();
        let own = self.closures.get(closure).filter(between_points)?;
        let one_of_several = |point: &Point| match &point.chain {
            Some(chain) => {
                self.points.iter().filter(|p| p.chain.as_ref() == Some(chain)).count() > 1
            }
            None => self.body_of(point).is_some(),
        };
        let attached = |name: &String| {
            let named = self.points.iter().position(|point| point.name == *name);
            named.filter(|&point| one_of_several(&self.points[point]))
        };
        let point = match own.between.each_ref().map(attached) {
            [Some(point), None] | [None, Some(point)] => point,
            _ => return None,
        };
        let name = &self.points[point].name;
        let mut before = self.closures[..closure].iter().filter(between_points);
        before.all(|earlier| !earlier.between.contains(name)).then_some(point)
    }

    /// True for a point on a plane.
    pub(crate) fn is_on_plane(&self, closure: usize) -> bool {
        self.closures[closure].kind.facts().between[1] == Part::Plane
    }

    /// True for a point on a line.
    pub(crate) fn is_on_line(&self, closure: usize) -> bool {
        self.closures[closure].kind.facts().between[1] == Part::Line
    }

    /// True where a point is on a plane or a line.
    pub(crate) fn touches_surfaces(&self) -> bool {
        (0..self.closures.len()).any(|k| self.is_on_plane(k) || self.is_on_line(k))
    }

    /// A channel and those whose coordinates closures make equal to its own; none without such a closure.
    pub(crate) fn made_equal(&self, channel: usize) -> Vec<usize> {
        let name = self.channels.get(channel).map(|c| &c.name);
        let its = self.closures.iter().filter(|c| c.is_of_channels()).map(|c| &c.between);
        let its = its.filter(|between| between.iter().any(|one| Some(one) == name)).flatten();
        its.filter_map(|one| self.channels.iter().position(|c| c.name == *one)).collect()
    }

    /// A channel and all whose coordinates closures make equal to its own, also over other channels; the channel
    /// first.
    pub(crate) fn all_equal(&self, channel: usize) -> Vec<usize> {
        let mut all = vec![channel];
        let mut next = 0;
        while next < all.len() {
            let new: Vec<usize> = self.made_equal(all[next]);
            for other in new {
                if !all.contains(&other) {
                    all.push(other);
                }
            }
            next += 1;
        }
        all
    }

    /// True for a channel of a joint.
    pub(crate) fn moves_joint(&self, channel: usize) -> bool {
        let name = self.channels.get(channel).map(|c| &c.name);
        let mut rows = self.chains.iter().flat_map(|c| &c.rows);
        rows.any(|r| r.channel.is_some() && r.channel.as_ref() == name)
    }

    /// True for a channel that may go round: of a joint that turns, or of none where its unit is an
    /// angle. A share of a range or a length has no turn.
    #[must_use]
    pub fn goes_round(&self, channel: usize) -> bool {
        let angle = |channel: &Channel| channel.unit == "rad" || channel.unit == "deg";
        let angle = self.channels.get(channel).is_some_and(angle);
        !self.slides(channel) && (angle || self.moves_joint(channel))
    }

    /// The same mechanism with the named closures only.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] for a name that is no closure.
    pub fn with_closures(&self, names: &[String]) -> Result<Self, Error> {
        for name in names {
            self.closure_index(name)?;
        }
        let mut some = self.clone();
        some.closures.retain(|c| names.contains(&c.name));
        Ok(some)
    }

    /// The channels of one chain, in the order of their first rows; empty for an index beyond the
    /// last chain.
    #[must_use]
    pub fn channels_of(&self, chain: usize) -> Vec<usize> {
        let rows = self.chains.get(chain).into_iter().flat_map(|c| &c.rows);
        let names = rows.filter_map(|r| r.channel.as_ref());
        let mut channels = Vec::new();
        for channel in names.filter_map(|n| self.channels.iter().position(|c| c.name == *n)) {
            if !channels.contains(&channel) {
                channels.push(channel);
            }
        }
        channels
    }

    /// True for a single chain that touches unknown points, planes and lines alone. Nothing ties such a
    /// mechanism to its base: a rotation of chain and places together changes no reading.
    #[must_use]
    pub fn floats(&self) -> bool {
        let fixed = |end: &String| {
            let mut points = self.points.iter();
            points.any(|p| p.name == *end && p.chain.is_none() && !p.is_unknown())
                || self.planes.iter().any(|p| p.name == *end && p.unknown.is_none())
                || self.lines.iter().any(|l| l.name == *end && l.unknown.is_none())
        };
        self.chains.len() == 1 && !self.closures.iter().any(|c| c.between.iter().any(fixed))
    }

    /// True for a channel whose coordinate is a length, of a prismatic joint or of a distance itself;
    /// false for an index beyond the last channel.
    #[must_use]
    pub fn slides(&self, channel: usize) -> bool {
        if self.measures(channel) {
            return true;
        }
        let Some(Channel { name, .. }) = self.channels.get(channel) else { return false };
        let mut rows = self.chains.iter().flat_map(|c| &c.rows);
        rows.any(|r| r.channel.as_ref() == Some(name) && r.joint == Motion::Prismatic)
    }

    /// True for a channel that slides or reads a length, and of which nothing says how far it goes.
    pub(crate) fn goes_anywhere(&self, channel: usize) -> bool {
        let free = |of: &Channel| of.limits.is_none() && of.range.is_none();
        self.slides(channel) && self.channels.get(channel).is_some_and(free)
    }

    /// The chain that a channel belongs to; `None` for an index beyond the last channel.
    #[must_use]
    pub fn chain_of(&self, channel: usize) -> Option<usize> {
        (0..self.chains.len()).find(|&c| self.channels_of(c).contains(&channel))
    }

    /// True where a channel drives a joint by a ratio in the chain of another channel.
    #[must_use]
    pub fn drives(&self, channel: usize, other: usize) -> bool {
        let name = self.channels.get(channel).map(|c| &c.name);
        let chain = self.chain_of(other).and_then(|c| self.chains.get(c));
        let mut rows = chain.into_iter().flat_map(|c| &c.rows);
        channel != other && rows.any(|r| r.channel.as_ref() == name && r.ratio.is_some())
    }

    /// True for a channel that senses a revolute joint, where whole turns make no difference; false
    /// for an index beyond the last channel.
    #[must_use]
    pub fn turns(&self, channel: usize) -> bool {
        let Some(Channel { name, .. }) = self.channels.get(channel) else { return false };
        let rows = self.chains.iter().flat_map(|c| &c.rows);
        let mut own = rows.filter(|row| row.channel.as_ref() == Some(name)).peekable();
        own.peek().is_some() && own.all(|row| row.joint == Motion::Revolute)
    }
}

/// The column that the value of a closure stands in.
fn column_of(closure: &Closure) -> Option<&String> {
    match &closure.value {
        Some(Value::Column(column)) => Some(column),
        _ => None,
    }
}

/// The names, each once, in order of appearance.
fn each_once<'a>(names: impl Iterator<Item = &'a String>) -> Vec<String> {
    let mut once: Vec<String> = Vec::new();
    for name in names {
        if !once.contains(name) {
            once.push(name.clone());
        }
    }
    once
}

/// `at=socket0,group=front` as the index of each column and its value.
pub(super) fn keys_of(text: &str, columns: &[String]) -> Option<Vec<(usize, String)>> {
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
