//! Evaluation of the model: misclosure and derivatives of readings.
//!
//! For one sample with readings `a` and parameters `β`,
//!
//! ```text
//! r = a + Σ δ_electronics(a)                                              (41)
//! q = k0 r + θ0 + Σ δ_sensor(r)                                           (42)
//! q' = q + Σ compliance · torque(q)                                       (43)
//! f = |p_a(q') - p_b(q')|² - d²      or      p_a - p_b                    (10)
//! ```
//!
//! with the derivatives by the chain rule,
//!
//! ```text
//! A = ∂f/∂a = G (∂q'/∂q) diag(∂q/∂r) (∂r/∂a)          G = ∂f/∂q'          (44)
//! X = ∂f/∂β                                                               (12)
//! ```
//!
//! All terms of one stage see the state that enters the stage, and their corrections add up, so
//! their order does not matter. Eight samples are computed at a time.

use crate::kinematics::posture::Posture;
use crate::mechanism::MOST_PARAMETERS;
use crate::model::compiled::Model;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, dispatch};
use crate::readings::course::{Followed, Late, Moved};
use crate::readings::{Block, Readings};
use crate::terms::term::Site;

/// True for the parameters of a term that changes nothing: a law that every term keeps. Most terms
/// of a model that looks for what is missing are so, and cost their derivatives only.
#[inline(always)]
fn absent(parameters: &[f64]) -> bool {
    parameters.iter().all(|p| *p == 0.0)
}

impl Model {
    /// Misclosure and derivatives of one block at readings `a`, what is unknown in one pose alone
    /// included: see [`Model::evaluate`].
    ///
    /// This is the only place where the kernel is dispatched, so that there is one copy of the
    /// kernel for each vector width.
    pub(super) fn evaluate_at(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        dispatch(
            #[inline(always)]
            || self.evaluate_as_compiled(readings, block, a, beta, want, ws),
        );
    }

    /// [`Model::evaluate`] with the instructions that the caller is compiled for.
    #[doc(hidden)]
    #[inline(always)]
    pub fn evaluate_as_compiled(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        let (a, xi) = a.split_at(self.scales.len());
        ws.xi.clear();
        ws.xi.extend_from_slice(xi);
        self.joint_angles(readings, block, a, beta, want, ws);
        ws.gates.clear();
        ws.gates.extend(self.gates_in(&readings.blocks()[block]));
        if !self.laws.is_empty() {
            self.take_laws(readings, block, beta, want, ws);
        }
        if !self.loads.is_empty() {
            self.bend(block, beta, ws);
        }
        if !self.laws.is_empty() {
            self.add_laws(ws);
        }
        ws.postures.resize_with(self.steps.len(), Posture::new);
        for (posture, steps) in ws.postures.iter_mut().zip(&self.steps) {
            posture.take(steps, &ws.angles, beta, &ws.gates);
        }
        self.close(readings, block, beta, want, ws);
        if want.x || want.a {
            self.chain_rule(block, beta, want, ws);
        }
        // Amounts of laws are coordinates here only.
        ws.angles.truncate(self.scales.len());
    }

    /// Eqs. (41, 42): joint coordinates before load, and their derivatives.
    #[inline(always)]
    fn joint_angles(
        &self,
        readings: &Readings,
        block: usize,
        a: &[Lanes],
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        let (meta, site) = (&readings.blocks()[block], self.site(readings, block, a));
        self.correct_readings(meta, site, beta, want, ws);
        // Room for all at once: a session of a few blocks would pay more for growing vectors.
        ws.angles.clear();
        ws.angles.reserve(self.scales.len() + self.amounts);
        ws.slopes.clear();
        ws.slopes.reserve(self.scales.len());
        for (scale, reading) in self.scales.iter().zip(&ws.corrected) {
            ws.angles.push(scale.nominal(*reading));
            ws.slopes.push(Lanes::splat(scale.gain));
        }
        self.correct_sensors(meta, site, beta, want, ws);
    }

    /// Eq. (41): what electronics add to readings, and the derivatives of that.
    #[inline(always)]
    fn correct_readings(
        &self,
        meta: &Block,
        mut site: Site,
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        let channels = self.scales.len();
        ws.moved.clear();
        ws.corrected.clear();
        ws.corrected.extend_from_slice(site.readings);
        ws.electric.clear();
        if !self.electronics.is_empty() {
            ws.mix.clear();
            ws.mix.resize(channels * channels, Lanes::ZERO);
        }
        let mut out = [Lanes::ZERO; MOST_PARAMETERS];
        for e in &self.electronics {
            let p = &beta[e.first..e.first + e.width];
            (site.place, site.channel) = (e.place, e.channel);
            if let Some(own) = e.term.late(p).filter(|_| want.x || !absent(p)) {
                site.followed = self.followed(&site, beta, (e.first, own), want.x, &mut ws.moved);
            }
            let row = &mut ws.mix[e.channel * channels..(e.channel + 1) * channels];
            match e.session.map(|s| meta.within(s)) {
                _ if absent(p) => {}
                None => {
                    ws.corrected[e.channel] += e.term.correction(p, &site);
                    e.term.slopes(p, &site, row);
                }
                Some(within) => {
                    ws.corrected[e.channel] += e.term.correction(p, &site) * within;
                    let mut slopes = vec![Lanes::ZERO; channels];
                    e.term.slopes(p, &site, &mut slopes);
                    row.iter_mut().zip(slopes).for_each(|(r, s)| *r += s * within);
                }
            }
            if want.x {
                e.term.partials(p, &site, &mut out[..e.width]);
                let within = e.session.map_or(Lanes::ONE, |s| meta.within(s));
                for (k, partial) in out[..e.width].iter().enumerate() {
                    ws.electric.push((e.first + k, e.channel, *partial * within));
                }
            }
        }
    }

    /// Eq. (42): what sensors add to joint coordinates, and the derivatives of that.
    #[inline(always)]
    fn correct_sensors(
        &self,
        meta: &Block,
        site: Site,
        beta: &[f64],
        want: Want,
        ws: &mut Workspace,
    ) {
        ws.partials.clear();
        ws.partials.reserve(if want.x { self.term_parameters } else { 0 });
        let mut site = Site { readings: &ws.corrected, ..site };
        let mut out = [Lanes::ZERO; MOST_PARAMETERS];
        for s in &self.sensors {
            let p = &beta[s.first..s.first + s.width];
            (site.place, site.channel) = (s.place, s.channel);
            if !ws.moved.is_empty() {
                site.late = self.late(beta, s.channel, 0)[1].lag;
            }
            let within = s.session.map_or(Lanes::ONE, |s| meta.within(s));
            if !absent(p) {
                ws.angles[s.channel] += s.term.correction(p, &site) * within;
                if want.x || want.a {
                    ws.slopes[s.channel] += s.term.slope(p, &site) * within;
                }
            }
            if want.x {
                s.term.partials(p, &site, &mut out[..s.width]);
                for (k, partial) in out[..s.width].iter().enumerate() {
                    ws.partials.push((s.first + k, s.channel, *partial * within));
                }
            }
        }
    }

    /// How a channel follows by the terms before the one with this parameter, and by all.
    pub(crate) fn late(&self, beta: &[f64], channel: usize, before: usize) -> [Late; 2] {
        let own = self.electronics.iter().filter(|e| e.channel == channel);
        own.fold([Late::default(); 2], |[sum, all], e| {
            let late = e.term.late(&beta[e.first..e.first + e.width]).unwrap_or_default();
            [if e.first < before { sum + late } else { sum }, all + late]
        })
    }

    /// What the samples of a channel followed, by its term with a parameter and those before it. Most are asked
    /// for by several terms: what was found is kept in `moved`.
    fn followed(
        &self,
        site: &Site,
        beta: &[f64],
        (first, own): (usize, Late),
        derivatives: bool,
        moved: &mut Vec<(usize, Late, Moved)>,
    ) -> Followed {
        let Some(course) = site.course else { return Followed::default() };
        let channel = site.channel;
        let [before, all] = self.late(beta, channel, first);
        // Where one of them asks for time constants, all do: two ways to write zero are one.
        let none = Late { lag: 0.0, square: all.square.map(|_| 0.0) };
        let mut to = |late: Late| {
            let kept = moved.iter().find(|(c, l, _)| (*c, *l) == (channel, late));
            let kept = kept.map(|(.., to)| *to);
            kept.unwrap_or_else(|| {
                let to = course.moved(channel, late);
                moved.push((channel, late, to));
                to
            })
        };
        let all = derivatives.then(|| to(all + none));
        let mut unless_nothing = |late: Late| (!late.is_nothing()).then(|| to(late + none));
        Followed { before: unless_nothing(before), with: unless_nothing(before + own), all }
    }

    /// How much of each motion acts in the samples of a block.
    #[inline(always)]
    pub(crate) fn gates_in(&self, block: &Block) -> impl Iterator<Item = Lanes> {
        self.gates.iter().map(move |gate| gate.of(block))
    }

    /// Eq. (44), and the columns of `X` that act through joint coordinates.
    #[inline(always)]
    fn chain_rule(&self, block: usize, beta: &[f64], want: Want, ws: &mut Workspace) {
        if !self.laws.is_empty() {
            self.hold_laws(ws);
        }
        if !self.loads.is_empty() {
            match &self.drives {
                Some(drives) if want.x => self.driven_back(drives, block, ws),
                Some(_) => {}
                None => self.bend_back(beta, want, ws),
            }
        }
        if !self.laws.is_empty() {
            self.turn_laws(want, ws);
        }
        if want.x {
            self.columns_of_sensors(ws);
        }
        if want.a {
            self.by_readings(ws);
        }
    }

    /// The columns of `X` of sensors and electronics.
    #[inline(always)]
    fn columns_of_sensors(&self, ws: &mut Workspace) {
        let (channels, width) = (self.scales.len(), self.width());
        for &(column, channel, partial) in &ws.partials {
            for k in 0..self.equations {
                ws.x[k * width + column] += ws.g[k * channels + channel] * partial;
            }
        }
        for &(column, channel, partial) in &ws.electric {
            let slope = ws.slopes[channel] * partial;
            for k in 0..self.equations {
                ws.x[k * width + column] += ws.g[k * channels + channel] * slope;
            }
            if !self.laws.is_empty() {
                for k in 0..self.equations {
                    ws.x[k * width + column] += ws.laws.direct[k * channels + channel] * partial;
                }
            }
        }
    }

    /// `A = G (∂q'/∂q) diag(∂q/∂r) (∂r/∂a)`, eq. (44).
    #[inline(always)]
    fn by_readings(&self, ws: &mut Workspace) {
        let channels = self.scales.len();
        ws.a.clear();
        ws.a.reserve(self.equations * channels);
        for k in 0..self.equations {
            for c in 0..channels {
                ws.a.push(ws.g[k * channels + c] * ws.slopes[c]);
            }
        }
        if !self.laws.is_empty() {
            ws.a.iter_mut().zip(&ws.laws.direct).for_each(|(a, direct)| *a += *direct);
        }
        if self.electronics.is_empty() {
            return;
        }
        for k in 0..self.equations {
            let row = &mut ws.a[k * channels..(k + 1) * channels];
            ws.turned.clear();
            ws.turned.extend_from_slice(row);
            for (turned, mix) in ws.turned.iter().zip(ws.mix.chunks_exact(channels)) {
                for (slope, share) in row.iter_mut().zip(mix) {
                    *slope += *turned * *share;
                }
            }
        }
    }

    /// Slope of each joint coordinate by its reading, `diag(∂q/∂r)` of (44), one per channel.
    ///
    /// `ws` comes from [`Model::evaluate`] with derivatives.
    #[must_use]
    pub fn slopes<'a>(&self, ws: &'a Workspace) -> &'a [Lanes] {
        &ws.slopes
    }
}
