//! The config's timetable against its behaviours.

use crate::timetable::Timetable;

/// Describes the first rule of the timetable that names no behaviour of the config, and lists the
/// behaviours that the config has.
pub(super) fn unknown_behaviour(table: &Timetable, names: &[String]) -> Option<(String, String)> {
    let unknown = *table.unknown(names).first()?;
    let what = format!("the timetable runs `{unknown}`, but the config has no such behaviour");
    let known = if names.is_empty() {
        "the config names no behaviours".to_owned()
    } else {
        format!("the config has {}", names.join(", "))
    };
    Some((what, known))
}
