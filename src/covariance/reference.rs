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
//! It shares no numerics with the [`chain`](super::chain): Φ and Γ come from a Taylor series,
//! moves from Runge–Kutta steps, the drift from the platform-frame equations (3) turned into n;
//! and it knows nothing of dwells, of gains, or of covariance.
//! Agreement of the two to 1e-6 is therefore evidence for both.

use faer::linalg::householder;
use faer::linalg::qr::{col_pivoting, no_pivoting};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Conj, Mat, Par, dyn_stack};
use nalgebra::{Matrix3, Vector3};

use super::{EndCovariance, split_periods};
use crate::attitude::{EAST, NORTH, Position, UP};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector, DriftMatrix, drift_c};
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
/// σ of a misalignment component known exactly, in units of the measurement noise: its share of
/// any variance is below 1e-12 even after a million measurements.
pub(crate) const KNOWN: f64 = 1e-9;

/// A row of unit noise on (ψ^n, D/s), ψ^n in [`ORDER`].
type Row = [f64; STATES];

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
    /// s, °/h.
    prior_sigma: CoefficientVector,
    /// What is known of ψ^n and D.
    misalignment: [Row; 3],
    /// What is known of D alone.
    drift: DriftInformation,
    noise_elimination: Elimination,
    misalignment_elimination: Elimination,
    time_s: f64,
    leg: usize,
    /// The last transition made, for the many equal periods of a dwell.
    cached: Option<(Position, f64, Matrix3<f64>, DriftMatrix)>,
}

impl<'a> SquareRootFilter<'a> {
    fn new(platform: &'a Platform) -> Self {
        let noise = Angle::from_rad(platform.noise_g).arcsec();
        let mut misalignment = [[0.0; STATES]; 3];
        for (i, axis) in ORDER.into_iter().enumerate() {
            let sigma = Angle::from_rad(platform.prior_misalignment_rad[axis]).arcsec();
            misalignment[i][i] = sigma.max(KNOWN * noise).recip();
        }
        Self {
            platform,
            drift_psd: platform.drift_psd * ARCSEC_PER_RAD.powi(2),
            noise,
            prior_sigma: platform
                .prior_drift_rad_per_s
                .map(|v| AngularRate::from_rad_per_s(v).deg_per_h()),
            misalignment,
            drift: DriftInformation::new(),
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

    /// One step: time update by (Φ, B) over `length_s`, and the measurement if wanted.
    fn update(&mut self, phi: &Matrix3<f64>, b: &DriftMatrix, length_s: f64, measure: bool) {
        self.propagate(phi, b);
        let process = (self.drift_psd * length_s).sqrt();
        if process > 0.0 {
            self.diffuse(process);
        }
        if measure {
            self.measure();
        }
    }

    /// ψ^n ← Φ ψ^n + B D.
    fn propagate(&mut self, phi: &Matrix3<f64>, b: &DriftMatrix) {
        // F is skew, so Φ is a rotation.
        self.rotate(phi);
        for row in &mut self.misalignment {
            for j in 0..COEFFICIENTS {
                let drift: f64 = (0..3).map(|i| row[i] * b[(ORDER[i], j)]).sum();
                row[3 + j] -= drift * self.prior_sigma[j];
            }
        }
    }

    /// ψ^n ← ψ^n + `process` v.
    fn diffuse(&mut self, process: f64) {
        let mut rows = [[0.0; NOISES + STATES]; NOISES + 3];
        for (i, row) in self.misalignment.iter().enumerate() {
            rows[i][i] = 1.0;
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
        let mut rows = [[0.0; STATES]; 3 + MEASUREMENTS];
        rows[..3].copy_from_slice(&self.misalignment);
        // They come first in the order.
        for i in 0..MEASUREMENTS {
            rows[3 + i][i] = self.noise.recip();
        }
        self.misalignment_elimination.run(&mut rows);
        self.misalignment.copy_from_slice(&rows[..3]);
        self.drift.add(&rows[3..]);
    }

    /// ψ^n ← Q ψ^n.
    fn rotate(&mut self, q: &Matrix3<f64>) {
        for row in &mut self.misalignment {
            let turned: [f64; 3] = ORDER.map(|to| (0..3).map(|i| row[i] * q[(to, ORDER[i])]).sum());
            row[..3].copy_from_slice(&turned);
        }
    }

    /// L with P_D = L Lᵀ, °/h.
    fn drift_root(&self) -> CoefficientMatrix {
        let mut root = self.drift.covariance_root();
        for (mut row, sigma) in root.row_iter_mut().zip(self.prior_sigma.iter()) {
            row *= *sigma;
        }
        root
    }

    /// Covariance of ψ^n, from that of D/s by its root.
    fn misalignment_covariance(&self) -> Matrix3<f64> {
        let rows = &self.misalignment;
        let mut inverse = Matrix3::identity();
        let own = Matrix3::from_fn(|i, j| rows[i][j]);
        if !own.col_piv_qr().solve_mut(&mut inverse) {
            inverse.fill(f64::NAN);
        }
        let from_drift = DriftMatrix::from_fn(|i, j| rows[i][3 + j]) * self.drift.covariance_root();
        let (own, drift) = (inverse, inverse * from_drift);
        let ordered = own * own.transpose() + drift * drift.transpose();
        let mut covariance = Matrix3::zeros();
        for i in 0..3 {
            for j in 0..3 {
                covariance[(ORDER[i], ORDER[j])] = ordered[(i, j)];
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

/// Block size of the Householder factors: these matrices are small.
const BLOCK: usize = 1;

/// Eliminates the first columns of a few rows, with the memory for it.
struct Elimination {
    matrix: Mat<f64>,
    factors: Mat<f64>,
    scratch: dyn_stack::MemBuffer,
}

impl Elimination {
    /// Of `width` columns of `rows` rows of `columns` entries.
    fn new(rows: usize, columns: usize, width: usize) -> Self {
        let factor = no_pivoting::factor::qr_in_place_scratch::<f64>(
            rows,
            width,
            BLOCK,
            Par::Seq,
            Default::default(),
        );
        let apply =
            householder::apply_block_householder_sequence_transpose_on_the_left_in_place_scratch::<
                f64,
            >(rows, BLOCK, columns - width);
        Self {
            matrix: Mat::zeros(rows, columns),
            factors: Mat::zeros(BLOCK, width),
            scratch: dyn_stack::MemBuffer::new(factor.or(apply)),
        }
    }

    /// Turns `rows` so that all but the first hold nothing of the columns to eliminate.
    fn run<const N: usize>(&mut self, rows: &mut [[f64; N]]) {
        let width = self.factors.ncols();
        put_sorted(&mut self.matrix, rows, width);
        let (mut eliminated, mut rest) = self.matrix.as_mut().split_at_col_mut(width);
        let _rank = no_pivoting::factor::qr_in_place(
            eliminated.rb_mut(),
            self.factors.as_mut(),
            Par::Seq,
            dyn_stack::MemStack::new(&mut self.scratch),
            Default::default(),
        );
        householder::apply_block_householder_sequence_transpose_on_the_left_in_place_with_conj(
            eliminated.rb(),
            self.factors.as_ref(),
            Conj::No,
            rest.rb_mut(),
            Par::Seq,
            dyn_stack::MemStack::new(&mut self.scratch),
        );
        for (i, row) in rows.iter_mut().enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                // Below the diagonal are the Householder vectors.
                *value = match j < width && i > j {
                    true => 0.0,
                    false => self.matrix[(i, j)],
                };
            }
        }
    }
}

/// Twelve rows of unit noise on D/s, the prior among them.
struct DriftInformation {
    /// Upper triangular in the order of the pivots.
    triangle: CoefficientMatrix,
    /// Which coefficient each column is.
    order: [usize; COEFFICIENTS],
    matrix: Mat<f64>,
    factors: Mat<f64>,
    scratch: dyn_stack::MemBuffer,
}

impl DriftInformation {
    /// The prior.
    fn new() -> Self {
        const ROWS: usize = COEFFICIENTS + MEASUREMENTS;
        Self {
            triangle: CoefficientMatrix::identity(),
            order: std::array::from_fn(|i| i),
            matrix: Mat::zeros(ROWS, COEFFICIENTS),
            factors: Mat::zeros(BLOCK, COEFFICIENTS),
            scratch: dyn_stack::MemBuffer::new(col_pivoting::factor::qr_in_place_scratch::<
                usize,
                f64,
            >(
                ROWS,
                COEFFICIENTS,
                BLOCK,
                Par::Seq,
                Default::default(),
            )),
        }
    }

    /// Adds the drift's part of two rows.
    fn add(&mut self, new: &[Row]) {
        let mut rows = [[0.0; COEFFICIENTS]; COEFFICIENTS + MEASUREMENTS];
        for (i, row) in rows.iter_mut().take(COEFFICIENTS).enumerate() {
            for (pivot, &column) in self.order.iter().enumerate().skip(i) {
                row[column] = self.triangle[(i, pivot)];
            }
        }
        for (row, new) in rows.iter_mut().skip(COEFFICIENTS).zip(new) {
            row.copy_from_slice(&new[3..]);
        }
        put_sorted(&mut self.matrix, &mut rows, COEFFICIENTS);
        let mut inverse = [0; COEFFICIENTS];
        let _transpositions = col_pivoting::factor::qr_in_place(
            self.matrix.as_mut(),
            self.factors.as_mut(),
            &mut self.order,
            &mut inverse,
            Par::Seq,
            dyn_stack::MemStack::new(&mut self.scratch),
            Default::default(),
        );
        for pivot in 0..COEFFICIENTS {
            for i in 0..=pivot {
                self.triangle[(i, pivot)] = self.matrix[(i, pivot)];
            }
        }
    }

    /// L with L Lᵀ the covariance of D/s.
    fn covariance_root(&self) -> CoefficientMatrix {
        let mut inverse = CoefficientMatrix::identity();
        if !self.triangle.solve_upper_triangular_mut(&mut inverse) {
            inverse.fill(f64::NAN);
        }
        let mut root = CoefficientMatrix::zeros();
        for (pivot, &coefficient) in self.order.iter().enumerate() {
            root.set_row(coefficient, &inverse.row(pivot));
        }
        root
    }
}

/// Copies `rows` into `matrix`, the largest in their first `width` entries first.
fn put_sorted<const N: usize>(matrix: &mut Mat<f64>, rows: &mut [[f64; N]], width: usize) {
    let size = |row: &[f64; N]| row[..width].iter().fold(0.0_f64, |max, v| max.max(v.abs()));
    rows.sort_by(|a, b| size(b).total_cmp(&size(a)));
    for (i, row) in rows.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            matrix[(i, j)] = *value;
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
