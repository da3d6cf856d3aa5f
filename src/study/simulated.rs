//! The Monte Carlo simulation of a study.

use super::Study;
use crate::error::{Error, Result};
use crate::motion::Timeline;
use crate::results::SimulationDocument;
use crate::schedule::Schedule;
use crate::simulate::{PriorSize, Simulation, SimulationOptions, SweepPoint, Trajectory, sweep};
use crate::units::Angle;

/// Misalignments of a sweep, degrees.
const SWEPT_DEG: [f64; 8] = [0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0];
/// Factors on the prior of the drift in a sweep.
const SWEPT_FACTORS: [f64; 7] = [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0];

/// What to simulate.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SimulationRequest {
    /// How many runs, from truths drawn from the prior.
    pub runs: usize,
    /// Truth, filter, and what the filter is told.
    pub options: SimulationOptions,
    /// Whether sizes of misalignment and drift are swept too.
    pub sweep: bool,
}

impl Default for SimulationRequest {
    /// A hundred runs with the nonlinear truth and the iterated filter.
    fn default() -> Self {
        Self {
            runs: 100,
            options: SimulationOptions::default(),
            sweep: false,
        }
    }
}

impl SimulationRequest {
    /// So many runs with these options.
    #[must_use]
    pub fn new(runs: usize, options: SimulationOptions) -> Self {
        Self {
            runs,
            options,
            ..Self::default()
        }
    }
}

/// What a simulation showed.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationResult {
    document: SimulationDocument,
    #[cfg(feature = "cli")]
    swept: Vec<SweepPoint>,
    trajectory: Trajectory,
}

impl SimulationResult {
    /// The simulation as data, in the form of `simulate --json`.
    pub fn document(&self) -> &SimulationDocument {
        &self.document
    }

    /// The first run against time, as CSV: states, estimates and errors with their σ.
    pub fn curves_csv(&self) -> String {
        self.trajectory.to_csv()
    }

    #[cfg(feature = "cli")]
    pub(crate) fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    #[cfg(feature = "cli")]
    pub(crate) fn swept(&self) -> &[SweepPoint] {
        &self.swept
    }

    /// The report as one HTML page that needs nothing else.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when the page cannot be made.
    #[cfg(feature = "report")]
    pub fn report_html(&self) -> Result<String> {
        crate::report::html::simulation(&self.document)
    }
}

impl Study {
    /// Plays `schedule` through with a true platform and a filter, many times, from the study's
    /// seed.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when the platform cannot run the schedule, or for what is asked.
    ///
    /// ```
    /// use scheme_opt::{Schedule, SimulationRequest, StandardScheme, Study};
    /// let study = Study::from_toml("[objective]\ntotal_time_s = 6000\n")?;
    /// let schedule = study.standard(StandardScheme::Icosahedron12)?;
    /// let mut request = SimulationRequest::default();
    /// request.runs = 20;
    /// assert_eq!(study.simulate(&schedule, &request)?.document().runs, 20);
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn simulate(
        &self,
        schedule: &Schedule,
        request: &SimulationRequest,
    ) -> Result<SimulationResult> {
        let test = self.checked.test();
        let timeline = Timeline::new(test, schedule)?;
        let simulation = Simulation::new(test.platform(), &timeline, request.options)?;
        let seed = self.config().search.seed;
        let (found, swept) = self.on_threads(|| {
            let found = simulation.monte_carlo(request.runs, seed)?;
            let swept = match request.sweep {
                true => self.sweep(&timeline, request)?,
                false => Vec::new(),
            };
            Ok::<_, Error>((found, swept))
        })??;
        let inputs = self.inputs();
        let options = &request.options;
        let document = SimulationDocument::new(&found, options, &swept, schedule, &inputs);
        Ok(SimulationResult {
            document,
            trajectory: simulation.trajectory(&simulation.draw(seed, 0), seed, 0),
            #[cfg(feature = "cli")]
            swept,
        })
    }

    /// First the misalignment with the drift as it is, then the drift with the misalignment of the
    /// platform's worst axis.
    fn sweep(&self, timeline: &Timeline, request: &SimulationRequest) -> Result<Vec<SweepPoint>> {
        let platform = self.checked.test().platform();
        let own = platform.prior_misalignment_rad().max();
        let own_deg = Angle::from_rad(own).deg();
        let by_misalignment = SWEPT_DEG.map(|misalignment_deg| PriorSize {
            misalignment_deg,
            drift_factor: 1.0,
        });
        let by_drift = SWEPT_FACTORS.map(|drift_factor| PriorSize {
            misalignment_deg: own_deg,
            drift_factor,
        });
        let sizes: Vec<PriorSize> = by_misalignment.into_iter().chain(by_drift).collect();
        let seed = self.config().search.seed;
        sweep(
            platform,
            timeline,
            request.options,
            &sizes,
            request.runs,
            seed,
        )
    }
}
