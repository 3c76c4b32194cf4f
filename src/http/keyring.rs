//! Tokens of programs: random, shown once, kept as digests in a private file of the data folder.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::role::Role;
use super::secret::{Digest, random};
use crate::files::{self, Folder};

/// In the data folder, beside the behaviours' own.
const FOLDER: &str = ".access";
const FILE: &str = "tokens.json";
const MAX_LEN: u64 = 64 * 1024;
/// Tokens of one data folder.
const MOST: usize = 100;
/// Characters of a name.
const LONGEST_NAME: usize = 40;
/// All tokens begin so, so that people and scanners know one when they see it.
pub(super) const PREFIX: &str = "spykee_";

/// A token that is known.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Key {
    name: String,
    role: Role,
    digest: Digest,
}

/// What may be told of a token.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listed {
    /// What its owner calls it.
    pub name: String,
    /// What it is good for.
    pub role: Role,
}

/// Why tokens cannot be read or changed.
#[derive(Debug, thiserror::Error)]
pub enum KeyringError {
    /// The file is there and not usable; no token is accepted then.
    #[error("cannot use the tokens in {path}: {why}")]
    Broken {
        /// Which.
        path: String,
        /// Why.
        why: String,
    },
    /// Not writable.
    #[error("cannot write the tokens to {path}: {source}")]
    Write {
        /// Where.
        path: String,
        /// The system's words.
        source: io::Error,
    },
    /// A name that is taken, empty or too long, or too many tokens.
    #[error("{0}")]
    Refused(String),
}

/// The tokens of a data folder.
#[derive(Debug, Clone, Default)]
pub struct Keyring {
    folder: PathBuf,
    keys: Vec<Key>,
}

impl Keyring {
    /// Reads them; none if there is no file. Waits for the disk.
    ///
    /// # Errors
    /// [`KeyringError::Broken`]: also if others can read or write the file.
    pub fn open(data: &Path) -> Result<Keyring, KeyringError> {
        let folder = data.join(FOLDER);
        let path = folder.join(FILE);
        if !path.exists() {
            return Ok(Keyring {
                folder,
                keys: Vec::new(),
            });
        }
        let broken = |why: String| KeyringError::Broken {
            path: path.display().to_string(),
            why,
        };
        let read = files::read_private(&path, MAX_LEN);
        let bytes = read.map_err(|error| broken(error.to_string()))?;
        let keys = serde_json::from_slice(&bytes).map_err(|error| broken(error.to_string()))?;
        Ok(Keyring { folder, keys })
    }

    /// Makes a token and keeps its digest: the one time that it is seen.
    ///
    /// # Errors
    /// See [`KeyringError`].
    pub fn make(&mut self, name: &str, role: Role) -> Result<String, KeyringError> {
        let refused = |why: String| Err(KeyringError::Refused(why));
        if name.is_empty()
            || name.chars().count() > LONGEST_NAME
            || name.chars().any(char::is_control)
        {
            return refused(format!("a token's name has 1 to {LONGEST_NAME} characters"));
        }
        if self.keys.iter().any(|key| key.name == name) {
            return refused(format!("there is a token `{name}`: revoke it first"));
        }
        if self.keys.len() >= MOST {
            return refused(format!("there are {MOST} tokens: revoke some first"));
        }
        let token = format!("{PREFIX}{}", random());
        let (name, digest) = (name.to_owned(), Digest::of(&token));
        self.keys.push(Key { name, role, digest });
        self.write()?;
        Ok(token)
    }

    /// Takes a token away; whether there was one of this name. A run that is on learns of it when it is
    /// started anew.
    ///
    /// # Errors
    /// [`KeyringError::Write`].
    pub fn revoke(&mut self, name: &str) -> Result<bool, KeyringError> {
        let before = self.keys.len();
        self.keys.retain(|key| key.name != name);
        if self.keys.len() == before {
            return Ok(false);
        }
        self.write().map(|()| true)
    }

    /// What there is.
    pub fn list(&self) -> Vec<Listed> {
        let listed = |key: &Key| Listed {
            name: key.name.clone(),
            role: key.role,
        };
        self.keys.iter().map(listed).collect()
    }

    /// Whose token it is.
    pub(super) fn find(&self, token: &str) -> Option<Listed> {
        let digest = Digest::of(token);
        // All are compared: how long it takes tells nothing.
        let mut found = None;
        for key in &self.keys {
            if key.digest.is(&digest) {
                found = Some(Listed {
                    name: key.name.clone(),
                    role: key.role,
                });
            }
        }
        found
    }

    pub(super) fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    fn write(&self) -> Result<(), KeyringError> {
        let path = self.folder.join(FILE).display().to_string();
        let written = serde_json::to_vec_pretty(&self.keys).map_err(io::Error::from);
        let written =
            written.and_then(|bytes| Folder::make(&self.folder)?.replace_durably(FILE, &bytes));
        written.map_err(|source| KeyringError::Write { path, source })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, Permissions};
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn a_token_is_kept_as_a_digest_in_a_private_file() {
        let data = tempfile::tempdir().unwrap();
        let token = Keyring::open(data.path())
            .unwrap()
            .make("phone", Role::Viewer)
            .unwrap();
        let path = data.path().join(FOLDER).join(FILE);
        let text = fs::read_to_string(&path).unwrap();
        assert!(!text.contains(&token) && text.contains("phone"), "{text}");
        assert_eq!(
            fs::metadata(&path).unwrap().permissions().mode() & 0o777,
            0o600
        );
        let mut keys = Keyring::open(data.path()).unwrap();
        assert_eq!(keys.find(&token), Some(keys.list()[0].clone()));
        assert_eq!(keys.find("spykee_"), None);
        assert!(
            keys.make("phone", Role::Driver).is_err(),
            "a name is taken once"
        );
        assert!(keys.revoke("phone").unwrap() && !keys.revoke("phone").unwrap());
        assert_eq!(Keyring::open(data.path()).unwrap().find(&token), None);
    }

    #[test]
    fn a_file_that_others_can_read_or_that_is_broken_lets_nobody_in() {
        let data = tempfile::tempdir().unwrap();
        Keyring::open(data.path())
            .unwrap()
            .make("phone", Role::Viewer)
            .unwrap();
        let path = data.path().join(FOLDER).join(FILE);
        fs::set_permissions(&path, Permissions::from_mode(0o644)).unwrap();
        assert!(Keyring::open(data.path()).is_err());
        fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
        fs::write(&path, "[{]").unwrap();
        assert!(Keyring::open(data.path()).is_err());
    }
}
