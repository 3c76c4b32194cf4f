//! What is known of the last stop.

use serde::{Deserialize, Serialize};

/// How far a person's STOP, or the last stop of a robot that was driving, has come.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema,
)]
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
