//! The step-by-step square-root filter on faer: the independent check, and the convergence.
//!
//! It visits every filter period of the test with a square root of the *information* on the 15
//! states (ψ^n, D/s), s the prior σ of each coefficient: rows of unit noise (Bierman,
//! *Factorization Methods for Discrete Sequential Estimation*, 1977, ch. V–VI), three on ψ^n and
//! D, twelve on D alone. A period adds the process noise √(q t) v to ψ^n, v of unit size; then
//! come the rows of the measurement. Eliminating v, and ψ^n from what is left over, by QR
//! factorisations leaves three rows on ψ^n and D again, and two more on D alone:
//!
//! ```text
//! | I               0        0               |      | R_ψ   R_D |      | R  |
//! | −√(q t) R_ψ Φ⁻¹  R_ψ Φ⁻¹  R_D − R_ψ Φ⁻¹ B |  →   | H / r  0  |  →   | R' |
//! ```
//!
//! What is known of D alone passes through no time update. Its rows are sorted by size and the
//! columns pivoted, which makes Householder QR backward stable row by row (Cox & Higham,
//! *Stability of Householder QR factorization for weighted least squares problems*, 1998). So what
//! only the prior knows keeps its digits beside what the measurements tell 1e16 times better; a
//! square root of the covariance, which carries the digits of its largest entry, loses them. A
//! coefficient known exactly has s = 0: its column is zero, and it stays known. A misalignment
//! known exactly is one known to 1e-9 of the noise of a measurement.
//!
//! # What it shares with the kernels, and what not
//!
//! Of its own are: the attitude, as the product of three turns, with its own sines; the gyros, by
//! their input, output and spin axes in (3); whole filter periods (`instrument`); Φ and Γ, by a
//! Taylor series; the drift integral of a move, by Runge–Kutta steps; every factorisation, faer's.
//! It knows nothing of dwells, of gains, or of covariance. Shared with the
//! [`chain`](super::chain) are:
//!
//! - the [`Timeline`]: which way a move takes, how long it takes, when settling and dwells are;
//! - the [`Platform`] in SI, the Earth rate in n, and the units (arcsec, °/h) of the states;
//! - the equations themselves, (2), (3), (9), and the rule for when the filter measures;
//! - the type of number with 32 digits, and products and sums of small matrices of it.
//!
//! Agreement of the two to 1e-6 is evidence for all but these.

mod elimination;
pub(crate) mod instrument;
mod transition;

use nalgebra::Matrix3;

use elimination::{DriftInformation, Elimination};
use instrument::Instrument;
use transition::{runge_kutta_integral, taylor_transition};

use super::real::{
    Dense, Extended, Real, convert, identity, inverse_of_triangle, product, sum, transposed, zeros,
};
use super::{CovarianceRoot, EndCovariance};
use crate::attitude::{EAST, NORTH, Position, UP};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector};
use crate::error::{Error, Result};
use crate::motion::{Move, Timeline};
use crate::platform::{Platform, Repositioning};
use crate::units::{ARCSEC_PER_RAD, Angle, AngularRate};

/// ψ^n and D.
const STATES: usize = 3 + COEFFICIENTS;
/// Process noise of a step, one for each ψ.
const NOISES: usize = 3;
/// ψ_x and ψ_z are measured (9); the vertical channel carries only noise.
const MEASUREMENTS: usize = 2;
/// Order of elimination of ψ^n: what is measured first.
const ORDER: [usize; 3] = [NORTH, EAST, UP];
/// A row of unit noise on (ψ^n, D/s), ψ^n in [`ORDER`].
type Row<T> = [T; STATES];

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
    run::<f64>(platform, &Instrument::PAPER, timeline, observe)
}

/// The same in numbers of 32 digits, some thirty times slower: for weak priors beside strong
/// measurements. Of moves that take time the drift integral is known to nine digits all the same.
///
/// # Errors
///
/// As [`step_by_step`].
pub fn step_by_step_extended(
    platform: &Platform,
    timeline: &Timeline,
    observe: &mut dyn FnMut(&Moment),
) -> Result<EndCovariance> {
    run::<Extended>(platform, &Instrument::PAPER, timeline, observe)
}

/// The filter in numbers `T`, on what it is told the instrument is.
pub(crate) fn run<T: Real>(
    platform: &Platform,
    instrument: &Instrument,
    timeline: &Timeline,
    observe: &mut dyn FnMut(&Moment),
) -> Result<EndCovariance> {
    let mut filter = SquareRootFilter::<T>::new(platform, instrument);
    filter.report(observe);
    for (index, leg) in timeline.legs().iter().enumerate() {
        filter.leg = index;
        if let Some(arrival) = &leg.arrival {
            if platform.motion.repositioning == Repositioning::FrameHold {
                let previous = instrument.attitude::<T>(timeline.legs()[index - 1].position);
                let here = instrument.attitude::<T>(leg.position);
                let turn = product(&here, &transposed(&previous));
                filter.rotate(&turn);
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

struct SquareRootFilter<'a, T: Real> {
    platform: &'a Platform,
    instrument: &'a Instrument,
    /// q, arcsec²/s.
    drift_psd: f64,
    /// r, arcsec.
    noise: f64,
    /// s, °/h.
    prior_sigma: CoefficientVector,
    /// What is known of ψ^n and D.
    misalignment: [Row<T>; 3],
    /// What is known of D alone.
    drift: DriftInformation<T>,
    noise_elimination: Elimination<T>,
    misalignment_elimination: Elimination<T>,
    time_s: f64,
    leg: usize,
    /// The last transition made, for the many equal periods of a dwell.
    cached: Option<(Position, f64, Transition<T>)>,
}

/// Φ and B of an interval.
type Transition<T> = (Dense<T, 3, 3>, Dense<T, 3, COEFFICIENTS>);

impl<'a, T: Real> SquareRootFilter<'a, T> {
    fn new(platform: &'a Platform, instrument: &'a Instrument) -> Self {
        let noise = Angle::from_rad(platform.noise_g).arcsec();
        let mut misalignment = [[T::from(0.0); STATES]; 3];
        for (i, axis) in ORDER.into_iter().enumerate() {
            let sigma = Angle::from_rad(platform.prior_misalignment_rad[axis]).arcsec();
            misalignment[i][i] = T::from(1.0) / T::from(sigma.max(T::KNOWN * noise));
        }
        Self {
            platform,
            instrument,
            drift_psd: platform.drift_psd * ARCSEC_PER_RAD.powi(2),
            noise,
            prior_sigma: platform
                .prior_drift_rad_per_s
                .map(|v| AngularRate::from_rad_per_s(v).deg_per_h()),
            misalignment,
            drift: DriftInformation::new(MEASUREMENTS),
            noise_elimination: Elimination::new(NOISES + 3, NOISES + STATES, NOISES),
            misalignment_elimination: Elimination::new(3 + MEASUREMENTS, STATES, 3),
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
            true => (self.instrument.split)(duration_s, period),
            false => (0, duration_s),
        };
        for tick in 0..ticks {
            let transition = self.transition(drift, start_s + tick as f64 * period, period);
            self.update(&transition, period, true);
            self.time_s += period;
            self.report(observe);
        }
        if remainder > 0.0 {
            let done = start_s + ticks as f64 * period;
            let transition = self.transition(drift, done, remainder);
            self.update(&transition, remainder, false);
            self.time_s += remainder;
            self.report(observe);
        }
    }

    /// Φ and B of an interval.
    fn transition(&mut self, drift: Drift<'_>, start_s: f64, length_s: f64) -> Transition<T> {
        let earth = self.platform.earth_rate_n;
        match drift {
            Drift::Constant(position) => {
                if let Some((p, length, transition)) = self.cached
                    && p == position
                    && length == length_s
                {
                    return transition;
                }
                let (phi, gamma) = taylor_transition(&earth, length_s);
                let transition = (
                    phi,
                    product(&gamma, &self.instrument.drift_columns(position)),
                );
                self.cached = Some((position, length_s, transition));
                transition
            }
            Drift::Moving(m) => {
                let b = runge_kutta_integral(self.instrument, &earth, m, (start_s, length_s));
                let (phi, _) = taylor_transition(&earth, length_s);
                (phi, convert(|i, j| b[i][j]))
            }
        }
    }

    /// One step: time update by (Φ, B) over `length_s`, and the measurement if wanted.
    fn update(&mut self, (phi, b): &Transition<T>, length_s: f64, measure: bool) {
        self.propagate(phi, b);
        let process = (self.drift_psd * length_s).sqrt();
        if process > 0.0 {
            self.diffuse(T::from(process));
        }
        if measure {
            self.measure();
        }
    }

    /// ψ^n ← Φ ψ^n + B D.
    fn propagate(&mut self, phi: &Dense<T, 3, 3>, b: &Dense<T, 3, COEFFICIENTS>) {
        // F is skew, so Φ is a rotation.
        self.rotate(phi);
        let in_order = ORDER.map(|axis| b[axis]);
        let mut own = zeros::<T, 3, 3>();
        for (own, row) in own.iter_mut().zip(&self.misalignment) {
            own.copy_from_slice(&row[..3]);
        }
        let drift = product(&own, &in_order);
        for (row, drift) in self.misalignment.iter_mut().zip(&drift) {
            let scaled = drift.iter().zip(self.prior_sigma.iter());
            for (value, (drift, sigma)) in row[3..].iter_mut().zip(scaled) {
                *value -= *drift * T::from(*sigma);
            }
        }
    }

    /// ψ^n ← ψ^n + `process` v.
    fn diffuse(&mut self, process: T) {
        let mut rows = [[T::from(0.0); NOISES + STATES]; NOISES + 3];
        for (i, row) in self.misalignment.iter().enumerate() {
            rows[i][i] = T::from(1.0);
            let driven = &mut rows[NOISES + i];
            for k in 0..NOISES {
                driven[k] = -process * row[k];
            }
            driven[NOISES..].copy_from_slice(row);
        }
        self.noise_elimination.run(&mut rows);
        for (row, left) in self.misalignment.iter_mut().zip(&rows[NOISES..]) {
            row.copy_from_slice(&left[NOISES..]);
        }
    }

    /// Takes a measurement of ψ_x and ψ_z.
    fn measure(&mut self) {
        let mut rows = [[T::from(0.0); STATES]; 3 + MEASUREMENTS];
        rows[..3].copy_from_slice(&self.misalignment);
        // They come first in the order.
        for i in 0..MEASUREMENTS {
            rows[3 + i][i] = T::from(1.0) / T::from(self.noise);
        }
        self.misalignment_elimination.run(&mut rows);
        self.misalignment.copy_from_slice(&rows[..3]);
        let [.., first, second] = &rows;
        self.drift
            .add::<{ COEFFICIENTS + MEASUREMENTS }>(&[&first[3..], &second[3..]]);
    }

    /// ψ^n ← Q ψ^n.
    fn rotate(&mut self, q: &Dense<T, 3, 3>) {
        for row in &mut self.misalignment {
            let turned: [T; 3] = ORDER.map(|to| {
                let parts = ORDER.iter().zip(&*row).map(|(&from, v)| *v * q[to][from]);
                parts.fold(T::from(0.0), |sum, part| sum + part)
            });
            row[..3].copy_from_slice(&turned);
        }
    }

    /// L with P_D = L Lᵀ, °/h.
    fn drift_root(&self) -> CoefficientMatrix {
        let root = self.drift.covariance_root();
        CoefficientMatrix::from_fn(|i, j| root[i][j].f64() * self.prior_sigma[i])
    }

    /// Covariance of ψ^n, from that of D/s by its root.
    fn misalignment_covariance(&self) -> Matrix3<f64> {
        let mut rows = self.misalignment;
        Elimination::new(3, STATES, 3).run(&mut rows);
        let own = inverse_of_triangle(&rows.map(|[x, z, y, ..]| [x, z, y]));
        let mut by_drift = zeros::<T, 3, COEFFICIENTS>();
        for (by_drift, row) in by_drift.iter_mut().zip(&rows) {
            by_drift.copy_from_slice(&row[3..]);
        }
        let drift = product(&product(&own, &by_drift), &self.drift.covariance_root());
        let ordered = sum(
            product(&own, &transposed(&own)),
            &product(&drift, &transposed(&drift)),
        );
        let mut covariance = Matrix3::zeros();
        for i in 0..3 {
            for j in 0..3 {
                covariance[(ORDER[i], ORDER[j])] = ordered[i][j].f64();
            }
        }
        covariance
    }

    fn report(&self, observe: &mut dyn FnMut(&Moment)) {
        let root = self.drift_root();
        observe(&Moment {
            time_s: self.time_s,
            leg: self.leg,
            sigma_deg_per_h: CoefficientVector::from_fn(|i, _| root.row(i).norm()),
        });
    }

    fn end(&self) -> Result<EndCovariance> {
        let root = self.drift_root();
        let end = EndCovariance {
            coefficients: root * root.transpose(),
            root: CovarianceRoot::new(root, *self.drift.order()),
            misalignment: self.misalignment_covariance(),
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
