//! Who asks, and what that is good for.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a visitor may do. One who may look may also stop the robot.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Look, and stop the robot.
    Viewer,
    /// All that the page and the API can do.
    Driver,
}

impl Role {
    /// The word that people use.
    pub fn name(self) -> &'static str {
        match self {
            Role::Viewer => "viewer",
            Role::Driver => "driver",
        }
    }
}

/// A visitor who was let in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Visitor {
    /// What he may do.
    pub role: Role,
    /// The name of the token that he came with, if he did.
    pub token: Option<String>,
}
