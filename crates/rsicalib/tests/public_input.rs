//! Public input that makes no sense is refused with an error, or has a documented answer.

use rsicalib::diagnosis::options::SearchOptions;
use rsicalib::estimate::paper::Paper;
use rsicalib::mechanism::Mechanism;
use rsicalib::model::{Instance, Model, parse};
use rsicalib::numerics::dense::Dense;
use rsicalib::numerics::lm::{SolverOptions, minimize};
use rsicalib::readings::{Readings, Table};
use rsicalib::report::{calibrated, traced};
use rsicalib::{Error, FitOptions, Observations, Target, fit, terms};

/// One channel in the middle of its range, nine times over.
fn table(rows: usize) -> Table {
    Table { values: vec![2048.0; 9 * rows], ..Table::default() }
}

fn readings(rows: usize) -> Readings {
    Readings::new(&Mechanism::rsi(), table(rows)).expect("counts within their range")
}

fn instance(id: &str, target: Target, place: usize) -> Instance {
    Instance { term: terms::find(id).expect("a term"), target, place }
}

fn model(instance: Instance) -> Result<Model, Error> {
    Model::new(&Mechanism::rsi(), &readings(3), vec![instance])
}

#[test]
fn a_mechanism_without_channels_is_refused() {
    let bare = Mechanism { channels: Vec::new(), ..Mechanism::rsi() };
    for table in [table(3), Table::default()] {
        let found = Readings::new(&bare, table.clone());
        assert!(matches!(found, Err(Error::Mechanism { .. })), "{found:?}");
        let found = Observations::new(&bare, table, None, FitOptions::default());
        assert!(matches!(found, Err(Error::Mechanism { .. })), "{found:?}");
    }
    assert!(Paper::new(&bare, &[]).is_err());
    assert!(Paper::new(&bare, &[1.0]).is_err());
}

#[test]
fn a_table_without_rows_is_refused() {
    let found = Readings::new(&Mechanism::rsi(), Table::default());
    assert!(matches!(found, Err(Error::Empty(_))), "{found:?}");
}

#[test]
fn columns_of_another_length_are_refused() {
    let mechanism = Mechanism::rsi();
    let cut = Table { values: vec![2048.0; 10], ..Table::default() };
    let short = Table { time: Some(vec![0.0]), ..table(3) };
    let keys = Table { keys: vec![vec![String::new(); 3]], ..table(3) };
    let columns = Table { columns: vec![vec![1.0; 3]], ..table(3) };
    for table in [cut, short, keys, columns] {
        let found = Readings::new(&mechanism, table);
        assert!(matches!(found, Err(Error::Shape { .. })), "{found:?}");
    }
}

#[test]
fn a_session_number_out_of_all_proportion_is_refused() {
    for last in [100_000, usize::MAX] {
        let table = Table { session: Some(vec![0, 1, last]), ..table(3) };
        let found = Readings::new(&Mechanism::rsi(), table);
        assert!(matches!(found, Err(Error::Shape { .. })), "{found:?}");
    }
}

#[test]
fn averages_need_one_weight_per_sample() {
    let (mechanism, readings) = (Mechanism::rsi(), readings(3));
    for weights in [vec![], vec![1.0; 2], vec![1.0; 4]] {
        let found = readings.averaged(&mechanism, &weights);
        assert!(matches!(found, Err(Error::Shape { expected: 3, .. })), "{found:?}");
    }
    assert!(readings.averaged(&mechanism, &[1.0, 0.0, 1.0]).is_ok());
}

#[test]
fn rows_and_blocks_beyond_the_last_are_empty() {
    let readings = readings(3);
    for beyond in [3, usize::MAX] {
        assert!(readings.row(beyond).is_empty());
        assert!(readings.raw(beyond).is_empty());
        assert!(readings.approach(beyond).is_empty());
        assert!(readings.velocity(beyond).is_empty());
        assert!(readings.columns(beyond).is_empty());
    }
    assert_eq!(readings.row(2), [2048.0; 9]);
    assert_eq!(readings.raw(0).len(), 9);
}

#[test]
fn targets_that_a_mechanism_does_not_have_are_named_by_kind_and_index() {
    let mechanism = Mechanism::rsi();
    let names = [
        (Target::All, "all", true),
        (Target::Channel(4), "a22", true),
        (Target::Channel(9), "channel 9", false),
        (Target::Chain(3), "chain 3", false),
        (Target::Row(0, 3), "arm1/4", true),
        (Target::Row(0, 4), "arm1/5", false),
        (Target::Row(3, 0), "chain 3/1", false),
        (Target::Closure(3), "closure 3", false),
    ];
    for (target, name, there) in names {
        assert_eq!(target.name(&mechanism), name);
        assert_eq!(target.is_in(&mechanism), there, "{name}");
    }
}

#[test]
fn queries_beyond_the_last_channel_or_chain_have_documented_answers() {
    let mechanism = Mechanism::rsi();
    for beyond in [9, usize::MAX] {
        assert!(mechanism.channels_of(beyond).is_empty());
        assert_eq!(mechanism.chain_of(beyond), None);
        assert!(!mechanism.slides(beyond));
        assert!(!mechanism.turns(beyond));
    }
    assert!(mechanism.turns(8));
}

#[test]
fn a_model_refuses_targets_and_places_that_are_not_there() {
    let wrong = [
        instance("offset", Target::Channel(9), 0),
        instance("offset", Target::All, 0),
        instance("link_length", Target::Row(0, 4), 0),
        instance("link_length", Target::Chain(0), 0),
        instance("base_tilt", Target::Chain(3), 0),
        instance("sag", Target::Closure(0), 0),
        instance("distance", Target::Closure(3), 0),
    ];
    for instance in wrong {
        let found = model(instance);
        assert!(matches!(found, Err(Error::Unknown { kind: "target", .. })), "{found:?}");
    }
    let found = model(instance("crosstalk", Target::Channel(4), 9));
    assert!(matches!(found, Err(Error::Unknown { kind: "place", .. })), "{found:?}");
    assert!(model(instance("crosstalk", Target::Channel(4), 3)).is_ok());
}

#[test]
fn a_model_refuses_readings_of_another_mechanism_and_a_short_centre() {
    let (mechanism, readings) = (Mechanism::rsi(), readings(3));
    let mut arm = mechanism.clone();
    arm.channels.pop();
    arm.chains[2].rows.pop();
    let found = Model::new(&arm, &readings, Vec::new());
    assert!(matches!(found, Err(Error::Shape { .. })), "{found:?}");
    let found = Model::about(None, &mechanism, &readings, Vec::new(), &[2048.0; 8]);
    assert!(matches!(found, Err(Error::Shape { found: 8, expected: 9, .. })), "{found:?}");
}

#[test]
fn an_empty_list_of_terms_gives_a_fit_without_parameters() {
    let (mechanism, options) = (Mechanism::rsi(), FitOptions::default());
    let options = FitOptions { terms: Some(Vec::new()), noise: Some(vec![1.0; 9]), ..options };
    assert_eq!(parse(&mechanism, &readings(3), &[]), Ok(Vec::new()));
    let observations = Observations::new(&mechanism, table(3), None, options).expect("readings");
    let instances = observations.instances().expect("no terms");
    let found = fit(&observations, instances, None).expect("nothing to find");
    assert!(found.beta.is_empty());
    // Three equations of one posture, which three rows repeat, and no parameter.
    assert_eq!(found.dof + found.within, 3.0);
    let (report, _) = calibrated::report(&observations, None).expect("nothing to find");
    assert!(report.estimates.parameters.is_empty());
    traced::report(&observations, &SearchOptions::default(), None).expect("a trace of nothing");
}

#[test]
fn a_problem_without_residuals_or_parameters_ends_at_its_start() {
    for (m, n) in [(0, 2), (3, 0), (0, 0)] {
        let problem = Dense::new(m, n, |_, r: &mut [f64]| r.fill(1.0), |_, j| j.fill(1.0));
        let end = minimize(&problem, &vec![0.5; n], &SolverOptions::default());
        assert_eq!(end.x, vec![0.5; n]);
        assert!(end.termination.converged());
        assert_eq!(end.cost, 0.5 * m as f64);
    }
}

#[test]
fn a_trace_of_hardly_more_equations_than_parameters_tries_what_they_allow() {
    // Eight poses: 24 equations for 18 parameters, and a free curve has seven.
    let wave = |k: usize| (2048.0 + 700.0 * ((1 + k) as f64 * 1.7).sin()).round();
    let table = Table { values: (0..8 * 9).map(wave).collect(), ..Table::default() };
    let options = FitOptions { noise: Some(vec![1.0; 9]), ..FitOptions::default() };
    let observations = Observations::new(&Mechanism::rsi(), table, None, options).expect("counts");
    traced::report(&observations, &SearchOptions::default(), None).expect("a trace");
}

#[test]
fn a_time_that_is_no_number_is_refused() {
    let timed = Table { time: Some(vec![0.0, f64::NAN, 1.0]), ..table(3) };
    let found = Readings::new(&Mechanism::rsi(), timed);
    assert!(matches!(found, Err(Error::Reading { row: 1, .. })), "{found:?}");
}

#[test]
fn options_that_cannot_be_used_are_refused() {
    let mechanism = Mechanism::rsi();
    let default = FitOptions::default;
    let solver = |xtol| rsicalib::numerics::lm::SolverOptions { xtol, ..default().lm };
    for options in [
        FitOptions { closures: Some(Vec::new()), ..default() },
        FitOptions { noise: Some(vec![f64::NAN; 9]), ..default() },
        FitOptions { noise: Some(vec![1.0; 8]), ..default() },
        FitOptions { noise: Some(vec![1.0; 10]), ..default() },
        FitOptions { noise: Some(Vec::new()), ..default() },
        FitOptions { play: -1.0, ..default() },
        FitOptions { starts: 0, ..default() },
        FitOptions { lm: solver(0.0), ..default() },
    ] {
        let found = Observations::new(&mechanism, table(3), None, options);
        assert!(matches!(found, Err(Error::Option { .. })), "{found:?}");
    }
    let observations = Observations::new(&mechanism, table(3), None, default()).expect("counts");
    let options = FitOptions { noise: Some(vec![1.0]), ..default() };
    let found = fit(&Observations { options, ..observations.clone() }, Vec::new(), None);
    assert!(matches!(found, Err(Error::Option { .. })), "{found:?}");
    let found = fit(&Observations { weights: vec![1.0], ..observations.clone() }, Vec::new(), None);
    assert!(matches!(found, Err(Error::Shape { found: 1, expected: 3, .. })), "{found:?}");
    let search = SearchOptions { without: vec!["nonsense".into()], ..SearchOptions::default() };
    let found = traced::report(&observations, &search, None);
    assert!(matches!(found, Err(Error::Unknown { .. })), "{found:?}");
}
