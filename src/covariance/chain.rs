//! A schedule as a chain of elements: Friedland's separated bias, two stages.
//!
//! Carried are V (3×m, sensitivity of ψ^n to the m parameters D), a root G of P = G Gᵀ (3×3,
//! covariance of ψ^n for known D) and, as rows, the information E (m×m) on D. With a dwell's
//! [`Kernel`](super::kernel::Kernel), in its factored form, and A = A(position):
//!
//! ```text
//! T = R11 V + R12 A,          S = I + R11 P R11ᵀ,
//! E += Tᵀ S⁻¹ T + (R22 A)ᵀ (R22 A),
//! P₊ = (P⁻¹ + R11ᵀ R11)⁻¹,    V₊ = V − P₊ R11ᵀ T,
//! V ← A_ψ V₊ + A_ε A,         P ← A_ψ P₊ A_ψᵀ + C.
//! ```
//!
//! Every change of E is an addition of a square, so nothing cancels. Against theory texts that
//! use J_ψψ⁻¹: S ⪰ I always, so a dwell of one period, the poles, and a misalignment known
//! exactly are ordinary cases.
//!
//! Between dwells V ← Φ V + B, P ← Φ P Φᵀ + q t I with B the drift integral; in frame-hold
//! repositioning V ← Q V, P ← Q P Qᵀ with Q = C_{k+1} C_kᵀ. A measured move runs the filter's
//! ticks one by one.
//!
//! # In 16 and in 32 digits
//!
//! Rows that tell the same combination again must be dependent. In doubles they are so to the
//! sixteenth digit only, and what is left over after elimination, 1e-16 of a row, counts as
//! information on combinations that no measurement told anything of. Against a prior of unit size
//! that matters as soon as a row is longer than some 1e13. The same holds for C_c^n, orthogonal
//! to the sixteenth digit. So attitudes, kernels and chain can be worked out in numbers of 32
//! digits as well; drift integrals of moves are those of doubles.
//!
//! What the parameters are is known to `Effects` alone: `twelve` are the coefficients of the drift, in
//! doubles, as searches take them; `selection` is all that a platform has.

use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, Matrix3, OMatrix, U3};

use super::kernel::Kernel;
use super::real::Real;
use super::triangle::{add_roots, inverse, one_and};
use super::{CovarianceModel, TickRule, split_periods};
use crate::drift::DriftMatrix;
use crate::motion::{Leg, Move, Timeline};

#[cfg(test)]
pub(crate) use super::twelve::Gram;
pub(crate) use super::twelve::{State, measurement_root};

/// Why time passes without a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Passage {
    /// The rest of a dwell, shorter than a period.
    Remainder,
    /// Settling after a move.
    Settle,
    /// `start_s` to `start_s + length` of the move.
    Moving { start_s: f64 },
}

/// One step of the chain.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Step {
    /// `periods` filter periods of the dwell.
    Dwell { periods: usize },
    /// Time without a measurement.
    Pass { passage: Passage, length_s: f64 },
    /// A measurement of ψ_x, ψ_z with information `weight` each, 1/arcsec².
    Measure { weight: f64, of: Measured },
    /// Change of position in frame-hold repositioning.
    Rotate,
}

/// What a single measurement belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measured {
    /// A measured move.
    Move,
    /// The rest of a dwell.
    Dwell,
}

/// Takes the information rows as the chain produces them: E += XᵀX.
pub(crate) trait InformationSink<V = DriftMatrix> {
    /// Adds three rows of unit noise.
    fn add(&mut self, rows: &V);
}

/// Watches the chain.
pub(crate) trait Recorder {
    /// Called before each step of a leg.
    fn record(&mut self, leg: usize, step: Step);
}

/// Remembers nothing.
pub(crate) struct NoRecord;

impl Recorder for NoRecord {
    fn record(&mut self, _: usize, _: Step) {}
}

/// Three rows on the parameters.
pub(crate) trait Drive<T>: Clone {
    /// `m` times these.
    fn turned(&self, m: &Matrix3<T>) -> Self;
    /// Adds others.
    fn add(&mut self, more: &Self);
    /// Takes others off.
    fn take(&mut self, less: &Self);
}

impl<T: Real, C: Dim> Drive<T> for OMatrix<T, U3, C>
where
    DefaultAllocator: Allocator<U3, C>,
{
    fn turned(&self, m: &Matrix3<T>) -> Self {
        m * self
    }
    fn add(&mut self, more: &Self) {
        *self += more;
    }
    fn take(&mut self, less: &Self) {
        *self -= less;
    }
}

/// What the parameters do to ψ^n: the part of the chain that knows them.
pub(crate) trait Effects {
    /// The numbers it is worked out in.
    type Number: Real;
    /// Three rows on the parameters.
    type Drive: Drive<Self::Number>;
    /// An attitude, with what follows from it.
    type Place;

    /// Noises, prior and dynamics.
    fn model(&self) -> &CovarianceModel;
    /// No effect.
    fn nothing(&self) -> Self::Drive;
    /// The place where a leg dwells.
    fn place(&self, leg: &Leg) -> Self::Place;
    /// C_c^n there.
    fn attitude(&self, place: &Self::Place) -> Matrix3<Self::Number>;
    /// X A there.
    fn held(&self, x: &Matrix3<Self::Number>, place: &Self::Place) -> Self::Drive;
    /// B of an interval of a move.
    fn moved(&self, m: &Move, start_s: f64, length_s: f64) -> Self::Drive;
    /// The kernel of so many filter periods.
    fn kernel(&self, periods: usize) -> Kernel<Self::Number>;
    /// What a measurement of one filter period sees of ψ^n, with unit noise.
    fn measurement(&self) -> Matrix3<Self::Number>;

    /// What a move that takes no time adds to ψ^n.
    fn jump(&self, _: &Move) -> Option<Self::Drive> {
        None
    }
    /// U: what the accelerometers show as ψ^n at a place.
    fn shift<'a>(&self, _: &'a Self::Place) -> Option<&'a Self::Drive> {
        None
    }
    /// What the vertical channel tells of the parameters in a period, with unit noise.
    fn upward<'a>(&self, _: &'a Self::Place) -> Option<&'a Self::Drive> {
        None
    }
    /// The place so long after the start of a move, if measurements there depend on it.
    fn passed(&self, _: &Move, _time_s: f64) -> Option<Self::Place> {
        None
    }
}

/// The chain at work: what the parameters do, the rule, and what it writes to.
pub(super) struct Runner<'a, E: Effects, S, R> {
    pub effects: &'a E,
    pub rule: TickRule,
    /// V.
    pub v: E::Drive,
    /// G.
    pub g: Matrix3<E::Number>,
    pub sink: &'a mut S,
    pub recorder: &'a mut R,
    pub leg: usize,
}

/// V and G at the end of a test.
pub(super) struct Reached<E: Effects> {
    pub v: E::Drive,
    pub g: Matrix3<E::Number>,
}

/// Runs `timeline` from its start: what is told of the parameters goes to `sink`.
pub(super) fn run<E: Effects, S: InformationSink<E::Drive>, R: Recorder>(
    effects: &E,
    timeline: &Timeline,
    rule: TickRule,
    sink: &mut S,
    recorder: &mut R,
) -> Reached<E> {
    start(effects, rule, sink, recorder).through(timeline)
}

/// Before the start: nothing is known of the parameters, and ψ^n by its prior.
pub(super) fn start<'a, E: Effects, S: InformationSink<E::Drive>, R: Recorder>(
    effects: &'a E,
    rule: TickRule,
    sink: &'a mut S,
    recorder: &'a mut R,
) -> Runner<'a, E, S, R> {
    let prior = effects.model().prior_psi.diagonal();
    Runner {
        effects,
        rule,
        v: effects.nothing(),
        g: Matrix3::from_diagonal(&prior.map(|variance| E::Number::from(variance).sqrt())),
        sink,
        recorder,
        leg: 0,
    }
}

/// The same from another V and G than those of the prior.
pub(super) fn run_from<E: Effects, S: InformationSink<E::Drive>, R: Recorder>(
    start: Reached<E>,
    effects: &E,
    timeline: &Timeline,
    rule: TickRule,
    sink: &mut S,
    recorder: &mut R,
) -> Reached<E> {
    let runner = Runner {
        effects,
        rule,
        v: start.v,
        g: start.g,
        sink,
        recorder,
        leg: 0,
    };
    runner.through(timeline)
}

impl<E: Effects, S: InformationSink<E::Drive>, R: Recorder> Runner<'_, E, S, R> {
    /// All legs of `timeline` in turn.
    fn through(mut self, timeline: &Timeline) -> Reached<E> {
        let mut before = None;
        for (index, leg) in timeline.legs().iter().enumerate() {
            self.leg = index;
            let here = self.effects.place(leg);
            self.reach(leg, &here, before.as_ref());
            self.dwell(leg, &here);
            before = Some(here);
        }
        if let Some(last) = &before {
            self.leave(last);
        }
        Reached {
            v: self.v,
            g: self.g,
        }
    }

    /// Comes to a leg, from the place `before` it if there is one.
    pub fn reach(&mut self, leg: &Leg, here: &E::Place, before: Option<&E::Place>) {
        match before {
            Some(before) => self.arrive(leg, here, before),
            None => self.enter(here),
        }
    }

    pub fn arrive(&mut self, leg: &Leg, here: &E::Place, before: &E::Place) {
        let Some(arrival) = &leg.arrival else {
            return;
        };
        self.leave(before);
        if self.model().frame_hold {
            self.recorder.record(self.leg, Step::Rotate);
            let attitude = |place| self.effects.attitude(place);
            let q = attitude(here) * attitude(before).transpose();
            self.v = self.v.turned(&q);
            self.g = q * self.g;
        } else if arrival.duration_s <= 0.0 {
            if let Some(jump) = self.effects.jump(arrival) {
                self.v.add(&jump);
            }
        } else if arrival.measured {
            self.measured_move(arrival);
        } else {
            self.moving(arrival, 0.0, arrival.duration_s);
        }
        self.enter(here);
        if leg.settle_s > 0.0 {
            self.pass_at(Passage::Settle, here, leg.settle_s);
        }
    }

    fn model(&self) -> &CovarianceModel {
        self.effects.model()
    }

    /// From ψ^n to ψ^n + U D.
    fn enter(&mut self, place: &E::Place) {
        if let Some(shift) = self.effects.shift(place) {
            self.v.add(shift);
        }
    }

    /// And back.
    fn leave(&mut self, place: &E::Place) {
        if let Some(shift) = self.effects.shift(place) {
            self.v.take(shift);
        }
    }

    /// A measured move: the filter's ticks run through it.
    fn measured_move(&mut self, arrival: &Move) {
        let period = self.model().period_s;
        let (ticks, remainder) = split_periods(arrival.duration_s, period);
        for tick in 0..ticks {
            self.moving(arrival, tick as f64 * period, period);
            self.measure_in_move(arrival, (tick + 1) as f64 * period, 1.0);
        }
        if remainder > 0.0 {
            self.moving(arrival, ticks as f64 * period, remainder);
            if self.rule == TickRule::Relaxed {
                self.measure_in_move(arrival, arrival.duration_s, remainder / period);
            }
        }
    }

    /// A measurement so long after the start of a move.
    fn measure_in_move(&mut self, m: &Move, time_s: f64, share: f64) {
        match self.effects.passed(m, time_s) {
            None => self.measure(share, Measured::Move, None),
            Some(place) => {
                self.enter(&place);
                self.measure(share, Measured::Move, Some(&place));
                self.leave(&place);
            }
        }
    }

    pub fn dwell(&mut self, leg: &Leg, here: &E::Place) {
        let (periods, remainder) = split_periods(leg.dwell_s, self.model().period_s);
        if periods > 0 {
            self.recorder.record(self.leg, Step::Dwell { periods });
            self.dwell_periods(here, periods);
        }
        if remainder > 0.0 {
            self.pass_at(Passage::Remainder, here, remainder);
            if self.rule == TickRule::Relaxed {
                let share = remainder / self.model().period_s;
                self.measure(share, Measured::Dwell, Some(here));
            }
        }
    }

    fn dwell_periods(&mut self, here: &E::Place, periods: usize) {
        let k = self.effects.kernel(periods);
        let mut t = self.v.turned(&k.r11);
        t.add(&self.effects.held(&k.r12, here));
        self.condition(&k.r11, &t);
        self.sink.add(&self.effects.held(&k.r22, here));
        self.look_up(here, periods as f64);
        self.v = self.v.turned(&k.a_psi);
        self.v.add(&self.effects.held(&k.a_epsilon, here));
        self.g = add_roots(&(k.a_psi * self.g), &k.u);
    }

    /// Takes the measurement of `h` ψ^n, of which D is `t`, with unit noise.
    fn condition(&mut self, h: &Matrix3<E::Number>, t: &E::Drive) {
        let through = h * self.g;
        let whitener = inverse(&one_and(&through.transpose())).transpose();
        self.sink.add(&t.turned(&whitener));
        self.g *= inverse(&one_and(&through));
        // V₊ = V − P₊ Hᵀ T.
        let gain = self.g * self.g.transpose() * h.transpose();
        self.v.take(&t.turned(&gain));
    }

    /// Time at a position without a measurement.
    fn pass_at(&mut self, passage: Passage, here: &E::Place, length_s: f64) {
        let [_, gamma] = E::Number::transition(&self.model().dynamics, length_s);
        let b = self.effects.held(&gamma, here);
        self.pass(passage, length_s, &b);
    }

    /// An interval of a move.
    fn moving(&mut self, m: &Move, start_s: f64, length_s: f64) {
        let b = self.effects.moved(m, start_s, length_s);
        self.pass(Passage::Moving { start_s }, length_s, &b);
    }

    fn pass(&mut self, passage: Passage, length_s: f64, b: &E::Drive) {
        self.recorder
            .record(self.leg, Step::Pass { passage, length_s });
        let [phi, _] = E::Number::transition(&self.model().dynamics, length_s);
        let process = E::Number::from(self.model().drift_psd * length_s).sqrt();
        self.v = self.v.turned(&phi);
        self.v.add(b);
        self.g = add_roots(&(phi * self.g), &(Matrix3::identity() * process));
    }

    /// A measurement with the information of a `share` of a period.
    fn measure(&mut self, share: f64, of: Measured, at: Option<&E::Place>) {
        let weight = share / self.model().noise_variance;
        self.recorder.record(self.leg, Step::Measure { weight, of });
        let h = self.effects.measurement() * E::Number::from(share).sqrt();
        let t = self.v.turned(&h);
        self.condition(&h, &t);
        if let Some(at) = at {
            self.look_up(at, share);
        }
    }

    /// What the vertical channel tells in so many periods.
    fn look_up(&mut self, at: &E::Place, periods: f64) {
        if let Some(upward) = self.effects.upward(at) {
            let root = E::Number::from(periods).sqrt();
            self.sink.add(&upward.turned(&(Matrix3::identity() * root)));
        }
    }
}
