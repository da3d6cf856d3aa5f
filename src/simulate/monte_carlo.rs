//! Many runs: RMS errors against predicted σ, NEES and NIS against χ² bounds.

use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::error::{Error, Result};
use crate::model::{Parameter, Role};
use crate::units::Angle;

use super::consistency::{Consistency, rms_ratio_bounds};
use super::divergence::{Divergence, RunSquares};
use super::square_root::{Knowledge, Nees, SquareRoot};
use super::states::Shape;
use super::{InitialTruth, Nis, Simulation, stream};

/// Most runs of a Monte Carlo experiment.
pub const MAX_RUNS: usize = 1_000_000;

/// RMS error of one state at the end of the test, against what is expected of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateCheck {
    /// √(mean of squared errors): °/h for a coefficient, arcsec for a misalignment, else in the unit of
    /// the parameter.
    pub rms_error: f64,
    /// √(mean of the variances), same unit: the truth, which counts what the filter ignores.
    pub sigma: f64,
    /// The same as the filter claims it; none: nothing is considered.
    pub claimed_sigma: Option<f64>,
    /// 1σ by the linear model, known before any test: that of the covariance chain, when the
    /// filter is told the truth.
    pub planned_sigma: f64,
    /// √(mean of (error/σ)²): 1 when errors are as expected; none for a state known exactly.
    pub ratio: Option<f64>,
}

/// The same of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterCheck {
    /// Which.
    pub parameter: Parameter,
    /// Its errors; of a considered one the values drawn against its prior, which the filter leaves as it
    /// is.
    pub check: StateCheck,
}

/// NEES at the end of one position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionCheck {
    /// When the position is left, s.
    pub end_s: f64,
    /// Over all states.
    pub nees: Option<Consistency>,
    /// Over the estimated parameters; none where they are the coefficients alone.
    pub nees_parameters: Option<Consistency>,
    /// Over the coefficients.
    pub nees_coefficients: Option<Consistency>,
}

/// What many runs of a test show. All is compared with the true covariance; where parameters are
/// considered, that is more than the filter claims.
#[derive(Debug, Clone, PartialEq)]
pub struct MonteCarlo {
    /// How many runs.
    pub runs: usize,
    /// Seed of the random streams.
    pub seed: u64,
    /// The coefficients, D_FX to D_SZ, °/h.
    pub coefficients: [StateCheck; COEFFICIENTS],
    /// All parameters of the platform in its order, the coefficients first.
    pub parameters: Vec<ParameterCheck>,
    /// ψ^n about North, Up, East, arcsec.
    pub misalignment: [StateCheck; 3],
    /// Where 95 of 100 ratios of a consistent filter lie.
    pub ratio_bounds: [f64; 2],
    /// Duration of the test, s.
    pub total_time_s: f64,
    /// At the end of every position.
    pub positions: Vec<PositionCheck>,
    /// NEES over all states at the end; none when everything is known exactly. Its bounds, and
    /// those of the two or three that follow, are such that all of a consistent filter lie within in
    /// 95 of 100 experiments.
    pub nees: Option<Consistency>,
    /// NEES over the estimated parameters at the end; none where they are the coefficients alone.
    pub nees_parameters: Option<Consistency>,
    /// NEES over the coefficients at the end.
    pub nees_coefficients: Option<Consistency>,
    /// NIS over the ticks of all runs, of what the innovations are without the share of the considered
    /// parameters; none without a measurement.
    pub nis: Option<Consistency>,
    /// What the filter's own claims come to; none: nothing is considered, and they are the above.
    pub claimed: Option<ClaimedConsistency>,
    /// The runs that diverged.
    pub divergence: Divergence,
    /// RMS over the runs of the largest angle the platform was off the computed frame, degrees.
    pub rms_largest_misalignment_deg: f64,
}

/// Averages by the claims of a filter that does not know of all parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClaimedConsistency {
    /// NEES over all states at the end.
    pub nees: Option<Consistency>,
    /// NIS over the ticks of all runs: what is seen at the stand.
    pub nis: Option<Consistency>,
}

impl MonteCarlo {
    /// √(mean over the coefficients of the squared RMS errors), °/h.
    pub fn rms_error_deg_per_h(&self) -> f64 {
        self.rms_of(|c| c.rms_error)
    }

    /// √(mean over the coefficients of the variances), °/h: the truth.
    pub fn rms_sigma_deg_per_h(&self) -> f64 {
        self.rms_of(|c| c.sigma)
    }

    /// The same as the filter claims it, °/h; none: nothing is considered.
    pub fn rms_claimed_sigma_deg_per_h(&self) -> Option<f64> {
        let claims = self.coefficients.iter().all(|c| c.claimed_sigma.is_some());
        claims.then(|| self.rms_of(|c| c.claimed_sigma.unwrap_or(c.sigma)))
    }

    /// The groups of `[errors.considered]`, which the filter does not know of.
    pub fn ignored_groups(&self) -> Vec<&'static str> {
        let considered = self.parameters.iter().map(|p| p.parameter);
        let considered = considered.filter(|p| p.role == Role::Considered);
        let mut groups: Vec<&'static str> = considered.map(|p| p.group).collect();
        groups.dedup();
        groups
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
    /// Of what is reported: the estimated parameters and ψ^n.
    error: Vec<f64>,
    /// Of the considered parameters: their true values.
    considered: Vec<f64>,
    sigma: Vec<f64>,
    /// Empty where nothing is considered.
    claimed_sigma: Vec<f64>,
    nees: Vec<Nees>,
    claimed_nees: Nees,
    nis: Nis,
    /// By the last pass of an iterated filter, squared and in σ.
    moved: Option<f64>,
    largest_misalignment_deg: f64,
}

impl RunRecord {
    /// What tells whether the run diverged; `measured` numbers were taken.
    fn squares(&self, measured: usize) -> RunSquares {
        let end = self.nees.last().copied().unwrap_or_default();
        let squares = self.error[..COEFFICIENTS].iter().map(|e| e.powi(2));
        RunSquares {
            nees: end.states,
            nees_dof: end.state_dof,
            nis: self.nis.own,
            nis_dof: measured,
            moved: self.moved,
            rms_error_deg_per_h: (squares.sum::<f64>() / COEFFICIENTS as f64).sqrt(),
        }
    }

    /// Sets the error of all states beside what is known at the end of a leg.
    fn compare(&mut self, error: &[f64], shape: &Shape, knowledge: &Knowledge) {
        self.error = shape.reported(error);
        let compare = |record: &mut Self, truth: &SquareRoot| {
            record.nees.push(truth.nees(error));
            record.sigma = truth.sigma();
        };
        if self.considered.is_empty() {
            return compare(self, knowledge.claimed());
        }
        compare(self, &knowledge.truth());
        self.claimed_sigma = knowledge.claimed().sigma();
        self.claimed_nees = knowledge.claimed().nees(error);
    }
}

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
        let belief = &self.belief;
        let known = &belief.prior_sigma[..belief.estimated()];
        let psi = &belief.prior_sigma[belief.shape.psi()..];
        let (twelve, others) = known.split_at(COEFFICIENTS);
        InitialTruth {
            drift_deg_per_h: CoefficientVector::from_fn(|i, _| normal(twelve[i])),
            misalignment_n_arcsec: Vector3::from_fn(|i, _| normal(psi[i])),
            others: others
                .iter()
                .chain(&belief.considered_sigma)
                .map(|sigma| normal(*sigma))
                .collect(),
        }
    }

    fn one_run(&self, seed: u64, run: u64) -> RunRecord {
        let mut random = stream(seed, run);
        let initial = self.draw_from(&mut random);
        let happened = self.record(&initial, &mut random);
        let mut record = RunRecord {
            error: Vec::new(),
            considered: happened.parameters[self.belief.estimated()..].to_vec(),
            sigma: Vec::new(),
            claimed_sigma: Vec::new(),
            nees: Vec::with_capacity(self.program.leg_ends.len()),
            claimed_nees: Nees::default(),
            nis: Nis::default(),
            moved: None,
            largest_misalignment_deg: 0.0,
        };
        for psi in &happened.misalignment {
            let off = Angle::from_arcsec(psi.psi_n_arcsec().norm()).deg();
            record.largest_misalignment_deg = record.largest_misalignment_deg.max(off);
        }
        record.moved = self.estimate(&happened, &mut |step| {
            if step.index == 0 {
                record.nis = Nis::default();
                record.nees.clear();
            }
            let nis = step.nis.unwrap_or_default();
            record.nis.own += nis.own;
            record.nis.claimed += nis.claimed;
            let leg = record.nees.len();
            if self.program.leg_ends[leg] == step.index {
                let knowledge = step.filter.knowledge().unwrap_or(&self.gains.leg_ends[leg]);
                let psi = &step.record.misalignment[step.index];
                let shape = &self.belief.shape;
                let truth = step.record.states(step.index, shape);
                let error = step.filter.error(psi, &truth);
                record.compare(&error, shape, knowledge);
            }
        });
        record
    }

    /// The averages that make the verdict: NEES of all states, of the estimated parameters where they
    /// are more than the coefficients, and of the coefficients; NIS.
    fn judged(&self) -> usize {
        3 + usize::from(self.has_others())
    }

    /// Whether more is estimated than the coefficients.
    fn has_others(&self) -> bool {
        self.belief.estimated() > COEFFICIENTS
    }

    fn summary(&self, records: &[RunRecord], seed: u64) -> Result<MonteCarlo> {
        let runs = records.len();
        let ratio_bounds = rms_ratio_bounds(runs)
            .ok_or_else(|| Error::numerical("no chi-square bounds for this number of runs"))?;
        let known = self.belief.estimated();
        let planned = self.gains.leg_ends.last().map(|k| k.truth().sigma());
        let planned = planned.unwrap_or_else(|| vec![f64::NAN; known + 3]);
        let check = |i: usize| state_check(records, i, planned[i]);
        let mut legs: Vec<PositionCheck> = (0..self.program.leg_ends.len())
            .map(|leg| self.position_check(records, leg, 1))
            .collect();
        // Start and return too, though they are no positions: the end is theirs.
        let end = legs.len().checked_sub(1);
        let end = end.map(|leg| self.position_check(records, leg, self.judged()));
        let measured = self.belief.sensors.count() * self.program.ticks;
        let squares: Vec<RunSquares> = records.iter().map(|r| r.squares(measured)).collect();
        let off = records.iter().map(|r| r.largest_misalignment_deg.powi(2));
        let positions = legs.drain(self.program.positions.clone()).collect();
        let parameters = self.platform.errors().parameters().iter().enumerate();
        let parameter_check = |(k, parameter): (usize, &Parameter)| ParameterCheck {
            parameter: *parameter,
            check: match parameter.role {
                Role::Estimated => check(k),
                Role::Considered => considered_check(records, k - known, parameter),
            },
        };
        Ok(MonteCarlo {
            runs,
            seed,
            coefficients: std::array::from_fn(check),
            parameters: parameters.map(parameter_check).collect(),
            misalignment: std::array::from_fn(|i| check(known + i)),
            ratio_bounds,
            total_time_s: end.as_ref().map_or(0.0, |p| p.end_s),
            nees: end.and_then(|p| p.nees),
            nees_parameters: end.and_then(|p| p.nees_parameters),
            nees_coefficients: end.and_then(|p| p.nees_coefficients),
            nis: self.nis(records, |n| n.own),
            claimed: self.claimed(records),
            divergence: Divergence::of(&squares),
            rms_largest_misalignment_deg: (off.sum::<f64>() / runs as f64).sqrt(),
            positions,
        })
    }

    /// NIS over the ticks of all runs.
    fn nis(&self, records: &[RunRecord], part: fn(&Nis) -> f64) -> Option<Consistency> {
        let sum = records.iter().map(|r| part(&r.nis)).sum();
        let measured = self.belief.sensors.count();
        let count = records.len() * self.program.ticks;
        Consistency::of_sum(self.judged(), sum, measured, count)
    }

    /// The averages by what a filter claims that ignores parameters.
    fn claimed(&self, records: &[RunRecord]) -> Option<ClaimedConsistency> {
        let ignores = !self.belief.considered_sigma.is_empty();
        ignores.then(|| {
            let sum = records.iter().map(|r| r.claimed_nees.states).sum();
            let dof = records[0].claimed_nees.state_dof;
            ClaimedConsistency {
                nees: Consistency::of_sum(self.judged(), sum, dof, records.len()),
                nis: self.nis(records, |n| n.claimed),
            }
        })
    }

    /// NEES at the end of a leg, its averages some of `among` that are looked at together.
    fn position_check(&self, records: &[RunRecord], leg: usize, among: usize) -> PositionCheck {
        let one = &records[0].nees[leg];
        let average = |part: fn(&Nees) -> f64, dof: usize| {
            let sum = records.iter().map(|r| part(&r.nees[leg])).sum();
            Consistency::of_sum(among, sum, dof, records.len())
        };
        let of_parameters = average(|n| n.parameters, one.parameter_dof);
        PositionCheck {
            end_s: self.program.intervals[self.program.leg_ends[leg]].end_s,
            nees: average(|n| n.states, one.state_dof),
            nees_parameters: of_parameters.filter(|_| self.has_others()),
            nees_coefficients: average(|n| n.coefficients, one.coefficient_dof),
        }
    }
}

fn mean(records: &[RunRecord], part: impl Fn(&RunRecord) -> f64) -> f64 {
    records.iter().map(part).sum::<f64>() / records.len() as f64
}

fn state_check(records: &[RunRecord], i: usize, planned_sigma: f64) -> StateCheck {
    let known = records.iter().any(|r| r.sigma[i] == 0.0);
    let claims = records.iter().all(|r| !r.claimed_sigma.is_empty());
    StateCheck {
        rms_error: mean(records, |r| r.error[i].powi(2)).sqrt(),
        sigma: mean(records, |r| r.sigma[i].powi(2)).sqrt(),
        claimed_sigma: claims.then(|| mean(records, |r| r.claimed_sigma[i].powi(2)).sqrt()),
        planned_sigma,
        ratio: (!known).then(|| mean(records, |r| (r.error[i] / r.sigma[i]).powi(2)).sqrt()),
    }
}

/// Of the considered parameter `i`: as before the test.
fn considered_check(records: &[RunRecord], i: usize, parameter: &Parameter) -> StateCheck {
    let rms_error = mean(records, |r| r.considered[i].powi(2)).sqrt();
    let sigma = parameter.prior_sigma;
    StateCheck {
        rms_error,
        sigma,
        claimed_sigma: None,
        planned_sigma: sigma,
        ratio: (sigma > 0.0).then(|| rms_error / sigma),
    }
}
