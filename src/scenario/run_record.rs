//! The events of a scenario so far, for queries by its script and for failure reports.

use std::collections::VecDeque;
use std::sync::Arc;

use parking_lot::Mutex;
use serde_json::{Value, json};

use super::CallError;
use crate::agent::RESCUE_NAME;
use crate::behaviour::is_failure;
use crate::robot::EndReason;
use crate::simulation::{Event, EventKind, Recorder};

const MAX_LINES: usize = 10_000;
const MAX_ENDINGS: usize = 1_000;
/// Number of most recent events kept for failure reports.
const RECENT: usize = 8;

/// The record of a scenario, shared with the simulation's recorder; cheap to clone.
#[derive(Clone, Default)]
pub(super) struct RunRecord(Arc<Mutex<RecordState>>);

#[derive(Default)]
struct RecordState {
    lines: Vec<Line>,
    /// Number of lines beyond `MAX_LINES`.
    missed: usize,
    endings: VecDeque<Ended>,
    recent: VecDeque<String>,
    failed: Option<Ended>,
}

struct Line {
    behaviour: String,
    level: &'static str,
    text: String,
    time: f64,
}

#[derive(Debug, Clone)]
pub(super) struct Ended {
    pub(super) behaviour: String,
    pub(super) reason: String,
    pub(super) text: String,
}

impl RunRecord {
    pub(super) fn recorder(&self) -> Recorder {
        let record = self.clone();
        Recorder::new(move |event| record.0.lock().record(&event))
    }

    /// Forgets earlier endings, when new behaviours start.
    pub(super) fn begin(&self) {
        self.0.lock().endings.clear();
    }

    /// Returns the reason of the last ending of a behaviour; without a name, of any behaviour
    /// except the rescue behaviour, which starts and ends automatically.
    pub(super) fn ended(&self, behaviour: Option<&str>) -> Option<String> {
        let state = self.0.lock();
        let is_meant = |ended: &&Ended| {
            behaviour.map_or(ended.behaviour != RESCUE_NAME, |name| {
                ended.behaviour == name
            })
        };
        let found = state.endings.iter().rev().find(is_meant);
        found.map(|ended| ended.reason.clone())
    }

    pub(super) fn failed(&self) -> Option<Ended> {
        self.0.lock().failed.clone()
    }

    /// Returns the behaviours' log lines that contain this text.
    pub(super) fn lines(&self, text: &str) -> Result<Value, CallError> {
        let state = self.0.lock();
        if state.missed > 0 {
            return Err(CallError::LinesMissed(MAX_LINES));
        }
        let lines = state.lines.iter().filter(|line| line.text.contains(text));
        let object = |line: &Line| {
            json!({"behaviour": line.behaviour, "level": line.level, "text": line.text,
                   "time": line.time})
        };
        Ok(lines.map(object).collect())
    }

    pub(super) fn recent(&self) -> Vec<String> {
        self.0.lock().recent.iter().cloned().collect()
    }
}

impl RecordState {
    fn record(&mut self, event: &Event) {
        let behaviour = event.field("behaviour").unwrap_or_default();
        match event.kind {
            EventKind::Log if self.lines.len() < MAX_LINES => self.lines.push(Line {
                behaviour: behaviour.to_owned(),
                level: event.level,
                text: event.text.clone(),
                time: event.at.as_secs_f64(),
            }),
            EventKind::Log => self.missed += 1,
            EventKind::Ended => self.end(Ended {
                behaviour: behaviour.to_owned(),
                reason: event.field("reason").unwrap_or_default().to_owned(),
                text: event.text.clone(),
            }),
            _ => {}
        }
        if let Some(words) = describe(event, behaviour) {
            if self.recent.len() == RECENT {
                self.recent.pop_front();
            }
            let time = event.at.as_secs_f64();
            self.recent.push_back(format!("{time:8.2} s  {words}"));
        }
    }

    fn end(&mut self, ended: Ended) {
        let reason = EndReason::ALL.iter().find(|one| one.name() == ended.reason);
        if self.failed.is_none() && reason.is_some_and(|reason| is_failure(*reason)) {
            self.failed = Some(ended.clone());
        }
        if self.endings.len() == MAX_ENDINGS {
            self.endings.pop_front();
        }
        self.endings.push_back(ended);
    }
}

/// Describes an event in one line; `None` for routine events.
fn describe(event: &Event, behaviour: &str) -> Option<String> {
    let text = event.text.lines().next().unwrap_or_default();
    match event.kind {
        EventKind::Heard if text.starts_with("Login") => None,
        EventKind::Heard => Some(format!("the robot receives {text}")),
        EventKind::Said if text.starts_with("Power") || text.starts_with("Accepted") => None,
        EventKind::Said => Some(format!("the robot reports {text}")),
        EventKind::Log => Some(format!("{behaviour}: {text}")),
        EventKind::Ended => Some(format!("{behaviour} ends: {text}")),
        EventKind::Safety | EventKind::Note => Some(text.to_owned()),
        EventKind::End => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use std::time::Duration;

    #[test]
    fn too_many_lines_give_an_error_instead_of_a_wrong_count() {
        let record = RunRecord::default();
        let mut event = Event {
            at: Duration::ZERO,
            kind: EventKind::Log,
            level: "info",
            text: "alarm".to_owned(),
            fields: BTreeMap::new(),
        };
        for _ in 0..MAX_LINES {
            record.0.lock().record(&event);
        }
        let lines = record.lines("alarm").unwrap();
        assert_eq!(lines.as_array().unwrap().len(), MAX_LINES);
        event.text = "one more".to_owned();
        record.0.lock().record(&event);
        let error = record.lines("alarm").unwrap_err();
        assert!(
            matches!(error, CallError::LinesMissed(MAX_LINES)),
            "{error}"
        );
    }
}
