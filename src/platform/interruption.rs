//! A platform in the middle of a test.

use super::Platform;
use crate::attitude::Position;
use crate::error::Result;
use crate::motion::Timeline;
use crate::schedule::Schedule;

impl Platform {
    /// The same platform in the middle of a test: `done` has been executed, as it was (an
    /// interrupted dwell with the time it got), and what is planned from now on continues it.
    ///
    /// Every timeline on it begins with what is done, so that the filter's knowledge so far — the
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
    /// use scheme_opt::internals::platform::PlatformConfig;
    /// use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
    ///
    /// let at = |deg| ScheduledPosition::new(Position::from_deg(deg, 20.0, 40.0), 900.0);
    /// let platform = PlatformConfig::default().check()?;
    /// let interrupted = platform.clone().interrupted_after(Schedule::new(vec![at(0.0)])?)?;
    /// let rest = Schedule::new(vec![at(120.0)])?;
    /// let whole = Schedule::new(vec![at(0.0), at(120.0)])?;
    /// let rms = |platform, schedule: &Schedule| {
    ///     let evaluator = Evaluator::new(platform, Objective::default());
    ///     evaluator.evaluate(schedule).map(|e| e.rms_sigma_deg_per_h())
    /// };
    /// assert_eq!(rms(interrupted, &rest)?, rms(platform, &whole)?);
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

    /// What of the test is over already, if anything.
    pub fn done(&self) -> Option<&Schedule> {
        self.done.as_ref()
    }

    /// Where it stands before what is planned; none: wherever the plan begins.
    pub(crate) fn standing(&self) -> Option<Position> {
        let last = self.done.as_ref().and_then(|d| d.positions().last());
        last.map(|p| p.position).or(self.motion.start)
    }

    /// Where it returns to at the end of a test, if it does; none: to where the plan begins.
    pub(crate) fn home(&self) -> Option<Position> {
        let first = self.done.as_ref().and_then(|d| d.positions().first());
        self.motion.start.or(first.map(|p| p.position))
    }
}
