//! What a test tells of every parameter.

use crate::covariance::full::FullCovariance;
use crate::model::Parameter;
use crate::observability::Order;
use crate::observability::parameters::ParameterObservability;

/// What is known of a parameter at the end of a test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownParameter {
    /// Which it is, and what was known of it before.
    pub parameter: Parameter,
    /// 1σ in its unit: the truth. Of one that is only considered, what it was.
    pub sigma: f64,
    /// What the filter claims, where there are parameters that it does not know of.
    pub claimed_sigma: Option<f64>,
    /// 1σ of the constant part, where σ is of the drift at the end of the test: D_F under a random walk.
    pub constant_part_sigma: Option<f64>,
    /// Highest derivative of the measurement that a solution needs; none: not observable, or not
    /// estimated.
    pub order: Option<Order>,
    /// How far its signature is its own, 0 to 1; none: known exactly before the test, or not estimated.
    pub separability: Option<f64>,
}

pub(super) fn known_parameters(
    parameters: &[Parameter],
    full: &FullCovariance,
    of_each: &[ParameterObservability],
) -> Vec<KnownParameter> {
    let (truth, claimed) = (full.sigma(), full.claimed_sigma());
    let differs = truth.len() < parameters.len();
    let known = |(k, parameter): (usize, &Parameter)| KnownParameter {
        parameter: *parameter,
        sigma: truth.get(k).copied().unwrap_or(parameter.prior_sigma),
        claimed_sigma: claimed.get(k).copied().filter(|_| differs),
        constant_part_sigma: full
            .constant_part_deg_per_h
            .and_then(|of| of.get(k).copied()),
        order: of_each.get(k).and_then(|of| of.order),
        separability: of_each.get(k).and_then(|of| of.separability),
    };
    parameters.iter().enumerate().map(known).collect()
}
