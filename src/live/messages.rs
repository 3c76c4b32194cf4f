//! The messages between page and server over the WebSocket: one JSON object per message. Frames of
//! the camera are binary: four bytes number, four bytes age in milliseconds, both big-endian, then
//! the JPEG as received from the robot.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::broadcast::State;
use super::log::Line;
use super::scripts::Behaviour;
use super::world::{Map, WorldPlan};
use crate::control::RunRequest;
use crate::http::Role;
use crate::robot::Detection;

/// From the page.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum FromPage {
    /// What the page shows now. Only that is sent.
    Watch(Watch),
    /// The last frame was shown; requests the next one.
    FrameShown,
    /// Sets the name of this viewer.
    Name {
        /// At most 24 characters.
        name: String,
    },
    /// Stop the robot and hold it. Every viewer may do this.
    Stop,
    /// Release the stop.
    ResetStop,
    /// Take the drive lock, or release it.
    DriveLock {
        /// True to take it.
        take: bool,
    },
    /// Drive with this power for at most 0.3 s; only for the viewer that has the drive lock.
    Drive {
        /// Percent of full power, -100..=100.
        left: f64,
        /// Percent of full power, -100..=100.
        right: f64,
    },
    /// Execute a command; answered by `answer` with the same number.
    Command {
        /// A number chosen by the page.
        id: u32,
        /// The command.
        command: RunRequest,
    },
}

/// What a page shows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Watch {
    /// The camera's frames.
    pub camera: bool,
    /// The objects that scripts found in the frames.
    pub found: bool,
    /// The map of a simulation.
    pub map: bool,
    /// The log.
    pub log: bool,
}

/// To the page.
#[derive(Debug, Clone, Serialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(super) enum ToPage<'a> {
    /// The first message: the viewer and the run.
    Hello {
        /// The program's version.
        version: &'static str,
        /// The viewer's number.
        you: u32,
        /// The viewer's role.
        role: Role,
        /// Whether there is a simulated world.
        world: bool,
        /// Whether the config allows the camera.
        camera: bool,
    },
    /// Sent twice a second, so that the page knows that it is connected, and how late messages
    /// arrive.
    Heartbeat {
        /// Since the connection was opened, by the server's clock.
        milliseconds: u64,
    },
    /// The state of the run.
    State(&'a State),
    /// The history of the battery: seconds before now, percent or null, charging.
    Battery {
        /// Oldest first.
        points: Vec<(f32, Option<u8>, bool)>,
    },
    /// The fixed parts of the simulated world.
    World(&'a WorldPlan),
    /// The moving parts of the simulated world.
    Map(&'a Map),
    /// Lines of the log, oldest first.
    Log {
        /// The lines.
        lines: Vec<Line>,
        /// The number of lines before them that were not sent, because the viewer was too slow.
        missed: u64,
    },
    /// The behaviours.
    Behaviours {
        /// The behaviours, in the order of the run.
        list: Vec<Behaviour>,
    },
    /// The objects that a script found in a frame.
    Found {
        /// The behaviour.
        behaviour: String,
        /// The frame's number.
        frame: u64,
        /// The objects found.
        marks: Vec<Detection>,
    },
    /// The result of a command.
    Answer {
        /// The number of the command.
        id: u32,
        /// Whether it was executed.
        ok: bool,
        /// The reason or result in words; may be empty.
        text: String,
    },
    /// A message for this viewer only, such as that another viewer has the drive lock.
    Notice {
        /// A key of the page's texts.
        key: &'static str,
        /// A name to insert into the text.
        name: String,
    },
}

/// Returns the JSON Schema of all messages, for the page and for other clients.
pub fn schema() -> Value {
    json!({
        "from_page": schemars::schema_for!(FromPage),
        "to_page": schemars::schema_for!(ToPage<'static>),
    })
}

/// Parses a message of a page and serialises it again.
pub fn understood(text: &str) -> serde_json::Result<String> {
    serde_json::to_string(&serde_json::from_str::<FromPage>(text)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_message_with_unknown_or_missing_fields_is_refused() {
        let read = |text: &str| serde_json::from_str::<FromPage>(text);
        assert_eq!(read("{\"type\":\"stop\"}").unwrap(), FromPage::Stop);
        let watch = Watch {
            camera: true,
            ..Watch::default()
        };
        assert_eq!(
            read("{\"type\":\"watch\",\"camera\":true}").unwrap(),
            FromPage::Watch(watch)
        );
        for wrong in [
            "",
            "{}",
            "[]",
            "{\"type\":\"go\"}",
            "{\"type\":\"drive\",\"left\":1}",
            "{\"type\":\"drive_lock\",\"take\":true,\"x\":1}",
            "{\"type\":\"drive\",\"left\":\"1\",\"right\":1}",
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn no_text_causes_a_panic(text in "\\PC{0,200}") {
            let _ = serde_json::from_str::<FromPage>(&text);
        }
    }
}
