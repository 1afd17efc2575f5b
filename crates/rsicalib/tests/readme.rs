//! The example of the crate's README, word for word.

use crate::paper;
use rsicalib::{Error, Fit, FitOptions, Mechanism, Observations, Table, fit};

/// Fits offsets and gains of the hand controller; `values` holds nine readings per row.
pub fn calibrate(values: Vec<f64>) -> Result<Fit, Error> {
    let table = Table { values, ..Table::default() };
    let observations = Observations::new(&Mechanism::rsi(), table, None, FitOptions::default())?;
    let fit = fit(&observations, observations.instances()?, None)?;
    println!("χ² {:.1} for {} degrees of freedom", fit.chi2, fit.dof);
    println!("misclosure {:.5} in, ended by {:?}", fit.rms_misclosure, fit.termination);
    Ok(fit)
}

#[test]
fn the_example_closes_the_loops_of_exact_readings() {
    let poses: Vec<_> = paper::TABLE_II.into_iter().chain(paper::table_iii()).collect();
    let (offsets, gains) = paper::rsi_parameters(0.02, 0.01);
    let fit = calibrate(paper::counts_of(&poses, &offsets, &gains)).expect("usable readings");
    // Lengths of inches, squared and differenced in double precision.
    assert!(fit.rms_misclosure < 1e-8, "{}", fit.rms_misclosure);
}

#[test]
fn the_readme_shows_this_example() {
    let source = include_str!("readme.rs");
    let first = source.find("use rsicalib").expect("its first line");
    let last = source.find("\n#[test]").expect("what follows");
    assert!(include_str!("../README.md").contains(&source[first..last]));
}
