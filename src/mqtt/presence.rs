//! Whether an agent is at its broker, as the broker keeps it.

use serde::{Deserialize, Serialize};

/// Whether an agent is at its broker, in the words of VDA 5050.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum Presence {
    /// It is.
    Online,
    /// It has logged off.
    Offline,
    /// It is gone, or out of reach: the broker says so for it.
    ConnectionBroken,
}

impl Presence {
    const ALL: [Presence; 3] = [
        Presence::Online,
        Presence::Offline,
        Presence::ConnectionBroken,
    ];

    /// As it stands in the topic.
    pub fn word(self) -> &'static str {
        match self {
            Presence::Online => "ONLINE",
            Presence::Offline => "OFFLINE",
            Presence::ConnectionBroken => "CONNECTIONBROKEN",
        }
    }

    /// `None`: no such word.
    pub(super) fn of(payload: &[u8]) -> Option<Presence> {
        let mut all = Presence::ALL.into_iter();
        all.find(|presence| presence.word().as_bytes() == payload)
    }
}
