//! Access control: who may use the page and the API. Everybody on loopback as long as no token was
//! ever made; else whoever has a token, until it is revoked.

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::extract::FromRequestParts;
use axum::http::StatusCode;
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};
use parking_lot::Mutex;
use tokio::sync::watch;
use tokio::time::Instant;

use super::Options;
use super::keyring::{AccessError, Key, Keyring, Role};
use super::origin_check::Names;
use crate::clock::every;
use crate::rate_limit::Repeats;

/// How often the tokens are read again.
const REREAD: Duration = Duration::from_secs(1);
const WRONG_TOKENS: Duration = Duration::from_secs(60);

/// The host names under which we are reached, and the tokens.
#[derive(Debug)]
pub struct Access {
    pub(super) names: Names,
    data: PathBuf,
    keyring: watch::Sender<Keyring>,
    /// The wrong tokens, which are logged once in a while.
    wrong: Mutex<Repeats<()>>,
}

impl Access {
    /// Sets up access according to the options and the tokens of this data folder, for a server on
    /// this address. Blocks on the disk.
    pub fn new(options: &Options, listen: SocketAddr, data: &Path) -> Result<Access, AccessError> {
        let keyring = Keyring::open(data)?;
        if keyring.is_unused() && !listen.ip().is_loopback() {
            return Err(AccessError::Open(listen));
        }
        Ok(Access {
            names: Names::new(listen, &options.hosts, &host_name()),
            data: data.to_owned(),
            keyring: watch::Sender::new(keyring),
            wrong: Mutex::new(Repeats::new(WRONG_TOKENS)),
        })
    }

    /// Whether no login is needed: on loopback, if no token was ever made.
    pub fn is_open(&self) -> bool {
        self.keyring.borrow().is_unused()
    }

    pub(super) fn visitor(&self, token: Option<&str>) -> Option<Visitor> {
        let keyring = self.keyring.borrow();
        if keyring.is_unused() {
            return Some(Visitor::new(Role::Driver, None));
        }
        let key = keyring.find(token?)?.clone();
        Some(Visitor::new(key.role, Some(key)))
    }

    /// Returns the visitor with this token; `None` for a wrong one, which is logged.
    pub(super) fn visitor_of_token(&self, token: &str, from: IpAddr) -> Option<Visitor> {
        let visitor = self
            .visitor(Some(token))
            .filter(|visitor| visitor.key.is_some());
        if visitor.is_none() {
            let mut wrong = self.wrong.lock();
            if let Some(before) = wrong.record((), Instant::now()) {
                let count = before + 1;
                tracing::warn!(%from, "{count} requests with a wrong token");
            }
        }
        visitor
    }

    pub async fn revoked(&self, visitor: &Visitor) {
        let lost = |keyring: &Keyring| match &visitor.key {
            Some(key) => !keyring.list().contains(key),
            None => !keyring.is_unused(),
        };
        // Fails only when this is dropped.
        let _ = self.keyring.subscribe().wait_for(lost).await;
    }

    /// Reads the tokens again and again, so that a new or a revoked one counts within a
    /// second. Never returns.
    pub async fn follow_tokens(self: Arc<Access>) {
        let mut beat = every(REREAD);
        let mut trouble = None;
        loop {
            beat.tick().await;
            let access = self.clone();
            let reread = tokio::task::spawn_blocking(move || access.reread()).await;
            let error = reread
                .unwrap_or(Ok(()))
                .err()
                .map(|error| error.to_string());
            if let Some(error) = &error
                && trouble.as_ref() != Some(error)
            {
                tracing::error!("{error}: until it can be read, nobody has access to the page");
            }
            trouble = error;
        }
    }

    /// Reads the tokens again. If that fails, nobody has access. Where a token was needed, one
    /// stays needed even if the file is gone.
    fn reread(&self) -> Result<(), AccessError> {
        let read = Keyring::open(&self.data);
        self.keyring.send_if_modified(|keyring| {
            let next = match &read {
                Ok(next) if !next.is_unused() || keyring.is_unused() => next.clone(),
                _ => Keyring::closed(&self.data),
            };
            let changed = *keyring != next;
            *keyring = next;
            changed
        });
        read.map(drop)
    }
}

/// The name of this computer; empty if it cannot be read.
fn host_name() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    name.trim().to_owned()
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Visitor {
    pub role: Role,
    /// The token used; `None` if none is needed.
    pub key: Option<Key>,
    /// The user ID of a program on this computer that uses the private socket.
    pub user: Option<u32>,
}

impl Visitor {
    pub(super) fn new(role: Role, key: Option<Key>) -> Visitor {
        Visitor {
            role,
            key,
            user: None,
        }
    }

    /// A program of this user on this computer: what it may do to the process it may do here.
    pub(super) fn local(user: u32) -> Visitor {
        Visitor {
            user: Some(user),
            ..Visitor::new(Role::Driver, None)
        }
    }

    /// Whether the visitor may do what needs this role.
    pub fn require(&self, role: Role) -> Result<(), Refusal> {
        if role == Role::Driver && self.role != Role::Driver {
            let why = "viewers may only watch and stop the robot";
            return Err(Refusal::new(StatusCode::FORBIDDEN, why));
        }
        Ok(())
    }

    /// Who this is, for the journal; `way` is what a visitor from the network uses.
    pub fn describe(&self, way: &str) -> String {
        match (self.user, &self.key) {
            (Some(user), _) => format!("the command line, user ID {user}"),
            (None, Some(key)) => format!("{way}, token {}", key.name),
            (None, None) => format!("{way}, without a token"),
        }
    }
}

impl<S: Sync> FromRequestParts<S> for Visitor {
    type Rejection = Refusal;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Visitor, Refusal> {
        match parts.extensions.get::<Option<Visitor>>() {
            Some(Some(visitor)) => Ok(visitor.clone()),
            _ => {
                let why = "log in first, or send a token";
                Err(Refusal::new(StatusCode::UNAUTHORIZED, why))
            }
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{error}")]
pub struct Refusal {
    status: StatusCode,
    error: String,
}

impl Refusal {
    pub fn new(status: StatusCode, error: impl Into<String>) -> Refusal {
        Refusal {
            status,
            error: error.into(),
        }
    }

    pub(super) fn wrong_token() -> Refusal {
        Refusal::new(StatusCode::UNAUTHORIZED, "wrong token")
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let body = serde_json::json!({ "error": self.error });
        (self.status, Json(body)).into_response()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, Permissions};
    use std::os::unix::fs::PermissionsExt as _;

    const HERE: IpAddr = IpAddr::V4(std::net::Ipv4Addr::LOCALHOST);

    fn access(listen: &str, data: &Path) -> Result<Access, AccessError> {
        Access::new(&Options::default(), listen.parse().unwrap(), data)
    }

    #[test]
    fn a_token_is_required_off_loopback_and_wherever_there_is_one() {
        let data = tempfile::tempdir().unwrap();
        for listen in ["0.0.0.0:1", "192.168.1.2:1"] {
            let refused = access(listen, data.path());
            assert!(matches!(refused, Err(AccessError::Open(_))), "{listen}");
        }
        assert!(access("127.0.0.1:1", data.path()).unwrap().is_open());
        let mut keys = Keyring::open(data.path()).unwrap();
        let token = keys.make("tv", Role::Viewer).unwrap();
        // On loopback, too: a proxy may stand in front of it.
        for listen in ["0.0.0.0:1", "127.0.0.1:1"] {
            let guarded = access(listen, data.path()).unwrap();
            assert!(!guarded.is_open());
            assert_eq!(guarded.visitor(None), None);
            assert_eq!(guarded.visitor(Some("spykee_")), None);
            let visitor = guarded.visitor_of_token(&token, HERE).unwrap();
            assert_eq!(visitor.role, Role::Viewer);
        }
    }

    #[test]
    fn a_token_that_is_made_or_revoked_counts_at_the_next_reading() {
        let data = tempfile::tempdir().unwrap();
        let access = access("127.0.0.1:1", data.path()).unwrap();
        assert!(access.visitor(None).is_some());
        let mut keys = Keyring::open(data.path()).unwrap();
        let token = keys.make("pad", Role::Driver).unwrap();
        access.reread().unwrap();
        assert_eq!(access.visitor(None), None);
        assert!(access.visitor(Some(&token)).is_some());
        keys.revoke("pad").unwrap();
        access.reread().unwrap();
        assert_eq!(access.visitor(Some(&token)), None);
        assert!(!access.is_open(), "the last token was revoked");
        fs::remove_dir_all(data.path().join(".access")).unwrap();
        access.reread().unwrap();
        assert!(!access.is_open(), "the file is gone");
    }

    #[test]
    fn while_the_tokens_cannot_be_read_nobody_has_access() {
        let data = tempfile::tempdir().unwrap();
        let mut keys = Keyring::open(data.path()).unwrap();
        let token = keys.make("pad", Role::Driver).unwrap();
        let access = access("127.0.0.1:1", data.path()).unwrap();
        let file = data.path().join(".access/tokens.json");
        fs::set_permissions(&file, Permissions::from_mode(0o644)).unwrap();
        assert!(access.reread().is_err());
        assert_eq!(access.visitor(Some(&token)), None);
        assert_eq!(access.visitor(None), None);
        fs::set_permissions(&file, Permissions::from_mode(0o600)).unwrap();
        access.reread().unwrap();
        assert!(access.visitor(Some(&token)).is_some());
    }
}
