//! What unit tests of several rooms share.

use crate::error::Error;
use crate::evaluate::{Evaluator, Objective};
use crate::platform::{Platform, PlatformConfig};

/// The default platform, changed.
pub(crate) fn platform(change: impl FnOnce(&mut PlatformConfig)) -> Platform {
    let mut config = PlatformConfig::default();
    change(&mut config);
    config.check().unwrap()
}

/// The default objective on the default platform, changed.
pub(crate) fn evaluator(change: impl FnOnce(&mut PlatformConfig)) -> Evaluator {
    Evaluator::new(platform(change), Objective::default())
}

/// Asserts that a value given by the user is refused: by its key, with the value and what is allowed.
pub(crate) fn assert_refused_by_key(error: &Error, key: &str) {
    assert!(error.is_input());
    assert_eq!(error.key(), Some(key));
    assert!(
        error.value().is_some() && error.allowed().is_some(),
        "{key}"
    );
}

/// Asserts that `gradient` is that of `f` at `x`, by central differences, to `tolerance` in each
/// part.
pub(crate) fn assert_gradient(
    f: impl Fn(&[f64]) -> f64,
    x: &[f64],
    gradient: &[f64],
    tolerance: f64,
) {
    /// Small beside the variables, large beside rounding.
    const STEP: f64 = 1e-6;
    for i in 0..x.len() {
        let (mut high, mut low) = (x.to_vec(), x.to_vec());
        high[i] += STEP;
        low[i] -= STEP;
        let numeric = (f(&high) - f(&low)) / (2.0 * STEP);
        let error = (numeric - gradient[i]).abs();
        assert!(error < tolerance, "{i}: {numeric} {}", gradient[i]);
    }
}
