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
//! # Filters
//!
//! [`FilterModel::Linear`] is the paper's: the Kalman filter on (8), (9), linearised at ψ = 0.
//! Its gains do not depend on the data and are computed once for all runs.
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
//! tilt changes the specific force and so the drift. The measurement equation is (9) unchanged.
//!
//! [`FilterModel::Iterated`] linearises about the estimate of the *whole* test: it traces the
//! estimate back to the start, goes through the measurements again with the same prior, and
//! repeats that until the estimate stays (Gauss–Newton). It forgets what early, wrong points of
//! linearisation did to the extended filter.

pub mod consistency;
pub mod divergence;
mod ekf;
pub mod judgement;
mod monte_carlo;
mod options;
mod program;
pub mod specification;
mod square_root;
mod sweep;
mod trajectory;
mod truth;

pub use monte_carlo::{MAX_RUNS, MonteCarlo, PositionCheck, StateCheck};
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

use ekf::{Belief, ExtendedFilter, Filter, LinearFilter, LinearGains};
use program::Program;
use square_root::StateVector;
use truth::{TrueNoise, TruthRecord};

/// A test ready to be simulated. The filter starts from zero with the platform's prior.
///
/// ```
/// use scheme_opt::internals::motion::Timeline;
/// use scheme_opt::internals::platform::PlatformConfig;
/// use scheme_opt::internals::schedule::standard::StandardScheme;
/// use scheme_opt::internals::simulate::consistency::Verdict;
/// use scheme_opt::internals::simulate::{Simulation, SimulationOptions};
///
/// let platform = PlatformConfig::default().check()?;
/// let schedule = StandardScheme::from_name("icosahedron-12")?.schedule(6000.0, &platform)?;
/// let timeline = Timeline::new(&platform, &schedule)?;
/// let simulation = Simulation::new(&platform, &timeline, SimulationOptions::default())?;
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
    /// 1σ that truths are drawn with.
    prior_sigma: StateVector,
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
    nis: Option<f64>,
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
        let program = Program::new(platform, timeline)?;
        let belief = Belief::new(platform, &options.told);
        let gains = LinearGains::new(&program, &belief, &mut |_| {});
        Ok(Self {
            platform: platform.clone(),
            options,
            prior_sigma: belief.prior_sigma,
            program,
            belief,
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
            },
            TruthNoise::None => TrueNoise {
                drift_psd: 0.0,
                accelerometer_g: 0.0,
            },
        };
        let (model, earth) = (self.options.truth, &self.belief.earth_rate_n);
        TruthRecord::new(&self.program, earth, model, initial, noise, random)
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
            let filter = Filter::Linear(LinearFilter::new(&self.gains));
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
        for (index, interval) in self.program.intervals.iter().enumerate() {
            filter.advance(&self.program, interval);
            let nis = interval
                .measured
                .then(|| filter.measure(interval, &record.z[index]));
            observe(&FinishedInterval {
                index,
                record,
                filter: &filter,
                nis,
            });
        }
        filter
    }
}

/// The generator of run number `run`: a stream of its own.
fn stream(seed: u64, run: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(run);
    random
}
