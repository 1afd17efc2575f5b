//! Names of a change by their evidence.

use crate::monitor::open::{Left, Name, Open, Rest};
use crate::monitor::watching::Monitor;

/// Names that are tried for the linearisation.
const TRIED: usize = 3;

impl Monitor {
    /// Names by their evidence, the best first, linearised about the estimate of the best as long
    /// as the rows since the onset are there; and what the best leaves of these.
    pub(super) fn compare(&mut self, open: &mut Open, last: u64) -> (Vec<Name>, Option<Rest>) {
        let mut names = self.names(open);
        let mut rest = None;
        for _ in 0..TRIED {
            let Some(best) = names.first().map(|n| n.kinds) else { break };
            rest = self.refit(open, best, last);
            let Some(rest) = rest else { break };
            open.left = Some(Left { kinds: best, last, rest });
            names = self.names(open);
            if names.first().is_some_and(|n| n.kinds == best) {
                break;
            }
        }
        (names, rest)
    }

    fn names(&self, open: &Open) -> Vec<Name> {
        let told = open.told(&self.watched, &self.state, self.scale);
        told.map_or(Vec::new(), |told| open.names(&told, &self.watched))
    }
}
