//! Scripts that drive no robot but try behaviours: in place of `robot` they have a stage that they
//! ask. Same VM, same walls, same clock.

use serde_json::Value;

use super::failure::SourceLocation;

/// What is wrong with a call, for the script's author.
pub type StageError = Box<dyn std::error::Error>;

/// What a scenario's script asks, by way of `scenario`, `expect` and `sim`.
pub trait Stage {
    /// Answers one call at once: its name, such as `sim:place`, its arguments as plain data, and the
    /// script's line.
    ///
    /// # Errors
    /// What is wrong with the call, for the script's author; it becomes an error of that line.
    fn ask(
        &self,
        call: &str,
        arguments: &[Value],
        place: Option<SourceLocation>,
    ) -> Result<Value, StageError>;
}
