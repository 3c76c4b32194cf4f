//! Combines the journal's records to runs with start and end.

use std::collections::BTreeMap;

use jiff::Timestamp;

use crate::journal::Record;

/// A behaviour from its start to its end.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Run {
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
        assert_eq!(
            super::runs(&records[2..3])[0].began,
            None,
            "it began before"
        );
    }
}
