//! The tokens of programs: random, shown once, stored as digests in a private file of the data
//! folder.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::role::Role;
use super::secret::{Digest, random};
use crate::files::{self, Folder};

/// Name of the folder, in the data folder beside those of the behaviours.
const FOLDER: &str = ".access";
const FILE: &str = "tokens.json";
const MAX_LEN: u64 = 64 * 1024;
/// Maximum number of tokens per data folder.
const MAX_TOKENS: usize = 100;
/// Maximum length of a name, in characters.
const LONGEST_NAME: usize = 40;
/// Prefix of all tokens, by which people and secret scanners recognise them.
pub(super) const PREFIX: &str = "spykee_";

/// A known token.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Key {
    name: String,
    role: Role,
    digest: Digest,
}

/// The public information about a token.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listed {
    /// The name given by its owner.
    pub name: String,
    /// The role that it grants.
    pub role: Role,
}

/// Why tokens cannot be read or changed.
#[derive(Debug, thiserror::Error)]
pub enum KeyringError {
    /// The file exists but is unusable; no token is accepted.
    #[error("cannot use the tokens in {path}: {why}")]
    Broken {
        /// The file.
        path: String,
        /// Why.
        why: String,
    },
    /// The file cannot be written.
    #[error("cannot write the tokens to {path}: {source}")]
    Write {
        /// The file.
        path: String,
        /// The error of the system.
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
    /// Reads the tokens; none if there is no file. Blocks on the disk.
    ///
    /// # Errors
    /// [`KeyringError::Broken`], also if other users can read or write the file.
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

    /// Creates a token and stores its digest. The token itself is only returned here.
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
        if self.keys.len() >= MAX_TOKENS {
            return refused(format!("there are {MAX_TOKENS} tokens: revoke some first"));
        }
        let token = format!("{PREFIX}{}", random());
        let (name, digest) = (name.to_owned(), Digest::of(&token));
        self.keys.push(Key { name, role, digest });
        self.write()?;
        Ok(token)
    }

    /// Removes a token. Returns whether there was one of this name. An active run uses the change
    /// after its next start.
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

    /// Lists the tokens.
    pub fn list(&self) -> Vec<Listed> {
        let listed = |key: &Key| Listed {
            name: key.name.clone(),
            role: key.role,
        };
        self.keys.iter().map(listed).collect()
    }

    /// Returns the entry of a token, if it is known.
    pub(super) fn find(&self, token: &str) -> Option<Listed> {
        let digest = Digest::of(token);
        // Compare all of them, so that the time taken reveals nothing.
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
    fn a_file_that_others_can_read_or_that_is_broken_is_refused() {
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
