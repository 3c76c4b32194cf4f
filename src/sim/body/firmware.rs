//! Settings for the simulated firmware where the behaviour of the real one is not known
//! (`PROTOCOL.md`, *Not known*), read from YAML; errors name line and column.

use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::document::{self, DocumentError, number};

/// Settings for the unknown parts of the firmware. Where one case is the worst for a client that
/// drives the robot, that case is the default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Firmware {
    /// The tracks stop when the user disconnects. Default: they keep running.
    pub stops_on_disconnect: bool,
    /// The tracks stop when no MOVE has arrived for this long. Default: they keep running.
    #[serde(serialize_with = "some_seconds", deserialize_with = "some_span")]
    pub stops_without_repeat: Option<Duration>,
    /// What a MOVE does while the robot searches for its station.
    pub move_while_searching: FirmwareBehaviour,
    /// What a MOVE does while the robot backs out of its station.
    pub move_while_undocking: FirmwareBehaviour,
    /// ENGINE 1 sent to the robot undocks it, as CHARGE_STOP does. Default: it does nothing.
    pub activate_undocks: bool,
    /// Commands that the robot's program executes per second, one after another in the order in
    /// which they came; an idle program executes one at once. Answers come when the question is
    /// executed; a login is not delayed, nor is what the robot reports by itself. Default: every
    /// command at once.
    ///
    /// What was received is executed even if its connection has ended meanwhile; a question that
    /// it asked then stays without answer. Only a reboot empties the queue.
    #[serde(deserialize_with = "number::commands_per_second")]
    pub commands_per_second: Option<f64>,
    /// Commands that wait at most; when there are more, the robot does not read on, and they stay
    /// in the network's buffers. Only with `commands_per_second`. Default: thousands.
    #[serde(deserialize_with = "some_count")]
    pub queue: Option<usize>,
    /// The robot answers a POWER without payload. Default: it does.
    pub answers_power_query: bool,
    /// The robot sends POWER on every change, and at least this often. Default 5 s.
    #[serde(serialize_with = "seconds", deserialize_with = "span")]
    pub power_period: Duration,
    /// Delay from AUTH_REPLY to the first POWER. Default 0 s.
    #[serde(serialize_with = "seconds", deserialize_with = "span")]
    pub power_after_login: Duration,
    /// What POWER reports while the robot charges. Default: the level.
    pub power_while_charging: PowerWhileCharging,
    /// Age of the battery level that POWER reports. Default 0 s.
    #[serde(serialize_with = "seconds", deserialize_with = "span")]
    pub power_late: Duration,
    /// Hours after which the station ends charging, counted from contact: when the robot leaves and
    /// comes back they begin anew. Default: it never does.
    #[serde(deserialize_with = "number::hours")]
    pub charger_hours: Option<f64>,
    /// The robot sends BASE_NOT_FOUND after this time without the station's beacon. Default 20 s.
    #[serde(serialize_with = "seconds", deserialize_with = "span")]
    pub search_limit: Duration,
    /// Length of the uploaded music. Default 20 s.
    #[serde(serialize_with = "seconds", deserialize_with = "span")]
    pub music: Duration,
    /// The version that AUTH_REPLY and CONFIG report.
    pub version: String,
}

/// What a MOVE does while the robot executes one of its own manoeuvres.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FirmwareBehaviour {
    /// The MOVE ends the manoeuvre, and the tracks follow it; MOVE 0 0 ends the manoeuvre too.
    #[default]
    Ends,
    /// The MOVE has no effect.
    Ignored,
    /// The tracks follow the MOVE, and the manoeuvre continues from the next MOVE 0 0.
    Obeyed,
}

/// What POWER reports while the robot charges (`PROTOCOL.md`, *POWER*).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PowerWhileCharging {
    /// The level.
    #[default]
    Exact,
    /// A level that is wrong by up to 15 points; one in four is a value beyond 100, of either sign.
    Noisy,
    /// Only values beyond 100: in turn -110, -128 and 110.
    OutOfRange,
}

impl Default for Firmware {
    fn default() -> Firmware {
        Firmware {
            stops_on_disconnect: false,
            stops_without_repeat: None,
            move_while_searching: FirmwareBehaviour::Ends,
            move_while_undocking: FirmwareBehaviour::Ends,
            activate_undocks: false,
            commands_per_second: None,
            queue: None,
            answers_power_query: true,
            power_period: Duration::from_secs(5),
            power_after_login: Duration::ZERO,
            power_while_charging: PowerWhileCharging::Exact,
            power_late: Duration::ZERO,
            charger_hours: None,
            search_limit: Duration::from_secs(20),
            music: Duration::from_secs(20),
            version: "1.0.22".into(),
        }
    }
}

impl Firmware {
    /// Parses firmware settings from YAML; missing keys get their defaults. `name` is the name of
    /// the text in errors.
    pub fn from_yaml(text: &str, name: &str) -> Result<Firmware, DocumentError> {
        document::read::<Option<Firmware>>(text, name).map(Option::unwrap_or_default)
    }

    /// Reads a file; see [`Firmware::from_yaml`].
    pub fn load(path: &Path) -> Result<Firmware, DocumentError> {
        document::load(path, "description of a firmware", Firmware::from_yaml)
    }
}

fn span<'de, D: Deserializer<'de>>(from: D) -> Result<Duration, D::Error> {
    number::span(from).map(Duration::from_secs_f64)
}

/// Seconds, or `null` for never.
fn some_span<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Duration>, D::Error> {
    let seconds: Option<f64> = number::span(from)?;
    Ok(seconds.map(Duration::from_secs_f64))
}

/// A number of commands, or `null` for no limit.
fn some_count<'de, D: Deserializer<'de>>(from: D) -> Result<Option<usize>, D::Error> {
    let count: Option<f64> = number::commands(from)?;
    Ok(count.map(|count| count as usize))
}

fn seconds<S: Serializer>(time: &Duration, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_f64(time.as_secs_f64())
}

fn some_seconds<S: Serializer>(time: &Option<Duration>, to: S) -> Result<S::Ok, S::Error> {
    time.map(|time| time.as_secs_f64()).serialize(to)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_keys_get_their_defaults_and_given_keys_are_used() {
        for nothing in ["", "# nothing\n", "{}"] {
            assert_eq!(
                Firmware::from_yaml(nothing, "f").unwrap(),
                Firmware::default()
            );
        }
        let text = "stops_on_disconnect: true\nstops_without_repeat: 0.5\nmove_while_searching: ignored\n\
                    move_while_undocking: obeyed\nactivate_undocks: true\npower_late: 3\n\
                    power_while_charging: out_of_range\ncharger_hours: 4\n\
                    commands_per_second: 2.5\nqueue: 16\nanswers_power_query: false\n";
        let expected = Firmware {
            stops_on_disconnect: true,
            stops_without_repeat: Some(Duration::from_millis(500)),
            move_while_searching: FirmwareBehaviour::Ignored,
            move_while_undocking: FirmwareBehaviour::Obeyed,
            activate_undocks: true,
            commands_per_second: Some(2.5),
            queue: Some(16),
            answers_power_query: false,
            power_late: Duration::from_secs(3),
            power_while_charging: PowerWhileCharging::OutOfRange,
            charger_hours: Some(4.0),
            ..Firmware::default()
        };
        assert_eq!(Firmware::from_yaml(text, "f").unwrap(), expected);
        let json = serde_json::to_string(&expected).unwrap();
        assert_eq!(serde_json::from_str::<Firmware>(&json).unwrap(), expected);
    }

    #[test]
    fn errors_name_their_place() {
        for (text, start, words) in [
            (
                "power_lat: 3\n",
                "f.yaml:1:1: ",
                "did you mean 'power_late'?",
            ),
            ("music: 3\npower_late: -1\n", "f.yaml:2:13: ", "0 to 86400"),
            (
                "stops_without_repeat: soon\n",
                "f.yaml:1:23: ",
                "0 to 86400",
            ),
            ("commands_per_second: 0\n", "f.yaml:1:22: ", "0.1 to 1000"),
            ("queue: 0\n", "f.yaml:1:8: ", "1 to 4096"),
            ("charger_hours: 0\n", "f.yaml:1:16: ", "0.01 to 100"),
            (
                "move_while_searching: obey\n",
                "f.yaml:1:",
                "unknown word `obey`; valid are ends, ignored, obeyed",
            ),
            (
                "power_while_charging: noise\n",
                "f.yaml:1:",
                "did you mean 'noisy'?",
            ),
            ("- 3\n", "f.yaml:1:1: ", "expected keys with values"),
        ] {
            let error = Firmware::from_yaml(text, "f.yaml").unwrap_err().to_string();
            assert!(error.starts_with(start) && error.contains(words), "{error}");
        }
        let error = Firmware::load(Path::new("no/such.yaml")).unwrap_err();
        assert!(error.to_string().contains("no/such.yaml"), "{error}");
    }
}
