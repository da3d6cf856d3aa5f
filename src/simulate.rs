//! Simulation of a test: a nonlinear true platform, a filter at work on its measurements, and
//! many such runs to see whether the errors are as large as the filter says.
//!
//! # Equations of the true platform
//!
//! The paper writes everything to first order in ψ. Without that, (1) reads
//! `C_c^p = exp(−[ψ×])`: p is c turned by ψ (with `C_i^j` from i to j, as the paper defines it;
//! only so do (5) and (6), where `−C_c^p g^c + g^c` becomes `−[g^c×] ψ`, agree with it). The
//! platform executes the commanded rate ω_c in its own axes and drifts:
//!
//! ```text
//! ω_ip^p = ω_c + ε^p                             ε^p = D_F + M g^p + w          (3)
//! d/dt C_p^n = C_p^n [ω_ip^p×] − [ω_ie^n×] C_p^n,   the same for c with ω_c
//! ```
//!
//! where g^p = C_n^p g^n is what the true platform feels ((4), with the sign that its own later
//! equations need). To first order in ψ the difference of p and c is (2), ψ̇ = ψ × ω_c + ε.
//! Exactly, with E = C_p^n C_n^c = exp([ψ^n×]), the rotation in n that takes the computed
//! platform to the true one, the commanded rate **cancels**:
//!
//! ```text
//! Ė = [ε^n×] E + E [ω_ie^n×] − [ω_ie^n×] E,     ε^n = C_p^n ε^p = A(C_p^n) D + w^n
//! ```
//!
//! whose first order is (8). So ψ^n is continuous across a slew without any approximation; what
//! a slew changes is C_c^n and with it g^p. Kept are the products the paper drops after (3) and
//! before (11): the drift acts in the true platform's axes and feels the true platform's tilt.
//! Integrated by the classical fourth-order Runge–Kutta method on the quaternion of E, one step a
//! filter period, more while the platform turns. The measurement is (5), (6):
//! `Z = −C_n^p g^n + g^c + v`, three accelerometers.
//!
//! In `frame-hold` repositioning C_c^p is kept while C_c^n jumps: E ← Q E Qᵀ with
//! Q = C_{k+1} C_kᵀ.
//!
//! The random drift is held over a filter period, with the variance q / period that makes its
//! average over a period have the 1σ of the platform file, and in n, where holding it leaves its
//! covariance q t I during a slew too (w is isotropic).
//!
//! # Errors beyond the twelve coefficients
//!
//! With an error of the torquers the commanded rate no longer cancels: they turn the platform by
//! (1 + T) ω_c, ω_c = C_n^c ω_ie^n + ω_nc^c as it was **commanded** for the computed axes, so that ε^p
//! gains T ω_c. A move that takes no time still turns them: E is integrated along the way of the gimbals
//! with no time passing. Only frame-hold has no such jump. The gyros' quadratic drift is one of the
//! g^p that the true platform feels, 1 + G times as large as the gravity that is used. The
//! accelerometers show f^p + δZ(f^p), f^p = −(1 + G) C_n^p g^n, with all their terms at the force that
//! they feel; all three channels are simulated. An azimuth reference shows how far what should point
//! North points off it about Up. The truth of first order has the same to first order in ψ and in the
//! parameters ([`model`](crate::model)).
//!
//! A **considered** parameter is drawn for the truth like any other, and the filter does not know of
//! it. Its error then is not what it claims. With the filter's own gains the effect of each considered
//! parameter is carried along, and everything is compared with the true covariance P + Σ_c S Sᵀ:
//! what the filter claims, P, beside it. Innovations of such a filter are no white noise; NIS is taken of
//! what is left of them without the share of the considered parameters, which a simulation knows.
//!
//! # Drift and biases that wander
//!
//! Truth and filter have them as states: three for each process, along the axes of the platform. An
//! interval takes the mean of the drift in it, with its exact covariance with the value at its end; in a
//! move the mean turns with the platform. Nothing wanders of what a filter linearises about: all of it
//! is in the deviation. NEES of all states has these too. D_F is reported as the drift of the moment, its
//! constant part and what the random walk has come to, for the truth as for the estimate.
//! A filter may be told that all noise is white ([`ToldNoise::only_white`]).
//!
//! # Filters
//!
//! [`FilterModel::Linear`] is the paper's: the Kalman filter on (8), (9), linearised at ψ = 0.
//! Its gains do not depend on the data and are computed once for all runs. It has the states that are
//! estimated; the vertical channel too where these tell of the accelerometers, and the azimuth.
//!
//! That model asks more than a small ψ: it drops ψ × ε. With drifts of 10 °/h left
//! uncompensated the platform turns by degrees within a position, and the dropped products
//! exceed the σ that the test reaches by orders of magnitude. [`FilterModel::Extended`]
//! linearises about its estimate. With the error η on the left, E = exp([η×]) Ê, the exact
//! equation gives
//!
//! ```text
//! η̇ = (−[ω_ie^n×] + M^n [g^n×]) η + A(Ĉ_p^n) δD + w^n,     M^n = Ĉ_p^n M̂ Ĉ_n^p
//! Ê (C_c^n Z − Ẑ^n) = η × g^n + v = (η_z, 0, −η_x) + v
//! ```
//!
//! the linear filter with the attitude the platform is estimated to have, and one more term: the
//! tilt changes the specific force and so the drift. M is ∂ε/∂g at that attitude; the torquers' part has
//! the commanded rate for a feature. The measurement equation is (9) unchanged; with errors of
//! the accelerometers η × g is turned by Ĉ_p^n (I + ∂δZ/∂f) Ĉ_n^p, and the parameters add δZ at Ĉ_p^n.
//!
//! [`FilterModel::Iterated`] linearises about the estimate of the *whole* test: it traces the
//! estimate back to the start, goes through the measurements again with the same prior, and
//! repeats that until the estimate stays (Gauss–Newton). It forgets what early, wrong points of
//! linearisation did to the extended filter.

mod belief;
mod channels;
pub mod consistency;
pub mod divergence;
mod ekf;
mod filter;
mod instruments;
pub mod judgement;
mod linear;
mod monte_carlo;
mod normal;
mod options;
mod program;
pub mod specification;
mod square_root;
mod states;
mod sweep;
mod trajectory;
mod truth;
mod wander;

pub use monte_carlo::{
    ClaimedConsistency, MAX_RUNS, MonteCarlo, ParameterCheck, PositionCheck, StateCheck,
};
pub use options::{
    FilterModel, InitialTruth, SimulationOptions, ToldNoise, TruthModel, TruthNoise,
};
pub use program::MAX_INTERVALS;
pub use sweep::{PriorSize, SweepPoint, largest_without_optimism, sweep};
pub use trajectory::{Sample, Trajectory};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::error::Result;
use crate::motion::Timeline;
use crate::platform::Platform;

use belief::Belief;
use ekf::ExtendedFilter;
use filter::Filter;
use linear::{LinearFilter, LinearGains};
use program::Program;
use truth::{Start, TrueNoise, TruthRecord};
use wander::Wandering;

/// A test ready to be simulated. The filter starts from zero with the platform's prior.
///
/// ```
/// use scheme_opt::internals::motion::{Test, Timeline};
/// use scheme_opt::internals::platform::PlatformConfig;
/// use scheme_opt::internals::schedule::standard::StandardScheme;
/// use scheme_opt::internals::simulate::consistency::Verdict;
/// use scheme_opt::internals::simulate::{Simulation, SimulationOptions};
///
/// let test = Test::from(PlatformConfig::default().check()?);
/// let schedule = StandardScheme::from_name("icosahedron-12")?.schedule(6000.0, &test)?;
/// let timeline = Timeline::new(&test, &schedule)?;
/// let simulation = Simulation::new(test.platform(), &timeline, SimulationOptions::default())?;
/// let found = simulation.monte_carlo(20, 1)?;
/// assert_eq!(found.nees.map(|n| n.verdict), Some(Verdict::Consistent));
/// # Ok::<(), scheme_opt::Error>(())
/// ```
#[derive(Debug)]
pub struct Simulation {
    platform: Platform,
    options: SimulationOptions,
    program: Program,
    belief: Belief,
    /// What wanders in truth.
    wandering: Option<Wandering>,
    /// Of the linear filter.
    gains: LinearGains,
}

/// Most passes of an iterated filter; two or three are usual.
const MOST_PASSES: usize = 6;

/// An iterated filter stops when its estimate lies within this, squared and in σ, of what it was
/// linearised about.
const CONVERGED: f64 = 0.01;

/// One interval of a run, done.
struct FinishedInterval<'s, 'a> {
    index: usize,
    record: &'s TruthRecord,
    filter: &'s Filter<'a>,
    nis: Option<Nis>,
}

/// Normalised innovation squared of one tick.
#[derive(Debug, Clone, Copy, Default)]
struct Nis {
    /// By the filter's own claims.
    claimed: f64,
    /// Without the share of the considered parameters; where there are none the same.
    own: f64,
}

impl Simulation {
    /// Prepares.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`].
    pub fn new(
        platform: &Platform,
        timeline: &Timeline,
        options: SimulationOptions,
    ) -> Result<Self> {
        options.check()?;
        let belief = Belief::new(platform, &options.told)?;
        let program = Program::new(platform, timeline, belief.wandering.as_ref())?;
        let is_linear = options.filter == FilterModel::Linear;
        let gains = LinearGains::new(&program, &belief, is_linear);
        Ok(Self {
            platform: platform.clone(),
            options,
            program,
            belief,
            wandering: Wandering::of(platform),
            gains,
        })
    }

    /// The options.
    pub fn options(&self) -> &SimulationOptions {
        &self.options
    }

    /// What happens in one run.
    fn record(&self, initial: &InitialTruth, random: &mut ChaCha8Rng) -> TruthRecord {
        let noise = match self.options.noise {
            TruthNoise::Drawn => TrueNoise {
                drift_psd: self.platform.drift_psd_rad2_per_s(),
                accelerometer_g: self.platform.noise_g(),
                azimuth_rad: self.platform.azimuth_noise_rad(),
                wandering: self.wandering.as_ref(),
            },
            TruthNoise::None => TrueNoise {
                drift_psd: 0.0,
                accelerometer_g: 0.0,
                azimuth_rad: self.platform.azimuth_noise_rad().map(|_| 0.0),
                wandering: None,
            },
        };
        let mut parameters = initial.drift_deg_per_h.as_slice().to_vec();
        parameters.extend(&initial.others);
        parameters.resize(self.platform.errors().parameters().len(), 0.0);
        let start = Start {
            misalignment_n_arcsec: &initial.misalignment_n_arcsec,
            instruments: &self.belief.layout.instruments(&parameters),
            parameters,
        };
        let (model, earth) = (self.options.truth, &self.belief.earth_rate_n);
        TruthRecord::new(&self.program, earth, model, start, noise, random)
    }

    /// What the filter makes of a run. `observe` is called after every interval; an iterated
    /// filter goes through the test more than once and starts again at index 0. Gives how far its
    /// last pass moved the estimate, squared and in σ.
    fn estimate(
        &self,
        record: &TruthRecord,
        observe: &mut dyn FnMut(&FinishedInterval<'_, '_>),
    ) -> Option<f64> {
        if self.options.filter == FilterModel::Linear {
            let filter = LinearFilter::new(&self.gains, &self.belief.shape);
            let filter = Filter::Linear(filter);
            self.pass(record, filter, observe);
            return None;
        }
        let mut moved = None;
        let mut filter = ExtendedFilter::new(&self.belief);
        let passes = match self.options.filter {
            FilterModel::Iterated => MOST_PASSES,
            FilterModel::Linear | FilterModel::Extended => 1,
        };
        for pass in 1..=passes {
            let Filter::Extended(done) = self.pass(record, Filter::Extended(filter), observe)
            else {
                return None;
            };
            if pass > 1 {
                let deviation = done.deviation();
                moved = Some(deviation);
                if deviation < CONVERGED {
                    break;
                }
            }
            filter = ExtendedFilter::about(&self.belief, done.retraced(&self.program));
        }
        moved
    }

    /// Takes `filter` through the test.
    fn pass<'a>(
        &self,
        record: &TruthRecord,
        mut filter: Filter<'a>,
        observe: &mut dyn FnMut(&FinishedInterval<'_, '_>),
    ) -> Filter<'a> {
        let considered = self.considered_in_sigma(record);
        for (index, interval) in self.program.intervals.iter().enumerate() {
            filter.advance(&self.program, interval);
            let nis = interval.measured.then(|| {
                let mut nis = Nis::default();
                filter.measure(
                    interval,
                    &record.measured[index],
                    &mut |innovation, gain| {
                        let by_considered = considered.iter().zip(&gain.by_considered);
                        let share: f64 = by_considered.map(|(c, by)| c * by).sum();
                        nis.claimed += innovation.powi(2);
                        nis.own += (innovation - share / gain.innovation_sigma).powi(2);
                    },
                );
                nis
            });
            observe(&FinishedInterval {
                index,
                record,
                filter: &filter,
                nis,
            });
        }
        filter
    }

    /// The considered parameters of a run in their prior 1σ.
    fn considered_in_sigma(&self, record: &TruthRecord) -> Vec<f64> {
        let considered = &record.parameters[self.belief.estimated()..];
        let in_sigma = |(value, sigma): (&f64, &f64)| match *sigma > 0.0 {
            true => value / sigma,
            false => 0.0,
        };
        let sigma = &self.belief.considered_sigma;
        considered.iter().zip(sigma).map(in_sigma).collect()
    }
}

/// The generator of run number `run`: a stream of its own.
fn stream(seed: u64, run: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(run);
    random
}
