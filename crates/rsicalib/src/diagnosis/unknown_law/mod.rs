//! A law that no term has, of one channel, link or closure: on what it depends, and its price beside what was found.
//!
//! The price (113) of such a law is that of a smooth function of one or two variables of the session,
//! averaged over these and over amplitudes, (115). It stands in place of one effect that was found, or of
//! all of them. A curve over the channel's own reading, and one over time, are terms. A law over torque
//! holds what a load does, one over a direction what hysteresis does: in place of such effects it has their
//! price, and that of what it adds.

mod evidence;
pub(crate) mod formula;
pub mod variables;
pub mod whose;

use crate::Error;
use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::price::{Data, Family, mean, of_number, of_places, prior};
use crate::diagnosis::score::candidates::candidates;
use crate::diagnosis::score::scored::{self, Scored, named_places, paid};
use crate::diagnosis::unknown_law::evidence::{Errors, Evidence, Likeliest};
use crate::diagnosis::unknown_law::formula::Written;
use crate::diagnosis::unknown_law::variables::{Quantity, Variable, variables};
use crate::diagnosis::unknown_law::whose::Whose;
use crate::estimate::at_fit::AtFit;
use crate::estimate::{Fit, Observations};
use crate::mechanism::Target;
use crate::model::Instance;
use crate::numerics::credible_set::{AS_WELL, RIVAL};
use crate::numerics::order;
use crate::numerics::order::Ends;
use crate::numerics::workers;
use crate::terms::term::Needs;

/// Id of a law that no term has.
pub const UNKNOWN_LAW: &str = "unknown_law";

/// Longer sessions are not asked: a limit of time.
const MOST_SAMPLES: usize = 4000;

/// Sets of variables over which formulas are looked for, the likeliest first: a limit of time.
const MOST_SETS: usize = 4;

/// A law that no term has.
#[derive(Debug, Clone, PartialEq)]
pub struct UnknownLaw {
    /// Whose errors follow it.
    pub whose: Whose,
    /// Others of which a law fits as well, the likeliest first.
    pub also_of: Vec<Whose>,
    /// The effects in whose place it stands.
    pub replaces: Vec<Instance>,
    /// Its price with what stays beside it, (113).
    pub price: f64,
    /// That less the price of what was found.
    pub behind: f64,
    /// Root mean square of its likeliest errors over the poses, in the unit of the joint.
    pub size: f64,
    /// What it depends on.
    pub depends_on: Vec<DependsOn>,
    /// The same variables, each with those that these data cannot tell from it.
    pub(crate) variables: Vec<(Quantity, Vec<Quantity>)>,
    /// Its likeliest errors in the samples of the search, in the unit of readings; zero where one is
    /// left out.
    pub(crate) errors: Vec<f64>,
    /// What data tell of it, in parameters.
    pub(crate) told: f64,
    /// χ² that it leaves.
    pub(crate) left: f64,
    /// A formula that does as well; none where none does, where formulas do not know its variables, or where the
    /// law does not fit as well as what was found.
    pub written: Option<Written>,
}

/// A variable on which errors depend.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "document", derive(schemars::JsonSchema))]
pub struct DependsOn {
    /// The variable: `theta[q1]`, `direction[q1]`, `travelled[q1]`, `torque[q1]`, `time`, ….
    pub variable: String,
    /// Share of what the law explains that is lost without the variable, of all of its variables.
    pub share: f64,
    /// Variables that these data cannot tell from it.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub also: Vec<String>,
}

impl UnknownLaw {
    /// The targets of which a law fits as well, each once, the likeliest first.
    #[must_use]
    pub fn targets(&self) -> Vec<Target> {
        let mut all = vec![self.whose.target];
        for other in &self.also_of {
            if !all.contains(&other.target) {
                all.push(other.target);
            }
        }
        all
    }

    /// True where it fits as well as what was found, or better.
    #[must_use]
    pub fn ties(&self) -> bool {
        self.behind <= AS_WELL
    }

    /// True where it fits better than what was found.
    #[must_use]
    pub fn better(&self) -> bool {
        self.behind < -AS_WELL
    }

    /// True where what was found is not said without it: the law fits better than effects do, or is
    /// likelier than nothing, or than an effect that is not applied for it.
    #[must_use]
    pub fn is_said(&self) -> bool {
        let undoes = self.replaces.iter().any(|effect| self.undoes(effect));
        self.better() || (self.behind < 0.0 && (self.replaces.is_empty() || undoes))
    }

    /// True for an effect that is not applied: in its place the law is likelier and holds nothing of it, or
    /// does as well over what every session has anew, so that nothing says that another has the effect.
    #[must_use]
    pub fn undoes(&self, effect: &Instance) -> bool {
        // Plays of all widths hold the jump of a hysteresis, which is one of none, but not its price.
        let play = |quantity: &Quantity| {
            effect.term.info().needs == Needs::Approach && matches!(quantity, Quantity::Play(_))
        };
        let held = self.variables.iter().any(|(q, _)| is_over(effect, *q) || play(q));
        let anew = self.ties() && self.variables.iter().any(|(q, _)| q.begins_anew());
        let less = self.behind < 0.0 || (anew && effect.term.info().needs == Needs::Nothing);
        less && self.replaces.contains(effect) && !held
    }
}

/// Laws of one place, each of its variables.
struct Scan {
    whose: Whose,
    sets: Vec<(Vec<usize>, Evidence)>,
    price: f64,
    /// Errors by the likeliest of them.
    likeliest: Likeliest,
    /// By how much χ² falls with it.
    fall: f64,
    /// The same with one of its two variables alone, where a law of that is one that a term has.
    alone: Vec<(usize, f64)>,
}

/// A fit beside which laws are weighed.
struct Beside<'a> {
    at: AtFit<'a>,
    chi2: f64,
    /// Its price, all that it keeps included.
    price: f64,
    /// Whether laws are weighed here that hold what it keeps, or all others; none where all are.
    holding: Option<bool>,
}

impl Beside<'_> {
    /// True where laws are weighed here that hold what it keeps, or do not.
    fn here(&self, holds: bool) -> bool {
        self.holding.is_none_or(|holding| holding == holds)
    }
}

/// What was found in a session, and where laws are looked for.
#[derive(Clone, Copy)]
struct Session<'a> {
    current: &'a Fit,
    found: &'a [Scored],
    /// What was found and is no wrong reading.
    effects: &'a [Scored],
    rows: &'a [usize],
    built: &'a [Whose],
    /// What an error costs that is the same in all poses.
    constant: f64,
}

/// The likeliest laws in place of some effects, of one channel.
struct Weighed {
    gone: Vec<Scored>,
    /// The fit without these effects, and its price.
    fit: Fit,
    price: f64,
    variables: Vec<Variable>,
    /// Of each place, the likeliest first.
    scans: Vec<Scan>,
}

impl Averaged<'_> {
    /// The likeliest law that no term has, beside or in place of what was found; none where it is less
    /// likely than what was found by more than [`RIVAL`]. Where nothing was found it must be likelier than
    /// chance, unless more than noise is `left_over`.
    ///
    /// # Errors
    ///
    /// As [`crate::estimate::fit`].
    pub fn unknown_law(
        &self,
        current: &Fit,
        found: &[Scored],
        left_over: bool,
    ) -> Result<Option<UnknownLaw>, Error> {
        let weights = &self.small.weights;
        let rows: Vec<usize> = (0..weights.len()).filter(|&row| weights[row] > 0.0).collect();
        if rows.len() > MOST_SAMPLES || rows.is_empty() {
            return Ok(None);
        }
        let built = Whose::built(&self.small.mechanism);
        let candidates = candidates(&self.small, current, &self.search.without);
        let named = candidates.iter().filter(|i| !i.term.info().penalised).count() as f64;
        // An error of what is built that is the same in all poses is one more effect of the catalogue.
        let constant = of_places(named_places(named)) + of_number(2) - of_number(1);
        let effects: Vec<Scored> =
            found.iter().copied().filter(|s| !scored::is_data(&s.instance)).collect();
        let session =
            Session { current, found, effects: &effects, rows: &rows, built: &built, constant };
        let mut replaced: Vec<Vec<Scored>> = vec![effects.clone()];
        if effects.len() > 1 {
            replaced.extend(effects.iter().map(|s| vec![*s]));
        }
        let mut best: Option<Weighed> = None;
        for gone in replaced {
            let Some(weighed) = self.weighed(&session, gone)? else { continue };
            if best.as_ref().is_none_or(|b| weighed.scans[0].price < b.scans[0].price) {
                best = Some(weighed);
            }
        }
        let Some(Weighed { gone, fit, price, variables, scans }) = best else { return Ok(None) };
        let scan = &scans[0];
        let behind = scan.price - self.said_of(current) - paid(found);
        let near = match (effects.is_empty(), left_over) {
            (false, _) => behind <= RIVAL,
            (true, true) => true,
            (true, false) => behind < 0.0,
        };
        if !near {
            return Ok(None);
        }
        // A report has the formula of a law that ties.
        let formula = || {
            let whose: Vec<Whose> =
                built.iter().copied().filter(|whose| *whose == scan.whose).collect();
            let beside = self.beside(&fit, price, None, &whose)?;
            Ok::<_, Error>(formula_of(&beside, &rows, scan, &variables, (constant, &self.data)))
        };
        let written = if behind <= AS_WELL { formula()? } else { None };
        let mut on = depends_on(scan, &variables);
        // What is over time has a term, and was found: a path that is travelled steadily is that, too.
        if gone.iter().any(|s| is_over(&s.instance, Quantity::Time)) {
            let paths = on.iter_mut().filter(|on| matches!(on.quantity, Quantity::Travelled(_)));
            paths.for_each(|on| on.also.insert(0, Quantity::Time));
        }
        let as_well = scan.price + AS_WELL - behind.max(0.0);
        let also_of = scans[1..].iter().take_while(|other| other.price < as_well);
        let mut errors = vec![0.0; weights.len()];
        rows.iter().zip(&scan.likeliest.errors).for_each(|(&row, e)| errors[row] = *e);
        Ok(Some(UnknownLaw {
            whose: scan.whose,
            also_of: also_of.map(|other| other.whose).collect(),
            replaces: instances(&gone),
            price: scan.price,
            behind,
            size: scan.likeliest.size() * scan.whose.gain(&self.small.mechanism).abs(),
            told: scan.likeliest.told,
            left: fit.cost() - scan.fall,
            written,
            errors,
            depends_on: on.iter().map(|on| on.named(&self.small)).collect(),
            variables: on.into_iter().map(|on| (on.quantity, on.also)).collect(),
        }))
    }

    /// The likeliest laws in place of these effects; none where none can be weighed.
    fn weighed(&self, session: &Session, gone: Vec<Scored>) -> Result<Option<Weighed>, Error> {
        let Session { current, found, effects, rows, built, constant } = *session;
        // A law over torque holds what a load does: it is priced as that load, and what is beyond.
        let over = |whose: &Whose, q: Quantity| gone.iter().any(|s| whose.holds(&s.instance, q));
        let (held, rest): (Vec<Scored>, Vec<Scored>) =
            gone.iter().partition(|s| s.instance.term.info().needs != Needs::Nothing);
        let mut taken = vec![(gone.clone(), (!held.is_empty()).then_some(false))];
        if !held.is_empty() {
            taken.push((rest, Some(true)));
        }
        let mut fits = Vec::with_capacity(taken.len());
        for (without, holding) in taken {
            let fit = self.without(current, &instances(&without))?;
            let others: Vec<Scored> =
                found.iter().filter(|s| !without.contains(s)).copied().collect();
            // A law that holds an effect is no other thing that is wrong.
            let beside = effects.len() - without.len();
            let number = match holding {
                Some(true) => 0.0,
                _ => of_number(beside + 1) - of_number(beside),
            };
            let price = self.said_of(&fit) + paid(&others) + number;
            fits.push((fit, price, holding));
        }
        let beside: Vec<Beside> = fits
            .iter()
            .map(|(fit, price, holding)| self.beside(fit, *price, *holding, built))
            .collect::<Result<_, _>>()?;
        let variables = variables(&beside[0].at, rows)?;
        let scans = scans(&beside, rows, &variables, &over, (built, constant, &self.data));
        if scans.is_empty() {
            return Ok(None);
        }
        let (fit, price, _) = fits.swap_remove(0);
        Ok(Some(Weighed { gone, fit, price, variables, scans }))
    }

    /// Laws of channels, and of what is built, beside a fit of this price.
    fn beside<'b>(
        &'b self,
        fit: &'b Fit,
        price: f64,
        holding: Option<bool>,
        built: &[Whose],
    ) -> Result<Beside<'b>, Error> {
        let constants: Vec<Instance> =
            built.iter().map(Whose::constant).collect::<Result<_, _>>()?;
        let at = AtFit::with(&self.small, fit, &constants)?;
        Ok(Beside { at, chi2: fit.cost(), price, holding })
    }
}

fn instances(of: &[Scored]) -> Vec<Instance> {
    of.iter().map(|s| s.instance).collect()
}

impl Whose {
    /// True where a law over a quantity holds what an effect does: at links and closures that of an effect there.
    fn holds(&self, effect: &Instance, quantity: Quantity) -> bool {
        let there = matches!(self.target, Target::Channel(_)) || self.target == effect.target;
        there && is_over(effect, quantity)
    }
}

/// True where an effect is a function of a quantity: a law over it holds what the effect does.
fn is_over(instance: &Instance, quantity: Quantity) -> bool {
    match instance.term.info().needs {
        Needs::Nothing | Needs::Way | Needs::Motion => false,
        Needs::Order => quantity == Quantity::Time,
        Needs::Temperature => quantity == Quantity::Temperature,
        Needs::Approach => matches!(quantity, Quantity::Direction(_)),
        Needs::Gravity | Needs::Masses => matches!(quantity, Quantity::Torque(_)),
    }
}

/// The likeliest laws of each place, the likeliest place first; all fits leave the same errors to it but for
/// what they keep.
fn scans(
    beside: &[Beside],
    rows: &[usize],
    variables: &[Variable],
    over: &(dyn Fn(&Whose, Quantity) -> bool + Sync),
    (built, constant, data): (&[Whose], f64, &Data),
) -> Vec<Scan> {
    let observations = beside[0].at.observations;
    let scan = |whose: Whose, errors: &dyn Fn(&AtFit) -> Errors| {
        let errors: Vec<Errors> = beside.iter().map(|one| errors(&one.at)).collect();
        if !errors[0].show() {
            return None;
        }
        let each = sets(observations, variables, &whose).into_iter().filter_map(|set| {
            let holds = set.iter().any(|&v| over(&whose, variables[v].quantity));
            let (one, errors) = beside.iter().zip(&errors).find(|(one, _)| one.here(holds))?;
            let of: Vec<&Variable> = set.iter().map(|&v| &variables[v]).collect();
            let evidence = errors.evidence(&of, data, one.chi2);
            let fall = evidence.fall + beside[0].chi2 - one.chi2;
            Some((set, Evidence { price: one.price + evidence.price, fall, ..evidence }))
        });
        let sets: Vec<(Vec<usize>, Evidence)> = each.collect();
        // One variable is as likely beforehand as two.
        let of = |width: usize| sets.iter().filter(|(set, _)| set.len() == width).count() as f64;
        let many = [of(1), of(2)];
        let price = mean(sets.iter().map(|(set, e)| (e.price, 1.0 / many[set.len() - 1])));
        let (set, best) = sets.iter().least_by(|a| a.1.price)?;
        let of: Vec<&Variable> = set.iter().map(|&v| &variables[v]).collect();
        let likeliest = errors[0].likeliest(&of, best)?;
        let fall = best.fall;
        let lone = |v: &usize| sets.iter().all(|(set, _)| set[..] != [*v]);
        let alone = set.iter().copied().filter(lone).map(|v| {
            let evidence = errors[0].evidence(&[&variables[v]], data, beside[0].chi2);
            (v, evidence.fall)
        });
        let alone = alone.collect();
        Some(Scan { whose, sets, price, likeliest, fall, alone })
    };
    let of_channels = workers::map(0..observations.readings.channels, |channel| {
        let gains = gain_of(observations, variables, channel);
        let errors = |at: &AtFit| Errors::of_channel(at, rows, channel, &gains);
        scan(Whose::channel(channel), &errors)
    });
    let of_built = workers::map(0..built.len(), |k| {
        scan(built[k], &|at: &AtFit| Errors::of_beside(at, rows, k).beside_a_constant(constant))
    });
    // Of the places of a kind all are as likely.
    let mut all: Vec<Scan> = Vec::with_capacity(of_channels.len() + of_built.len());
    for kind in [of_channels, of_built] {
        let kind: Vec<Scan> = kind.into_iter().flatten().collect();
        let charge = 2.0 * (kind.len() as f64 / prior(Family::Free)).ln();
        all.extend(kind.into_iter().map(|scan| Scan { price: scan.price + charge, ..scan }));
    }
    order::ascending(&mut all, |a| a.price);
    all
}

/// The likeliest formula of a place, over the sets of variables that these data cannot tell apart; a fit that
/// has what is built beside it has that place alone.
fn formula_of(
    beside: &Beside,
    rows: &[usize],
    scan: &Scan,
    variables: &[Variable],
    (constant, data): (f64, &Data),
) -> Option<Written> {
    let plain = match scan.whose.target {
        Target::Channel(channel) => {
            let gains = gain_of(beside.at.observations, variables, channel);
            Errors::of_channel(&beside.at, rows, channel, &gains)
        }
        _ => Errors::of_beside(&beside.at, rows, 0),
    };
    let errors = match scan.whose.target {
        Target::Channel(_) => plain.clone(),
        _ => plain.clone().beside_a_constant(constant),
    };
    let least = scan.sets.iter().map(|(_, e)| e.price).fold(f64::INFINITY, f64::min);
    let mut likely: Vec<_> = scan.sets.iter().filter(|(_, e)| e.price < least + AS_WELL).collect();
    order::ascending(&mut likely, |a| a.1.price);
    let each = likely.into_iter().take(MOST_SETS).filter_map(|(set, evidence)| {
        let of: Vec<Quantity> = set.iter().map(|&v| variables[v].quantity).collect();
        let smooth = evidence.price - beside.price;
        formula::written(
            &beside.at,
            rows,
            &scan.whose,
            &of,
            [&errors, &plain],
            (data, beside.chi2, smooth),
        )
    });
    let best = each.least_by(|a| a.price)?;
    (best.price < least - beside.price + AS_WELL).then_some(best)
}

/// A constant and the readings of a channel as orthonormal functions of the samples, where a closure makes
/// its coordinate equal to another: what is linear in them is a gain. Nothing elsewhere.
fn gain_of(observations: &Observations, variables: &[Variable], channel: usize) -> Vec<Vec<f64>> {
    let equal = observations.mechanism.made_equal(channel);
    let own = variables.iter().find(|v| v.quantity == Quantity::Theta(channel));
    let Some(own) = own.filter(|_| !equal.is_empty()) else { return Vec::new() };
    let n = own.values.len() as f64;
    let mean = own.values.iter().sum::<f64>() / n;
    let length = own.values.iter().map(|v| (v - mean).powi(2)).sum::<f64>().sqrt();
    let linear = own.values.iter().map(|v| (v - mean) / length).collect();
    vec![vec![n.sqrt().recip(); own.values.len()], linear]
}

/// The sets of variables that a law may have.
fn sets(observations: &Observations, variables: &[Variable], whose: &Whose) -> Vec<Vec<usize>> {
    match whose.target {
        Target::Channel(channel) => sets_of_channel(observations, variables, channel),
        _ => sets_of_built(observations, variables, whose),
    }
}

/// The sets of variables that a law of what is built may have: any one that is not of the way to a pose, and
/// where two joints of its chains are.
fn sets_of_built(
    observations: &Observations,
    variables: &[Variable],
    whose: &Whose,
) -> Vec<Vec<usize>> {
    let mechanism = &observations.mechanism;
    let chains = whose.chains(mechanism);
    let near = |v: &usize| match variables[*v].quantity {
        Quantity::Theta(c) => match mechanism.chain_of(c) {
            Some(chain) => chains.is_empty() || chains.contains(&chain),
            None => chains.is_empty(),
        },
        _ => false,
    };
    let of_pose = |v: &usize| !variables[*v].quantity.of_way();
    let all: Vec<usize> = (0..variables.len()).filter(of_pose).collect();
    let own: Vec<usize> = all.iter().copied().filter(near).collect();
    let pairs =
        own.iter().flat_map(|&v| own.iter().take_while(move |w| **w < v).map(move |w| vec![*w, v]));
    all.iter().map(|&v| vec![v]).chain(pairs).collect()
}

/// The sets of variables that a law of a channel may have: any one that no term has as a free curve,
/// its own reading with any other, and two of its chain, of which one is of the pose. What is of the
/// way to a pose has a partner only where one of both is the channel's own. What a closure makes equal to
/// the channel is its own reading and the residual.
fn sets_of_channel(
    observations: &Observations,
    variables: &[Variable],
    channel: usize,
) -> Vec<Vec<usize>> {
    let chain = |c: usize| observations.mechanism.chain_of(c);
    let near = |v: usize| {
        let its = variables[v].quantity.channel();
        its.is_none_or(|c| chain(c).is_some() && chain(c) == chain(channel))
    };
    let own = |v: usize| variables[v].quantity == Quantity::Theta(channel);
    let own_way = |v: usize| {
        let quantity = variables[v].quantity;
        quantity.of_way() && quantity.channel() == Some(channel)
    };
    let way = |v: usize| variables[v].quantity.of_way();
    let term = |v: usize| own(v) || variables[v].quantity == Quantity::Time;
    let equal = observations.mechanism.made_equal(channel);
    let residual = |v: usize| match variables[v].quantity {
        Quantity::Theta(c) => c != channel && equal.contains(&c),
        _ => false,
    };
    let all = (0..variables.len()).filter(|v| !residual(*v));
    let singles = all.clone().filter(|&v| !term(v)).map(|v| vec![v]);
    let pairs =
        all.clone().flat_map(|v| all.clone().take_while(move |w| *w < v).map(move |w| (w, v)));
    let pairs = pairs.filter(|&(w, v)| match (way(w), way(v)) {
        (true, true) => false,
        (false, false) => own(v) || own(w) || (near(v) && near(w)),
        (true, false) => own(v) || (own_way(w) && near(v)),
        (false, true) => own(w) || (own_way(v) && near(w)),
    });
    singles.chain(pairs.map(|(w, v)| vec![w, v])).collect()
}

/// [`DependsOn`], before its names.
struct On {
    quantity: Quantity,
    share: f64,
    also: Vec<Quantity>,
}

impl On {
    fn named(&self, observations: &Observations) -> DependsOn {
        let name = |quantity: &Quantity| quantity.name(observations);
        DependsOn {
            variable: name(&self.quantity),
            share: self.share,
            also: self.also.iter().map(name).collect(),
        }
    }
}

/// What the likeliest law of a channel depends on, and what cannot be told from it.
fn depends_on(scan: &Scan, variables: &[Variable]) -> Vec<On> {
    let likeliest = scan.sets.iter().least_by(|a| a.1.price);
    let Some((set, best)) = likeliest else { return Vec::new() };
    // What the law explains without a variable; a law of what is left may be one that a term has.
    let without = |v: usize| {
        let rest: Vec<usize> = set.iter().copied().filter(|&w| w != v).collect();
        let alone = || scan.alone.iter().find(|(w, _)| rest[..] == [*w]).map_or(0.0, |it| it.1);
        scan.sets.iter().find(|(s, _)| *s == rest).map_or_else(alone, |(_, e)| e.fall)
    };
    let lost: Vec<f64> = set.iter().map(|&v| (best.fall - without(v)).max(0.0)).collect();
    let all = lost.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let instead = |v: usize| {
        let swapped = scan.sets.iter().filter(|(s, e)| {
            let same = set.iter().filter(|&&w| w != v).all(|w| s.contains(w));
            same && s.len() == set.len() && !s.contains(&v) && e.price < best.price + AS_WELL
        });
        let mut others: Vec<(f64, usize)> = swapped
            .filter_map(|(s, e)| Some((e.price, *s.iter().find(|w| !set.contains(w))?)))
            .collect();
        order::ascending(&mut others, |a| a.0);
        others.into_iter().map(|(_, w)| variables[w].quantity).collect()
    };
    let each = set.iter().zip(&lost);
    let mut out: Vec<On> = each
        .map(|(&v, lost)| On {
            quantity: variables[v].quantity,
            share: lost / all,
            also: instead(v),
        })
        .collect();
    order::descending(&mut out, |a| a.share);
    out
}
