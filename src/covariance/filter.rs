//! The step-by-step square-root filter on faer: the independent check, and the convergence.
//!
//! It visits every filter period of the test with a square root of the *information* on the states
//! (ψ^n, D/s), D all m parameters of the platform and s the prior σ of each: rows of unit noise
//! (Bierman, *Factorization Methods for Discrete Sequential Estimation*, 1977, ch. V–VI), three on ψ^n
//! and D, m on D alone. A period adds the process noise √(q t) v to ψ^n, v of unit size; then
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
//! parameter known exactly has s = 0: its column is zero, and it stays known. A misalignment
//! known exactly is one known to 1e-9 of the noise of a measurement.
//!
//! All parameters are carried directly, in three channels of measurement and a fourth of azimuth,
//!
//! ```text
//! z_1 = ψ_z + b_1 + v,   z_2 = b_2 + v,   z_3 = −ψ_x + b_3 + v,   z_4 = ψ_y + v_4,   b = C_c^n δZ^c D.
//! ```
//!
//! Drift and biases that wander are states along the axes of the platform (`wander`), beside ψ^n.
//! Under a random walk D_F is the drift at the moment, its constant part and what the walk has come to.
//!
//! A move turns the torquers whether it takes time or not: ψ^n jumps by ∫ C_c^n T ω_nc^c ds. Considered
//! parameters have columns but no prior among the rows; see [`full`](super::full) for what becomes of
//! them.
//!
//! # What it shares with the kernels, and what not
//!
//! Of its own are: the attitude, as the product of three turns, with its own sines, and the rate at
//! which the gimbals turn it; the terms of the error model, by the names of the parameters and the axes
//! of each gyro (`terms`); whole filter periods (`instrument`); Φ and Γ, by a Taylor series; how far a
//! move is at a time, as the area under its rate; the drift integral of a move, by Runge–Kutta steps; what wanders, in the platform and not in n, by both
//! (`wander`); every factorisation, faer's.
//! It knows nothing of dwells, of gains, or of covariance. Shared with the
//! [`chain`](super::chain) are:
//!
//! - the [`Timeline`]: which way a move takes, how long it and the gimbals' speeding up take, when settling
//!   and dwells are;
//! - the [`Platform`] in SI, the Earth rate in n, the units of the states and of the parameters;
//! - which parameters there are, with their priors, and how P follows from N and B;
//! - the equations themselves, (2), (3), (9), and the rule for when the filter measures;
//! - the type of number with 32 digits, and products and sums of small matrices of it.
//!
//! Agreement of the two to 1e-6 is evidence for all but these.

mod elimination;
pub(crate) mod instrument;
mod terms;
mod transition;
mod wander;

use nalgebra::{DMatrix, Matrix3};

use elimination::{DriftInformation, Elimination, Told, inverse_of};
use instrument::{Drive, Instrument, Terms};
use transition::{runge_kutta_integral, taylor_transition};
use wander::{Wandered, Wandering};

use super::EndCovariance;
use super::full::{
    FullCovariance, IgnoredGroup, Outcome, Question, Walked, coefficients, errors_of_coefficients,
};
use super::real::{Dense, Extended, Real, product, transposed};
use crate::attitude::{EAST, NORTH, Position, UP};
use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::error::{Error, Result};
use crate::motion::{Move, Timeline};
use crate::platform::{Platform, Repositioning};
use crate::units::{ARCSEC_PER_RAD, Angle};

/// Components of ψ^n, the first states.
const PSI: usize = 3;
/// Order of elimination of ψ^n: what is measured first.
const ORDER: [usize; 3] = [NORTH, EAST, UP];
/// −[g^n ×], g^n = (0, −1, 0): what each channel sees of ψ^n, (9). The vertical one sees nothing.
const SEEN: [[f64; 3]; 3] = [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]];

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
    Ok(run::<f64>(platform, &Instrument::of(platform), timeline, observe)?.end)
}

/// The same in numbers of 32 digits, some thirty times slower: for weak priors beside strong
/// measurements. Of moves the drift integral is known to nine digits all the same.
///
/// # Errors
///
/// As [`step_by_step`].
pub fn step_by_step_extended(
    platform: &Platform,
    timeline: &Timeline,
    observe: &mut dyn FnMut(&Moment),
) -> Result<EndCovariance> {
    Ok(run::<Extended>(platform, &Instrument::of(platform), timeline, observe)?.end)
}

/// What is known of all parameters at the end of `timeline`, step by step.
///
/// # Errors
///
/// As [`step_by_step`].
pub fn full_step_by_step(platform: &Platform, timeline: &Timeline) -> Result<FullCovariance> {
    run::<f64>(platform, &Instrument::of(platform), timeline, &mut |_| {})
}

/// The filter in numbers `T`, on what it is told the instrument is.
pub(crate) fn run<T: Real>(
    platform: &Platform,
    instrument: &Instrument,
    timeline: &Timeline,
    observe: &mut dyn FnMut(&Moment),
) -> Result<FullCovariance> {
    let mut filter = SquareRootFilter::<T>::new(platform, instrument)?;
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
        filter.advance(here, leg.settle_s, false, observe);
        filter.advance(here, leg.dwell_s, true, observe);
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
    terms: Terms<T>,
    /// The same for drift integrals.
    terms_in_doubles: Terms<f64>,
    /// q, arcsec²/s.
    drift_psd: f64,
    /// r, arcsec.
    noise: f64,
    /// Noise of the azimuth, arcsec.
    azimuth_noise: Option<f64>,
    /// s of each parameter.
    scale: Vec<T>,
    /// How many parameters are estimated; they come first.
    estimated: Vec<usize>,
    considered: Vec<usize>,
    /// What wanders; none: noise is white.
    wandering: Option<Wandering>,
    /// How many states there are beside D: ψ^n, and what wanders.
    states: usize,
    /// What is known of them and D: rows of unit noise on (ψ^n, d, b, D/s), ψ^n in [`ORDER`].
    misalignment: Vec<Vec<T>>,
    /// What is known of D alone.
    drift: DriftInformation<T>,
    noise_elimination: Elimination<T>,
    misalignment_elimination: Elimination<T>,
    time_s: f64,
    leg: usize,
    /// The last step made, for the many equal periods of a dwell.
    cached: Option<(Position, f64, Step<T>)>,
}

/// An interval: Φ and B, what becomes of what wanders, and what the accelerometers show at its end:
/// δZ^n of each parameter, and the attitude.
#[derive(Clone)]
struct Step<T> {
    phi: Dense<T, 3, 3>,
    b: Drive<T>,
    wandered: Option<Wandered<T>>,
    output: Option<Drive<T>>,
    attitude: Dense<T, 3, 3>,
}

impl<'a, T: Real> SquareRootFilter<'a, T> {
    fn new(platform: &'a Platform, instrument: &'a Instrument) -> Result<Self> {
        let parameters = platform.errors.parameters();
        let unknown = || Error::numerical("the filter does not know every parameter");
        let terms = Terms::new(parameters).ok_or_else(unknown)?;
        let terms_in_doubles = Terms::new(parameters).ok_or_else(unknown)?;
        let noise = Angle::from_rad(platform.noise_g).arcsec();
        let count = parameters.len();
        let wandering = Wandering::of(platform);
        let states = PSI + wandering.as_ref().map_or(0, Wandering::states);
        let mut misalignment = vec![vec![T::from(0.0); states + count]; states];
        let start = wandering
            .iter()
            .flat_map(|w| w.start::<T>(platform.period_s));
        for (i, sigma) in start.enumerate() {
            misalignment[PSI + i][PSI + i] = T::from(1.0) / T::from(sigma);
        }
        for (i, axis) in ORDER.into_iter().enumerate() {
            let sigma = Angle::from_rad(platform.prior_misalignment_rad[axis]).arcsec();
            misalignment[i][i] = T::from(1.0) / T::from(sigma.max(T::KNOWN * noise));
        }
        let azimuth_noise = platform
            .azimuth_noise_rad
            .map(|v| Angle::from_rad(v).arcsec());
        // Two of ψ_x and ψ_z, the azimuth; the vertical channel tells of biases that wander, or of D
        // alone.
        let biases = wandering
            .as_ref()
            .is_some_and(Wandering::has_accelerometers);
        let seeing = 2 + usize::from(azimuth_noise.is_some()) + usize::from(biases);
        let measured = seeing + usize::from(terms.has_accelerometers() && !biases);
        let estimated = platform.errors.estimated();
        Ok(Self {
            platform,
            instrument,
            terms,
            terms_in_doubles,
            drift_psd: platform.drift_psd * ARCSEC_PER_RAD.powi(2),
            noise,
            azimuth_noise,
            scale: parameters.iter().map(|p| T::from(p.prior_sigma)).collect(),
            estimated: (0..estimated).collect(),
            considered: (estimated..count).collect(),
            misalignment,
            drift: DriftInformation::new(count, estimated, measured),
            noise_elimination: Elimination::new(2 * states, 2 * states + count, states),
            misalignment_elimination: Elimination::new(states + seeing, states + count, states),
            wandering,
            states,
            time_s: 0.0,
            leg: 0,
            cached: None,
        })
    }

    fn reposition(&mut self, m: &Move, observe: &mut dyn FnMut(&Moment)) {
        if m.duration_s > 0.0 {
            self.advance(Drift::Moving(m), m.duration_s, m.measured, observe);
        } else if self.terms.has_torquers() {
            let b = self.moved(m, (0.0, 1.0));
            self.drive(&b);
        }
    }

    /// Advances by `duration_s`; with measurements, in whole periods and a remainder.
    fn advance(
        &mut self,
        drift: Drift<'_>,
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
            self.pass(drift, (tick as f64 * period, period), true);
            self.report(observe);
        }
        if remainder > 0.0 {
            self.pass(drift, (ticks as f64 * period, remainder), false);
            self.report(observe);
        }
    }

    /// An interval, with the measurement at its end if wanted.
    fn pass(&mut self, drift: Drift<'_>, (start_s, length_s): (f64, f64), measure: bool) {
        match drift {
            Drift::Moving(m) if m.ramp() > 0.0 => {
                let whole = m.duration_s;
                let smooth = transition::cut_at_corners(m, (start_s / whole, length_s / whole));
                for (k, (start, length)) in smooth.iter().enumerate() {
                    let measure = measure && k + 1 == smooth.len();
                    self.pass_smoothly(drift, (start * whole, length * whole), measure);
                }
            }
            _ => self.pass_smoothly(drift, (start_s, length_s), measure),
        }
        self.time_s += length_s;
    }

    fn pass_smoothly(&mut self, drift: Drift<'_>, (start_s, length_s): (f64, f64), measure: bool) {
        let parts = self.wandering.as_ref().map_or(1, |w| w.parts(length_s));
        let part_s = length_s / parts as f64;
        for part in 0..parts {
            let step = self.step(drift, start_s + part as f64 * part_s, part_s);
            self.update(&step, part_s, measure && part + 1 == parts);
        }
    }

    /// Φ and B of an interval, and what the accelerometers show at its end.
    fn step(&mut self, drift: Drift<'_>, start_s: f64, length_s: f64) -> Step<T> {
        let earth = self.platform.earth_rate_n;
        match drift {
            Drift::Constant(position) => {
                if let Some((p, length, step)) = &self.cached
                    && *p == position
                    && *length == length_s
                {
                    return step.clone();
                }
                let (phi, gamma) = taylor_transition(&earth, length_s);
                let attitude = self.instrument.attitude::<T>(position);
                let rate: [T; 3] = std::array::from_fn(|i| {
                    let parts = attitude.iter().zip(&earth);
                    parts.fold(T::from(0.0), |sum, (row, w)| sum + row[i] * T::from(*w))
                });
                let axes = &self.instrument.axes;
                let a = self.terms.drift(axes, &attitude, &rate, T::from(1.0));
                let wandering = self.wandering.as_ref();
                let step = Step {
                    phi,
                    b: gamma.map(|row| combination(&row, &a)),
                    wandered: wandering.map(|w| w.held(&attitude, &earth, length_s)),
                    output: self.output(position),
                    attitude,
                };
                self.cached = Some((position, length_s, step.clone()));
                step
            }
            Drift::Moving(m) => {
                let [start, length] = [start_s, length_s].map(|s| s / m.duration_s);
                let part = (start_s, length_s);
                let wandering = self.wandering.as_ref();
                let end = m.position_after(transition::way_done(m, start + length).0);
                Step {
                    phi: taylor_transition(&earth, length_s).0,
                    b: self.moved(m, (start, length)),
                    wandered: wandering.map(|w| w.moved(self.instrument, &earth, m, part)),
                    output: self.output(end),
                    attitude: self.instrument.attitude(end),
                }
            }
        }
    }

    /// B of a part of a move.
    fn moved(&self, m: &Move, part: (f64, f64)) -> Drive<T> {
        let earth = self.platform.earth_rate_n;
        let b = runge_kutta_integral(self.instrument, &self.terms_in_doubles, &earth, m, part);
        b.map(|row| row.into_iter().map(T::from).collect())
    }

    /// δZ^n of each parameter at a position, if the accelerometers have errors.
    fn output(&self, position: Position) -> Option<Drive<T>> {
        let attitude = || self.instrument.attitude::<T>(position);
        let wanted = self.terms.has_accelerometers();
        wanted.then(|| self.terms.output(&attitude()))
    }

    /// One step: time update over `length_s`, and the measurement if wanted.
    fn update(&mut self, step: &Step<T>, length_s: f64, measure: bool) {
        // F is skew, so Φ is a rotation.
        self.rotate(&step.phi);
        self.drive(&step.b);
        let process = T::from((self.drift_psd * length_s).sqrt());
        match &step.wandered {
            Some(wandered) => self.wander(wandered),
            None if process > T::from(0.0) => {
                self.diffuse(|row| row.iter().map(|v| process * *v).collect());
            }
            None => {}
        }
        if measure {
            self.measure(step);
        }
    }

    /// What wanders drives ψ^n, fades, and comes anew.
    fn wander(&mut self, wandered: &Wandered<T>) {
        for row in &mut self.misalignment {
            let own = [row[0], row[1], row[2]];
            for (k, kept) in wandered.kept.iter().enumerate() {
                let at = PSI + 3 * k;
                for (j, value) in row[at..at + 3].iter_mut().enumerate() {
                    if let Some(carried) = wandered.carried.get(k) {
                        let parts = own.iter().zip(ORDER);
                        let driven = parts.fold(T::from(0.0), |sum, (own, axis)| {
                            sum + *own * carried[axis][j]
                        });
                        *value -= driven;
                    }
                    *value /= *kept;
                }
            }
        }
        self.diffuse(|row| {
            let mut driven = vec![T::from(0.0); row.len()];
            for (value, noise) in row.iter().zip(&wandered.noise) {
                for (sum, g) in driven.iter_mut().zip(noise) {
                    *sum += *value * *g;
                }
            }
            driven
        });
    }

    /// ψ^n ← ψ^n + B D.
    fn drive(&mut self, b: &Drive<T>) {
        let in_order = ORDER.map(|axis| &b[axis]);
        for row in &mut self.misalignment {
            let own = [row[0], row[1], row[2]];
            let of_parameters = row[self.states..].iter_mut().zip(&self.scale);
            for (j, (value, scale)) in of_parameters.enumerate() {
                let parts = own.iter().zip(in_order);
                let drift = parts.fold(T::from(0.0), |sum, (own, b)| sum + *own * b[j]);
                *value -= drift * *scale;
            }
        }
    }

    /// x ← x + G v, v of unit size: `driven` gives a row times G.
    fn diffuse(&mut self, driven: impl Fn(&[T]) -> Vec<T>) {
        let states = self.states;
        let width = 2 * states + self.scale.len();
        let mut rows = vec![vec![T::from(0.0); width]; 2 * states];
        for (i, row) in self.misalignment.iter().enumerate() {
            rows[i][i] = T::from(1.0);
            let of_row = &mut rows[states + i];
            for (value, by) in of_row.iter_mut().zip(driven(&row[..states])) {
                *value = -by;
            }
            of_row[states..].copy_from_slice(row);
        }
        self.noise_elimination.run(&mut rows);
        for (row, left) in self.misalignment.iter_mut().zip(&rows[states..]) {
            row.copy_from_slice(&left[states..]);
        }
    }

    /// Takes the measurements of a period.
    fn measure(&mut self, step: &Step<T>) {
        let output = step.output.as_ref();
        let wandering = self.wandering.as_ref().filter(|w| w.has_accelerometers());
        let mut rows = self.misalignment.clone();
        let mut of_drift_alone = None;
        for (channel, seen) in SEEN.iter().enumerate() {
            let mut row = self.channel(seen, output.map(|o| &o[channel]), self.noise);
            if let Some(wandering) = wandering {
                let biases = wandering.seen(&step.attitude, channel);
                for (value, bias) in row[PSI..].iter_mut().zip(biases) {
                    *value = bias / T::from(self.noise);
                }
            }
            match seen.iter().any(|v| *v != 0.0) || wandering.is_some() {
                true => rows.push(row),
                false => of_drift_alone = output.is_some().then_some(row),
            }
        }
        if let Some(noise) = self.azimuth_noise {
            let mut azimuth = [0.0; 3];
            azimuth[UP] = 1.0;
            rows.push(self.channel(&azimuth, None, noise));
        }
        self.misalignment_elimination.run(&mut rows);
        let left = rows.split_off(self.states);
        self.misalignment = rows;
        let all = left.iter().chain(&of_drift_alone);
        self.drift.add(all.map(|row| &row[self.states..]));
    }

    /// A row of unit noise for a measurement that sees so much of ψ^n, and what the accelerometers
    /// add.
    fn channel(&self, seen: &[f64; 3], output: Option<&Vec<T>>, noise: f64) -> Vec<T> {
        let noise = T::from(noise);
        let mut row: Vec<T> = ORDER
            .iter()
            .map(|&axis| T::from(seen[axis]) / noise)
            .collect();
        row.resize(self.states, T::from(0.0));
        match output {
            Some(output) => {
                let scaled = output.iter().zip(&self.scale);
                row.extend(scaled.map(|(v, s)| *v * *s / noise));
            }
            None => row.resize(self.states + self.scale.len(), T::from(0.0)),
        }
        row
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

    /// What the filter comes to, the `last` of the parameters last.
    fn told(&self, last: &[usize]) -> Told<T> {
        self.drift.told(&self.estimated, last, &self.considered)
    }

    /// The states in terms of the estimates' errors and of what is ignored, from what is told of D/s.
    fn followed(&self, told: &Told<T>, ignored: &[usize]) -> Followed<T> {
        let states = self.states;
        let mut rows = self.misalignment.clone();
        Elimination::new(states, states + self.scale.len(), states).run(&mut rows);
        let own = inverse_of(&rows, states);
        // By what is left over, by the estimates' errors and by what is not known of.
        let through = |of: &dyn Fn(&[T]) -> Vec<T>| {
            let parts: Vec<Vec<T>> = rows.iter().map(|row| of(&row[states..])).collect();
            DMatrix::from_fn(states, parts[0].len(), |i, j| {
                let parts = own[i].iter().zip(&parts);
                parts.fold(T::from(0.0), |sum, (own, part)| sum + *own * part[j])
            })
        };
        Followed {
            own: DMatrix::from_fn(states, states, |i, j| own[i][j]),
            estimated: -through(&|row| combined(row, &told.pivots, &told.root)),
            ignored: -through(&|row| {
                let mut parts = combined(row, &told.pivots, &told.bias);
                for (part, &c) in parts.iter_mut().zip(ignored) {
                    *part += row[c];
                }
                parts
            }),
        }
    }

    /// What the random walk of the drift has come to, where it has one.
    fn walked(&self, of: &Followed<T>) -> Option<Walked> {
        let has_walk = self.wandering.as_ref().is_some_and(Wandering::has_walk);
        let rows = |m: &DMatrix<T>| m.rows(PSI, 3).map(T::f64);
        has_walk.then(|| Walked {
            own: rows(&of.own),
            by_estimates: rows(&of.estimated),
            by_ignored: rows(&of.ignored),
        })
    }

    fn report(&self, observe: &mut dyn FnMut(&Moment)) {
        let told = self.told(&self.estimated);
        let mut sigma = CoefficientVector::zeros();
        for (k, &parameter) in told.pivots.iter().enumerate() {
            if parameter < COEFFICIENTS {
                let parts = told.root[k].iter().chain(&told.bias[k]);
                let squares: f64 = parts.map(|v| v.f64() * v.f64()).sum();
                sigma[parameter] = squares.sqrt() * self.scale[parameter].f64();
            }
        }
        let has_walk = self.wandering.as_ref().is_some_and(Wandering::has_walk);
        let walked = has_walk.then(|| self.followed(&told, &self.considered));
        if let Some(walked) = walked.and_then(|followed| self.walked(&followed)) {
            let [root, bias] = [&told.root, &told.bias].map(|m| self.scaled(&told, m));
            for (gyro, of) in walked.sigma(&told.pivots, &root, &bias) {
                sigma[gyro] = of;
            }
        }
        observe(&Moment {
            time_s: self.time_s,
            leg: self.leg,
            sigma_deg_per_h: sigma,
        });
    }

    /// In the parameters' units.
    fn scaled(&self, told: &Told<T>, rows: &[Vec<T>]) -> DMatrix<f64> {
        let columns = rows.first().map_or(0, Vec::len);
        DMatrix::from_fn(rows.len(), columns, |i, j| {
            (rows[i][j] * self.scale[told.pivots[i]]).f64()
        })
    }

    fn budget(&self) -> Vec<IgnoredGroup> {
        let twelve = coefficients();
        let questions = Question::of_budget(&self.platform.errors);
        let answered = questions.into_iter().map(|(group, role, question)| {
            let estimated = [&twelve[..], &question.others].concat();
            let told = self.drift.told(&estimated, &twelve, &question.ignored);
            let mut bias = self.scaled(&told, &told.bias);
            if let Some(walked) = self.walked(&self.followed(&told, &question.ignored)) {
                walked.add_to_bias(&told.pivots, &mut bias);
            }
            IgnoredGroup {
                group,
                role,
                error_deg_per_h: errors_of_coefficients(&told.pivots, &bias),
            }
        });
        answered.collect()
    }

    fn end(&self) -> Result<FullCovariance> {
        let told = self.told(&coefficients());
        let followed = self.followed(&told, &self.considered);
        let full = FullCovariance::new(Outcome {
            root: self.scaled(&told, &told.root),
            bias: self.scaled(&told, &told.bias),
            misalignment: followed.misalignment(),
            walked: self.walked(&followed),
            budget: self.budget(),
            pivots: told.pivots,
        });
        match full.is_finite() {
            true => Ok(full),
            false => Err(Error::numerical(
                "the square-root filter overflows double precision: the noises, the prior and \
                 the durations are too far apart to give a trustworthy number",
            )),
        }
    }
}

/// The states: what of them is their own, unit by unit, and what follows from the estimates' errors and
/// from one s of each parameter that is ignored.
struct Followed<T: Real> {
    own: DMatrix<T>,
    estimated: DMatrix<T>,
    ignored: DMatrix<T>,
}

impl<T: Real> Followed<T> {
    /// Covariance of ψ^n.
    fn misalignment(&self) -> Matrix3<f64> {
        let square = |m: &DMatrix<T>| {
            let psi = m.rows(0, PSI);
            psi * psi.transpose()
        };
        let ordered = square(&self.own) + square(&self.estimated) + square(&self.ignored);
        let mut covariance = Matrix3::zeros();
        for i in 0..3 {
            for j in 0..3 {
                covariance[(ORDER[i], ORDER[j])] = ordered[(i, j)].f64();
            }
        }
        covariance
    }
}

/// Σ_k row_k a_k of three rows.
fn combination<T: Real>(row: &[T; 3], a: &Drive<T>) -> Vec<T> {
    let of = |j: usize| row[0] * a[0][j] + row[1] * a[1][j] + row[2] * a[2][j];
    (0..a[0].len()).map(of).collect()
}

/// `row` on the parameters times `matrix`, whose rows belong to the `pivots`.
fn combined<T: Real>(row: &[T], pivots: &[usize], matrix: &[Vec<T>]) -> Vec<T> {
    let mut sum = vec![T::from(0.0); matrix.first().map_or(0, Vec::len)];
    for (&parameter, of) in pivots.iter().zip(matrix) {
        for (sum, value) in sum.iter_mut().zip(of) {
            *sum += row[parameter] * *value;
        }
    }
    sum
}
