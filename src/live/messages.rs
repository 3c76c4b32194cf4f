//! What page and server say to each other over the WebSocket: one JSON object a message. Frames of the
//! camera are binary: four bytes number, four bytes age in milliseconds, both big-endian, then the JPEG
//! as it came.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::command::PageCommand;
use super::log::Line;
use super::scripts::Behaviour;
use super::state::State;
use super::world::{Map, Place};
use crate::http::Role;
use crate::robot::Finding;

/// From the page.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum FromPage {
    /// What the page shows now; nothing else is sent.
    Watch(Watch),
    /// The last frame was shown: the next, please.
    Taken,
    /// What the others call this viewer.
    Name {
        /// At most 24 characters.
        name: String,
    },
    /// Stop the robot and hold it. Anybody may.
    Stop,
    /// Let go of it.
    LetGo,
    /// Take the wheel, or leave it.
    Wheel {
        /// Take it.
        take: bool,
    },
    /// Drive so for 0.3 s at most; for the viewer that has the wheel.
    Drive {
        /// Percent of full power, -100..=100.
        left: f64,
        /// Percent of full power, -100..=100.
        right: f64,
    },
    /// Do something; answered by `answer` with the same number.
    Order {
        /// Counts up.
        id: u32,
        /// What.
        order: PageCommand,
    },
}

/// What a page shows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Watch {
    /// The camera's frames.
    pub camera: bool,
    /// What scripts found in them.
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
    /// The first message.
    Hello(Hello),
    /// How things stand.
    State(&'a State),
    /// The battery so far: seconds before now, percent, charging.
    Battery {
        /// Oldest first.
        points: Vec<(f32, u8, bool)>,
    },
    /// The simulated world as it is at first.
    World(&'a Place),
    /// What moves in it.
    Map(&'a Map),
    /// Lines of the log, oldest first.
    Log {
        /// These.
        lines: Vec<Line>,
        /// So many before them were not sent: the viewer was too slow.
        missed: u64,
    },
    /// The behaviours.
    Behaviours {
        /// In the order of the run.
        list: Vec<Behaviour>,
    },
    /// What a script found in a frame.
    Found {
        /// Which behaviour.
        behaviour: String,
        /// The frame's number.
        frame: u64,
        /// The things.
        marks: Vec<Found>,
    },
    /// What became of an order.
    Answer {
        /// That of the order.
        id: u32,
        /// It was done.
        ok: bool,
        /// In words, if there is something to say.
        text: String,
    },
    /// Something that only this viewer is told, such as that another viewer has the wheel.
    Notice {
        /// A key of the page's texts.
        key: &'static str,
        /// Goes into the text.
        name: String,
    },
}

/// Who looks at what.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub(super) struct Hello {
    /// Of the program.
    pub version: &'static str,
    /// The viewer's number.
    pub you: u32,
    /// What he may do.
    pub role: Role,
    /// There is a simulated world to see and to change.
    pub world: bool,
    /// The config lets the camera be on.
    pub camera: bool,
}

/// One thing that was found, in pixels of the frame.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Found {
    /// Left edge.
    pub x: u32,
    /// Upper edge.
    pub y: u32,
    /// Width.
    pub w: u32,
    /// Height.
    pub h: u32,
    /// What: the colour's name, the track's id.
    pub text: String,
}

impl From<Finding> for Found {
    fn from(Finding { x, y, w, h, text }: Finding) -> Found {
        Found { x, y, w, h, text }
    }
}

/// The JSON Schema of all messages, for the page and for other clients.
pub fn schema() -> Value {
    json!({
        "from_page": schemars::schema_for!(FromPage),
        "to_page": schemars::schema_for!(ToPage<'static>),
    })
}

/// What a page says with this text, written again as it was understood.
///
/// # Errors
/// If it is no message of a page: the parser's words.
pub fn understood(text: &str) -> serde_json::Result<String> {
    serde_json::to_string(&serde_json::from_str::<FromPage>(text)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_message_with_a_word_too_many_is_refused() {
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
            "{\"type\":\"wheel\",\"take\":true,\"x\":1}",
            "{\"type\":\"drive\",\"left\":\"1\",\"right\":1}",
        ] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "\\PC{0,200}") {
            let _ = serde_json::from_str::<FromPage>(&text);
        }
    }
}
