//! Combines the journal's records: runs with start and end, spans without a link.

use std::collections::{BTreeMap, BTreeSet};

use jiff::Timestamp;

use crate::journal::Record;

/// While its link is up, a session records the battery level each minute. Two levels that are
/// further apart than this, in seconds, have a gap between them.
pub(super) const MAX_GAP: i64 = 200;

/// A behaviour from its start to its end.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Run {
    /// The number of its agent's session.
    pub(super) session: i64,
    pub(super) behaviour: String,
    pub(super) began: Option<Timestamp>,
    /// `None` if it is still running or its agent was killed.
    pub(super) ended: Option<Timestamp>,
    /// The running time recorded by the agent.
    pub(super) seconds: Option<f64>,
    /// Why it ended; empty if unknown.
    pub(super) reason: String,
    pub(super) message: String,
}

impl Run {
    /// How long it ran, in whole seconds. Prefers the recorded running time over the difference of
    /// the timestamps: the clock may have been set in between.
    pub(super) fn lasted(&self) -> Option<i64> {
        let own = self.seconds.map(|seconds| seconds.round() as i64);
        let shown = self.began.zip(self.ended);
        let shown = shown.map(|(began, ended)| ended.duration_since(began).as_secs().max(0));
        own.or(shown)
    }

    /// Whether it failed.
    pub(super) fn failed(&self) -> bool {
        matches!(self.reason.as_str(), "error" | "cpu" | "memory")
    }
}

/// The runs of `started` and `ended` records, in the order in which they began.
pub(super) fn runs(records: &[Record]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    let mut open: BTreeMap<(i64, String), usize> = BTreeMap::new();
    for record in records {
        let behaviour = record.text("behaviour").to_owned();
        let key = (record.session, behaviour.clone());
        match record.kind() {
            "started" => {
                open.insert(key, runs.len());
                runs.push(Run {
                    session: record.session,
                    behaviour,
                    began: Some(record.at),
                    ended: None,
                    seconds: None,
                    reason: String::new(),
                    message: String::new(),
                });
            }
            "ended" => {
                let at = open.remove(&key).unwrap_or_else(|| {
                    runs.push(Run {
                        session: record.session,
                        behaviour,
                        began: None,
                        ended: None,
                        seconds: None,
                        reason: String::new(),
                        message: String::new(),
                    });
                    runs.len() - 1
                });
                let run = &mut runs[at];
                run.ended = Some(record.at);
                run.seconds = record.number("seconds");
                run.reason = record.text("reason").to_owned();
                run.message = record.text("message").to_owned();
            }
            _ => {}
        }
    }
    runs
}

/// A battery level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Level {
    pub(super) at: Timestamp,
    pub(super) percent: f64,
    pub(super) charging: bool,
}

/// A docking or an alarm.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Mark {
    pub(super) at: Timestamp,
    /// Whether a docking succeeded.
    pub(super) good: bool,
    /// Whether this is an alarm of the watchdog.
    pub(super) alarm: bool,
}

/// The contents of a chart.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Story {
    pub(super) since: Timestamp,
    pub(super) until: Timestamp,
    /// The robots in the records.
    pub(super) robots: Vec<String>,
    pub(super) levels: Vec<Level>,
    pub(super) marks: Vec<Mark>,
    pub(super) runs: Vec<Run>,
    /// Spans without a link, after one was lost.
    pub(super) offline: Vec<(Timestamp, Timestamp)>,
}

impl Story {
    pub(super) fn of(
        (since, until): (Timestamp, Timestamp),
        battery: &[Record],
        events: &[Record],
    ) -> Story {
        let mut robots: Vec<String> = battery.iter().filter_map(|one| one.robot.clone()).collect();
        robots.sort();
        robots.dedup();
        let level = |one: &Record| Level {
            at: one.at,
            percent: one.number("percent").unwrap_or(0.0),
            charging: one.is("charging"),
        };
        Story {
            since,
            until,
            robots,
            levels: battery.iter().map(level).collect(),
            marks: events.iter().filter_map(mark).collect(),
            runs: drawn(runs(events), until, battery, events),
            offline: offline(events, until),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.levels.is_empty() && self.marks.is_empty() && self.runs.is_empty()
    }
}

/// The runs as they are drawn: a run without an end, whose session has recorded nothing more, ends
/// with the last record of its session. Its agent was killed, or its time is that of a simulation.
fn drawn(mut runs: Vec<Run>, until: Timestamp, battery: &[Record], events: &[Record]) -> Vec<Run> {
    let mut last: BTreeMap<i64, Timestamp> = BTreeMap::new();
    for record in battery.iter().chain(events) {
        let at = last.entry(record.session).or_insert(record.at);
        *at = record.at.max(*at);
    }
    // Without a link nothing is recorded although the behaviours go on.
    let mut offline: BTreeSet<i64> = BTreeSet::new();
    for record in events {
        match record.kind() {
            "link_down" => offline.insert(record.session),
            "link_up" => offline.remove(&record.session),
            _ => false,
        };
    }
    for run in runs.iter_mut().filter(|run| run.ended.is_none()) {
        let last = last.get(&run.session).copied();
        run.ended = last.filter(|last| {
            let is_over = until.duration_since(*last).as_secs() > MAX_GAP;
            is_over && !offline.contains(&run.session)
        });
    }
    runs
}

fn mark(record: &Record) -> Option<Mark> {
    let at = record.at;
    match record.kind() {
        "dock" => {
            let good = matches!(record.text("end"), "done" | "already_docked");
            let given_up = matches!(
                record.text("end"),
                "cancelled" | "preempted" | "disconnected"
            );
            (!given_up).then_some(Mark {
                at,
                good,
                alarm: false,
            })
        }
        "safety" if record.text("action") == "alarm" => Some(Mark {
            at,
            good: false,
            alarm: true,
        }),
        _ => None,
    }
}

fn offline(events: &[Record], until: Timestamp) -> Vec<(Timestamp, Timestamp)> {
    let (mut spans, mut since) = (Vec::new(), None);
    for record in events {
        match record.kind() {
            "link_down" => since = since.or(Some(record.at)),
            "link_up" => spans.extend(since.take().map(|since| (since, record.at))),
            _ => {}
        }
    }
    spans.extend(since.map(|since| (since, until)));
    spans
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use serde_json::json;

    pub(in crate::cli::history) fn record(seconds: i64, data: serde_json::Value) -> Record {
        Record {
            at: Timestamp::from_second(1_790_000_000 + seconds).unwrap(),
            session: 1,
            robot: Some("SPYKEE0001".to_owned()),
            data: data.as_object().unwrap().clone(),
        }
    }

    #[test]
    fn starts_and_ends_make_runs_and_a_killed_run_has_no_end() {
        let records = [
            record(0, json!({"event": "started", "behaviour": "patrol"})),
            record(1, json!({"event": "started", "behaviour": "guard"})),
            record(
                5,
                json!({"event": "ended", "behaviour": "guard", "reason": "error", "message": "guard.lua:3: no"}),
            ),
            record(6, json!({"event": "started", "behaviour": "guard"})),
            record(
                9,
                json!({"event": "ended", "behaviour": "patrol", "reason": "done"}),
            ),
        ];
        let runs = runs(&records);
        let summary: Vec<_> = runs
            .iter()
            .map(|run| {
                (
                    run.behaviour.as_str(),
                    run.reason.as_str(),
                    run.ended.is_some(),
                )
            })
            .collect();
        let expected = [
            ("patrol", "done", true),
            ("guard", "error", true),
            ("guard", "", false),
        ];
        assert_eq!(summary, expected);
        assert!(runs[1].failed() && !runs[0].failed());
        assert_eq!(
            super::runs(&records[2..3])[0].began,
            None,
            "it began before"
        );
    }

    #[test]
    fn a_run_without_an_end_is_drawn_up_to_the_last_record_of_its_session() {
        let at = |seconds| record(seconds, json!({})).at;
        let battery = [
            record(60, json!({"event": "battery", "percent": 80})),
            record(600, json!({"event": "battery", "percent": 79})),
        ];
        let mut events = vec![
            record(0, json!({"event": "link_up"})),
            record(1, json!({"event": "started", "behaviour": "patrol"})),
        ];
        let ended = |until: i64, events: &[Record]| {
            let story = Story::of((at(0), at(until)), &battery, events);
            story.runs[0].ended
        };
        assert_eq!(ended(100_000, &events), Some(at(600)), "nothing came later");
        assert_eq!(ended(660, &events), None, "it goes on");
        events.push(record(610, json!({"event": "link_down", "reason": "gone"})));
        assert_eq!(ended(100_000, &events), None, "nothing can come");
        let other = Record {
            session: 2,
            ..record(620, json!({"event": "link_up"}))
        };
        events.push(other);
        assert_eq!(ended(100_000, &events), None, "it is another session's");
        let end = json!({"event": "ended", "behaviour": "patrol", "reason": "done"});
        events.push(record(700, end));
        assert_eq!(ended(100_000, &events), Some(at(700)));
    }

    #[test]
    fn spans_without_a_link_end_with_the_next_link_or_with_the_picture() {
        let down = |at| record(at, json!({"event": "link_down", "reason": "gone"}));
        let up = |at| record(at, json!({"event": "link_up"}));
        let until = record(100, json!({})).at;
        let spans = offline(&[up(0), down(10), down(11), up(20), down(90)], until);
        let lengths: Vec<i64> = spans
            .iter()
            .map(|(from, to)| to.duration_since(*from).as_secs())
            .collect();
        assert_eq!(lengths, [10, 10]);
    }
}
