//! Random configurations of a mechanism in which the loops are closed.
//!
//! Joint coordinates `q` are drawn within the joint limits. Newton's method with the shortest
//! step then closes the loops,
//!
//! ```text
//! q ← q - Gᵀ (G Gᵀ)⁻¹ f,    G = ∂f/∂q                                     (10, 44)
//! ```
//!
//! Places that are of one pose alone are found with the joints. Distances that the readings measure
//! and points that an instrument sees close nothing: they are computed afterwards.

use faer::linalg::solvers::Svd;
use faer::{Mat, Side};

use crate::Error;
use crate::mechanism::{Channel, Mechanism};
use crate::model::compiled::{CompiledClosure, Model};
use crate::model::ends::End;
use crate::model::numbering::Unknown;
use crate::model::prior::Prior;
use crate::model::scattered::scatter;
use crate::model::shown::{Shown, reaching};
use crate::model::thing::Thing;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::Lanes;
use crate::numerics::random::Random;
use crate::numerics::rank::{RANK, eliminated};
use crate::numerics::workers;
use crate::readings::{Readings, Table};
use crate::text::{listed, quoted};

/// Values of a column that tells unknown points apart, where the mechanism names none.
const PLACEMENTS: usize = 6;

/// Upper limit of the combinations of such values.
const MOST_KEYS: usize = 10_000;

/// Rows of a session that configurations are drawn about.
pub(crate) const ROWS: usize = 64;

/// Steps of one configuration: Newton's, or those of a path.
pub(crate) const STEPS: usize = 60;

/// Rounds of drawing, each twice what is missing.
const ROUNDS: usize = 40;

/// Rounds after which nothing more is drawn for keys of which none has closed, if so many were drawn as all rounds
/// draw for one. Of twenty draws for each that is asked for none has closed.
const HOPELESS: usize = 10;

/// Longest step of a joint, Newton's or of a path [rad, or lengths of the longest link].
pub(crate) const LONGEST_STEP: f64 = 0.3;

/// Misclosure of a closed configuration, as a fraction of the reach.
const CLOSED: f64 = 1e-10;

/// Place of an unknown point: its number in the mechanism, its keys, where it is.
type Placed = (Thing, Vec<String>, Vec<f64>);

/// The model of readings, and its parameters.
pub(crate) type Under<'a> = dyn Fn(&Readings) -> Result<(Model, Vec<f64>), Error> + 'a;

/// Random configurations that need not close, and the model of their loops.
pub(crate) struct Open {
    pub(crate) readings: Readings,
    pub(crate) model: Model,
    pub(crate) beta: Vec<f64>,
}

/// Configurations with these keys, where there are.
pub(crate) type Draw<'a> =
    dyn FnMut(&[usize], &mut Random) -> Result<Vec<Option<Closed>>, Error> + 'a;

/// Where the joints of a mechanism may be, and which unknown points its tips may touch.
#[derive(Debug)]
pub(crate) struct Configurations {
    /// The mechanism without ranges: what joints can do is in the limits.
    free: Mechanism,
    /// Lowest and highest coordinate of each channel.
    limits: Vec<[f64; 2]>,
    /// Of each channel, whether its file says so.
    declared: Vec<bool>,
    /// What a step of one is for each channel [rad, or length].
    spread: Vec<f64>,
    /// Length of the longest chain.
    reach: f64,
    /// Combinations of the columns that tell unknown points apart.
    keys: Vec<Vec<String>>,
    /// Where the unknown points are.
    places: Vec<Placed>,
    /// Rows of a session that configurations are drawn about, with their keys; empty: about none.
    about: Vec<(Vec<String>, Vec<f64>)>,
    /// What a session shows of where the mechanism can be; none: its file tells.
    shown: Option<Shown>,
}

impl Configurations {
    /// Of a mechanism; unknown points are placed where its chains can touch them.
    ///
    /// # Errors
    ///
    /// As [`Mechanism::validate`] and [`Readings::new`].
    pub(crate) fn new(mechanism: &Mechanism, random: &mut Random) -> Result<Self, Error> {
        mechanism.validate()?;
        let all = keys(mechanism)?;
        let together = Self::made(mechanism, all.clone(), random)?;
        let apart = alone(mechanism);
        if apart.len() < 2 || together.closed(1, random).is_ok() {
            return Ok(together);
        }
        // A tip in a cone is on no table: one at a time.
        Self::made(mechanism, blanked(all, &apart), random)
    }

    fn made(
        mechanism: &Mechanism,
        keys: Vec<Vec<String>>,
        random: &mut Random,
    ) -> Result<Self, Error> {
        let made = Self::of_keys(mechanism, keys);
        let free = made.free.clone();
        made.with_places(random, &|readings| {
            let model = Model::uncentred(&free, readings, Vec::new())?;
            let beta = model.nominal();
            Ok((model, beta))
        })
    }

    /// Of a mechanism that touches other points, planes and frames than those of a session: their keys
    /// are other ones, but blank where those of the session are.
    pub(crate) fn of_others(mechanism: &Mechanism, readings: &Readings) -> Result<Self, Error> {
        let blanks = |group: &Vec<String>| group.iter().map(String::is_empty).collect();
        let mut patterns: Vec<Vec<bool>> = readings.groups.iter().map(blanks).collect();
        patterns.sort_unstable();
        patterns.dedup();
        Ok(Self::of_keys(mechanism, blanked(keys(mechanism)?, &patterns)))
    }

    /// Of a mechanism whose unknown points are told apart by these combinations of their columns,
    /// and lie where a model says.
    pub(crate) fn of_keys(mechanism: &Mechanism, keys: Vec<Vec<String>>) -> Self {
        let reach = reach(mechanism);
        let longest = longest(mechanism).unwrap_or(reach);
        let mut free = mechanism.clone();
        for channel in &mut free.channels {
            (channel.range, channel.limits) = (None, None);
        }
        // Leans of lines count from one axis, wherever these configurations are.
        for line in &mut free.lines {
            line.direction.get_or_insert([0.0, 0.0, 1.0]);
        }
        let declared = |c: &Channel| c.limits.is_some() || c.range.is_some();
        let limits: Vec<[f64; 2]> =
            (0..free.channels.len()).map(|c| limits(mechanism, c, longest, reach)).collect();
        Self {
            spread: spread(mechanism, &limits),
            limits,
            declared: mechanism.channels.iter().map(declared).collect(),
            reach,
            keys,
            places: Vec::new(),
            about: Vec::new(),
            shown: None,
            free,
        }
    }

    /// The same, drawn about rows of a session: between a row and anywhere. A slide of which the file does not tell how
    /// far it goes reaches what the session shows, and a tenth beyond.
    pub(crate) fn about(mut self, readings: &Readings) -> Self {
        for c in (0..self.limits.len()).filter(|&c| !self.declared[c] && self.free.slides(c)) {
            let shown = (0..readings.samples).map(|row| {
                let read = readings.row(row)[c];
                self.free.channels[c].angle(read)
            });
            let [low, high] = reaching(shown);
            let [a, b] = self.limits[c];
            self.limits[c] = [a.min(low), b.max(high)];
        }
        self.spread = spread(&self.free, &self.limits);
        self.near(readings)
    }

    /// The same, drawn about rows of a session.
    fn near(self, readings: &Readings) -> Self {
        let every = readings.samples.div_ceil(ROWS);
        let mut about = Vec::new();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let raw = readings.raw(block);
            for lane in (0..meta.live).filter(|&lane| meta.rows[lane] % every == 0) {
                let keys = readings.groups.get(meta.group).cloned().unwrap_or_default();
                about.push((keys, raw.iter().map(|a| a.0[lane]).collect()));
            }
        }
        Self { about, ..self }
    }

    /// The same, within what a session shows where the file does not tell how far the mechanism goes.
    pub(crate) fn within_shown(
        mut self,
        model: &Model,
        of: (&Readings, &[f64]),
        beta: &[f64],
    ) -> Self {
        let Some(shown) = Shown::by(model, of, beta) else { return self };
        for (c, span) in shown.channels.iter().enumerate() {
            if let Some(span) = span {
                let [a, b] = span.map(|reading| self.free.channels[c].angle(reading));
                self.limits[c] = [a.min(b), a.max(b)];
            }
        }
        self.spread = spread(&self.free, &self.limits);
        Self { shown: Some(shown), ..self.near(of.0) }
    }

    /// The mechanism without ranges and limits.
    pub(crate) fn mechanism(&self) -> &Mechanism {
        &self.free
    }

    /// What each equation is divided by to have no unit of length.
    pub(crate) fn sizes(&self, model: &Model) -> Vec<f64> {
        let size = |c: &CompiledClosure| match c.is_of_coordinates() {
            true => 1.0,
            false => self.reach.powi(c.kind.facts().dimension),
        };
        let of = |c: &CompiledClosure| std::iter::repeat_n(size(c), c.equations());
        model.closures.iter().flat_map(of).collect()
    }

    /// `X` by all parameters, each equation over its size, what is of one pose alone eliminated, and
    /// below it the slopes of the known distances between unknown points.
    pub(crate) fn slopes(&self, model: &Model, readings: &Readings, beta: &[f64]) -> Mat<f64> {
        let by: Vec<f64> = self.sizes(model).iter().map(|s| s.recip()).collect();
        let x = without_places(model, readings, beta, &by);
        let links = model.links();
        let rows = x.nrows();
        let mut x = Mat::from_fn(rows + links.len(), x.ncols(), |i, j| match i < rows {
            true => x[(i, j)],
            false => 0.0,
        });
        for (i, link) in links.iter().enumerate() {
            for (column, slope) in apart(link, beta).1 {
                x[(rows + i, column)] += slope;
            }
        }
        x
    }

    /// Combinations of keys.
    pub(crate) fn combinations(&self) -> usize {
        self.keys.len()
    }

    /// Readings of random configurations that need not close, one for each of these keys.
    pub(crate) fn open(&self, keys: &[usize], random: &mut Random) -> Result<Readings, Error> {
        let values = keys.iter().flat_map(|key| self.draw(*key, random)).collect();
        self.at(keys, values, random)
    }

    /// Readings of these values, row by row, one row for each of these keys.
    fn at(&self, keys: &[usize], values: Vec<f64>, random: &mut Random) -> Result<Readings, Error> {
        let columns = self.columns(keys.len(), random);
        Readings::new(&self.free, self.table(values, keys, columns))
    }

    /// Columns of so many rows: ones, which the loops then replace, and any numbers where only laws
    /// use a column.
    fn columns(&self, rows: usize, random: &mut Random) -> Vec<Vec<f64>> {
        let own = |name: &String| self.free.columns.iter().any(|column| column.name == *name);
        let mut of = |name: &String| match own(name) {
            true => (0..rows).map(|_| random.uniform(-1.0, 1.0)).collect(),
            false => vec![1.0; rows],
        };
        self.free.value_columns().iter().map(&mut of).collect()
    }

    /// Readings of so many closed configurations for each combination of keys.
    ///
    /// # Errors
    ///
    /// [`Error::Mechanism`] where fewer than three of four are found.
    pub(crate) fn closed(&self, each: usize, random: &mut Random) -> Result<Readings, Error> {
        self.closed_by(each, random, &|readings| {
            let model = Model::uncentred(&self.free, readings, Vec::new())?;
            let beta = model.nominal();
            Ok((model, beta))
        })
    }

    /// As [`Configurations::closed`], of the loops of another model of the readings.
    pub(crate) fn closed_by(
        &self,
        each: usize,
        random: &mut Random,
        under: &Under<'_>,
    ) -> Result<Readings, Error> {
        self.closed_of(each, random, 2, &mut |keys, random| self.close(keys, random, under))
    }

    /// As [`Configurations::closed`], of those that are drawn, of each that is missing so many.
    pub(crate) fn closed_of(
        &self,
        each: usize,
        random: &mut Random,
        drawn: usize,
        draw: &mut Draw<'_>,
    ) -> Result<Readings, Error> {
        let mut found: Vec<Vec<Closed>> = vec![Vec::new(); self.keys.len()];
        for round in 0..ROUNDS {
            let missing = |(key, found): (usize, &Vec<Closed>)| {
                let hopeless = round >= HOPELESS && each * round >= ROUNDS && found.is_empty();
                std::iter::repeat_n(key, if hopeless { 0 } else { drawn * (each - found.len()) })
            };
            let wanted: Vec<usize> = found.iter().enumerate().flat_map(missing).collect();
            if wanted.is_empty() {
                break;
            }
            for (key, closed) in wanted.iter().zip(draw(&wanted, random)?) {
                let own = &mut found[*key];
                own.extend(closed.filter(|_| own.len() < each));
            }
        }
        let (kept, asked) = (found.iter().map(Vec::len).sum::<usize>(), each * self.keys.len());
        if 4 * kept < 3 * asked {
            return Err(Error::Mechanism {
                place: quoted(&self.free.name),
                found: format!("{kept} of {asked} random configurations that close"),
                expected: self.wanted(),
            });
        }
        self.readings_of(&found)
    }

    /// Readings of closed configurations, those of each combination of keys together.
    pub(crate) fn readings_of(&self, found: &[Vec<Closed>]) -> Result<Readings, Error> {
        let keys: Vec<usize> =
            found.iter().enumerate().flat_map(|(k, f)| std::iter::repeat_n(k, f.len())).collect();
        let every = || found.iter().flatten();
        let values = every().flat_map(|c| c.values.iter().copied()).collect();
        let columns = (0..self.free.value_columns().len())
            .map(|k| every().map(|c| c.distances[k]).collect())
            .collect();
        Readings::new(&self.free, self.table(values, &keys, columns))
    }

    /// What a mechanism lacks whose loops do not close.
    fn wanted(&self) -> String {
        let named = |wanted: &dyn Fn(usize) -> bool| -> Vec<String> {
            let undeclared = (0..self.limits.len()).filter(|&c| !self.declared[c] && wanted(c));
            undeclared.map(|c| self.free.channels[c].name.clone()).collect()
        };
        let measured = named(&|c| self.free.measures(c));
        let joints = named(&|c| self.free.moves_joint(c) && !self.free.measures(c));
        let of = |key: &str, channels: &[String]| match channels.is_empty() {
            true => None,
            false => Some(format!("`{key}` of the channels {}", listed(channels))),
        };
        let wanted: Vec<String> =
            of("range", &measured).into_iter().chain(of("limits", &joints)).collect();
        match wanted.is_empty() {
            true => "lengths, limits and ranges with which its loops can be closed".into(),
            false => format!("{}, with which its loops can be closed", wanted.join(", ")),
        }
    }

    /// The drawing's parameters, with what is unknown in its place.
    pub(crate) fn nominal(&self, model: &Model) -> Vec<f64> {
        let mut beta = model.nominal();
        self.put(model, &mut beta);
        beta
    }

    /// Puts what is unknown in its place.
    pub(crate) fn put(&self, model: &Model, beta: &mut [f64]) {
        for unknown in &model.unknowns {
            let known = |p: &&Placed| p.0 == unknown.thing && p.1 == unknown.keys;
            if let Some((_, _, at)) = self.places.iter().find(known) {
                let first = model.term_parameters + unknown.first;
                beta[first..first + unknown.width].copy_from_slice(at);
            }
        }
    }

    /// Readings of one random configuration with this key.
    fn draw(&self, key: usize, random: &mut Random) -> Vec<f64> {
        let channels = self.free.channels.iter().zip(&self.limits);
        let mut drawn: Vec<f64> = channels
            .map(|(c, [low, high])| (random.uniform(*low, *high) - c.offset) / c.gain)
            .collect();
        let own = self.about.iter().filter(|(keys, _)| *keys == self.keys[key]);
        let mut rows: Vec<&Vec<f64>> = own.map(|(_, row)| row).collect();
        if rows.is_empty() {
            rows = self.about.iter().map(|(_, row)| row).collect();
        }
        if !rows.is_empty() {
            let row = rows[random.below(rows.len())];
            let part = random.uniform(0.0, 1.0);
            drawn.iter_mut().zip(row).for_each(|(drawn, row)| *drawn = row + part * (*drawn - row));
        }
        drawn
    }

    fn table(&self, values: Vec<f64>, keys: &[usize], columns: Vec<Vec<f64>>) -> Table {
        let texts = (0..self.free.key_columns().len())
            .map(|c| keys.iter().map(|&k| self.keys[k][c].clone()).collect())
            .collect();
        Table { values, keys: texts, columns, ..Table::default() }
    }

    /// One configuration for each of these keys; none where Newton's method ends elsewhere.
    fn close(
        &self,
        keys: &[usize],
        random: &mut Random,
        under: &Under<'_>,
    ) -> Result<Vec<Option<Closed>>, Error> {
        let open = self.opened(keys, random, under)?;
        let blocks = workers::map(0..open.readings.blocks().len(), |block| {
            let start = self.start(&open, block, &mut Workspace::default());
            let closed = self.close_block(&open, block, start);
            open.readings.blocks()[block].rows.into_iter().zip(closed).collect::<Vec<_>>()
        });
        let mut found = vec![None; keys.len()];
        for (row, closed) in blocks.into_iter().flatten() {
            found[row] = closed;
        }
        Ok(found)
    }

    /// As [`Configurations::open`], with what is unknown in its place.
    pub(crate) fn opened(
        &self,
        keys: &[usize],
        random: &mut Random,
        under: &Under<'_>,
    ) -> Result<Open, Error> {
        self.in_place(self.open(keys, random)?, under)
    }

    /// The same of configurations with these readings, row by row.
    pub(crate) fn opened_at(
        &self,
        keys: &[usize],
        values: Vec<f64>,
        random: &mut Random,
        under: &Under<'_>,
    ) -> Result<Open, Error> {
        self.in_place(self.at(keys, values, random)?, under)
    }

    fn in_place(&self, readings: Readings, under: &Under<'_>) -> Result<Open, Error> {
        let (model, mut beta) = under(&readings)?;
        self.put(&model, &mut beta);
        Ok(Open { readings, model, beta })
    }

    /// Where the samples of one block are, with what is unknown in each alone.
    pub(crate) fn start(&self, open: &Open, block: usize, ws: &mut Workspace) -> Vec<Lanes> {
        let Open { readings, model, beta } = open;
        let want = Want { x: false, a: true };
        model.evaluate(readings, block, readings.raw(block), beta, want, ws);
        if model.closures.iter().any(|closure| seen(closure).is_some()) {
            // Nothing has been seen yet: what is of one pose alone is looked for where it is drawn.
            for (slot, drawn) in model.posed.slots() {
                slot.iter().for_each(|&slot| ws.xi[slot] = Lanes::splat(drawn));
            }
        }
        readings.raw(block).iter().chain(&ws.xi).copied().collect()
    }

    /// Newton's method on the samples of one block.
    pub(crate) fn close_block(
        &self,
        open: &Open,
        block: usize,
        mut at: Vec<Lanes>,
    ) -> Vec<Option<Closed>> {
        let Open { readings, model, beta } = open;
        let meta = &readings.blocks()[block];
        let sizes = self.sizes(model);
        let known: Vec<usize> = model
            .closures
            .iter()
            .filter(|c| closes(c))
            .flat_map(|c| c.equation..c.equation + c.equations())
            .collect();
        let (mut ws, want) = (Workspace::default(), Want { x: false, a: true });
        let misclosure = |ws: &Workspace, lane: usize| -> Vec<f64> {
            known.iter().map(|&k| ws.f[k].0[lane] / sizes[k]).collect()
        };
        for _ in 0..STEPS {
            model.evaluate(readings, block, &at, beta, want, &mut ws);
            let mut moved = false;
            for lane in 0..meta.live {
                let f = misclosure(&ws, lane);
                if largest(&f) > 1e-3 * CLOSED {
                    self.step(&f, &ws, &known, &sizes, lane, &mut at);
                    moved = true;
                }
            }
            if !moved {
                break;
            }
        }
        model.evaluate(readings, block, &at, beta, want, &mut ws);
        let lane = |lane: usize| {
            let values: Vec<f64> = at[..self.spread.len()].iter().map(|a| a.0[lane]).collect();
            let closed = largest(&misclosure(&ws, lane)) < CLOSED
                && self.within(&values, &mut at[self.spread.len()..].iter().map(|a| a.0[lane]));
            let distances = measured(model, readings, block, beta, &ws, lane);
            let places = at[self.spread.len()..].iter().map(|a| a.0[lane]).collect();
            closed.then_some(Closed { values, places, distances })
        };
        (0..meta.live).map(lane).collect()
    }

    /// One Newton step of one sample.
    fn step(
        &self,
        f: &[f64],
        ws: &Workspace,
        known: &[usize],
        sizes: &[f64],
        lane: usize,
        at: &mut [Lanes],
    ) {
        let (channels, places) = (self.spread.len(), ws.xi.len());
        let per_step = |c: usize| self.per_step(c);
        let g = Mat::from_fn(known.len(), channels + places, |i, c| {
            let by = match c < channels {
                true => ws.a[known[i] * channels + c],
                false => ws.b[known[i] * places + c - channels],
            };
            by.0[lane] * per_step(c) / sizes[known[i]]
        });
        let step = shortest(&g, f);
        let shrink = (LONGEST_STEP / largest(&step)).min(1.0);
        for (c, step) in step.iter().enumerate() {
            at[c].0[lane] -= step * shrink * per_step(c);
        }
    }

    /// What a step of one is for a reading, or for what is unknown in one pose alone.
    fn per_step(&self, c: usize) -> f64 {
        match c < self.spread.len() {
            true => self.spread[c] / self.free.channels[c].gain,
            false => self.reach,
        }
    }

    /// Steps of about one of each reading, and of what is unknown in one pose alone.
    pub(crate) fn units(&self, model: &Model) -> Vec<f64> {
        let channels = self.spread.len();
        let turns = model.posed.turns();
        let of = |c: usize| match c >= channels && turns.contains(&(c - channels)) {
            true => 1.0,
            false => self.per_step(c).abs(),
        };
        (0..model.stride()).map(of).collect()
    }

    /// Lowest and highest of each in these units, where the file or a session tells them.
    pub(crate) fn ends(&self, units: &[f64]) -> Vec<[f64; 2]> {
        let shown = self.shown.as_ref();
        let span = |c: usize| match self.free.channels.get(c) {
            None => shown.and_then(|shown| shown.places.get(c - self.spread.len()).copied()),
            Some(channel) => {
                let told = self.declared[c] || shown.is_some_and(|s| s.channels[c].is_some());
                let ends = self.limits[c].map(|end| (end - channel.offset) / channel.gain);
                told.then_some([ends[0].min(ends[1]), ends[0].max(ends[1])])
            }
        };
        let of = |(c, unit): (usize, &f64)| match span(c) {
            Some(span) => span.map(|end| end / unit),
            None => [f64::NEG_INFINITY, f64::INFINITY],
        };
        units.iter().enumerate().map(of).collect()
    }

    /// A whole turn of each in these units; zero where it does not turn, or only so far.
    pub(crate) fn turns(&self, units: &[f64]) -> Vec<f64> {
        let free = |c: usize| {
            let turns = self.free.moves_joint(c) && !self.free.slides(c);
            turns && !self.declared[c]
        };
        let turn = |(c, unit): (usize, &f64)| match c < self.spread.len() && free(c) {
            true => 2.0 * std::f64::consts::PI / (self.free.channels[c].gain.abs() * unit),
            false => 0.0,
        };
        units.iter().enumerate().map(turn).collect()
    }

    /// Which of the combinations of keys a row of readings has.
    pub(crate) fn key_of(&self, readings: &Readings, row: usize) -> Option<usize> {
        let (block, _) = readings.lane_of_rows()[row];
        let own = readings.groups.get(readings.blocks()[block].group)?;
        self.keys.iter().position(|keys| keys == own)
    }

    /// True within the limits of the joints, and what a session shows. Without a session what is on no joint
    /// is whatever closes the loops.
    fn within(&self, values: &[f64], places: &mut dyn Iterator<Item = f64>) -> bool {
        let channels = self.free.channels.iter().zip(&self.limits).zip(values);
        let mut inside = channels.enumerate().map(|(k, ((c, [low, high]), v))| {
            let q = c.angle(*v);
            (q >= *low && q <= *high) || !(self.shown.is_some() || self.free.moves_joint(k))
        });
        inside.all(|inside| inside) && self.shown.as_ref().is_none_or(|shown| shown.holds(places))
    }

    /// The same with what is unknown in places that the tips of chains can touch, known distances
    /// apart.
    pub(crate) fn with_places(
        mut self,
        random: &mut Random,
        under: &Under<'_>,
    ) -> Result<Self, Error> {
        let every: Vec<usize> = (0..self.keys.len()).collect();
        let readings = self.open(&every, random)?;
        let (model, mut beta) = under(&readings)?;
        if model.unknowns.is_empty() {
            return Ok(self);
        }
        scatter(&model, &readings, self.reach, random, &mut beta);
        let links = model.links();
        for _ in 0..ROUNDS {
            let off: Vec<f64> = links.iter().map(|link| apart(link, &beta).0).collect();
            if largest(&off) < 1e-12 * self.reach {
                break;
            }
            // The shortest step that puts linked points at their distances.
            let mut slopes = Mat::zeros(links.len(), beta.len());
            for (i, link) in links.iter().enumerate() {
                for (column, slope) in apart(link, &beta).1 {
                    slopes[(i, column)] += slope;
                }
            }
            let terms = model.term_parameters;
            for (beta, step) in beta.iter_mut().zip(shortest(&slopes, &off)).skip(terms) {
                *beta -= step;
            }
        }
        let at = |unknown: &Unknown| {
            beta[model.term_parameters + unknown.first..][..unknown.width].to_vec()
        };
        self.places = model.unknowns.iter().map(|u| (u.thing, u.keys.clone(), at(u))).collect();
        Ok(self)
    }
}

/// Misclosure, and `X` by all parameters, sample by sample: all equations, of which none is taken up by what is unknown in
/// one pose alone.
pub(crate) fn linear(model: &Model, readings: &Readings, beta: &[f64]) -> (Vec<f64>, Mat<f64>) {
    let equations = model.rows();
    let mut f = vec![0.0; readings.samples * equations];
    let mut x = Mat::zeros(f.len(), model.parameters);
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: true, a: false };
        model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            for k in 0..equations {
                f[row * equations + k] = ws.f[k].0[lane];
                let slopes = &ws.x[k * model.width()..];
                for (&column, slope) in model.columns()[meta.group].iter().zip(slopes) {
                    x[(row * equations + k, column)] = slope.0[lane];
                }
            }
        }
    }
    (f, x)
}

/// A configuration in which the loops are closed.
#[derive(Debug, Clone)]
pub(crate) struct Closed {
    values: Vec<f64>,
    /// What is unknown in one pose alone.
    places: Vec<f64>,
    /// What the columns of measured distances hold.
    distances: Vec<f64>,
}

impl Closed {
    /// Readings, and after them what is unknown in one pose alone.
    pub(crate) fn coordinates(&self) -> impl Iterator<Item = f64> {
        self.values.iter().chain(&self.places).copied()
    }
}

/// True for a closure that closes a configuration: what is measured beside it is computed afterwards.
pub(crate) fn closes(closure: &CompiledClosure) -> bool {
    closure.column.is_none() && seen(closure).is_none()
}

/// How far a known distance is off [length], with its slopes.
pub(crate) fn apart(link: &Prior, beta: &[f64]) -> (f64, Vec<(usize, f64)>) {
    let sd = match link {
        Prior::Apart { sd, .. } | Prior::Along { sd, .. } | Prior::Parameter { sd, .. } => *sd,
    };
    let slopes = link.slopes(beta).into_iter().map(|(column, slope)| (column, slope * sd));
    (link.off(beta) * sd, slopes.collect())
}

/// The end of points that touch which an instrument sees.
fn seen(closure: &CompiledClosure) -> Option<usize> {
    let of = |end: &End| matches!(end, End::Seen(..));
    closure.ends.iter().position(of).filter(|_| closure.kind.facts().is_vector)
}

/// Distances and points seen that the readings would bring along, after [`Model::evaluate`].
fn measured(
    model: &Model,
    readings: &Readings,
    block: usize,
    beta: &[f64],
    ws: &Workspace,
    lane: usize,
) -> Vec<f64> {
    let (columns, group) = (readings.columns(block), readings.blocks()[block].group);
    let mut distances: Vec<f64> = columns.iter().map(|c| c.0[lane]).collect();
    for closure in &model.closures {
        if let Some(column) = closure.column {
            distances[column] = ws.f[closure.equation].0[lane] + columns[column].0[lane];
        }
        let end = seen(closure).map(|k| (closure.ends[k], closure.ends[1 - k]));
        if let Some((End::Seen(into, frame, _), other)) = end {
            let at = model.end_point(&other, group, columns, beta, ws).map(|x| x.0[lane]);
            let there = model.seen_from(&frame, group, beta, at);
            into.iter().zip(there).for_each(|(column, x)| distances[*column] = x);
        }
    }
    distances
}

/// `X`, each equation multiplied by its factor, without what the places of one pose take up of it.
fn without_places(model: &Model, readings: &Readings, beta: &[f64], by: &[f64]) -> Mat<f64> {
    let (_, mut x) = linear(model, readings, beta);
    let (equations, places) = (model.rows(), model.pose_unknowns());
    for i in 0..x.nrows() {
        (0..x.ncols()).for_each(|j| x[(i, j)] *= by[i % equations]);
    }
    if places == 0 {
        return x;
    }
    let mut ws = Workspace::default();
    for (block, meta) in readings.blocks().iter().enumerate() {
        let want = Want { x: false, a: true };
        model.evaluate(readings, block, readings.raw(block), beta, want, &mut ws);
        for (lane, &row) in meta.rows.iter().enumerate().take(meta.live) {
            let b = Mat::from_fn(equations, places, |k, c| ws.b[k * places + c].0[lane] * by[k]);
            let own = x.subrows(row * equations, equations).to_owned();
            if let Some(left) = eliminated(own, &b) {
                x.subrows_mut(row * equations, equations).copy_from(left);
            }
        }
    }
    x
}

/// The shortest `z` with `G z = f`; along directions that `G` hardly sees nothing moves.
fn shortest(g: &Mat<f64>, f: &[f64]) -> Vec<f64> {
    let (m, n) = (g.nrows(), g.ncols());
    if m > n {
        return shortest_of_many(g, f);
    }
    let Ok(eigen) = (g * g.transpose()).self_adjoint_eigen(Side::Lower) else {
        return vec![0.0; n];
    };
    let (values, vectors) = (eigen.S().column_vector(), eigen.U());
    let most = (0..m).map(|i| values[i]).fold(0.0, f64::max);
    let mut y = vec![0.0; m];
    for k in (0..m).filter(|&k| values[k] > 1e-13 * most) {
        let along = (0..m).map(|i| vectors[(i, k)] * f[i]).sum::<f64>() / values[k];
        (0..m).for_each(|i| y[i] += vectors[(i, k)] * along);
    }
    (0..n).map(|j| (0..m).map(|i| g[(i, j)] * y[i]).sum()).collect()
}

/// The shortest of the `z` that come nearest to `G z = f`.
fn shortest_of_many(g: &Mat<f64>, f: &[f64]) -> Vec<f64> {
    let n = g.ncols();
    let Ok(svd) = Svd::new_thin(g.as_ref()) else { return vec![0.0; n] };
    let (values, u, v) = (svd.S().column_vector(), svd.U(), svd.V());
    let mut z = vec![0.0; n];
    for k in (0..values.nrows()).filter(|&k| values[k] > RANK * values[0]) {
        let along = f.iter().enumerate().map(|(i, f)| u[(i, k)] * f).sum::<f64>() / values[k];
        (0..n).for_each(|j| z[j] += v[(j, k)] * along);
    }
    z
}

/// The largest size; infinite where one is not a number.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, v| if v.is_nan() { f64::INFINITY } else { m.max(v.abs()) })
}

/// For each closure with columns of its own, which columns of keys are blank where it alone of them
/// holds: those of others that it does not have.
fn alone(mechanism: &Mechanism) -> Vec<Vec<bool>> {
    let columns = mechanism.key_columns();
    let own = |k: usize| -> Vec<bool> {
        let its = mechanism.own_columns(k);
        columns.iter().map(|column| !its.contains(column)).collect()
    };
    let mut patterns: Vec<Vec<bool>> = (0..mechanism.closures.len()).map(own).collect();
    patterns.retain(|pattern| pattern.contains(&false));
    patterns.sort_unstable();
    patterns.dedup();
    patterns
}

/// Each of these combinations with the columns of each pattern blank, each once.
fn blanked(keys: Vec<Vec<String>>, patterns: &[Vec<bool>]) -> Vec<Vec<String>> {
    if !patterns.iter().flatten().any(|blank| *blank) {
        return keys;
    }
    let blank = |key: &Vec<String>, pattern: &Vec<bool>| -> Vec<String> {
        let cells = key.iter().zip(pattern);
        cells.map(|(cell, blank)| if *blank { String::new() } else { cell.clone() }).collect()
    };
    let all = patterns.iter().flat_map(|pattern| keys.iter().map(move |key| blank(key, pattern)));
    let mut once: Vec<Vec<String>> = all.collect();
    once.sort_unstable();
    once.dedup();
    once
}

/// Combinations of the values that closures give to the columns of unknown points.
fn keys(mechanism: &Mechanism) -> Result<Vec<Vec<String>>, Error> {
    let mut combinations = vec![Vec::new()];
    for column in mechanism.key_columns() {
        let mut named: Vec<String> = Vec::new();
        for end in mechanism.closures.iter().flat_map(|c| &c.between) {
            let Some((point, fixed)) = mechanism.unknown_end(end) else { continue };
            for (k, value) in fixed {
                if mechanism.points[point].keys()[k] == column && !named.contains(&value) {
                    named.push(value);
                }
            }
        }
        if named.is_empty() {
            named = (0..PLACEMENTS).map(|i| i.to_string()).collect();
        }
        if combinations.len() * named.len() > MOST_KEYS {
            return Err(Error::Mechanism {
                place: "unknown points".into(),
                found: format!("more than {MOST_KEYS} combinations of their columns"),
                expected: "fewer columns".into(),
            });
        }
        combinations = combinations
            .iter()
            .flat_map(|c| named.iter().map(|n| [&c[..], std::slice::from_ref(n)].concat()))
            .collect();
    }
    Ok(combinations)
}

/// Joint coordinates of a channel: its limits, else its range, else any.
fn limits(mechanism: &Mechanism, channel: usize, longest: f64, reach: f64) -> [f64; 2] {
    let of = &mechanism.channels[channel];
    match (of.limits, of.range) {
        (Some(limits), _) => limits,
        (None, Some([low, high])) => {
            let (a, b) = (of.angle(low), of.angle(high));
            [a.min(b), a.max(b)]
        }
        (None, None) if mechanism.measures(channel) => [0.0, 2.0 * reach],
        (None, None) if mechanism.slides(channel) => [-longest, longest],
        (None, None) => [-std::f64::consts::PI, std::f64::consts::PI],
    }
}

/// What a step of one is for each channel [rad, or length]: half of how far it goes, where it does not turn.
fn spread(mechanism: &Mechanism, limits: &[[f64; 2]]) -> Vec<f64> {
    let turns = |c: usize| mechanism.moves_joint(c) && !mechanism.slides(c);
    let of = |(c, [low, high]): (usize, &[f64; 2])| if turns(c) { 1.0 } else { 0.5 * (high - low) };
    limits.iter().enumerate().map(of).collect()
}

/// The longest length between joints of the drawing; none where all are zero.
fn longest(mechanism: &Mechanism) -> Option<f64> {
    let rows = mechanism.chains.iter().flat_map(|c| &c.rows);
    let lengths = rows.flat_map(|r| [r.a, r.d, r.xyz[0], r.xyz[1], r.xyz[2]]);
    Some(lengths.fold(0.0, |m: f64, v| m.max(v.abs()))).filter(|longest| *longest > 0.0)
}

/// Length of the longest chain, its rows one behind the other.
fn reach(mechanism: &Mechanism) -> f64 {
    let norm = |v: &[f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    let of_chain = |c: &crate::mechanism::Chain| -> f64 {
        c.rows.iter().map(|r| r.a.hypot(r.d) + norm(&r.xyz)).sum()
    };
    let at = mechanism.points.iter().filter_map(|p| p.at.as_ref()).map(norm);
    let longest = mechanism.chains.iter().map(of_chain).chain(at).fold(0.0, f64::max);
    if longest > 0.0 { longest } else { 1.0 }
}
