//! Lists of faults as people write them: YAML, every fault in one line, errors with line and column.

use std::path::Path;
use std::time::Duration;

use serde::Deserialize;

use crate::files::{self, ReadError};
use crate::wire::Refusal;
use crate::yaml;

use super::faults::{Fault, Towards, Trouble};
use super::locate::{self, Step};
use super::number;
use super::timing::Timing;

/// A longer file is no list of faults.
const MAX_FILE_LEN: u64 = yaml::MAX_LEN;
/// Faults at once; each is asked at every step.
const MAX_FAULTS: usize = 200;

/// A list of faults that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FaultsError {
    /// The file cannot be read.
    #[error("cannot read the faults {name}: {source}")]
    Read {
        /// The file.
        name: String,
        /// Why.
        source: std::io::Error,
    },
    /// The file is too long.
    #[error("{name} is longer than {MAX_FILE_LEN} bytes: is it a list of faults?")]
    TooLong {
        /// The file.
        name: String,
    },
    /// The YAML does not describe faults.
    #[error("{name}:{line}:{column}: {message}")]
    Invalid {
        /// The file, or what else the text came from.
        name: String,
        /// Counted from 1.
        line: usize,
        /// Counted from 1.
        column: usize,
        /// What was found, what was expected, what to do.
        message: String,
    },
}

/// The names of troubles in YAML.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Name {
    Delay,
    Split,
    Drip,
    HalfOpen,
    Drop,
    Reset,
    Garbage,
    LengthLie,
    HugeFrames,
    TruncatedFrames,
    FlippedFrames,
    NoPower,
    PowerJumps,
    PowerGarbage,
    Reboot,
    RefuseLogin,
    TakeOver,
    BaseNotFound,
    NoCharge,
    DockLost,
}

/// Why a login is refused, in YAML.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Reason {
    Busy,
    Password,
}

/// What a robot is after a reboot, in YAML.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Memory {
    Kept,
    Lost,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    faults: Vec<Entry>,
}

/// One fault as it is written: whatever is left out has a default.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    fault: Name,
    towards: Option<Towards>,
    reason: Option<Reason>,
    state: Option<Memory>,
    #[serde(default, deserialize_with = "some_span")]
    seconds: Option<f64>,
    #[serde(default, deserialize_with = "some_span")]
    jitter: Option<f64>,
    #[serde(default, deserialize_with = "some_bytes")]
    bytes: Option<f64>,
    #[serde(default, deserialize_with = "some_percent")]
    percent: Option<f64>,
    #[serde(default, deserialize_with = "number::span")]
    after: f64,
    #[serde(default, rename = "for", deserialize_with = "some_span")]
    lasts: Option<f64>,
    #[serde(default, deserialize_with = "some_span")]
    every: Option<f64>,
    #[serde(default = "always", deserialize_with = "number::chance")]
    chance: f64,
}

fn always() -> f64 {
    1.0
}

macro_rules! optional {
    ($($name:ident = $reader:ident;)+) => {$(
        fn $name<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
            number::$reader(from).map(Some)
        }
    )+};
}

optional! {
    some_span = span;
    some_bytes = bytes;
    some_percent = percent;
}

impl Fault {
    /// Reads a list of faults; `name` is what errors call the text, usually its file's name.
    ///
    /// # Errors
    /// [`FaultsError::Invalid`] with line and column: unknown keys and faults, values out of range,
    /// values that mean nothing for this fault.
    pub fn list_from_yaml(text: &str, name: &str) -> Result<Vec<Fault>, FaultsError> {
        let invalid = |(line, column): (usize, usize), message: String| FaultsError::Invalid {
            name: name.to_owned(),
            line,
            column,
            message,
        };
        let Document { faults } =
            locate::read(text).map_err(|(place, message)| invalid(place, message))?;
        if faults.len() > MAX_FAULTS {
            let message = format!("{} faults are too many: at most {MAX_FAULTS}", faults.len());
            return Err(invalid(locate::find(text, &[Step::Key("faults")]), message));
        }
        for (index, entry) in faults.iter().enumerate() {
            if let Some((key, message)) = entry.mistake() {
                let path = [Step::Key("faults"), Step::Index(index), Step::Key(key)];
                return Err(invalid(locate::find(text, &path), message));
            }
        }
        Ok(faults.iter().map(Entry::fault).collect())
    }

    /// Reads a list of faults from a file.
    ///
    /// # Errors
    /// As [`Fault::list_from_yaml`], or the file cannot be read.
    pub fn load_list(path: &Path) -> Result<Vec<Fault>, FaultsError> {
        let name = path.display().to_string();
        match files::read_text(path, MAX_FILE_LEN) {
            Ok(text) => Fault::list_from_yaml(&text, &name),
            Err(ReadError::TooLong { .. }) => Err(FaultsError::TooLong { name }),
            Err(error) => Err(FaultsError::Read {
                name,
                source: error.into(),
            }),
        }
    }
}

impl Name {
    /// The keys that mean something for it, besides those that all faults know.
    fn keys(self) -> &'static [&'static str] {
        match self {
            Name::Delay => &["seconds", "jitter", "towards", "for"],
            Name::Split | Name::HalfOpen => &["towards", "for"],
            Name::Drip => &["bytes", "towards", "for"],
            Name::Drop | Name::Reset => &[],
            Name::Garbage | Name::LengthLie => &["bytes", "towards"],
            Name::FlippedFrames => &["bytes", "for"],
            Name::PowerJumps => &["percent", "for"],
            Name::Reboot => &["state", "for"],
            Name::RefuseLogin => &["reason", "for"],
            Name::DockLost => &["seconds", "for"],
            Name::HugeFrames
            | Name::TruncatedFrames
            | Name::NoPower
            | Name::PowerGarbage
            | Name::TakeOver
            | Name::BaseNotFound
            | Name::NoCharge => &["for"],
        }
    }
}

impl Entry {
    /// The first key that cannot be meant so, and why.
    fn mistake(&self) -> Option<(&'static str, String)> {
        let given = [
            ("towards", self.towards.is_some()),
            ("reason", self.reason.is_some()),
            ("state", self.state.is_some()),
            ("seconds", self.seconds.is_some()),
            ("jitter", self.jitter.is_some()),
            ("bytes", self.bytes.is_some()),
            ("percent", self.percent.is_some()),
            ("for", self.lasts.is_some()),
        ];
        let known = self.fault.keys();
        let stray = given.iter().find(|(key, is)| *is && !known.contains(key));
        if let Some((key, _)) = stray {
            let list = [known, &["after", "every", "chance"]].concat().join("`, `");
            return Some((
                key,
                format!("`{key}` means nothing here: this fault knows `{list}`"),
            ));
        }
        if self.bytes.is_some_and(|bytes| bytes < 1.0) && self.fault != Name::LengthLie {
            return Some(("bytes", "expected at least 1 byte".into()));
        }
        let length = self.fault().timing.lasts;
        match (self.every.map(Duration::from_secs_f64), length) {
            (Some(_), None) => Some(("every", "say with `for` how long it lasts each time".into())),
            (Some(every), Some(length)) if every <= length || every.is_zero() => {
                let message = format!("must be longer than the {length:?} that the fault lasts");
                Some(("every", message))
            }
            _ => None,
        }
    }

    fn fault(&self) -> Fault {
        let trouble = self.trouble();
        let usual = Fault::new(trouble);
        let one_way =
            matches!(self.fault, Name::Garbage | Name::LengthLie).then_some(Towards::Client);
        let seconds = |seconds: Option<f64>| seconds.map(Duration::from_secs_f64);
        Fault {
            towards: self.towards.or(one_way).unwrap_or(usual.towards),
            timing: Timing {
                after: Duration::from_secs_f64(self.after),
                lasts: seconds(self.lasts).or(usual.timing.lasts),
                every: seconds(self.every),
            },
            chance: self.chance,
            ..usual
        }
    }

    fn trouble(&self) -> Trouble {
        let seconds = |usual: f64| Duration::from_secs_f64(self.seconds.unwrap_or(usual));
        let bytes = |usual: f64| self.bytes.unwrap_or(usual) as usize;
        match self.fault {
            Name::Delay => Trouble::Delay {
                by: seconds(0.2),
                jitter: Duration::from_secs_f64(self.jitter.unwrap_or(0.0)),
            },
            Name::Split => Trouble::Split,
            Name::Drip => Trouble::Drip {
                rate: bytes(2000.0) as u32,
            },
            Name::HalfOpen => Trouble::HalfOpen,
            Name::Drop => Trouble::Drop,
            Name::Reset => Trouble::Reset,
            Name::Garbage => Trouble::Garbage { bytes: bytes(64.0) },
            Name::LengthLie => Trouble::LengthLie {
                claim: self.bytes.map(|bytes| bytes as u16),
            },
            Name::HugeFrames => Trouble::HugeFrames,
            Name::TruncatedFrames => Trouble::TruncatedFrames,
            Name::FlippedFrames => Trouble::FlippedFrames { bytes: bytes(16.0) },
            Name::NoPower => Trouble::NoPower,
            Name::PowerJumps => Trouble::PowerJumps {
                percent: self.percent.map(|percent| percent as u8),
            },
            Name::PowerGarbage => Trouble::PowerGarbage,
            Name::Reboot => Trouble::Reboot {
                forgets: self.state != Some(Memory::Kept),
            },
            Name::RefuseLogin => Trouble::RefuseLogin(match self.reason {
                Some(Reason::Password) => Refusal::WrongPassword,
                Some(Reason::Busy) | None => Refusal::InUse,
            }),
            Name::TakeOver => Trouble::TakeOver,
            Name::BaseNotFound => Trouble::BaseNotFound,
            Name::NoCharge => Trouble::NoCharge,
            Name::DockLost => Trouble::DockLost {
                after: seconds(5.0),
            },
        }
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
    fn what_is_left_out_has_defaults() {
        let faults = read("faults: [{fault: drop}, {fault: take_over}, {fault: split}]");
        assert_eq!(faults[0], Fault::new(Trouble::Drop));
        assert_eq!(faults[1].timing.lasts, Some(Duration::from_secs(5)));
        assert_eq!(faults[2].timing.lasts, None);
    }

    #[test]
    fn what_is_written_is_read() {
        let text = "faults:\n  - { fault: delay, seconds: 0.5, jitter: 1, towards: robot, after: 2, \
                    for: 3, every: 10, chance: 0.5 }\n  - { fault: length_lie, bytes: 0 }\n";
        let faults = read(text);
        let seconds = Duration::from_secs;
        let (by, jitter) = (Duration::from_millis(500), seconds(1));
        let expected = Fault {
            trouble: Trouble::Delay { by, jitter },
            towards: Towards::Robot,
            timing: Timing {
                after: seconds(2),
                lasts: Some(seconds(3)),
                every: Some(seconds(10)),
            },
            chance: 0.5,
        };
        assert_eq!(faults[0], expected);
        assert_eq!(faults[1].trouble, Trouble::LengthLie { claim: Some(0) });
        assert_eq!(faults[1].towards, Towards::Client);
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        for (text, start, words) in [
            (
                "faults:\n  - fault: dlay\n",
                "f.yaml:2:",
                "did you mean `delay`?",
            ),
            (
                "faults:\n  - fault: drop\n    afetr: 1\n",
                "f.yaml:3:5: ",
                "did you mean `after`?",
            ),
            (
                "faults:\n  - fault: drop\n    after: -1\n",
                "f.yaml:3:12: ",
                "0 to 86400",
            ),
            (
                "faults:\n  - fault: drop\n    for: 3\n",
                "f.yaml:3:10: ",
                "`for` means nothing here",
            ),
            (
                "faults: [{fault: split, percent: 3}]",
                "f.yaml:1:34: ",
                "`towards`, `for`, `after`",
            ),
            (
                "faults: [{fault: split, every: 3}]",
                "f.yaml:1:32: ",
                "say with `for`",
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
            ("faults: 3", "f.yaml:1:9: ", "expected a sequence"),
        ] {
            let text = mistake(text);
            assert!(text.starts_with(start) && text.contains(words), "{text}");
        }
    }

    #[test]
    fn a_crowd_is_refused() {
        let text = format!("faults:\n{}", "  - fault: drop\n".repeat(MAX_FAULTS + 1));
        assert!(mistake(&text).contains("201 faults are too many"));
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let error = Fault::load_list(Path::new("no/such/faults.yaml")).unwrap_err();
        assert!(error.to_string().contains("no/such/faults.yaml"), "{error}");
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_without_panic(text in ".{0,200}", more in "[a-z_:{}\\[\\], 0-9.&*-]{0,80}") {
            let _ = Fault::list_from_yaml(&text, "random");
            let _ = Fault::list_from_yaml(&format!("faults:\n  - fault: {more}"), "random");
        }
    }
}
