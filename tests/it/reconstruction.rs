//! The reconstruction formulas within one dwell: (9)–(18), (25), (26).
//!
//! At a position that tracks the local level frame, ψ̇^n = −ω_ie^n × ψ^n + ε^n (8) with ε^n
//! constant, and Z^n = (ψ_z, 0, −ψ_x) (9). Differentiating gives Ż^n (10) and Z̈^n (12), and
//! solving for the states the paper's (13)–(18), (25) and (26): each state's observability order
//! is the highest derivative of Z in its solution.
//!
//! [`Levelled`] is the way forward (what the measurement and its derivatives are), and
//! [`MeasurementJet`] with [`Reconstruction`] the way back. Angles in rad, rates in rad/s. Z is in
//! g, and since gravity is 1 g that is the same number as an angle in rad.
//!
//! # What the tests find
//!
//! (9), (10), (12)–(18) and (25) hold as printed, signs included: the derivatives of a noise-free
//! dwell, formed analytically and by finite differences, give the states back. Two remarks.
//!
//! - In (10) and (12) the matrix before ψ must be C_c^n(0), as it is in (9), for
//!   ψ^n = C_c^n ψ; the text reads C_n^c(0) there. The component form on the right of both is
//!   correct, and is what is implemented.
//! - (26) is **exact only to first order in t**. It takes ψ_y^n(t) − ψ_y^n(0) for ψ̇_y^n t, but
//!   ψ̇_y^n = ω_N ψ_z^n + ε_y^n changes as ψ_z^n does. The error is ½ ω_N² ψ̇_z t² + …: with the
//!   drifts of the paper's §3 it is 0.016 °/h after 1000 s, six times the σ that the filter
//!   reaches there. [`Reconstruction::azimuth_drift_exact`] has ∫ψ_z dt in its place, which is known from
//!   Z itself by (14), and holds at all times.

use nalgebra::{Rotation3, Vector3};
use scheme_opt::internals::attitude::{EAST, NORTH, Position, UP, earth_rate_n};
use scheme_opt::internals::covariance::CovarianceModel;
use scheme_opt::internals::drift::{CoefficientVector, DriftCoefficient, drift_matrix};
use scheme_opt::internals::dynamics::ErrorDynamics;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::observability::solution::Solution;
use scheme_opt::internals::observability::{Channel, Combination, Observability};
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::schedule::standard::StandardScheme;
use scheme_opt::internals::units::{Angle, AngularRate};

use crate::support::{Random, held, random_positions};

/// The platform held level at a position: ψ^n and ε^n at one moment, and what follows from them.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Levelled {
    /// Earth rate ω_ie^n = (ω_N, ω_U, 0), rad/s.
    earth_rate_n: Vector3<f64>,
    /// Misalignment ψ^n, rad.
    psi_n: Vector3<f64>,
    /// Gyro drift ε^n, rad/s, constant.
    epsilon_n: Vector3<f64>,
}

impl Levelled {
    /// The same `t_s` seconds later: the exact solution of (8).
    #[must_use]
    fn after(&self, t_s: f64) -> Self {
        let dynamics = ErrorDynamics::new(self.earth_rate_n);
        Self {
            psi_n: dynamics.transition(t_s) * self.psi_n + dynamics.integral(t_s) * self.epsilon_n,
            ..*self
        }
    }

    /// ψ̇^n of (8), rad/s.
    fn psi_rate_n(&self) -> Vector3<f64> {
        self.psi_n.cross(&self.earth_rate_n) + self.epsilon_n
    }

    /// Z^n of (9), g.
    fn measurement(&self) -> Vector3<f64> {
        Vector3::new(self.psi_n[EAST], 0.0, -self.psi_n[NORTH])
    }

    /// Ż^n of (10), g/s.
    fn first_derivative(&self) -> Vector3<f64> {
        let (omega_n, omega_u) = (self.earth_rate_n[NORTH], self.earth_rate_n[UP]);
        let (psi, epsilon) = (&self.psi_n, &self.epsilon_n);
        Vector3::new(
            omega_u * psi[NORTH] - omega_n * psi[UP] + epsilon[EAST],
            0.0,
            omega_u * psi[EAST] - epsilon[NORTH],
        )
    }

    /// Z̈^n of (12), g/s².
    fn second_derivative(&self) -> Vector3<f64> {
        let (omega_n, omega_u) = (self.earth_rate_n[NORTH], self.earth_rate_n[UP]);
        let (psi, epsilon) = (&self.psi_n, &self.epsilon_n);
        Vector3::new(
            -(omega_n * omega_n + omega_u * omega_u) * psi[EAST] + omega_u * epsilon[NORTH]
                - omega_n * epsilon[UP],
            0.0,
            omega_u * omega_u * psi[NORTH] - omega_u * omega_n * psi[UP] + omega_u * epsilon[EAST],
        )
    }

    /// Z^n and its derivatives at this moment.
    fn jet(&self) -> MeasurementJet {
        MeasurementJet {
            z_n: self.measurement(),
            z_rate_n: self.first_derivative(),
            z_acceleration_n: self.second_derivative(),
        }
    }
}

/// The measurement and its first two derivatives at one moment of a dwell, turned into n.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MeasurementJet {
    /// Z^n, g.
    z_n: Vector3<f64>,
    /// Ż^n, g/s.
    z_rate_n: Vector3<f64>,
    /// Z̈^n, g/s².
    z_acceleration_n: Vector3<f64>,
}

/// The states of a dwell from a [`MeasurementJet`].
#[derive(Debug, Clone, Copy, PartialEq)]
struct Reconstruction {
    omega_n: f64,
    omega_u: f64,
    jet: MeasurementJet,
}

impl Reconstruction {
    /// At a site with Earth rate `earth_rate_n`, rad/s.
    fn new(earth_rate_n: &Vector3<f64>, jet: MeasurementJet) -> Self {
        Self {
            omega_n: earth_rate_n[NORTH],
            omega_u: earth_rate_n[UP],
            jet,
        }
    }

    /// ψ_x^n by (13), rad. Order 0.
    fn psi_x(&self) -> f64 {
        -self.jet.z_n.z
    }

    /// ψ_z^n by (14), rad. Order 0.
    fn psi_z(&self) -> f64 {
        self.jet.z_n.x
    }

    /// ε_x^n by (15), rad/s. Order 1.
    fn epsilon_x(&self) -> f64 {
        self.omega_u * self.psi_z() - self.jet.z_rate_n.z
    }

    /// ε_y^n by (16), rad/s; none at the poles, where ω_N = 0 hides it. Order 2.
    fn epsilon_y(&self) -> Option<f64> {
        let rate_squared = self.omega_n * self.omega_n + self.omega_u * self.omega_u;
        let numerator = self.omega_u * self.epsilon_x()
            - self.jet.z_acceleration_n.x
            - rate_squared * self.psi_z();
        (self.omega_n != 0.0).then(|| numerator / self.omega_n)
    }

    /// ω_N ψ_y^n − ε_z^n by (17), rad/s. Order 1.
    fn azimuth_minus_drift(&self) -> f64 {
        self.omega_u * self.psi_x() - self.jet.z_rate_n.x
    }

    /// (ω_N ψ_y^n − ε_z^n) ω_U by (18), rad/s²: the same combination as (17), from Z̈. That both
    /// derivatives show only this one is why ψ_y^n and ε_z^n cannot be told apart in a dwell.
    fn azimuth_minus_drift_times_omega_u(&self) -> f64 {
        self.omega_u * self.omega_u * self.psi_x() - self.jet.z_acceleration_n.z
    }

    /// ψ̇_y^n by (25), rad/s; none at the poles. Order 2, through ε_y^n.
    fn psi_y_rate(&self) -> Option<f64> {
        Some(self.omega_n * self.psi_z() + self.epsilon_y()?)
    }

    /// ε_z^n − ω_N ψ_y^n(0) by (26) as printed, rad/s, from the jet `t_s` seconds into the dwell;
    /// none at the poles. Exact only to first order in `t_s`, see the module text.
    fn azimuth_drift(&self, t_s: f64) -> Option<f64> {
        let change = self.psi_y_rate()? * t_s;
        Some(self.jet.z_rate_n.x + change * self.omega_n - self.omega_u * self.psi_x())
    }

    /// ε_z^n − ω_N ψ_y^n(0), rad/s: (26) with ψ_y^n(t) − ψ_y^n(0) = ω_N ∫ψ_z dt + ε_y t instead
    /// of ψ̇_y t, which makes it exact. `psi_z_integral_rad_s` is ∫₀ᵗ ψ_z^n dt, known from Z by
    /// (14). None at the poles.
    fn azimuth_drift_exact(&self, t_s: f64, psi_z_integral_rad_s: f64) -> Option<f64> {
        let change = self.omega_n * psi_z_integral_rad_s + self.epsilon_y()? * t_s;
        Some(self.jet.z_rate_n.x + change * self.omega_n - self.omega_u * self.psi_x())
    }
}

/// The paper's §3 at the position: D_F = 11, 12, 13 °/h, all others 5 °/h/g, ψ = 0.1°.
fn dwell(latitude: f64, position: Position) -> Levelled {
    let d = CoefficientVector::from_fn(|i, _| {
        AngularRate::from_deg_per_h([11.0, 12.0, 13.0].get(i).copied().unwrap_or(5.0)).rad_per_s()
    });
    Levelled {
        earth_rate_n: earth_rate_n(latitude),
        psi_n: Vector3::new(0.1, -0.07, 0.04).map(|deg| Angle::from_deg(deg).rad()),
        epsilon_n: drift_matrix(&position.attitude()) * d,
    }
}

fn cases() -> Vec<Levelled> {
    let mut all = Vec::new();
    for latitude in [-1.1, 0.0, 0.49, 1.3] {
        for angles in [[0.0, 0.0, 0.0], [0.3, -0.7, 2.1], [-2.9, 1.2, -0.4]] {
            all.push(dwell(latitude, Position::from_array(angles)));
        }
    }
    all
}

/// Fourth-order central differences of Z^n over the exact solution.
fn numeric(dwell: &Levelled, step_s: f64) -> (Vector3<f64>, Vector3<f64>) {
    let z = |k: f64| dwell.after(k * step_s).measurement();
    let first = (8.0 * (z(1.0) - z(-1.0)) - (z(2.0) - z(-2.0))) / (12.0 * step_s);
    let second =
        (16.0 * (z(1.0) + z(-1.0)) - (z(2.0) + z(-2.0)) - 30.0 * z(0.0)) / (12.0 * step_s * step_s);
    (first, second)
}

#[test]
fn equations_10_and_12_are_the_derivatives_of_9() {
    for start in cases() {
        for t in [0.0, 400.0, 1000.0] {
            let now = start.after(t);
            let (first, second) = numeric(&now, 50.0);
            let (one, two) = (now.first_derivative(), now.second_derivative());
            assert!((first - one).amax() < 1e-9 * one.amax(), "{first} {one}");
            assert!((second - two).amax() < 1e-6 * two.amax(), "{second} {two}");
        }
    }
}

fn check(now: &Levelled, found: &Reconstruction, tolerance: f64) {
    let omega = now.earth_rate_n;
    let (psi, epsilon) = (now.psi_n, now.epsilon_n);
    let rate = epsilon.amax();
    let close = |a: f64, b: f64, scale: f64| {
        assert!((a - b).abs() <= tolerance * scale, "{a:e} instead of {b:e}");
    };
    close(found.psi_x(), psi[NORTH], psi.amax());
    close(found.psi_z(), psi[EAST], psi.amax());
    close(found.epsilon_x(), epsilon[NORTH], rate);
    close(found.epsilon_y().unwrap(), epsilon[UP], rate);
    close(found.psi_y_rate().unwrap(), now.psi_rate_n()[UP], rate);
    let mixed = omega[NORTH] * psi[UP] - epsilon[EAST];
    close(found.azimuth_minus_drift(), mixed, rate);
    let scaled = found.azimuth_minus_drift_times_omega_u();
    close(scaled, mixed * omega[UP], rate * omega.norm());
}

#[test]
fn equations_13_to_18_and_25_give_the_states_back() {
    for start in cases() {
        for t in [0.0, 400.0, 1000.0] {
            let now = start.after(t);
            check(
                &now,
                &Reconstruction::new(&now.earth_rate_n, now.jet()),
                1e-11,
            );
        }
    }
}

#[test]
fn they_do_so_with_derivatives_by_finite_differences_too() {
    for start in cases() {
        let now = start.after(500.0);
        let (z_rate_n, z_acceleration_n) = numeric(&now, 50.0);
        let jet = MeasurementJet {
            z_rate_n,
            z_acceleration_n,
            z_n: now.measurement(),
        };
        check(&now, &Reconstruction::new(&now.earth_rate_n, jet), 1e-6);
    }
}

/// (5), (6): the true platform is turned by ψ^n from the computed one, and Z is what its
/// accelerometers show less what the computed gravity would make them show.
#[test]
fn a_measurement_in_the_platform_is_turned_into_n() {
    let gravity_n = -Vector3::y();
    for mut now in cases() {
        now.psi_n *= 1e-3;
        let computed = *Position::from_rad(0.3, -0.7, 2.1).attitude().matrix();
        let truth = Rotation3::new(now.psi_n).matrix() * computed;
        let z_c = -truth.transpose() * gravity_n + computed.transpose() * gravity_n;
        // ψ is 2e-6 rad: its square is what (9) leaves out.
        let error = (computed * z_c - now.measurement()).amax();
        assert!(error < 1e-11, "{error:e}");
    }
}

/// ∫₀ᵗ ψ_z dt from the solution itself, by Simpson's rule.
fn psi_z_integral(start: &Levelled, t_s: f64) -> f64 {
    let panels = 200;
    let h = t_s / f64::from(panels);
    let z = |k: i32| start.after(f64::from(k) * h).psi_n[EAST];
    (0..panels)
        .step_by(2)
        .map(|k| h / 3.0 * (z(k) + 4.0 * z(k + 1) + z(k + 2)))
        .sum()
}

#[test]
fn equation_26_holds_to_first_order_in_time_only() {
    let start = dwell(Angle::from_deg(28.2).rad(), Position::default());
    let truth = start.epsilon_n[EAST] - start.earth_rate_n[NORTH] * start.psi_n[UP];
    let error_deg_per_h = |t: f64, exact: bool| {
        let now = start.after(t);
        let found = Reconstruction::new(&now.earth_rate_n, now.jet());
        let value = match exact {
            true => found.azimuth_drift_exact(t, psi_z_integral(&start, t)),
            false => found.azimuth_drift(t),
        };
        AngularRate::from_rad_per_s(value.unwrap() - truth).deg_per_h()
    };
    for t in [0.0, 100.0, 1000.0, 4000.0] {
        assert!(
            error_deg_per_h(t, true).abs() < 1e-9,
            "{}",
            error_deg_per_h(t, true)
        );
    }
    assert!(error_deg_per_h(0.0, false).abs() < 1e-12);
    // ½ ω_N² ψ̇_z t² with ψ̇_z ≈ 8 °/h: small at once, six sigmas of the filter after 1000 s.
    let (at_100, at_1000) = (
        error_deg_per_h(100.0, false),
        error_deg_per_h(1000.0, false),
    );
    let predicted = 0.5 * start.earth_rate_n[NORTH].powi(2) * start.psi_rate_n()[EAST] * 1e6;
    let predicted = AngularRate::from_rad_per_s(predicted).deg_per_h();
    println!("(26) as printed is off by {at_1000:.4} deg/h after 1000 s");
    assert!(
        (at_1000 / predicted - 1.0).abs() < 0.1,
        "{at_1000} {predicted}"
    );
    assert!((at_1000 / at_100 - 100.0).abs() < 10.0);
    assert!(at_1000.abs() > 0.01);
}

#[test]
fn at_the_poles_the_vertical_drift_is_hidden() {
    let now = dwell(std::f64::consts::FRAC_PI_2, Position::default());
    let found = Reconstruction::new(&now.earth_rate_n, now.jet());
    assert_eq!((found.epsilon_y(), found.psi_y_rate()), (None, None));
    assert!((found.epsilon_x() - now.epsilon_n[NORTH]).abs() < 1e-18);
}

// ---------------------------------------------------------------- reconstruction, end to end

/// A noise-free test: the drift, the misalignment at its start, and what each channel tells.
struct Truth {
    coefficients: CoefficientVector,
    /// By position, for the channels x, z, y; z with the change of ψ_y taken out by (25).
    channels: Vec<[f64; 3]>,
}

/// Simulates zero-time moves between dwells, differentiates Z numerically at the start of each
/// dwell, and reconstructs by (15)–(17) and (25).
fn simulate(positions: &[Position], dwell_s: f64) -> Truth {
    let omega = earth_rate_n(Angle::from_deg(28.2).rad());
    let mut random = Random(17);
    let mut rate = |limit: f64| AngularRate::from_deg_per_h(random.between(-limit, limit));
    let coefficients = CoefficientVector::from_fn(|_, _| rate(12.0).rad_per_s());
    let mut psi_n = Vector3::new(0.1, -0.08, 0.05).map(|deg| Angle::from_deg(deg).rad());
    let mut change_of_psi_y = 0.0;
    let mut channels = Vec::new();
    for position in positions {
        let now = Levelled {
            earth_rate_n: omega,
            psi_n,
            epsilon_n: drift_matrix(&position.attitude()) * coefficients,
        };
        let z = |t: f64| now.after(t).measurement();
        let h = 60.0;
        let jet = MeasurementJet {
            z_n: z(0.0),
            z_rate_n: (8.0 * (z(h) - z(-h)) - (z(2.0 * h) - z(-2.0 * h))) / (12.0 * h),
            z_acceleration_n: (16.0 * (z(h) + z(-h)) - (z(2.0 * h) + z(-2.0 * h)) - 30.0 * z(0.0))
                / (12.0 * h * h),
        };
        let found = Reconstruction::new(&omega, jet);
        let epsilon_y = found.epsilon_y().unwrap();
        let mixed = -found.azimuth_minus_drift() + omega[0] * change_of_psi_y;
        channels.push([found.epsilon_x(), mixed, epsilon_y]);
        // (25) over the dwell: ω_N ∫ψ_z + ε_y t, ψ_z from Z itself by (14), Simpson's rule.
        let panels = 40;
        let width = dwell_s / f64::from(panels);
        let psi_z = |k: i32| z(f64::from(k) * width).x;
        let integral: f64 = (0..panels)
            .step_by(2)
            .map(|k| width / 3.0 * (psi_z(k) + 4.0 * psi_z(k + 1) + psi_z(k + 2)))
            .sum();
        change_of_psi_y += omega[0] * integral + epsilon_y * dwell_s;
        let dynamics = ErrorDynamics::new(omega);
        psi_n = dynamics.transition(dwell_s) * psi_n + dynamics.integral(dwell_s) * now.epsilon_n;
    }
    assert!((psi_n[UP]).abs() > 0.0 && (psi_n[EAST]).abs() > 0.0);
    Truth {
        coefficients,
        channels,
    }
}

#[test]
fn the_reconstructions_give_the_coefficients_of_a_noise_free_test() {
    let platform = PlatformConfig::default().check().unwrap();
    let model = CovarianceModel::new(&platform);
    let mut random = Random(19);
    for positions in [
        StandardScheme::Axis24.positions(),
        StandardScheme::Icosahedron12.positions(),
        random_positions(&mut random, 6),
        random_positions(&mut random, 14),
    ] {
        let truth = simulate(&positions, 900.0);
        let timeline = Timeline::new(&platform.clone().into(), &held(&positions, 900.0)).unwrap();
        let o = Observability::analyze(&model, &timeline).unwrap();
        for c in DriftCoefficient::ALL {
            let combination = Combination::single(c);
            let solution = Solution::find(&model, &timeline, &o, &combination).unwrap();
            let found: f64 = solution
                .terms
                .iter()
                .map(|t| {
                    let [x, z, y] = truth.channels[t.position];
                    t.weight
                        * match t.channel {
                            Channel::X => x,
                            Channel::Z => z,
                            Channel::Y => y,
                            Channel::Azimuth => panic!("a slewing platform has no such channel"),
                        }
                })
                .sum();
            let error = AngularRate::from_rad_per_s(found - truth.coefficients[c.index()]);
            let gain: f64 = solution.terms.iter().map(|t| t.weight.abs()).sum();
            let error = error.deg_per_h().abs() / gain.max(1.0);
            // What the finite differences of Z leave, in °/h.
            assert!(error < 1e-4, "{}: {error:e}", c.name());
        }
    }
}
