//! Scripts that drive no robot but try behaviours: in place of `robot` they have a stage that they
//! ask. Same VM, same walls, same clock.

use std::rc::Rc;

use serde_json::Value;
use tokio::time::Instant;

use super::failure::{Failure, Place};
use super::options::Options;
use super::{Script, api};

/// What a scenario's script asks, by way of `scenario`, `expect` and `sim`.
pub trait Stage {
    /// Answers one call at once: its name, such as `sim:place`, its arguments as plain data, and the
    /// script's line.
    ///
    /// # Errors
    /// What is wrong with the call, for the script's author; it becomes an error of that line.
    fn ask(&self, call: &str, arguments: &[Value], place: Option<Place>) -> Result<Value, String>;
}

/// Answers nothing: for those who only want to know which names there are.
struct Empty;

impl Stage for Empty {
    fn ask(&self, call: &str, _: &[Value], _: Option<Place>) -> Result<Value, String> {
        Err(format!("{call} is not possible here"))
    }
}

impl Script {
    /// Loads a script that has `scenario`, `expect` and `sim`, and of the usual names `task`, `log`,
    /// `script`, `print` and `require`.
    ///
    /// # Errors
    /// As of [`Script::load`].
    pub fn on_stage(
        source: &[u8],
        options: Options,
        stage: Rc<dyn Stage>,
        now: Instant,
    ) -> Result<Script, Failure> {
        Script::load_with(source, options, api::Surroundings::Stage(stage), now)
    }

    /// Such a script with nothing in it and nobody to ask.
    pub(crate) fn on_empty_stage(options: Options, now: Instant) -> Result<Script, Failure> {
        Script::on_stage(b"", options, Rc::new(Empty), now)
    }
}
