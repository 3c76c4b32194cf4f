//! The commands that an agent accepts from its broker, and its answers.

use serde::{Deserialize, Serialize};

use crate::agent::Change;
use crate::control::{RunRequest, RunResponse};
use crate::timetable::TimetableChange;
use crate::wire::Sound;

const LONGEST: usize = 1024;
/// Maximum length of the name of a chosen behaviour, in bytes.
const LONGEST_CHOICE: usize = 256;

/// One command. Its text is a word (`stop`, `run patrol`), or JSON with an `id` that is returned in
/// the answer: `{"command": "run patrol", "id": "7"}`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BrokerCommand {
    pub command: String,
    pub id: Option<String>,
}

impl BrokerCommand {
    pub fn parse(payload: &[u8]) -> Result<BrokerCommand, String> {
        let text = text(payload, LONGEST)?;
        let mut read = BrokerCommand {
            command: text.to_owned(),
            id: None,
        };
        if text.starts_with('{') {
            read = serde_json::from_str(text).map_err(|error| {
                format!(
                    "it is not a command in JSON ({error}), such as {{\"command\": \"stop\", \"id\": \"1\"}}"
                )
            })?;
            read.command = read.command.trim().to_owned();
        }
        read.request("").map(|_| read)
    }

    /// The request to the run; `start` starts the `chosen` behaviour.
    pub(super) fn request(&self, chosen: &str) -> Result<RunRequest, String> {
        let start = |name: &str| RunRequest::Behaviour {
            name: name.to_owned(),
            change: Change::Start,
            lasts: None,
        };
        let timetable = |change, until: Option<&str>| RunRequest::Timetable {
            change,
            until: until.map(str::to_owned),
            start: None,
        };
        Ok(match self.command.as_str() {
            "start" => start(chosen),
            "skip" => timetable(TimetableChange::Skip, None),
            "unskip" => timetable(TimetableChange::Unskip, None),
            "resume" => timetable(TimetableChange::Resume, None),
            "stop" => RunRequest::Stop,
            "reset_stop" => RunRequest::ResetStop,
            "return_to_base" | "dock" => RunRequest::Dock {
                seconds: None,
                retries: None,
            },
            "undock" => RunRequest::Undock { seconds: None },
            "locate" => RunRequest::Play {
                sound: Sound::Laser,
            },
            "snapshot" => RunRequest::Picture { seconds: None },
            other => match other
                .split_once(' ')
                .map(|(word, rest)| (word, rest.trim()))
            {
                Some(("run", name)) if !name.is_empty() => start(name),
                Some(("pause", until)) => timetable(TimetableChange::Pause, Some(until)),
                _ => {
                    return Err(format!(
                        "`{other}` is not a command; the commands are start, stop, reset_stop, \
                         return_to_base, dock, undock, locate, snapshot, run NAME, skip, unskip, \
                         pause TIME and resume"
                    ));
                }
            },
        })
    }
}

/// Parses the choice of the behaviour that `start` starts.
pub(super) fn parse_choice(payload: &[u8]) -> Result<&str, String> {
    text(payload, LONGEST_CHOICE)
}

fn text(payload: &[u8], longest: usize) -> Result<&str, String> {
    if payload.len() > longest {
        return Err("it is longer than any valid command".to_owned());
    }
    let text = std::str::from_utf8(payload).map_err(|_| "it is not UTF-8 text")?;
    Ok(text.trim())
}

/// The result of a command.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CommandResult {
    #[serde(flatten)]
    pub command: BrokerCommand,
    pub done: bool,
    /// How it ended, or why it was not executed.
    pub text: Option<String>,
}

impl CommandResult {
    pub(super) fn new(command: BrokerCommand, response: &RunResponse) -> CommandResult {
        let end = response.dock_end();
        let end = end.map(|end| end.name().replace('_', " "));
        let error = response.error();
        CommandResult {
            command,
            done: error.is_none(),
            text: match response {
                RunResponse::Stopped { outcome, .. } => Some(outcome.to_string()),
                _ => end.or(error),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn words_and_json_are_orders() {
        let parse = |text: &str| BrokerCommand::parse(text.as_bytes()).unwrap();
        let request = |text: &str| parse(text).request("guard").unwrap();
        assert_eq!(request(" stop\n"), RunRequest::Stop);
        assert_eq!(request("return_to_base"), request("dock"));
        assert_eq!(request("start"), request("run guard"));
        let pause = RunRequest::Timetable {
            change: TimetableChange::Pause,
            until: Some("2026-05-04 18:00".to_owned()),
            start: None,
        };
        assert_eq!(request("pause 2026-05-04 18:00"), pause);
        let command = parse("run patrol");
        assert_eq!(command.id, None);
        let numbered = parse(r#"{"command": " run patrol ", "id": "7"}"#);
        assert_eq!(
            (numbered.command, numbered.id),
            (command.command, Some("7".to_owned()))
        );
    }

    #[test]
    fn an_invalid_order_is_refused_with_an_explanation() {
        let refused = |bytes: &[u8]| BrokerCommand::parse(bytes).unwrap_err();
        assert!(refused(b"fly").contains("return_to_base"));
        assert!(refused(b"run ").contains("not a command"));
        assert!(refused(b"{\"id\": \"7\"}").contains("command"));
        assert!(refused(&[0xff]).contains("not UTF-8"));
        assert!(refused(&[b'a'; 2000]).contains("longer"));
    }

    proptest! {
        #[test]
        fn no_payload_causes_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = BrokerCommand::parse(&bytes);
        }
    }
}
