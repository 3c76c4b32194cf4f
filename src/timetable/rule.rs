//! The timetable of the config.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Pattern, Quiet};
use crate::clock::{Span, Zone};

/// One rule of the timetable.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    /// The behaviour, by its name.
    pub run: String,
    /// The start times: minute, hour, day of the month, month, day of the week.
    #[schemars(with = "String")]
    pub at: Pattern,
    /// The longest run, such as `30m`, or a number of seconds [default: until it ends on its own].
    #[serde(rename = "for", default, skip_serializing_if = "Option::is_none")]
    pub lasts: Option<Span>,
}

/// All rules, and the settings that apply to them.
#[derive(Debug, Clone, PartialEq)]
pub struct Timetable {
    /// In the order of the config.
    pub rules: Vec<Rule>,
    /// The time zone of all times.
    pub zone: Zone,
    /// The quiet hours.
    pub quiet: Option<Quiet>,
    /// A start that was missed by at most this is made up for.
    pub catch_up: Span,
}
