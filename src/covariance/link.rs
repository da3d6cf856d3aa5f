//! A link of the chain: any stretch of a test, move and dwell together, as one element in (ψ^n, D).
//!
//! As a dwell's [`Kernel`](super::kernel::Kernel), but with D itself for ε^n, so that moves,
//! settles, measured moves and changes of position compose with it. What the stretch measures is
//! as good as three scalars `R ψ^n + S D` of unit noise (ψ^n at its start) and information E on D
//! alone; given them, ψ^n at its end is `A ψ^n + B D` plus noise of covariance C. Links 1 then 2,
//! with W the whitener of I + R2 C1 R2ᵀ and C1₊ = (C1⁻¹ + R2ᵀ R2)⁻¹:
//!
//! ```text
//! rows   W (R2 A1 ψ + (R2 B1 + S2) D)   stacked with   R1 ψ + S1 D,
//! A = A2 (A1 − C1₊ R2ᵀ R2 A1),   B = A2 (B1 − C1₊ R2ᵀ (R2 B1 + S2)) + B2,   C = A2 C1₊ A2ᵀ + C2.
//! ```
//!
//! Where many orders of the same positions are tried, every move with the dwell after it is made a
//! link once, and a further position costs one application of it.

use nalgebra::Matrix3;

use super::chain::measurement_root;
use super::fast::cuts::Rest;
use super::small::{condition, square_root, whitener};
use super::{CovarianceModel, split_periods};
use crate::drift::{CoefficientMatrix, DriftMatrix, times_drift_matrix};
use crate::motion::{Leg, Timeline};

/// A stretch of a test as one element.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Link {
    r: Matrix3<f64>,
    s: DriftMatrix,
    e: CoefficientMatrix,
    a: Matrix3<f64>,
    b: DriftMatrix,
    c: Matrix3<f64>,
}

/// Where a chain of links has come to: V, P and the information E on D, without the prior.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reached {
    /// Sensitivity of ψ^n to D, arcsec per °/h.
    pub v: DriftMatrix,
    /// Covariance of ψ^n for known D, arcsec².
    pub p: Matrix3<f64>,
    /// Information on D, (°/h)⁻².
    pub e: CoefficientMatrix,
}

impl Link {
    /// No time at all.
    fn nothing() -> Self {
        Self {
            r: Matrix3::zeros(),
            s: DriftMatrix::zeros(),
            e: CoefficientMatrix::zeros(),
            a: Matrix3::identity(),
            b: DriftMatrix::zeros(),
            c: Matrix3::zeros(),
        }
    }

    /// This link, then `next`.
    pub fn then(&self, next: &Self) -> Self {
        let seen_psi = next.r * self.a;
        let seen_drift = next.r * self.b + next.s;
        let g = square_root(&self.c);
        let w = whitener(&(next.r * g));
        // The information of both on the start: the second's rows stacked on the first's.
        let mut rows = Rest::of(&self.r, &self.s, &(self.e + next.e));
        rows.with_rows(&(w * seen_psi), &(w * seen_drift));
        let (r, s, e) = rows.parts();
        let c_plus = condition(&g, &next.r);
        let gain = next.a * c_plus * next.r.transpose();
        Self {
            r: *r,
            s: *s,
            e: *e,
            a: next.a * self.a - gain * seen_psi,
            b: next.a * self.b - gain * seen_drift + next.b,
            c: next.a * c_plus * next.a.transpose() + next.c,
        }
    }

    /// What is told about the start of the link when `rest` is told about its end.
    pub fn back(&self, rest: &Rest) -> Rest {
        let mut before = *rest;
        before.through(&self.a, &self.b, &self.c);
        before.with_rows(&self.r, &self.s);
        before.add_to_information(&self.e);
        before
    }
}

impl Reached {
    /// After `link`.
    pub fn after(&self, link: &Link) -> Self {
        let t = link.r * self.v + link.s;
        let g = square_root(&self.p);
        let x = whitener(&(link.r * g)) * t;
        let mut e = self.e + link.e;
        e.gemm_tr(1.0, &x, &x, 1.0);
        let p_plus = condition(&g, &link.r);
        let v_plus = self.v - p_plus * (link.r.transpose() * t);
        Self {
            v: link.a * v_plus + link.b,
            p: link.a * p_plus * link.a.transpose() + link.c,
            e,
        }
    }

    /// Information on D at the end when `rest` is told about what follows.
    pub fn joined(&self, rest: &Rest) -> CoefficientMatrix {
        let (r, s, e_rest) = rest.parts();
        let x = whitener(&(r * square_root(&self.p))) * (r * self.v + s);
        let mut e = self.e + e_rest;
        e.gemm_tr(1.0, &x, &x, 1.0);
        e
    }
}

impl CovarianceModel {
    /// Before the test: nothing is known of D, and ψ^n by its prior.
    pub(crate) fn nothing_reached(&self) -> Reached {
        Reached {
            v: DriftMatrix::zeros(),
            p: self.prior_psi,
            e: CoefficientMatrix::zeros(),
        }
    }

    /// The move to a leg from the leg before it and the settle after it, by the filter's rule.
    pub(crate) fn arrival_link(&self, [before, leg]: [&Leg; 2]) -> Link {
        let mut link = Link::nothing();
        if let Some(m) = &leg.arrival {
            if self.frame_hold {
                link.a = leg.attitude.matrix() * before.attitude.matrix().transpose();
            } else if m.duration_s > 0.0 && m.measured {
                let (ticks, remainder) = split_periods(m.duration_s, self.period_s);
                for tick in 0..ticks {
                    let start_s = tick as f64 * self.period_s;
                    let b = m.drift_integral(&self.stand, &self.dynamics, start_s, self.period_s);
                    link = link.then(&self.unmeasured(self.period_s, b));
                    link = link.then(&self.measurement());
                }
                if remainder > 0.0 {
                    let start_s = ticks as f64 * self.period_s;
                    let b = m.drift_integral(&self.stand, &self.dynamics, start_s, remainder);
                    link = link.then(&self.unmeasured(remainder, b));
                }
            } else if m.duration_s > 0.0 {
                let b = m.drift_integral(&self.stand, &self.dynamics, 0.0, m.duration_s);
                link = self.unmeasured(m.duration_s, b);
            }
        }
        if leg.settle_s > 0.0 {
            let b = times_drift_matrix(&self.dynamics.integral(leg.settle_s), &leg.attitude);
            link = link.then(&self.unmeasured(leg.settle_s, b));
        }
        link
    }

    /// `periods` filter periods held at the attitude of `leg`.
    pub(crate) fn dwell_link(&self, leg: &Leg, periods: usize) -> Link {
        let k = self.kernels.kernel(periods);
        let of = |m: &Matrix3<f64>| times_drift_matrix(m, &leg.attitude);
        let r22 = of(&k.r22);
        Link {
            r: k.r11,
            s: of(&k.r12),
            e: r22.transpose() * r22,
            a: k.a_psi,
            b: of(&k.a_epsilon),
            c: k.c,
        }
    }

    /// What has been reached at the end of `timeline`, of dwells in whole periods.
    pub(crate) fn reached(&self, timeline: &Timeline) -> Reached {
        let legs = timeline.legs();
        let mut reached = self.nothing_reached();
        for (k, leg) in legs.iter().enumerate() {
            if k > 0 {
                reached = reached.after(&self.arrival_link([&legs[k - 1], leg]));
            }
            let (periods, remainder) = split_periods(leg.dwell_s, self.period_s);
            reached = reached.after(&self.dwell_link(leg, periods));
            if remainder > 0.0 {
                let b = times_drift_matrix(&self.dynamics.integral(remainder), &leg.attitude);
                reached = reached.after(&self.unmeasured(remainder, b));
            }
        }
        reached
    }

    /// Time without a measurement in which the drift adds `b`.
    fn unmeasured(&self, length_s: f64, b: DriftMatrix) -> Link {
        Link {
            a: self.dynamics.transition(length_s),
            b,
            c: Matrix3::identity() * (self.drift_psd * length_s),
            ..Link::nothing()
        }
    }

    /// One measurement of ψ_x and ψ_z.
    fn measurement(&self) -> Link {
        Link {
            r: measurement_root(self.noise_variance.recip()),
            ..Link::nothing()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Position;
    use crate::covariance::TickRule;
    use crate::covariance::chain::{Gram, NoRecord};
    use crate::platform::{Platform, PlatformConfig, Repositioning};
    use crate::schedule::ScheduledPosition;

    fn timeline(platform: &Platform) -> Timeline {
        let at = [
            (10.0, 20.0, 30.0, 300.0),
            (100.0, -40.0, 5.0, 450.0),
            (-60.0, 80.0, 170.0, 200.0),
            (0.0, 0.0, -90.0, 415.0),
        ];
        let held = at.map(|(a, b, g, s)| ScheduledPosition::new(Position::from_deg(a, b, g), s));
        Timeline::unchecked(&platform.clone().into(), held.into_iter())
    }

    fn platforms() -> [Platform; 5] {
        let changes: [fn(&mut PlatformConfig); 5] = [
            |_| {},
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.7.into());
                c.motion.settle_s = 30.0;
            },
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.7.into());
                c.motion.measure_moves = true;
            },
            |c| {
                c.motion.repositioning = Repositioning::FrameHold;
                c.motion.settle_s = 20.0;
            },
            |c| {
                c.motion.slew_rate_deg_per_s = Some(2.0.into());
                c.motion.start_deg = Some([5.0, 5.0, 5.0]);
            },
        ];
        changes.map(|change| {
            let mut config = PlatformConfig::default();
            change(&mut config);
            config.check().unwrap()
        })
    }

    fn close(a: &CoefficientMatrix, b: &CoefficientMatrix, what: &str) {
        let error = (a - b).amax() / b.amax();
        assert!(error < 1e-11, "{what}: {error:e}");
    }

    #[test]
    fn links_are_the_chain() {
        for platform in platforms() {
            let model = CovarianceModel::new(&platform);
            let timeline = timeline(&platform);
            let mut gram = Gram(CoefficientMatrix::zeros());
            let state = model.run(&timeline, TickRule::Filter, &mut gram, &mut NoRecord);
            let reached = model.reached(&timeline);
            close(&reached.e, &gram.0, "E");
            assert!((reached.v - state.v).amax() < 1e-9 * state.v.amax());
            assert!((reached.p - state.p).amax() < 1e-10 * state.p.amax());
        }
    }

    #[test]
    fn links_compose_and_go_back() {
        for platform in platforms() {
            let model = CovarianceModel::new(&platform);
            let timeline = timeline(&platform);
            let whole = model.reached(&timeline);
            let legs = timeline.legs();
            // Of the last two positions, without the remainder of the last dwell.
            let link = |k: usize| {
                let arrival = model.arrival_link([&legs[k - 1], &legs[k]]);
                let periods = (legs[k].dwell_s / platform.period_s()) as usize;
                arrival.then(&model.dwell_link(&legs[k], periods))
            };
            let last = legs.len() - 1;
            let mut before = model.nothing_reached();
            for k in 0..last - 1 {
                if k > 0 {
                    before = before.after(&model.arrival_link([&legs[k - 1], &legs[k]]));
                }
                let periods = (legs[k].dwell_s / platform.period_s()) as usize;
                before = before.after(&model.dwell_link(&legs[k], periods));
            }
            let [one, two] = [link(last - 1), link(last)];
            close(&before.after(&one).after(&two).e, &whole.e, "in turn");
            close(&before.after(&one.then(&two)).e, &whole.e, "composed");
            let rest = one.back(&two.back(&Rest::nothing()));
            close(&before.joined(&rest), &whole.e, "back");
        }
    }
}
