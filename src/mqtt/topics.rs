//! The topics of an agent at a broker: `PREFIX/ROBOT/...`, with the robot's uid.

/// Maximum length of a robot's name in a topic, in characters.
const LONGEST_ID: usize = 64;

/// The topics of one agent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Topics {
    base: String,
    discovery: String,
    /// The robot's uid, reduced to characters that are safe in topics.
    pub(super) id: String,
}

impl Topics {
    /// Returns the topics of the robot with this uid.
    pub(super) fn new(prefix: &str, discovery: &str, uid: &str) -> Topics {
        let id = id_of(uid);
        Topics {
            base: format!("{prefix}/{id}"),
            discovery: discovery.to_owned(),
            id,
        }
    }

    /// The agent's presence: see [`Presence`](super::presence::Presence). Retained.
    pub(super) fn connection(&self) -> String {
        format!("{}/connection", self.base)
    }

    /// The state, as JSON. Retained.
    pub(super) fn state(&self) -> String {
        format!("{}/state", self.base)
    }

    /// Events, as JSON.
    pub(super) fn event(&self) -> String {
        format!("{}/event", self.base)
    }

    /// Requested pictures, as JPEG.
    pub(super) fn picture(&self) -> String {
        format!("{}/picture", self.base)
    }

    /// Results of commands, as JSON.
    pub(super) fn answer(&self) -> String {
        format!("{}/answer", self.base)
    }

    /// Commands to the agent.
    pub(super) fn command(&self) -> String {
        format!("{}/command", self.base)
    }

    /// The choice of the behaviour that `start` starts.
    pub(super) fn behaviour(&self) -> String {
        format!("{}/behaviour/set", self.base)
    }

    /// The description of the entities for Home Assistant. Retained.
    pub(super) fn discovery(&self) -> String {
        format!("{}/device/{}/config", self.discovery, self.id)
    }

    /// Home Assistant's birth message, sent when it starts.
    pub(super) fn birth(&self) -> String {
        format!("{}/status", self.discovery)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uid_cannot_reach_other_topics() {
        let topics = Topics::new("spykee", "homeassistant", "../#/+\u{0}x");
        assert_eq!(topics.command(), "spykee/_______x/command");
        assert_eq!(id_of(""), "robot");
        assert_eq!(id_of(&"a".repeat(1000)).len(), LONGEST_ID);
        assert_eq!(id_of("SPYKEE0001"), "SPYKEE0001");
    }
}
