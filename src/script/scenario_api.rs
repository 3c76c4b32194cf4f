//! The interface of scenario scripts, which do not drive a robot but test behaviours: in place of
//! `robot` they call a scenario API. VM, sandbox and clock are the same.

use serde_json::Value;

use super::failure::SourceLocation;

/// An error in a call, for the script's author.
pub type ScenarioCallError = Box<dyn std::error::Error>;

/// The answer of the scenario API, as plain data.
pub type ScenarioCallResult = Result<Value, ScenarioCallError>;

/// One call of the script.
#[derive(Debug, Clone, Copy)]
pub struct ScenarioCall<'a> {
    /// Its name, such as `sim:location`.
    pub name: &'a str,
    /// As plain data.
    pub arguments: &'a [Value],
    /// The line of the script.
    pub location: Option<&'a SourceLocation>,
}

/// What a scenario script calls through `scenario`, `expect` and `sim`.
pub trait ScenarioApi {
    /// Answers one call at once.
    ///
    /// # Errors
    ///
    /// If the call is wrong, with a message for the script's author; it is raised as an error at
    /// that line.
    fn answer(&self, call: ScenarioCall<'_>) -> ScenarioCallResult;
}
