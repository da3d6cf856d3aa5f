//! The kernels and the chain in numbers of 32 digits: for weak priors beside strong
//! measurements.
//!
//! Rows that tell the same combination again must be dependent. In doubles they are so to the
//! sixteenth digit only, and what is left over after elimination, 1e-16 of a row, counts as
//! information on combinations that no measurement told anything of. Against a prior of unit size
//! that matters as soon as a row is longer than some 1e13. The same holds for C_c^n, orthogonal
//! to the sixteenth digit, and for a right angle whose cosine is 6e-17. So attitudes, kernels and
//! chain are worked out here again, by the formulas of [`kernel`](super::kernel) and
//! [`chain`](super::chain), with 1e-32 in place of 1e-16. Drift integrals of moves that take time
//! are taken over from doubles.

use nalgebra::Matrix3;

use super::real::{
    Dense, Extended, Real, convert, identity, inverse_of_triangle, product, sin_cos, sum, times,
    transposed, zeros,
};
use super::{CovarianceModel, CovarianceRoot, EndCovariance, not_finite, split_periods};
use crate::attitude::{EAST, NORTH, Position, UP};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, DriftCoefficient};
use crate::error::Result;
use crate::motion::{Leg, Move, Timeline};

type Square = Dense<Extended, 3, 3>;
type Drive = Dense<Extended, 3, COEFFICIENTS>;

impl CovarianceModel {
    /// The covariance at the end of `timeline` by the filter's tick rule.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows.
    pub(crate) fn end_covariance_extended(&self, timeline: &Timeline) -> Result<EndCovariance> {
        let mut chain = Chain::new(self);
        let legs = timeline.legs();
        for (index, leg) in legs.iter().enumerate() {
            if let Some(arrival) = &leg.arrival {
                chain.arrive(arrival, leg, &legs[index - 1]);
            }
            chain.dwell(leg);
        }
        chain.end()
    }
}

/// V, a root of P, and the information on D/s, s the prior σ.
struct Chain<'a> {
    model: &'a CovarianceModel,
    v: Drive,
    /// G with G Gᵀ = P.
    g: Square,
    information: Dense<Extended, COEFFICIENTS, COEFFICIENTS>,
    /// Elements of 2^k periods.
    doublings: Vec<Element>,
}

impl<'a> Chain<'a> {
    fn new(model: &'a CovarianceModel) -> Self {
        let mut g = zeros();
        for (i, row) in g.iter_mut().enumerate() {
            row[i] = Extended::from(model.prior_psi[(i, i)]).sqrt();
        }
        Self {
            model,
            v: zeros(),
            g,
            information: zeros(),
            doublings: vec![Element::one_period(model)],
        }
    }

    fn arrive(&mut self, arrival: &Move, leg: &Leg, previous: &Leg) {
        if self.model.frame_hold {
            let previous = Extended::attitude(previous.position);
            let turn = product(&Extended::attitude(leg.position), &transposed(&previous));
            self.v = product(&turn, &self.v);
            self.g = product(&turn, &self.g);
        } else if arrival.measured && arrival.duration_s > 0.0 {
            let period = self.model.period_s;
            let (ticks, remainder) = split_periods(arrival.duration_s, period);
            for tick in 0..ticks {
                self.moving(arrival, tick as f64 * period, period);
                self.measure();
            }
            self.moving(arrival, ticks as f64 * period, remainder);
        } else {
            self.moving(arrival, 0.0, arrival.duration_s);
        }
        self.wait(leg.position, leg.settle_s);
    }

    fn dwell(&mut self, leg: &Leg) {
        let (periods, remainder) = split_periods(leg.dwell_s, self.model.period_s);
        if periods > 0 {
            let element = self.element(periods);
            self.dwell_periods(leg.position, &element);
        }
        self.wait(leg.position, remainder);
    }

    fn element(&mut self, periods: usize) -> Element {
        let mut element = Element::identity();
        let mut left = periods;
        for k in 0.. {
            if left == 0 {
                break;
            }
            if k == self.doublings.len() {
                let half = self.doublings[k - 1];
                self.doublings.push(half.then(&half));
            }
            if left & 1 == 1 {
                element = element.then(&self.doublings[k]);
            }
            left >>= 1;
        }
        element
    }

    fn dwell_periods(&mut self, position: Position, k: &Element) {
        let a = drift_matrix(position);
        let [r11, r12, r22] = [(0, 0), (0, 3), (3, 3)].map(|(i, j)| k.block(i, j));
        let t = sum(product(&r11, &self.v), &product(&r12, &a));
        self.condition(&r11, &t);
        self.add(&product(&r22, &a));
        self.v = sum(product(&k.a_psi, &self.v), &product(&k.a_epsilon, &a));
        self.g = add_roots(&product(&k.a_psi, &self.g), &k.u);
    }

    /// Takes the measurement of `h` ψ^n, which is `t` D more, both with unit noise.
    fn condition(&mut self, h: &Square, t: &Drive) {
        let through = product(h, &self.g);
        let whitened = solve_transposed(&one_and(&transposed(&through)), t);
        self.add(&whitened);
        self.g = product(&self.g, &inverse_of_triangle(&one_and(&through)));
        // V₊ = V − P₊ Hᵀ T.
        let gain = product(&self.g, &product(&transposed(&self.g), &transposed(h)));
        self.v = sum(self.v, &times(product(&gain, t), Extended::from(-1.0)));
    }

    /// A measurement of ψ_x, ψ_z.
    fn measure(&mut self) {
        let root = Extended::from(self.model.noise_variance).sqrt().recip();
        let mut h = zeros();
        h[NORTH][NORTH] = root;
        h[EAST][EAST] = root;
        let t = product(&h, &self.v);
        self.condition(&h, &t);
    }

    /// Time at a position without a measurement.
    fn wait(&mut self, position: Position, length_s: f64) {
        if length_s > 0.0 {
            let (_, gamma) = transition(self.model, length_s);
            self.pass(length_s, &product(&gamma, &drift_matrix(position)));
        }
    }

    /// An interval of a move.
    fn moving(&mut self, m: &Move, start_s: f64, length_s: f64) {
        if length_s > 0.0 {
            let b = m.drift_integral(&self.model.dynamics, start_s, length_s);
            self.pass(length_s, &convert(|i, j| b[(i, j)]));
        }
    }

    fn pass(&mut self, length_s: f64, b: &Drive) {
        let (phi, _) = transition(self.model, length_s);
        self.v = sum(product(&phi, &self.v), b);
        let process = Extended::from(self.model.drift_psd * length_s).sqrt();
        self.g = add_roots(&product(&phi, &self.g), &times(identity(), process));
    }

    /// Three rows of unit noise on D.
    fn add(&mut self, rows: &Drive) {
        let mut scaled = *rows;
        for row in &mut scaled {
            for (value, sigma) in row.iter_mut().zip(self.model.prior_sigma.iter()) {
                *value *= Extended::from(*sigma);
            }
        }
        self.information = triangle(self.information.iter().chain(&scaled));
    }

    fn end(self) -> Result<EndCovariance> {
        let prior = identity::<Extended, COEFFICIENTS>();
        let whole = triangle(self.information.iter().chain(&prior));
        let mut root = inverse_of_triangle(&whole);
        for (row, sigma) in root.iter_mut().zip(self.model.prior_sigma.iter()) {
            row.iter_mut().for_each(|v| *v *= Extended::from(*sigma));
        }
        let coefficients = product(&root, &transposed(&root));
        let through_drift = product(&self.v, &root);
        let misalignment = sum(
            product(&self.g, &transposed(&self.g)),
            &product(&through_drift, &transposed(&through_drift)),
        );
        let end = EndCovariance {
            coefficients: CoefficientMatrix::from_fn(|i, j| coefficients[i][j].f64()),
            root: CovarianceRoot::new(
                CoefficientMatrix::from_fn(|i, j| root[i][j].f64()),
                std::array::from_fn(|i| i),
            ),
            misalignment: Matrix3::from_fn(|i, j| misalignment[i][j].f64()),
        };
        let numbers = end.coefficients.iter().chain(end.misalignment.iter());
        match numbers.copied().all(f64::is_finite) {
            true => Ok(end),
            false => Err(not_finite()),
        }
    }
}

/// The element of n periods, as in [`kernel`](super::kernel).
#[derive(Clone, Copy)]
struct Element {
    w: Dense<Extended, 6, 6>,
    a_psi: Square,
    a_epsilon: Square,
    u: Square,
}

impl Element {
    fn identity() -> Self {
        Self {
            w: zeros(),
            a_psi: identity(),
            a_epsilon: zeros(),
            u: zeros(),
        }
    }

    fn one_period(model: &CovarianceModel) -> Self {
        let (phi, gamma) = transition(model, model.period_s);
        let process = Extended::from(model.drift_psd) * Extended::from(model.period_s);
        let noise = Extended::from(model.noise_variance);
        let innovation_sigma = (noise + process).sqrt();
        let mut w = zeros();
        for (row, axis) in [NORTH, EAST].into_iter().enumerate() {
            for j in 0..3 {
                w[row][j] = phi[axis][j] / innovation_sigma;
                w[row][3 + j] = gamma[axis][j] / innovation_sigma;
            }
        }
        // Given the measurement, the measured directions of the process noise shrink.
        let mut keep = identity();
        for axis in [NORTH, EAST] {
            keep[axis][axis] = noise / (noise + process);
        }
        let mut u = zeros();
        for (i, row) in u.iter_mut().enumerate() {
            row[i] = (keep[i][i] * process).sqrt();
        }
        Self {
            w,
            a_psi: product(&keep, &phi),
            a_epsilon: product(&keep, &gamma),
            u,
        }
    }

    /// This element, then `next`.
    fn then(&self, next: &Self) -> Self {
        let w2_psi: Dense<_, 6, 3> = next.columns(0);
        let seen_psi = product(&w2_psi, &self.a_psi);
        let seen_epsilon = sum(product(&w2_psi, &self.a_epsilon), &next.columns(3));
        let seen: Dense<_, 6, 6> = std::array::from_fn(|i| {
            let (psi, epsilon) = (seen_psi[i], seen_epsilon[i]);
            std::array::from_fn(|j| if j < 3 { psi[j] } else { epsilon[j - 3] })
        });
        let through_noise = product(&w2_psi, &self.u);
        let whitened = solve_transposed(&one_and(&transposed(&through_noise)), &seen);
        let shrink = inverse_of_triangle(&one_and(&through_noise));
        let conditional = product(&self.u, &shrink);
        // (I + C̃1 J2)⁻¹ Φ̃1 = Φ̃1 − U1 (I + U1ᵀ J2 U1)⁻¹ U1ᵀ J2 Φ̃1.
        let gain = product(
            &product(&conditional, &transposed(&shrink)),
            &transposed(&through_noise),
        );
        let less = |a: &Square, seen: &Dense<Extended, 6, 3>| {
            sum(*a, &times(product(&gain, seen), Extended::from(-1.0)))
        };
        let start_psi = less(&self.a_psi, &seen_psi);
        let start_epsilon = less(&self.a_epsilon, &seen_epsilon);
        Self {
            w: triangle(self.w.iter().chain(&whitened)),
            a_psi: product(&next.a_psi, &start_psi),
            a_epsilon: sum(product(&next.a_psi, &start_epsilon), &next.a_epsilon),
            u: add_roots(&product(&next.a_psi, &conditional), &next.u),
        }
    }

    /// Three columns of W.
    fn columns(&self, first: usize) -> Dense<Extended, 6, 3> {
        self.w.map(|row| std::array::from_fn(|j| row[first + j]))
    }

    fn block(&self, i: usize, j: usize) -> Square {
        std::array::from_fn(|k| std::array::from_fn(|l| self.w[i + k][j + l]))
    }
}

/// Φ and Γ of an interval in closed form, F = −[ω ×] of rate ω.
fn transition(model: &CovarianceModel, length_s: f64) -> (Square, Square) {
    let one = Extended::from(1.0);
    let f = model.dynamics.system_matrix();
    let f: Square = convert(|i, j| f[(i, j)]);
    let squared = product(&f, &f);
    // F² has the trace −2 ω².
    let trace = squared[NORTH][NORTH] + squared[UP][UP] + squared[EAST][EAST];
    let rate = (-trace / Extended::from(2.0)).sqrt();
    let t = Extended::from(length_s);
    let (sin, cos) = sin_cos(rate * t);
    let first = sin / rate;
    let second = (one - cos) / (rate * rate);
    let third = (t - first) / (rate * rate);
    let phi = sum(identity(), &sum(times(f, first), &times(squared, second)));
    let gamma = sum(
        times(identity(), t),
        &sum(times(f, second), &times(squared, third)),
    );
    (phi, gamma)
}

/// A (3×12).
fn drift_matrix(position: Position) -> Drive {
    let attitude = Extended::attitude(position);
    let mut a = zeros();
    for c in DriftCoefficient::ALL {
        // g^c is minus the Up row of C_c^n.
        let factor = match c.excitation() {
            None => Extended::from(1.0),
            Some((axis, sign)) => attitude[UP][axis] * Extended::from(-sign),
        };
        for i in 0..3 {
            a[i][c.index()] = attitude[i][c.gyro()] * factor;
        }
    }
    a
}

/// R with RᵀR = Σ rᵀ r over `rows`, by Householder reflections, the largest rows first.
fn triangle<'a, const N: usize>(
    rows: impl Iterator<Item = &'a [Extended; N]>,
) -> Dense<Extended, N, N> {
    let mut rows: Vec<[Extended; N]> = rows.copied().collect();
    let size = |row: &[Extended; N]| row.iter().fold(0.0_f64, |max, v| max.max(v.0.abs()));
    rows.sort_by(|a, b| size(b).total_cmp(&size(a)));
    for j in 0..N {
        reflect(&mut rows[j..], j);
    }
    std::array::from_fn(|i| rows[i])
}

/// Squares of less underflow; nothing of the problem comes near.
const NOTHING: f64 = 1e-140;

/// Turns `rows` so that all but the first are zero in column `j`.
fn reflect<const N: usize>(rows: &mut [[Extended; N]], j: usize) {
    let zero = Extended::from(0.0);
    let squares = |rows: &[[Extended; N]]| rows.iter().fold(zero, |sum, row| sum + row[j] * row[j]);
    if rows[1..].iter().all(|row| row[j].0.abs() < NOTHING) {
        rows[1..].iter_mut().for_each(|row| row[j] = zero);
        return;
    }
    let norm = squares(rows).sqrt();
    let head = rows[0][j];
    // Away from what is there, so that nothing cancels.
    let diagonal = if head > zero { -norm } else { norm };
    let mut reflector: Vec<Extended> = rows.iter().map(|row| row[j]).collect();
    reflector[0] -= diagonal;
    let half_square = norm * norm - head * diagonal;
    for k in j + 1..N {
        let parts = rows.iter().zip(&reflector);
        let dot = parts.fold(zero, |sum, (row, v)| sum + row[k] * *v);
        let share = dot / half_square;
        for (row, v) in rows.iter_mut().zip(&reflector) {
            row[k] -= *v * share;
        }
    }
    rows[0][j] = diagonal;
    rows[1..].iter_mut().for_each(|row| row[j] = zero);
}

/// R with RᵀR = I + NᵀN.
fn one_and<const M: usize, const N: usize>(n: &Dense<Extended, M, N>) -> Dense<Extended, N, N> {
    triangle(n.iter().chain(&identity()))
}

/// R⁻ᵀ b.
fn solve_transposed<const N: usize, const C: usize>(
    r: &Dense<Extended, N, N>,
    b: &Dense<Extended, N, C>,
) -> Dense<Extended, N, C> {
    product(&transposed(&inverse_of_triangle(r)), b)
}

/// A root of A Aᵀ + B Bᵀ.
fn add_roots(a: &Square, b: &Square) -> Square {
    transposed(&triangle(transposed(a).iter().chain(&transposed(b))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::covariance::TickRule;
    use crate::platform::{PlatformConfig, Repositioning};
    use crate::schedule::{Schedule, ScheduledPosition};

    /// On an ordinary problem sixteen digits are enough: the same covariance, signs included, by
    /// moves that take time or none, are measured or not, or turn ψ^n.
    #[test]
    fn doubles_and_numbers_of_32_digits_have_the_same_covariance() {
        type Change = fn(&mut PlatformConfig);
        let cases: [Change; 4] = [
            |_| {},
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.9);
                c.motion.measure_moves = true;
            },
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.9);
                c.motion.settle_s = 37.0;
                c.motion.start_deg = Some([5.0, -20.0, 60.0]);
                c.motion.return_to_start = true;
            },
            |c| c.motion.repositioning = Repositioning::FrameHold,
        ];
        for (k, change) in cases.into_iter().enumerate() {
            let mut config = PlatformConfig::default();
            change(&mut config);
            let platform = config.check().unwrap();
            let positions = [
                ([10.0, 20.0, 30.0], 604.0),
                ([-80.0, 65.0, 140.0], 1300.0),
                ([-80.0, 65.0, 140.0], 7.0),
                ([150.0, -40.0, -75.0], 955.0),
            ]
            .map(|(a, dwell_s)| {
                ScheduledPosition::new(Position::from_deg(a[0], a[1], a[2]), dwell_s)
            });
            let timeline = Timeline::new(&platform, &Schedule::new(positions.into()).unwrap());
            let timeline = timeline.unwrap();
            let model = CovarianceModel::new(&platform);
            let doubles = model.end_covariance(&timeline, TickRule::Filter).unwrap();
            let extended = model.end_covariance_extended(&timeline).unwrap();
            let (a, b) = (&doubles.coefficients, &extended.coefficients);
            for i in 0..COEFFICIENTS {
                for j in 0..COEFFICIENTS {
                    let scale = (b[(i, i)] * b[(j, j)]).sqrt();
                    assert!((a[(i, j)] - b[(i, j)]).abs() < 1e-9 * scale, "{k}: {i} {j}");
                }
            }
            let difference = doubles.misalignment - extended.misalignment;
            assert!(difference.amax() < 1e-9 * extended.misalignment.amax());
        }
    }
}
