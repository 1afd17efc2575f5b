//! Poses to visit after a session: those that decide between its explanations, or those that make
//! the platform more certain.

use faer::Mat;

use crate::Error;
use crate::apply::change::PlatformRms;
use crate::apply::poses::poses_of;
use crate::design::contest::{Contest, Field, Rival};
use crate::design::exchange::Criterion;
use crate::design::forecast::decides;
use crate::design::hidden::{WorstHidden, with_priors, worst_hidden};
use crate::design::linearised::{Linearised, Whitened};
use crate::design::moments::{Moments, PoseSlopes, moments_of, slopes_of};
use crate::design::plan::{Within, workspace};
use crate::design::precision::Precision;
use crate::design::reachable::{Reachable, around, reachable};
use crate::diagnosis::options::SearchOptions;
use crate::diagnosis::score::candidates::candidates;
use crate::diagnosis::stepwise::moves::Stepwise;
use crate::estimate::{Fit, Observations, fit};
use crate::model::{Instance, Model, Want, Workspace, parse};
use crate::numerics::random::Random;
use crate::numerics::workers;
