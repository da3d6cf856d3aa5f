//! The stacked rows of a schedule: one per channel and position, in the unknowns D, ω_N ψ_y(0).

use crate::attitude::{EAST, NORTH, UP};
use crate::covariance::{CovarianceModel, split_periods};
use crate::drift::{COEFFICIENTS, DriftMatrix, drift_matrix};
use crate::motion::Timeline;

/// D and ω_N ψ_y(0).
pub(crate) const UNKNOWNS: usize = COEFFICIENTS + 1;

/// A channel of the reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Channel {
    /// ε_x^n, from Ż (15): order 1.
    X,
    /// ε_z^n − ω_N ψ_y^n, from Ż (17): order 1.
    Z,
    /// ε_y^n, from Z̈ (16): order 2.
    Y,
}

impl Channel {
    /// The row of A, and of the channel weights.
    pub(crate) const fn axis(self) -> usize {
        match self {
            Self::X => NORTH,
            Self::Z => EAST,
            Self::Y => UP,
        }
    }
}

/// Where the rows of one drift matrix come from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum RowSource {
    /// Held at the position of a leg.
    Dwell,
    /// Passing, this fraction into the measured move to the leg.
    Move { fraction: f64 },
}

/// The rows of one position, or of one moment of a measured move.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block {
    pub leg: usize,
    pub source: RowSource,
    pub a: DriftMatrix,
    /// 1/σ of the channels x, y, z (indices of n).
    pub weights: [f64; 3],
    /// Derivative of the weights with respect to the dwell (or move) duration, 1/s.
    pub weight_rates: [f64; 3],
}

/// All rows of a schedule.
pub(crate) struct Regressor {
    pub blocks: Vec<Block>,
    /// Whether ω_N ψ_y(0) is an unknown: not at the poles.
    pub azimuth_unknown: bool,
    /// Whether the y channel exists: not at the poles.
    pub vertical_channel: bool,
}

impl Regressor {
    pub fn new(model: &CovarianceModel, timeline: &Timeline) -> Self {
        let mut blocks = Vec::with_capacity(timeline.legs().len());
        for (leg, l) in timeline.legs().iter().enumerate() {
            if let Some(m) = &l.arrival
                && m.measured
                && !model.frame_hold
            {
                let (ticks, _) = split_periods(m.duration_s, model.period_s);
                let (weights, rates) = channel_weights(model, m.duration_s);
                // The move as a whole tells as much as a dwell of its length; each tick a share.
                let share = (ticks.max(1) as f64).sqrt().recip();
                for tick in 0..ticks {
                    let fraction = (tick as f64 + 0.5) * model.period_s / m.duration_s;
                    blocks.push(Block {
                        leg,
                        source: RowSource::Move { fraction },
                        a: m.drift_matrix_at(fraction),
                        weights: weights.map(|w| w * share),
                        weight_rates: rates.map(|w| w * share),
                    });
                }
            }
            let (weights, weight_rates) = channel_weights(model, l.dwell_s);
            blocks.push(Block {
                leg,
                source: RowSource::Dwell,
                a: drift_matrix(&l.attitude),
                weights,
                weight_rates,
            });
        }
        let azimuth = model.omega_north() != 0.0;
        Self {
            blocks,
            azimuth_unknown: azimuth,
            vertical_channel: azimuth,
        }
    }

    /// How many unknowns there are.
    pub fn unknowns(&self) -> usize {
        COEFFICIENTS + usize::from(self.azimuth_unknown)
    }

    /// The row of a channel in a block, weighted by one.
    pub fn row(&self, block: &Block, channel: Channel) -> [f64; UNKNOWNS] {
        let axis = channel.axis();
        std::array::from_fn(|j| match j {
            COEFFICIENTS if channel == Channel::Z && self.azimuth_unknown => -1.0,
            COEFFICIENTS => 0.0,
            _ => block.a[(axis, j)],
        })
    }

    /// Unweighted rows of the channels wherever a dwell or move is long enough to tell them.
    pub fn geometry(&self, channels: &[Channel]) -> Vec<[f64; UNKNOWNS]> {
        self.rows(channels, |_| 1.0)
    }

    /// Rows weighted by 1/σ of their channel.
    pub fn weighted(&self, channels: &[Channel]) -> Vec<[f64; UNKNOWNS]> {
        self.rows(channels, |weight| weight)
    }

    fn rows(&self, channels: &[Channel], scale: impl Fn(f64) -> f64) -> Vec<[f64; UNKNOWNS]> {
        let mut rows = Vec::new();
        for block in &self.blocks {
            for &channel in channels {
                let weight = block.weights[channel.axis()];
                if weight > 0.0 && (channel != Channel::Y || self.vertical_channel) {
                    rows.push(self.row(block, channel).map(|v| v * scale(weight)));
                }
            }
        }
        rows
    }
}

/// Channel weights of a dwell, linear in the duration between whole periods, and their slope.
fn channel_weights(model: &CovarianceModel, duration_s: f64) -> ([f64; 3], [f64; 3]) {
    let (periods, remainder) = split_periods(duration_s, model.period_s);
    let low = model.kernels.kernel(periods).channel_weights;
    let high = model.kernels.kernel(periods + 1).channel_weights;
    let share = remainder / model.period_s;
    (
        std::array::from_fn(|i| low[i] + share * (high[i] - low[i])),
        std::array::from_fn(|i| (high[i] - low[i]) / model.period_s),
    )
}
