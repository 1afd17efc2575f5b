//! Faults of converters against codes that have them, and codes that have none.

use crate::devices::Rng;
use rsicalib::screening::converter::of_codes;
use rsicalib::screening::fault::FaultKind;

/// Codes of 48 poses, 8 samples each, of nine channels, with noise of about a count.
fn held(seed: u64) -> (Vec<f64>, Vec<usize>) {
    let mut rng = Rng::new(seed + 1);
    let (mut values, mut pose) = (Vec::new(), Vec::new());
    for p in 0..48 {
        let centre: [f64; 9] = std::array::from_fn(|_| rng.uniform(1200.0, 2900.0));
        for _ in 0..8 {
            values.extend(centre.map(|c| (c + rng.normal()).round()));
            pose.push(p);
        }
    }
    (values, pose)
}

/// A recording of 4,000 rows whose channels swing to and fro by the same amount.
fn waved(seed: u64) -> (Vec<f64>, Vec<usize>) {
    let mut rng = Rng::new(seed + 1);
    let pace: [f64; 9] = std::array::from_fn(|_| rng.uniform(0.01, 0.05));
    let values = (0..4000).flat_map(|row| {
        pace.map(|w| (2000.0 + 700.0 * (w * f64::from(row)).sin() + rng.normal()).round())
    });
    (values.collect(), (0..4000).collect())
}

fn change(values: &mut [f64], channel: usize, by: impl Fn(i64) -> i64) {
    values.iter_mut().skip(channel).step_by(9).for_each(|v| *v = by(*v as i64) as f64);
}

#[test]
fn sound_codes_have_no_faults() {
    for seed in 0..200 {
        let (values, pose) = held(seed);
        assert_eq!(of_codes(&values, &[true; 9], &pose, true), []);
    }
    for seed in 0..20 {
        let (values, pose) = waved(seed);
        assert_eq!(of_codes(&values, &[true; 9], &pose, false), []);
    }
}

#[test]
fn stuck_bits_are_found_with_their_value() {
    for (bit, high) in [(0, true), (1, false), (3, true), (5, false)] {
        for (mut values, pose, still) in
            [(held(7).0, held(7).1, true), (waved(7).0, waved(7).1, false)]
        {
            let stick = |code: i64| if high { code | 1 << bit } else { code & !(1 << bit) };
            change(&mut values, 4, stick);
            let found = of_codes(&values, &[true; 9], &pose, still);
            let stuck = found.iter().find(|f| f.kind == FaultKind::StuckBits(vec![(bit, high)]));
            assert_eq!(stuck.map(|f| f.channel), Some(4), "bit {bit}: {found:?}");
        }
    }
}

#[test]
fn clipped_codes_are_found_with_their_poses() {
    let (mut values, pose) = held(3);
    change(&mut values, 2, |code| code.min(2500));
    let found = of_codes(&values, &[true; 9], &pose, true);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].channel, 2);
    let FaultKind::Clipped { at, poses } = &found[0].kind else { panic!("{found:?}") };
    assert_eq!(*at, 2500.0);
    let all = |p: usize| (0..8).all(|s| values[(8 * p + s) * 9 + 2] == 2500.0);
    assert_eq!(*poses, (0..48).filter(|&p| all(p)).collect::<Vec<_>>());

    let (mut values, pose) = waved(3);
    change(&mut values, 6, |code| code.max(1400));
    let found = of_codes(&values, &[true; 9], &pose, false);
    assert_eq!(found.iter().map(|f| f.channel).collect::<Vec<_>>(), [6]);
}

#[test]
fn averages_and_angles_have_no_bits() {
    let (mut values, pose) = held(1);
    change(&mut values, 0, |code| code & !1);
    assert_eq!(of_codes(&values, &[false; 9], &pose, true), []);
    values[0] += 0.5;
    assert_eq!(of_codes(&values, &[true; 9], &pose, true), []);
}
