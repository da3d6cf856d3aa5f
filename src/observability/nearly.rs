//! What is told only through a small tilt.
//!
//! An order is geometry: 0.01° off an axis is oblique, and what that shows is observable. Weights
//! that make so much of so little are large, though. In c = Σ w_k row_k let P be the sum of the
//! positive weights or that of the negative ones, whichever is larger in size. Then c is P times a
//! difference of two weighted means of rows (or a mean alone), in which one unit of c shows as
//!
//! ```text
//! δ = 1/P:
//! ```
//!
//! the tilt by which c is told from the others. A position off an axis by δ in a schedule that is
//! axis-aligned otherwise comes out as this δ, and rows that are wrong by δ can make up all of c.
//! The weights are the shortest over all rows of the order. What would be taken for c but for the
//! tilt follows from the same least squares: the others change by G c/(cᵀ G c) with G = (RᵀR)⁺ for
//! one unit of c.

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
pub enum ToldQuantity {
    /// A coefficient, at its own order.
    Coefficient(DriftCoefficient),
    /// A combination none of whose coefficients is in the list itself.
    Combination(Combination),
}

/// Something that is observable, but only through a small tilt; its `Display` says so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearly {
    /// What is told.
    pub told: ToldQuantity,
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
            (Order::First, regressor.first(), &observability.spaces.first),
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
                    ToldQuantity::Coefficient(c) => named.coefficients()[c.index()] != 0.0,
                    ToldQuantity::Combination(other) => other.rounded(NAMED) == named,
                };
                // Where all channels are of order 1, the second view is the first again.
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
            ToldQuantity::Coefficient(c) => c.name().to_owned(),
            ToldQuantity::Combination(c) => c.to_string(),
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
    let rounded = format!("{value:.1e}");
    let exponent = rounded
        .split_once('e')
        .and_then(|(_, e)| e.parse::<i32>().ok());
    match exponent {
        Some(e @ -6..1) => format!("{value:.0$}", (1 - e) as usize),
        _ => rounded,
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
        let (mut positive, mut negative) = (0.0, 0.0);
        for (u, share) in weights.iter().zip(&self.shares) {
            match u * share {
                w if w > 0.0 => positive += w,
                w => negative -= w,
            }
        }
        let tilt_rad = f64::max(positive, negative).recip();
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
            told: ToldQuantity::Coefficient(c),
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
            told: ToldQuantity::Combination(combination.rounded(NAMED)),
            order: self.order,
            taken_for: Combination::of(&[]),
            tilt_rad: self.small_tilt(&combination)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use DriftCoefficient as D;

    fn words(from: &[(D, f64)], tilt_deg: f64) -> String {
        let nearly = Nearly {
            told: ToldQuantity::Coefficient(D::FX),
            order: Order::First,
            taken_for: Combination::of(from),
            tilt_rad: Angle::from_deg(tilt_deg).rad(),
        };
        nearly.to_string()
    }

    #[test]
    fn the_words_are_a_sentence() {
        let one = [(D::SX, -1.0), (D::OX, 0.01)];
        assert_eq!(
            words(&one, 0.01),
            "D_FX is told from D_SX only by 0.010 deg of tilt, at order 1."
        );
        assert_eq!(
            words(&[], 0.000_123),
            "D_FX shows only by 0.00012 deg of tilt, at order 1."
        );
        let four = [(D::FY, 1.0), (D::FZ, 1.0), (D::IX, 1.0), (D::IY, 1.0)];
        assert_eq!(
            words(&four, 0.5),
            "D_FX is told from D_FY, D_FZ, D_IX and D_IY only by 0.50 deg of tilt, at order 1."
        );
        let five = [&four[..], &[(D::IZ, 1.0)]].concat();
        assert!(words(&five, 0.5).contains("D_FY, D_FZ, D_IX and 2 others only"));
        assert!(words(&one, 3e-9).contains("by 3.0e-9 deg"));
        // Just below: no third digit.
        assert!(words(&one, 0.009_998).contains("by 0.010 deg"));
    }
}
