//! Visitors and their roles.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a visitor may do. A viewer may also stop the robot.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Watch, and stop the robot.
    Viewer,
    /// Everything that the page and the API offer.
    Driver,
}

impl Role {
    /// Returns the name of the role.
    pub fn name(self) -> &'static str {
        match self {
            Role::Viewer => "viewer",
            Role::Driver => "driver",
        }
    }
}

/// A visitor with access.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Visitor {
    /// The visitor's role.
    pub role: Role,
    /// The name of the token used, if any.
    pub token: Option<String>,
}
