//! [`AnchorPosition`].

use crate::mechanism::{Mechanism, Point, Target};
use crate::terms::term::{Acts, Term};

term! {
    /// An anchor that stands elsewhere than drawn.
    ///
    /// Moves the end of a distance that is on no chain, and stands, by `x`, `y`, `z`: a joint of a hexapod's
    /// base, a drum of a cable robot, the post of a ball bar. Of one that is unknown the fit says where it is; one
    /// at which several distances end is not looked for.
    AnchorPosition("anchor_position", Closure, per Closure, needs Nothing) {
        x: "length" ~ 2.5e-3,
        y: "length" ~ 2.5e-3,
        z: "length" ~ 2.5e-3,
    } acts Acts::End
}

impl Term for AnchorPosition {
    fn suits_target(&self, mechanism: &Mechanism, target: Target) -> bool {
        let Target::Closure(closure) = target else { return false };
        let own = &mechanism.closures[closure];
        let is_distance = own.channel.is_some() || own.value.is_some();
        let end = mechanism.standing_end(closure).filter(|_| is_distance);
        end.is_some_and(|end| {
            let mut points = mechanism.points.iter();
            let drawn = |p: &Point| p.at.is_some() && p.unknown.is_none();
            let name = &own.between[end];
            let alone = mechanism.closures.iter().filter(|c| c.between.contains(name)).count() == 1;
            alone && points.any(|point| point.name == *name && drawn(point))
        })
    }
}
