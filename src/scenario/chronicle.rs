//! What has happened in a scenario so far, as far as its script may ask for it and a failure tells.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde_json::{Value, json};

use super::refusal::CallError;
use crate::agent::RESCUE_NAME;
use crate::behaviour::is_failure;
use crate::lab::{Event, EventKind, Recorder};
use crate::robot::EndReason;

/// Lines of behaviours that are kept.
const MAX_LINES: usize = 10_000;
/// Endings that are kept.
const MAX_ENDINGS: usize = 1_000;
/// What happened last.
const RECENT: usize = 8;

/// Shared with the laboratory's recorder; cheap to clone.
#[derive(Clone, Default)]
pub(super) struct Chronicle(Arc<Mutex<Pages>>);

#[derive(Default)]
struct Pages {
    lines: Vec<Line>,
    /// Lines that were written beyond those.
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

/// How a behaviour ended.
#[derive(Debug, Clone)]
pub(super) struct Ended {
    pub(super) behaviour: String,
    pub(super) reason: String,
    pub(super) text: String,
}

impl Chronicle {
    /// Writes down what it is given.
    pub(super) fn recorder(&self) -> Recorder {
        let chronicle = self.clone();
        Recorder::new(move |event| chronicle.pages().note(&event))
    }

    fn pages(&self) -> MutexGuard<'_, Pages> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Behaviours begin: how those before them ended is no answer any more.
    pub(super) fn begin(&self) {
        self.pages().endings.clear();
    }

    /// How a behaviour ended for the last time, or any but the rescue behaviour, which comes and goes.
    pub(super) fn ended(&self, behaviour: Option<&str>) -> Option<String> {
        let pages = self.pages();
        let is_meant = |ended: &&Ended| {
            behaviour.map_or(ended.behaviour != RESCUE_NAME, |name| {
                ended.behaviour == name
            })
        };
        let found = pages.endings.iter().rev().find(is_meant);
        found.map(|ended| ended.reason.clone())
    }

    /// The first behaviour that failed.
    pub(super) fn failed(&self) -> Option<Ended> {
        self.pages().failed.clone()
    }

    /// What the behaviours wrote that contains this text.
    ///
    /// # Errors
    /// So much was written that not all of it is known: an expectation that counts would be wrong.
    pub(super) fn lines(&self, text: &str) -> Result<Value, CallError> {
        let pages = self.pages();
        if pages.missed > 0 {
            return Err(CallError::LinesMissed(MAX_LINES));
        }
        let lines = pages.lines.iter().filter(|line| line.text.contains(text));
        let object = |line: &Line| {
            json!({"behaviour": line.behaviour, "level": line.level, "text": line.text,
                   "time": line.time})
        };
        Ok(lines.map(object).collect())
    }

    /// What happened last, oldest first.
    pub(super) fn recent(&self) -> Vec<String> {
        self.pages().recent.iter().cloned().collect()
    }
}

impl Pages {
    fn note(&mut self, event: &Event) {
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
        if let Some(words) = words(event, behaviour) {
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

/// An event in one line for people; nothing for what goes on all the time.
fn words(event: &Event, behaviour: &str) -> Option<String> {
    let text = event.text.lines().next().unwrap_or_default();
    match event.kind {
        EventKind::Heard if text.starts_with("Login") => None,
        EventKind::Heard => Some(format!("the robot hears {text}")),
        EventKind::Said if text.starts_with("Power") || text.starts_with("Accepted") => None,
        EventKind::Said => Some(format!("the robot says {text}")),
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
    fn lines_that_are_not_all_kept_are_an_error_and_no_count() {
        let chronicle = Chronicle::default();
        let mut event = Event {
            at: Duration::ZERO,
            kind: EventKind::Log,
            level: "info",
            text: "alarm".to_owned(),
            fields: BTreeMap::new(),
        };
        for _ in 0..MAX_LINES {
            chronicle.pages().note(&event);
        }
        let lines = chronicle.lines("alarm").unwrap();
        assert_eq!(lines.as_array().unwrap().len(), MAX_LINES);
        event.text = "one more".to_owned();
        chronicle.pages().note(&event);
        let error = chronicle.lines("alarm").unwrap_err();
        assert!(
            matches!(error, CallError::LinesMissed(MAX_LINES)),
            "{error}"
        );
    }
}
