//! What cannot be told apart over all parameters, and what to add, for people.

use super::report::wrap;
use crate::analysis::additions::Aim;
use crate::observability::named::Remedy;
use crate::results::{AdditionRecord, AdditionsRecord, NamedObservabilityRecord, UnobservedRecord};
use crate::wording::{listed, number};

/// Combinations that are written out.
const WRITTEN: usize = 12;
/// Parts of a combination that a person reads.
const READABLE: usize = 8;
/// Weak combinations that are written out.
const WEAKEST: usize = 3;

/// What does not show, and what would tell it.
pub(super) fn unobservable(named: &NamedObservabilityRecord) -> String {
    let NamedObservabilityRecord { rank, unknowns, .. } = named;
    if named.unobservable.is_empty() {
        return wrap(&format!(
            "By the measurements alone, whatever is known before: all {unknowns} unknowns (estimated \
             parameters and the misalignment at the start) can be told apart."
        ));
    }
    let mut text = wrap(&format!(
        "By the measurements alone, whatever is known before: rank {rank} of {unknowns} unknowns \
         (estimated parameters and the misalignment at the start). What is left rests on the priors:"
    ));
    let (single, combined): (Vec<&UnobservedRecord>, Vec<_>) =
        named.unobservable.iter().partition(|u| u.terms.len() == 1);
    for remedy in different(&single) {
        let names: Vec<&str> = single
            .iter()
            .filter(|u| u.remedy == *remedy)
            .map(|u| u.name.as_str())
            .collect();
        let words = match names.len() {
            1 => remedy.to_string(),
            _ => remedy.to_string().replacen("needs", "need", 1),
        };
        text.push_str(&wrap(&format!("- {}: {words}.", listed(&names))));
    }
    let (readable, long): (Vec<&UnobservedRecord>, Vec<_>) = combined
        .into_iter()
        .partition(|u| u.terms.len() <= READABLE);
    for u in readable.iter().take(WRITTEN) {
        let UnobservedRecord {
            words, rests_on, ..
        } = u;
        text.push_str(&wrap(&format!(
            "- {words}. Sigma stays at least {rests_on}."
        )));
    }
    if readable.len() > WRITTEN {
        let more = readable.len() - WRITTEN;
        text.push_str(&wrap(&format!("- and {more} more, all by --json.")));
    }
    for remedy in different(&long) {
        let words = match long.iter().filter(|u| u.remedy == *remedy).count() {
            1 => format!("- One combination of more than {READABLE} unknowns: {remedy}."),
            n => format!(
                "- {n} combinations of more than {READABLE} unknowns each: {}.",
                remedy.to_string().replacen("needs", "need", 1)
            ),
        };
        text.push_str(&wrap(&words));
    }
    text
}

/// The remedies that occur, in order.
fn different<'a>(all: &[&'a UnobservedRecord]) -> Vec<&'a Remedy> {
    let mut remedies: Vec<&Remedy> = Vec::new();
    for u in all {
        if !remedies.contains(&&u.remedy) {
            remedies.push(&u.remedy);
        }
    }
    remedies
}

/// What hardly shows.
pub(super) fn weak(named: &NamedObservabilityRecord) -> String {
    let mut text = String::new();
    if !named.weak.is_empty() {
        text.push('\n');
        text.push_str(&wrap(
            "Told apart only by a small share of what their parts would show alone:",
        ));
    }
    for w in named.weak.iter().take(WEAKEST) {
        let percent = number(100.0 * w.share);
        text.push_str(&wrap(&format!("- {}: {percent} %.", w.name)));
    }
    if !named.worst_drift.is_empty() {
        text.push('\n');
        text.push_str(&wrap(
            "What is known worst of the drift after the test, scaled to length one, deg/h at 1 g:",
        ));
    }
    for d in named.worst_drift.iter().take(4) {
        text.push_str(&wrap(&format!(
            "- {}: {}.",
            number(d.sigma_deg_per_h),
            d.name
        )));
    }
    text
}

/// The position and the move to add.
pub(super) fn additions(additions: &AdditionsRecord) -> String {
    let aim = match &additions.aim {
        Aim::Unobserved { parameters } => {
            format!("sigma of what is not told so far ({})", few(parameters))
        }
        Aim::Criterion => "the criterion".to_owned(),
    };
    let tried = additions.examined;
    let found = [&additions.position, &additions.turn];
    let mut text = match found.into_iter().flatten().any(|a| a.factor > 1.0) {
        true => wrap(&format!(
            "What would help most, rated by {aim}, beside the same time in longer dwells ({tried} \
             tried):"
        )),
        false => wrap(&format!(
            "Rated by {aim}, nothing helps more than the same time in longer dwells ({tried} tried); \
             the best of what does less:"
        )),
    };
    let all = [
        ("the best position", &additions.position, false),
        ("the best move", &additions.turn, true),
    ];
    for (what, addition, is_move) in all {
        let Some(a) = addition else { continue };
        let better = match is_move == additions.move_is_better {
            true => ", the better of both",
            false => "",
        };
        text.push_str(&wrap(&format!("- {}{better}: {}.", by(what, a), a.words)));
    }
    text
}

fn by(what: &str, a: &AdditionRecord) -> String {
    let than_by_time = match a.factor > 1.0 {
        true => format!("{} times smaller by it", number(a.factor)),
        false => format!(
            "{} times larger by it than by the time alone",
            number(1.0 / a.factor)
        ),
    };
    format!(
        "{what} ({than_by_time}; criterion {}, the time alone {})",
        number(a.criterion),
        number(a.criterion_same_time)
    )
}

/// A list of names, cut short.
fn few(names: &[String]) -> String {
    match names.len() {
        n if n > READABLE => format!("{} and {} more", names[..READABLE].join(", "), n - READABLE),
        _ => listed(names),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What does less than longer dwells is not said to help most.
    #[test]
    fn an_addition_is_measured_by_the_time_that_it_takes() {
        for (factor, heading, said) in [
            (1.25, "What would help most", "1.250 times smaller by it;"),
            (
                0.8,
                "nothing helps more than the same time",
                "1.250 times larger by it than by the time alone;",
            ),
        ] {
            let position = serde_json::json!({
                "positions": [], "turn": null, "total_time_s": 1100.0, "criterion": 2.0,
                "criterion_same_time": 1.9, "factor": factor, "helps": [], "words": "hold it",
            });
            let record = serde_json::json!({
                "aim": { "kind": "criterion" }, "position": position, "turn": null,
                "move_is_better": false, "examined": 307,
            });
            let record: AdditionsRecord = serde_json::from_value(record).unwrap();
            let text = additions(&record).replace('\n', " ");
            assert!(text.contains(heading), "{text}");
            assert!(text.contains(said), "{text}");
        }
    }
}
