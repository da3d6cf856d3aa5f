// What every input must stand: no panic, and what is accepted is what it says it is. Shared by the
// fuzz targets and by the short run in the tests.

use scheme_opt::internals::config::{StudyConfig, StudySource};
use scheme_opt::internals::schedule::Schedule;
use scheme_opt::internals::schedule::file::{from_csv, from_json, to_csv, to_json};

/// Reads a platform file; true when it is accepted.
pub fn platform_toml(text: &str) -> bool {
    let Ok(source) = StudySource::parse(text, None) else {
        return false;
    };
    let Ok(study) = source.check() else {
        return false;
    };
    let json = serde_json::to_string(study.config()).expect("a configuration is JSON");
    let again: StudyConfig = serde_json::from_str(&json).expect("and reads back");
    assert_eq!(&again, study.config());
    true
}

/// Reads a JSON schedule; true when it is accepted.
pub fn schedule_json(text: &str) -> bool {
    from_json(text).is_ok_and(|schedule| survives_writing(&schedule))
}

/// Reads a CSV schedule; true when it is accepted.
pub fn schedule_csv(text: &str) -> bool {
    from_csv(text).is_ok_and(|schedule| survives_writing(&schedule))
}

/// Written in either form, a schedule reads back the same.
fn survives_writing(schedule: &Schedule) -> bool {
    let json = to_json(schedule);
    let read = from_json(&json).expect("what was written");
    assert_eq!(to_json(&read), json);
    assert_eq!(from_csv(&to_csv(schedule)).expect("what was written"), read);
    true
}
