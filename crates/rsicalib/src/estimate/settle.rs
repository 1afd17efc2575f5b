//! Estimated readings without noise: eq. (52), block by block.

use crate::estimate::eliminated::Eliminated;
use crate::estimate::objective::{Noise, Part, Play};
use crate::estimate::significance::{NORMAL_95, ONE_IN_TWENTY};
use crate::estimate::spread::{seats, spread};
use crate::kinematics::elements::Way;
use crate::model::{Model, Want, Workspace};
use crate::numerics::distributions::chi2_quantile;
use crate::numerics::lanes::{Lanes, WIDTH, dispatch, solve_lower, solve_transposed};
use crate::terms::term::Scale;

/// Largest number of repeats of (52).
const INNER: usize = 20;

/// Up to this number of parameters, `X` is computed in every repeat.
const CHEAP: usize = 40;

/// Change of `â`, in standard deviations of a reading, below which (52) has converged. `w` has an
/// error of second order in it. `X` has one of first order, of that part of the thousandth or so by
/// which noise turns a column: [`VISIBLE`](crate::numerics::symmetric::VISIBLE) is far above.
const STILL: f64 = 1e-6;

/// [`STILL`] while a search looks for a minimum: a repeat that moves readings by less than this leaves
/// the thousandth or so of it by which noise turns a column, and `½ wᵀ S⁻¹ w` has an error of
/// second order in that. Every linearisation repeats (52) once more.
const COARSE: f64 = 0.1;

/// Readings `â` of one block at parameters `x`, moved onto the closures by (52): one [`Lanes`] per
/// channel.
pub(crate) fn settled(part: &Part, noise: &Noise, block: usize, x: &[f64]) -> Vec<Lanes> {
    let mut a_hat = part.start(block);
    Room::new(part.model, noise).settle(part, block, x, &mut a_hat, false);
    a_hat
}

/// Readings of a block that are moved onto the closures as if play were as little as it is beside what
/// readings span, (168).
pub(crate) struct Closing {
    room: Room,
    closed: Vec<Lanes>,
}

impl Closing {
    /// The noise with which they are moved: that of readings that are anywhere in their session; none where no
    /// play moves joints.
    pub(crate) fn noise(part: &Part, noise: &Noise) -> Option<Noise> {
        let sigma = || spread(part.readings).into_iter().map(f64::sqrt).collect();
        seats(part.model, noise).then(|| Noise { sigma: sigma(), ..noise.clone() })
    }

    /// By [`Closing::noise`].
    pub(crate) fn new(model: &Model, noise: &Noise) -> Self {
        Self { room: Room::new(model, noise), closed: Vec::new() }
    }

    /// Settled readings of a block, moved.
    pub(crate) fn close(
        &mut self,
        part: &Part,
        block: usize,
        x: &[f64],
        settled: &[Lanes],
    ) -> &mut [Lanes] {
        let Self { room, closed } = self;
        closed.clear();
        closed.extend_from_slice(settled);
        part.model.absent(part.readings, block, &mut room.absent);
        for _ in 0..INNER {
            let want = Want { x: false, a: true };
            part.model.evaluate(part.readings, block, closed, x, want, &mut room.ws);
            if !room.step(&settled[..part.readings.channels], closed) {
                break;
            }
        }
        closed
    }
}

/// Standard deviations that what is unknown in one pose may be off before it is looked for again.
const ASTRAY: f64 = 1e4;

/// Buffers for the readings of one block.
pub(crate) struct Room {
    pub(crate) ws: Workspace,
    /// Whitened misclosure, `L⁻¹ w`, of which what is unknown in one pose alone is eliminated: `g` of
    /// (59).
    pub(crate) w: Vec<Lanes>,
    /// The same equation by equation, `N g`: what each closure leaves.
    pub(crate) of_closures: Vec<Lanes>,
    eliminated: Eliminated,
    /// Cholesky factor of `S`, row by row, full square.
    l: Vec<Lanes>,
    /// What was eliminated of the whitened misclosure: the next step of the unknowns of the pose.
    taken: Vec<Lanes>,
    lambda: Vec<Lanes>,
    variance: Vec<f64>,
    /// Variance of each equation by play, one draw for each seating.
    play: Vec<f64>,
    /// Number of samples, by their weights, that share the seating of each sample.
    seated: Lanes,
    /// Variance of each equation that every sample draws for itself: of a length that is measured, and
    /// (55).
    own: Vec<f64>,
    /// For each equation, one where its closure does not hold, zero elsewhere; empty where all hold.
    absent: Vec<Lanes>,
    /// Factor from the misclosure of each equation to a length.
    lengths: Vec<f64>,
    /// `L⁻¹ ∂f/∂x` by the length `x` that each equation errs by; equation by equation.
    pub(crate) by_closure: Vec<Lanes>,
    still: Vec<f64>,
    /// Change of what is unknown in one pose, in its standard deviations, below which it has converged.
    settled: f64,
    /// [`beyond`] of each channel, and the largest part of its variance that this is.
    beyond: Vec<f64>,
    beyond_most: f64,
}

/// A change in the unit of a channel, but not below the rounding of a reading: otherwise the
/// readings of an encoder with little noise would never converge.
fn still(change: f64, scale: &Scale) -> f64 {
    let largest = scale.span.iter().fold(1.0 / scale.gain.abs(), |m, a| m.max(a.abs()));
    change.max(64.0 * f64::EPSILON * largest)
}

/// Part of the variance of an equation that rounding may leave when those before take their share.
const ROUNDED: f64 = 1e-15;

/// Squares of the noise of an angle that are beyond first order: two noises by which effects that
/// nobody knows may bend it, squared, and the square of the noise itself.
const BEYOND: f64 = 5.0;

/// Variance of the reading of each channel by which an equation errs beyond first order (57): zero
/// for joints that slide. All angles have the least noise of any, for what a channel says may have
/// been given up.
fn beyond(model: &Model, noise: &Noise) -> Vec<f64> {
    let turning =
        || model.joints().filter(|(way, _)| *way == Way::Turn).map(|(_, channel)| channel);
    let angle = |c: usize| noise.sigma[c] * model.scales[c].gain.abs();
    let least = turning().map(angle).fold(f64::INFINITY, f64::min);
    let part = (BEYOND * turning().count() as f64 * least * least).min(1.0);
    let mut beyond = vec![0.0; noise.sigma.len()];
    for c in turning() {
        beyond[c] = part * (least / model.scales[c].gain).powi(2);
    }
    beyond
}

impl Room {
    pub(crate) fn new(model: &Model, noise: &Noise) -> Self {
        let k = model.rows();
        let limit = |(sigma, scale): (&f64, &Scale)| still(STILL * sigma, scale);
        let beyond = beyond(model, noise);
        let Play { of_seating: play, of_sample: own } = noise.of_closures(model);
        let parts = beyond.iter().zip(&noise.sigma).map(|(beyond, sigma)| beyond / (sigma * sigma));
        let beyond_most = parts.fold(0.0, f64::max) + 2.0 * ROUNDED;
        Self {
            ws: Workspace::default(),
            w: vec![Lanes::ZERO; k],
            of_closures: Vec::new(),
            eliminated: Eliminated::new(model.pose_unknowns()),
            settled: STILL,
            l: vec![Lanes::ZERO; k * k],
            taken: Vec::new(),
            lambda: vec![Lanes::ZERO; k],
            variance: noise.sigma.iter().map(|s| s * s).collect(),
            lengths: model.lengths(),
            by_closure: Vec::new(),
            play,
            seated: Lanes::ONE,
            own,
            absent: Vec::new(),
            still: noise.sigma.iter().zip(&model.scales).map(limit).collect(),
            beyond,
            beyond_most,
        }
    }

    /// Room in which (52) converges to [`COARSE`] of the least noise: what a channel says may have
    /// been given up, and its noise is then no small change.
    pub(crate) fn coarse(model: &Model, noise: &Noise) -> Self {
        let angle = |(sigma, scale): (&f64, &Scale)| sigma * scale.gain.abs();
        let angles = noise.sigma.iter().zip(&model.scales).map(angle);
        let least = COARSE * angles.fold(f64::INFINITY, f64::min);
        let limit = |scale: &Scale| still(least / scale.gain.abs(), scale);
        let limits = model.scales.iter().map(limit).collect();
        Self { still: limits, settled: COARSE, ..Self::new(model, noise) }
    }

    /// Gives each equation a variance of its own in every sample, (55).
    pub(crate) fn ease(&mut self, slack: &[f64]) {
        self.own.iter_mut().zip(slack).for_each(|(own, slack)| *own += *slack);
    }

    /// True where a closure has play.
    pub(crate) fn plays(&self) -> bool {
        self.play.iter().chain(&self.own).any(|play| *play > 0.0)
    }

    /// Says how many samples share the seating of each sample of the next block, (67).
    #[inline(always)]
    pub(crate) fn seat(&mut self, samples: Lanes) {
        self.seated = samples;
    }

    /// Variance of each equation: the diagonal of `S = L Lᵀ`, of `L N Nᵀ Lᵀ` where what is unknown in
    /// a pose takes a part of it up.
    pub(crate) fn variances(&self) -> Vec<Lanes> {
        let k = self.play.len();
        // The columns of `Lᵀ` are the rows of `L`, which is zero above its diagonal.
        let mut rows = vec![Lanes::ZERO; k * k];
        for i in 0..k {
            (0..=i).for_each(|j| rows[j * k + i] = self.l[i * k + j]);
        }
        self.eliminated.turn(&mut rows, k);
        let left = rows.chunks_exact(k.max(1)).skip(k - self.w.len());
        let mut variances = vec![Lanes::ZERO; k];
        for row in left {
            variances.iter_mut().zip(row).for_each(|(sum, l)| *sum += *l * *l);
        }
        variances
    }

    /// Repeats (52) until the readings converge, then whitens `w` and, on request, `X`. Returns the
    /// number of repeats.
    pub(crate) fn settle(
        &mut self,
        part: &Part,
        block: usize,
        x: &[f64],
        a_hat: &mut [Lanes],
        want_x: bool,
    ) -> usize {
        let (model, readings) = (part.model, part.readings);
        model.absent(readings, block, &mut self.absent);
        let raw = readings.raw(block);
        if a_hat.iter().any(|a| a.0.iter().any(|a| !a.is_finite())) {
            let place = model.pose_unknowns() > 0;
            let start = if place { self.place(part, block, x) } else { raw.to_vec() };
            a_hat.copy_from_slice(&start);
        }
        let mut repeats = 0;
        loop {
            repeats += 1;
            // `X` of many parameters is computed once, after `â` has converged.
            let want = Want { x: want_x && model.width() <= CHEAP, a: true };
            model.evaluate(readings, block, a_hat, x, want, &mut self.ws);
            let moved = self.step(raw, a_hat);
            if repeats == 1 && self.astray() {
                let start = self.place(part, block, x);
                a_hat.copy_from_slice(&start);
                continue;
            }
            if !moved || repeats == INNER {
                break;
            }
        }
        if want_x {
            if model.width() > CHEAP {
                let want = Want { x: true, a: true };
                model.evaluate(readings, block, a_hat, x, want, &mut self.ws);
            }
            self.whiten_parameters(model.width());
        }
        repeats
    }

    /// Takes the other place of what is unknown in a pose, (169), or one where a body is looked for by these parameters, or
    /// turned, where the squares of the whitened misclosure are less there by more than chance; true where it has taken one.
    pub(crate) fn cross(
        &mut self,
        part: &Part,
        block: usize,
        x: &[f64],
        a_hat: &mut [Lanes],
    ) -> bool {
        let squares = |room: &mut Self, at: &mut [Lanes]| {
            room.settle(part, block, x, at, false);
            room.weigh(part.weight(block));
            room.w.iter().fold(Lanes::ZERO, |sum, w| w.mul_add(*w, sum))
        };
        let here = squares(self, a_hat);
        // No place leaves less than nothing.
        let by_chance = NORMAL_95 * NORMAL_95;
        if here.0.iter().all(|left| *left <= by_chance) {
            return false;
        }
        let xi = &a_hat[part.readings.channels..];
        let across = part.model.placed_across(part.readings, block, xi, x, &mut self.ws);
        let turns = !part.model.posed.bodies.is_empty();
        let anew = turns.then(|| self.place(part, block, x));
        let most = chi2_quantile(ONE_IN_TWENTY, self.w.len() as f64);
        // Where most are open it is by the parameters, not by where things are looked for.
        let open = here.0.iter().filter(|left| **left > most).count();
        let turned = match (1..=WIDTH / 2).contains(&open) {
            true => part.model.placed_turned(part.readings, block, xi, x, &mut self.ws),
            false => Vec::new(),
        };
        let (mut left, mut crossed) = (here, false);
        for mut other in across.into_iter().chain(anew).chain(turned) {
            let there = squares(self, &mut other);
            let less = |lane: &usize| there.0[*lane] + by_chance < left.0[*lane];
            let taken: Vec<usize> = (0..WIDTH).filter(less).collect();
            crossed |= !taken.is_empty();
            for lane in taken {
                a_hat.iter_mut().zip(&other).for_each(|(own, other)| own.0[lane] = other.0[lane]);
                left.0[lane] = there.0[lane];
            }
        }
        crossed
    }

    /// The readings as they are, and what is unknown in their poses where it is looked for.
    fn place(&mut self, part: &Part, block: usize, x: &[f64]) -> Vec<Lanes> {
        part.model.placed(part.readings, block, part.readings.raw(block), x, &mut self.ws)
    }

    /// True where what is unknown in a pose is so far from where it was that the search begins again.
    fn astray(&self) -> bool {
        let far = |w: &Lanes| w.0.iter().any(|w| w.is_nan() || w.abs() > ASTRAY);
        !self.eliminated.is_none() && self.taken.iter().any(far)
    }

    /// So many repeats of (52), then `L⁻¹ w` and `L⁻¹ X`: none of settled readings. After one from the
    /// raw readings what is left out is of third order in the noise.
    pub(crate) fn linearise(
        &mut self,
        part: &Part,
        block: usize,
        raw: &[Lanes],
        x: &[f64],
        a_hat: &mut [Lanes],
        repeats: usize,
    ) {
        part.model.absent(part.readings, block, &mut self.absent);
        for repeat in 0..=repeats {
            let want = Want { x: repeat == repeats, a: true };
            part.model.evaluate(part.readings, block, a_hat, x, want, &mut self.ws);
            self.step(raw, a_hat);
        }
        self.whiten_parameters(part.model.width());
    }

    /// Multiplies `L⁻¹ w` and `L⁻¹ X` by the weights of the samples.
    #[inline(always)]
    pub(crate) fn weigh(&mut self, weight: Lanes) {
        for value in self.ws.x.iter_mut().chain(&mut self.w) {
            *value = *value * weight;
        }
    }

    /// One repeat of (52), and of (59); true where the readings have changed, or what is unknown in
    /// their poses.
    fn step(&mut self, raw: &[Lanes], a_hat: &mut [Lanes]) -> bool {
        if self.eliminated.is_none() {
            return dispatch(
                #[inline(always)]
                || {
                    self.misclosure(raw, a_hat);
                    self.factor();
                    self.adjust(raw, a_hat)
                },
            );
        }
        let (n, k) = (a_hat.len() - raw.len(), self.play.len());
        self.w.resize(k, Lanes::ZERO);
        dispatch(
            #[inline(always)]
            || {
                self.misclosure(raw, a_hat);
                self.factor();
            },
        );
        let mut b = std::mem::take(&mut self.ws.b);
        whiten_rows(&self.l, k, &mut b, n);
        self.eliminated.factor(&b, k);
        self.ws.b = b;
        self.eliminated.turn(&mut self.w, 1);
        let g = self.w.split_off(n);
        self.taken.clone_from(&self.w);
        let (read, xi) = a_hat.split_at_mut(raw.len());
        let rounding = self.eliminated.rounding(xi);
        let still = |w: &Lanes| {
            w.0.iter().zip(rounding).all(|(w, least)| w.abs() <= self.settled.max(least))
        };
        let mut moved = !self.taken.iter().all(still);
        let step = self.eliminated.step(&self.w);
        xi.iter_mut().zip(step).for_each(|(xi, step)| *xi += step);
        self.w.fill(Lanes::ZERO);
        self.w.extend_from_slice(&g);
        self.eliminated.turn_back(&mut self.w);
        self.of_closures.clone_from(&self.w);
        moved |= dispatch(
            #[inline(always)]
            || self.adjust(raw, read),
        );
        self.w = g;
        moved
    }

    /// `w = f(â) + A (a - â)`
    #[inline(always)]
    fn misclosure(&mut self, raw: &[Lanes], a_hat: &[Lanes]) {
        let c = raw.len();
        for (k, w) in self.w.iter_mut().enumerate() {
            *w = self.ws.f[k];
            for i in 0..c {
                *w = self.ws.a[k * c + i].mul_add(raw[i] - a_hat[i], *w);
            }
        }
    }

    /// `S = A Σ Aᵀ + m Π = L Lᵀ`, (67), then `w ← L⁻¹ w`.
    #[inline(always)]
    fn factor(&mut self) {
        let (n, c) = (self.w.len(), self.variance.len());
        for i in 0..n {
            for j in 0..=i {
                let mut s = Lanes::ZERO;
                if i == j {
                    s = self.seated * self.play[i] + Lanes::splat(self.own[i]);
                    // An equation of zeros keeps to itself, whatever its variance.
                    if let Some(absent) = self.absent.get(i) {
                        s += *absent;
                    }
                }
                for (m, variance) in self.variance.iter().enumerate() {
                    s = (self.ws.a[i * c + m] * *variance).mul_add(self.ws.a[j * c + m], s);
                }
                let variance = s;
                for m in 0..j {
                    s -= self.l[i * n + m] * self.l[j * n + m];
                }
                if i == j {
                    // (57) is never above this part of the variance.
                    let clear = variance * self.beyond_most;
                    let below = |lane: usize| s.0[lane].is_nan() || s.0[lane] < clear.0[lane];
                    if (0..WIDTH).any(below) {
                        let least = self.least_left(i, variance);
                        s = Lanes(std::array::from_fn(|lane| s.0[lane].max(least.0[lane])));
                    }
                }
                self.l[i * n + j] = if i == j { s.sqrt() } else { s / self.l[j * n + j] };
            }
        }
        solve_lower(&self.l, &mut self.w);
    }

    /// What those before leave at least of the variance of an equation, (57).
    #[inline(always)]
    fn least_left(&self, equation: usize, variance: Lanes) -> Lanes {
        let c = self.variance.len();
        let row = &self.ws.a[equation * c..(equation + 1) * c];
        let beyond = self.beyond.iter().zip(row);
        beyond.fold(variance * ROUNDED, |sum, (beyond, a)| (*a * *beyond).mul_add(*a, sum))
    }

    /// `â ← a - Σ Aᵀ L⁻ᵀ (L⁻¹ w)`; true where `â` has changed.
    #[inline(always)]
    fn adjust(&mut self, raw: &[Lanes], a_hat: &mut [Lanes]) -> bool {
        let (n, c) = (self.w.len(), raw.len());
        self.lambda.copy_from_slice(&self.w);
        solve_transposed(&self.l, &mut self.lambda);
        let mut moved = false;
        for i in 0..c {
            let mut e = Lanes::ZERO;
            for k in 0..n {
                e = self.ws.a[k * c + i].mul_add(self.lambda[k], e);
            }
            let next = raw[i] - e * self.variance[i];
            let change = (next - a_hat[i]).map(f64::abs);
            let limit = self.still[i];
            for lane in 0..WIDTH {
                moved |= change.0[lane] > limit;
            }
            a_hat[i] = next;
        }
        moved
    }

    /// `X ← L⁻¹ X`
    fn whiten_parameters(&mut self, columns: usize) {
        let (l, n, x) = (&self.l, self.play.len(), &mut self.ws.x);
        dispatch(
            #[inline(always)]
            || whiten_rows(l, n, x, columns),
        );
        self.eliminate(columns, |ws| &mut ws.x);
    }

    /// `Nᵀ` of whitened rows.
    fn eliminate(&mut self, columns: usize, rows: impl Fn(&mut Workspace) -> &mut Vec<Lanes>) {
        if !self.eliminated.is_none() {
            let rows = rows(&mut self.ws);
            self.eliminated.turn(rows, columns);
            rows.drain(..(self.play.len() - self.w.len()) * columns);
        }
    }

    /// What the readings of the first samples of a block add to the variance of its whitened
    /// equations, one for each where nothing else does.
    pub(crate) fn variance_of_readings(&self, weight: Lanes, live: usize) -> f64 {
        let mut sum = Lanes::ZERO;
        for row in self.ws.a.chunks_exact(self.variance.len()) {
            for (a, variance) in row.iter().zip(&self.variance) {
                sum += *a * *a * *variance;
            }
        }
        (sum * weight * weight).0[..live].iter().sum()
    }

    /// What errors of the closures do to the whitened equations, [`Room::by_closure`].
    pub(crate) fn whiten_closures(&mut self) {
        let n = self.w.len();
        self.by_closure.clear();
        self.by_closure.resize(n * n, Lanes::ZERO);
        for (e, length) in self.lengths.iter().enumerate() {
            let holds = self.absent.get(e).map_or(Lanes::ONE, |absent| Lanes::ONE - *absent);
            self.by_closure[e * n + e] = holds * (1.0 / length);
        }
        whiten_rows(&self.l, n, &mut self.by_closure, n);
    }

    /// `A ← L⁻¹ A`
    pub(crate) fn whiten_readings(&mut self) {
        let (l, n, a) = (&self.l, self.play.len(), &mut self.ws.a);
        let columns = self.variance.len();
        dispatch(
            #[inline(always)]
            || whiten_rows(l, n, a, columns),
        );
        self.eliminate(columns, |ws| &mut ws.a);
    }
}

/// Forward substitution on every column of `rows`, equation by equation.
#[inline(always)]
fn whiten_rows(l: &[Lanes], n: usize, rows: &mut [Lanes], columns: usize) {
    for i in 0..n {
        for m in 0..i {
            let factor = l[i * n + m];
            let (above, here) = rows.split_at_mut(i * columns);
            for (value, known) in here[..columns].iter_mut().zip(&above[m * columns..]) {
                *value -= factor * *known;
            }
        }
        let inverse = Lanes::ONE / l[i * n + i];
        for value in &mut rows[i * columns..(i + 1) * columns] {
            *value = *value * inverse;
        }
    }
}
