//! Reports for people, as text.

use crate::motion::Timeline;
use crate::platform::Platform;
use crate::results::{CertificateRecord, EvaluationDocument, ResultDocument};
use crate::search::Status;

use super::table;

/// The longest line of running text.
const WIDTH: usize = 80;

/// What a search found.
pub(super) fn search(
    document: &ResultDocument,
    platform: &Platform,
    timeline: &Timeline,
    files: &[String],
) -> String {
    let found = &document.evaluation;
    let mut text = verdict(document);
    if let Some(certificate) = &document.certificate {
        text.push_str(&wrap(&within(certificate)));
    }
    if document.status != Status::Converged.name() {
        text.push_str(&wrap(&format!("{}: {}", document.status, document.reason)));
    }
    if !document.pareto.is_empty() {
        text.push_str("\nTotal time against criterion; what follows is the longest test\n\n");
        let score = &found.score;
        text.push_str(&table::front(
            &score.criterion_name,
            &score.criterion_unit,
            &document.pareto,
        ));
    }
    text.push_str("\nSchedule\n\n");
    text.push_str(&table::schedule(platform, timeline));
    text.push_str("\nCoefficients after the test, 1 sigma\n\n");
    text.push_str(&table::coefficients(found));
    text.push('\n');
    text.push_str(&observability(found));
    text.push_str("\nBeside the standard schemes in the same time\n\n");
    text.push_str(&table::baselines(found, &document.baselines));
    for skipped in &document.baselines_skipped {
        text.push_str(&wrap(&format!(
            "{}: not run, {}",
            skipped.name, skipped.reason
        )));
    }
    text.push('\n');
    text.push_str(&work(document));
    if !files.is_empty() {
        text.push_str(&format!("\nWritten: {}\n", files.join("\n         ")));
    }
    text
}

/// The result in one line: accuracy, effort, and what the standard schemes make of the same time
/// by the criterion of the search.
fn verdict(document: &ResultDocument) -> String {
    let found = &document.evaluation;
    let score = &found.score;
    let positions = found.schedule.positions.len();
    let searched_for = match score.criterion_name.as_str() {
        "a" => String::new(),
        name => format!(
            ", criterion {name} {} {}",
            table::number(score.criterion),
            score.criterion_unit
        ),
    };
    let comparison = document.best_baseline().map_or_else(String::new, |best| {
        let ratio = best.criterion_ratio.unwrap_or(f64::INFINITY);
        let compared = match ratio {
            r if r >= 1.005 => format!("{r:.2} times better than"),
            r if r <= 0.995 => format!("{:.2} times worse than", 1.0 / r),
            _ => "as good as".to_owned(),
        };
        format!(": {compared} the best standard scheme ({})", best.name)
    });
    format!(
        "RMS sigma {} deg/h{searched_for} in {} s with {positions} position{}{comparison}\n",
        table::number(found.rms_sigma_deg_per_h),
        table::seconds(found.total_time_s),
        if positions == 1 { "" } else { "s" },
    )
}

/// How far the schedule is from the best possible.
fn within(certificate: &CertificateRecord) -> String {
    let remarks: String = certificate
        .remarks
        .iter()
        .map(|r| format!("; {r}"))
        .collect();
    let (bound, gap) = match (certificate.lower_bound, certificate.gap_percent) {
        (Some(bound), Some(gap)) => (bound, gap),
        (Some(bound), None) if certificate.total_time_s.is_none() => {
            let bound = table::seconds(bound);
            return format!("No schedule of {bound} s or less meets the specification{remarks}.");
        }
        _ => return format!("How far that is from the best possible is not known{remarks}."),
    };
    let gap = match gap {
        gap if gap < 100.0 => format!("{gap:.1} %"),
        gap => format!("a factor of {}", table::number(1.0 + gap / 100.0)),
    };
    let none = match certificate.total_time_s {
        Some(time_s) => format!(
            "in {} s none is below {}{}",
            table::seconds(time_s),
            table::number(bound),
            match certificate.unit.as_str() {
                "1" => String::new(),
                unit => format!(" {unit}"),
            }
        ),
        None => format!(
            "none of {} s or less meets the specification",
            table::seconds(bound)
        ),
    };
    format!("Within {gap} of what any torquing programme could reach: {none}{remarks}.")
}

/// Status and work done.
fn work(document: &ResultDocument) -> String {
    let c = &document.counters;
    let time = document
        .wall_time_s
        .map_or_else(String::new, |s| format!(" in {s:.1} s"));
    wrap(&format!(
        "{}: {} starts, {} values, {} gradients{time}; seed {}; two computations of every sigma \
         agree to {:.0e}.",
        document.status,
        c.starts,
        c.evaluations,
        c.gradients,
        document.seed,
        document.evaluation.agreement,
    ))
}

/// What is known of a given schedule.
pub(super) fn evaluation(
    document: &EvaluationDocument,
    platform: &Platform,
    timeline: &Timeline,
) -> String {
    let mut text = totals(document);
    text.push_str("\nSchedule\n\n");
    text.push_str(&table::schedule(platform, timeline));
    text.push_str("\nCoefficients after the test, 1 sigma\n\n");
    text.push_str(&table::coefficients(document));
    text.push('\n');
    text.push_str(&table::misalignment(document));
    text.push('\n');
    text.push_str(&observability(document));
    text
}

fn totals(document: &EvaluationDocument) -> String {
    let number = table::number;
    let score = &document.score;
    let missing = || "none".to_owned();
    format!(
        "RMS sigma          {} deg/h\n\
         largest sigma      {} deg/h\n\
         worst combination  {} deg/h\n\
         ln det P_D         {} (P_D in (deg/h)^2)\n\
         criterion {:<9}{} {}\n\
         score              {}\n\
         total time         {} s, of which {} s moves and settles\n\
         agreement          {:.0e} between two computations of every sigma\n",
        number(document.rms_sigma_deg_per_h),
        number(document.max_sigma_deg_per_h),
        number(document.max_eig_sigma_deg_per_h),
        document.logdet_deg_per_h.map_or_else(missing, number),
        score.criterion_name,
        number(score.criterion),
        score.criterion_unit,
        score.value.map_or_else(missing, number),
        table::seconds(document.total_time_s),
        table::seconds(document.overhead_s),
        document.agreement,
    )
}

/// What the schedule can and cannot tell apart, in words.
fn observability(document: &EvaluationDocument) -> String {
    let o = &document.observability;
    if o.unobservable.is_empty() {
        let weakest = document
            .coefficients
            .iter()
            .min_by(|a, b| a.separability.total_cmp(&b.separability));
        let condition = o.condition_number.map_or_else(String::new, |c| {
            format!(", condition number {}", table::number(c))
        });
        let weakest = weakest.map_or_else(String::new, |c| {
            format!(
                "; hardest to tell from the others: {} (separability {:.4})",
                c.name.name(),
                c.separability
            )
        });
        return wrap(&format!(
            "All {} unknowns are observable{condition}{weakest}.",
            o.unknowns
        ));
    }
    wrap(&format!(
        "{} of {} unknowns are observable. What the measurements cannot tell: {}. Of such a \
         combination only the prior is known.",
        o.rank,
        o.unknowns,
        o.unobservable.join("; ")
    ))
}

/// Breaks running text into lines.
pub(super) fn wrap(text: &str) -> String {
    let mut lines = String::new();
    let mut width = 0;
    for word in text.split_whitespace() {
        let length = word.chars().count();
        if width > 0 && width + 1 + length > WIDTH {
            lines.push('\n');
            width = 0;
        } else if width > 0 {
            lines.push(' ');
            width += 1;
        }
        lines.push_str(word);
        width += length;
    }
    lines.push('\n');
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_text_is_broken_into_lines() {
        let text = wrap(&"seventeen letters ".repeat(30));
        assert!(
            text.lines()
                .all(|line| line.len() <= WIDTH && !line.ends_with(' '))
        );
        assert_eq!(text.split_whitespace().count(), 60);
    }
}
