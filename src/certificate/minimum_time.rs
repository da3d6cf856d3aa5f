//! The shortest conceivable test: how long any schedule needs for a specification.
//!
//! A schedule can always be extended at its last position, which only adds information. So the
//! bound for a duration also holds for every shorter one, and where the lower bound on the largest
//! σ/specification exceeds 1, no schedule up to that duration meets the specification.

use super::Certifier;
use std::fmt;

use crate::criterion::Criterion;
use crate::drift::CoefficientVector;
use crate::error::Result;
use crate::motion::MAX_FILTER_PERIODS;
use crate::schedule::MAX_DURATION_S;

/// How long a test must be at least.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MinimumTime {
    /// The prior already meets the specification.
    Nothing,
    /// What the specification asks for is met by the prior, or is of parameters beside the drift
    /// coefficients, which the bound takes as known.
    OfOthers,
    /// No schedule of this duration, s, or shorter meets the specification.
    MoreThan(f64),
    /// Not even in the longest test the program handles, of this duration in s.
    NotWithin(f64),
    /// No lower bound was found on the duration: what the bound says of the shortest test
    /// already is within the specification.
    Unknown,
}

impl fmt::Display for MinimumTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("the prior already meets the specification"),
            Self::OfOthers => f.write_str(
                "no bound on the time: what the specification asks of the drift coefficients the \
                 prior already meets, and of the other parameters this says nothing",
            ),
            Self::MoreThan(s) => {
                write!(f, "no schedule of {s:.1} s or less meets the specification")
            }
            Self::NotWithin(s) => write!(
                f,
                "no schedule meets the specification, not even one of {s:e} s, the longest that \
                 is handled"
            ),
            Self::Unknown => f.write_str(
                "no useful bound on the time: the bound does not exclude even the shortest test",
            ),
        }
    }
}

impl MinimumTime {
    /// The same of a specification that asks for parameters beside the drift coefficients too, `others`.
    #[must_use]
    pub fn beside(self, others: bool) -> Self {
        match self {
            Self::Nothing if others => Self::OfOthers,
            of_the_twelve => of_the_twelve,
        }
    }
}

/// How closely the two ends of the bracket have to come, relatively.
const WIDTH: f64 = 3e-4;
/// Most bounds computed.
const STEPS: usize = 24;
/// How the ratio falls with the time, for the first guess: σ ∝ T^−1.2.
const POWER: f64 = 1.2;

impl Certifier {
    /// How long any schedule needs at least until each σ is within `spec_deg_per_h` (°/h;
    /// infinite: not asked for). `guess_s` is where to begin.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) where double precision does not
    /// suffice.
    pub fn minimum_time(
        &self,
        spec_deg_per_h: &CoefficientVector,
        guess_s: f64,
    ) -> Result<MinimumTime> {
        let prior = &self.conditions.prior_sigma;
        if prior.iter().zip(spec_deg_per_h.iter()).all(|(p, s)| p <= s) {
            return Ok(MinimumTime::Nothing);
        }
        let criterion = Criterion::max_ratio(*spec_deg_per_h);
        let period = self.conditions.period_s;
        let longest = MAX_DURATION_S.min(MAX_FILTER_PERIODS * period);
        let ratio = |time: f64| {
            let bound = self.criterion_bound(&criterion, time)?;
            Ok::<f64, crate::Error>(libm::log(bound.lower_bound.max(f64::MIN_POSITIVE)))
        };
        // Ends of the bracket: time and ln ratio. Below one period nothing is measured, so the
        // prior, which fails, is all there is.
        let mut low: Option<(f64, f64)> = None;
        let mut high: Option<(f64, f64)> = None;
        let mut at = guess_s.clamp(period, longest);
        // A drift that walks has σ that hardly fall with the time: bolder from step to step.
        let boldness = match self.conditions.drift_colour.is_white() {
            true => 1.0,
            false => 2.0,
        };
        let mut power = POWER * boldness;
        for _ in 0..STEPS {
            let value = ratio(at)?;
            power /= boldness;
            if value > 0.0 {
                low = Some((at, value));
            } else {
                high = Some((at, value));
            }
            at = match (low, high) {
                (Some((t, _)), None) if t >= longest => {
                    return Ok(MinimumTime::NotWithin(longest));
                }
                (Some((t, v)), None) => {
                    (t * libm::exp(1.05 * v / power).clamp(1.001, 20.0)).min(longest)
                }
                (None, Some((t, _))) if t <= period => return Ok(MinimumTime::Unknown),
                (None, Some((t, v))) => {
                    (t * libm::exp(1.05 * v / power).clamp(0.05, 0.999)).max(period)
                }
                (Some(a), Some(b)) => {
                    if b.0 / a.0 < 1.0 + WIDTH {
                        break;
                    }
                    between(a, b)
                }
                (None, None) => break,
            };
        }
        Ok(low.map_or(MinimumTime::Unknown, |(t, _)| MinimumTime::MoreThan(t)))
    }
}

/// The root of the line through both ends in ln t, moved to the side that is still far from it.
fn between(low: (f64, f64), high: (f64, f64)) -> f64 {
    let (a, b) = (libm::log(low.0), libm::log(high.0));
    let root = a + (b - a) * low.1 / (low.1 - high.1);
    let (to_low, to_high) = (root - a, b - root);
    let step = 0.4 * WIDTH;
    let root = if to_low > to_high {
        root - step
    } else {
        root + step
    };
    libm::exp(root.clamp(a + 0.05 * (b - a), b - 0.05 * (b - a)))
}
