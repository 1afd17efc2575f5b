//! Number of parameters that a mechanism can determine, counted before any reading is taken.
//!
//! The parameters of a model are counted three times:
//!
//! ```text
//! parameters   columns of X, redundant ones and all
//! minimal      rank of what they do to the points that the chains carry, loops open
//! known        rank of X where the loops are closed, unknown points eliminated
//! ```
//!
//! Loops hide what moves everything alike: the place of the whole in the base, and the size of
//! the whole unless a length is known.
//!
//! A combination of parameters that moves no carried point changes no closure. The model is
//! therefore reduced first to its minimal parameters, `V₁` of [`Spaces`], and the loops are asked
//! of those alone:
//!
//! ```text
//! E = ∂(carried points)/∂β = U diag(s) V₁ᵀ        known = rank(X V₁)
//! ```

use std::fmt;

use faer::Mat;

use crate::mechanism::{Closure, Mechanism, ModelSection, Point, Target, Value};
use crate::model::configurations::{Configurations, linear};
use crate::model::{Instance, Model, parse};
use crate::numerics::random::Random;
use crate::numerics::rank::{Spaces, eliminated, rank, scaled, unit};
use crate::terms::targets::targets;
use crate::terms::term::Acts;
use crate::text::quoted;
use crate::{Error, terms};

/// Rows of all chains, or parameters of a model, beyond which none are counted.
const MOST_COUNTED: usize = 2000;

/// Complete geometry of any chain, with its sensors; and where there are such,
/// `point_position` and `distance`.
pub const COMPLETE: [&str; 6] =
    ["offset", "gain", "link_frame", "base_position", "base_tilt", "base_bearing"];

/// Terms of complete geometry beside [`COMPLETE`], where the mechanism has targets for them.
const WHERE_THERE_ARE: [&str; 2] = ["point_position", "distance"];

/// Part of a unit vector below which a term takes no part in what is hidden.
const PART: f64 = 1e-6;

/// The model whose parameters are counted.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Counting {
    /// As the mechanism declares it.
    #[default]
    Declared,
    /// Complete geometry: [`COMPLETE`].
    Complete,
    /// These terms, as users write them.
    Given(Vec<String>),
}

impl Counting {
    /// The model of a list of terms; the declared one without a list.
    #[must_use]
    pub fn of(terms: Option<Vec<String>>) -> Self {
        match terms {
            None => Self::Declared,
            Some(terms) if terms == COMPLETE => Self::Complete,
            Some(terms) => Self::Given(terms),
        }
    }

    /// The word for it: `declared`, `complete`, `given`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Declared => "declared",
            Self::Complete => "complete",
            Self::Given(_) => "given",
        }
    }
}

/// One term: number of its parameters, and how many could be told apart from all others.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Counted {
    /// Id of the term.
    pub term: &'static str,
    /// Number of its parameters.
    pub parameters: usize,
    /// Rank with every other parameter known.
    pub alone: usize,
    /// Rank with every other parameter unknown.
    pub beside: usize,
}

/// What closed loops cannot tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Hidden {
    /// Where the whole stands in its base.
    Place {
        /// Number of independent motions.
        motions: usize,
    },
    /// The size of the whole.
    Size,
}

impl fmt::Display for Hidden {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Place { motions } => write!(f, "where the whole stands in its base ({motions})"),
            Self::Size => write!(f, "its size: declare one length that is known (1)"),
        }
    }
}

/// What readings of a mechanism could tell.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Identifiable {
    /// Which model.
    pub model: Counting,
    /// Term by term.
    pub terms: Vec<Counted>,
    /// Parameters, redundant ones and all.
    pub parameters: usize,
    /// Rank of what they do to the carried points, loops open.
    pub minimal: usize,
    /// Rank where the loops are closed.
    pub known: usize,
    /// What hides the difference between the last two, as far as it has a name.
    pub hidden: Vec<Hidden>,
    /// Closed configurations on which the counts rest.
    pub configurations: usize,
}

/// Counts what readings of a mechanism can and cannot tell.
///
/// Joint limits say where the joints may be. The counts do not depend on the seed.
///
/// # Errors
///
/// [`Error::Mechanism`] where the loops cannot be closed near random configurations, or no chain
/// carries a point; [`Error::Unknown`] for terms that there are not; as [`Model::new`].
///
/// # Example
///
/// ```
/// use rsicalib::Mechanism;
/// use rsicalib::design::identifiability::{Counting, identifiable};
///
/// let found = identifiable(&Mechanism::rsi(), Counting::Complete, 0)?;
/// assert_eq!((found.minimal, found.known), (57, 50));
/// # Ok::<(), rsicalib::Error>(())
/// ```
pub fn identifiable(
    mechanism: &Mechanism,
    counting: Counting,
    seed: u64,
) -> Result<Identifiable, Error> {
    let mut random = Random::new(seed);
    refuse_large("chains", mechanism.chains.iter().map(|chain| chain.rows.len()).sum())?;
    let configurations = Configurations::new(mechanism, &mut random)?;
    let instances = instances(&configurations, &counting, &mut random)?;
    refuse_ends(&instances)?;
    refuse_large("terms", instances.iter().map(|one| one.term.info().parameters.len()).sum())?;
    let labels = Labels::of(&instances);
    let open = Open::new(mechanism, &instances, &labels, &mut random)?;
    let (closed, rows) = loops(&configurations, &instances, &labels, &open, &mut random)?;
    counted(mechanism, counting, &labels, &open, &closed, rows)
}

/// Refuses what would take hours.
fn refuse_large(name: &'static str, count: usize) -> Result<(), Error> {
    if count <= MOST_COUNTED {
        return Ok(());
    }
    let found = format!("{count} rows or parameters");
    let expected = format!("at most {MOST_COUNTED}: the time grows with their cube");
    Err(Error::option(name, found, expected))
}

/// Refuses terms of what is at the ends of closures: nothing of an open chain tells of them.
fn refuse_ends(instances: &[Instance]) -> Result<(), Error> {
    let of_end = |acts| {
        matches!(acts, Acts::Surface(_) | Acts::End | Acts::Attachment | Acts::Instrument(_))
    };
    let Some(one) = instances.iter().find(|one| of_end(one.term.acts())) else { return Ok(()) };
    let expected =
        "terms of channels, chains and lengths: of what closures end at, nothing is counted";
    let found = one.term.info().id.into();
    Err(Error::Option { name: "terms", found, expected: expected.into() })
}

/// The instances of the model that is counted.
fn instances(
    configurations: &Configurations,
    counting: &Counting,
    random: &mut Random,
) -> Result<Vec<Instance>, Error> {
    let mechanism = configurations.mechanism();
    let specs = match counting {
        Counting::Complete => return complete(mechanism),
        Counting::Declared => &mechanism.model.terms,
        Counting::Given(specs) => specs,
    };
    let every: Vec<usize> = (0..configurations.combinations()).collect();
    parse(mechanism, &configurations.open(&every, random)?, specs)
}

/// Terms of complete geometry at the targets that mean something in this mechanism.
fn complete(mechanism: &Mechanism) -> Result<Vec<Instance>, Error> {
    let carries = |chain: usize| {
        let name = Some(&mechanism.chains[chain].name);
        mechanism.points.iter().any(|p| p.chain.as_ref() == name)
    };
    // A distance between unknown points is declared, not found.
    let sampled = |closure: usize| {
        let fixed =
            |end: &String| mechanism.points.iter().any(|p| p.name == *end && p.at.is_some());
        mechanism.closures[closure].between.iter().any(fixed)
    };
    let mut instances = Vec::new();
    for id in COMPLETE.into_iter().chain(WHERE_THERE_ARE) {
        let term = terms::find(id)?;
        for target in targets(term, mechanism) {
            let wanted = match target {
                Target::Chain(chain) if id == "point_position" => carries(chain),
                Target::Closure(closure) => sampled(closure),
                _ => true,
            };
            if wanted {
                instances.push(Instance { term, target, place: 0 });
            }
        }
    }
    Ok(instances)
}

/// Which parameters belong to which term.
struct Labels {
    /// Term of each parameter.
    term: Vec<&'static str>,
    /// Parameters that act on carried points, and those that are distances of closures.
    geometric: Vec<usize>,
    distances: Vec<(usize, Target)>,
}

impl Labels {
    fn of(instances: &[Instance]) -> Self {
        let mut labels = Self { term: Vec::new(), geometric: Vec::new(), distances: Vec::new() };
        for instance in instances {
            for _ in 0..instance.width() {
                let column = labels.term.len();
                match instance.term.acts() {
                    Acts::Distance => labels.distances.push((column, instance.target)),
                    _ => labels.geometric.push(column),
                }
                labels.term.push(instance.term.info().id);
            }
        }
        labels
    }
}

/// What the parameters do to the carried points where no loop is closed.
struct Open {
    /// Factor of each geometric parameter that makes its column one long.
    scale: Vec<f64>,
    spaces: Spaces,
    /// Combinations of scaled parameters that move the whole: three translations, three
    /// rotations, growth.
    moves: Mat<f64>,
    /// The moves that the model can make.
    possible: [bool; MOVES],
}

/// Motions of the whole, and growth.
const MOVES: usize = 7;

impl Open {
    fn new(
        mechanism: &Mechanism,
        instances: &[Instance],
        labels: &Labels,
        random: &mut Random,
    ) -> Result<Self, Error> {
        let open = Configurations::new(&opened(mechanism)?, random)?;
        let geometric: Vec<Instance> = instances
            .iter()
            .filter(|i| !matches!(i.term.acts(), Acts::Distance))
            .copied()
            .collect();
        // Three equations of each carried point: more rows than parameters by half.
        let samples = 10 + labels.geometric.len() / 2;
        let readings = open.open(&vec![0; samples], random)?;
        let model = Model::with_null_equations(open.mechanism(), &readings, geometric)?;
        let (points, effect) = linear(&model, &readings, &open.nominal(&model));
        let scale = unit(&effect);
        let targets = Mat::from_fn(points.len(), MOVES, |row, k| {
            let (axis, at) = (row % 3, &points[row - row % 3..row - row % 3 + 3]);
            moved(k, axis, at)
        });
        let found = Spaces::beside(&scaled(&effect, &scale), &targets);
        let (spaces, (moves, missed)) = found.ok_or_else(|| not_numbers(mechanism))?;
        let possible = std::array::from_fn(|k| missed[k] < 1e-6);
        Ok(Self { scale, spaces, moves, possible })
    }

    /// Rank of all parameters: distances are parameters of their own.
    fn minimal(&self, labels: &Labels) -> usize {
        self.spaces.rank() + labels.distances.len()
    }
}

/// Coordinate `axis` of what move `k` does to a point.
fn moved(k: usize, axis: usize, at: &[f64]) -> f64 {
    match k {
        0..3 => f64::from(u8::from(k == axis)),
        3..6 => {
            let about = k - 3; // e × p
            match (axis + 3 - about) % 3 {
                1 => -at[(about + 2) % 3],
                2 => at[(about + 1) % 3],
                _ => 0.0,
            }
        }
        _ => at[axis],
    }
}

/// What the loops see.
struct Loops {
    /// `X` of geometric parameters, scaled as [`Open::scale`], then of distances.
    geometric: Mat<f64>,
    distances: Mat<f64>,
    /// Factor of each distance that makes its column one long.
    scale: Vec<f64>,
}

/// Derivatives of the closures in closed configurations, unknown points eliminated.
fn loops(
    configurations: &Configurations,
    instances: &[Instance],
    labels: &Labels,
    open: &Open,
    random: &mut Random,
) -> Result<(Loops, usize), Error> {
    let mechanism = configurations.mechanism();
    let combinations = configurations.combinations();
    let every: Vec<usize> = (0..combinations).collect();
    let first = configurations.open(&every, random)?;
    let model = Model::with_null_equations(mechanism, &first, instances.to_vec())?;
    // As many rows of every closure as it has parameters to tell, and half as many again.
    let minimal = open.minimal(labels);
    let active = model.active();
    let need = model.closures.iter().map(|closure| {
        let seen = active[closure.equation].len().min(minimal);
        8 + 3 * seen / (2 * closure.kind.equations())
    });
    let own = 3 + model.width() - model.term_parameters;
    let each = own + need.max().unwrap_or(0).div_ceil(combinations);

    let readings = configurations.closed(each, random)?;
    let model = Model::with_null_equations(mechanism, &readings, instances.to_vec())?;
    let beta = configurations.nominal(&model);
    let x = configurations.slopes(&model, &readings, &beta);
    let unknown = x.subcols(model.term_parameters, x.ncols() - model.term_parameters).to_owned();
    let device = x.subcols(0, model.term_parameters).to_owned();
    let x = eliminated(device, &unknown).ok_or_else(|| not_numbers(mechanism))?;

    let geometric = Mat::from_fn(x.nrows(), labels.geometric.len(), |i, j| {
        x[(i, labels.geometric[j])] * open.scale[j]
    });
    let distances =
        Mat::from_fn(x.nrows(), labels.distances.len(), |i, j| x[(i, labels.distances[j].0)]);
    let scale = unit(&distances);
    let distances = scaled(&distances, &scale);
    Ok((Loops { geometric, distances, scale }, readings.samples))
}

/// Ranks of the whole and of each term.
fn counted(
    mechanism: &Mechanism,
    counting: Counting,
    labels: &Labels,
    open: &Open,
    loops: &Loops,
    configurations: usize,
) -> Result<Identifiable, Error> {
    let lost = || not_numbers(mechanism);
    // X of the minimal parameters: V₁ of the geometry, then the distances.
    let (minimal, geometry) = (open.minimal(labels), open.spaces.rank());
    let reduced = &loops.geometric * &open.spaces.rows;
    let x = Mat::from_fn(reduced.nrows(), minimal, |i, j| match j < geometry {
        true => reduced[(i, j)],
        false => loops.distances[(i, j - geometry)],
    });
    let seen = Spaces::of(&x).ok_or_else(lost)?;
    let known = seen.rank();

    let mut names: Vec<&'static str> = Vec::new();
    for term in &labels.term {
        if !names.contains(term) {
            names.push(term);
        }
    }
    let mut terms = Vec::with_capacity(names.len());
    for term in names {
        // Rows of the term's parameters, in terms of the minimal ones and of what moves nothing.
        let own: Vec<usize> = (0..labels.geometric.len())
            .filter(|&j| labels.term[labels.geometric[j]] == term)
            .collect();
        let distances: Vec<usize> = (0..labels.distances.len())
            .filter(|&j| labels.term[labels.distances[j].0] == term)
            .collect();
        let parameters = own.len() + distances.len();
        let part = Mat::from_fn(parameters, minimal, |i, j| match own.get(i) {
            Some(&row) if j < geometry => open.spaces.rows[(row, j)],
            Some(_) => 0.0,
            None => f64::from(u8::from(j == geometry + distances[i - own.len()])),
        });
        let reach = &part * &seen.rows;
        let alone = Mat::from_fn(parameters, known, |i, j| reach[(i, j)] * seen.singular[j]);
        let unseen = &part * &seen.null;
        let redundant = open.spaces.null.ncols();
        let null = Mat::from_fn(parameters, redundant + unseen.ncols(), |i, j| match own.get(i) {
            _ if j >= redundant => unseen[(i, j - redundant)],
            Some(&row) => open.spaces.null[(row, j)],
            None => 0.0,
        });
        terms.push(Counted {
            term,
            parameters,
            alone: rank(&alone, None).ok_or_else(lost)?,
            // Of the term's own directions those that no combination with others hides.
            beside: parameters - rank(&null, Some(PART)).ok_or_else(lost)?,
        });
    }
    let hidden = match known < minimal {
        true => hidden(mechanism, labels, open, loops).ok_or_else(lost)?,
        false => Vec::new(),
    };
    Ok(Identifiable {
        model: counting,
        terms,
        parameters: labels.term.len(),
        minimal,
        known,
        hidden,
        configurations,
    })
}

/// Motions and growth of the whole that no loop sees, if the model can make them.
fn hidden(
    mechanism: &Mechanism,
    labels: &Labels,
    open: &Open,
    loops: &Loops,
) -> Option<Vec<Hidden>> {
    // A distance grows with the whole.
    let grows = |k: usize| {
        let (_, target) = labels.distances[k];
        // Distances of one make that differ do not grow by the same.
        let own = mechanism.closures_of(target).map(|closure| &mechanism.closures[closure].value);
        match own.reduce(|a, b| if a == b { a } else { &None }) {
            Some(Some(Value::Known(value))) if loops.scale[k] > 0.0 => value / loops.scale[k],
            _ => 0.0,
        }
    };
    let distances = Mat::from_fn(labels.distances.len(), MOVES, |k, j| match j + 1 == MOVES {
        true => grows(k),
        false => 0.0,
    });
    let seen = &loops.geometric * &open.moves + &loops.distances * &distances;
    // What the parameters would show if they did not cancel each other.
    let norms = |x: &Mat<f64>| x.col_iter().map(|column| column.norm_l2()).collect::<Vec<_>>();
    let (of_geometry, of_distances) = (norms(&loops.geometric), norms(&loops.distances));
    let most = |j: usize| -> f64 {
        let of = |norms: &[f64], z: &Mat<f64>| -> f64 {
            norms.iter().enumerate().map(|(k, norm)| norm * z[(k, j)].abs()).sum()
        };
        of(&of_geometry, &open.moves) + of(&of_distances, &distances)
    };
    let unseen = |moves: usize| -> Option<usize> {
        let made: Vec<usize> = (0..moves).filter(|&j| open.possible[j]).collect();
        // A motion that every loop is blind to shows rounding alone.
        let least = |j: usize| 1e-4 * open.moves.col(j).norm_l2() + f64::MIN_POSITIVE;
        let by: Vec<f64> = made.iter().map(|&j| most(j).max(least(j)).recip()).collect();
        let seen = Mat::from_fn(seen.nrows(), made.len(), |i, j| seen[(i, made[j])] * by[j]);
        Some(made.len() - rank(&seen, Some(1e-7))?)
    };
    let motions = unseen(MOVES - 1)?;
    let size = unseen(MOVES)? > motions;
    let place = (motions > 0).then_some(Hidden::Place { motions });
    Some(place.into_iter().chain(size.then_some(Hidden::Size)).collect())
}

/// The same chains, each carried point closed on the origin: `f` is where it is.
fn opened(mechanism: &Mechanism) -> Result<Mechanism, Error> {
    let mut points: Vec<Point> =
        mechanism.points.iter().filter(|p| p.chain.is_some()).cloned().collect();
    if mechanism.closures.iter().any(|closure| closure.channel.is_some()) {
        return Err(Error::Mechanism {
            place: quoted(&mechanism.name),
            found: "a channel that reads a length between points".into(),
            expected:
                "channels of joints alone: of others nothing is counted before there are readings"
                    .into(),
        });
    }
    if points.is_empty() {
        return Err(Error::Mechanism {
            place: quoted(&mechanism.name),
            found: "no point on a chain".into(),
            expected: "one".into(),
        });
    }
    let mut origin = String::from("origin");
    while points.iter().any(|p| p.name == origin) {
        origin.push('_');
    }
    let closure = |p: &Point| Closure::touch(&p.name, [p.name.clone(), origin.clone()]);
    let closures = points.iter().map(closure).collect();
    points.push(Point { name: origin, at: Some([0.0; 3]), ..Point::default() });
    Ok(Mechanism {
        points,
        closures,
        planes: Vec::new(),
        lines: Vec::new(),
        frames: Vec::new(),
        platform: std::collections::BTreeMap::new(),
        rest: None,
        workspace: None,
        model: ModelSection::default(),
        laws: Vec::new(),
        ..mechanism.clone()
    })
}

fn not_numbers(mechanism: &Mechanism) -> Error {
    Error::Mechanism {
        place: quoted(&mechanism.name),
        found: "derivatives that are not numbers".into(),
        expected: "lengths and gains of usual size".into(),
    }
}
