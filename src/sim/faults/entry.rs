//! The YAML format of one fault.

use std::time::Duration;

use serde::Deserialize;

use super::fault::{Direction, Fault, FaultKind};
use super::timing::Timing;
use crate::sim::yaml::number;
use crate::wire::Refusal;

/// The names of faults in YAML.
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

/// The names of reasons for refusing a login in YAML.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Reason {
    Busy,
    Password,
}

/// Whether the robot keeps its state in a reboot, in YAML.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Memory {
    Kept,
    Lost,
}

/// One entry of a list of faults; missing keys have defaults.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Entry {
    fault: Name,
    towards: Option<Direction>,
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

impl Name {
    /// Returns the keys that apply to this fault, besides those that all faults accept.
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
    /// Checks that every given key applies to this fault. On error, returns the offending key and a
    /// message.
    pub(super) fn check(&self) -> Result<(), (&'static str, String)> {
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
            return Err((
                key,
                format!("`{key}` does not apply to this fault: it accepts `{list}`"),
            ));
        }
        if self.bytes.is_some_and(|bytes| bytes < 1.0) && self.fault != Name::LengthLie {
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

    /// Returns the fault, with defaults for missing keys.
    pub(super) fn fault(&self) -> Fault {
        let kind = self.kind();
        let usual = Fault::new(kind);
        let one_way =
            matches!(self.fault, Name::Garbage | Name::LengthLie).then_some(Direction::Client);
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

    fn kind(&self) -> FaultKind {
        let seconds = |usual: f64| Duration::from_secs_f64(self.seconds.unwrap_or(usual));
        let bytes = |usual: f64| self.bytes.unwrap_or(usual) as usize;
        match self.fault {
            Name::Delay => FaultKind::Delay {
                by: seconds(0.2),
                jitter: Duration::from_secs_f64(self.jitter.unwrap_or(0.0)),
            },
            Name::Split => FaultKind::Split,
            Name::Drip => FaultKind::Drip {
                rate: bytes(2000.0) as u32,
            },
            Name::HalfOpen => FaultKind::HalfOpen,
            Name::Drop => FaultKind::Drop,
            Name::Reset => FaultKind::Reset,
            Name::Garbage => FaultKind::Garbage { bytes: bytes(64.0) },
            Name::LengthLie => FaultKind::LengthLie {
                claim: self.bytes.map(|bytes| bytes as u16),
            },
            Name::HugeFrames => FaultKind::HugeFrames,
            Name::TruncatedFrames => FaultKind::TruncatedFrames,
            Name::FlippedFrames => FaultKind::FlippedFrames { bytes: bytes(16.0) },
            Name::NoPower => FaultKind::NoPower,
            Name::PowerJumps => FaultKind::PowerJumps {
                percent: self.percent.map(|percent| percent as u8),
            },
            Name::PowerGarbage => FaultKind::PowerGarbage,
            Name::Reboot => FaultKind::Reboot {
                forgets: self.state != Some(Memory::Kept),
            },
            Name::RefuseLogin => FaultKind::RefuseLogin(match self.reason {
                Some(Reason::Password) => Refusal::WrongPassword,
                Some(Reason::Busy) | None => Refusal::InUse,
            }),
            Name::TakeOver => FaultKind::TakeOver,
            Name::BaseNotFound => FaultKind::BaseNotFound,
            Name::NoCharge => FaultKind::NoCharge,
            Name::DockLost => FaultKind::DockLost {
                after: seconds(5.0),
            },
        }
    }
}
