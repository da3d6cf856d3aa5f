//! A line search for the strong Wolfe conditions that can be stepped.
//!
//! Moré & Thuente, "Line search algorithms with guaranteed sufficient decrease", ACM TOMS 20
//! (1994), in the form of MINPACK-2's `dcsrch` and `dcstep`: an interval that holds an acceptable
//! step is found by extrapolation and shrunk by safeguarded cubic and quadratic interpolation; until
//! a step decreases enough, it is the function less the line of sufficient decrease that is
//! interpolated. New here: a trial without a value (a plan that does not fit into its time) bounds the
//! steps from above.

/// μ of the sufficient decrease f(t) ≤ f(0) + μ t f'(0).
const DECREASE: f64 = 1e-4;
/// η of the curvature condition |f'(t)| ≤ η |f'(0)|.
const CURVATURE: f64 = 0.9;
/// The interval is not worth dividing below this, relative to its upper end.
const INTERVAL: f64 = 1e-10;
/// Longest step.
const LONGEST: f64 = 1e10;
/// How far beyond the last step to look for an upper end: at least and at most, in steps.
const BEYOND: [f64; 2] = [1.1, 4.0];
/// An interval that has not shrunk to this share in two steps is bisected.
const SHRINKS_TO: f64 = 0.66;

/// Value and slope along the line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LinePoint {
    pub value: f64,
    pub slope: f64,
}

/// A step tried, with what was found there.
#[derive(Debug, Clone, Copy)]
struct End {
    step: f64,
    value: f64,
    slope: f64,
}

impl End {
    /// As seen from the line `value = slope · step`.
    fn above(self, slope: f64) -> Self {
        Self {
            value: self.value - slope * self.step,
            slope: self.slope - slope,
            ..self
        }
    }
}

/// What to do next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Next {
    /// Try this step.
    Try(f64),
    /// The last step tried will do.
    Accept,
    /// No step will do.
    Fail,
}

/// A search on its way; the first step to try is 1.
#[derive(Debug, Clone)]
pub(super) struct LineSearch {
    start: LinePoint,
    /// The best step so far, an end of the interval.
    best: End,
    /// The other end.
    other: End,
    bracketed: bool,
    /// No step has decreased enough yet with a slope that rises.
    first_stage: bool,
    step: f64,
    /// Bounds of the next step.
    bounds: [f64; 2],
    longest: f64,
    /// Length of the interval, and before that.
    widths: [f64; 2],
}

impl LineSearch {
    /// From a point with this value and slope, which is negative.
    pub fn new(start: LinePoint) -> Self {
        let end = End {
            step: 0.0,
            value: start.value,
            slope: start.slope,
        };
        Self {
            start,
            best: end,
            other: end,
            bracketed: false,
            first_stage: true,
            step: 1.0,
            bounds: [0.0, 1.0 + BEYOND[1]],
            longest: LONGEST,
            widths: [LONGEST, 2.0 * LONGEST],
        }
    }

    /// Takes what was found at the step to try; finite, or none.
    pub fn next(&mut self, found: Option<LinePoint>) -> Next {
        let Some(found) = found else {
            return self.shorter();
        };
        let trial = End {
            step: self.step,
            value: found.value,
            slope: found.slope,
        };
        let line = DECREASE * self.start.slope;
        let enough = self.start.value + line * trial.step;
        if self.first_stage && trial.value <= enough && trial.slope >= 0.0 {
            self.first_stage = false;
        }
        if trial.value <= enough && trial.slope.abs() <= -CURVATURE * self.start.slope {
            return Next::Accept;
        }
        if trial.step >= self.longest && trial.value <= enough && trial.slope <= line {
            return Next::Accept;
        }
        if self.bracketed && self.is_exhausted() {
            return Next::Fail;
        }
        // Moré and Thuente's first stage: as long as no trial decreased the function enough, the
        // interval is updated by the function less the line of sufficient decrease.
        let shift = match self.first_stage && trial.value <= self.best.value && trial.value > enough
        {
            true => line,
            false => 0.0,
        };
        self.update(trial.above(shift), shift);
        self.place_bounds();
        // The interval has shrunk to the best step, which has been tried, or the step overflowed.
        if self.bracketed && self.is_exhausted() || !self.step.is_finite() {
            return Next::Fail;
        }
        Next::Try(self.step)
    }

    /// The step led where there is no value: towards the best one.
    fn shorter(&mut self) -> Next {
        let reach = self.step - self.best.step;
        if self.bracketed || reach <= INTERVAL * self.step {
            return Next::Fail;
        }
        self.longest = self.best.step + 0.75 * reach;
        self.step = self.best.step + 0.5 * reach;
        self.place_bounds();
        Next::Try(self.step)
    }

    fn is_exhausted(&self) -> bool {
        let [low, high] = self.bounds;
        self.step <= low || self.step >= high || high - low <= INTERVAL * high
    }

    /// The ends of the interval and the next step, for values above a line of slope `shift`.
    fn update(&mut self, trial: End, shift: f64) {
        let (best, other) = (self.best.above(shift), self.other.above(shift));
        let (step, brackets) = self.interpolated(&best, &other, &trial);
        self.bracketed |= brackets;
        let (best, other) = if trial.value > best.value {
            (best, trial)
        } else if opposite(trial.slope, best.slope) {
            (trial, best)
        } else {
            (trial, other)
        };
        self.best = best.above(-shift);
        self.other = other.above(-shift);
        self.step = step;
    }

    /// The step that interpolation proposes, and whether the trial brackets a minimiser.
    fn interpolated(&self, best: &End, other: &End, trial: &End) -> (f64, bool) {
        let nearer = |a: f64, b: f64, to: f64| (a - to).abs() < (b - to).abs();
        if trial.value > best.value {
            // Higher: between the cubic's and the quadratic's minimiser, nearer the best.
            let cubic = cubic(best, trial, false);
            let mean = (best.value - trial.value) / (trial.step - best.step) + best.slope;
            let quadratic = best.step + 0.5 * (best.slope / mean) * (trial.step - best.step);
            let step = match nearer(cubic, quadratic, best.step) {
                true => cubic,
                false => cubic + 0.5 * (quadratic - cubic),
            };
            (step, true)
        } else if opposite(trial.slope, best.slope) {
            // Lower, beyond the minimum: the one farther from the trial.
            let (cubic, secant) = (cubic(trial, best, false), secant(trial, best));
            let step = match nearer(secant, cubic, trial.step) {
                true => cubic,
                false => secant,
            };
            (step, true)
        } else if trial.slope.abs() < best.slope.abs() {
            // Lower, and the slope is getting smaller.
            let (cubic, secant) = (self.cubic_ahead(best, trial), secant(trial, best));
            if self.bracketed {
                let step = match nearer(cubic, secant, trial.step) {
                    true => cubic,
                    false => secant,
                };
                let limit = trial.step + SHRINKS_TO * (other.step - trial.step);
                let step = match trial.step > best.step {
                    true => step.min(limit),
                    false => step.max(limit),
                };
                (step, false)
            } else {
                let step = match nearer(secant, cubic, trial.step) {
                    true => cubic,
                    false => secant,
                };
                (step.clamp(self.bounds[0], self.bounds[1]), false)
            }
        } else if self.bracketed {
            // Lower, and the slope is not getting smaller.
            (cubic(trial, other, false), false)
        } else {
            (self.farthest(best, trial), false)
        }
    }

    /// The cubic's minimiser beyond the trial, or as far as may be.
    fn cubic_ahead(&self, best: &End, trial: &End) -> f64 {
        let step = cubic(trial, best, true);
        // From the trial away from the best, if at all.
        let ahead = (step - trial.step) * (trial.step - best.step) > 0.0;
        if ahead {
            step
        } else {
            self.farthest(best, trial)
        }
    }

    fn farthest(&self, best: &End, trial: &End) -> f64 {
        match trial.step > best.step {
            true => self.bounds[1],
            false => self.bounds[0],
        }
    }

    /// The bounds of the step after this one; the step bisects an interval that shrinks too slowly.
    fn place_bounds(&mut self) {
        let (best, other) = (self.best.step, self.other.step);
        if self.bracketed {
            let width = (other - best).abs();
            if width >= SHRINKS_TO * self.widths[1] {
                self.step = best + 0.5 * (other - best);
            }
            self.widths = [width, self.widths[0]];
            self.bounds = [best.min(other), best.max(other)];
        } else {
            let done = self.step - best;
            self.bounds = BEYOND.map(|times| self.step + times * done);
        }
        self.step = self.step.clamp(0.0, self.longest);
    }
}

fn opposite(a: f64, b: f64) -> bool {
    a * b.signum() < 0.0
}

/// The minimiser of the cubic through two ends, seen from `a`. With `ahead` a cubic without one is
/// allowed for.
fn cubic(a: &End, b: &End, ahead: bool) -> f64 {
    let theta = 3.0 * (b.value - a.value) / (a.step - b.step) + a.slope + b.slope;
    let scale = theta.abs().max(a.slope.abs()).max(b.slope.abs());
    let under = (theta / scale).powi(2) - (a.slope / scale) * (b.slope / scale);
    let under = if ahead { under.max(0.0) } else { under };
    let root = scale * under.sqrt();
    let gamma = if a.step > b.step { -root } else { root };
    let ratio = ((gamma - a.slope) + theta) / ((gamma - a.slope) + gamma + b.slope);
    a.step + ratio * (b.step - a.step)
}

/// Where the slope through two ends vanishes, seen from `a`.
fn secant(a: &End, b: &End) -> f64 {
    a.step + a.slope / (a.slope - b.slope) * (b.step - a.step)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Value and slope of a function along a line.
    type Line = fn(f64) -> (f64, f64);

    /// Lines that fall at 0: shapes of Moré & Thuente's test problems, and a valley with a wall.
    const LINES: [Line; 5] = [
        |t| {
            let d = t * t + 2.0;
            (-t / d, (t * t - 2.0) / (d * d))
        },
        |t| {
            let s = t + 0.004;
            let (f4, f5) = (s.powi(4), s.powi(5));
            (f5 - 2.0 * f4, 5.0 * f4 - 8.0 * s.powi(3))
        },
        |t| ((t - 3.0).powi(2), 2.0 * (t - 3.0)),
        |t| (-(t.sin()) + 0.01 * t * t, -t.cos() + 0.02 * t),
        |t| {
            (
                (-t).exp() + (4.0 * (t - 2.0)).exp(),
                -(-t).exp() + 4.0 * (4.0 * (t - 2.0)).exp(),
            )
        },
    ];

    /// The step accepted along `line`, whose unit is `scale`; no values from `wall` on.
    fn accepted(line: Line, scale: f64, wall: f64) -> Option<f64> {
        let at = |t: f64| {
            let (value, slope) = line(t * scale);
            LinePoint {
                value,
                slope: slope * scale,
            }
        };
        let mut search = LineSearch::new(at(0.0));
        let mut step = 1.0;
        for _ in 0..40 {
            let found = (step * scale < wall).then(|| at(step));
            let found = found.filter(|f| f.value.is_finite());
            match search.next(found) {
                Next::Try(next) => step = next,
                Next::Accept => return Some(step),
                Next::Fail => return None,
            }
        }
        None
    }

    #[test]
    fn what_it_accepts_meets_the_wolfe_conditions() {
        for (i, line) in LINES.into_iter().enumerate() {
            for scale in [1e-3, 0.1, 1.0, 10.0, 1e3] {
                let step = accepted(line, scale, f64::INFINITY);
                let t = step.map(|step| step * scale);
                let Some(t) = t else {
                    panic!("line {i}, scale {scale}")
                };
                let ((start, falls), (value, slope)) = (line(0.0), line(t));
                assert!(
                    value <= start + DECREASE * t * falls,
                    "line {i}, scale {scale}: {t}"
                );
                assert!(
                    slope.abs() <= -CURVATURE * falls,
                    "line {i}, scale {scale}: {t}"
                );
            }
        }
    }

    #[test]
    fn it_stays_on_this_side_of_a_wall() {
        // The minimum, at 3, is beyond it: the best that can be had is a decrease short of it.
        let line = LINES[2];
        for scale in [0.1, 1.0, 100.0] {
            let t = accepted(line, scale, 2.0).unwrap() * scale;
            assert!(t < 2.0 && line(t).0 < line(0.0).0, "{t}");
        }
    }
}
