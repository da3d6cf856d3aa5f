//! Many runs: RMS errors against predicted σ, NEES and NIS against χ² bounds.

use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::error::{Error, Result};
use crate::units::Angle;

use super::consistency::{Consistency, rms_ratio_bounds};
use super::divergence::{Divergence, RunSquares};
use super::square_root::{Nees, PSI, STATES, SquareRoot, StateVector};
use super::{InitialTruth, Simulation, stream};

/// Most runs of a Monte Carlo experiment.
pub const MAX_RUNS: usize = 1_000_000;

/// RMS error of one state at the end of the test, against what the filter says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateCheck {
    /// √(mean of squared errors): °/h for a coefficient, arcsec for a misalignment.
    pub rms_error: f64,
    /// √(mean of the filter's variances), same unit.
    pub sigma: f64,
    /// 1σ by the linear model, known before any test: that of the covariance chain, when the
    /// filter is told the truth.
    pub planned_sigma: f64,
    /// √(mean of (error/σ)²): 1 for a consistent filter; none for a state known exactly.
    pub ratio: Option<f64>,
}

/// NEES at the end of one position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionCheck {
    /// When the position is left, s.
    pub end_s: f64,
    /// Over all states.
    pub nees: Option<Consistency>,
    /// Over the coefficients.
    pub nees_coefficients: Option<Consistency>,
}

/// What many runs of a test show.
#[derive(Debug, Clone, PartialEq)]
pub struct MonteCarlo {
    /// How many runs.
    pub runs: usize,
    /// Seed of the random streams.
    pub seed: u64,
    /// The coefficients, D_FX to D_SZ, °/h.
    pub coefficients: [StateCheck; COEFFICIENTS],
    /// ψ^n about North, Up, East, arcsec.
    pub misalignment: [StateCheck; 3],
    /// Where 95 of 100 ratios of a consistent filter lie.
    pub ratio_bounds: [f64; 2],
    /// Duration of the test, s.
    pub total_time_s: f64,
    /// At the end of every position.
    pub positions: Vec<PositionCheck>,
    /// NEES over all states at the end; none when everything is known exactly. Its bounds, and
    /// those of the two that follow, are such that all three of a consistent filter lie within in
    /// 95 of 100 experiments.
    pub nees: Option<Consistency>,
    /// NEES over the coefficients at the end.
    pub nees_coefficients: Option<Consistency>,
    /// NIS over the ticks of all runs; none without a measurement.
    pub nis: Option<Consistency>,
    /// The runs that diverged.
    pub divergence: Divergence,
    /// RMS over the runs of the largest angle the platform was off the computed frame, degrees.
    pub rms_largest_misalignment_deg: f64,
}

impl MonteCarlo {
    /// √(mean over the coefficients of the squared RMS errors), °/h.
    pub fn rms_error_deg_per_h(&self) -> f64 {
        self.rms_of(|c| c.rms_error)
    }

    /// √(mean over the coefficients of the filter's variances), °/h.
    pub fn rms_sigma_deg_per_h(&self) -> f64 {
        self.rms_of(|c| c.sigma)
    }

    /// The same of the linear model, °/h.
    pub fn rms_planned_sigma_deg_per_h(&self) -> f64 {
        self.rms_of(|c| c.planned_sigma)
    }

    fn rms_of(&self, part: impl Fn(&StateCheck) -> f64) -> f64 {
        let sum: f64 = self.coefficients.iter().map(|c| part(c).powi(2)).sum();
        (sum / COEFFICIENTS as f64).sqrt()
    }
}

/// What one run leaves.
struct RunRecord {
    error: StateVector,
    sigma: StateVector,
    nees: Vec<Nees>,
    nis: f64,
    /// By the last pass of an iterated filter, squared and in σ.
    moved: Option<f64>,
    largest_misalignment_deg: f64,
}

impl RunRecord {
    /// What tells whether the run diverged; `ticks` measurements were taken.
    fn squares(&self, ticks: usize) -> RunSquares {
        let end = self.nees.last().copied().unwrap_or_default();
        let squares = self.error[..COEFFICIENTS].iter().map(|e| e.powi(2));
        RunSquares {
            nees: end.states,
            nees_dof: end.state_dof,
            nis: self.nis,
            nis_dof: 2 * ticks,
            moved: self.moved,
            rms_error_deg_per_h: (squares.sum::<f64>() / COEFFICIENTS as f64).sqrt(),
        }
    }
}

/// The averages that make the verdict: NEES of all states and of the coefficients, NIS.
const JUDGED: usize = 3;

impl Simulation {
    /// Runs the test `runs` times with truth drawn from the prior, on rayon's threads.
    ///
    /// Every run has its own stream of the generator, so that the result depends on `seed` but
    /// not on the number of threads.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] for a number of runs outside 2 to [`MAX_RUNS`].
    pub fn monte_carlo(&self, runs: usize, seed: u64) -> Result<MonteCarlo> {
        if !(2..=MAX_RUNS).contains(&runs) {
            let allowed = format!("2 to {MAX_RUNS}");
            return Err(Error::out_of_range("runs", runs, &allowed));
        }
        let records: Vec<RunRecord> = (0..runs as u64)
            .into_par_iter()
            .map(|run| self.one_run(seed, run))
            .collect();
        self.summary(&records, seed)
    }

    /// Truth drawn from the prior, for run number `run` of `seed`.
    pub fn draw(&self, seed: u64, run: u64) -> InitialTruth {
        let mut random = stream(seed, run);
        self.draw_from(&mut random)
    }

    pub(super) fn draw_from(&self, random: &mut ChaCha8Rng) -> InitialTruth {
        let mut normal = |sigma: f64| -> f64 {
            let n: f64 = StandardNormal.sample(random);
            n * sigma
        };
        let prior = &self.prior_sigma;
        InitialTruth {
            drift_deg_per_h: CoefficientVector::from_fn(|i, _| normal(prior[i])),
            misalignment_n_arcsec: Vector3::from_fn(|i, _| normal(prior[PSI + i])),
        }
    }

    fn one_run(&self, seed: u64, run: u64) -> RunRecord {
        let mut random = stream(seed, run);
        let initial = self.draw_from(&mut random);
        let mut record = RunRecord {
            error: [0.0; STATES],
            sigma: [0.0; STATES],
            nees: Vec::with_capacity(self.program.leg_ends.len()),
            nis: 0.0,
            moved: None,
            largest_misalignment_deg: 0.0,
        };
        let happened = self.record(&initial, &mut random);
        for psi in &happened.misalignment {
            let off = Angle::from_arcsec(psi.psi_n_arcsec().norm()).deg();
            record.largest_misalignment_deg = record.largest_misalignment_deg.max(off);
        }
        record.moved = self.estimate(&happened, &mut |step| {
            if step.index == 0 {
                record.nis = 0.0;
                record.nees.clear();
            }
            record.nis += step.nis.unwrap_or(0.0);
            let leg = record.nees.len();
            if self.program.leg_ends[leg] == step.index {
                let root = step.filter.root().unwrap_or(&self.gains.leg_ends[leg]);
                let psi = &step.record.misalignment[step.index];
                record.error = step.filter.error(psi, &step.record.coefficients);
                record.nees.push(root.nees(&record.error));
                record.sigma = root.sigma();
            }
        });
        record
    }

    fn summary(&self, records: &[RunRecord], seed: u64) -> Result<MonteCarlo> {
        let runs = records.len();
        let ratio_bounds = rms_ratio_bounds(runs)
            .ok_or_else(|| Error::numerical("no chi-square bounds for this number of runs"))?;
        let planned = self.gains.leg_ends.last().map(SquareRoot::sigma);
        let planned = planned.unwrap_or([f64::NAN; STATES]);
        let check = |i: usize| state_check(records, i, planned[i]);
        // Start and return too, though they are no positions: the end is theirs.
        let nees = |leg: usize, among: usize| {
            let sum = |part: fn(&Nees) -> f64| records.iter().map(|r| part(&r.nees[leg])).sum();
            let one = &records[0].nees[leg];
            let (states, coefficients) = (sum(|n| n.states), sum(|n| n.coefficients));
            (
                Consistency::of_sum(among, states, one.state_dof, runs),
                Consistency::of_sum(among, coefficients, one.coefficient_dof, runs),
            )
        };
        let check_leg = |(leg, &index): (usize, &usize)| {
            let (nees, nees_coefficients) = nees(leg, 1);
            PositionCheck {
                end_s: self.program.intervals[index].end_s,
                nees,
                nees_coefficients,
            }
        };
        let mut legs: Vec<PositionCheck> = self
            .program
            .leg_ends
            .iter()
            .enumerate()
            .map(check_leg)
            .collect();
        let (end_nees, end_nees_coefficients) = match legs.len() {
            0 => (None, None),
            legs => nees(legs - 1, JUDGED),
        };
        let nis = records.iter().map(|r| r.nis).sum();
        let ticks = self.program.ticks;
        let squares: Vec<RunSquares> = records.iter().map(|r| r.squares(ticks)).collect();
        let off = records.iter().map(|r| r.largest_misalignment_deg.powi(2));
        let end = legs.last().cloned();
        let positions = legs.drain(self.program.positions.clone()).collect();
        Ok(MonteCarlo {
            runs,
            seed,
            coefficients: std::array::from_fn(check),
            misalignment: std::array::from_fn(|i| check(PSI + i)),
            ratio_bounds,
            total_time_s: end.as_ref().map_or(0.0, |p| p.end_s),
            nees: end_nees,
            nees_coefficients: end_nees_coefficients,
            nis: Consistency::of_sum(JUDGED, nis, 2, runs * ticks),
            divergence: Divergence::of(&squares),
            rms_largest_misalignment_deg: (off.sum::<f64>() / runs as f64).sqrt(),
            positions,
        })
    }
}

fn state_check(records: &[RunRecord], i: usize, planned_sigma: f64) -> StateCheck {
    let mean = |part: &dyn Fn(&RunRecord) -> f64| {
        records.iter().map(part).sum::<f64>() / records.len() as f64
    };
    let known = records.iter().any(|r| r.sigma[i] == 0.0);
    StateCheck {
        rms_error: mean(&|r| r.error[i].powi(2)).sqrt(),
        sigma: mean(&|r| r.sigma[i].powi(2)).sqrt(),
        planned_sigma,
        ratio: (!known).then(|| mean(&|r| (r.error[i] / r.sigma[i]).powi(2)).sqrt()),
    }
}
