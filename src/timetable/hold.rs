//! What people have changed of the timetable until further notice: a start that is left out once, and
//! a time before which nothing starts.

use jiff::{SignedDuration, Timestamp};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::sync::oneshot;

use super::pattern::TimetableError;
use super::rule::NextStart;
use crate::clock::{self, Date, Zone};

/// What a person changes of the timetable.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
pub enum TimetableChange {
    /// Leave out the next start, once.
    Skip,
    /// Do not leave it out after all.
    Unskip,
    /// Start nothing until a time.
    Pause,
    /// End the pause early.
    Resume,
}

/// A change for a service, and where its answer goes: an error says why nothing has changed, or why
/// the next program does not know it.
#[derive(Debug)]
pub struct TimetableOrder {
    pub change: TimetableChange,
    pub until: Option<String>,
    pub start: Option<Timestamp>,
    /// Who changes it, for the journal.
    pub by: String,
    pub answer: oneshot::Sender<Result<(), String>>,
}

#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Hold {
    /// Nothing starts before this time.
    pub paused: Option<Timestamp>,
    /// The start that is left out.
    skipped: Option<NextStart>,
}

impl Hold {
    /// See [`Planner::change`](super::Planner::change).
    pub(super) fn change(
        &mut self,
        order: &TimetableOrder,
        next: Option<NextStart>,
        now: Timestamp,
        zone: &Zone,
    ) -> Result<Option<String>, TimetableError> {
        let until = order.until.as_deref();
        if until.is_some() != (order.change == TimetableChange::Pause) {
            return Err(TimetableError::Until);
        }
        let before = self.clone();
        let words = |at: Timestamp| clock::describe(&zone.time(at));
        let text = match order.change {
            TimetableChange::Pause => {
                let until = time(until.unwrap_or_default(), zone)?;
                if until <= now {
                    return Err(TimetableError::Past(words(until)));
                }
                self.paused = Some(until);
                format!("nothing starts until {}", words(until))
            }
            TimetableChange::Resume => {
                self.paused = None;
                "the pause is over".to_owned()
            }
            TimetableChange::Skip => {
                let next = next.ok_or(TimetableError::NoStart)?;
                let name = format!("{} on {}", next.behaviour, words(next.at));
                if order.start.is_some_and(|start| start != next.at) {
                    return Err(TimetableError::OtherStart(name));
                }
                self.skipped = Some(NextStart {
                    skipped: true,
                    ..next
                });
                format!("{name} is left out")
            }
            TimetableChange::Unskip => {
                self.skipped = None;
                "the next start is not left out".to_owned()
            }
        };
        Ok(if *self == before { None } else { Some(text) })
    }

    /// The time from which to look for the next start: `from`, or the end of the pause.
    pub(super) fn first_after(&self, from: Timestamp) -> Timestamp {
        // A start at the very end of the pause takes place.
        let end = |until: Timestamp| until.saturating_sub(SignedDuration::from_secs(1));
        let end = self.paused.and_then(|until| end(until).ok());
        end.map_or(from, |end| end.max(from))
    }

    /// A planned start, with whether it is left out.
    pub(super) fn shown(&self, at: Timestamp, run: &str) -> NextStart {
        let mut start = NextStart {
            // Whole seconds.
            at: Timestamp::from_second(at.as_second()).unwrap_or(at),
            behaviour: run.to_owned(),
            skipped: true,
        };
        start.skipped = self.skipped.as_ref() == Some(&start);
        start
    }

    /// Forgets what is over.
    pub(super) fn expire(&mut self, now: Timestamp) {
        self.paused = self.paused.filter(|until| now < *until);
        self.skipped.take_if(|start| start.at <= now);
    }
}

/// A time with its offset from UTC, or in this zone; in whole seconds.
fn time(text: &str, zone: &Zone) -> Result<Timestamp, TimetableError> {
    let text = text.trim();
    let local = || text.parse().map(|date: Date| date.at(zone));
    let time = text.parse::<Timestamp>().or_else(|_| local());
    let time = time.map_err(|_| TimetableError::NoTime(text.chars().take(40).collect()))?;
    Ok(Timestamp::from_second(time.as_second()).unwrap_or(time))
}
