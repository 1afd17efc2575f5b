//! Where a search ended.

use std::sync::Arc;

use crate::diagnosis::averaged::Averaged;
use crate::diagnosis::doubt::doubt;
use crate::diagnosis::options::LEVEL;
use crate::diagnosis::score::scored::{self, Scored};
use crate::diagnosis::search::rivals::Explanation;
use crate::estimate::Fit;
use crate::model::{Instance, Model};
use crate::screening::blame::Blame;

/// One effect of a search.
pub struct FoundEffect {
    pub scored: Scored,
    /// What fits as well.
    pub also: Vec<Instance>,
    /// Whose reading is wrong, if it is one.
    pub blame: Blame,
    /// The fit without it.
    pub without: Fit,
    /// Scores of everything without it, best first.
    pub scores: Vec<Scored>,
    /// Laws of the same target that fit as well: the model with each, and its parameters.
    pub laws: Vec<(Instance, Arc<Model>, Vec<f64>)>,
}

/// Where a search ended.
pub struct Searched {
    pub current: Fit,
    pub found: Vec<FoundEffect>,
    /// Poses that are wrong as a whole.
    pub poses: Vec<Scored>,
    pub left: Option<Scored>,
    /// Scores of everything that is left, best first.
    pub scores: Vec<Scored>,
    /// Explanations that are nearly as good as the best, itself included.
    pub rivals: Vec<Explanation>,
}

impl Searched {
    /// A search that did not look for anything.
    pub fn nothing(start: Fit) -> Self {
        let (found, poses) = (Vec::new(), Vec::new());
        let (rivals, scores) = (Vec::new(), Vec::new());
        Self { current: start, found, poses, left: None, scores, rivals }
    }

    /// What is found but wrong readings.
    fn effects(&self) -> impl Iterator<Item = &FoundEffect> {
        self.found.iter().filter(|step| !scored::is_data(&step.scored.instance))
    }

    /// What is left, with what is paid for what was found.
    pub(crate) fn price(&self, averaged: &Averaged) -> f64 {
        let found = self.found.iter().map(|step| step.scored);
        let all: Vec<Scored> = found.chain(self.poses.iter().copied()).collect();
        averaged.said_of(&self.current) + scored::paid(&all)
    }

    /// True where what is left is noise.
    pub(crate) fn quiet(&self, averaged: &Averaged) -> bool {
        averaged.judge(&self.current).lack_of_fit(&self.current).is_none_or(|p| p > LEVEL)
    }

    /// True where nothing is left, and nothing that was found is in doubt.
    pub(crate) fn is_answer(&self, averaged: &Averaged) -> bool {
        let (found, rises): (Vec<_>, Vec<_>) = self
            .effects()
            .map(|step| (step.scored.instance, step.without.cost() - self.current.cost()))
            .unzip();
        self.quiet(averaged) && doubt(&averaged.small.mechanism, &found, &rises).is_none()
    }
}
