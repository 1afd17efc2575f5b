//! Points between closures, which no chain carries: the sled of a machine on belts, and its anchors.

use crate::closures::kind::Part;
use crate::mechanism::Closure;
use crate::model::compiled::Model;
use crate::model::ends::{End, ends};

/// A point that is somewhere else in each pose, or one that a closure holds such a point to.
pub(crate) struct Between {
    /// The channel of the length to it, or the point.
    pub(crate) name: String,
    /// True where a channel measures the length to it.
    pub(crate) measured: bool,
    /// The closures of the mechanism that end there.
    pub(crate) closures: Vec<usize>,
    pub(crate) end: End,
}

impl Between {
    /// True where it is somewhere else in each pose.
    pub(crate) fn moves(&self) -> bool {
        matches!(self.end, End::Posed(_))
    }
}

impl Model {
    /// The points between closures; none where no point moves by itself.
    pub(crate) fn between_closures(&self) -> Vec<Between> {
        let mut out: Vec<Between> = Vec::new();
        for (number, closure) in self.mechanism.closures.iter().enumerate() {
            for (name, measured, end) in self.held(closure) {
                match out.iter_mut().find(|b| b.name == name && b.measured == measured) {
                    Some(known) => known.closures.push(number),
                    None => out.push(Between { name, measured, closures: vec![number], end }),
                }
            }
        }
        out
    }

    /// Name, whether a channel measures the length to it, and place of the ends of a closure that
    /// holds a point which moves; without those that chains carry or an instrument measures.
    fn held(&self, closure: &Closure) -> Vec<(String, bool, End)> {
        let Ok(ends) = ends(&self.mechanism, closure, &self.owned, &self.attached) else {
            return Vec::new();
        };
        let points = closure.kind.facts().between == [Part::Point; 2];
        if !points || !ends.iter().any(|end| matches!(end, End::Posed(_))) {
            return Vec::new();
        }
        let one = |(end, point): (End, &String)| match (end, &closure.channel) {
            (End::Posed(_), _) | (End::Fixed(_) | End::Unknown(..), None) => {
                Some((point.clone(), false, end))
            }
            (End::Fixed(_) | End::Unknown(..), Some(channel)) => Some((channel.clone(), true, end)),
            (End::Carried(..) | End::Seen(..) | End::Coordinate(_), _) => None,
        };
        ends.into_iter().zip(&closure.between).filter_map(one).collect()
    }
}
