//! A session explained with its joints as they are drawn.
//!
//! Where joints may start anywhere, an error of a surface is taken up by them: a bent table is flattened
//! by offsets of four joints, and the arm is farther from where it is than before. So where the model that
//! was asked for leaves something, a session on a surface is searched once more without offsets of joints,
//! and both explanations have their price (113), offsets that are determined included.
//!
//! Where the second names an error of a surface, or has one in a tie, the first names none, and the second is not ruled
//! out, joints stay as they are drawn: what is not known to be wrong is not changed. Else nothing is hidden, and
//! offsets were asked for.

use crate::Error;
use crate::apply::change::apart;
use crate::diagnosis::long::Search;
use crate::diagnosis::plausibility::absurdities;
use crate::diagnosis::price::{Family, charge, of_number, of_places, prior};
use crate::diagnosis::score::scored::is_data;
use crate::diagnosis::search::outcome::FoundEffect;
use crate::diagnosis::search::rivals::{Explanation, nearest};
use crate::estimate::fit;
use crate::mechanism::Mechanism;
use crate::model::Instance;
use crate::numerics::credible_set::RIVAL;
use crate::terms::term::{Acts, Role};

/// What was asked for, without offsets of joints that turn; none where there are none, no surface, or where an
/// error of a surface was `found` with them: they hide none.
///
/// Where a joint that turns is at zero its maker has marked. A carriage stands where its stop is: of 36 delta
/// printers on a bed 12 were told three effects each, where offsets of carriages were left out here.
#[must_use]
pub(crate) fn without_offsets(
    mechanism: &Mechanism,
    base: &[Instance],
    found: &[FoundEffect],
) -> Option<Vec<Instance>> {
    let named = found.iter().any(|step| of_surface(&step.scored.instance));
    let on_surface = mechanism.touches_surfaces() && !named;
    let turns = |i: &Instance| mechanism.channels_at(i.target).iter().any(|c| mechanism.turns(*c));
    let kept = base.iter().copied().filter(|i| i.term.role() != Role::Offset || !turns(i));
    let kept: Vec<_> = kept.collect();
    (on_surface && kept.len() < base.len()).then_some(kept)
}

/// Which of two searches explains a session: the one of the model that was asked for, or `drawn`, with
/// joints as they are drawn. The other is listed among the rivals of the one that is kept.
///
/// # Errors
///
/// As [`crate::estimate::fit`].
pub(crate) fn likelier<'a>(
    mut asked: Search<'a>,
    mut drawn: Search<'a>,
    offsets: &[Instance],
) -> Result<(Search<'a>, bool), Error> {
    let effects_of = |search: &Search| -> Vec<Instance> {
        search.searched.found.iter().map(|step| step.scored.instance).collect()
    };
    let effects = |search: &Search, more: &[Instance]| -> Vec<Instance> {
        more.iter().copied().chain(effects_of(search).into_iter().filter(|i| !is_data(i))).collect()
    };
    let of_both = [effects(&asked, offsets), effects(&drawn, &[])];
    if !names_surface(&drawn) {
        return Ok((asked, false));
    }
    let paid = paid(&asked, offsets)?;
    let own = asked.searched.price(&asked.averaged) + paid;
    let other = drawn.searched.price(&asked.averaged);
    let small = &drawn.averaged.small;
    let sound = absurdities(small, &drawn.searched.current, &effects_of(&drawn)).is_empty();
    let chosen = sound && other <= own + RIVAL;
    let far = apart(&asked.averaged.small, &asked.searched.current, &drawn.searched.current);
    let (kept, [mine, others], all) = match chosen {
        true => (&mut drawn, [other, own], &of_both[0]),
        false => (&mut asked, [own - paid, other - paid], &of_both[1]),
    };
    let listed_too = sound && !all.is_empty();
    let here = std::mem::take(&mut kept.searched.rivals);
    let here = match here.is_empty() && listed_too {
        true => vec![Explanation {
            effects: Vec::new(),
            noise: None,
            chi2: mine,
            probability: 1.0,
            apart: Some(0.0),
        }],
        false => here,
    };
    let listed = Explanation {
        effects: all.clone(),
        noise: None,
        chi2: others,
        probability: 1.0,
        apart: far,
    };
    let both = here.into_iter().chain(listed_too.then_some(listed));
    let near = nearest(both.map(|explanation| (explanation, ())).collect());
    kept.searched.rivals = near.into_iter().map(|(explanation, ())| explanation).collect();
    // One explanation is no choice.
    if kept.searched.rivals.iter().all(|rival| rival.effects.is_empty()) {
        kept.searched.rivals.clear();
    }
    Ok((if chosen { drawn } else { asked }, chosen))
}

/// True where a search says, or cannot tell from what it says, that a surface is not as it is drawn.
fn names_surface(search: &Search) -> bool {
    let mut found = search.searched.found.iter();
    found.any(|step| of_surface(&step.scored.instance) || step.also.iter().any(of_surface))
}

fn of_surface(instance: &Instance) -> bool {
    matches!(instance.term.acts(), Acts::Surface(_))
}

/// The price of the offsets that were asked for, by what they gain beside what was found. Each joint that is
/// not where it is drawn is one more thing that is wrong. Offsets that readings do not determine cost nothing:
/// they explain nothing.
fn paid(asked: &Search, offsets: &[Instance]) -> Result<f64, Error> {
    let (averaged, with) = (&asked.averaged, &asked.searched.current);
    let kept = with.model.instances.iter().copied().filter(|i| !offsets.contains(i));
    let kept: Vec<Instance> = kept.collect();
    let mut drawn = averaged.small.clone();
    drawn.leave_offsets_as_drawn(&kept);
    let without = fit(&drawn, kept, Some(with))?;
    let gains = averaged.said_of(&without) - averaged.said_of(with);
    let parameters = (without.dof - with.dof).max(0.0);
    let steps = asked.searched.found.iter().filter(|step| !is_data(&step.scored.instance));
    let found = steps.count();
    Ok(charge(parameters, gains.max(0.0))
        + of_places(1.0 / prior(Family::Named))
        + of_number(found + parameters.round() as usize)
        - of_number(found))
}
