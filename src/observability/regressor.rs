//! The stacked rows of a schedule: one per channel and position, in the unknowns D, ω_N ψ_y(0).
//!
//! In `slew` repositioning ψ^n is continuous and every z row holds −ω_N ψ_y(0). In `frame-hold`
//! repositioning ψ^n ← Q ψ^n with Q = C_{k+1} C_kᵀ at every change of position, so that
//! ψ_y(t_k) = q_k ψ_y(0) plus what is known, q_{k+1} = Q_yy q_k. And where Q tilts the vertical,
//! part of ψ_y comes out in ψ_x and ψ_z, which Z shows by itself: the [`Channel::Azimuth`], of
//! order 0, which the slewing platform does not have.
//!
//! Where the **azimuth is measured**, ψ_y^n is of order 0 and, by its derivative, ε_y^n of order 1, so
//! that all channels are. One row of the [`Channel::Azimuth`] stands for it, weighted as one
//! measurement: an honest lower limit that does not depend on any duration.

use super::order::Order;
use super::row_space::counts;
use crate::attitude::{Attitude, EAST, NORTH, Stand, UP};
use crate::covariance::{CovarianceModel, split_periods};
use crate::drift::{COEFFICIENTS, DriftMatrix};
use crate::model::Mounting;
use crate::motion::Timeline;
use serde::{Deserialize, Serialize};

/// D and ω_N ψ_y(0).
pub(crate) const UNKNOWNS: usize = COEFFICIENTS + 1;

/// A channel of the reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum Channel {
    /// ε_x^n, from Ż (15): order 1.
    X,
    /// ε_z^n − ω_N ψ_y^n, from Ż (17): order 1.
    Z,
    /// ε_y^n, from Z̈ (16): order 2.
    Y,
    /// ω_N ψ_y^n, from what a change of position in frame-hold repositioning moves into ψ_x^n
    /// and ψ_z^n, (13) and (14): order 0.
    Azimuth,
}

impl Channel {
    /// All channels.
    pub(crate) const ALL: [Self; 4] = [Self::X, Self::Z, Self::Y, Self::Azimuth];
    /// The channels of order 1 and below.
    pub(crate) const FIRST: [Self; 3] = [Self::X, Self::Z, Self::Azimuth];

    /// The name used in documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Z => "z",
            Self::Y => "y",
            Self::Azimuth => "azimuth",
        }
    }

    /// What the channel tells, in ASCII.
    pub const fn quantity(self) -> &'static str {
        match self {
            Self::X => "eps_nx",
            Self::Z => "eps_nz - omega_N psi_ny",
            Self::Y => "eps_ny",
            Self::Azimuth => "omega_N psi_ny",
        }
    }

    /// Its order where only Z is measured: the highest derivative of it in the solution. With the
    /// azimuth measured too it is `Regressor::order`.
    pub const fn order(self) -> Order {
        match self {
            Self::Azimuth => Order::Zero,
            Self::X | Self::Z => Order::First,
            Self::Y => Order::Second,
        }
    }

    /// The row of A, and of the channel weights.
    pub(crate) const fn axis(self) -> usize {
        match self {
            Self::X => NORTH,
            Self::Z => EAST,
            Self::Y | Self::Azimuth => UP,
        }
    }
}

/// Entries of A below this are rounding, not excitation.
const ROUNDING: f64 = 1e-12;
/// A measured move is represented by its filter periods, at most by so many moments.
const MOMENTS: usize = 200;

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
pub(crate) struct RowBlock {
    pub leg: usize,
    pub source: RowSource,
    /// Where the platform is.
    pub attitude: Attitude,
    /// The coefficient of ω_N ψ_y(0) in the z row: −1, in frame-hold −q_k.
    pub azimuth: f64,
    /// 1/σ of the channels x, y, z (indices of n).
    pub weights: [f64; 3],
    /// Derivative of the weights with respect to the dwell (or move) duration, 1/s.
    pub weight_rates: [f64; 3],
    /// The length of its rows in the geometry: 1, so that a position counts once; of a moment of a
    /// move 1/√(moments), so that a move does too, however many moments it is taken for.
    pub share: f64,
}

impl RowBlock {
    /// Entry (i, a) of C_c^n without rounding.
    #[inline]
    pub fn entry(&self, i: usize, a: usize) -> f64 {
        without_rounding(self.attitude.matrix()[(i, a)])
    }
}

/// What a change of position in frame-hold repositioning tells about ω_N ψ_y(0).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Change {
    /// The leg it leads to.
    pub leg: usize,
    /// Q_yy = g_k · g_{k+1}.
    pub cosine: f64,
    /// q_k before it.
    pub share: f64,
    /// 1/σ of the order-0 measurement of ω_N ψ_y, (°/h)⁻¹; zero where a side is not measured.
    pub weight: f64,
}

impl Change {
    /// The coefficient of ω_N ψ_y(0): q_k √(1 − Q_yy²).
    pub fn coefficient(&self) -> f64 {
        self.share * (1.0 - self.cosine * self.cosine).max(0.0).sqrt()
    }

    /// The coefficient, where it tells anything.
    pub fn told(&self) -> Option<f64> {
        let coefficient = self.coefficient();
        // A turn about the vertical moves nothing of ψ_y but by rounding.
        let tells = self.weight > 0.0 && counts(coefficient.abs(), 1.0);
        tells.then_some(coefficient)
    }
}

/// One row with where it comes from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TaggedRow {
    pub leg: usize,
    pub source: RowSource,
    pub channel: Channel,
    /// 1/σ, (°/h)⁻¹.
    pub weight: f64,
    /// Its length in the geometry, see [`RowBlock::share`].
    pub share: f64,
    /// The unweighted row.
    pub row: [f64; UNKNOWNS],
}

/// All rows of a schedule.
pub(crate) struct Regressor {
    pub blocks: Vec<RowBlock>,
    /// Changes of position in frame-hold repositioning.
    pub changes: Vec<Change>,
    /// The axes of the gyros.
    pub mounting: Mounting,
    /// What attitude the gimbals' angles are.
    pub stand: Stand,
    /// Whether ω_N ψ_y(0) is an unknown: not at the poles.
    pub azimuth_unknown: bool,
    /// Whether the y channel exists: not at the poles, but where the azimuth is measured.
    pub vertical_channel: bool,
    /// What the measured azimuth tells of ω_N ψ_y(0), if it is measured.
    pub measured_azimuth: Option<MeasuredAzimuth>,
}

/// ω_N ψ_y(0) by the azimuth measured in the first dwell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeasuredAzimuth {
    /// 1/σ of one measurement, (°/h)⁻¹; zero where the first dwell has none.
    pub weight: f64,
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
                // The move as a whole tells as much as a dwell of its length; each moment a share.
                let moments = ticks.min(MOMENTS);
                let share = (moments.max(1) as f64).sqrt().recip();
                for moment in 0..moments {
                    let fraction = (moment as f64 + 0.5) / moments as f64;
                    blocks.push(RowBlock {
                        leg,
                        source: RowSource::Move { fraction },
                        attitude: model.stand.attitude(m.position_at(fraction)),
                        azimuth: -1.0,
                        weights: weights.map(|w| w * share),
                        weight_rates: rates.map(|w| w * share),
                        share,
                    });
                }
            }
            let (weights, weight_rates) = channel_weights(model, l.dwell_s);
            blocks.push(RowBlock {
                leg,
                source: RowSource::Dwell,
                attitude: l.attitude,
                azimuth: -1.0,
                weights,
                weight_rates,
                share: 1.0,
            });
        }
        let azimuth = !at_a_pole(model);
        let first_dwell_s = timeline.legs().first().map_or(0.0, |leg| leg.dwell_s);
        let measured_azimuth = model.azimuth_variance.map(|variance| MeasuredAzimuth {
            weight: match azimuth && split_periods(first_dwell_s, model.period_s).0 > 0 {
                true => (model.omega_north() * variance.sqrt()).abs().recip(),
                false => 0.0,
            },
        });
        let mut regressor = Self {
            blocks,
            changes: Vec::new(),
            mounting: *model.mounting(),
            stand: model.stand,
            azimuth_unknown: azimuth,
            vertical_channel: azimuth || measured_azimuth.is_some(),
            measured_azimuth,
        };
        if model.frame_hold && azimuth {
            regressor.hold_frame(model, timeline);
        }
        regressor
    }

    /// What frame-hold repositioning makes of ψ_y, see the module text.
    fn hold_frame(&mut self, model: &CovarianceModel, timeline: &Timeline) {
        let legs = timeline.legs();
        let measured = |dwell_s: f64| split_periods(dwell_s, model.period_s).0 > 0;
        // One measurement on either side of the change: an honest lower limit.
        let weight = (model.omega_north() * (2.0 * model.noise_variance).sqrt()).recip();
        let mut share = 1.0;
        for leg in 1..legs.len() {
            let [before, after] = [&legs[leg - 1], &legs[leg]];
            let cosine = before
                .attitude
                .gravity_c()
                .dot(&after.attitude.gravity_c())
                .clamp(-1.0, 1.0);
            let both = measured(before.dwell_s) && measured(after.dwell_s);
            self.changes.push(Change {
                leg,
                cosine,
                share,
                weight: if both { weight } else { 0.0 },
            });
            share *= cosine;
            // Without moves that measure there is one block per leg.
            self.blocks[leg].azimuth = -share;
        }
    }

    /// The order of a channel: the highest derivative of what is measured in its solution.
    pub fn order(&self, channel: Channel) -> Order {
        match self.measured_azimuth {
            Some(_) => channel.order().min(Order::First),
            None => channel.order(),
        }
    }

    /// The channels of order 1 and below.
    pub fn first(&self) -> &'static [Channel] {
        match self.measured_azimuth {
            Some(_) => &Channel::ALL,
            None => &Channel::FIRST,
        }
    }

    /// How many unknowns there are.
    pub fn unknowns(&self) -> usize {
        COEFFICIENTS + usize::from(self.azimuth_unknown)
    }

    /// The row of a channel in a block whose drift matrix is `a`, weighted by one.
    fn row(&self, block: &RowBlock, a: &DriftMatrix, channel: Channel) -> [f64; UNKNOWNS] {
        let axis = channel.axis();
        std::array::from_fn(|j| match j {
            COEFFICIENTS if channel == Channel::Z && self.azimuth_unknown => {
                without_rounding(block.azimuth)
            }
            COEFFICIENTS => 0.0,
            _ => without_rounding(a[(axis, j)]),
        })
    }

    /// Rows of the channels wherever a dwell or move is long enough to tell them, whatever the
    /// noise: each position, and each move, counts once.
    pub fn geometry(&self, channels: &[Channel]) -> Vec<[f64; UNKNOWNS]> {
        let scale = |t: &TaggedRow| t.row.map(|v| v * t.share);
        self.tagged(channels).iter().map(scale).collect()
    }

    /// Rows weighted by 1/σ of their channel.
    pub fn weighted(&self, channels: &[Channel]) -> Vec<[f64; UNKNOWNS]> {
        let weigh = |t: &TaggedRow| t.row.map(|v| v * t.weight);
        self.tagged(channels).iter().map(weigh).collect()
    }

    /// The rows of the channels, unweighted, with their origin.
    pub fn tagged(&self, channels: &[Channel]) -> Vec<TaggedRow> {
        let mut rows = Vec::with_capacity(channels.len() * self.blocks.len());
        for block in &self.blocks {
            let a = self.mounting.drift_matrix(&block.attitude);
            for &channel in channels {
                let weight = block.weights[channel.axis()];
                let there = match channel {
                    Channel::X | Channel::Z => true,
                    Channel::Y => self.vertical_channel,
                    Channel::Azimuth => false,
                };
                if weight > 0.0 && there {
                    rows.push(TaggedRow {
                        leg: block.leg,
                        source: block.source,
                        channel,
                        weight,
                        share: block.share,
                        row: self.row(block, &a, channel),
                    });
                }
            }
        }
        if channels.contains(&Channel::Azimuth) {
            rows.extend(self.changes.iter().filter_map(azimuth_row));
            rows.extend(self.measured_azimuth.iter().filter_map(measured_row));
        }
        rows
    }
}

/// The row of a change of position; none where it tells nothing.
fn azimuth_row(change: &Change) -> Option<TaggedRow> {
    change.told().map(|coefficient| {
        let mut row = [0.0; UNKNOWNS];
        row[COEFFICIENTS] = coefficient;
        TaggedRow {
            leg: change.leg,
            source: RowSource::Dwell,
            channel: Channel::Azimuth,
            weight: change.weight,
            share: 1.0,
            row,
        }
    })
}

/// The row of the measured azimuth.
fn measured_row(measured: &MeasuredAzimuth) -> Option<TaggedRow> {
    (measured.weight > 0.0).then_some(TaggedRow {
        leg: 0,
        source: RowSource::Dwell,
        channel: Channel::Azimuth,
        weight: measured.weight,
        share: 1.0,
        row: super::row_space::unit(COEFFICIENTS),
    })
}

/// Whether ω_N is none beside ω_ie: then ψ_y^n does not show, and ε_y^n does not either.
pub(super) fn at_a_pole(model: &CovarianceModel) -> bool {
    !counts(model.omega_north(), model.dynamics.rate())
}

/// sin 180° is 1.2e-16 in floating point, and a column of nothing else would pass for a signature
/// once it is scaled to length one.
fn without_rounding(entry: f64) -> f64 {
    if entry.abs() < ROUNDING { 0.0 } else { entry }
}

/// 1/σ of the channels x, y, z (indices of n) of a dwell of `duration_s`, (°/h)⁻¹.
pub(crate) fn dwell_weights(model: &CovarianceModel, duration_s: f64) -> [f64; 3] {
    channel_weights(model, duration_s).0
}

/// Channel weights of a dwell, linear in the duration between whole periods, and their slope.
fn channel_weights(model: &CovarianceModel, duration_s: f64) -> ([f64; 3], [f64; 3]) {
    let (periods, remainder) = split_periods(duration_s, model.period_s);
    let low = weights_of_periods(model, periods);
    let high = weights_of_periods(model, periods + 1);
    let share = remainder / model.period_s;
    (
        std::array::from_fn(|i| low[i] + share * (high[i] - low[i])),
        std::array::from_fn(|i| (high[i] - low[i]) / model.period_s),
    )
}

/// Channel weights of a dwell of so many periods. The kernel's are of Z alone; a measured azimuth tells
/// ε_y by its change at least, from the first measurement to the last.
fn weights_of_periods(model: &CovarianceModel, periods: usize) -> [f64; 3] {
    let mut weights: [f64; 3] = model.kernels.kernel(periods).channel_weights.into();
    if let Some(variance) = model.azimuth_variance
        && periods >= 2
    {
        let time_s = (periods - 1) as f64 * model.period_s;
        let sigma = (2.0 * variance + model.drift_psd * time_s).sqrt() / time_s;
        weights[UP] = weights[UP].max(sigma.recip());
    }
    weights
}
