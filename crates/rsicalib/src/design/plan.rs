//! Poses to visit, chosen to tell most about offsets and gains.
//!
//! Candidates are drawn from a box. From several starts, poses of the plan are exchanged for
//! candidates until no exchange helps; the best plan is ordered so that the ways are short.

use faer::Mat;

use crate::Error;
use crate::apply::poses::poses_of;
use crate::design::exchange::Criterion;
use crate::design::information::{Bound, Candidates};
use crate::design::moments::{moments_of, slopes_of};
use crate::design::reach::readings_at;
use crate::design::tour::tour;
use crate::design::within_limits::within_limits;
use crate::estimate::Noise;
use crate::mechanism::Mechanism;
use crate::model::{Model, parse};
use crate::numerics::random::Random;
use crate::numerics::workers;
use crate::readings::{Readings, Table};
use crate::text::{brief, listed_numbers};

/// A box of poses: lowest and highest x, y, z (length unit), rx, ry, rz (rad).
pub type Within = [[f64; 2]; 6];

/// Readings that a pose keeps from the ends of the range: offsets are not known beforehand.
pub const MARGIN: f64 = 20.0;

/// Candidates at which the platform is judged.
const JUDGED: usize = 96;

/// Upper limit of poses, candidates and starts.
const MOST_CANDIDATES: usize = 1_000_000;

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
/// and [`Candidates::new`].
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
    let channels = mechanism.channels.len();
    check_parameters(mechanism, offsets, gains)?;
    check_options(options)?;
    Error::same("beside", options.beside.len(), options.beside.len().next_multiple_of(channels))?;
    let mut random = Random::new(options.seed);
    let (poses, readings) = match (options.within, mechanism.workspace) {
        (None, None) => by_limits(mechanism, offsets, gains, options)?,
        _ => {
            let within = workspace(mechanism, options.within)?;
            candidates(mechanism, offsets, gains, options, &within, &mut random)?
        }
    };
    let visited = options.beside.len() / channels;
    if visited + options.poses < channels {
        let expected = format!("at least {channels} with those visited already");
        return Err(Error::option("poses", options.poses, &expected));
    }

    let every: Vec<f64> = readings.iter().flatten().chain(&options.beside).copied().collect();
    let sigma = sigma(mechanism, 1.0);
    let mut told = Candidates::new(mechanism, every, offsets, gains, &sigma)?;
    if options.criterion == Criterion::Platform {
        told.platform = Some(platform_weight(mechanism, offsets, gains, &told)?);
    }
    let kept: Vec<usize> = (poses.len()..poses.len() + visited).collect();
    let starts: Vec<Vec<usize>> =
        (0..options.starts).map(|_| random.choose(options.poses, poses.len())).collect();
    let found: Vec<(Vec<usize>, f64)> =
        workers::map(&starts, |start| told.exchange(start, &kept, options.criterion));
    let best = found.into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let within = box_of(&poses);
    let middle = within.map(|[low, high]| 0.5 * (low + high));
    let distance = |a: &[f64], b: &[f64]| -> f64 {
        let spans = within.iter().map(|[low, high]| (high - low).max(1e-12));
        a.iter().zip(b).zip(spans).map(|((a, b), span)| ((b - a) / span).powi(2)).sum()
    };
    let best = best.map(|b| b.0).unwrap_or_default();
    let (chosen, _) = tour(best, &middle, |k| &poses[k], distance);

    let of = |rows: Vec<f64>| bound_of(mechanism, offsets, gains, rows, options.noise);
    let planned = chosen.iter().flat_map(|&k| &readings[k]).chain(&options.beside);
    Ok(Plan {
        bound: of(planned.copied().collect())?,
        before: if visited > 0 { Some(of(options.beside.clone())?) } else { None },
        poses: chosen.iter().map(|&k| poses[k]).collect(),
        readings: chosen.iter().map(|&k| readings[k].clone()).collect(),
    })
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
    let found = taken(mechanism, offsets, gains, poses, 0.0)?;
    let expected = "poses that the mechanism can take";
    if let Some(beyond) = found.iter().position(Option::is_none) {
        let found = format!("number {} out of reach or range", beyond + 1);
        return Err(Error::option("poses", found, expected));
    }
    if poses.is_empty() {
        return Err(Error::option("poses", "none", expected));
    }
    let readings = found.into_iter().flatten().flatten().collect();
    bound_of(mechanism, offsets, gains, readings, noise)
}

/// The box of a workspace, given or the mechanism's own.
///
/// # Errors
///
/// [`Error::Option`] for a mechanism whose workspace is not known, and for ends that are not
/// numbers or not in order.
pub fn workspace(mechanism: &Mechanism, within: Option<Within>) -> Result<Within, Error> {
    let known = within.or_else(|| mechanism.workspace.map(|w| w.bounds()));
    let expected = "lowest and highest x, y, z, rx, ry, rz";
    let Some(within) = known else {
        let found = format!("no workspace of '{}'", mechanism.name);
        return Err(Error::option("within", found, expected));
    };
    let ordered = |[low, high]: &[f64; 2]| low.is_finite() && high.is_finite() && low <= high;
    if !within.iter().all(ordered) {
        let expected = "six pairs of numbers, the lower end first";
        return Err(Error::option("within", listed_numbers(within.as_flattened()), expected));
    }
    Ok(within)
}

/// Poses, and the readings at each.
type Reachable = (Vec<[f64; 6]>, Vec<Vec<f64>>);

/// Poses within reach, with their readings: half of the box's inside, half of its faces.
///
/// The best poses are extreme ones.
fn candidates(
    mechanism: &Mechanism,
    offsets: &[f64],
    gains: &[f64],
    options: &PlanOptions,
    within: &Within,
    random: &mut Random,
) -> Result<Reachable, Error> {
    let count = options.candidates;
    let drawn: Vec<[f64; 6]> = (0..count)
        .map(|k| {
            within.map(|[low, high]| {
                let inside = random.uniform(low, high);
                let end = if random.coin() { low } else { high };
                if k >= count / 2 && random.coin() { end } else { inside }
            })
        })
        .collect();
    let found = taken(mechanism, offsets, gains, &drawn, MARGIN)?;
    let reached = drawn.into_iter().zip(found).filter_map(|(pose, row)| Some((pose, row?)));
    let (poses, readings): (Vec<_>, Vec<_>) = reached.unzip();
    if poses.len() < (count / 200).max(20) {
        let found =
            format!("{} of {count} poses within reach, joint limits and ranges", poses.len());
        return Err(Error::option("within", found, "a box that the mechanism can reach"));
    }
    Ok((poses, readings))
}

/// Poses of random configurations within the limits of the joints, with their readings.
fn by_limits(
    mechanism: &Mechanism,
    offsets: &[f64],
    gains: &[f64],
    options: &PlanOptions,
) -> Result<Reachable, Error> {
    if mechanism.platform.is_empty() {
        let why = "without one, poses are planned beside a result";
        return Err(Error::missing(&mechanism.name, "platform", why));
    }
    let calibrated = with_sensors(mechanism, offsets, gains);
    let values = within_limits(&calibrated, options.candidates, options.seed)?;
    let readings = Readings::new(&calibrated, Table { values, ..Table::default() })?;
    let terms = ["offset".to_string(), "gain".to_string()];
    let instances = parse(&calibrated, &readings, &terms)?;
    let model = Model::uncentred(&calibrated, &readings, instances)?;
    let noise = Noise::declared(sigma(mechanism, 1.0));
    let poses = poses_of(&model, &readings, &model.nominal(), &noise);
    let rows = readings.table.values.chunks_exact(mechanism.channels.len());
    let whole = poses.into_iter().zip(rows).filter(|(pose, _)| pose.iter().all(|v| v.is_finite()));
    Ok(whole.map(|(pose, row)| (pose, row.to_vec())).unzip())
}

/// The mechanism with other offsets and gains.
fn with_sensors(mechanism: &Mechanism, offsets: &[f64], gains: &[f64]) -> Mechanism {
    let mut out = mechanism.clone();
    for (channel, (offset, gain)) in out.channels.iter_mut().zip(offsets.iter().zip(gains)) {
        (channel.offset, channel.gain) = (*offset, *gain);
    }
    out
}

/// The box that poses fill.
fn box_of(poses: &[[f64; 6]]) -> Within {
    std::array::from_fn(|i| {
        let values = poses.iter().map(|pose| pose[i]);
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    })
}

/// Readings at poses; none where a pose cannot be taken.
fn taken(
    mechanism: &Mechanism,
    offsets: &[f64],
    gains: &[f64],
    poses: &[[f64; 6]],
    margin: f64,
) -> Result<Vec<Option<Vec<f64>>>, Error> {
    let at = |pose| readings_at(mechanism, pose, offsets, gains, margin);
    workers::map(poses, at).into_iter().collect()
}

fn bound_of(
    mechanism: &Mechanism,
    offsets: &[f64],
    gains: &[f64],
    readings: Vec<f64>,
    noise: f64,
) -> Result<Bound, Error> {
    let sigma = sigma(mechanism, noise);
    let told = Candidates::new(mechanism, readings, offsets, gains, &sigma)?;
    Ok(told.bound(&(0..told.len()).collect::<Vec<_>>()))
}

/// `Ω` of the platform over the candidates, in their scaled parameters.
fn platform_weight(
    mechanism: &Mechanism,
    offsets: &[f64],
    gains: &[f64],
    told: &Candidates,
) -> Result<Mat<f64>, Error> {
    let mut calibrated = with_sensors(mechanism, offsets, gains);
    calibrated.channels.iter_mut().for_each(|channel| channel.range = None);
    let channels = mechanism.channels.len();
    let values = told.counts.iter().take(JUDGED * channels).copied().collect();
    let readings = Readings::new(&calibrated, Table { values, ..Table::default() })?;
    let terms = ["offset".to_string(), "gain".to_string()];
    let instances = parse(&calibrated, &readings, &terms)?;
    let model = Model::uncentred(&calibrated, &readings, instances)?;
    let steps: Vec<f64> = told.scale.iter().map(|scale| 1e-5 / scale).collect();
    let columns: Vec<usize> = (0..2 * channels).collect();
    let noise = Noise::declared(sigma(mechanism, 1.0));
    let place = |beta: &[f64]| poses_of(&model, &readings, beta, &noise);
    let steps: Vec<(usize, f64)> = steps.into_iter().enumerate().collect();
    let slopes = slopes_of(&model.nominal(), &steps, place);
    let moments = moments_of(&slopes, &columns, 2 * channels);
    let n = 2 * channels;
    Ok(Mat::from_fn(n, n, |i, j| moments.position[(i, j)] / (told.scale[i] * told.scale[j])))
}

/// Noise of each channel: as declared, else a unit of the reading; times `noise`.
fn sigma(mechanism: &Mechanism, noise: f64) -> Vec<f64> {
    let declared = |c: &crate::mechanism::Channel| c.noise.filter(|n| *n > 0.0).unwrap_or(1.0);
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

fn check_options(options: &PlanOptions) -> Result<(), Error> {
    if options.criterion == Criterion::Decide {
        let expected = "another one, or a result that leaves something open";
        return Err(Error::option("criterion", "decide", expected));
    }
    for (name, value) in
        [("poses", options.poses), ("candidates", options.candidates), ("starts", options.starts)]
    {
        if !(1..=MOST_CANDIDATES).contains(&value) {
            return Err(Error::option(
                name,
                value,
                format!("at least 1 and at most {MOST_CANDIDATES}"),
            ));
        }
    }
    check_noise(options.noise)
}

fn check_noise(noise: f64) -> Result<(), Error> {
    if noise.is_finite() && noise > 0.0 {
        return Ok(());
    }
    Err(Error::option("noise", brief(noise), "a number of readings above 0"))
}
