//! Reads lists of faults from YAML; errors name line and column.

use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Deserializer};
use wire::Refusal;
use yaml::parsed_text;

use super::{Direction, Fault, FaultKind, Timing};
use crate::document::{self, DocumentError, Step, number};

/// Maximum number of faults in a list; each is polled at every step.
const MAX_FAULTS: usize = 200;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    faults: Vec<Entry>,
}

impl Fault {
    /// Parses a list of faults; `name` is the name of the text in errors, usually its file name.
    pub fn list_from_yaml(text: &str, name: &str) -> Result<Vec<Fault>, DocumentError> {
        let invalid = |path: &[Step], message| {
            DocumentError::invalid(name, document::find(text, path), message)
        };
        let Document { faults } = document::read(text, name)?;
        if faults.len() > MAX_FAULTS {
            let message = format!("{} faults are too many: at most {MAX_FAULTS}", faults.len());
            return Err(invalid(&[Step::Key("faults")], message));
        }
        for (index, entry) in faults.iter().enumerate() {
            entry.check().map_err(|(key, message)| {
                let path = [Step::Key("faults"), Step::Index(index), Step::Key(key)];
                invalid(&path, message)
            })?;
        }
        Ok(faults.iter().map(Entry::fault).collect())
    }

    /// Reads a file; see [`Fault::list_from_yaml`].
    pub fn load_list(path: &Path) -> Result<Vec<Fault>, DocumentError> {
        document::load(path, "list of faults", Fault::list_from_yaml)
    }
}

/// A kind of fault: its name, the keys that apply to it besides those that all faults accept, and what
/// it is with the values of an entry.
struct Row(
    &'static str,
    &'static [&'static str],
    fn(&Entry) -> FaultKind,
);

static ROWS: [Row; 21] = [
    Row("delay", &["seconds", "jitter", "towards", "for"], |entry| {
        FaultKind::Delay {
            by: entry.seconds_or(0.2),
            jitter: Duration::from_secs_f64(entry.jitter.unwrap_or(0.0)),
        }
    }),
    Row("split", &["towards", "for"], |_| FaultKind::Split),
    Row("drip", &["bytes", "towards", "for"], |entry| {
        FaultKind::Drip {
            rate: entry.bytes_or(2000.0) as u32,
        }
    }),
    Row("half_open", &["towards", "for"], |_| FaultKind::HalfOpen),
    Row("drop", &[], |_| FaultKind::Drop),
    Row("reset", &[], |_| FaultKind::Reset),
    Row("garbage", &["bytes", "towards"], |entry| {
        FaultKind::Garbage {
            bytes: entry.bytes_or(64.0),
        }
    }),
    Row("length_lie", &["bytes", "towards"], |entry| {
        FaultKind::LengthLie {
            claim: entry.bytes.map(|bytes| bytes as u16),
        }
    }),
    Row("huge_frames", &["for"], |_| FaultKind::HugeFrames),
    Row("truncated_frames", &["for"], |_| FaultKind::TruncatedFrames),
    Row("flipped_frames", &["bytes", "for"], |entry| {
        FaultKind::FlippedFrames {
            bytes: entry.bytes_or(16.0),
        }
    }),
    Row("no_power", &["for"], |_| FaultKind::NoPower),
    Row("power_jumps", &["percent", "for"], |entry| {
        FaultKind::PowerJumps {
            percent: entry.percent.map(|percent| percent as u8),
        }
    }),
    Row("power_garbage", &["for"], |_| FaultKind::PowerGarbage),
    Row("reboot", &["state", "for"], |entry| FaultKind::Reboot {
        forgets: entry.state != Some(Memory::Kept),
    }),
    Row("refuse_login", &["reason", "for"], |entry| {
        FaultKind::RefuseLogin(match entry.reason {
            Some(Reason::Password) => Refusal::WrongPassword,
            Some(Reason::Busy) | None => Refusal::InUse,
        })
    }),
    Row("slow_program", &["commands_per_second", "for"], |entry| {
        FaultKind::SlowProgram {
            period: Duration::from_secs_f64(1.0 / entry.commands_per_second.unwrap_or(5.0)),
        }
    }),
    Row("take_over", &["for"], |_| FaultKind::TakeOver),
    Row("base_not_found", &["for"], |_| FaultKind::BaseNotFound),
    Row("no_charge", &["for"], |_| FaultKind::NoCharge),
    Row("dock_lost", &["seconds", "for"], |entry| {
        FaultKind::DockLost {
            after: entry.seconds_or(5.0),
        }
    }),
];

fn row<'de, D: Deserializer<'de>>(from: D) -> Result<&'static Row, D::Error> {
    parsed_text(from, "the name of a fault", |text| {
        let names = ROWS.each_ref().map(|Row(name, ..)| *name).join("`, `");
        let found = ROWS.iter().find(|Row(name, ..)| *name == text);
        found.ok_or_else(|| format!("unknown variant `{text}`, expected one of `{names}`"))
    })
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Reason {
    Busy,
    Password,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Memory {
    Kept,
    Lost,
}

/// One entry of a list of faults; missing keys have defaults.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    #[serde(deserialize_with = "row")]
    fault: &'static Row,
    towards: Option<Direction>,
    reason: Option<Reason>,
    state: Option<Memory>,
    #[serde(default, deserialize_with = "number::span")]
    seconds: Option<f64>,
    #[serde(default, deserialize_with = "number::span")]
    jitter: Option<f64>,
    #[serde(default, deserialize_with = "number::bytes")]
    bytes: Option<f64>,
    #[serde(default, deserialize_with = "number::percent")]
    percent: Option<f64>,
    #[serde(default, deserialize_with = "number::commands_per_second")]
    commands_per_second: Option<f64>,
    #[serde(default, deserialize_with = "number::span")]
    after: f64,
    #[serde(default, rename = "for", deserialize_with = "number::span")]
    lasts: Option<f64>,
    #[serde(default, deserialize_with = "number::span")]
    every: Option<f64>,
    #[serde(default = "number::one", deserialize_with = "number::chance")]
    chance: f64,
}

impl Entry {
    /// Checks that every given key applies to this fault. On error, returns the offending key and a
    /// message.
    fn check(&self) -> Result<(), (&'static str, String)> {
        let given = [
            ("towards", self.towards.is_some()),
            ("reason", self.reason.is_some()),
            ("state", self.state.is_some()),
            ("seconds", self.seconds.is_some()),
            ("jitter", self.jitter.is_some()),
            ("bytes", self.bytes.is_some()),
            ("percent", self.percent.is_some()),
            ("commands_per_second", self.commands_per_second.is_some()),
            ("for", self.lasts.is_some()),
        ];
        let Row(_, known, kind) = *self.fault;
        let stray = given.iter().find(|(key, is)| *is && !known.contains(key));
        if let Some((key, _)) = stray {
            let list = [known, &["after", "every", "chance"]].concat().join("`, `");
            return Err((
                key,
                format!("`{key}` does not apply to this fault: it accepts `{list}`"),
            ));
        }
        let lies = matches!(kind(self), FaultKind::LengthLie { .. });
        if self.bytes.is_some_and(|bytes| bytes < 1.0) && !lies {
            return Err(("bytes", "expected at least 1 byte".into()));
        }
        let length = self.fault().timing.lasts;
        match (self.every.map(Duration::from_secs_f64), length) {
            (Some(_), None) => Err((
                "every",
                "needs `for`: how long the fault lasts each time".into(),
            )),
            (Some(every), Some(length)) if every <= length || every.is_zero() => {
                let message = format!("must be longer than the {length:?} that the fault lasts");
                Err(("every", message))
            }
            _ => Ok(()),
        }
    }

    fn fault(&self) -> Fault {
        let Row(_, _, kind) = *self.fault;
        let usual = Fault::new(kind(self));
        let towards = match usual.kind {
            FaultKind::Garbage { .. } | FaultKind::LengthLie { .. } => Direction::Client,
            _ => usual.towards,
        };
        let seconds = |seconds: Option<f64>| seconds.map(Duration::from_secs_f64);
        Fault {
            towards: self.towards.unwrap_or(towards),
            timing: Timing {
                after: Duration::from_secs_f64(self.after),
                lasts: seconds(self.lasts).or(usual.timing.lasts),
                every: seconds(self.every),
            },
            chance: self.chance,
            ..usual
        }
    }

    fn seconds_or(&self, usual: f64) -> Duration {
        Duration::from_secs_f64(self.seconds.unwrap_or(usual))
    }

    fn bytes_or(&self, usual: f64) -> usize {
        self.bytes.unwrap_or(usual) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<Fault> {
        Fault::list_from_yaml(text, "f.yaml").unwrap()
    }

    fn mistake(text: &str) -> String {
        let error = Fault::list_from_yaml(text, "f.yaml").unwrap_err();
        error.to_string()
    }

    #[test]
    fn missing_keys_have_defaults() {
        let faults = read("faults: [{fault: drop}, {fault: take_over}, {fault: split}]");
        assert_eq!(faults[0], Fault::new(FaultKind::Drop));
        assert_eq!(faults[1].timing.lasts, Some(Duration::from_secs(5)));
        assert_eq!(faults[2].timing.lasts, None);
    }

    #[test]
    fn given_keys_are_used() {
        let text = "faults:\n  - { fault: delay, seconds: 0.5, jitter: 1, towards: robot, after: 2, \
                    for: 3, every: 10, chance: 0.5 }\n  - { fault: length_lie, bytes: 0 }\n";
        let faults = read(text);
        let seconds = Duration::from_secs;
        let by = Duration::from_millis(500);
        let jitter = seconds(1);
        let expected = Fault {
            kind: FaultKind::Delay { by, jitter },
            towards: Direction::Robot,
            timing: Timing {
                after: seconds(2),
                lasts: Some(seconds(3)),
                every: Some(seconds(10)),
            },
            chance: 0.5,
        };
        assert_eq!(faults[0], expected);
        assert_eq!(faults[1].kind, FaultKind::LengthLie { claim: Some(0) });
        assert_eq!(faults[1].towards, Direction::Client);
        let faults = read("faults: [{fault: slow_program, commands_per_second: 2, for: 3}]");
        let period = Duration::from_millis(500);
        assert_eq!(faults[0].kind, FaultKind::SlowProgram { period });
        assert_eq!(faults[0].timing.lasts, Some(seconds(3)));
    }

    #[test]
    fn errors_name_their_place() {
        for (text, start, words) in [
            (
                "faults:\n  - fault: dlay\n",
                "f.yaml:2:",
                "did you mean 'delay'?",
            ),
            (
                "faults:\n  - fault: drop\n    afetr: 1\n",
                "f.yaml:3:5: ",
                "did you mean 'after'?",
            ),
            (
                "faults:\n  - fault: drop\n    after: -1\n",
                "f.yaml:3:12: ",
                "0 to 86400",
            ),
            (
                "faults:\n  - fault: drop\n    for: 3\n",
                "f.yaml:3:10: ",
                "`for` does not apply to this fault",
            ),
            (
                "faults: [{fault: split, percent: 3}]",
                "f.yaml:1:34: ",
                "`towards`, `for`, `after`",
            ),
            (
                "faults: [{fault: split, every: 3}]",
                "f.yaml:1:32: ",
                "needs `for`",
            ),
            (
                "faults: [{fault: reboot, every: 3}]",
                "f.yaml:1:33: ",
                "longer than the 5s",
            ),
            (
                "faults: [{fault: garbage, bytes: 0}]",
                "f.yaml:1:34: ",
                "at least 1 byte",
            ),
            (
                "faults: [{fault: drop, chance: .nan}]",
                "f.yaml:1:32: ",
                "1 is always",
            ),
            (
                "faults: [{fault: slow_program, commands_per_second: 0}]",
                "f.yaml:1:53: ",
                "0.1 to 1000",
            ),
            ("faults: 3", "f.yaml:1:9: ", "expected a sequence"),
        ] {
            let text = mistake(text);
            assert!(text.starts_with(start) && text.contains(words), "{text}");
        }
    }

    #[test]
    fn too_many_faults_are_rejected() {
        let text = format!("faults:\n{}", "  - fault: drop\n".repeat(MAX_FAULTS + 1));
        assert!(mistake(&text).contains("201 faults are too many"));
    }

    #[test]
    fn the_error_names_a_missing_file() {
        let error = Fault::load_list(Path::new("no/such/faults.yaml")).unwrap_err();
        assert!(error.to_string().contains("no/such/faults.yaml"), "{error}");
    }

    proptest::proptest! {
        #[test]
        fn no_text_causes_a_panic(text in ".{0,200}", more in "[a-z_:{}\\[\\], 0-9.&*-]{0,80}") {
            let _ = Fault::list_from_yaml(&text, "random");
            let _ = Fault::list_from_yaml(&format!("faults:\n  - fault: {more}"), "random");
        }
    }
}
