//! A test on a platform, and what of it is over already.

use super::Timeline;
use crate::attitude::Position;
use crate::error::Result;
use crate::platform::Platform;
use crate::schedule::Schedule;

/// A test on a platform, from its beginning or in the middle of it. Schedules say what is planned
/// from now on.
///
/// What is about the instrument and the site alone takes the [`Platform`]; what is about the course
/// of a test takes this.
#[derive(Debug, Clone, PartialEq)]
pub struct Test {
    platform: Platform,
    /// What of it is over already.
    done: Option<Schedule>,
}

/// A test that has not begun.
impl From<Platform> for Test {
    fn from(platform: Platform) -> Self {
        Self {
            platform,
            done: None,
        }
    }
}

impl Test {
    /// The same test later: `done` has been executed, as it was (an interrupted dwell with the time
    /// it got), and what is planned from now on continues it.
    ///
    /// Every timeline of it begins with what is done, so that the filter's knowledge so far — the
    /// whole covariance of misalignment and drift, with their correlations — is what the rest of
    /// the test starts from, exactly. Total times count from the beginning of the test. Done twice,
    /// the second part follows the first.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`](crate::Error::is_input) when the platform could not have executed `done`.
    ///
    /// ```
    /// use scheme_opt::internals::attitude::Position;
    /// use scheme_opt::internals::evaluate::{Evaluator, Objective};
    /// use scheme_opt::internals::motion::Test;
    /// use scheme_opt::internals::platform::PlatformConfig;
    /// use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
    ///
    /// let at = |deg| ScheduledPosition::new(Position::from_deg(deg, 20.0, 40.0), 900.0);
    /// let test = Test::from(PlatformConfig::default().check()?);
    /// let interrupted = test.clone().interrupted_after(Schedule::new(vec![at(0.0)])?)?;
    /// let rest = Schedule::new(vec![at(120.0)])?;
    /// let whole = Schedule::new(vec![at(0.0), at(120.0)])?;
    /// let rms = |test: Test, schedule: &Schedule| {
    ///     let evaluator = Evaluator::new(test, Objective::default());
    ///     evaluator.evaluate(schedule).map(|e| e.rms_sigma_deg_per_h())
    /// };
    /// assert_eq!(rms(interrupted, &rest)?, rms(test, &whole)?);
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn interrupted_after(mut self, done: Schedule) -> Result<Self> {
        Timeline::new(&self, &done)?;
        let before = self.done.take();
        let before = before.iter().flat_map(Schedule::positions);
        let all = before.chain(done.positions()).copied().collect();
        self.done = Some(Schedule::new(all)?);
        Ok(self)
    }

    /// The platform that it is run on.
    pub fn platform(&self) -> &Platform {
        &self.platform
    }

    /// What of it is over already, if anything.
    pub fn done(&self) -> Option<&Schedule> {
        self.done.as_ref()
    }

    /// Where the platform stands before what is planned; none: wherever the plan begins.
    pub(crate) fn standing(&self) -> Option<Position> {
        let last = self.done.as_ref().and_then(|d| d.positions().last());
        last.map(|p| p.position).or(self.platform.motion.start)
    }

    /// Where the platform returns to at the end, if it does; none: to where the plan begins.
    pub(crate) fn home(&self) -> Option<Position> {
        let first = self.done.as_ref().and_then(|d| d.positions().first());
        self.platform.motion.start.or(first.map(|p| p.position))
    }
}
