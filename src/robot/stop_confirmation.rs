//! What is known of a person's STOP: whether the robot has executed it, and whether it will hold in
//! the next program.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Why something does not start while a person's STOP holds, and what to do.
pub const STOP_HOLDS: &str = "a person's STOP holds: release it with *Let it move again* at the page, or with `spykee robot \
     reset-stop`";

/// How far a person's STOP, or the last stop of a robot that was driving, has come.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StopConfirmation {
    /// There is no stop to confirm.
    #[default]
    None,
    /// It was sent; the answer of the robot's program is awaited.
    Sending,
    /// The robot's program has executed it.
    Executed,
    /// The robot's system has acknowledged it; its program does not say what it executed.
    Acknowledged,
    /// The robot is out of reach, or does not answer: it may be driving.
    NotConfirmed,
}

impl std::fmt::Display for StopConfirmation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            StopConfirmation::None => "STOP holds",
            StopConfirmation::Sending => "the stop is being sent",
            StopConfirmation::Executed => "the robot has executed the stop",
            StopConfirmation::Acknowledged => {
                "the robot's system has acknowledged the stop; its program does not say whether it \
                 executed it"
            }
            StopConfirmation::NotConfirmed => {
                "NOT CONFIRMED: the robot is out of reach; the agent keeps trying. Switch it off by \
                 hand if it drives"
            }
        })
    }
}

/// Whether a STOP will hold in the next program, too.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kept", rename_all = "snake_case")]
pub enum StopKept {
    /// It will, until a person releases it.
    Yes,
    /// A simulation's: it ends with its program.
    WithProgram,
    /// The disk has not answered in time. STOP holds in this program.
    NotYet,
    /// It holds in this program only.
    No {
        /// The reason.
        why: String,
    },
}

impl StopKept {
    /// A warning for people; `None` if all is well.
    pub fn warning(&self) -> Option<String> {
        match self {
            StopKept::Yes | StopKept::WithProgram => None,
            StopKept::NotYet => Some(
                "STOP holds in this program; it is not kept for the next one yet: the disk does not \
                 answer"
                    .to_owned(),
            ),
            StopKept::No { why } => Some(format!(
                "STOP holds in this program, but NOT in the next one: {why}"
            )),
        }
    }
}

/// What the one who pressed STOP is told.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StopOutcome {
    /// What is known of the robot.
    #[serde(rename = "stop_confirmation")]
    pub confirmation: StopConfirmation,
    /// Whether the next program will hold it too.
    #[serde(flatten)]
    pub kept: StopKept,
}

impl std::fmt::Display for StopOutcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.confirmation)?;
        match self.kept.warning() {
            Some(warning) => write!(f, ". {warning}"),
            None => Ok(()),
        }
    }
}
