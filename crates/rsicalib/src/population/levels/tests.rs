//! The state of levels, and the variances that are likeliest, beside matrices of all units.

use faer::Mat;

use crate::population::levels::{Held, Levels};

/// Numbers that repeat nothing, between -1 and 1.
fn number(k: usize) -> f64 {
    ((k * 7919 + 131) * 104_729 % 100_003) as f64 / 50_001.5 - 1.0
}

/// Lower triangle `L` of `a = L Lᵀ`, by plain products.
fn triangle(a: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut l = vec![vec![0.0; a.len()]; a.len()];
    for i in 0..a.len() {
        for j in 0..=i {
            let rest = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            l[i][j] = if i == j { rest.sqrt() } else { rest / l[j][j] };
        }
    }
    l
}

/// `L⁻¹ x`
fn before(l: &[Vec<f64>], x: &[f64]) -> Vec<f64> {
    let mut out: Vec<f64> = Vec::new();
    for (i, row) in l.iter().enumerate() {
        out.push((x[i] - out.iter().zip(row).map(|(o, l)| o * l).sum::<f64>()) / row[i]);
    }
    out
}

fn product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn ln_det(l: &[Vec<f64>]) -> f64 {
    (0..l.len()).map(|i| 2.0 * l[i][i].ln()).sum()
}

/// Units with two parameters: `H`, and the groups of each rank with those of the units first.
struct Units {
    information: Vec<[[f64; 2]; 2]>,
    told: Vec<[f64; 2]>,
    groups: Vec<Vec<usize>>,
    held: f64,
}

impl Units {
    fn new(levels: &[Vec<usize>], held: f64) -> Self {
        let units = levels[0].len();
        let h = |u: usize| {
            let (a, b, c) = (number(3 * u), number(3 * u + 1), number(3 * u + 2));
            [[1.0 + a * a + c * c, a * b + c], [a * b + c, 1.5 + b * b]]
        };
        let told = |u: usize| [3.0 * number(500 + 2 * u), 3.0 * number(501 + 2 * u)];
        let mut groups = vec![(0..units).collect()];
        groups.extend(levels.iter().cloned());
        Self {
            information: (0..units).map(h).collect(),
            told: (0..units).map(told).collect(),
            groups,
            held,
        }
    }

    fn levels(&self) -> Levels {
        let matrix = |h: &[[f64; 2]; 2]| Mat::from_fn(2, 2, |i, j| h[i][j]);
        let information: Vec<Mat<f64>> = self.information.iter().map(matrix).collect();
        let told: Vec<Vec<f64>> = self.told.iter().map(|h| h.to_vec()).collect();
        Levels::new(&information, &told, &[0, 1], &self.groups[1..], self.held).expect("alike")
    }

    /// Minus twice the logarithm of the restricted likelihood, but for a constant, by matrices of
    /// all units.
    fn cost(&self, ln: &[f64]) -> f64 {
        let size = 2 * self.told.len();
        let (mut v, mut y) = (vec![vec![0.0; size]; size], vec![0.0; size]);
        for (u, (h, told)) in self.information.iter().zip(&self.told).enumerate() {
            let det = h[0][0] * h[1][1] - h[0][1] * h[1][0];
            let inverse = [[h[1][1] / det, -h[0][1] / det], [-h[1][0] / det, h[0][0] / det]];
            for i in 0..2 {
                v[2 * u + i][2 * u..2 * u + 2].copy_from_slice(&inverse[i]);
                y[2 * u + i] = product(&inverse[i], told);
            }
        }
        for (rank, groups) in self.groups.iter().enumerate() {
            for (u, one) in groups.iter().enumerate() {
                for (w, _) in groups.iter().enumerate().filter(|(_, other)| *other == one) {
                    (0..2).for_each(|i| v[2 * u + i][2 * w + i] += ln[2 * rank + i].exp());
                }
            }
        }
        let l = triangle(&v);
        let y = before(&l, &y);
        let column = |i: usize| -> Vec<f64> {
            before(&l, &(0..size).map(|k| f64::from(u8::from(k % 2 == i))).collect::<Vec<_>>())
        };
        let x = [column(0), column(1)];
        let held = |i, j| if i == j { self.held } else { 0.0 };
        let m: Vec<Vec<f64>> =
            (0..2).map(|i| (0..2).map(|j| product(&x[i], &x[j]) + held(i, j)).collect()).collect();
        let lm = triangle(&m);
        let g = before(&lm, &[product(&x[0], &y), product(&x[1], &y)]);
        ln_det(&l) + ln_det(&lm) + product(&y, &y) - product(&g, &g)
    }
}

fn nested() -> Vec<Vec<usize>> {
    vec![vec![0, 0, 1, 1, 1, 2, 3, 3, 4, 4], vec![0, 0, 0, 0, 0, 1, 1, 1, 2, 2]]
}

fn crossed() -> Vec<Vec<usize>> {
    vec![vec![0, 0, 0, 1, 1, 1, 2, 2, 2, 2], vec![0, 1, 2, 0, 1, 2, 0, 1, 2, 2]]
}

#[test]
fn the_score_is_the_slope_of_the_likelihood_of_all_units() {
    for (levels, held) in [(nested(), 0.0), (nested(), 1.0), (crossed(), 0.0), (crossed(), 1.0)] {
        let units = Units::new(&levels, held);
        let of = units.levels();
        let ln: Vec<f64> = (0..6).map(|k| 0.8 * number(40 + k)).collect();
        let at = of.tree.at(&ln);
        for one in 0..6 {
            let beside = |by: f64| {
                let mut other = ln.clone();
                other[one] += by;
                units.cost(&other)
            };
            // Central differences of 1e-4 are exact to a few 1e-8.
            let slope = (beside(1e-4) - beside(-1e-4)) / 2e-4;
            let score = at.q[one] - at.k[one];
            assert!((score + slope).abs() < 1e-6, "{one}: {score} and not {}", -slope);
        }
    }
}

#[test]
fn what_is_gained_is_the_change_of_the_likelihood_of_all_units() {
    for (levels, held) in [(nested(), 0.0), (nested(), 1.0), (crossed(), 0.0), (crossed(), 1.0)] {
        let units = Units::new(&levels, held);
        let tree = units.levels().tree;
        let ln = |from: usize| (0..6).map(|k| 2.0 * number(from + k)).collect::<Vec<_>>();
        let (one, other) = (ln(40), ln(60));
        let gained = tree.gained(&tree.at(&one), &tree.at(&other));
        let witness = units.cost(&other) - units.cost(&one);
        assert!((gained - witness).abs() < 1e-9, "{gained} and not {witness}");
    }
}

#[test]
fn nothing_beside_the_found_variances_is_likelier() {
    for levels in [nested(), crossed()] {
        let units = Units::new(&levels, 0.0);
        let of = units.levels();
        let best = units.cost(&of.best);
        for one in 0..6 {
            for by in [-0.3, -0.03, 0.03, 0.3] {
                let mut other = of.best.clone();
                other[one] += by;
                let least = of.tree.least[one].expect("told");
                assert!(other[one] < least || units.cost(&other) > best - 1e-9, "{one} by {by}");
            }
        }
    }
}

#[test]
fn the_likeliest_variances_are_found_from_wherever_one_begins() {
    for (levels, held) in [(nested(), 1.0), (crossed(), 1.0)] {
        let mut units = Units::new(&levels, held);
        // Parameters that are told a thousand times better together than apart.
        for h in &mut units.information {
            let (a, b) = (h[0][0], h[1][1]);
            *h = [[a * 1e6, 999.0 * a * 1e3], [999.0 * a * 1e3, a * 1e6 + b]];
        }
        units.told.iter_mut().for_each(|h| *h = [h[0] * 1e6, h[1] * 1e6]);
        let of = units.levels();
        for from in [-12.0, -3.0, 0.0, 5.0] {
            let start: Vec<f64> = (0..6).map(|k| from + number(k)).collect();
            let found = of.tree.fit(start, None).0;
            let apart = units.cost(&found) - units.cost(&of.best);
            assert!(apart.abs() < 1e-6, "from {from}: {apart}, {found:?}, {:?}", of.best);
        }
    }
}

/// Units with an error `s` each.
fn alike(x: &[f64], s: f64, levels: &[Vec<usize>]) -> Levels {
    let precision = s.powi(-2);
    let information = vec![Mat::from_fn(1, 1, |_, _| precision); x.len()];
    let told: Vec<Vec<f64>> = x.iter().map(|x| vec![precision * x]).collect();
    Levels::new(&information, &told, &[0], levels, 0.0).expect("alike")
}

fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}

fn squares(x: &[f64]) -> f64 {
    x.iter().map(|one| (one - mean(x)).powi(2)).sum()
}

/// Sessions, by four, of devices, by three, of batches.
fn balanced(batch: f64, device: f64, session: f64) -> Vec<f64> {
    let at = |u: usize| {
        batch * number(700 + u / 12) + device * number(800 + u / 4) + session * number(900 + u)
    };
    (0..60).map(at).collect()
}

fn groups(by: usize) -> Vec<usize> {
    (0..60).map(|u| u / by).collect()
}

#[test]
fn of_balanced_levels_variances_are_those_of_mean_squares() {
    let x = balanced(9.0, 4.0, 2.0);
    let means = |by: usize| -> Vec<f64> { x.chunks(by).map(mean).collect() };
    // Mean squares of sessions in devices, devices in batches, batches.
    let session = x.chunks(4).map(squares).sum::<f64>() / 45.0;
    let device = 4.0 * means(4).chunks(3).map(squares).sum::<f64>() / 10.0;
    let batch = 12.0 * squares(&means(12)) / 4.0;
    let of = alike(&x, 0.5, &[groups(4), groups(12)]);
    let witness = [session - 0.25, (device - session) / 4.0, (batch - device) / 12.0];
    assert!(witness.iter().all(|variance| *variance > 0.0), "{witness:?}");
    for (ln, witness) in of.best.iter().zip(witness) {
        // Steps end where `ln τ²` moves by less than 1e-6.
        assert!((ln - witness.ln()).abs() < 1e-5, "{} and not {witness}", ln.exp());
    }
    assert!((of.mean().0[0] - mean(&x)).abs() < 1e-9);
}

#[test]
fn a_level_that_shows_nothing_leaves_its_squares_to_the_others() {
    // Devices have means alike: between them there is less than sessions make.
    let mut x = balanced(0.0, 0.0, 2.0);
    for device in x.chunks_mut(4) {
        let own = mean(device);
        device.iter_mut().for_each(|x| *x -= own);
    }
    let of = alike(&x, 0.5, &[groups(4)]);
    let spreads = of.spreads();
    let session = squares(&x) / 59.0 - 0.25;
    assert_eq!(spreads[1][0].sd, Some(0.0));
    // The least that a variance is taken for, 1e-3 of an error, is beside it.
    let found = spreads[0][0].sd.expect("told").powi(2);
    assert!((found / session - 1.0).abs() < 1e-3, "{found} and not {session}");
}

/// Two parameters, of which units tell the second with this precision.
fn of_two(second: f64) -> Levels {
    let information: Vec<Mat<f64>> = (0..8)
        .map(|u| Mat::from_fn(2, 2, |i, j| if i != j { 0.0 } else { [1.0 + u as f64, second][i] }))
        .collect();
    let told: Vec<Vec<f64>> =
        (0..8_i32).map(|u| vec![f64::from(u * u % 7), second * f64::from(u % 3)]).collect();
    let levels = [vec![0, 0, 1, 1, 2, 2, 3, 3], vec![0, 0, 0, 0, 1, 1, 1, 1]];
    Levels::new(&information, &told, &[0, 1], &levels, 0.0).expect("alike")
}

#[test]
fn a_parameter_that_no_unit_tells_has_no_spread() {
    // The precision of a standard deviation of 1e170 is no number above zero.
    for second in [0.0, 1e170_f64.powi(-2), 1e-200] {
        for (level, own) in of_two(second).spreads().iter().enumerate() {
            assert!(own[0].sd.is_some(), "level {level}");
            assert_eq!((own[1].sd, own[1].interval), (None, None), "level {level}");
        }
    }
    assert!(of_two(1e-100).spreads().iter().all(|own| own[1].sd.is_some()));
}

#[test]
fn what_is_left_out_tells_nothing() {
    let all = of_two(1.0);
    let rest = all.without(&[true, false]);
    // It is still compared with the others.
    let told = |levels: &Levels| levels.devices(&rest).iter().map(|d| d.0[(0, 0)]).collect();
    let (own, compared): (Vec<f64>, Vec<f64>) = (told(&rest), told(&all));
    assert!(own[0] == 0.0 && own[1] > 0.0 && compared[0] > 0.0 && compared[1] == own[1]);
    assert_eq!((all.level(), all.largest()), (Some(1), vec![0, 0, 0, 0, 1, 1, 1, 1]));
    // Of one group nothing is between: what the other half tells is all there is.
    assert!(rest.total()[0] != all.total()[0]);
}

#[test]
fn what_is_told_well_does_not_drown_what_is_not_told() {
    let (x, t) = (0.7, [1.0_f64, 0.3]);
    for precision in [1e3, 1e6, 1e9, 1e12] {
        let h = Mat::from_fn(2, 2, |_, _| precision);
        let held = Held::of(&t, &h, vec![precision * x; 2]);
        // By Sherman and Morrison, with T = diag(t²) and H = precision 11ᵀ.
        let sum = precision / (1.0 + precision * (t[0].powi(2) + t[1].powi(2)));
        let near = |found: f64, witness: f64| {
            // `1 + R S R` is rounded by so much beside what nobody tells.
            let by = 1e-12 + 1e-15 * precision;
            assert!((found - witness).abs() < by, "{precision}: {found} and not {witness}");
        };
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let one = f64::from(u8::from(i == j));
            near(held.lambda[(i, j)], sum);
            near(held.v[(i, j)], one * t[i].powi(2) - sum * t[i].powi(2) * t[j].powi(2));
            near(held.lent[(i, j)], one - sum * t[i].powi(2));
            near(held.b[i], sum * x);
        }
    }
}

#[test]
fn information_that_is_negative_by_rounding_is_none() {
    // Of the difference of two parameters -10, where their sum is told to 2e9.
    let h = Mat::from_fn(2, 2, |i, j| if i == j { 1e9 - 5.0 } else { 1e9 + 5.0 });
    let held = Held::of(&[1.0, 1.0], &h, vec![7e8; 2]);
    let along = |of: &Mat<f64>, sign: f64| of[(0, 0)] + sign * of[(0, 1)];
    assert!((along(&held.lambda, 1.0) - 1.0).abs() < 1e-6, "{:?}", held.lambda);
    assert!(along(&held.v, 1.0).abs() < 1e-6, "{:?}", held.v);
    assert!(along(&held.lambda, -1.0).abs() < 1e-6, "{:?}", held.lambda);
    assert!((along(&held.v, -1.0) - 1.0).abs() < 1e-6, "{:?}", held.v);
}

#[test]
fn levels_that_cannot_be_are_refused() {
    let one = vec![Mat::from_fn(1, 1, |_, _| 1.0); 4000];
    let told = vec![vec![1.0]; 4000];
    let pairs: Vec<usize> = (0..4000).map(|u| u / 2).collect();
    let across: Vec<usize> = (0..4000_usize).map(|u| u.div_ceil(2)).collect();
    assert!(Levels::new(&one, &told, &[0], &[pairs, across], 0.0).is_err());
    assert!(Levels::new(&one, &told, &[0], &[vec![0; 3]], 0.0).is_err());
}
