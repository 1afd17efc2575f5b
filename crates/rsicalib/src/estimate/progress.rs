//! Progress of a calibration or a trace, for those who wait.
//!
//! How much there is to do is not known beforehand: it depends on what is found. So the share that
//! is done is an estimate, from the usual share of each stage and the steps in it. It never falls.
//! The core knows no clock: whoever listens has one. Whoever listens may end the job.

use std::fmt;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use crate::Error;
use crate::numerics::linearization::{Linearization, Problem};
use crate::numerics::workers::lock;

/// A stage of a calibration or a trace, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Parameters of the model that was asked for.
    Fit,
    /// Readings that are wrong.
    Screening,
    /// Effects that the model lacks.
    Search,
    /// What is at fault alone.
    Isolation,
    /// Parameters with what was found.
    Refit,
    /// Error on poses that are left out.
    HeldOut,
    /// What could be there unseen.
    Detectability,
}

impl Stage {
    /// The stage in words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Fit => "fit",
            Self::Screening => "check for wrong readings",
            Self::Search => "search for missing effects",
            Self::Isolation => "isolate what is at fault",
            Self::Refit => "fit with what was found",
            Self::HeldOut => "fit without some poses",
            Self::Detectability => "size of what could hide",
        }
    }

    /// Share of the work that is usually done when the stage begins and when it ends, and the
    /// number of steps after which half of the stage is done.
    fn span(self, job: Job) -> (f64, f64, f64) {
        match (job, self) {
            (Job::Calibrate, Self::Fit) => (0.0, 0.6, 3.0),
            (Job::Calibrate, Self::HeldOut) => (0.8, 1.0, 3.0),
            (Job::Calibrate, _) => (0.6, 0.8, 5.0),
            (Job::Trace, Self::Fit) => (0.0, 0.02, 3.0),
            (Job::Trace, Self::Screening) => (0.02, 0.03, 3.0),
            (Job::Trace, Self::Search) => (0.03, 0.6, 12.0),
            (Job::Trace, Self::Isolation) => (0.6, 0.67, 20.0),
            (Job::Trace, Self::Refit) => (0.67, 0.68, 3.0),
            (Job::Trace, Self::HeldOut) => (0.68, 0.92, 5.0),
            (Job::Trace, Self::Detectability) => (0.92, 1.0, 1.0),
        }
    }
}

/// What is done as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Job {
    /// A calibration.
    Calibrate,
    /// A trace.
    Trace,
}

#[derive(Debug, Clone, Copy)]
struct Place {
    job: Job,
    stage: Stage,
    steps: f64,
    share: f64,
}

/// Tells a listener the stage of a job and the share of it that is done, from 0 to 1.
#[derive(Clone, Default)]
pub struct Progress(Option<Arc<Teller>>);

struct Teller {
    listener: Box<dyn Fn(Stage, f64) -> ControlFlow<()> + Send + Sync>,
    place: Mutex<Option<Place>>,
    ended: AtomicBool,
}

impl fmt::Debug for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "Progress(heard)" } else { "Progress(unheard)" })
    }
}

impl Progress {
    /// Progress that is heard; the default is not. The listener may be called from any thread, from
    /// one at a time. Where it breaks the job ends with [`Error::Ended`].
    #[must_use]
    pub fn heard_by(
        listener: impl Fn(Stage, f64) -> ControlFlow<()> + Send + Sync + 'static,
    ) -> Self {
        let (listener, place) = (Box::new(listener), Mutex::new(None));
        Self(Some(Arc::new(Teller { listener, place, ended: AtomicBool::new(false) })))
    }

    /// Begins a job; within another one nothing changes.
    pub(crate) fn begin(&self, job: Job) {
        self.tell(|place| {
            place.get_or_insert(Place { job, stage: Stage::Fit, steps: 0.0, share: 0.0 });
        });
    }

    /// Enters a stage; an earlier one than the last is not entered again.
    pub(crate) fn enter(&self, stage: Stage) {
        self.tell(|place| {
            if let Some(place) = place.as_mut().filter(|place| stage > place.stage) {
                (place.stage, place.steps) = (stage, 0.0);
            }
        });
    }

    /// One more step of the stage.
    ///
    /// # Errors
    ///
    /// As [`Progress::goes_on`].
    pub(crate) fn step(&self) -> Result<(), Error> {
        self.tell(|place| {
            if let Some(place) = place {
                place.steps += 1.0;
            }
        });
        self.goes_on()
    }

    /// Whether the job goes on.
    ///
    /// # Errors
    ///
    /// [`Error::Ended`] where the listener has ended it.
    pub(crate) fn goes_on(&self) -> Result<(), Error> {
        if self.ended() { Err(Error::Ended) } else { Ok(()) }
    }

    fn ended(&self) -> bool {
        self.0.as_ref().is_some_and(|teller| teller.ended.load(Ordering::Relaxed))
    }

    /// Changes the place in the job, and tells of it where a job has begun.
    fn tell(&self, change: impl Fn(&mut Option<Place>)) {
        let Some(teller) = &self.0 else { return };
        let mut guard = lock(&teller.place);
        change(&mut guard);
        let Some(place) = guard.as_mut() else { return };
        let (from, to, half) = place.stage.span(place.job);
        let within = 1.0 - 0.5_f64.powf(place.steps / half);
        place.share = (from + (to - from) * within).max(place.share);
        // Told under the lock, so that shares are heard in their order.
        if (teller.listener)(place.stage, place.share).is_break() {
            teller.ended.store(true, Ordering::Relaxed);
        }
    }
}

/// A problem whose listener is asked before each linearisation, which may take long, whether the job
/// goes on.
pub(crate) struct Heard<'a, P> {
    pub problem: &'a P,
    pub progress: &'a Progress,
}

impl<P: Problem> Problem for Heard<'_, P> {
    fn parameters(&self) -> usize {
        self.problem.parameters()
    }

    fn linearize(&self, x: &[f64]) -> Linearization {
        if !self.progress.ended() {
            self.progress.tell(|_| {});
        }
        if self.progress.ended() {
            return Linearization::undefined(x.len());
        }
        self.problem.linearize(x)
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::{Heard, Job, Progress};
    use crate::Error;
    use crate::numerics::linearization::{Curvature, Linearization, Problem};
    use crate::numerics::lm::{self, Termination};

    /// `½ (x² - 2)²`, whose linearisations are counted.
    struct Root(AtomicUsize);

    impl Problem for Root {
        fn parameters(&self) -> usize {
            1
        }

        fn linearize(&self, x: &[f64]) -> Linearization {
            self.0.fetch_add(1, Ordering::Relaxed);
            let (r, slope) = (x[0] * x[0] - 2.0, 2.0 * x[0]);
            let curvature = Curvature::Gram(faer::Mat::from_fn(1, 1, |_, _| slope * slope));
            let (cost, gradient) = (0.5 * r * r, vec![slope * r]);
            Linearization { cost, gradient, curvature, islands: Vec::new() }
        }
    }

    #[test]
    fn a_listener_ends_a_job_within_a_linearisation() {
        let heard = AtomicUsize::new(0);
        let progress =
            Progress::heard_by(move |_, _| match heard.fetch_add(1, Ordering::Relaxed) {
                4.. => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            });
        let root = Root(AtomicUsize::new(0));
        let problem = Heard { problem: &root, progress: &progress };
        // Nobody is told before a job begins.
        let found = lm::minimize(&problem, &[9.0], &lm::SolverOptions::default());
        assert!((found.x[0] - f64::sqrt(2.0)).abs() < 1e-8);
        progress.begin(Job::Calibrate);
        root.0.store(0, Ordering::Relaxed);
        lm::minimize(&problem, &[9.0], &lm::SolverOptions::default());
        // One was told of the beginning, and the fifth breaks.
        assert_eq!(root.0.load(Ordering::Relaxed), 3);
        assert!(matches!(progress.step(), Err(Error::Ended)));
        let again = lm::minimize(&problem, &[9.0], &lm::SolverOptions::default());
        assert_eq!(again.termination, Termination::NotFinite);
    }
}
