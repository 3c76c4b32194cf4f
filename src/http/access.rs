//! Access control: the config's passwords, the tokens of programs, the sessions of browsers.

use std::net::{IpAddr, SocketAddr};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

use super::attempts::Attempts;
use super::guard::{Names, OriginHeaders, Reason};
use super::keyring::{Keyring, KeyringError};
use super::options::Options;
use super::role::{Role, Visitor};
use super::secret::Digest;
use super::sessions::Sessions;
use crate::files;

/// Maximum length of a password file and of a password, in bytes.
const MAX_FILE_LEN: u64 = 4096;
const MAX_PASSWORD: usize = 1024;

/// Why access cannot be set up.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// Anyone who can reach that address could drive the robot.
    #[error(
        "{0} can be reached from elsewhere, but there is neither a password nor a token: \
         `spykee token new NAME` creates a token, `live: {{ driver_password_file: FILE }}` sets a password"
    )]
    Open(SocketAddr),
    /// A password cannot be read.
    #[error("cannot read the password file {path}: {why}")]
    Password {
        /// Which.
        path: String,
        /// Why.
        why: String,
    },
    /// The tokens cannot be read.
    #[error(transparent)]
    Tokens(#[from] KeyringError),
}

/// Why access was denied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Denied {
    #[error("wrong password or token")]
    Wrong,
    #[error("too many attempts: wait {} s", .0.as_secs() + 1)]
    TooMany(Duration),
}

/// See the module.
#[derive(Debug)]
pub struct Access {
    names: Names,
    passwords: Vec<(Digest, Role)>,
    keyring: Keyring,
    sessions: Mutex<Sessions>,
    attempts: Mutex<Attempts>,
}

impl Access {
    /// Sets up access according to the options and the tokens of this data folder, for a server on
    /// this address. Blocks on the disk.
    ///
    /// # Errors
    /// See [`AccessError`].
    pub fn new(options: &Options, listen: SocketAddr, data: &Path) -> Result<Access, AccessError> {
        let files = [
            (&options.driver_password_file, Role::Driver),
            (&options.viewer_password_file, Role::Viewer),
        ];
        let mut passwords = Vec::new();
        for (path, role) in files {
            if let Some(path) = path {
                passwords.push((Digest::of(&password(path)?), role));
            }
        }
        let access = Access {
            names: Names::new(listen, &options.hosts),
            passwords,
            keyring: Keyring::open(data)?,
            sessions: Mutex::default(),
            attempts: Mutex::new(Attempts::new(Instant::now())),
        };
        if access.is_open() && !listen.ip().is_loopback() {
            Err(AccessError::Open(listen))
        } else {
            Ok(access)
        }
    }

    /// Whether no login is needed: on loopback, with neither a password nor a token.
    pub fn is_open(&self) -> bool {
        self.passwords.is_empty() && self.keyring.is_empty()
    }

    /// Whether people can log in; with tokens alone only programs can.
    pub(super) fn has_passwords(&self) -> bool {
        !self.passwords.is_empty()
    }

    /// # Errors
    /// If the request is not addressed to us, or comes from another site's page.
    pub(super) fn validate(&self, request: OriginHeaders<'_>) -> Result<(), Reason> {
        self.names.validate(request)
    }

    /// Opens a session with a password or a token.
    ///
    /// # Errors
    /// See [`Denied`].
    pub(super) fn log_in(&self, from: IpAddr, password: &str) -> Result<(String, Role), Denied> {
        let now = Instant::now();
        let tried = lock(&self.attempts).take(from, now);
        tried.map_err(Denied::TooMany)?;
        let known = (password.len() <= MAX_PASSWORD)
            .then(|| self.role_of(password))
            .flatten();
        let role = known.ok_or(Denied::Wrong)?;
        lock(&self.attempts).give_back(from);
        Ok((lock(&self.sessions).open(role, now), role))
    }

    /// Compares all of them, so that the time taken reveals nothing.
    fn role_of(&self, password: &str) -> Option<Role> {
        let digest = Digest::of(password);
        let mut known = self.keyring.find(password).map(|token| token.role);
        for (password, role) in &self.passwords {
            if password.is(&digest) {
                known = known.max(Some(*role));
            }
        }
        known
    }

    pub(super) fn log_out(&self, session: &str) {
        lock(&self.sessions).close(session);
    }

    /// Returns the visitor with this session, or without any.
    pub(super) fn of_session(&self, session: Option<&str>) -> Option<Visitor> {
        let role = if self.is_open() {
            Some(Role::Driver)
        } else {
            lock(&self.sessions).role(session?, Instant::now())
        };
        role.map(|role| Visitor { role, token: None })
    }

    /// Returns the visitor with this token.
    ///
    /// # Errors
    /// See [`Denied`]; wrong tokens count as attempts.
    pub(super) fn of_token(&self, from: IpAddr, token: &str) -> Result<Visitor, Denied> {
        lock(&self.attempts)
            .take(from, Instant::now())
            .map_err(Denied::TooMany)?;
        let found = self.keyring.find(token).ok_or(Denied::Wrong)?;
        lock(&self.attempts).give_back(from);
        let (role, token) = (found.role, Some(found.name));
        Ok(Visitor { role, token })
    }
}

/// Locks shared state; only for short lookups.
fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

fn password(path: &Path) -> Result<String, AccessError> {
    let refused = |why: String| AccessError::Password {
        path: path.display().to_string(),
        why,
    };
    let read = files::read_private(path, MAX_FILE_LEN);
    let bytes = read.map_err(|error| refused(error.to_string()))?;
    let text = String::from_utf8(bytes).map_err(|_| refused("it is not UTF-8".to_owned()))?;
    match text.lines().next().unwrap_or_default() {
        line if line.chars().count() < 8 => Err(refused(
            "its first line is not a password of at least 8 characters".to_owned(),
        )),
        line => Ok(line.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, Permissions};
    use std::os::unix::fs::PermissionsExt as _;

    const HERE: IpAddr = IpAddr::V4(std::net::Ipv4Addr::LOCALHOST);

    fn access(listen: &str, password: Option<&str>) -> Result<Access, AccessError> {
        let data = tempfile::tempdir().unwrap();
        let path = data.path().join("password");
        let driver_password_file = password.map(|password| {
            fs::write(&path, password).unwrap();
            fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
            path.clone()
        });
        let options = Options {
            driver_password_file,
            ..Options::default()
        };
        Access::new(&options, listen.parse().unwrap(), data.path())
    }

    #[test]
    fn off_loopback_a_password_is_required() {
        assert!(matches!(
            access("0.0.0.0:1", None),
            Err(AccessError::Open(_))
        ));
        assert!(matches!(
            access("192.168.1.2:1", None),
            Err(AccessError::Open(_))
        ));
        assert!(access("127.0.0.1:1", None).unwrap().is_open());
        let guarded = access("0.0.0.0:1", Some("correct horse\n")).unwrap();
        assert_eq!(guarded.of_session(None), None);
        assert_eq!(guarded.log_in(HERE, "correct"), Err(Denied::Wrong));
        let (session, role) = guarded.log_in(HERE, "correct horse").unwrap();
        assert_eq!(role, Role::Driver);
        assert!(guarded.of_session(Some(&session)).is_some());
        guarded.log_out(&session);
        assert_eq!(guarded.of_session(Some(&session)), None);
        assert!(matches!(
            access("0.0.0.0:1", Some("short")),
            Err(AccessError::Password { .. })
        ));
    }

    #[test]
    fn with_a_password_loopback_needs_it_too_because_of_proxies() {
        let guarded = access("127.0.0.1:1", Some("correct horse")).unwrap();
        assert!(!guarded.is_open());
        assert_eq!(guarded.of_session(None), None);
    }

    #[test]
    fn guessing_is_slow_even_if_a_guess_is_right() {
        let guarded = access("127.0.0.1:1", Some("correct horse")).unwrap();
        let wrong = || guarded.log_in(HERE, "guess");
        let denied = (0..20).map(|_| wrong().unwrap_err());
        assert_eq!(denied.filter(|denied| *denied == Denied::Wrong).count(), 5);
        assert!(matches!(
            guarded.log_in(HERE, "correct horse"),
            Err(Denied::TooMany(_))
        ));
        assert!(guarded.of_token(HERE, "spykee_x").is_err());
    }
}
