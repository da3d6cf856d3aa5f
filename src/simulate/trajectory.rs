//! One run in full: truth, estimate and 1σ against time.

use std::fmt::Write;

use nalgebra::{Matrix3, Vector3};

use crate::attitude::Attitude;
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftCoefficient};

use super::ekf::LinearGains;
use super::square_root::{PSI, SquareRoot, StateVector};
use super::{InitialTruth, Simulation, stream};

/// Truth and estimate at the end of one interval. ψ^n about North, Up, East.
#[derive(Debug, Clone, Copy, PartialEq)]
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
    /// The filter's covariance of η, arcsec².
    pub misalignment_n_covariance_arcsec2: Matrix3<f64>,
    /// Estimated D, °/h.
    pub drift_estimate_deg_per_h: CoefficientVector,
    /// The filter's 1σ of D, °/h.
    pub drift_sigma_deg_per_h: CoefficientVector,
    /// Normalised innovation squared, two degrees of freedom; none without a measurement.
    pub nis: Option<f64>,
    /// NEES over all states: the squared error in σ.
    pub nees: f64,
}

impl Sample {
    /// The filter's 1σ of ψ in n, arcsec.
    pub fn misalignment_n_sigma_arcsec(&self) -> Vector3<f64> {
        self.misalignment_n_covariance_arcsec2
            .diagonal()
            .map(f64::sqrt)
    }
}

/// One run.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// True D, °/h.
    pub drift_deg_per_h: CoefficientVector,
    /// The end of every interval in order.
    pub samples: Vec<Sample>,
}

impl Simulation {
    /// One run from `initial`, its noise from stream `run` of `seed`.
    pub fn trajectory(&self, initial: &InitialTruth, seed: u64, run: u64) -> Trajectory {
        // Run number `run` of a Monte Carlo draws its truth first: the noise is the same.
        let mut random = stream(seed, run);
        let _ = self.draw_from(&mut random);
        let roots = self.linear_roots();
        let mut trajectory = Trajectory {
            drift_deg_per_h: initial.drift_deg_per_h,
            samples: Vec::with_capacity(self.program.intervals.len()),
        };
        let record = self.record(initial, &mut random);
        self.estimate(&record, &mut |step| {
            if step.index == 0 {
                trajectory.samples.clear();
            }
            let Some(root) = step.filter.root().or_else(|| roots.get(step.index)) else {
                return;
            };
            let interval = &self.program.intervals[step.index];
            let truth = &step.record.misalignment[step.index];
            let (psi, d) = step.filter.estimate();
            let sigma: StateVector = root.sigma();
            let error = step.filter.error(truth, &step.record.coefficients);
            trajectory.samples.push(Sample {
                time_s: interval.end_s,
                leg: interval.leg,
                attitude: *interval.end_attitude(),
                misalignment_n_arcsec: truth.psi_n_arcsec(),
                misalignment_n_estimate_arcsec: psi,
                misalignment_n_error_arcsec: Vector3::from_fn(|i, _| error[PSI + i]),
                misalignment_n_covariance_arcsec2: root.misalignment_covariance(),
                drift_estimate_deg_per_h: d,
                drift_sigma_deg_per_h: CoefficientVector::from_fn(|i, _| sigma[i]),
                nis: step.nis,
                nees: root.nees(&error).states,
            });
        });
        trajectory
    }

    /// The covariance of the linear filter after every interval; empty for the others, which
    /// carry their own.
    fn linear_roots(&self) -> Vec<SquareRoot> {
        let mut roots = Vec::new();
        if self.options.filter == super::FilterModel::Linear {
            LinearGains::new(&self.program, &self.belief, &mut |root| {
                roots.push(root.clone());
            });
        }
        roots
    }
}

/// Names of ψ^n's components in files.
const MISALIGNMENT: [&str; 3] = ["psi_nx", "psi_ny", "psi_nz"];

impl Trajectory {
    /// As CSV with a header: time, position number, then truth, estimate, error (estimate less
    /// truth) and σ of every state, NIS and NEES.
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
        csv.push_str(",nis,nees\n");
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
                let truth = self.drift_deg_per_h[i];
                let estimate = s.drift_estimate_deg_per_h[i];
                let sigma = s.drift_sigma_deg_per_h[i];
                let error = estimate - truth;
                let _ = write!(csv, ",{truth:.7},{estimate:.7},{error:.7},{sigma:.7}");
            }
            let nis = s.nis.map_or_else(String::new, |v| format!("{v:.4}"));
            let _ = writeln!(csv, ",{nis},{:.4}", s.nees);
        }
        csv
    }
}
