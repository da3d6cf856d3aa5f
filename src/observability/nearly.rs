//! What is told only through a small tilt.
//!
//! An order is geometry: 0.01° off an axis is oblique, and what that shows is observable. Weights
//! that make so much of so little are large, though. With c = Σ w_k row_k, rows that are wrong by
//! an angle δ each make c wrong by up to δ Σ|w_k|, so that from
//!
//! ```text
//! δ = 1/Σ|w_k|
//! ```
//!
//! on they can make up all of it: the tilt by which c is told from the others. The weights are the
//! shortest over all rows of its order; with fewer rows δ is smaller. What would be taken for c
//! instead follows from the same least squares: the others change by G c/(cᵀ G c) with
//! G = (RᵀR)⁺ for one unit of c.

use std::fmt;

use super::combinations::Combination;
use super::regressor::{Channel, Regressor, UNKNOWNS};
use super::row_space::{AllRows, RowSpace};
use super::weak::NAMED;
use super::{Observability, Order};
use crate::covariance::CovarianceModel;
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftCoefficient};
use crate::motion::Timeline;
use crate::units::Angle;

/// Tilts below this are said: 1°.
pub const NEARLY_DEG: f64 = 1.0;
/// Names of a list that are written out.
const WRITTEN: usize = 3;

/// What is told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Told {
    /// A coefficient, at its own order.
    Coefficient(DriftCoefficient),
    /// A combination none of whose coefficients is in the list itself.
    Combination(Combination),
}

/// Something that is observable, but only through a small tilt; its `Display` says so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearly {
    /// What is told.
    pub told: Told,
    /// By the channels of this order and below.
    pub order: Order,
    /// What one unit of the coefficient would be taken for but for the tilt, by the others; zero
    /// where it would not show at all, and for a combination.
    pub taken_for: Combination,
    /// The tilt by which it is told, rad, see the module text.
    pub tilt_rad: f64,
}

impl Nearly {
    /// What `timeline`, of which `observability` is the analysis, tells by less than
    /// [`NEARLY_DEG`]: coefficients first, then combinations.
    pub fn find(
        model: &CovarianceModel,
        timeline: &Timeline,
        observability: &Observability,
    ) -> Vec<Self> {
        let regressor = Regressor::new(model, timeline);
        let spaces = [
            (
                Order::First,
                &Channel::FIRST[..],
                &observability.spaces.first,
            ),
            (Order::Second, &Channel::ALL[..], &observability.spaces.all),
        ];
        let views =
            spaces.map(|(order, channels, space)| View::new(&regressor, order, channels, space));
        let mut found: Vec<Self> = Vec::new();
        for c in DriftCoefficient::ALL {
            let order = observability.orders[c.index()];
            let view = views.iter().find(|view| Some(view.order) == order);
            found.extend(view.and_then(|view| view.coefficient(c)));
        }
        for view in &views {
            for combination in view.hardly_seen() {
                let named = combination.rounded(NAMED);
                let said = |n: &Self| match n.told {
                    Told::Coefficient(c) => named.coefficients()[c.index()] != 0.0,
                    Told::Combination(other) => other.rounded(NAMED) == named,
                };
                if !found.iter().any(said) {
                    found.extend(view.combination(combination));
                }
            }
        }
        found
    }

    /// The tilt, degrees.
    pub fn tilt_deg(&self) -> f64 {
        Angle::from_rad(self.tilt_rad).deg()
    }

    /// The name of what is told.
    pub fn name(&self) -> String {
        match self.told {
            Told::Coefficient(c) => c.name().to_owned(),
            Told::Combination(c) => c.to_string(),
        }
    }

    /// The names of what a coefficient is told from.
    pub fn from(&self) -> Vec<&'static str> {
        self.taken_for.names(NAMED)
    }
}

impl fmt::Display for Nearly {
    /// "D_FX is told from D_SX only by 0.010 deg of tilt, at order 1."
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let from = self.from();
        let name = self.name();
        match from.as_slice() {
            [] => write!(f, "{name} shows only")?,
            [other] => write!(f, "{name} is told from {other} only")?,
            [first @ .., last] if first.len() <= WRITTEN => {
                write!(
                    f,
                    "{name} is told from {} and {last} only",
                    first.join(", ")
                )?;
            }
            [..] => write!(
                f,
                "{name} is told from {} and {} others only",
                from[..WRITTEN].join(", "),
                from.len() - WRITTEN
            )?,
        }
        let tilt = two_digits(self.tilt_deg());
        write!(
            f,
            " by {tilt} deg of tilt, at order {}.",
            self.order.number()
        )
    }
}

/// Two significant digits, as a person writes them.
fn two_digits(value: f64) -> String {
    let exponent = libm::log10(value).floor();
    match exponent {
        e if e >= 0.0 => format!("{value:.1}"),
        e if e >= -6.0 => format!("{value:.0$}", (1.0 - e) as usize),
        _ => format!("{value:.1e}"),
    }
}

/// The channels up to an order.
struct View<'a> {
    order: Order,
    space: &'a RowSpace<UNKNOWNS>,
    all: AllRows<'a, UNKNOWNS>,
    /// What a row counts in the geometry.
    shares: Vec<f64>,
}

impl<'a> View<'a> {
    fn new(
        regressor: &Regressor,
        order: Order,
        channels: &[Channel],
        space: &'a RowSpace<UNKNOWNS>,
    ) -> Self {
        Self {
            order,
            space,
            all: AllRows::new(space, &regressor.geometry(channels)),
            shares: regressor.tagged(channels).iter().map(|t| t.share).collect(),
        }
    }

    /// δ of a combination, its largest weight one; none where it is large.
    fn small_tilt(&self, combination: &Combination) -> Option<f64> {
        let weights = self.all.weights(combination.as_array())?;
        let gain: f64 = weights
            .iter()
            .zip(&self.shares)
            .map(|(u, share)| (u * share).abs())
            .sum();
        let tilt_rad = gain.recip();
        (tilt_rad < Angle::from_deg(NEARLY_DEG).rad()).then_some(tilt_rad)
    }

    fn coefficient(&self, c: DriftCoefficient) -> Option<Nearly> {
        let own = Combination::single(c);
        let tilt_rad = self.small_tilt(&own)?;
        let changes = self.all.covariances(own.as_array())?;
        let variance = changes[c.index()];
        let others = CoefficientVector::from_fn(|j, _| match j == c.index() {
            true => 0.0,
            false => -changes[j] / variance,
        });
        let azimuth = -changes[COEFFICIENTS] / variance;
        Some(Nearly {
            told: Told::Coefficient(c),
            order: self.order,
            taken_for: Combination::from_weights(&others, azimuth),
            tilt_rad,
        })
    }

    fn hardly_seen(&self) -> Vec<Combination> {
        let rows = self.space.hardly_seen(Angle::from_deg(NEARLY_DEG).rad());
        rows.into_iter().map(Combination::from_array).collect()
    }

    fn combination(&self, combination: Combination) -> Option<Nearly> {
        Some(Nearly {
            told: Told::Combination(combination.rounded(NAMED)),
            order: self.order,
            taken_for: Combination::of(&[]),
            tilt_rad: self.small_tilt(&combination)?,
        })
    }
}
