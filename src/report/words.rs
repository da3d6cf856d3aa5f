//! What the numbers mean, in sentences: shared by the text on a terminal and the HTML page.

use crate::config::{StudyConfig, TestConfig};
use crate::drift::DriftCoefficient;
use crate::model::Colour;
use crate::platform::Platform;
use crate::results::{
    BaselineRecord, BatchDocument, BatchRecord, BatchStatus, CertificateRecord, ComparedWith,
    DoneRecord, EvaluationDocument, FromRecord, ParameterRecord, ResultDocument, RoleRecord,
    ScoreRecord, SimulatedParameter, SimulationDocument,
};
use crate::simulate::consistency::{Consistency, Verdict};
use crate::simulate::specification::SpecificationCheck;

use crate::wording::{decimals, listed, number, seconds, separability};

/// What a reader has to know before any number of the result; empty where there is nothing.
pub fn preface(document: &ResultDocument) -> Vec<String> {
    let mut words = Vec::new();
    words.extend(document.done.as_ref().map(done));
    words.extend(unobservable(document));
    words.extend(known_before(&document.evaluation));
    words
}

/// Whose test it is; none where nobody said.
pub fn test(test: &TestConfig) -> Option<String> {
    let said = test.given().map(|(name, text)| match name {
        "title" | "note" => text.to_owned(),
        _ => format!("{name} {text}"),
    });
    let said: Vec<String> = said.collect();
    (!said.is_empty()).then(|| said.join("; "))
}

/// What of the test is done already.
pub fn done(done: &DoneRecord) -> String {
    let count = done.schedule.positions.len();
    format!(
        "Done already: {count} position{} in {} s. What follows is the rest; times count from the \
         beginning of the test.",
        if count == 1 { "" } else { "s" },
        seconds(done.total_time_s)
    )
}

/// How the result stands to the scheme that the search began with.
pub fn from(document: &ResultDocument, from: &FromRecord) -> String {
    let name = &from.name;
    let mut words = Vec::new();
    if !from.only.is_empty() {
        words.push(format!(
            "Of {name} only the {} may change.",
            listed(&from.only)
        ));
    }
    let score = &document.evaluation.score;
    let reaches = from
        .criterion
        .zip(from.total_time_s)
        .map(|(criterion, time_s)| {
            format!(
                "{name} itself reaches {}{} in {} s",
                number(criterion),
                unit(&score.criterion_unit),
                seconds(time_s)
            )
        });
    let compares = score.known_before.is_none();
    match (reaches, from.is_the_result) {
        (_, true) => words.push(format!(
            "Nothing better than {name} was found: this is the scheme as it was given."
        )),
        (Some(reaches), false) if from.time_ratio.is_some() => words.push(format!(
            "{reaches}: this takes {}.",
            match from.time_ratio.unwrap_or(1.0) {
                r if r >= 1.005 => format!("{r:.2} times less than that"),
                _ => "as long".to_owned(),
            }
        )),
        (Some(reaches), false) if compares => {
            let which = match document.pareto.is_empty() {
                true => "this is",
                false => "in no more time the front comes to what is",
            };
            words.push(format!("{reaches}: {which} {} it.", compared(from.ratio)))
        }
        (Some(reaches), false) => words.push(format!("{reaches}.")),
        (None, false) => {}
    }
    if !from.beyond.is_empty() {
        words.push(format!(
            "{name} is not within the limits of this search: {}. Its nearest form within them was one \
             of the starts, and for that reason the result need not be as good as it.",
            from.beyond.join("; ")
        ));
    }
    if !from.pinned.is_empty() && from.only != ["dwells"] {
        let numbers: Vec<String> = from.pinned.iter().map(ToString::to_string).collect();
        let s = if numbers.len() == 1 { "" } else { "s" };
        words.push(format!(
            "Its pinned position{s} {} kept angles and order.",
            listed(&numbers)
        ));
    }
    words.join(" ")
}

/// How a batch went, in a sentence.
pub fn batch(document: &BatchDocument) -> String {
    let all = &document.platforms;
    let count = |is: &dyn Fn(&BatchRecord) -> bool| all.iter().filter(|p| is(p)).count();
    let plural = |n: usize| if n == 1 { "platform" } else { "platforms" };
    let mut parts = vec![format!("{} {}", all.len(), plural(all.len()))];
    let sorts: [(&str, usize); 5] = [
        (
            "with the schedule asked for",
            count(&|p| p.status != BatchStatus::Interrupted && p.acceptable == Some(true)),
        ),
        (
            "without an acceptable one",
            count(&|p| p.status != BatchStatus::Interrupted && p.acceptable == Some(false)),
        ),
        ("failed", count(&|p| p.status == BatchStatus::Failed)),
        (
            "interrupted",
            count(&|p| p.status == BatchStatus::Interrupted),
        ),
        (
            "not started",
            count(&|p| p.status == BatchStatus::NotStarted),
        ),
    ];
    let sorts = sorts.into_iter().filter(|(_, n)| *n > 0);
    parts.extend(sorts.map(|(what, n)| format!("{n} {what}")));
    let rest = parts.split_off(1);
    match rest.is_empty() {
        true => format!("{}.", parts[0]),
        false => format!("{}: {}.", parts[0], rest.join(", ")),
    }
}

/// Why a platform of a batch has no schedule that is acceptable; none: it has one, or nothing is known.
pub fn why_not(record: &BatchRecord) -> Option<&str> {
    let reason = record
        .reason
        .as_deref()
        .filter(|_| record.acceptable == Some(false));
    record.error.as_deref().or(reason)
}

/// Whether a specification is met, in a word.
pub const fn met(met: bool) -> &'static str {
    if met { "met" } else { "missed" }
}

/// How far the gimbals go from where they start, whole turns counted.
pub fn winding(winding_deg: [f64; 3]) -> String {
    let [alpha, beta, gamma] = winding_deg.map(|deg| decimals(deg, 3));
    format!(
        "Farthest from the start, whole turns counted: alpha {alpha} deg, beta {beta} deg, gamma \
         {gamma} deg."
    )
}

/// That the criterion is 0 whatever the schedule; none where it is not.
pub fn known_before(document: &EvaluationDocument) -> Option<String> {
    let known = document.score.known_before.as_ref()?;
    Some(format!("No test is needed: {known}."))
}

/// Which coefficients that count stay unobservable, on this stand or by this schedule.
fn unobservable(document: &ResultDocument) -> Option<String> {
    let found = &document.unobservable;
    let named = |all: &[DriftCoefficient]| {
        let records = document.evaluation.coefficients.iter();
        let named: Vec<String> = records
            .filter(|c| all.contains(&c.name))
            .map(|c| {
                let (prior, sigma) = (c.prior_sigma_deg_per_h, c.sigma_deg_per_h);
                let sigma = match sigma < 0.995 * prior {
                    true => format!("{} before and {} after", number(prior), number(sigma)),
                    false => format!("{}, as before", number(prior)),
                };
                format!("{} ({sigma})", c.name.name())
            })
            .collect();
        crate::wording::listed(&named)
    };
    let mut words = Vec::new();
    if !found.on_this_stand.is_empty() {
        words.push(format!(
            "NOT OBSERVABLE on this stand, whatever the schedule: {} (sigma in deg/h).",
            named(&found.on_this_stand)
        ));
    }
    if !found.by_this_schedule.is_empty() {
        words.push(format!(
            "NOT OBSERVABLE by this schedule: {} (sigma in deg/h); more positions or more time may \
             help.",
            named(&found.by_this_schedule)
        ));
    }
    if !found.accepted.is_empty() {
        words.push(format!(
            "Unobservable, and accepted by objective.accept_unobservable: {} (sigma in deg/h).",
            named(&found.accepted)
        ));
    }
    if !found.combinations.is_empty() {
        words.push(format!(
            "What no schedule on this stand can tell: {}.",
            found.combinations.join("; ")
        ));
    }
    if !found.is_acceptable() {
        words.push(
            "Coefficients that may stay so are named in objective.accept_unobservable.".to_owned(),
        );
    }
    (!words.is_empty()).then(|| words.join(" "))
}

/// The result in one line: accuracy, effort, and what the standard schemes make of the same time
/// by the criterion of the search.
pub fn verdict(document: &ResultDocument) -> String {
    let found = &document.evaluation;
    let score = &found.score;
    let positions = found.schedule.positions.len();
    let searched_for = match is_the_rms(found) {
        true => String::new(),
        false => format!(
            ", criterion {} {}{}",
            score.criterion_name,
            number(score.criterion),
            unit(&score.criterion_unit)
        ),
    };
    // Where no schedule can make the criterion good, to be as good as the others says nothing.
    let compares = score.known_before.is_none() && document.unobservable.is_acceptable();
    let best = document.best_baseline().filter(|_| compares);
    let comparison = best.map_or_else(String::new, |best| {
        let compared = compared(best.yardstick_ratio());
        format!(": {compared} the best standard scheme ({})", in_order(best))
    });
    format!(
        "RMS sigma {} deg/h{searched_for} in {} s with {positions} position{}{comparison}\n",
        number(found.rms_sigma_deg_per_h),
        seconds(found.total_time_s),
        if positions == 1 { "" } else { "s" },
    )
}

/// A standard scheme by its name, and in which order it is the yardstick.
pub fn in_order(scheme: &BaselineRecord) -> String {
    match scheme.best_order {
        Some(_) => format!("{} in its best order", scheme.name),
        None => scheme.name.clone(),
    }
}

/// A ratio of another schedule's criterion to this one's, in words.
pub fn compared(ratio: Option<f64>) -> String {
    match ratio.unwrap_or(f64::INFINITY) {
        r if r >= 1.005 => format!("{r:.2} times better than"),
        r if r <= 0.995 => format!("{:.2} times worse than", 1.0 / r),
        _ => "as good as".to_owned(),
    }
}

/// Name of a criterion and its unit, as they head a column of a terminal.
pub fn criterion_column(name: &str, unit: &str) -> String {
    match unit {
        "1" => name.to_owned(),
        unit => format!("{name}, {unit}"),
    }
}

/// Whether the criterion is the RMS σ itself: `a` without weights.
pub fn is_the_rms(document: &EvaluationDocument) -> bool {
    let weights = &document.inputs.objective.weights;
    document.score.criterion_name == "a" && weights.is_empty()
}

/// A unit as it follows a number; empty for a ratio.
pub fn unit(unit: &str) -> String {
    match unit {
        "1" => String::new(),
        unit => format!(" {unit}"),
    }
}

/// The heading of a column or an axis of the criterion.
pub fn criterion_heading(score: &ScoreRecord) -> String {
    let unit = match score.criterion_unit.as_str() {
        "1" => String::new(),
        "deg/h" => ", °/h".to_owned(),
        unit => format!(", {unit}"),
    };
    format!("criterion {}{unit}", score.criterion_name)
}

/// How far the schedule is from the best possible.
pub fn within(certificate: &CertificateRecord) -> String {
    let remarks: String = certificate
        .remarks
        .iter()
        .map(|r| format!("; {r}"))
        .collect();
    let (bound, gap) = match (certificate.lower_bound, certificate.gap_percent) {
        (Some(bound), Some(gap)) => (bound, gap),
        (Some(bound), None) if certificate.total_time_s.is_none() => {
            let bound = seconds(bound);
            return format!("No schedule of {bound} s or less meets the specification{remarks}.");
        }
        _ => return format!("How far that is from the best possible is not known{remarks}."),
    };
    let gap = match gap {
        gap if gap < 100.0 => format!("{gap:.1} %"),
        gap => format!("a factor of {}", number(1.0 + gap / 100.0)),
    };
    let none = match certificate.total_time_s {
        Some(time_s) => format!(
            "in {} s none is below {}{}",
            seconds(time_s),
            number(bound),
            unit(&certificate.unit)
        ),
        None => format!(
            "none of {} s or less meets the specification",
            seconds(bound)
        ),
    };
    format!("Within {gap} of what any torquing programme could reach: {none}{remarks}.")
}

/// What a list of what is told only through a small tilt means.
pub const NEARLY: &str = "Nearly not observable: what follows is told only through a small tilt. A stand \
    whose angles are wrong by as much, or that has no such tilt, does not tell it.";

/// What the schedule can and cannot tell apart.
pub fn observability(document: &EvaluationDocument) -> String {
    let o = &document.observability;
    if o.unobservable.is_empty() {
        let weakest = document
            .coefficients
            .iter()
            .min_by(|a, b| a.separability.total_cmp(&b.separability));
        let condition = o
            .condition_number
            .map_or_else(String::new, |c| format!(", condition number {}", number(c)));
        let weakest = weakest.map_or_else(String::new, |c| {
            format!(
                "; hardest to tell from the others: {} (separability {})",
                c.name.name(),
                separability(c.separability)
            )
        });
        return format!(
            "All {} unknowns are observable{condition}{weakest}.",
            o.unknowns
        );
    }
    // Between two dwells the drift moves psi too, which the filter sees at the second and the orders
    // of the dwells' derivatives do not count.
    let otherwise = match document.overhead_s > 0.0 {
        true => {
            "Of such a combination little more than the prior is known: what the drift does during \
             moves and settles is not counted here, but in the sigma it is"
        }
        false => "Of such a combination only the prior is known",
    };
    format!(
        "{} of {} unknowns are observable. What the measurements cannot tell: {}. {otherwise}.",
        o.rank,
        o.unknowns,
        o.unobservable.join("; ")
    )
}

/// What simulated runs say: the sentences of their judgement.
pub fn simulated(document: &SimulationDocument) -> Vec<String> {
    match &document.judgement {
        Some(judgement) => judgement.sentences.clone(),
        None => vec![format!(
            "Over all {} runs the RMS error is {} deg/h, the plan {} deg/h. The version that wrote \
             this document did not look for runs that diverged: simulate again to know.",
            document.runs,
            number(document.rms_error_deg_per_h),
            number(document.rms_planned_sigma_deg_per_h),
        )],
    }
}

/// Cells of a table of averages: what is expected (the degrees of freedom), what was found, the
/// bounds, and where it lies.
pub fn consistency(c: &Consistency) -> [String; 4] {
    let place = match c.verdict {
        Verdict::Consistent => "within",
        Verdict::Pessimistic => "below",
        _ => "above",
    };
    [
        c.degrees_of_freedom.to_string(),
        number(c.average),
        format!("{:.3} to {:.3}", c.bounds[0], c.bounds[1]),
        place.to_owned(),
    ]
}

/// The averages at the end of a simulation by name: those that make the verdict first.
pub fn averages(document: &SimulationDocument) -> Vec<(&'static str, &Option<Consistency>)> {
    let ignores = document.compared_with == ComparedWith::FilterAndConsidered;
    let mut averages = vec![("NEES, all states", &document.nees)];
    if document.nees_parameters.is_some() {
        averages.push(("NEES, parameters", &document.nees_parameters));
    }
    averages.push(("NEES, coefficients", &document.nees_coefficients));
    match ignores {
        false => averages.push(("NIS", &document.nis)),
        true => averages.extend([
            ("NIS without what is ignored", &document.nis),
            ("NEES as claimed", &document.nees_claimed),
            ("NIS as claimed", &document.nis_claimed),
        ]),
    }
    averages
}

/// How the bounds of a simulation's averages are to be read.
pub fn bounds(document: &SimulationDocument) -> String {
    let count = match document.nees_parameters.is_some() {
        true => "four",
        false => "three",
    };
    let claimed = match document.compared_with {
        ComparedWith::Filter => "",
        ComparedWith::FilterAndConsidered => {
            " As claimed: by the filter's own covariance, which does not know of the considered \
             parameters; it is no part of the verdict. NIS as claimed is what the stand would see."
        }
    };
    format!(
        "All {count} averages at the end lie within their bounds in 95 of 100 simulations of a \
         consistent filter; they make the verdict. Those of the positions are taken each by itself: \
         one in twenty is outside by chance.{claimed}"
    )
}

/// The parameters of a simulation beyond the twelve coefficients.
pub fn other_parameters(document: &SimulationDocument) -> &[SimulatedParameter] {
    let twelve = document.coefficients.len().min(document.parameters.len());
    &document.parameters[twelve..]
}

/// What the columns of a simulation's errors are.
pub fn columns(document: &SimulationDocument) -> String {
    let [low, high] = document.ratio_bounds;
    match document.compared_with {
        ComparedWith::Filter => format!(
            "ratio: RMS of error/sigma; 95 of 100 lie between {low:.3} and {high:.3} for a filter \
             that is right about itself. planned: sigma by the linear model, as `evaluate` has it."
        ),
        ComparedWith::FilterAndConsidered => format!(
            "sigma: the truth, in which the considered parameters count; claimed: what the filter \
             says, which does not know of them. ratio: RMS of error/sigma; 95 of 100 lie between \
             {low:.3} and {high:.3} if the truth is as predicted. planned: the true sigma by the \
             linear model, as `evaluate` has it."
        ),
    }
}

/// What a sweep of a platform with more errors than the coefficients leaves alone.
pub const SWEPT: &str = "Swept are the misalignment and the twelve drift coefficients; the other \
    parameters are drawn from their own priors at every point.";

/// How the intervals of a simulation's errors are to be read.
pub fn intervals(check: &SpecificationCheck) -> String {
    format!(
        "All these intervals hold the 1 sigma of the error together with {:.0} % certainty, if the \
         errors are of one normal distribution (chi-square). Met: the whole interval is within \
         the specification, and no run diverged.",
        100.0 * check.probability
    )
}

/// What the plan says of the specification, for a page on which a simulation decides; none without
/// a specification.
pub fn planned_specification(document: &EvaluationDocument) -> Option<String> {
    let planned = specification(document)?;
    let (met, missed) = ("The specification is met", "The specification is not met");
    Some(match planned.strip_prefix(met) {
        Some(rest) => format!("By the plan alone the specification would be met{rest}"),
        None => planned.replacen(
            missed,
            "By the plan alone the specification would not be met",
            1,
        ),
    })
}

/// Whether the specification is met and when; none without a specification.
pub fn specification(document: &EvaluationDocument) -> Option<String> {
    let specified: Vec<_> = document
        .coefficients
        .iter()
        .filter(|c| c.spec_deg_per_h.is_some())
        .collect();
    let others: Vec<(&ParameterRecord, f64)> = document
        .parameters
        .iter()
        .skip(document.coefficients.len())
        .filter_map(|p| Some((p, p.spec?)))
        .collect();
    if specified.is_empty() && others.is_empty() {
        return None;
    }
    let instead = |name: &str, sigma: f64, spec: f64, unit: &str| {
        let (sigma, spec) = (number(sigma), number(spec));
        format!("{name} ({sigma} instead of {spec} {unit})")
    };
    let late = specified.iter().filter(|c| c.time_to_spec_s.is_none());
    let late = late.map(|c| {
        let spec = c.spec_deg_per_h.unwrap_or(f64::INFINITY);
        instead(c.name.name(), c.sigma_deg_per_h, spec, "deg/h")
    });
    let beyond = others.iter().filter(|(p, spec)| p.sigma > *spec);
    let beyond = beyond.map(|(p, spec)| instead(&p.name, p.sigma, *spec, &p.unit));
    let missed: Vec<String> = late.chain(beyond).collect();
    if !missed.is_empty() {
        return Some(format!(
            "The specification is not met: {}.",
            listed(&missed)
        ));
    }
    let times = specified.iter().filter_map(|c| c.time_to_spec_s);
    let from = times.reduce(f64::max).map(|last| {
        let last = seconds(last);
        format!("every coefficient that has one is within it from {last} s on")
    });
    let at_the_end = match others.is_empty() {
        true => None,
        false => {
            let names: Vec<&str> = others.iter().map(|(p, _)| p.name.as_str()).collect();
            Some(format!("within it at the end: {}", listed(&names)))
        }
    };
    let met: Vec<String> = from.into_iter().chain(at_the_end).collect();
    Some(format!("The specification is met: {}.", met.join("; ")))
}

/// What a filter that ignores something makes of it; none where it ignores nothing.
pub fn claims(document: &EvaluationDocument) -> Option<String> {
    let ratio = |p: &ParameterRecord| p.claimed_sigma.map(|claimed| p.sigma / claimed);
    let estimated = document
        .parameters
        .iter()
        .filter(|p| ratio(p).is_some_and(f64::is_finite));
    let size = |p: &ParameterRecord| ratio(p).unwrap_or(0.0);
    let worst = estimated.max_by(|a, b| size(a).total_cmp(&size(b)))?;
    let ignored = document
        .parameters
        .iter()
        .filter(|p| p.role == RoleRecord::Considered);
    let mut groups: Vec<&str> = ignored
        .map(|p| crate::model::group(&p.group).map_or(&p.group[..], |g| g.title))
        .collect();
    groups.dedup();
    let (claimed, unit) = (worst.claimed_sigma?, &worst.unit);
    Some(format!(
        "The filter ignores {} and claims less than is true: at worst {}, {} {unit} for {} {unit} claimed.",
        listed(&groups),
        worst.name,
        number(worst.sigma),
        number(claimed),
    ))
}

/// What D_F means under a rate random walk, and how well its constant part is known; none without one.
pub fn constant_part(document: &EvaluationDocument) -> Option<String> {
    let parts = document.parameters.iter().filter_map(|p| {
        let sigma = p.constant_part_sigma?;
        Some(format!("{} {}", p.name, number(sigma)))
    });
    let parts: Vec<String> = parts.collect();
    (!parts.is_empty()).then(|| {
        format!(
            "The drift walks: D_F is the drift at the end of the test, its constant part and what the rate \
             random walk has come to. 1 sigma of the constant part alone: {} deg/h.",
            listed(&parts)
        )
    })
}

/// What is changed for [`EvaluationDocument::limits`], and how that is counted.
pub const LIMITS: &str = "The criterion with one thing better, as a ratio to that of the plan. The total \
    time stays; time that is saved goes to the dwells in proportion, and the schedule is not searched \
    anew, which is right to first order where it is the best for the platform as it is. What would not \
    help is left out: a filter that ignores errors does worse with less noise, for it then trusts what \
    it misreads.";

/// What a ratio of the criterion means.
pub fn gained(criterion_ratio: f64) -> String {
    let percent = 100.0 * (1.0 - criterion_ratio);
    match percent {
        p if p >= 0.05 => format!("{p:.1} % better"),
        p if p <= -0.05 => format!("{:.1} % worse", -p),
        _ => "no difference".to_owned(),
    }
}

/// What a plan without accelerometer biases leaves out where they wander.
const CONSTANT_BIAS: &str = "the constant part of the accelerometer bias";

/// What the plan takes to be perfect: groups of `[errors]` that the platform file does not have.
pub fn perfect(inputs: &StudyConfig) -> String {
    // Inputs of a document were checked when it was made.
    let checked = inputs.platform.check();
    let has = |group: &str| {
        let parameters = checked.as_ref().map(|p| p.errors().parameters());
        parameters.is_ok_and(|all| all.iter().any(|p| p.group == group && p.prior_sigma > 0.0))
    };
    // What cannot be told at 1 g is no fault of a plan.
    let counts = |key: &str| key != "quadratic_output_drift_deg_per_h_per_g2";
    let wanders = checked
        .as_ref()
        .is_ok_and(|p| !p.accelerometer_colour().is_white());
    let absent: Vec<&str> = crate::model::optional_groups()
        .filter(|group| counts(group.key) && !has(group.key))
        .map(|group| match group.key {
            // What wanders is no constant, and is in the plan.
            "accelerometer_bias_ug" if wanders => CONSTANT_BIAS,
            _ => group.title,
        })
        .collect();
    let noise = wandering(checked.as_ref().ok());
    match absent.is_empty() {
        true => format!("Modelled: the full error model; {noise}."),
        false => format!("Perfect in this plan: {}; {noise}.", listed(&absent)),
    }
}

/// What is said of noise: what wanders, and what of it is not modelled.
fn wandering(platform: Option<&Platform>) -> String {
    let [drift, bias] = [Platform::drift_colour, Platform::accelerometer_colour]
        .map(|of| platform.map_or(Colour::WHITE, |p| *of(p)));
    let kinds = [
        ("rate random walk", drift.random_walk.is_some()),
        ("bias instability of the gyros", drift.markov.is_some()),
        ("acceleration random walk", bias.random_walk.is_some()),
        (
            "bias instability of the accelerometers",
            bias.markov.is_some(),
        ),
    ];
    let of = |wanted: bool| {
        let chosen = kinds
            .iter()
            .filter(move |(_, modelled)| *modelled == wanted);
        chosen.map(|(name, _)| *name).collect::<Vec<_>>()
    };
    let (modelled, absent) = (of(true), of(false));
    match (modelled.is_empty(), absent.is_empty()) {
        (true, _) => format!(
            "random drift and noise are white (not modelled: {})",
            listed(&absent)
        ),
        (false, true) => "all noise that wanders is in it".to_owned(),
        (false, false) => format!(
            "modelled: {}; not modelled: {}",
            listed(&modelled),
            listed(&absent)
        ),
    }
}
