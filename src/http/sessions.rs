//! The sessions of logged-in visitors, kept in memory only: they end with the program.

use std::time::Duration;

use tokio::time::Instant;

use super::role::Role;
use super::secret::{Digest, random};

/// Maximum number of sessions; the oldest one is removed to make room.
const MAX_SESSIONS: usize = 256;
/// Lifetime of a session.
pub(super) const LIFE: Duration = Duration::from_secs(7 * 24 * 60 * 60);

#[derive(Debug)]
struct Session {
    digest: Digest,
    role: Role,
    until: Instant,
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Sessions(Vec<Session>);

impl Sessions {
    /// Opens a session and returns its secret.
    pub(super) fn open(&mut self, role: Role, now: Instant) -> String {
        let secret = random();
        if self.0.len() >= MAX_SESSIONS {
            self.0.remove(0);
        }
        let (digest, until) = (Digest::of(&secret), now + LIFE);
        self.0.push(Session {
            digest,
            role,
            until,
        });
        secret
    }

    /// Returns the role of the session with this secret.
    pub(super) fn role(&mut self, secret: &str, now: Instant) -> Option<Role> {
        self.0.retain(|session| session.until > now);
        let digest = Digest::of(secret);
        self.0
            .iter()
            .find(|session| session.digest.is(&digest))
            .map(|session| session.role)
    }

    /// Ends the session with this secret.
    pub(super) fn close(&mut self, secret: &str) {
        let digest = Digest::of(secret);
        self.0.retain(|session| !session.digest.is(&digest));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_ends_by_logging_out_by_age_and_when_there_are_too_many() {
        let now = Instant::now();
        let mut sessions = Sessions::default();
        let one = sessions.open(Role::Viewer, now);
        let other = sessions.open(Role::Driver, now);
        assert_eq!(sessions.role(&one, now), Some(Role::Viewer));
        assert_eq!(sessions.role("", now), None);
        sessions.close(&one);
        assert_eq!(sessions.role(&one, now), None);
        assert_eq!(sessions.role(&other, now), Some(Role::Driver));
        (0..MAX_SESSIONS).for_each(|_| drop(sessions.open(Role::Viewer, now)));
        assert_eq!(
            (sessions.0.len(), sessions.role(&other, now)),
            (MAX_SESSIONS, None)
        );
        sessions.role("", now + LIFE);
        assert!(sessions.0.is_empty());
    }
}
