//! What a plan makes small.

use faer::Mat;

use crate::Error;
use crate::design::candidates::Candidates;
use crate::design::linearised::Linearised;
use crate::error::index_of;
use crate::terms::term::Role;

/// What is made small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Criterion {
    /// Sum of the variances of the offsets (A-optimal for what the paper reports).
    #[default]
    Offsets,
    /// Variance of the joint coordinates, averaged over the candidates (I-optimal).
    Joints,
    /// Volume of the confidence ellipsoid (D-optimal).
    Volume,
    /// Variance of the platform, averaged over the workspace (V-optimal).
    Platform,
    /// Probability of a wrong decision between the explanations of a session, (96).
    Decide,
}

/// Names of the criteria, as users write them.
pub const CRITERIA: [(&str, Criterion); 5] = [
    ("decide", Criterion::Decide),
    ("platform", Criterion::Platform),
    ("offsets", Criterion::Offsets),
    ("joints", Criterion::Joints),
    ("volume", Criterion::Volume),
];

impl Criterion {
    /// Its name, as users write it.
    #[must_use]
    pub fn name(self) -> &'static str {
        CRITERIA.iter().find(|c| c.1 == self).map_or("", |c| c.0)
    }

    /// The criterion of a name.
    ///
    /// # Errors
    ///
    /// [`Error::Unknown`] with the names there are.
    pub fn find(name: &str) -> Result<Self, Error> {
        Ok(CRITERIA[index_of(&CRITERIA, |c| c.0, "criterion", name)?].1)
    }

    /// `Ω` of the criterion `tr Ω C` among all parameters of a model; none for the volume. `platform`
    /// is that of the platform.
    pub(crate) fn omega(
        self,
        at: &Linearised<'_>,
        found: &Candidates,
        platform: impl FnOnce() -> Result<Mat<f64>, Error>,
    ) -> Result<Option<Mat<f64>>, Error> {
        match self {
            Self::Volume => Ok(None),
            Self::Platform | Self::Decide => platform().map(Some),
            Self::Offsets => Ok(Some(of_joints(at, found.channels, |_| vec![0.0]))),
            Self::Joints => {
                let of = |c: usize| (0..found.len()).map(|k| found.row(k)[c]).collect();
                Ok(Some(of_joints(at, found.channels, of)))
            }
        }
    }
}

/// `Ω` of the joint coordinates at some readings of each channel.
fn of_joints(
    at: &Linearised<'_>,
    channels: usize,
    readings: impl Fn(usize) -> Vec<f64>,
) -> Mat<f64> {
    let n = at.model.parameters;
    let mut omega = Mat::zeros(n, n);
    for c in 0..channels {
        let Some(offset) = at.model.column(Role::Offset, c) else { continue };
        omega[(offset, offset)] = 1.0;
        let Some(gain) = at.model.column(Role::Gain, c) else { continue };
        // Gains turn about the centre of each channel.
        let centre = at.model.scales[c].centre;
        let a: Vec<f64> = readings(c).iter().map(|reading| reading - centre).collect();
        let count = a.len() as f64;
        let mean = a.iter().sum::<f64>() / count;
        omega[(offset, gain)] = mean;
        omega[(gain, offset)] = mean;
        omega[(gain, gain)] = a.iter().map(|a| a * a).sum::<f64>() / count;
    }
    omega
}
