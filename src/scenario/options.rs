//! What stands in the second argument of `scenario`.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::arguments::Fields;

/// How a scenario is set up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// A ready world's name, or a file beside the scenario's; the built-in one if there is none.
    pub world: Option<String>,
    /// The battery's level at the start, 0..=100 percent, if not the world's.
    pub battery: Option<f64>,
    /// It is played with the seeds from 1 to this.
    pub seeds: u64,
    /// So much virtual time it may take.
    pub limit: Duration,
    /// What it counts in a lesson.
    pub points: u32,
    /// Frames a second of the robot's camera, if not the world's.
    pub fps: Option<f64>,
    /// A behaviour that fails does not fail the scenario.
    pub may_fail: bool,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            world: None,
            battery: None,
            seeds: 1,
            limit: Duration::from_secs(300),
            points: 1,
            fps: None,
            may_fail: false,
        }
    }
}

impl Options {
    const KEYS: [&str; 7] = [
        "world", "battery", "seeds", "limit", "points", "fps", "may_fail",
    ];

    /// # Errors
    /// An unknown key, with the nearest; a wrong value.
    pub(super) fn of(value: &Value) -> Result<Options, String> {
        let fields = Fields::of(value, "the options", &Options::KEYS)?;
        let default = Options::default();
        let limit = fields.number("limit", 0.1, 30.0 * 86_400.0)?;
        Ok(Options {
            world: fields.text("world")?,
            battery: fields.number("battery", 0.0, 100.0)?,
            seeds: fields.whole("seeds", 1, 10_000)?.unwrap_or(default.seeds),
            limit: limit.map_or(default.limit, Duration::from_secs_f64),
            points: fields
                .whole("points", 0, 1000)?
                .map_or(default.points, |points| points as u32),
            fps: fields.number("fps", 0.1, 30.0)?,
            may_fail: fields.flag("may_fail")?.unwrap_or(default.may_fail),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_is_left_out_is_as_usual_and_an_empty_table_is_nothing() {
        assert_eq!(Options::of(&json!({})).unwrap(), Options::default());
        assert_eq!(Options::of(&json!([])).unwrap(), Options::default());
        assert_eq!(Options::of(&Value::Null).unwrap(), Options::default());
    }

    #[test]
    fn every_mistake_is_named_with_what_would_be_right() {
        for (value, words) in [
            (json!({"batery": 3}), "did you mean 'battery'"),
            (
                json!({"battery": 300}),
                "battery must be between 0 and 100, got 300",
            ),
            (json!({"seeds": 1.5}), "seeds must be a whole number"),
            (
                json!({"seeds": 0}),
                "seeds must be between 1 and 10000, got 0",
            ),
            (
                json!({"limit": "long"}),
                "limit must be a number, got 'long'",
            ),
            (json!({"world": 7}), "world must be a text, got 7"),
            (
                json!({"may_fail": 1}),
                "may_fail must be true or false, got 1",
            ),
            (json!("quick"), "the options must be a table, got 'quick'"),
        ] {
            let error = Options::of(&value).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
    }
}
