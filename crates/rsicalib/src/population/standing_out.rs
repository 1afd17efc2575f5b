//! Devices that stand out of a fleet: by their verdict, or by a parameter.

use crate::diagnosis::verdict::Verdict;
use crate::numerics::distributions::student_limit;
use crate::numerics::median::median;
use crate::numerics::order;

/// Devices from which on a spread tells what is usual.
const FEWEST: usize = 5;

/// Efficiency of the median distance from the median, of normal numbers (Rousseeuw and Croux 1993): it knows the standard
/// deviation as well as so large a share of them does.
const EFFICIENCY: f64 = 0.37;

/// Probability of naming any parameter of a fleet of normal devices.
const FALSE: f64 = 0.01;

/// A parameter is hardly determined where its standard deviation is so many times the usual.
const WEAK: f64 = 4.0;

/// Of a normal number, the standard deviation over the median distance from the median.
const NORMAL: f64 = 1.4826;

/// What a device has of one parameter: its value, and the standard deviation of that.
pub type Known = (f64, f64);

/// One parameter over the devices whose calibration is usable, in its unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Usual {
    /// Median of the values.
    pub median: f64,
    /// Standard deviation between devices, robust.
    pub between: f64,
    /// Median standard deviation of one device; NaN where none is known.
    pub within: f64,
    /// How many devices these are.
    pub devices: usize,
}

impl Usual {
    /// Of devices with these verdicts; a refused device has no verdict. None where fewer than 5 are usable.
    #[must_use]
    pub fn of(devices: &[Known], verdicts: &[Option<Verdict>]) -> Option<Self> {
        let usable = |verdict: &Option<Verdict>| verdict.is_some_and(|v| v.exit_code() == 0);
        let both = devices.iter().zip(verdicts).filter(|(own, v)| usable(v) && own.0.is_finite());
        let known: Vec<Known> = both.map(|(own, _)| *own).collect();
        if known.len() < FEWEST {
            return None;
        }
        let middle = median(known.iter().map(|own| own.0).collect());
        let between = NORMAL * median(known.iter().map(|own| (own.0 - middle).abs()).collect());
        let within = median(known.iter().map(|own| own.1).filter(|sd| sd.is_finite()).collect());
        Some(Self { median: middle, between, within, devices: known.len() })
    }

    /// How far a device is from the median where one of so many numbers of normal devices is by chance: few devices
    /// know their own spread badly.
    fn limit(&self, numbers: usize) -> f64 {
        student_limit(FALSE, numbers, EFFICIENCY * self.devices.saturating_sub(1) as f64)
    }

    /// How far a device is from the median, in units of the larger of `between` and its own standard
    /// deviation; NaN where it is not known.
    #[must_use]
    pub fn far(&self, (value, sd): Known) -> f64 {
        (value - self.median) / self.between.max(sd).max(f64::MIN_POSITIVE)
    }

    /// The device that is farthest from the median, and how far.
    #[must_use]
    pub fn furthest(&self, devices: &[Known]) -> (usize, f64) {
        let far = devices.iter().map(|&own| self.far(own).abs()).enumerate();
        far.fold((0, 0.0), |most, own| if own.1 > most.1 { own } else { most })
    }
}

/// Why a device stands out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Remark {
    /// The device.
    pub device: usize,
    /// The more it stands out, the larger: χ² per degree of freedom, or standard deviations.
    pub size: f64,
    /// What stands out; none where the verdict says it.
    pub parameter: Option<Odd>,
}

/// A parameter of a device that is unlike that of the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Odd {
    /// The parameter.
    pub number: usize,
    /// How many times worse than usual it is known, where it is not far away; none where it is.
    pub weak: Option<f64>,
}

/// Devices that stand out by parameter `number`, where so many `numbers` of the fleet are looked at. Of an
/// undetermined device its verdict says that its parameters are not known.
#[must_use]
pub fn by_parameter(
    number: usize,
    usual: &Usual,
    devices: &[Known],
    verdicts: &[Option<Verdict>],
    numbers: usize,
) -> Vec<Remark> {
    let limit = usual.limit(numbers);
    let one = |(device, (&own, verdict)): (usize, (&Known, &Option<Verdict>))| {
        let (size, weak) = (usual.far(own).abs(), own.1 / usual.within);
        let is_weak = weak > WEAK && *verdict != Some(Verdict::Undetermined);
        let is_far = size > limit;
        let odd = Odd { number, weak: (!is_far).then_some(weak) };
        let remark = Remark { device, size, parameter: Some(odd) };
        (verdict.is_some() && (is_far || is_weak)).then_some(remark)
    };
    devices.iter().zip(verdicts).enumerate().filter_map(one).collect()
}

/// Devices that stand out by their verdicts; of `fits`, χ² and degrees of freedom.
#[must_use]
pub fn by_verdict(verdicts: &[Option<Verdict>], fits: &[(f64, f64)]) -> Vec<Remark> {
    let one = |(device, (verdict, &(chi2, dof))): (usize, (&Option<Verdict>, &(f64, f64)))| {
        let size = if dof > 0.0 && !chi2.is_nan() { chi2 / dof } else { 0.0 };
        let fine = matches!(verdict, Some(Verdict::Adequate | Verdict::Unjudged));
        (!fine).then_some(Remark { device, size, parameter: None })
    };
    verdicts.iter().zip(fits).enumerate().filter_map(one).collect()
}

/// Puts devices first that need a decision, and of these those that stand out most.
pub fn sort(remarks: &mut [Remark], verdicts: &[Option<Verdict>]) {
    let rank = |one: &Remark| rank(verdicts[one.device]);
    remarks.sort_by(|a, b| rank(a).cmp(&rank(b)).then(order::compare(-a.size, -b.size)));
}

/// How soon somebody must decide on a device, the soonest first; none was refused.
fn rank(verdict: Option<Verdict>) -> u8 {
    match verdict {
        None => 0,
        Some(Verdict::Undetermined) => 1,
        Some(Verdict::Implausible) => 2,
        Some(Verdict::Unexplained) => 3,
        Some(Verdict::PartlyExplained) => 4,
        Some(Verdict::Explained) => 5,
        Some(Verdict::Adequate | Verdict::Unjudged) => 6,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::distributions::normal_quantile;
    use crate::numerics::random::Random;

    #[test]
    fn a_device_is_named_by_the_limit_of_all_numbers_that_are_looked_at() {
        // scipy.stats.norm.isf(0.005), version 1.17: 0.5 % in each tail.
        let usual = Usual { median: 1.0, between: 0.1, within: 0.01, devices: 1_000_000_000 };
        let verdicts = [Some(Verdict::Adequate); 2];
        let devices = [(1.0 + 0.1 * 2.575, 0.01), (1.0 - 0.1 * 2.577, 0.01)];
        let found = by_parameter(0, &usual, &devices, &verdicts, 1);
        assert_eq!(found.iter().map(|one| one.device).collect::<Vec<_>>(), [1]);
        assert!(by_parameter(0, &usual, &devices, &verdicts, 2).is_empty());
    }

    #[test]
    fn what_is_usual_is_told_by_usable_devices_alone() {
        let mut devices: Vec<Known> = (0..21).map(|k| (f64::from(k), 0.5)).collect();
        let mut verdicts = vec![Some(Verdict::Unjudged); 21];
        devices.push((1e9, 1e9));
        verdicts.push(Some(Verdict::Undetermined));
        // Of 0 to 20 the median is 10, and the median distance from it is 5.
        let usual = Usual { median: 10.0, between: 1.4826 * 5.0, within: 0.5, devices: 21 };
        assert_eq!(Usual::of(&devices, &verdicts), Some(usual));
        verdicts[..17].fill(None);
        assert_eq!(Usual::of(&devices, &verdicts), None);
    }

    #[test]
    fn small_fleets_of_normal_devices_name_none_and_one_that_is_far_off() {
        let mut random = Random::new(20_261_128);
        for (devices, far) in [(6, 1000.0), (12, 80.0), (40, 20.0)] {
            let (verdicts, numbers) = (vec![Some(Verdict::Adequate); devices], 9 * devices);
            let (mut named, fleets) = (0, 300);
            for _ in 0..fleets {
                let any = (0..9).any(|number| {
                    let mut own: Vec<Known> = (0..devices)
                        .map(|_| (normal_quantile(random.uniform(0.0, 1.0)), 0.01))
                        .collect();
                    let remarks = |own: &[Known]| {
                        let usual = Usual::of(own, &verdicts).expect("enough devices");
                        by_parameter(number, &usual, own, &verdicts, numbers)
                    };
                    let any = !remarks(&own).is_empty();
                    own[3].0 += far;
                    assert!(remarks(&own).iter().any(|one| one.device == 3));
                    any
                });
                named += usize::from(any);
            }
            // 1 % is promised: of 300, 3 and three of their standard deviations.
            assert!(named <= 8, "{devices} devices: {named} of {fleets} fleets");
        }
    }
}
