//! The step-by-step square-root filter on faer: the independent check, and the convergence.
//!
//! It visits every filter period of the test with a square root L of the covariance of the 15
//! states (ψ^n, D), P = L Lᵀ, and one QR factorisation per period (the array form of Kailath,
//! Sayed & Hassibi, *Linear Estimation*, 2000, ch. 12):
//!
//! ```text
//! qr | r I        0     |   | S^½ᵀ  K̄ᵀ |
//!    | (H L̃)ᵀ    L̃ᵀ    | = | 0     Lᵀ  |,      L̃ = [Φ L, √(q t) I]
//! ```
//!
//! Nothing is subtracted, so it keeps its digits under weak priors where a dense covariance
//! filter loses all of them: with a prior 1e9 times the final σ it still agrees with the kernels
//! to 1e-7. A square root of a covariance carries about 16 digits of its *largest* entry, though:
//! from a prior of some 1e11 times the final σ it cannot confirm the kernels to 1e-6 any more,
//! and an evaluation then refuses to answer.
//!
//! It shares no numerics with the [`chain`](super::chain): Φ and Γ come from a Taylor series,
//! moves from Runge–Kutta steps, the drift from the platform-frame equations (3) turned into n.
//! Agreement of the two to 1e-6 is therefore evidence for both.

use faer::linalg::qr::no_pivoting::factor;
use faer::{Mat, Par, dyn_stack};
use nalgebra::{Matrix3, Vector3};

use super::{EndCovariance, split_periods};
use crate::attitude::{EAST, NORTH, Position};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector, DriftMatrix, drift_c};
use crate::error::{Error, Result};
use crate::motion::{Move, Timeline};
use crate::platform::{Platform, Repositioning};
use crate::units::{ARCSEC_PER_RAD, Angle, AngularRate};

/// ψ^n and D.
const STATES: usize = 3 + COEFFICIENTS;
/// ψ_x and ψ_z are measured (9); the vertical channel carries only noise.
const MEASUREMENTS: usize = 2;
/// Rows of the pre-array: measurement noise, states, process noise.
const ROWS: usize = MEASUREMENTS + STATES + 3;
/// Columns of the pre-array.
const COLUMNS: usize = MEASUREMENTS + STATES;

/// What the filter knows at one moment of the test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Time since the start of the test, s.
    pub time_s: f64,
    /// Index of the position being moved to or held.
    pub leg: usize,
    /// 1σ of each coefficient, °/h.
    pub sigma_deg_per_h: CoefficientVector,
}

/// Runs the filter through `timeline`, calling `observe` at the start, after every filter period
/// and after every move, settle and dwell.
///
/// # Errors
///
/// [`Error::is_numerical`] when a covariance is not finite.
pub fn step_by_step(
    platform: &Platform,
    timeline: &Timeline,
    observe: &mut dyn FnMut(&Moment),
) -> Result<EndCovariance> {
    let mut filter = SquareRootFilter::new(platform);
    filter.report(observe);
    for (index, leg) in timeline.legs().iter().enumerate() {
        filter.leg = index;
        if let Some(arrival) = &leg.arrival {
            if platform.motion.repositioning == Repositioning::FrameHold {
                let previous = &timeline.legs()[index - 1].attitude;
                filter.rotate(&(leg.attitude.matrix() * previous.matrix().transpose()));
            } else {
                filter.reposition(arrival, observe);
            }
        }
        let here = Drift::Constant(leg.position);
        filter.advance(here, 0.0, leg.settle_s, false, observe);
        filter.advance(here, 0.0, leg.dwell_s, true, observe);
    }
    filter.end()
}

/// What drives ψ^n over an interval.
#[derive(Clone, Copy)]
enum Drift<'a> {
    Constant(Position),
    Moving(&'a Move),
}

struct SquareRootFilter<'a> {
    platform: &'a Platform,
    /// q, arcsec²/s.
    drift_psd: f64,
    /// r, arcsec.
    noise: f64,
    /// Lᵀ, upper triangular: row k, column state.
    root_t: Mat<f64>,
    /// The pre-array and its scratch, reused.
    array: Mat<f64>,
    coefficients: Mat<f64>,
    scratch: dyn_stack::MemBuffer,
    time_s: f64,
    leg: usize,
    /// The last transition made, for the many equal periods of a dwell.
    cached: Option<(Position, f64, Matrix3<f64>, DriftMatrix)>,
}

impl<'a> SquareRootFilter<'a> {
    fn new(platform: &'a Platform) -> Self {
        let mut root_t = Mat::zeros(STATES, STATES);
        for i in 0..3 {
            root_t[(i, i)] = Angle::from_rad(platform.prior_misalignment_rad[i]).arcsec();
        }
        for i in 0..COEFFICIENTS {
            root_t[(3 + i, 3 + i)] =
                AngularRate::from_rad_per_s(platform.prior_drift_rad_per_s[i]).deg_per_h();
        }
        let block = factor::recommended_block_size::<f64>(ROWS, COLUMNS);
        Self {
            platform,
            drift_psd: platform.drift_psd * ARCSEC_PER_RAD.powi(2),
            noise: Angle::from_rad(platform.noise_g).arcsec(),
            root_t,
            array: Mat::zeros(ROWS, COLUMNS),
            coefficients: Mat::zeros(block, COLUMNS),
            scratch: dyn_stack::MemBuffer::new(factor::qr_in_place_scratch::<f64>(
                ROWS,
                COLUMNS,
                block,
                Par::Seq,
                Default::default(),
            )),
            time_s: 0.0,
            leg: 0,
            cached: None,
        }
    }

    fn reposition(&mut self, m: &Move, observe: &mut dyn FnMut(&Moment)) {
        self.advance(Drift::Moving(m), 0.0, m.duration_s, m.measured, observe);
    }

    /// Advances by `duration_s`; with measurements, in whole periods and a remainder.
    fn advance(
        &mut self,
        drift: Drift<'_>,
        start_s: f64,
        duration_s: f64,
        measured: bool,
        observe: &mut dyn FnMut(&Moment),
    ) {
        if duration_s <= 0.0 {
            return;
        }
        let period = self.platform.period_s;
        let (ticks, remainder) = match measured {
            true => split_periods(duration_s, period),
            false => (0, duration_s),
        };
        for tick in 0..ticks {
            let (phi, b) = self.transition(drift, start_s + tick as f64 * period, period);
            self.update(&phi, &b, period, true);
            self.time_s += period;
            self.report(observe);
        }
        if remainder > 0.0 {
            let done = start_s + ticks as f64 * period;
            let (phi, b) = self.transition(drift, done, remainder);
            self.update(&phi, &b, remainder, false);
            self.time_s += remainder;
            self.report(observe);
        }
    }

    /// Φ and B of an interval, by Taylor series at a position and Runge–Kutta in a move.
    fn transition(
        &mut self,
        drift: Drift<'_>,
        start_s: f64,
        length_s: f64,
    ) -> (Matrix3<f64>, DriftMatrix) {
        let earth = self.platform.earth_rate_n;
        match drift {
            Drift::Constant(position) => {
                if let Some((p, length, phi, b)) = self.cached
                    && p == position
                    && length == length_s
                {
                    return (phi, b);
                }
                let (phi, gamma) = taylor_transition(&earth, length_s);
                let b = gamma * drift_columns(position);
                self.cached = Some((position, length_s, phi, b));
                (phi, b)
            }
            Drift::Moving(m) => runge_kutta_transition(&earth, m, start_s, length_s),
        }
    }

    /// One array step: time update by (Φ, B) over `length_s`, and the measurement if wanted.
    fn update(&mut self, phi: &Matrix3<f64>, b: &DriftMatrix, length_s: f64, measure: bool) {
        self.array.as_mut().fill(0.0);
        let process = (self.drift_psd * length_s).sqrt();
        for k in 0..STATES {
            // Row k of L̃ᵀ = Lᵀ [Φ B; 0 I]ᵀ.
            let row: [f64; STATES] = std::array::from_fn(|j| self.root_t[(k, j)]);
            for i in 0..3 {
                let psi: f64 = (0..3).map(|j| phi[(i, j)] * row[j]).sum();
                let drift: f64 = (0..COEFFICIENTS).map(|j| b[(i, j)] * row[3 + j]).sum();
                self.array[(MEASUREMENTS + k, MEASUREMENTS + i)] = psi + drift;
            }
            for (j, value) in row.iter().enumerate().skip(3) {
                self.array[(MEASUREMENTS + k, MEASUREMENTS + j)] = *value;
            }
        }
        for i in 0..3 {
            self.array[(MEASUREMENTS + STATES + i, MEASUREMENTS + i)] = process;
        }
        for (column, axis) in [NORTH, EAST].into_iter().enumerate() {
            self.array[(column, column)] = self.noise;
            if measure {
                for k in MEASUREMENTS..ROWS {
                    self.array[(k, column)] = self.array[(k, MEASUREMENTS + axis)];
                }
            }
        }
        self.triangularise();
    }

    fn triangularise(&mut self) {
        let info = factor::qr_in_place(
            self.array.as_mut(),
            self.coefficients.as_mut(),
            Par::Seq,
            dyn_stack::MemStack::new(&mut self.scratch),
            Default::default(),
        );
        // Rows past the rank hold nothing: a known state (zero prior) has no row of its own.
        for i in 0..STATES {
            for j in 0..STATES {
                let kept = j >= i && MEASUREMENTS + i < info.rank;
                self.root_t[(i, j)] = match kept {
                    true => self.array[(MEASUREMENTS + i, MEASUREMENTS + j)],
                    false => 0.0,
                };
            }
        }
    }

    /// ψ^n ← Q ψ^n.
    fn rotate(&mut self, q: &Matrix3<f64>) {
        for k in 0..STATES {
            let psi = Vector3::from_fn(|j, _| self.root_t[(k, j)]);
            let turned = q * psi;
            for j in 0..3 {
                self.root_t[(k, j)] = turned[j];
            }
        }
    }

    /// Covariance of states i and j.
    fn covariance(&self, i: usize, j: usize) -> f64 {
        (0..STATES)
            .map(|k| self.root_t[(k, i)] * self.root_t[(k, j)])
            .sum()
    }

    fn report(&self, observe: &mut dyn FnMut(&Moment)) {
        observe(&Moment {
            time_s: self.time_s,
            leg: self.leg,
            sigma_deg_per_h: CoefficientVector::from_fn(|i, _| {
                self.covariance(3 + i, 3 + i).sqrt()
            }),
        });
    }

    fn end(&self) -> Result<EndCovariance> {
        let end = EndCovariance {
            coefficients: CoefficientMatrix::from_fn(|i, j| self.covariance(3 + i, 3 + j)),
            misalignment: Matrix3::from_fn(|i, j| self.covariance(i, j)),
        };
        let finite = |mut values: std::slice::Iter<'_, f64>| values.all(|v| v.is_finite());
        if finite(end.coefficients.as_slice().iter()) && finite(end.misalignment.as_slice().iter())
        {
            Ok(end)
        } else {
            Err(Error::numerical(
                "the square-root filter overflows double precision: the noises, the prior and \
                 the durations are too far apart to give a trustworthy number",
            ))
        }
    }
}

/// A by its columns: what each coefficient alone does to ε^n, from the platform-frame equations.
fn drift_columns(position: Position) -> DriftMatrix {
    let attitude = position.attitude();
    let gravity = attitude.gravity_c();
    let mut a = DriftMatrix::zeros();
    for i in 0..COEFFICIENTS {
        let mut unit = CoefficientVector::zeros();
        unit[i] = 1.0;
        a.set_column(i, &(attitude.matrix() * drift_c(&unit, &gravity)));
    }
    a
}

/// F = −[ω ×].
fn system_matrix(earth_rate: &Vector3<f64>) -> Matrix3<f64> {
    -earth_rate.cross_matrix()
}

/// Φ and Γ by their Taylor series, in chunks short enough for it to converge fast.
fn taylor_transition(earth_rate: &Vector3<f64>, length_s: f64) -> (Matrix3<f64>, Matrix3<f64>) {
    const LONGEST_S: f64 = 1000.0;
    let chunks = (length_s / LONGEST_S).ceil().max(1.0);
    let t = length_s / chunks;
    let f = system_matrix(earth_rate);
    let (mut phi, mut gamma) = (Matrix3::zeros(), Matrix3::zeros());
    let mut term = Matrix3::identity();
    for k in 1..25 {
        phi += term;
        gamma += term * (t / f64::from(k));
        term = f * term * (t / f64::from(k));
    }
    let (mut whole_phi, mut whole_gamma) = (Matrix3::identity(), Matrix3::zeros());
    for _ in 0..chunks as usize {
        whole_gamma = phi * whole_gamma + gamma;
        whole_phi = phi * whole_phi;
    }
    (whole_phi, whole_gamma)
}

/// Φ and B of an interval of a move by the classical Runge–Kutta method on
/// d[Φ B]/dt = F [Φ B] + [0 A(t)].
fn runge_kutta_transition(
    earth_rate: &Vector3<f64>,
    m: &Move,
    start_s: f64,
    length_s: f64,
) -> (Matrix3<f64>, DriftMatrix) {
    /// Turn per step, rad (0.25°), and longest step, s: local error below 1e-9.
    const STEP_RAD: f64 = 0.0044;
    const STEP_S: f64 = 50.0;
    let turn = m.change.iter().map(|c| c.abs()).sum::<f64>() * length_s / m.duration_s;
    let steps = (turn / STEP_RAD).max(length_s / STEP_S).ceil().max(1.0);
    let h = length_s / steps;
    let f = system_matrix(earth_rate);
    let a_at = |t: f64| {
        drift_columns(Position::from_array(
            m.angles_at((start_s + t) / m.duration_s),
        ))
    };
    let (mut phi, mut b) = (Matrix3::identity(), DriftMatrix::zeros());
    let mut a0 = a_at(0.0);
    for step in 0..steps as usize {
        let t = step as f64 * h;
        let (a_mid, a1) = (a_at(t + 0.5 * h), a_at(t + h));
        let k1 = f * b + a0;
        let k2 = f * (b + k1 * (0.5 * h)) + a_mid;
        let k3 = f * (b + k2 * (0.5 * h)) + a_mid;
        let k4 = f * (b + k3 * h) + a1;
        b += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
        a0 = a1;
        let p1 = f * phi;
        let p2 = f * (phi + p1 * (0.5 * h));
        let p3 = f * (phi + p2 * (0.5 * h));
        let p4 = f * (phi + p3 * h);
        phi += (p1 + p2 * 2.0 + p3 * 2.0 + p4) * (h / 6.0);
    }
    (phi, b)
}
