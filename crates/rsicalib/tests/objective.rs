//! The maximum-likelihood objective against a minimisation of its own.

use crate::devices::{Device, How, Rng, derivative, hand_controller, random};
use nalgebra::{DMatrix, DVector};
use rsicalib::estimate::{Implicit, Noise, Part};
use rsicalib::model::{Model, Prior, Want, Workspace};
use rsicalib::numerics::lanes::Lanes;
use rsicalib::numerics::linearization::Problem;
use rsicalib::readings::{Readings, Table};

/// Cross-talk mixes the noise of channels; a curve changes `A` with the reading.
const IDS: [&str; 6] = ["crosstalk", "offset", "gain", "curvature", "link_length", "sag"];

/// A device whose readings carry noise, seen by a model that is off by a bit.
struct Case {
    model: Model,
    readings: Readings,
    beta: Vec<f64>,
    noise: Noise,
    /// Variance of each equation by play.
    play: DVector<f64>,
}

impl Case {
    fn new(mut device: Device, play: f64, seed: u64) -> Self {
        let readings = device.readings();
        let (instances, mut values) = device.terms(&readings, &IDS, seed);
        values.iter_mut().for_each(|v| *v *= 0.3);
        assert!(device.closes(&instances, &values), "every pose assembles");
        let mut rng = Rng::new(seed);
        // Noise of 1.5 mrad, another on each channel; parameters off by 3 %.
        let channels = &device.mechanism.channels;
        let sigma: Vec<f64> =
            channels.iter().map(|c| rng.uniform(1e-3, 2e-3) / c.gain.abs()).collect();
        let noisy = device.table.values.iter_mut().zip(sigma.iter().cycle());
        noisy.for_each(|(v, sigma)| *v += sigma * rng.normal());
        values.iter_mut().for_each(|v| *v *= 1.0 + 0.03 * rng.normal());
        let readings = device.readings();
        let (model, beta) = device.model(&readings, &instances, &values);
        let variance = DVector::from_vec(model.play()) * play;
        Self {
            model,
            readings,
            beta,
            noise: Noise { play, ..Noise::declared(sigma) },
            play: variance,
        }
    }

    fn part(&self) -> Part<'_> {
        Part { model: &self.model, readings: &self.readings, weights: None }
    }

    fn implicit<'a>(&'a self, priors: &'a [Prior]) -> Implicit<'a> {
        Implicit::new(vec![(self.part(), self.noise.clone())], priors)
    }

    /// `f` and `A` of one sample at readings `a`.
    fn sample(&self, block: usize, a: &DVector<f64>) -> (DVector<f64>, DMatrix<f64>) {
        let a: Vec<Lanes> = a.iter().map(|a| Lanes::splat(*a)).collect();
        let mut ws = Workspace::default();
        let want = Want { x: false, a: true };
        self.model.evaluate(&self.readings, block, &a, &self.beta, want, &mut ws);
        let (k, c) = (self.model.equations(), a.len());
        // All lanes read the same; those of a block differ in time, which no term here sees,
        // and in measured distances, for which the caller picks blocks of one sample.
        (
            DVector::from_fn(k, |i, _| ws.f[i].0[0]),
            DMatrix::from_fn(k, c, |i, j| ws.a[i * c + j].0[0]),
        )
    }

    /// `min ½ eᵀΣ⁻¹e + ½ vᵀΠ⁻¹v` subject to `f(a - e) = v`, for one sample.
    ///
    /// Newton's method on the conditions of Lagrange, `v = Πλ`:
    ///
    /// ```text
    /// Σ⁻¹ e - Aᵀ λ = 0         f(a - e) - Π λ = 0
    /// ```
    ///
    /// in units of the noise, with second derivatives by differences: they only
    /// steer, where it ends depends on `f` and `A` alone.
    fn lagrange(&self, block: usize, raw: &DVector<f64>) -> f64 {
        let (k, c) = (self.model.equations(), raw.len());
        let sigma = DVector::from_column_slice(&self.noise.sigma);
        let play = &self.play;
        let at = |e: &DVector<f64>| {
            let (f, a) = self.sample(block, &(raw - e.component_mul(&sigma)));
            (f, a * DMatrix::from_diagonal(&sigma))
        };
        let (mut e, mut lambda) = (DVector::zeros(c), DVector::zeros(k));
        for _ in 0..50 {
            let (f, a) = at(&e);
            let first = &e - a.transpose() * &lambda;
            let second = f - play.component_mul(&lambda);
            let mut system = DMatrix::zeros(c + k, c + k);
            for j in 0..c {
                let mut unit = DVector::zeros(c);
                unit[j] = 1e-2;
                let slope = (at(&(&e + &unit)).1 - at(&(&e - &unit)).1) / 2e-2;
                let mut column = -slope.transpose() * &lambda;
                column[j] += 1.0;
                system.view_mut((0, j), (c, 1)).copy_from(&column);
            }
            system.view_mut((0, c), (c, k)).copy_from(&-a.transpose());
            system.view_mut((c, 0), (k, c)).copy_from(&-&a);
            for i in 0..k {
                system[(c + i, c + i)] = -play[i];
            }
            let rhs = -DVector::from_iterator(c + k, first.iter().chain(second.iter()).copied());
            let step = system.lu().solve(&rhs).expect("independent closures");
            e += step.rows(0, c);
            lambda += step.rows(c, k);
            if step.rows(0, c).amax() < 1e-12 {
                return 0.5 * (e.norm_squared() + lambda.component_mul(&lambda).dot(play));
            }
        }
        panic!("Newton's method did not converge");
    }
}

/// The hand controller; random mechanisms without and with play.
fn cases() -> Vec<Case> {
    vec![
        Case::new(hand_controller(How::Held, 1), 0.0, 1),
        Case::new(random(3, How::Held, 12), 0.0, 2),
        Case::new(random(3, How::Held, 13), 1.0, 3),
        Case::new(random(2, How::Moving, 22), 25.0, 4),
    ]
}

#[test]
fn its_cost_is_the_least_noise_that_closes_the_loops() {
    for case in cases() {
        let name = &case.model.mechanism.name;
        // Each row in readings of its own: one sample, one block.
        let mut plain = 0.0;
        for row in 0..case.readings.samples {
            // (67): the samples of a pose share one seating, and each has its part of what is known of it.
            let mut single = case.single(row);
            let own = |r: &&usize| **r == case.readings.pose[row];
            single.play *= case.readings.pose.iter().filter(own).count() as f64;
            let raw = DVector::from_column_slice(single.readings.row(0));
            plain += single.lagrange(0, &raw);
        }
        let implicit = case.implicit(&[]);
        let cost = implicit.linearize(&case.beta).cost;
        // Readings stand still to 1e-9 of their noise, where the cost is flat.
        assert!((cost - plain).abs() < 1e-9 * plain, "{name}: {cost} should be {plain}");
        let freedoms = (case.readings.samples * case.model.equations()) as f64;
        assert!(cost > 0.1 * freedoms, "{name}: the noise should be felt, {cost}");

        let residuals = case.implicit(&[]).residuals(&case.beta, false);
        let whitened: f64 = residuals.whitened.iter().map(|w| 0.5 * w * w).sum();
        assert!((whitened - plain).abs() < 1e-9 * plain, "{name}: {whitened}");
        assert!(residuals.inner < 20, "{name}: (52) did not settle");
    }
}

impl Case {
    /// One row as a case of its own, under the same parameters and scales.
    fn single(&self, row: usize) -> Self {
        let table = &self.readings.table;
        let one = Table {
            values: self.readings.row(row).to_vec(),
            keys: table.keys.iter().map(|k| vec![k[row].clone()]).collect(),
            columns: table.columns.iter().map(|c| vec![c[row]]).collect(),
            ..Table::default()
        };
        let readings = Readings::new(&self.model.mechanism, one).expect("a row that was accepted");
        let mut model = Model::new(&self.model.mechanism, &readings, self.model.instances.clone())
            .expect("terms that need nothing");
        model.scales.clone_from(&self.model.scales);
        let terms = self.model.term_parameters;
        let mut beta = self.beta[..terms].to_vec();
        if let Some(own) = model.unknowns.first() {
            let same = self.model.unknowns.iter().find(|known| known.name == own.name);
            let at = terms + same.expect("the same point").first;
            beta.extend(&self.beta[at..at + 3]);
        }
        // Play goes with the mean of a measured distance, over all rows.
        Self { model, readings, beta, noise: self.noise.clone(), play: self.play.clone() }
    }
}

#[test]
fn its_gradient_matches_differences_of_its_cost() {
    for case in cases() {
        let here = case.implicit(&[]).linearize(&case.beta);
        let norms = here.column_norms();
        for (column, norm) in norms.iter().enumerate() {
            // A hundredth of the parameter's own uncertainty.
            let h = 0.01 / norm;
            let cost = |by: f64| {
                let mut beta = case.beta.clone();
                beta[column] += by;
                vec![case.implicit(&[]).linearize(&beta).cost]
            };
            let difference = derivative(cost, h)[0];
            let scale = norm * (2.0 * here.cost).sqrt();
            assert!(
                (here.gradient[column] - difference).abs() < 1e-6 * scale.max(1e-300),
                "{}, column {column}: {} should be {difference}",
                case.model.mechanism.name,
                here.gradient[column]
            );
        }
    }
}

#[test]
fn a_quiet_encoder_stands_still_too() {
    // Noise of 1e-8 rad: a billionth of that is below the rounding of a reading.
    let mut case = cases().swap_remove(1);
    let (instances, beta) = (case.model.instances.clone(), case.beta.clone());
    let mut device = Device {
        mechanism: case.model.mechanism.clone(),
        table: case.readings.table.clone(),
        points: beta[case.model.term_parameters..].to_vec(),
    };
    assert!(device.closes(&instances, &beta[..case.model.term_parameters]), "every pose assembles");
    case.readings = device.readings();
    let gains = device.mechanism.channels.iter().map(|c| c.gain.abs());
    case.noise.sigma = gains.map(|gain| 1e-8 / gain).collect();
    (case.model, case.beta) =
        device.model(&case.readings, &instances, &beta[..case.model.term_parameters]);
    let residuals = case.implicit(&[]).residuals(&case.beta, false);
    assert!(residuals.inner < 5, "repeated {} times", residuals.inner);
}

#[test]
fn where_it_started_does_not_matter() {
    for case in cases() {
        let fresh = case.implicit(&[]).linearize(&case.beta);
        let used = case.implicit(&[]);
        let elsewhere: Vec<f64> = case.beta.iter().map(|b| 1.1 * b).collect();
        used.linearize(&elsewhere);
        let used = used.linearize(&case.beta);
        assert!((used.cost - fresh.cost).abs() < 1e-9 * fresh.cost);
    }
}

#[test]
fn a_prior_is_one_more_observation() {
    let case = &cases()[1];
    let prior = Prior::Parameter { column: 2, mean: case.beta[2] + 0.03, sd: 0.02 };
    let (without, with) =
        (case.implicit(&[]).linearize(&case.beta), case.implicit(&[prior]).linearize(&case.beta));
    assert!((with.cost - without.cost - 0.5 * 1.5 * 1.5).abs() < 1e-9 * with.cost);
    assert!((with.gradient[2] - without.gradient[2] + 1.5 / 0.02).abs() < 1e-9 * with.cost);
    let change = with.gram()[(2, 2)] - without.gram()[(2, 2)];
    assert!((change * 0.02 * 0.02 - 1.0).abs() < 1e-6);
}

#[test]
fn weights_divide_the_variance_and_zero_leaves_out() {
    let case = &cases()[1]; // without play: that is of a seating, not of a sample
    let cost = |weights: &[f64]| {
        let part = Part { weights: Some(weights), ..case.part() };
        Implicit::new(vec![(part, case.noise.clone())], &[]).linearize(&case.beta).cost
    };
    let n = case.readings.samples;
    let all = cost(&vec![1.0; n]);
    assert!((cost(&vec![0.5; n]) - 0.25 * all).abs() < 1e-12 * all);
    let even: Vec<f64> = (0..n).map(|row| if row % 2 == 0 { 1.0 } else { 0.0 }).collect();
    let odd: Vec<f64> = even.iter().map(|w| 1.0 - w).collect();
    assert!((cost(&even) + cost(&odd) - all).abs() < 1e-12 * all);
}
