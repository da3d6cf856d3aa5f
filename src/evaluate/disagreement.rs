//! Where the two computations of a number differ by more than they may.

use crate::covariance::EndCovariance;
use crate::covariance::full::FullCovariance;
use crate::covariance::real::Real;
use crate::drift::{COEFFICIENTS, DriftCoefficient};
use crate::error::Error;
use crate::model::{Parameter, Unit};

/// Largest relative difference of a σ between the two computations.
pub const AGREEMENT: f64 = 1e-6;

/// Largest difference of a correlation between the two computations. σ does not know the sign of a
/// coefficient's column, correlations do; rounding turns them by as much as it changes σ, but in
/// every direction.
pub const CORRELATION_AGREEMENT: f64 = 1e-5;

/// Where the two computations differ by more than [`AGREEMENT`] or [`CORRELATION_AGREEMENT`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disagreement {
    /// In what.
    pub of: Compared,
    /// By the dwell kernels: a σ in its unit, a correlation.
    pub kernels: f64,
    /// The same by the step-by-step filter.
    pub filter: f64,
    /// Their difference, of a σ relative to it; infinite where one is not a number.
    pub difference: f64,
}

/// A number that is computed twice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compared {
    /// σ of a coefficient.
    Coefficient(DriftCoefficient),
    /// σ of ψ^n about North, Up or East: 0, 1, 2.
    Misalignment(usize),
    /// The correlation of two coefficients.
    Correlation(DriftCoefficient, DriftCoefficient),
    /// σ of another parameter, by its name.
    Parameter(&'static str, Unit),
    /// The σ that the filter claims of a parameter, where some are only considered.
    Claimed(&'static str, Unit),
    /// σ of the constant part of D_F of gyro X, Y, Z, where the drift walks.
    ConstantPart(&'static str),
    /// What ignoring a group of errors adds, by its key.
    Ignored(&'static str),
}

impl Compared {
    /// `D_FX` … `D_SZ`, `psi_nx`, `psi_ny`, `psi_nz`; of a correlation both, as `D_FX, D_SX`.
    pub fn name(self) -> String {
        match self {
            Self::Coefficient(c) => c.name().to_owned(),
            Self::Misalignment(axis) => MISALIGNMENT_NAMES[axis].to_owned(),
            Self::Correlation(a, b) => format!("{}, {}", a.name(), b.name()),
            Self::Parameter(name, _)
            | Self::Claimed(name, _)
            | Self::ConstantPart(name)
            | Self::Ignored(name) => name.to_owned(),
        }
    }

    /// `deg/h`, `arcsec` or another unit; `1` of a correlation.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Coefficient(_) | Self::ConstantPart(_) | Self::Ignored(_) => "deg/h",
            Self::Parameter(_, unit) | Self::Claimed(_, unit) => unit.name(),
            Self::Misalignment(_) => "arcsec",
            Self::Correlation(..) => "1",
        }
    }
}

/// Names of the components of ψ^n: North, Up, East.
pub(crate) const MISALIGNMENT_NAMES: [&str; 3] = ["psi_nx", "psi_ny", "psi_nz"];

impl Disagreement {
    pub(super) fn error(self) -> Error {
        let what = match self.of {
            Compared::Coefficient(_) | Compared::Misalignment(_) | Compared::Parameter(..) => {
                "sigmas"
            }
            Compared::Claimed(..) => "claimed sigmas",
            Compared::ConstantPart(_) => "sigmas of the constant part",
            Compared::Ignored(_) => "errors by ignorance",
            Compared::Correlation(..) => "correlations",
        };
        let (of, unit) = (self.of.name(), self.of.unit());
        Error::disagreement(format!(
            "the dwell kernels and the step-by-step filter give different {what} of {of} ({:e} and \
             {:e} {unit}); neither is printed as a result",
            self.kernels, self.filter,
        ))
        .with_key(&of)
    }
}

/// The largest relative difference of a σ between two computations of the same covariance, or the
/// first that is too large; `noise_arcsec` is that of a measurement.
pub(super) fn compare(
    parameters: &[Parameter],
    kernels: &FullCovariance,
    filter: &FullCovariance,
    noise_arcsec: f64,
) -> std::result::Result<f64, Disagreement> {
    let worst = compare_ends(&kernels.end, &filter.end, noise_arcsec)?;
    Ok(worst.max(compare_parameters(parameters, kernels, filter)?))
}

/// The same of what is not of the coefficients or ψ^n.
fn compare_parameters(
    parameters: &[Parameter],
    kernels: &FullCovariance,
    filter: &FullCovariance,
) -> std::result::Result<f64, Disagreement> {
    /// °/h: less than this nobody cares for, and a group that cannot err at all may come to it.
    const LEAST_ERROR: f64 = 1e-9;
    let pairs = |a: Vec<f64>, b: Vec<f64>| parameters.iter().zip(a.into_iter().zip(b));
    let truth = pairs(kernels.sigma(), filter.sigma()).skip(COEFFICIENTS);
    let truth = truth.map(|(p, (a, b))| (Compared::Parameter(p.name, p.unit), a, b, 0.0));
    let claimed = pairs(kernels.claimed_sigma(), filter.claimed_sigma());
    let claimed = claimed.map(|(p, (a, b))| (Compared::Claimed(p.name, p.unit), a, b, 0.0));
    let budget = kernels
        .budget
        .iter()
        .zip(&filter.budget)
        .flat_map(|(a, b)| {
            let each = a.error_deg_per_h.iter().zip(b.error_deg_per_h.iter());
            each.map(|(of_a, of_b)| {
                (
                    Compared::Ignored(a.group),
                    *of_a,
                    *of_b,
                    LEAST_ERROR / AGREEMENT,
                )
            })
        });
    let constant = |full: &FullCovariance| full.constant_part_deg_per_h.unwrap_or_default();
    let constant = pairs(constant(kernels).into(), constant(filter).into());
    let constant = constant.map(|(p, (a, b))| (Compared::ConstantPart(p.name), a, b, 0.0));
    let mut worst = 0.0_f64;
    let all = truth.chain(claimed).chain(constant).chain(budget);
    for (of, kernels, filter, least) in all {
        let difference = match kernels == filter {
            true => 0.0,
            false => (kernels - filter).abs() / filter.max(least),
        };
        worst = worst.max(agreed(of, [kernels, filter, difference], AGREEMENT)?);
    }
    Ok(worst)
}

fn compare_ends(
    kernels: &EndCovariance,
    filter: &EndCovariance,
    noise_arcsec: f64,
) -> std::result::Result<f64, Disagreement> {
    // A misalignment known exactly is one far below the noise to the filter.
    let least = noise_arcsec * f64::KNOWN / AGREEMENT;
    let (a, b) = (kernels.sigma_deg_per_h(), filter.sigma_deg_per_h());
    let coefficients = DriftCoefficient::ALL.into_iter().map(|c| {
        let (a, b) = (a[c.index()], b[c.index()]);
        (Compared::Coefficient(c), a, b, b)
    });
    let (psi_a, psi_b) = (
        kernels.misalignment_sigma_arcsec(),
        filter.misalignment_sigma_arcsec(),
    );
    let misalignment = (0..3).map(|axis| {
        let (a, b) = (psi_a[axis], psi_b[axis]);
        (Compared::Misalignment(axis), a, b, b.max(2.0 * least))
    });
    let mut worst = 0.0_f64;
    for (of, kernels, filter, scale) in coefficients.chain(misalignment) {
        // A coefficient known exactly has σ = 0 in both.
        let difference = if kernels == filter {
            0.0
        } else {
            (kernels - filter).abs() / scale
        };
        worst = worst.max(agreed(of, [kernels, filter, difference], AGREEMENT)?);
    }
    for (i, first) in DriftCoefficient::ALL.into_iter().enumerate() {
        for (j, second) in DriftCoefficient::ALL.into_iter().enumerate().take(i) {
            if b[i] > 0.0 && b[j] > 0.0 {
                let of = Compared::Correlation(second, first);
                let correlation = |end: &EndCovariance| end.coefficients[(i, j)] / (b[i] * b[j]);
                let (kernels, filter) = (correlation(kernels), correlation(filter));
                let difference = (kernels - filter).abs();
                agreed(of, [kernels, filter, difference], CORRELATION_AGREEMENT)?;
            }
        }
    }
    Ok(worst)
}

/// The difference of what the two computations give, unless it is more than `most`.
fn agreed(
    of: Compared,
    [kernels, filter, difference]: [f64; 3],
    most: f64,
) -> std::result::Result<f64, Disagreement> {
    if difference <= most {
        return Ok(difference);
    }
    Err(Disagreement {
        of,
        kernels,
        filter,
        difference: if difference.is_nan() {
            f64::INFINITY
        } else {
            difference
        },
    })
}
