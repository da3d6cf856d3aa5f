//! Observability order and separability from the ε^n expansions (22), (23).
//!
//! Within one dwell the measurement Z and its derivatives give (13)–(18), (25), (26): ψ_x^n and
//! ψ_z^n from Z itself; ε_x^n and ε_z^n − ω_N ψ_y^n from Ż; ε_y^n and ψ̇_y^n from Z̈. Over a
//! schedule, every position adds one row per channel in the unknowns D and ω_N ψ_y^n(0):
//!
//! ```text
//! x (order 1): A_x D = ε_x       z (order 1): A_z D − ω_N ψ_y(0) = η_z      y (order 2): A_y D = ε_y
//! ```
//!
//! The **observability order** of a combination is the smallest d such that it lies in the row
//! space of the channels of order ≤ d; the paper's observable degree is its inverse. It is
//! geometry only: 0.01° off an axis already counts as oblique, and [`nearly`] says so.
//!
//! What counts as rank is decided in one place, at one relative tolerance, [`RANK_TOLERANCE`], for
//! orders, separability, ranks, condition number, names and reconstructions alike.
//!
//! Over a schedule the z rows share the unknown ψ_y^n(0), and the change of ψ_y^n since then is
//! taken from (25), which holds Z̈. We follow the paper, which in (26) nevertheless counts the z
//! channel as of order 1. Counted strictly, only the x rows are of order 1 across dwells:
//! [`Observability::strict_orders`]. The two agree for eleven or more generic positions; they
//! differ for fewer, and where a gimbal is held still (icosahedron-12 at β = 0: 7 x rows count).
//!
//! With the azimuth measured, ψ_y is of order 0 and ε_y of order 1: everything that shows is of order 1.
//!
//! **Separability** measures how far: of coefficient i, ‖(I − Π_{−i}) s_i‖ / ‖s_i‖ with s_i its
//! column of the stacked rows, each weighted by 1/σ of its channel in its dwell, and Π_{−i} the
//! projector on the other columns. 1: its signature is its own; 0: not separable.

pub mod advice;
pub mod classical;
pub(crate) mod combinations;
pub(crate) mod log_separability;
pub mod named;
pub mod nearly;
mod order;
pub mod parameters;
pub(crate) mod regressor;
pub(crate) mod row_space;
pub mod separability;
mod singular;
pub mod solution;
mod sparse;
pub(crate) mod stand;
pub mod weak;

use crate::covariance::CovarianceModel;
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftCoefficient};
use crate::error::{Error, Result};
use crate::motion::Timeline;
pub use combinations::Combination;
pub use order::Order;
pub use regressor::Channel;
use regressor::{Regressor, UNKNOWNS};
pub use row_space::RANK_TOLERANCE;
use row_space::RowSpace;

/// What a schedule makes observable.
#[derive(Debug, Clone, PartialEq)]
pub struct Observability {
    /// Order of each coefficient; none: not observable.
    pub orders: [Option<Order>; COEFFICIENTS],
    /// The same counted strictly: without the z channels, whose comparison between dwells takes
    /// the change of ψ_y^n from Z̈, see the module text.
    pub strict_orders: [Option<Order>; COEFFICIENTS],
    /// Separability of each coefficient by the order-1 channels alone, 0 to 1.
    pub separability_first_order: CoefficientVector,
    /// Separability of each coefficient by all channels, 0 to 1; zero when and only when the
    /// coefficient has no order.
    pub separability: CoefficientVector,
    /// Rank of the rows of all channels.
    pub rank: usize,
    /// Rank of the rows of the channels of order 1 and below; at most one less than there are
    /// unknowns, for these never see D_IX + D_IY + D_IZ.
    pub rank_first_order: usize,
    /// Rank of the x rows alone, over the coefficients: 11 at best.
    pub rank_x: usize,
    /// Number of unknowns: the coefficients and ω_N ψ_y(0), the latter not at the poles (where
    /// ω_N is none beside ω_ie, see [`RANK_TOLERANCE`]).
    pub unknowns: usize,
    /// Condition number of the weighted rows, columns scaled to length one; infinite when the
    /// rank is short.
    pub condition_number: f64,
    /// The combinations that stay unobservable.
    pub unobservable: Vec<Combination>,
    spaces: Spaces,
}

/// What the channels span, from fewer channels to more.
#[derive(Debug, Clone, PartialEq)]
struct Spaces {
    zero: RowSpace<UNKNOWNS>,
    x: RowSpace<UNKNOWNS>,
    first: RowSpace<UNKNOWNS>,
    all: RowSpace<UNKNOWNS>,
    /// Then the change of ψ_y between dwells is measured too, and the two counts agree.
    azimuth_measured: bool,
}

impl Spaces {
    fn of(regressor: &Regressor) -> Self {
        let all = RowSpace::of(&regressor.geometry(&Channel::ALL));
        let part =
            |channels: &[Channel]| RowSpace::beside(&regressor.geometry(channels), all.largest());
        Self {
            zero: part(&[Channel::Azimuth]),
            x: part(&[Channel::X]),
            first: part(regressor.first()),
            all,
            azimuth_measured: regressor.measured_azimuth.is_some(),
        }
    }

    fn order_of(&self, combination: &Combination) -> Option<Order> {
        let vector = combination.as_array();
        [
            (&self.zero, Order::Zero),
            (&self.first, Order::First),
            (&self.all, Order::Second),
        ]
        .into_iter()
        .find_map(|(space, order)| space.contains(vector).then_some(order))
    }

    fn strict_order_of(&self, combination: &Combination) -> Option<Order> {
        let by_x = self.azimuth_measured || self.x.contains(combination.as_array());
        match self.order_of(combination) {
            Some(Order::First) if !by_x => Some(Order::Second),
            order => order,
        }
    }
}

impl Observability {
    /// Analyses `timeline`.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the noise of a channel is so small
    /// that its weight is no number.
    pub fn analyze(model: &CovarianceModel, timeline: &Timeline) -> Result<Self> {
        let regressor = Regressor::new(model, timeline);
        let unknowns = regressor.unknowns();
        let spaces = Spaces::of(&regressor);
        let weighted = regressor.weighted(&Channel::ALL);
        if !weighted.iter().flatten().all(|v| v.is_finite()) {
            return Err(Error::numerical("the weight of a channel is not finite"));
        }
        let missing = spaces.all.missing(unknowns);
        let each = DriftCoefficient::ALL.map(Combination::single);
        let orders = each.map(|c| spaces.order_of(&c));
        let first = |c: DriftCoefficient| orders[c.index()].is_some_and(|o| o <= Order::First);
        Ok(Self {
            orders,
            strict_orders: each.map(|c| spaces.strict_order_of(&c)),
            separability_first_order: separability::of_rows(
                &regressor.weighted(regressor.first()),
                &spaces.first,
                first,
            ),
            separability: separability::of_rows(&weighted, &spaces.all, |c| {
                orders[c.index()].is_some()
            }),
            rank: spaces.all.rank(),
            rank_first_order: spaces.first.rank(),
            rank_x: spaces.x.rank(),
            unknowns,
            condition_number: separability::condition_number(&weighted, &spaces.all, unknowns),
            unobservable: missing.into_iter().map(Combination::from_array).collect(),
            spaces,
        })
    }

    /// Order of any combination; none: not observable, or nothing but zeros.
    ///
    /// ```
    /// use scheme_opt::internals::covariance::CovarianceModel;
    /// use scheme_opt::internals::drift::DriftCoefficient as D;
    /// use scheme_opt::internals::motion::{Test, Timeline};
    /// use scheme_opt::internals::observability::{Combination, Observability, Order};
    /// use scheme_opt::internals::platform::PlatformConfig;
    /// use scheme_opt::internals::schedule::standard::StandardScheme;
    /// let test = Test::from(PlatformConfig::default().check()?);
    /// let order_at = |scheme: StandardScheme| {
    ///     let schedule = scheme.schedule(12_000.0, &test)?;
    ///     let timeline = Timeline::new(&test, &schedule)?;
    ///     let o = Observability::analyze(&CovarianceModel::new(test.platform()), &timeline)?;
    ///     Ok::<_, scheme_opt::Error>(o.order_of(&Combination::of(&[(D::IX, 1.0), (D::IY, -1.0)])))
    /// };
    /// assert_eq!(order_at(StandardScheme::Axis24)?, Some(Order::Second));
    /// assert_eq!(order_at(StandardScheme::Icosahedron12)?, Some(Order::First));
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn order_of(&self, combination: &Combination) -> Option<Order> {
        self.spaces.order_of(combination)
    }

    /// Order of any combination counted strictly, see [`Observability::strict_orders`].
    pub fn strict_order_of(&self, combination: &Combination) -> Option<Order> {
        self.spaces.strict_order_of(combination)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Attitude, Position};
    use crate::platform::PlatformConfig;
    use crate::schedule::{Schedule, ScheduledPosition};

    fn analyze_at(latitude_deg: f64, positions: &[Position]) -> Observability {
        let mut config = PlatformConfig::default();
        config.site.latitude_deg = latitude_deg;
        let platform = config.check().unwrap();
        let held = positions.iter().map(|p| ScheduledPosition::new(*p, 1000.0));
        let schedule = Schedule::new(held.collect()).unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
        Observability::analyze(&CovarianceModel::new(&platform), &timeline).unwrap()
    }

    fn analyze(positions: &[Position]) -> Observability {
        analyze_at(28.2, positions)
    }

    fn generic(count: usize) -> Vec<Position> {
        (0..count)
            .map(|k| {
                let k = k as f64;
                let angles = [0.3 + 2.1 * k, 1.1 * k * k - 0.7, 1.7 * k * k * k - 0.4];
                Position::from_array(angles.map(|a| a % std::f64::consts::TAU))
            })
            .collect()
    }

    fn axis_aligned() -> Vec<Position> {
        let quarter = std::f64::consts::FRAC_PI_2;
        let mut all = Vec::new();
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                for turn in 0..4 {
                    let mut u = nalgebra::Vector3::zeros();
                    u[axis] = sign;
                    let heading = f64::from(turn) * quarter;
                    all.push(Attitude::with_gravity_along(u, heading).unwrap().position());
                }
            }
        }
        all
    }

    #[test]
    fn five_generic_positions_observe_everything_and_four_leave_one_combination() {
        let four = analyze(&generic(4));
        assert_eq!(
            (four.rank, four.unknowns, four.unobservable.len()),
            (12, 13, 1)
        );
        let five = analyze(&generic(5));
        assert_eq!((five.rank, five.unobservable.len()), (13, 0));
        assert!(five.condition_number.is_finite());
        assert!(five.orders.iter().all(Option::is_some));
    }

    #[test]
    fn input_coefficients_are_of_order_two_always_and_the_others_of_order_one() {
        for positions in [generic(12), axis_aligned()] {
            let o = analyze(&positions);
            for c in DriftCoefficient::ALL {
                let input = c.kind() == crate::drift::DriftKind::Input;
                let expected = if input { Order::Second } else { Order::First };
                assert_eq!(o.orders[c.index()], Some(expected), "{}", c.name());
                let first = o.separability_first_order[c.index()];
                assert_eq!(first < 1e-6, input, "{} {first}", c.name());
                assert!(o.separability[c.index()] > 1e-3);
                assert!(o.separability[c.index()] <= 1.0 + 1e-12);
            }
        }
    }

    #[test]
    fn ranks_of_epsilon_x_are_11_and_9() {
        let model = CovarianceModel::new(&PlatformConfig::default().check().unwrap());
        let rank = |positions: &[Position]| {
            let held = positions.iter().map(|p| ScheduledPosition::new(*p, 1000.0));
            let platform = PlatformConfig::default().check().unwrap();
            let schedule = Schedule::new(held.collect()).unwrap();
            let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
            let rows = Regressor::new(&model, &timeline).geometry(&[Channel::X]);
            RowSpace::of(&rows).rank()
        };
        assert_eq!(rank(&generic(30)), 11);
        assert_eq!(rank(&axis_aligned()), 9);
    }

    #[test]
    fn one_position_names_what_it_cannot_tell() {
        let o = analyze(&[Position::default()]);
        // (27): only D_FX − D_SX, D_FY − D_IY and D_FZ − D_SZ − ω_N ψ_y are seen.
        assert_eq!(o.rank, 3);
        let names: Vec<String> = o.unobservable.iter().map(ToString::to_string).collect();
        for name in ["D_FX + D_SX", "D_FY + D_IY", "D_OX"] {
            assert!(names.contains(&name.to_owned()), "{names:?}");
        }
        assert!(o.condition_number.is_infinite());
        assert!(o.orders.iter().all(Option::is_none));
        assert_eq!(o.separability.max(), 0.0);
    }

    #[test]
    fn at_the_poles_psi_y_is_no_unknown_and_the_input_trace_is_lost() {
        let o = analyze_at(90.0, &generic(12));
        assert_eq!(o.unknowns, 12);
        assert_eq!(o.rank, 11);
        assert_eq!(o.unobservable.len(), 1);
        assert_eq!(o.unobservable[0].to_string(), "D_IX + D_IY + D_IZ");
    }
}
