//! Scripts that drive no robot but try behaviours: in place of `robot` they have a stage that they
//! ask. Same VM, same walls, same clock.

use serde_json::Value;

use super::failure::SourceLocation;

/// What is wrong with a call, for the script's author.
pub type StageError = Box<dyn std::error::Error>;

/// What a stage answers, as plain data.
pub type StageAnswer = Result<Value, StageError>;

/// One call of the script.
#[derive(Debug, Clone, Copy)]
pub struct StageCall<'a> {
    /// Its name, such as `sim:place`.
    pub name: &'a str,
    /// As plain data.
    pub arguments: &'a [Value],
    /// The script's line.
    pub place: Option<&'a SourceLocation>,
}

/// What a scenario's script asks, by way of `scenario`, `expect` and `sim`.
pub trait Stage {
    /// Answers one call at once.
    ///
    /// # Errors
    /// What is wrong with the call, for the script's author; it becomes an error of that line.
    fn answer(&self, call: StageCall<'_>) -> StageAnswer;
}
