//! Poses to visit before any session, chosen to tell most about offsets and gains.

use faer::Mat;

use crate::Error;
use crate::design::bound::{Bound, bound as bound_at};
use crate::design::candidates::{Candidates, Space, check_counts};
pub use crate::design::candidates::{MARGIN, Within, workspace};
use crate::design::choice::{Choice, refined};
use crate::design::criterion::Criterion;
use crate::design::linearised::{Linearised, Whitened};
use crate::design::moments::moments;
use crate::design::precision::{Known, Precision};
use crate::design::reach::readings_at;
use crate::estimate::paper::Layout;
use crate::estimate::{FitOptions, Observations};
use crate::mechanism::{Channel, Mechanism, ModelSection};
use crate::numerics::random::Random;
use crate::numerics::workers;
use crate::readings::Table;
use crate::text::brief;

/// Candidates at which the platform is judged.
const JUDGED: usize = 96;

/// Sweeps of the exchange; it has never needed more than a dozen.
const SWEEPS: usize = 50;

/// Share of what a candidate tells that is known of everything beforehand: any start can be improved.
const FAINT: f64 = 1e-9;

/// How a plan is made.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanOptions {
    /// Number of poses to visit.
    pub poses: usize,
    /// Readings of poses that are visited already, row by row: the plan complements them.
    pub beside: Vec<f64>,
    /// Box of the candidates; the mechanism's own workspace by default, else its joint limits.
    pub within: Option<Within>,
    /// What is made small.
    pub criterion: Criterion,
    /// Number of candidates that are drawn; those out of reach are left out.
    pub candidates: usize,
    /// Number of searches from different starts.
    pub starts: usize,
    /// Same seed, same plan.
    pub seed: u64,
    /// Factor of the noise that each channel declares, or standard deviation of one reading
    /// where none is declared: scales the bound, not the plan.
    pub noise: f64,
}

impl Default for PlanOptions {
    fn default() -> Self {
        Self {
            poses: 12,
            beside: Vec::new(),
            within: None,
            criterion: Criterion::default(),
            candidates: 3000,
            starts: 4,
            seed: 0,
            noise: 1.0,
        }
    }
}

/// Poses to visit.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Plan {
    /// `x y z` (length unit), `rx ry rz` (rad), in an order of short ways.
    pub poses: Vec<[f64; 6]>,
    /// What the channels should read there.
    pub readings: Vec<Vec<f64>>,
    /// Bound with these poses and those visited already.
    pub bound: Bound,
    /// Bound with only the poses visited already, if there are any.
    pub before: Option<Bound>,
}

/// Chooses poses that tell most about offsets and gains.
///
/// # Errors
///
/// [`Error::Option`] for numbers that cannot be used, and for a box that is unknown or out of
/// reach; [`Error::Shape`] unless there is one offset and gain per channel; as [`readings_at`]
/// and [`bound_at`].
///
/// # Example
///
/// ```
/// use rsicalib::Mechanism;
/// use rsicalib::design::plan::{PlanOptions, plan};
///
/// let rsi = Mechanism::rsi();
/// let (offsets, gains): (Vec<f64>, Vec<f64>) =
///     rsi.channels.iter().map(|c| (c.offset, c.gain)).unzip();
/// let options = PlanOptions { candidates: 300, starts: 1, ..PlanOptions::default() };
/// let found = plan(&rsi, &offsets, &gains, &options)?;
/// assert_eq!(found.poses.len(), 12);
/// # Ok::<(), rsicalib::Error>(())
/// ```
pub fn plan(
    mechanism: &Mechanism,
    offsets: &[f64],
    gains: &[f64],
    options: &PlanOptions,
) -> Result<Plan, Error> {
    check_parameters(mechanism, offsets, gains)?;
    let visited = check_options(mechanism, options)?;
    let of =
        |rows: &[f64]| bound_at(mechanism, rows, offsets, gains, &sigma(mechanism, options.noise));
    let before = if visited > 0 { Some(of(&options.beside)?) } else { None };

    let session = session(mechanism, offsets, gains, &options.beside)?;
    let sigma = sigma(mechanism, 1.0);
    let at = Linearised::of_offsets_and_gains(&session, &session.readings, sigma.clone())?;
    let within = match (options.within, mechanism.workspace) {
        (None, None) => None,
        (given, _) => Some(workspace(mechanism, given)?),
    };
    let mut random = Random::new(options.seed);
    let space = Space { at: &at, within, off: &[], from_limits: 0.0 };
    let found = space.draw(options.candidates, &mut random)?;

    let at = Linearised::of_offsets_and_gains(&session, &at.readings(&found.table)?, sigma)?;
    let space = Space { at: &at, ..space };
    let rows_of = |found: &Candidates| at.rows(&at.readings(&found.table)?);
    let rows = rows_of(&found)?;
    let precision = known(&at, &found, &rows, options)?;
    let channels = mechanism.channels.len();
    let last = options.beside.chunks_exact(channels).last();
    let middle = || found.span.iter().map(|[low, high]| 0.5 * (low + high)).collect();
    let choice = Choice {
        poses: options.poses,
        from: last.map_or_else(middle, <[f64]>::to_vec),
        way: 0.0,
        sweeps: SWEEPS,
        again: true,
    };
    let choose = |rows: &Whitened, found: &Candidates, start: &[usize]| {
        choice.of(Known { precision: precision.clone(), rows }, found, start)
    };
    let count = found.len();
    let starts: Vec<Vec<usize>> =
        (0..options.starts).map(|_| random.choose(options.poses, count)).collect();
    let (found, _, chosen) = refined(choose, rows_of, (found, rows), &starts, &space, &mut random)?;
    let planned = found.some(&chosen);
    Ok(Plan {
        bound: of(&[&planned.table.values[..], &options.beside].concat())?,
        before,
        readings: planned.table.values.chunks_exact(channels).map(<[f64]>::to_vec).collect(),
        poses: planned.poses,
    })
}

/// What is known beforehand: of the poses visited already, and a trace of everything.
fn known(
    at: &Linearised<'_>,
    found: &Candidates,
    rows: &Whitened,
    options: &PlanOptions,
) -> Result<Precision, Error> {
    let (told, n) = (rows.gram(), at.model.parameters);
    let faint = FAINT / found.len() as f64;
    let mut known = Mat::from_fn(n, n, |i, j| if i == j { faint * told[(i, i)] } else { 0.0 });
    if !options.beside.is_empty() {
        known += at.rows(&at.session.readings)?.gram();
    }
    let judged = found.some(&(0..found.len().min(JUDGED)).collect::<Vec<_>>());
    let omega = options.criterion.omega(at, found, || Ok(moments(at, &told, &judged)?.position))?;
    Ok(Precision::new(&known, omega))
}

/// The Cramér-Rao bound for poses that are to be visited.
///
/// # Errors
///
/// [`Error::Option`] for a pose that the mechanism cannot take, for no pose and for noise that
/// is not above 0; otherwise as [`plan`].
pub fn bound(
    mechanism: &Mechanism,
    offsets: &[f64],
    gains: &[f64],
    poses: &[[f64; 6]],
    noise: f64,
) -> Result<Bound, Error> {
    check_parameters(mechanism, offsets, gains)?;
    check_noise(noise)?;
    let expected = "poses that the mechanism can take";
    let at = |pose| readings_at(mechanism, pose, offsets, gains, 0.0);
    let found: Vec<_> = workers::map(poses, at).into_iter().collect::<Result<_, _>>()?;
    if let Some(beyond) = found.iter().position(Option::is_none) {
        let found = format!("number {} out of reach or range", beyond + 1);
        return Err(Error::option("poses", found, expected));
    }
    if poses.is_empty() {
        return Err(Error::option("poses", "none", expected));
    }
    let readings: Vec<f64> = found.into_iter().flatten().flatten().collect();
    bound_at(mechanism, &readings, offsets, gains, &sigma(mechanism, noise))
}

/// A session of the poses visited already, with offsets and gains as given and no other term; without
/// any, one of a row that does not count.
fn session(
    mechanism: &Mechanism,
    offsets: &[f64],
    gains: &[f64],
    beside: &[f64],
) -> Result<Observations, Error> {
    let (columns, laws) = (Vec::new(), Vec::new());
    let mut calibrated =
        Mechanism { columns, laws, model: ModelSection::default(), ..mechanism.clone() };
    for (channel, (offset, gain)) in calibrated.channels.iter_mut().zip(offsets.iter().zip(gains)) {
        (channel.offset, channel.gain) = (*offset, *gain);
    }
    let middle = |c: &Channel| match c.limits {
        Some([low, high]) => (0.5 * (low + high) - c.offset) / c.gain,
        None => c.middle(),
    };
    let values = match beside.is_empty() {
        true => calibrated.channels.iter().map(middle).collect(),
        false => beside.to_vec(),
    };
    // That row may be out of range.
    let free = |c: &Channel| Channel { range: None, ..c.clone() };
    let channels = calibrated.channels.iter().map(free).collect();
    let free = Mechanism { channels, rest: None, ..calibrated.clone() };
    let table = Table { values, ..Table::default() };
    let mut session = Observations::new(&free, table, None, FitOptions::default())?;
    session.weights.fill(if beside.is_empty() { 0.0 } else { 1.0 });
    session.mechanism = calibrated;
    Ok(session)
}

/// Noise of each channel: as declared, else a unit of the reading; times `noise`.
fn sigma(mechanism: &Mechanism, noise: f64) -> Vec<f64> {
    let declared = |c: &Channel| c.noise.filter(|n| *n > 0.0).unwrap_or(1.0);
    mechanism.channels.iter().map(|c| noise * declared(c)).collect()
}

fn check_parameters(mechanism: &Mechanism, offsets: &[f64], gains: &[f64]) -> Result<(), Error> {
    mechanism.validate()?;
    let expected = mechanism.channels.len();
    if expected == 0 {
        return Err(Error::Empty("the mechanism has no channel".into()));
    }
    for (what, values) in [("offsets", offsets), ("gains", gains)] {
        Error::same(what, values.len(), expected)?;
    }
    if let Some(bad) = offsets.iter().find(|v| !v.is_finite()) {
        return Err(Error::option("offsets", bad, "numbers"));
    }
    match gains.iter().find(|v| !v.is_finite() || **v == 0.0) {
        Some(bad) => Err(Error::option("gains", bad, "numbers other than 0")),
        None => Ok(()),
    }
}

/// Number of poses that are visited already.
fn check_options(mechanism: &Mechanism, options: &PlanOptions) -> Result<usize, Error> {
    let channels = mechanism.channels.len();
    if options.criterion == Criterion::Decide {
        let expected = "another one, or a result that leaves something open";
        return Err(Error::option("criterion", "decide", expected));
    }
    check_counts(&[
        ("poses", options.poses),
        ("candidates", options.candidates),
        ("starts", options.starts),
    ])?;
    check_noise(options.noise)?;
    Error::same("beside", options.beside.len(), options.beside.len().next_multiple_of(channels))?;
    if mechanism.platform.is_empty() {
        let why = "without one, poses are planned beside a result: calibrate a first session, of postures that \
                   differ as much as they can, then plan with its result and its readings";
        return Err(Error::missing(&mechanism.name, "platform", why));
    }
    Layout::new(mechanism)?;
    let visited = options.beside.len() / channels;
    if visited + options.poses < channels {
        let expected = format!("at least {channels} with those visited already");
        return Err(Error::option("poses", options.poses, &expected));
    }
    Ok(visited)
}

fn check_noise(noise: f64) -> Result<(), Error> {
    if noise.is_finite() && noise > 0.0 {
        return Ok(());
    }
    Err(Error::option("noise", brief(noise), "a number of readings above 0"))
}
