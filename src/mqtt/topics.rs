//! The topics of an agent at a broker: `PREFIX/ROBOT/...`, with the robot's uid.

use crate::robot::named;

/// Maximum length of a robot's name in a topic, in characters.
const LONGEST_ID: usize = 64;

pub(super) const PREFIX: &str = "spykee";
/// The first part of the topics in which Home Assistant looks for devices.
const DISCOVERY: &str = "homeassistant";

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Topics {
    /// The robot's uid, reduced to characters that are safe in topics.
    pub(super) id: String,
}

impl Topics {
    pub(super) fn new(uid: &str) -> Topics {
        Topics { id: id_of(uid) }
    }

    /// The topic of this name: `connection` (the agent's [`Presence`]), `state`, `event`, `picture`,
    /// `alarm` (the last picture that a script sent to people), `answer`, `command`, or `behaviour/set` (the behaviour that `start` starts).
    pub(super) fn named(&self, name: &str) -> String {
        format!("{PREFIX}/{}/{name}", self.id)
    }

    /// The description of the entities for Home Assistant. Retained.
    pub(super) fn discovery(&self) -> String {
        format!("{DISCOVERY}/device/{}/config", self.id)
    }

    /// Home Assistant's birth message, sent when it starts.
    pub(super) fn birth(&self) -> String {
        format!("{DISCOVERY}/status")
    }
}

/// Converts a uid to a part of a topic: it comes from a robot and could contain characters with a
/// meaning in topics.
pub(super) fn id_of(uid: &str) -> String {
    let plain = |c: char| {
        if c.is_ascii_alphanumeric() || matches!(c, '-' | '_') {
            c
        } else {
            '_'
        }
    };
    match uid.chars().take(LONGEST_ID).map(plain).collect::<String>() {
        id if id.is_empty() => "robot".to_owned(),
        id => id,
    }
}

named! {
    /// Whether an agent is connected to its broker, in the terms of VDA 5050.
    Presence {
        Online = "ONLINE",
        Offline = "OFFLINE",
        /// The connection broke: the broker publishes this on the agent's behalf.
        ConnectionBroken = "CONNECTIONBROKEN",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uid_cannot_reach_other_topics() {
        let topics = Topics::new("../#/+\u{0}x");
        assert_eq!(topics.named("command"), "spykee/_______x/command");
        assert_eq!(id_of(""), "robot");
        assert_eq!(id_of(&"a".repeat(1000)).len(), LONGEST_ID);
        assert_eq!(id_of("SPYKEE0001"), "SPYKEE0001");
    }
}
