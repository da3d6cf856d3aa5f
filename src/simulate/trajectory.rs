//! One run in full: truth, estimate and 1σ against time.

use std::fmt::Write;

use nalgebra::{Matrix3, Vector3};

use crate::attitude::Attitude;
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftCoefficient};
use crate::model::{Parameter, Unit};

use super::{FilterModel, InitialTruth, Simulation, stream};

/// Truth and estimate at the end of one interval. ψ^n about North, Up, East. Covariances are the true
/// ones: where the filter ignores parameters, more than it claims.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Time since the start of the test, s.
    pub time_s: f64,
    /// Index of the position being moved to or held.
    pub leg: usize,
    /// C_c^n.
    pub attitude: Attitude,
    /// True ψ^n, the rotation vector of C_p^n C_n^c, arcsec.
    pub misalignment_n_arcsec: Vector3<f64>,
    /// Estimated ψ^n, arcsec.
    pub misalignment_n_estimate_arcsec: Vector3<f64>,
    /// η: the rotation from the estimated to the true platform, in n, arcsec. With ψ of many
    /// degrees this is not the difference of the two rotation vectors.
    pub misalignment_n_error_arcsec: Vector3<f64>,
    /// The covariance of η, arcsec².
    pub misalignment_n_covariance_arcsec2: Matrix3<f64>,
    /// True D, °/h: D_F is the drift of the moment, with what a random walk has come to.
    pub drift_deg_per_h: CoefficientVector,
    /// Estimated D, °/h.
    pub drift_estimate_deg_per_h: CoefficientVector,
    /// 1σ of D, °/h.
    pub drift_sigma_deg_per_h: CoefficientVector,
    /// Estimates of the other parameters that are estimated, each in its unit, and their 1σ.
    pub others: Vec<[f64; 2]>,
    /// Normalised innovation squared as the filter claims it, a degree of freedom for each number that
    /// is measured; none without a measurement.
    pub nis: Option<f64>,
    /// NEES over all states: the squared error in σ.
    pub nees: f64,
}

impl Sample {
    /// 1σ of ψ in n, arcsec.
    pub fn misalignment_n_sigma_arcsec(&self) -> Vector3<f64> {
        self.misalignment_n_covariance_arcsec2
            .diagonal()
            .map(f64::sqrt)
    }
}

/// One run.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// True D at the start, °/h.
    pub drift_deg_per_h: CoefficientVector,
    /// The other parameters that are estimated, with their true values.
    pub others: Vec<(Parameter, f64)>,
    /// Whether the filter ignores parameters that the platform has.
    pub ignores: bool,
    /// The end of every interval in order.
    pub samples: Vec<Sample>,
}

impl Simulation {
    /// One run from `initial`, its noise from stream `run` of `seed`.
    pub fn trajectory(&self, initial: &InitialTruth, seed: u64, run: u64) -> Trajectory {
        // Run number `run` of a Monte Carlo draws its truth first: the noise is the same.
        let mut random = stream(seed, run);
        let _ = self.draw_from(&mut random);
        let record = self.record(initial, &mut random);
        let parameters = &self.platform.errors().parameters()[..self.belief.estimated()];
        let valued = parameters.iter().copied().zip(record.parameters.clone());
        let mut trajectory = Trajectory {
            drift_deg_per_h: initial.drift_deg_per_h,
            others: valued.skip(COEFFICIENTS).collect(),
            ignores: !self.belief.considered_sigma.is_empty(),
            samples: Vec::with_capacity(self.program.intervals.len()),
        };
        // The linear filter has its gains from beforehand; what it knows goes along here.
        let mut by_gains = self.belief.knowledge();
        self.estimate(&record, &mut |step| {
            if step.index == 0 {
                trajectory.samples.clear();
            }
            let interval = &self.program.intervals[step.index];
            if self.options.filter == FilterModel::Linear {
                self.gains
                    .follow(&mut by_gains, &self.program, &self.belief, interval);
            }
            let root = step.filter.knowledge().unwrap_or(&by_gains).truth();
            let truth = &step.record.misalignment[step.index];
            let shape = &self.belief.shape;
            let estimate = step.filter.estimate(shape);
            let (d, others) = estimate.parameters.split_at(COEFFICIENTS);
            let sigma = root.sigma();
            let true_states = step.record.states(step.index, shape);
            let error = step.filter.error(truth, &true_states);
            let mut walked = true_states.clone();
            walked.resize(shape.states(), 0.0);
            let true_parameters = shape.reported(&walked);
            let psi = shape.psi();
            trajectory.samples.push(Sample {
                time_s: interval.end_s,
                leg: interval.leg,
                attitude: *interval.end_attitude(),
                misalignment_n_arcsec: truth.psi_n_arcsec(),
                misalignment_n_estimate_arcsec: estimate.psi,
                misalignment_n_error_arcsec: Vector3::from_fn(|i, _| error[psi + i]),
                misalignment_n_covariance_arcsec2: root.misalignment_covariance(),
                drift_deg_per_h: CoefficientVector::from_fn(|i, _| true_parameters[i]),
                drift_estimate_deg_per_h: CoefficientVector::from_fn(|i, _| d[i]),
                drift_sigma_deg_per_h: CoefficientVector::from_fn(|i, _| sigma[i]),
                others: others
                    .iter()
                    .zip(&sigma[COEFFICIENTS..])
                    .map(|(estimate, sigma)| [*estimate, *sigma])
                    .collect(),
                nis: step.nis.map(|nis| nis.claimed),
                nees: root.nees(&error).states,
            });
        });
        trajectory
    }
}

/// Names of ψ^n's components in files.
const MISALIGNMENT: [&str; 3] = ["psi_nx", "psi_ny", "psi_nz"];

impl Trajectory {
    /// As CSV with a header: time, position number, then truth, estimate, error (estimate less
    /// truth) and σ of every state, NIS and NEES; after these the same of estimated parameters beyond
    /// the twelve coefficients, each in its unit.
    pub fn to_csv(&self) -> String {
        let mut csv = String::from("time_s,position");
        let drift = DriftCoefficient::ALL.map(DriftCoefficient::name);
        for (names, unit) in [(&MISALIGNMENT[..], "arcsec"), (&drift[..], "deg_per_h")] {
            for name in names {
                for what in ["true", "estimate", "error", "sigma"] {
                    // Writing to a string cannot fail.
                    let _ = write!(csv, ",{name}_{what}_{unit}");
                }
            }
        }
        csv.push_str(",nis,nees");
        for (parameter, _) in &self.others {
            let unit = unit_in_names(parameter.unit);
            for what in ["true", "estimate", "error", "sigma"] {
                let _ = write!(csv, ",{}_{what}_{unit}", parameter.name);
            }
        }
        csv.push('\n');
        for s in &self.samples {
            let _ = write!(csv, "{:.3},{}", s.time_s, s.leg + 1);
            let sigma = s.misalignment_n_sigma_arcsec();
            for i in 0..3 {
                let truth = s.misalignment_n_arcsec[i];
                let estimate = s.misalignment_n_estimate_arcsec[i];
                let error = -s.misalignment_n_error_arcsec[i];
                let _ = write!(csv, ",{truth:.4},{estimate:.4},{error:.4},{:.4}", sigma[i]);
            }
            for i in 0..COEFFICIENTS {
                let truth = s.drift_deg_per_h[i];
                let estimate = s.drift_estimate_deg_per_h[i];
                let sigma = s.drift_sigma_deg_per_h[i];
                let error = estimate - truth;
                let _ = write!(csv, ",{truth:.7},{estimate:.7},{error:.7},{sigma:.7}");
            }
            let nis = s.nis.map_or_else(String::new, |v| format!("{v:.4}"));
            let _ = write!(csv, ",{nis},{:.4}", s.nees);
            for ((_, truth), [estimate, sigma]) in self.others.iter().zip(&s.others) {
                let error = estimate - truth;
                let _ = write!(csv, ",{truth:.7},{estimate:.7},{error:.7},{sigma:.7}");
            }
            csv.push('\n');
        }
        csv
    }
}

/// A unit in the name of a column.
fn unit_in_names(unit: Unit) -> String {
    unit.name().replace('/', "_per_")
}
