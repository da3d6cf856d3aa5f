//! The gradient of any function of P_D with respect to all angles and durations, by reverse mode
//! through the chain, for a few times the cost of one value.
//!
//! E is only ever added to, so its adjoint Ē is the same through the whole chain:
//! `covariance/fast/adjoint.rs` has the recursion.
//!
//! Time enters through the steps without measurement, d/dt (V, P) = (F V + A_end, F P + P Fᵀ +
//! q I), and through the weight of the relaxed measurement at the end of a remainder. A duration
//! at a whole number of periods gets its derivative from above.

/// Derivatives of a figure of merit with respect to one leg of a timeline.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LegGradient {
    /// With respect to (α, β, γ), per rad, all durations held.
    pub angles: [f64; 3],
    /// With respect to the dwell, per s.
    pub dwell_s: f64,
    /// With respect to the duration of the move to the position, per s, its path held.
    pub move_s: f64,
}
