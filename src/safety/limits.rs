//! Every number of the safety rules, with its default: the `watchdog:` section of the config.

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::PowerMeaning;
use crate::robot::{Percent, Seconds};

/// The numbers of the safety rules. Times are in seconds in the config, which sets those that an
/// owner has a reason to change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// What the number in the robot's battery reports means (`auto`): `percent`, a share of the energy;
    /// `voltage`, a share of a voltage, which is converted; `auto`, a share of the energy until it
    /// sags twice while the tracks run. All levels are shares of the energy.
    pub power: PowerMeaning,
    /// At or below this level the robot is sent home, whatever the scripts do (30 %).
    pub low: Percent,
    /// At this level or above, a robot that was low may move again (50 %).
    pub ok: Percent,
    /// At or below this level no behaviour moves the robot, charging or not, except on the way home
    /// (8 %); camera, microphone, lights and sounds are switched off.
    pub critical: Percent,
    /// The longest single search for the station on the way home (180 s).
    pub dock_timeout: Seconds,
    /// The longest wait for charging to begin once the robot is on the station (30 s).
    pub charge_timeout: Seconds,
    /// Further searches after the first one; when all have failed, the alarm sounds (3).
    pub dock_retries: u32,
    /// The pause after a failed search, if nothing drives the robot elsewhere then (20 s).
    pub dock_pause: Seconds,
    /// Whether the watchdog itself makes a short move if the station was not found and no rescue
    /// behaviour has driven (true). It moves blindly: at 30 %, straight for 2 s, later for up
    /// to 4 s (0.27 to 0.54 m), every second one after a turn of 0.95 s, with a search after each,
    /// until the robot is released. False where the robot could fall.
    pub blind_moves: bool,
    /// The rescue behaviour, which drives a robot with a low battery elsewhere after a failed
    /// search: `builtin`, which drives over free floor; the name of a `.lua` file; or `off`.
    pub rescue: Rescue,
    /// The shortest grant of the tracks to the rescue behaviour (8 s); it lasts twice as long as the
    /// failed search, at most [`DriveGrant::LONGEST`](super::DriveGrant::LONGEST).
    #[serde(skip)]
    pub rescue_time: Seconds,
    /// The limit of each track's power during a grant (45 %); more is scaled down on both tracks
    /// alike.
    #[serde(skip)]
    pub rescue_power: Percent,
    /// After this time off the station without a battery level, the battery counts as low (600 s).
    pub power_silence: Seconds,
    /// A host with a motion must show life this often, or the tracks are stopped (0.25 s).
    pub host_silence: Seconds,
    /// A host that shows no life for this much longer is ended; one that does continues (1.75 s).
    /// Thus a processor that stalls does not end the script that runs on it.
    #[serde(skip)]
    pub host_grace: Seconds,
    /// A host without motion that shows no life for this long is also ended (5 s).
    #[serde(skip)]
    pub host_idle_silence: Seconds,
    /// With a stream on and the tracks moving, bytes must come this often (3 s).
    #[serde(skip)]
    pub stream_silence: Seconds,
    /// The time from one alarm to the next (15 s).
    #[serde(skip)]
    pub alarm_every: Seconds,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            power: PowerMeaning::Auto,
            low: percent(30),
            ok: percent(50),
            critical: percent(8),
            dock_timeout: Seconds::from_secs(180),
            charge_timeout: Seconds::from_secs(30),
            dock_retries: 3,
            dock_pause: Seconds::from_secs(20),
            blind_moves: true,
            rescue: Rescue::Builtin,
            rescue_time: Seconds::from_secs(8),
            rescue_power: percent(45),
            power_silence: Seconds::from_secs(600),
            host_silence: Seconds::from_millis(250),
            host_grace: Seconds::from_millis(1750),
            host_idle_silence: Seconds::from_secs(5),
            stream_silence: Seconds::from_secs(3),
            alarm_every: Seconds::from_secs(15),
        }
    }
}

/// Why values in [`Limits`] are refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LimitsError {
    #[error("watchdog levels must rise: critical ({critical}) < low ({low}) < ok ({ok})")]
    Levels {
        critical: Percent,
        low: Percent,
        ok: Percent,
    },
    #[error("`{0}` is neither `builtin` nor `off` nor the name of a .lua file")]
    Rescue(String),
}

impl Limits {
    /// Checks the limits against each other.
    pub fn check(&self) -> Result<(), LimitsError> {
        let Limits {
            critical, low, ok, ..
        } = self;
        if critical < low && low < ok {
            return Ok(());
        }
        Err(LimitsError::Levels {
            critical: *critical,
            low: *low,
            ok: *ok,
        })
    }
}

const fn percent(level: u8) -> Percent {
    match Percent::new(level) {
        Some(percent) => percent,
        None => panic!("a default level beyond 100 %"),
    }
}

/// The behaviour that the tracks of a robot with a low battery are granted to between two searches,
/// up to 40 s at a time. In a config: `builtin`, `off`, or the name of a `.lua` file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Rescue {
    /// The built-in behaviour: it drives over free floor and looks for the station.
    #[default]
    Builtin,
    /// No behaviour: the tracks are not granted.
    Off,
    /// The user's own behaviour.
    File(PathBuf),
}

impl TryFrom<String> for Rescue {
    type Error = LimitsError;

    fn try_from(text: String) -> Result<Rescue, LimitsError> {
        match text.as_str() {
            "builtin" => Ok(Rescue::Builtin),
            "off" => Ok(Rescue::Off),
            file if file.ends_with(".lua") => Ok(Rescue::File(PathBuf::from(file))),
            _ => Err(LimitsError::Rescue(text)),
        }
    }
}

impl fmt::Display for Rescue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Rescue::Builtin => f.write_str("builtin"),
            Rescue::Off => f.write_str("off"),
            Rescue::File(file) => file.display().fmt(f),
        }
    }
}

impl From<Rescue> for String {
    fn from(rescue: Rescue) -> String {
        rescue.to_string()
    }
}

impl schemars::JsonSchema for Rescue {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Rescue".into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": "string", "pattern": "^(builtin|off|.+\\.lua)$" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_those_the_documentation_names() {
        let limits = Limits::default();
        assert_eq!(
            (limits.low.get(), limits.ok.get(), limits.critical.get()),
            (30, 50, 8)
        );
        assert_eq!(limits.host_silence, Seconds::from_millis(250));
        assert_eq!(limits.host_idle_silence, Seconds::from_secs(5));
        assert_eq!(limits.dock_pause, Seconds::from_secs(20));
        assert!(limits.blind_moves);
        assert_eq!(limits.check(), Ok(()));
    }

    #[test]
    fn levels_that_do_not_rise_are_refused() {
        for (critical, low, ok) in [(20, 20, 50), (8, 50, 50), (8, 20, 20), (30, 20, 50)] {
            let limits = Limits {
                critical: percent(critical),
                low: percent(low),
                ok: percent(ok),
                ..Limits::default()
            };
            let error = limits.check().unwrap_err().to_string();
            let expected = format!("critical ({critical} %) < low ({low} %) < ok ({ok} %)");
            assert!(error.contains(&expected), "{error}");
        }
    }

    fn read(text: &str) -> Result<Rescue, serde_yaml::Error> {
        serde_yaml::from_str(text)
    }

    #[test]
    fn a_config_names_a_keyword_or_a_script() {
        assert_eq!(read("builtin").unwrap(), Rescue::Builtin);
        assert_eq!(read("off").unwrap(), Rescue::Off);
        let file = Rescue::File("mine/out.lua".into());
        assert_eq!(read("mine/out.lua").unwrap(), file);
        for text in ["builtin", "off", "out.lua"] {
            assert_eq!(
                String::from(read(text).unwrap()),
                text,
                "written as it was read"
            );
        }
        let error = read("of").unwrap_err().to_string();
        assert!(error.contains("`of` is neither"), "{error}");
    }

    #[test]
    fn the_schema_describes_the_setting() {
        let schema = schemars::schema_for!(crate::safety::Limits).to_value();
        let rescue = &schema["properties"]["rescue"];
        assert_eq!(rescue["pattern"], r"^(builtin|off|.+\.lua)$");
        assert_eq!(rescue["type"], "string");
    }
}
