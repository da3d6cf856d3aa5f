//! The filter that linearises about estimates. Derivation: see [`crate::simulate`].

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::attitude::{EAST, GRAVITY_N, NORTH, UP};
use crate::units::ARCSEC_PER_RAD;

use super::belief::{Belief, State, Taken};
use super::channels::{Channel, SEEN_OF_PSI};
use super::instruments::Instruments;
use super::program::{DriftInterval, Program};
use super::square_root::Knowledge;
use super::states::LinearTransition;
use super::truth::{Direction, Disturbance, Measured, azimuth_of, turned};
use super::wander::linear_transition;

/// A platform as it is believed to be: what a filter is linearised about.
#[derive(Debug, Clone)]
pub(super) struct Nominal {
    /// Ê = Ĉ_p^n C_n^c.
    pub rotation: UnitQuaternion<f64>,
    /// The estimated parameters, each in its unit.
    pub parameters: Vec<f64>,
}

impl Nominal {
    /// As before any measurement.
    fn unknown(belief: &Belief) -> Self {
        Self {
            rotation: UnitQuaternion::identity(),
            parameters: vec![0.0; belief.estimated()],
        }
    }

    fn integrate(
        &mut self,
        earth_rate_n: &Vector3<f64>,
        instruments: &Instruments,
        interval: &DriftInterval,
        way: Direction,
    ) {
        let disturbance = Disturbance {
            earth_rate_n,
            instruments,
            random_n: Vector3::zeros(),
            wandering: Vector3::zeros(),
        };
        self.rotation = disturbance.integrate(&self.rotation, interval, way);
    }

    /// Moved by a deviation.
    fn moved(&self, by: &State) -> Self {
        let parameters = self.parameters.iter().zip(&by.parameters);
        Self {
            rotation: UnitQuaternion::from_scaled_axis(by.psi / ARCSEC_PER_RAD) * self.rotation,
            parameters: parameters.map(|(nominal, by)| nominal + by).collect(),
        }
    }
}

/// What an [`ExtendedFilter`] linearises about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum About {
    /// The estimate of the moment: the nominal platform is moved by every update.
    Estimate,
    /// A trajectory of the whole test, from an earlier pass: the nominal platform is left alone.
    Trajectory,
}

/// The extended filter: the nominal platform nonlinearly, the deviation from it linearly.
#[derive(Debug)]
pub(super) struct ExtendedFilter<'a> {
    belief: &'a Belief,
    about: About,
    pub nominal: Nominal,
    /// Those of the nominal platform.
    instruments: Instruments,
    /// The estimate less the nominal platform: η of E = exp([η×]) Ê, and the parameters. Nothing wanders
    /// of the nominal platform: what does is all here.
    pub correction: State,
    pub knowledge: Knowledge,
}

impl<'a> ExtendedFilter<'a> {
    /// A filter that starts from zero and linearises about its estimate.
    pub fn new(belief: &'a Belief) -> Self {
        let nominal = Nominal::unknown(belief);
        Self {
            belief,
            about: About::Estimate,
            instruments: belief.layout.instruments(&nominal.parameters),
            nominal,
            correction: State::zero(&belief.shape),
            knowledge: belief.knowledge(),
        }
    }

    /// A filter with the same prior that linearises about the trajectory from `start`.
    pub fn about(belief: &'a Belief, start: Nominal) -> Self {
        let mut parameters: Vec<f64> = start.parameters.iter().map(|v| -v).collect();
        parameters.resize(belief.shape.psi(), 0.0);
        Self {
            about: About::Trajectory,
            correction: State {
                psi: -start.rotation.scaled_axis() * ARCSEC_PER_RAD,
                parameters,
            },
            instruments: belief.layout.instruments(&start.parameters),
            nominal: start,
            ..Self::new(belief)
        }
    }

    /// The estimate.
    pub fn best(&self) -> Nominal {
        self.nominal.moved(&self.correction)
    }

    /// Where the test must have started for the estimate to be right at its end.
    pub fn retraced(&self, program: &Program) -> Nominal {
        let mut nominal = self.best();
        let instruments = self.belief.layout.instruments(&nominal.parameters);
        let earth_rate_n = &self.belief.earth_rate_n;
        for interval in program.intervals.iter().rev() {
            nominal.integrate(earth_rate_n, &instruments, interval, Direction::Backward);
            if let Some(q) = &interval.turn {
                nominal.rotation = turned(&nominal.rotation, &q.transpose());
            }
        }
        nominal
    }

    /// How far the estimate lies from the nominal platform, squared, in σ; of what wanders apart.
    pub fn deviation(&self) -> f64 {
        let root = self.knowledge.claimed();
        let of = root.nees_without_wandering(&self.correction.numbers());
        of.states
    }

    /// Predicts through `interval`.
    pub fn advance(&mut self, interval: &DriftInterval) {
        if let Some(q) = &interval.turn {
            self.knowledge.turn(q);
            self.nominal.rotation = turned(&self.nominal.rotation, q);
            self.correction.psi = q * self.correction.psi;
        }
        let start = self.nominal.rotation;
        self.nominal.integrate(
            &self.belief.earth_rate_n,
            &self.instruments,
            interval,
            Direction::Forward,
        );
        let middle = start.nlerp(&self.nominal.rotation, 0.5);
        let step = self.jacobians(interval, &middle);
        self.knowledge
            .predict(&step, self.belief.drift_psd * interval.length_s);
        let State { parameters, psi } = &mut self.correction;
        let driven = parameters.iter().zip(step.b.column_iter());
        *psi = step.phi * *psi + driven.fold(Vector3::zeros(), |sum, (d, b)| sum + b * *d);
        if let Some(fading) = &step.fading {
            fading.fade(&mut parameters[self.belief.estimated()..]);
        }
    }

    /// Φ and B about the nominal platform: those of (8) with the attitude it is believed to
    /// have, and with the tilt's part in the specific force, F = −[ω_ie×] + M^n [g^n×].
    fn jacobians(
        &self,
        interval: &DriftInterval,
        rotation: &UnitQuaternion<f64>,
    ) -> LinearTransition {
        let (belief, pace) = (self.belief, interval.pace());
        let turn = rotation.to_rotation_matrix();
        let (mut m_n, mut a) = (Matrix3::zeros(), belief.mixing.nothing());
        for (i, c_to_n) in interval.attitudes.iter().enumerate() {
            let weight = simpson_weight(i, interval.attitudes.len());
            let p_to_n = turn.matrix() * c_to_n.matrix();
            let gravity_p = p_to_n.tr_mul(&GRAVITY_N);
            let m = p_to_n * self.instruments.sensitivity(&gravity_p) * p_to_n.transpose();
            m_n += m * weight;
            let commanded = interval.commanded(i, &belief.earth_rate_n);
            a += belief.mixing.drift(&p_to_n, &commanded, pace) * weight;
        }
        let f = (m_n * GRAVITY_N.cross_matrix() - belief.earth_rate_n.cross_matrix()) * pace;
        let (fh, identity) = (f * interval.span(), Matrix3::identity());
        let gamma = identity + fh * 0.5;
        let b = gamma * a * interval.span();
        let wandering = belief.wandering.as_ref();
        linear_transition(wandering, identity + fh * gamma, b, interval.length_s)
    }

    /// Takes what is measured at the end of `interval`.
    pub fn measure(&mut self, interval: &DriftInterval, measured: &Measured, taken: Taken<'_>) {
        let seen = self.seen(interval, measured);
        for (channel, value) in &seen {
            let innovation = value - channel.seen_of(&self.correction.numbers(), 0);
            let gain = self.knowledge.update(channel);
            taken(innovation / gain.innovation_sigma, &gain);
            self.correction.correct(&gain, innovation);
        }
        if self.about == About::Estimate {
            self.nominal = self.best();
            let State { parameters, psi } = &mut self.correction;
            parameters[..self.belief.estimated()].fill(0.0);
            *psi = Vector3::zeros();
            self.instruments = self.belief.layout.instruments(&self.nominal.parameters);
        }
    }

    /// What is measured beyond what the nominal platform shows, and how that follows from the
    /// deviation.
    fn seen(&self, interval: &DriftInterval, measured: &Measured) -> Vec<(Channel, f64)> {
        let (sensors, rotation) = (&self.belief.sensors, &self.nominal.rotation);
        let c_to_n = interval.end_attitude().matrix();
        let gravity = GRAVITY_N * ARCSEC_PER_RAD;
        let larger = 1.0 + self.instruments.gravity_error();
        let p_to_n = rotation.to_rotation_matrix().matrix() * c_to_n;
        let force = -p_to_n.tr_mul(&GRAVITY_N) * larger;
        let mut nominal_z = gravity - rotation.inverse_transform_vector(&(gravity * larger));
        // Z^n = g − Eᵀ g + …; turned by Ê, what exceeds the nominal one is η × g + …, the form of (9).
        let mut of_psi = SEEN_OF_PSI;
        let mut output = self.belief.mixing.nothing();
        if let Some(slope) = self.instruments.output_slope(&force) {
            nominal_z += c_to_n * self.instruments.output(&force) * ARCSEC_PER_RAD;
            let shown = (Matrix3::identity() + slope) * larger;
            of_psi = p_to_n * shown * p_to_n.transpose() * SEEN_OF_PSI;
            output = self.belief.mixing.output(&p_to_n);
        }
        if let Some(wandering) = &self.belief.wandering {
            output = wandering.shown(&output, &p_to_n);
        }
        let z_n = c_to_n * measured.z * ARCSEC_PER_RAD;
        let excess = rotation.transform_vector(&(z_n - nominal_z));
        let channels = sensors.channels(&of_psi, &output).into_iter();
        let mut seen: Vec<(Channel, f64)> = channels
            .zip(sensors.rows().iter().map(|row| excess[*row]))
            .collect();
        if let Some(channel) = sensors.azimuth(azimuth_slope(rotation)) {
            let difference = wrapped(measured.azimuth - azimuth_of(rotation));
            seen.push((channel, difference * ARCSEC_PER_RAD));
        }
        seen
    }
}

/// ∂azimuth/∂η of exp([η×]) Ê.
fn azimuth_slope(rotation: &UnitQuaternion<f64>) -> [f64; 3] {
    let north = rotation.transform_vector(&Vector3::x());
    let horizontal = north[NORTH].powi(2) + north[EAST].powi(2);
    let mut slope = [0.0; 3];
    slope[UP] = 1.0;
    for axis in [NORTH, EAST] {
        slope[axis] = -north[UP] * north[axis] / horizontal;
    }
    slope
}

/// The same angle within half a turn, rad.
fn wrapped(angle: f64) -> f64 {
    const TURN: f64 = 2.0 * std::f64::consts::PI;
    angle - TURN * libm::round(angle / TURN)
}

/// Simpson's weight of node `i` of `count` (odd), the whole being 1; a single node has it all.
fn simpson_weight(i: usize, count: usize) -> f64 {
    let last = count - 1;
    let weight = match i {
        _ if last == 0 => return 1.0,
        0 => 1.0,
        i if i == last => 1.0,
        i if i % 2 == 1 => 4.0,
        _ => 2.0,
    };
    weight / (3 * last) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_the_azimuth_is_its_derivative() {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -1.9, 0.4));
        let h = 1e-6;
        for (axis, slope) in azimuth_slope(&rotation).into_iter().enumerate() {
            let mut eta = Vector3::zeros();
            eta[axis] = h;
            let at =
                |eta: Vector3<f64>| azimuth_of(&(UnitQuaternion::from_scaled_axis(eta) * rotation));
            let expected = wrapped(at(eta) - at(-eta)) / (2.0 * h);
            assert!(
                (slope - expected).abs() < 1e-8,
                "{axis}: {slope} {expected}"
            );
        }
        assert_eq!(azimuth_slope(&UnitQuaternion::identity()), [0.0, 1.0, 0.0]);
    }
}
