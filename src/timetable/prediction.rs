//! Predicts the starts of the timetable, and which will not happen and why.

use jiff::Timestamp;

use super::Timetable;

/// Maximum number of predicted starts.
const MAX_STARTS: usize = 10_000;

/// One future start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PredictedStart {
    /// The time.
    pub at: Timestamp,
    /// The behaviour.
    pub run: String,
    /// When it is ended, if it has not ended on its own.
    pub until: Option<Timestamp>,
    /// Remarks about this start.
    pub reasons: Vec<Reason>,
}

impl PredictedStart {
    /// Whether the behaviour will be started, as far as can be predicted.
    pub fn happens(&self) -> bool {
        self.reasons.iter().all(|reason| *reason == Reason::Quiet)
    }
}

/// A remark about a future start.
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
