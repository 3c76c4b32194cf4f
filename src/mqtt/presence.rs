//! Whether an agent is connected to its broker, as retained there.

use serde::{Deserialize, Serialize};

/// Whether an agent is connected to its broker, in the terms of VDA 5050.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum Presence {
    /// The agent is connected.
    Online,
    /// The agent has disconnected.
    Offline,
    /// The connection broke: the broker publishes this on the agent's behalf.
    ConnectionBroken,
}

impl Presence {
    const ALL: [Presence; 3] = [
        Presence::Online,
        Presence::Offline,
        Presence::ConnectionBroken,
    ];

    /// Returns the word used as the payload.
    pub fn word(self) -> &'static str {
        match self {
            Presence::Online => "ONLINE",
            Presence::Offline => "OFFLINE",
            Presence::ConnectionBroken => "CONNECTIONBROKEN",
        }
    }

    /// Parses a payload; `None` if it is not one of the words.
    pub(super) fn parse(payload: &[u8]) -> Option<Presence> {
        let mut all = Presence::ALL.into_iter();
        all.find(|presence| presence.word().as_bytes() == payload)
    }
}
