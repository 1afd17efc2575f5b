//! Tables of readings, and what is made of them.

use arbitrary::{Result, Unstructured};
use rsicalib::diagnosis::options::SearchOptions;
use rsicalib::mechanism::Mechanism;
use rsicalib::readings::{Readings, Table};
use rsicalib::report::{calibrated, traced};
use rsicalib::{FitOptions, Observations};

use crate::cases;

/// Numbers that people's files hold, and numbers that no device gives.
fn number(drawn: &mut Unstructured<'_>) -> Result<f64> {
    Ok(match drawn.int_in_range(0..=15)? {
        0 => *drawn.choose(&[f64::NAN, f64::INFINITY, -1.0, 4096.0, 1e308, 1e-320, -0.0])?,
        1 => f64::from_bits(drawn.arbitrary()?),
        2 => 0.0,
        3 => 4095.0,
        _ => f64::from(drawn.int_in_range(0..=4095_u16)?),
    })
}

fn column(drawn: &mut Unstructured<'_>, rows: usize) -> Result<Option<Vec<f64>>> {
    if drawn.ratio(1, 2)? {
        return Ok(None);
    }
    let rows = if drawn.ratio(1, 8)? { rows + 1 } else { rows };
    Ok(Some((0..rows).map(|row| number(drawn).unwrap_or(row as f64)).collect()))
}

fn table(drawn: &mut Unstructured<'_>) -> Result<Table> {
    let rows: usize = drawn.int_in_range(0..=8)?;
    let cut = usize::from(drawn.ratio(1, 16)?);
    let wave = |k: usize| 2048.0 + (1500.0 * (k as f64 * 0.7).sin()).round();
    let few = drawn.int_in_range(0..=4)?;
    let mut values: Vec<f64> = (0..(9 * rows).saturating_sub(cut)).map(wave).collect();
    for _ in 0..few {
        if let Some(at) = values.len().checked_sub(1) {
            values[drawn.int_in_range(0..=at)?] = number(drawn)?;
        }
    }
    let held = drawn.arbitrary()?;
    let pose = if held { Some((0..rows).map(|r| (r / 2) as i64).collect()) } else { None };
    let session = drawn.ratio(1, 4)?.then(|| (0..rows).map(|r| r / 3).collect());
    let (time, temperature) = (column(drawn, rows)?, column(drawn, rows)?);
    Ok(Table { values, pose, time, temperature, session, ..Table::default() })
}

#[test]
fn a_table_is_refused_or_kept_as_it_is() {
    let mechanism = Mechanism::rsi();
    cases(|drawn| {
        let given = table(drawn)?;
        match Readings::new(&mechanism, given.clone()) {
            Err(error) => assert!(error.to_string().len() > 10, "{error}"),
            Ok(read) => {
                let numbers = [&given.time, &given.temperature].into_iter().flatten().flatten();
                assert!(numbers.copied().all(f64::is_finite), "{given:?}");
                assert_eq!(read.table, given);
                assert!(read.mean.iter().all(|m| (0.0..=4095.0).contains(m)), "{:?}", read.mean);
            }
        }
        Ok(())
    });
}

#[test]
fn any_table_has_a_result_or_a_refusal() {
    let mechanism = Mechanism::rsi();
    cases(|drawn| {
        // One table in 20: a trace takes more time than a thousand refusals.
        if !drawn.ratio(1, 20)? {
            return Ok(());
        }
        let noise = drawn.arbitrary::<bool>()?.then(|| vec![1.0; 9]);
        let options = FitOptions { noise, starts: 4, ..FitOptions::default() };
        let Ok(observations) = Observations::new(&mechanism, table(drawn)?, None, options) else {
            return Ok(());
        };
        let _ = calibrated::report(&observations, None);
        let _ = traced::report(&observations, &SearchOptions::default(), None);
        Ok(())
    });
}
