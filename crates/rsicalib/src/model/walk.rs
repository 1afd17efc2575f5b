//! Paths of closed configurations.
//!
//! A path goes from `q` towards `k`, which need not close the loops, by steps of at most `h`. The loops
//! are stiff along `V`, of `G = ∂f/∂q = U S Vᵀ`. Each step corrects what the one before has left open:
//!
//! ```text
//! q' = q - V S⁻¹ Uᵀ f + min(1, h / |k - q|) (1 - V Vᵀ) (k - q)
//! |V' S'⁻¹ U'ᵀ f'| < ½ h,   det(Vᵀ V') det(Uᵀ U') > ½                        (174)
//! ```
//!
//! The determinants are those of the directions in which the loops are stiff, before a step and after
//! it. Across a singular configuration, where several ways to close the loops meet, their product is
//! negative. Elsewhere it comes close to one, and the correction to zero, as steps become short: a step
//! that fails is halved. A path ends at a limit, at a singular configuration, or where no way along the
//! loops leads nearer. `|q|` is the largest coordinate, in steps of about one.

use crate::model::configurations::{LONGEST_STEP, STEPS};
use crate::model::loops::{Loops, Place};
use crate::model::stiff::Stiff;
use crate::model::workspace::Workspace;

/// A path ends where a step along the loops is shorter.
const SHORTEST: f64 = LONGEST_STEP / 16.0;

/// The least product of the determinants of (174), and the largest correction as a part of a step.
const HALF: f64 = 0.5;

/// One path.
pub(super) struct Walk {
    from: Place,
    goal: Place,
    here: Place,
    stiff: Stiff,
    step: f64,
}

/// Walks from places towards others, of at most eight samples of a block.
pub(super) fn walks(
    loops: &Loops<'_>,
    block: usize,
    ways: Vec<(Place, Place)>,
    ws: &mut Workspace,
) -> Vec<Walk> {
    let starts: Vec<Place> = ways.iter().map(|(from, _)| from.clone()).collect();
    let stiff = loops.look(block, &starts, ws);
    let walk = |((from, goal), stiff)| Walk::new(from, goal, stiff);
    let mut walks: Vec<Walk> = ways.into_iter().zip(stiff).map(walk).collect();
    walk_on(loops, block, &mut walks, ws);
    walks
}

/// Walks on until all paths are at their ends.
fn walk_on(loops: &Loops<'_>, block: usize, walks: &mut [Walk], ws: &mut Workspace) {
    for _ in 0..STEPS {
        let next = walks.iter().enumerate().filter_map(|(k, walk)| Some((k, walk.next()?)));
        let (going, next): (Vec<usize>, Vec<Place>) = next.unzip();
        if going.is_empty() {
            break;
        }
        let stiff = loops.look(block, &next, ws);
        for ((k, next), stiff) in going.into_iter().zip(next).zip(stiff) {
            let within = loops.coordinates.within(&next, &walks[k].from);
            walks[k].take(next, stiff, within);
        }
    }
}

/// Which of these paths go on to places that close.
pub(super) fn lead_to(
    loops: &Loops<'_>,
    block: usize,
    walks: &mut [Walk],
    goals: &[Option<Place>],
    ws: &mut Workspace,
) -> Vec<bool> {
    for (walk, goal) in walks.iter_mut().zip(goals) {
        walk.goal.clone_from(goal.as_ref().unwrap_or(&walk.here));
        walk.step = LONGEST_STEP;
    }
    walk_on(loops, block, walks, ws);
    let at: Vec<Place> = walks.iter().map(|walk| walk.goal.clone()).collect();
    let there = loops.look(block, &at, ws);
    let ends = walks.iter().zip(there).zip(goals);
    ends.map(|((walk, there), goal)| goal.is_some() && walk.ends_at(&there)).collect()
}

impl Walk {
    fn new(from: Place, goal: Place, stiff: Stiff) -> Self {
        Self { here: from.clone(), from, goal, stiff, step: LONGEST_STEP }
    }

    /// Where it is, with what is left open corrected.
    pub(super) fn corrected(&self) -> Place {
        &self.here + self.stiff.correction()
    }

    /// The next step; none where no way leads on.
    fn next(&self) -> Option<Place> {
        let way = &self.goal - &self.here;
        let along = self.stiff.free(&way) * (self.step / way.amax()).min(1.0);
        (along.amax() >= SHORTEST).then(|| self.corrected() + along)
    }

    /// Takes a step where it is one along the loops and within limits, or else halves it.
    fn take(&mut self, next: Place, stiff: Stiff, within: bool) {
        let good = within
            && stiff.correction().amax() < HALF * self.step
            && self.stiff.alike(&stiff) > HALF;
        if good {
            (self.here, self.stiff) = (next, stiff);
        }
        self.step = if good { (2.0 * self.step).min(LONGEST_STEP) } else { 0.5 * self.step };
    }

    /// True where one more step leads to its goal, which closes.
    fn ends_at(&self, there: &Stiff) -> bool {
        let way = &self.goal - self.corrected();
        way.amax() <= LONGEST_STEP && self.stiff.alike(there) > HALF
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    fn place(x: f64, y: f64) -> Place {
        DVector::from_vec(vec![x, y])
    }

    /// Walks along `f(x, y) = 0`, of which `stiff` has the misclosure and the slopes.
    fn walk(stiff: &dyn Fn(&Place) -> Stiff, from: Place, goal: Place) -> Walk {
        let stiff_there = stiff(&from);
        let mut walk = Walk::new(from, goal, stiff_there);
        for _ in 0..STEPS {
            let Some(next) = walk.next() else { break };
            let there = stiff(&next);
            walk.take(next, there, true);
        }
        walk
    }

    fn circle(at: &Place) -> Stiff {
        let g = DMatrix::from_row_slice(1, 2, &[2.0 * at[0], 2.0 * at[1]]);
        Stiff::of(DVector::from_element(1, at.norm_squared() - 1.0), &g)
    }

    #[test]
    fn a_path_along_a_circle_leads_to_another_place_of_it() {
        let found = walk(&circle, place(1.0, 0.0), place(-0.6, 0.8));
        assert!((found.corrected() - place(-0.6, 0.8)).amax() < SHORTEST);
        assert!(found.ends_at(&circle(&found.goal)));
    }

    #[test]
    fn a_path_ends_before_a_place_where_two_ways_meet() {
        let cross = |at: &Place| {
            let g = DMatrix::from_row_slice(1, 2, &[at[1], at[0]]);
            Stiff::of(DVector::from_element(1, at[0] * at[1]), &g)
        };
        let found = walk(&cross, place(-1.0, 0.0), place(0.95, 0.0));
        assert!(found.here[0] < 0.0 && found.here[0] > -LONGEST_STEP);
        assert!(!found.ends_at(&cross(&found.goal)));
    }
}
