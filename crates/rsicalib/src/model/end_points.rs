//! Where the ends of closures and the points of a mechanism are.

use crate::model::compiled::Model;
use crate::model::ends::{End, Measured, moves_of, rotate, seen_from, turned};
use crate::model::workspace::Workspace;
use crate::numerics::lanes::{Lanes, Vec3};

/// A point of a frame, in base coordinates.
#[inline(always)]
fn moved(rotation: &[f64; 9], origin: &[f64; 3], point: &Vec3) -> Vec3 {
    let mut out = rotate(rotation, point);
    for (out, origin) in out.iter_mut().zip(origin) {
        *out += Lanes::splat(*origin);
    }
    out
}

impl Model {
    #[inline(always)]
    pub(crate) fn end_point(
        &self,
        end: &End,
        group: usize,
        seen: &[Lanes],
        beta: &[f64],
        ws: &Workspace,
    ) -> Vec3 {
        match end {
            End::Carried(chain, at, moved_by) => {
                let tip = &ws.postures[*chain].tip;
                self.moved_along(tip.point(at), *moved_by, &tip.axes, beta, &ws.gates)
            }
            End::Fixed(at) => at.map(Lanes::splat),
            End::Unknown(number, at, free) => {
                let mut point = at.map(Lanes::splat);
                let mut parameter = self.unknown_first(*number, group);
                for (point, free) in point.iter_mut().zip(free) {
                    if *free {
                        *point = Lanes::splat(beta[parameter]);
                        parameter += 1;
                    }
                }
                point
            }
            End::Posed(number) => self.posed_point(*number, &ws.xi, beta, &ws.gates),
            End::Seen(columns, frame, [from, to]) => {
                let read = [seen[columns[0]], seen[columns[1]], seen[columns[2]]];
                let mut point = read;
                for knock in &self.knocks[*from..*to] {
                    let moves = knock.moves(&read, beta, &ws.gates);
                    point.iter_mut().zip(moves).for_each(|(at, by)| *at += by);
                }
                match frame {
                    Measured::Base => point,
                    Measured::Known(rotation, origin) => moved(rotation, origin, &point),
                    Measured::Unknown(number) => {
                        let first = self.unknown_first(*number, group);
                        let origin = [beta[first], beta[first + 1], beta[first + 2]];
                        moved(&turned(&beta[first + 3..first + 6]), &origin, &point)
                    }
                }
            }
            End::Coordinate(channel) => [ws.angles[*channel], Lanes::ZERO, Lanes::ZERO],
        }
    }

    /// A point that some of the attached moves move along these axes.
    #[inline(always)]
    pub(super) fn moved_along(
        &self,
        mut point: Vec3,
        [from, to]: [usize; 2],
        axes: &[Vec3; 3],
        beta: &[f64],
        gates: &[Lanes],
    ) -> Vec3 {
        for own in &self.attached[from..to] {
            own.by.along(&mut point, axes, beta, gates);
        }
        point
    }

    /// Where a point is that is somewhere else in each pose.
    #[inline(always)]
    pub(crate) fn posed_point(
        &self,
        number: usize,
        xi: &[Lanes],
        beta: &[f64],
        gates: &[Lanes],
    ) -> Vec3 {
        let (at, moved_by) = (self.posed.place(number, xi), self.posed.points[number].moved_by);
        if moved_by[0] == moved_by[1] {
            return at;
        }
        self.moved_along(at, moved_by, &self.posed.axes(number, xi), beta, gates)
    }

    /// The rotation of the frame in which an instrument measures, row by row.
    #[inline(always)]
    pub(super) fn axes_of(&self, frame: &Measured, group: usize, beta: &[f64]) -> [f64; 9] {
        match frame {
            Measured::Base => [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            Measured::Known(rotation, _) => *rotation,
            Measured::Unknown(number) => {
                let first = self.unknown_first(*number, group);
                turned(&beta[first + 3..first + 6])
            }
        }
    }

    /// What an instrument would read of a place in base coordinates.
    pub(crate) fn seen_from(
        &self,
        frame: &Measured,
        group: usize,
        beta: &[f64],
        at: [f64; 3],
    ) -> [f64; 3] {
        match frame {
            Measured::Base => at,
            Measured::Known(rotation, origin) => seen_from(rotation, origin, at),
            Measured::Unknown(number) => {
                let pose = &beta[self.unknown_first(*number, group)..][..6];
                seen_from(&turned(&pose[3..]), &pose[..3], at)
            }
        }
    }

    /// Positions of the mechanism's points in one block, in base coordinates, one per point; `None`
    /// for an unknown point.
    ///
    /// `ws` comes from [`Model::evaluate`] with these parameters.
    #[must_use]
    pub fn points(&self, ws: &Workspace, beta: &[f64]) -> Vec<Option<Vec3>> {
        let points = self.mechanism.points.iter().enumerate();
        points
            .map(|(number, point)| match (&point.chain, point.at) {
                (Some(chain), Some(at)) => {
                    let chain = self.mechanism.chain_index(chain).ok()?;
                    let (tip, moved_by) =
                        (&ws.postures[chain].tip, moves_of(&self.attached, number));
                    Some(self.moved_along(tip.point(&at), moved_by, &tip.axes, beta, &ws.gates))
                }
                (None, Some(at)) => Some(at.map(Lanes::splat)),
                _ => None,
            })
            .collect()
    }
}
