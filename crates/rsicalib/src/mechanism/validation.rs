//! Checks of a mechanism: names that are known and unique, numbers that can be used.

use crate::Error;
use crate::closures::kind::{Given, Part};
use crate::mechanism::checks::{angles, finite, known, refuse};
use crate::mechanism::degrees::unit_meant;
use crate::mechanism::drawing::{Channel, Closure, Mechanism, Point, Row, Value};
use crate::mechanism::law::{Law, Variable};
use crate::mechanism::queries::list;
use crate::numerics::bounds;
use crate::text::{brief, number, quoted};

impl Mechanism {
    /// Checks that every name is known and unique, and that every number can be used.
    ///
    /// # Errors
    ///
    /// [`Error::Mechanism`] with the entry, what was found and what was expected.
    pub fn validate(&self) -> Result<(), Error> {
        self.check_parts()?;
        self.check_channels()
    }

    /// The same, but for channels that nothing reads: where closures are left out some have none.
    pub(crate) fn check_parts(&self) -> Result<(), Error> {
        if let Some(gravity) = &self.gravity {
            finite(gravity.iter(), || "gravity".into())?;
            if gravity.iter().all(|g| *g == 0.0) {
                return Err(refuse("gravity".into(), "[0, 0, 0]".into(), "a direction".into()));
            }
        }
        if self.channels.is_empty() {
            return Err(refuse("channel".into(), "none".into(), "at least one".into()));
        }
        unique("channel", self.channels.iter().map(|c| &c.name))?;
        unique("chain", self.chains.iter().map(|c| &c.name))?;
        unique("point", self.points.iter().map(|p| &p.name))?;
        unique("plane", self.planes.iter().map(|p| &p.name))?;
        unique("line", self.lines.iter().map(|l| &l.name))?;
        unique("frame", self.frames.iter().map(|f| &f.name))?;
        unique("column", self.columns.iter().map(|c| &c.name))?;
        unique("closure", self.closures.iter().map(|c| &c.name))?;
        for channel in &self.channels {
            check_channel(channel)?;
        }
        self.check_chains()?;
        for point in &self.points {
            self.check_point(point)?;
        }
        self.check_places()?;
        for closure in &self.closures {
            self.check_closure(closure)?;
        }
        self.check_workspace()?;
        self.check_platform()?;
        self.check_laws()
    }

    fn check_laws(&self) -> Result<(), Error> {
        for (k, law) in self.laws.iter().enumerate() {
            law.check()?;
            on_one_line(&law.id, || "term".into())?;
            self.check_joints(law)?;
            if self.laws[..k].iter().any(|other| other.id == law.id) {
                let place = format!("term {}", quoted(&law.id));
                return Err(refuse(place, "the name again".into(), "one of its own".into()));
            }
        }
        Ok(())
    }

    /// Refuses a law that refers to a joint which no chain has, or to a column or a channel that is
    /// not declared, and one with a parameter of a column's name.
    fn check_joints(&self, law: &Law) -> Result<(), Error> {
        let most = (0..self.chains.len()).map(|c| self.channels_of(c).len()).max().unwrap_or(0);
        let columns: Vec<&str> = self.columns.iter().map(|c| c.name.as_str()).collect();
        let channels: Vec<&str> = self.channels.iter().map(|c| c.name.as_str()).collect();
        if let Some(name) = law.parameters.keys().find(|p| columns.contains(&p.as_str())) {
            let place = format!("term {}, parameters", quoted(&law.id));
            return Err(refuse(place, quoted(name), "a name that is no column".into()));
        }
        for variable in law.formula_among(&columns, &channels)?.variables {
            if let Variable::Theta(k) = variable
                && k > most
            {
                let (place, expected) =
                    (format!("term {}, {}", quoted(&law.id), law.text().0), "theta[1]");
                let expected = format!("{expected} to theta[{most}]: joints of a chain");
                return Err(refuse(place, format!("theta[{k}]"), expected));
            }
        }
        Ok(())
    }

    fn check_workspace(&self) -> Result<(), Error> {
        let Some(workspace) = &self.workspace else { return Ok(()) };
        for (name, [low, high]) in
            ["x", "y", "z", "rx", "ry", "rz"].into_iter().zip(workspace.bounds())
        {
            finite([&low, &high].into_iter(), || format!("workspace, {name}"))?;
            if name.starts_with('r') {
                angles([&low, &high].into_iter(), || format!("workspace, {name}"))?;
            }
            if low > high {
                let expected = "the lower end first".into();
                let found = format!("[{}, {}]", brief(low), brief(high));
                return Err(refuse(format!("workspace, {name}"), found, expected));
            }
        }
        Ok(())
    }

    fn check_chains(&self) -> Result<(), Error> {
        let mut seen: Vec<(&String, usize, &Row)> = Vec::new();
        for (number, chain) in self.chains.iter().enumerate() {
            for (i, row) in chain.rows.iter().enumerate() {
                let place = || format!("chain {}, row {}", quoted(&chain.name), i + 1);
                check_row(row, place)?;
                let Some(name) = &row.channel else { continue };
                if self.channels.iter().all(|c| c.name != *name) {
                    let known = list(self.channels.iter().map(|c| &c.name));
                    return Err(refuse(place(), format!("channel {}", quoted(name)), known));
                }
                let expected = match seen.iter().find(|(of, ..)| *of == name) {
                    Some((_, chain, _)) if *chain != number => {
                        "all rows of a channel in one chain: a loop between two links of a chain is \
                         drawn in the frame of the first of them, as if that were the base"
                    }
                    Some(_) if row.ratio.is_none() => "each channel at one joint, or a ratio here",
                    Some((.., before)) if before.joint != row.joint => {
                        "joints of one channel that all turn, or all slide"
                    }
                    _ => {
                        seen.push((name, number, row));
                        continue;
                    }
                };
                let found = format!("channel {} again", quoted(name));
                return Err(refuse(place(), found, expected.into()));
            }
        }
        Ok(())
    }

    /// Refuses channels that no joint and no closure has.
    fn check_channels(&self) -> Result<(), Error> {
        let rows = self.chains.iter().flat_map(|chain| &chain.rows);
        let seen: Vec<&String> = rows.filter_map(|row| row.channel.as_ref()).collect();
        let senses = |channel: &Channel| {
            let between = |c: &Closure| {
                let parts = c.kind.facts().between.into_iter().zip(&c.between);
                let named =
                    |(part, name): (Part, &String)| part == Part::Channel && *name == channel.name;
                c.channel.as_ref() == Some(&channel.name) || parts.into_iter().any(named)
            };
            seen.contains(&&channel.name) || self.closures.iter().any(between)
        };
        match self.channels.iter().find(|channel| !senses(channel)) {
            Some(channel) => Err(refuse(
                format!("channel {}", quoted(&channel.name)),
                "no joint that it senses".into(),
                "a row of a chain that names it, or a closure".into(),
            )),
            None => Ok(()),
        }
    }

    fn check_point(&self, point: &Point) -> Result<(), Error> {
        let place = || format!("point {}", quoted(&point.name));
        if let Some(chain) = &point.chain {
            known(self.chain_index(chain), place)?;
        }
        finite(point.at.iter().flatten(), place)?;
        self.check_where(point)?;
        let own = point.is_unknown() && point.chain.is_none() && point.columns.is_none();
        match (&point.at, &point.columns) {
            _ if own => Ok(()),
            (Some(_), None) if !point.is_unknown() => Ok(()),
            (None, Some(_)) if !point.is_unknown() && point.chain.is_none() => Ok(()),
            _ => Err(refuse(
                place(),
                "neither a place nor an unknown, or both".into(),
                "`at = [x, y, z]`, or `unknown = [columns]` without a chain, or `columns`".into(),
            )),
        }
    }

    fn check_closure(&self, closure: &Closure) -> Result<(), Error> {
        let place = || format!("closure {}", quoted(&closure.name));
        for noise in closure.noise.iter().chain(&closure.sd) {
            if !(bounds::usable(*noise) && *noise >= 0.0) {
                return Err(refuse(place(), format!("{noise}"), "a length of 0 or more".into()));
            }
        }
        let given = closure.kind.facts().given == Given::Value;
        // Of a plane, how high above it the point is, where a column says so.
        let heights = closure.kind.facts().between[1] == Part::Plane;
        let usable = match (&closure.value, &closure.channel) {
            (None, None) => !given,
            (Some(value), None) => match value.known() {
                Some(known) => given && bounds::positive(known),
                None => given || heights,
            },
            (None, Some(_)) => given,
            (Some(_), Some(_)) => false,
        };
        if !usable {
            let expected = "a positive `value` for a distance, or the `channel` that reads it; \
                            neither for any other kind, but for a plane a column of heights";
            let found = match (&closure.value, &closure.channel) {
                (None, None) => "no value".into(),
                (Some(Value::Known(value)), None) => format!("a value of {value}"),
                (Some(Value::Column(column)), None) => {
                    format!("a value in column {}", quoted(column))
                }
                (None, Some(channel)) => format!("channel {}", quoted(channel)),
                (Some(_), Some(channel)) => format!("a value, and channel {}", quoted(channel)),
            };
            return Err(refuse(place(), found, expected.into()));
        }
        let [a, b] = &closure.between;
        if a == b {
            return Err(refuse(place(), format!("{} twice", quoted(a)), "two of them".into()));
        }
        if self.is_link(closure) {
            return self.check_unknowns(closure);
        }
        if let Some(channel) = &closure.channel {
            known(self.channel_index(channel), place)?;
        }
        for (part, name) in closure.kind.facts().between.into_iter().zip(&closure.between) {
            known(self.index_of(part, name), place)?;
        }
        self.check_that_it_varies(closure)
    }

    /// Refuses a closure of what is unknown in each pose that nothing measures and that has no noise: it
    /// has no variance by which it could be weighed.
    fn check_that_it_varies(&self, closure: &Closure) -> Result<(), Error> {
        let parts = closure.kind.facts().between.into_iter().zip(&closure.between);
        let ends = parts.filter(|(part, _)| *part == Part::Point);
        let ends: Vec<&Point> =
            ends.filter_map(|(_, name)| self.points.iter().find(|p| p.name == *name)).collect();
        let read = |point: &&Point| point.chain.is_some() || point.columns.is_some();
        let measured = closure.channel.is_some() || matches!(closure.value, Some(Value::Column(_)));
        let noisy = measured || closure.noise.is_some_and(|noise| noise > 0.0);
        if noisy || ends.iter().any(read) || !ends.iter().any(|point| self.is_moving(point)) {
            return Ok(());
        }
        let place = format!("closure {}", quoted(&closure.name));
        let rigid = ends.len() == 2 && ends.iter().all(|point| self.is_moving(point));
        let (found, expected) = match rigid {
            true => (
                "a known distance between two points that are somewhere else in each pose, and no `noise`",
                "points of one rigid body: a [[frame]] with `unknown = [\"pose\"]`, and at each point \
                 `frame` with its name and `at` in it; where they are on two bodies, `noise`: how well \
                 the distance is known",
            ),
            false => (
                "a point that is somewhere else in each pose, nothing that measures it here, and no `noise`",
                "`noise`: how well the closure holds",
            ),
        };
        Err(refuse(place, found.into(), expected.into()))
    }

    /// Checks that both ends of a distance between unknown points name a point and its columns.
    fn check_unknowns(&self, closure: &Closure) -> Result<(), Error> {
        match closure.between.iter().find(|end| self.unknown_end(end).is_none()) {
            None => Ok(()),
            Some(end) => {
                let unknown = self.points.iter().filter(|p| p.is_unknown());
                let known = unknown.map(|p| format!("{}[{}=…]", p.name, p.keys().join("=…,")));
                let known: Vec<String> = known.collect();
                let expected = match known.is_empty() {
                    true => "points of the mechanism".into(),
                    false => format!("unknown points with columns of theirs: {}", known.join(", ")),
                };
                let place = format!("closure {}, between", quoted(&closure.name));
                Err(refuse(place, quoted(end), expected))
            }
        }
    }

    fn check_platform(&self) -> Result<(), Error> {
        for (name, at) in &self.platform {
            known(self.point_index(name), || "platform".into())?;
            let point = self.points.iter().find(|point| point.name == *name);
            if let Some(Point { chain: None, frame, .. }) = point {
                let of_frame = |frame: &String| format!("a point of the frame {}", quoted(frame));
                let found = frame.as_ref().map_or("a point of no chain".into(), of_frame);
                let expected =
                    "a point that a chain carries: where others are is not told by readings alone";
                return Err(refuse(format!("platform, {name}"), found, expected.into()));
            }
            finite(at.iter(), || format!("platform, {name}"))?;
        }
        if let Some(rest) = &self.rest {
            finite(rest.pose.iter(), || "rest, pose".into())?;
            angles(rest.pose[3..].iter(), || "rest, pose".into())?;
        }
        let rest = self.rest.iter().filter_map(|rest| Some(("rest", rest.sd?)));
        let model = self.model.sd.iter().map(|(term, sd)| (term.as_str(), *sd));
        if let Some((what, sd)) = rest.chain(model).find(|(_, sd)| !bounds::positive(*sd)) {
            return Err(refuse(format!("{what}, sd"), sd.to_string(), "a positive number".into()));
        }
        if self.closures.is_empty() {
            return Err(refuse("closure".into(), "none".into(), "at least one".into()));
        }
        Ok(())
    }
}

fn unique<'a>(kind: &str, names: impl Iterator<Item = &'a String>) -> Result<(), Error> {
    let mut seen = Vec::new();
    for name in names {
        if seen.contains(&name) || name.is_empty() {
            let place = format!("{kind} {}", quoted(name));
            return Err(refuse(place, "the name again, or none".into(), "one of its own".into()));
        }
        on_one_line(name, || kind.into())?;
        seen.push(name);
    }
    Ok(())
}

/// Characters of a line of a screen: what people are to read is no longer.
const LINE: usize = 80;

/// Refuses names and labels that no line of a report can show: empty ones, those with line breaks or
/// other controls, and those longer than a line.
fn on_one_line(text: &str, place: impl Fn() -> String) -> Result<(), Error> {
    let count = text.chars().count();
    let found = match () {
        () if text.trim().is_empty() => "nothing to read".into(),
        () if text.chars().any(char::is_control) => format!("{} with a line break", quoted(text)),
        () if count > LINE => format!("{count} characters"),
        () => return Ok(()),
    };
    Err(refuse(place(), found, format!("1 to {LINE} characters on one line")))
}

fn check_row(row: &Row, place: impl Fn() -> String) -> Result<(), Error> {
    let numbers = [row.theta, row.d, row.a, row.alpha];
    finite(numbers.iter().chain(&row.xyz).chain(&row.rpy).chain(&row.com), &place)?;
    angles([row.theta, row.alpha].iter().chain(&row.rpy), &place)?;
    if let Some(mass) = row.mass.filter(|m| !(bounds::usable(*m) && *m >= 0.0)) {
        return Err(refuse(place(), format!("mass {mass}"), "a number of 0 or more".into()));
    }
    let Some(ratio) = row.ratio else { return Ok(()) };
    let expected = match (&row.channel, ratio != 0.0 && bounds::usable(ratio)) {
        (Some(_), true) => return Ok(()),
        (Some(_), false) => "a number other than 0",
        (None, _) => "a channel of which it is the ratio",
    };
    Err(refuse(place(), format!("ratio {}", number(ratio)), expected.into()))
}

fn check_channel(channel: &Channel) -> Result<(), Error> {
    if let Some(label) = &channel.label {
        on_one_line(label, || format!("channel {}: label", quoted(&channel.name)))?;
    }
    let place = || format!("channel {}", quoted(&channel.name));
    finite([channel.gain, channel.offset].iter(), place)?;
    if let Some(unit) = unit_meant(&channel.unit) {
        let found = format!("unit {}", quoted(&channel.unit));
        return Err(refuse(place(), found, format!("{}, as files write it", quoted(unit))));
    }
    if !bounds::positive(channel.gain.abs()) {
        let found = format!("gain {}", number(channel.gain));
        return Err(refuse(place(), found, "a gain other than zero".into()));
    }
    for [low, high] in channel.range.iter().chain(&channel.limits) {
        if !(bounds::usable(*low) && bounds::usable(*high) && low < high) {
            let expected = "the lower end before the upper";
            return Err(refuse(
                place(),
                format!("[{}, {}]", brief(*low), brief(*high)),
                expected.into(),
            ));
        }
    }
    for (what, size) in [("noise", channel.noise), ("share", channel.share)] {
        if let Some(size) = size.filter(|size| !bounds::positive(*size)) {
            return Err(refuse(place(), format!("{what} {size}"), "a positive number".into()));
        }
    }
    if channel.passive && (channel.torque.is_some() || channel.share.is_some()) {
        let found = "torque or share, with passive = true";
        return Err(refuse(place(), found.into(), "a joint that has a drive".into()));
    }
    Ok(())
}
