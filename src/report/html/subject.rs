//! What a page is about: a schedule on a platform, with everything that is known of it.

use crate::analysis::Analysis;
use crate::commands::CommandTable;
use crate::config::{CheckedConfig, StudyConfig};
use crate::drift::{COEFFICIENTS, CoefficientMatrix};
use crate::error::Result;
use crate::evaluate::{Evaluation, Evaluator};
use crate::motion::Timeline;
use crate::results::{AnalysisDocument, DoneRecord, EvaluationDocument, Inputs};
use crate::schedule::Schedule;
use crate::schedule::file::ScheduleDocument;

/// A schedule, its platform, and all that can be computed of the two.
pub(super) struct Subject {
    pub study: CheckedConfig,
    pub evaluator: Evaluator,
    pub schedule: Schedule,
    pub timeline: Timeline,
    pub evaluation: Evaluation,
    /// The evaluation as data.
    pub document: EvaluationDocument,
    pub analysis: AnalysisDocument,
    pub commands: CommandTable,
}

impl Subject {
    /// From what every document carries: the schedule and the resolved inputs.
    pub fn new(
        schedule: &ScheduleDocument,
        config: &StudyConfig,
        defaulted: &[String],
        done: Option<&DoneRecord>,
    ) -> Result<Self> {
        let mut study = config.check()?;
        if let Some(done) = done {
            study = study.interrupted_after(Schedule::try_from(&done.schedule)?)?;
        }
        let schedule = Schedule::try_from(schedule)?;
        let evaluator = study.evaluator();
        let timeline = Timeline::new(study.test(), &schedule)?;
        let evaluation = evaluator.evaluate(&schedule)?;
        let inputs = Inputs {
            config: config.clone(),
            defaulted: defaulted.to_vec(),
            done: done.cloned(),
        };
        let document =
            EvaluationDocument::new(&evaluation, &schedule, evaluator.objective(), &inputs);
        let analysis = Analysis::new(&evaluator, &schedule, &evaluation)?;
        let analysis = AnalysisDocument::new(
            &analysis,
            &evaluation,
            &schedule,
            evaluator.objective(),
            &inputs,
        );
        let step_deg = CommandTable::DEFAULT_STEP_DEG;
        let mut commands = CommandTable::new(study.test().platform(), &timeline, step_deg)?;
        if let Some(done) = done {
            commands = commands.since(done.total_time_s);
        }
        Ok(Self {
            study,
            evaluator,
            schedule,
            timeline,
            evaluation,
            document,
            analysis,
            commands,
        })
    }

    /// Correlations of the estimates at the end of the test; zero with what is known exactly.
    pub fn correlations(&self) -> CoefficientMatrix {
        let p = &self.evaluation.end.coefficients;
        CoefficientMatrix::from_fn(|i, j| {
            let scale = (p[(i, i)] * p[(j, j)]).sqrt();
            match (i == j, scale > 0.0) {
                (true, _) => 1.0,
                (false, true) => (p[(i, j)] / scale).clamp(-1.0, 1.0),
                (false, false) => 0.0,
            }
        })
    }

    /// When each leg of the timeline begins, and when the last one ends, s.
    pub fn leg_times_s(&self) -> Vec<f64> {
        let mut times = vec![0.0];
        for leg in self.timeline.legs() {
            times.push(times[times.len() - 1] + leg.duration_s());
        }
        times
    }
}

/// The number of pairs of different coefficients, for the page's text.
pub(super) const PAIRS: usize = COEFFICIENTS * (COEFFICIENTS - 1) / 2;

/// How gravity lies in the platform at a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sense {
    /// Along one axis.
    Axis,
    /// Between two axes.
    Plane,
    /// Between all three.
    Space,
}

impl Sense {
    /// A part of gravity below this, in g, does not count: sin 1°.
    const NEGLIGIBLE: f64 = 0.017_452;

    /// By the parts of `gravity` (g) along the platform's axes.
    pub fn of(gravity: [f64; 3]) -> Self {
        let parts = gravity
            .iter()
            .filter(|g| g.abs() > Self::NEGLIGIBLE)
            .count();
        match parts {
            0 | 1 => Self::Axis,
            2 => Self::Plane,
            _ => Self::Space,
        }
    }

    pub const fn name(self) -> &'static str {
        match self {
            Self::Axis => "along an axis",
            Self::Plane => "oblique to two axes",
            Self::Space => "oblique to all axes",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gravity_is_axial_or_oblique() {
        let s = std::f64::consts::FRAC_1_SQRT_2;
        assert_eq!(Sense::of([0.0, -1.0, 0.01]), Sense::Axis);
        assert_eq!(Sense::of([s, -s, 0.0]), Sense::Plane);
        assert_eq!(Sense::of([0.6, -0.6, 0.53]), Sense::Space);
    }
}
