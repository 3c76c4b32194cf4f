//! The timetable of the config, its view for display, and the starts that it leads to.

use jiff::Timestamp;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::sync::watch;

use super::{Pattern, Quiet};
use crate::clock::{Span, Zone};

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
    pub quiet: Option<Quiet>,
    /// A start that was missed by at most this is made up for.
    pub catch_up: Span,
}

/// The next start and the quiet hours. Both are unset in a run without a timetable.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct View {
    /// The next start of the timetable: its time and its behaviour.
    pub next: Option<(Timestamp, String)>,
    pub quiet: bool,
}

impl View {
    /// Creates the channel through which a service publishes its view.
    pub fn channel() -> (watch::Sender<View>, watch::Receiver<View>) {
        watch::channel(View::default())
    }
}

const MAX_STARTS: usize = 10_000;

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PredictedStart {
    pub at: Timestamp,
    pub run: String,
    /// When it is ended, if it has not ended on its own.
    pub until: Option<Timestamp>,
    pub reasons: Vec<Reason>,
}

impl PredictedStart {
    /// Whether the behaviour will be started, as far as can be predicted.
    pub fn happens(&self) -> bool {
        self.reasons.iter().all(|reason| *reason == Reason::Quiet)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// It is a quiet hour: no sounds and no headlight.
    Quiet,
    /// It still runs from an earlier start.
    Overlap,
    /// The config has no behaviour of this name.
    Unknown,
}

impl Timetable {
    /// Returns the names in the rules that no behaviour has, in the order of the rules.
    pub fn unknown<'a>(&'a self, known: &[String]) -> Vec<&'a str> {
        let runs = self.rules.iter().map(|rule| rule.run.as_str());
        runs.filter(|run| !known.iter().any(|name| name == run))
            .collect()
    }
}

/// Returns the next starts after an instant, assuming that every run lasts as planned. `known` are
/// the config's behaviours.
pub fn predict_starts(
    table: &Timetable,
    known: &[String],
    after: Timestamp,
    count: usize,
) -> Vec<PredictedStart> {
    let next = |rule: usize, after| table.rules[rule].at.next_after(after, &table.zone);
    let mut due: Vec<Option<Timestamp>> = (0..table.rules.len())
        .map(|rule| next(rule, after))
        .collect();
    let mut found: Vec<PredictedStart> = Vec::new();
    while found.len() < count.min(MAX_STARTS) {
        let soonest = due.iter().enumerate();
        let soonest = soonest.filter_map(|(rule, at)| Some(((*at)?, rule)));
        let Some((at, rule)) = soonest.min() else {
            break;
        };
        due[rule] = next(rule, at);
        let rule = &table.rules[rule];
        let lasts = rule.lasts.map(|lasts| lasts.get());
        let mut reasons = Vec::new();
        if !known.contains(&rule.run) {
            reasons.push(Reason::Unknown);
        }
        let runs = |other: &&PredictedStart| other.run == rule.run && other.happens();
        let last = found.iter().rev().find(runs);
        if last.is_some_and(|last| last.at == at || last.until.is_some_and(|until| until > at)) {
            reasons.push(Reason::Overlap);
        }
        if table
            .quiet
            .is_some_and(|quiet| quiet.covers(at, &table.zone))
        {
            reasons.push(Reason::Quiet);
        }
        found.push(PredictedStart {
            at,
            run: rule.run.clone(),
            until: lasts.and_then(|lasts| at.checked_add(lasts).ok()),
            reasons,
        });
    }
    found
}
