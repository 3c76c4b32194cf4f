//! The commands that an agent accepts from its broker, and its answers.

use serde::{Deserialize, Serialize};

/// Maximum length of a command, in bytes.
const LONGEST: usize = 1024;
/// Maximum length of the name of a chosen behaviour, in bytes.
const LONGEST_CHOICE: usize = 256;

/// One command. Its text is a word (`stop`, `run patrol`), or JSON with an `id` that is returned in
/// the answer: `{"command": "run patrol", "id": "7"}`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BrokerCommand {
    /// Start the chosen behaviour.
    Start,
    /// STOP: the robot stands until a person releases it. Also ends all behaviours.
    Stop,
    /// Release STOP.
    ResetStop,
    /// Drive to the station.
    Dock,
    /// Leave the station.
    Undock,
    /// Make a sound.
    Locate,
    /// Take a picture.
    Snapshot,
    /// Start this behaviour.
    Run(String),
    /// Choose the behaviour that `start` starts.
    Choose(String),
}

#[derive(Debug, Serialize, Deserialize)]
struct JsonCommand {
    command: String,
    id: Option<String>,
}

impl BrokerCommand {
    /// Parses a command, with its id if it has one.
    ///
    /// # Errors
    /// Why it is no valid command, in words.
    pub fn parse(payload: &[u8]) -> Result<(BrokerCommand, Option<String>), String> {
        let text = text(payload, LONGEST)?;
        if !text.starts_with('{') {
            return Ok((BrokerCommand::of_words(text)?, None));
        }
        let written: JsonCommand = serde_json::from_str(text).map_err(|error| {
            format!(
                "it is not a command in JSON ({error}), such as {{\"command\": \"stop\", \"id\": \"1\"}}"
            )
        })?;
        Ok((BrokerCommand::of_words(written.command.trim())?, written.id))
    }

    /// Parses the choice of the behaviour that `start` starts.
    pub(super) fn parse_choice(payload: &[u8]) -> Result<BrokerCommand, String> {
        let name = text(payload, LONGEST_CHOICE)?;
        Ok(BrokerCommand::Choose(name.to_owned()))
    }

    fn of_words(words: &str) -> Result<BrokerCommand, String> {
        Ok(match words {
            "start" => BrokerCommand::Start,
            "stop" => BrokerCommand::Stop,
            "reset_stop" => BrokerCommand::ResetStop,
            "return_to_base" | "dock" => BrokerCommand::Dock,
            "undock" => BrokerCommand::Undock,
            "locate" => BrokerCommand::Locate,
            "snapshot" => BrokerCommand::Snapshot,
            other => match other.strip_prefix("run ").map(str::trim) {
                Some(name) if !name.is_empty() => BrokerCommand::Run(name.to_owned()),
                _ => {
                    return Err(format!(
                        "`{other}` is not a command; the commands are start, stop, reset_stop, \
                         return_to_base, dock, undock, locate, snapshot and run NAME"
                    ));
                }
            },
        })
    }

    /// Formats the command as JSON, with an id.
    pub fn to_json(&self, id: &str) -> String {
        let command = self.to_string();
        let id = Some(id.to_owned());
        // Serialising a struct of strings cannot fail.
        serde_json::to_string(&JsonCommand { command, id }).unwrap_or_default()
    }
}

fn text(payload: &[u8], longest: usize) -> Result<&str, String> {
    if payload.len() > longest {
        return Err("it is longer than any valid command".to_owned());
    }
    let text = std::str::from_utf8(payload).map_err(|_| "it is not UTF-8 text")?;
    Ok(text.trim())
}

impl std::fmt::Display for BrokerCommand {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            BrokerCommand::Start => "start",
            BrokerCommand::Stop => "stop",
            BrokerCommand::ResetStop => "reset_stop",
            BrokerCommand::Dock => "return_to_base",
            BrokerCommand::Undock => "undock",
            BrokerCommand::Locate => "locate",
            BrokerCommand::Snapshot => "snapshot",
            BrokerCommand::Run(name) => return write!(f, "run {name}"),
            BrokerCommand::Choose(name) => return write!(f, "choose {name}"),
        })
    }
}

/// The result of a command.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CommandResult {
    /// The command, in words.
    pub command: String,
    /// The id of the command, if it had one.
    pub id: Option<String>,
    /// Whether the command was executed.
    pub done: bool,
    /// How it ended, or why it was not executed.
    pub text: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn words_and_json_are_orders() {
        let parse = |text: &str| BrokerCommand::parse(text.as_bytes());
        assert_eq!(parse(" stop\n"), Ok((BrokerCommand::Stop, None)));
        assert_eq!(parse("return_to_base"), Ok((BrokerCommand::Dock, None)));
        let run = BrokerCommand::Run("patrol".to_owned());
        assert_eq!(parse("run patrol"), Ok((run.clone(), None)));
        assert_eq!(parse(&run.to_json("7")), Ok((run, Some("7".to_owned()))));
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
