//! The tokens of people and programs: random, shown once, stored as digests in a private file of
//! the data folder.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use data_encoding::HEXLOWER;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use sha2::{Digest as _, Sha256};

use crate::files::{self, Folder, ReadError};

/// Name of the folder, in the data folder beside those of the behaviours.
const FOLDER: &str = ".access";
const FILE: &str = "tokens.json";
const MAX_LEN: u64 = 64 * 1024;
/// Maximum number of tokens per data folder.
const MAX_TOKENS: usize = 100;
const LONGEST_NAME: usize = 40;
/// Prefix of all tokens, by which people and secret scanners recognise them.
const PREFIX: &str = "spykee_";
/// Number of random bytes in a token: 256 bits cannot be guessed, so neither a slow hash nor a
/// limit of attempts is needed.
const RANDOM: usize = 32;

/// What a visitor may do. A viewer may also stop the robot.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    JsonSchema,
    clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// May look and stop the robot.
    Viewer,
    /// May do everything that the page and the API offer.
    Driver,
}

impl Role {
    pub fn name(self) -> &'static str {
        match self {
            Role::Viewer => "viewer",
            Role::Driver => "driver",
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    pub name: String,
    pub role: Role,
    digest: Digest,
}

/// The SHA-256 digest of a token. Its debug output reveals nothing. The time of a comparison may
/// reveal a part of a digest, from which nobody can compute a token.
#[derive(Clone, PartialEq, Eq)]
struct Digest([u8; 32]);

impl Digest {
    fn new(token: &str) -> Digest {
        Digest(Sha256::digest(token.as_bytes()).into())
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Digest")
    }
}

impl Serialize for Digest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&HEXLOWER.encode(&self.0))
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Digest, D::Error> {
        let text = String::deserialize(from)?;
        let bytes = HEXLOWER.decode(text.as_bytes()).ok();
        let digest = bytes.and_then(|bytes| bytes.try_into().ok());
        digest
            .map(Digest)
            .ok_or_else(|| serde::de::Error::custom("expected 64 hexadecimal digits"))
    }
}

/// Why access cannot be set up, or tokens cannot be read or changed.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// Anyone who can reach that address could drive the robot.
    #[error(
        "{0} can be reached from elsewhere, but there is no token: `spykee token new NAME` makes one"
    )]
    Open(SocketAddr),
    /// The file exists, or may exist, but is unusable; no token is accepted.
    #[error("cannot use the tokens in {path}: {why}")]
    Broken { path: String, why: String },
    #[error("cannot write the tokens to {path}: {source}")]
    Write { path: String, source: io::Error },
    #[error("the data folder {path} belongs to another user, who could not read these tokens")]
    Foreign { path: String },
    /// A name that is taken, empty or too long, or too many tokens.
    #[error("{0}")]
    Refused(String),
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keyring {
    data: PathBuf,
    /// `None` if there is no file: no token was ever made.
    keys: Option<Vec<Key>>,
}

impl Keyring {
    /// Reads the tokens; only if there is certainly no file, there are none. Blocks on the disk.
    ///
    /// # Errors
    /// [`AccessError::Broken`], also if other users can read or write the file.
    pub fn open(data: &Path) -> Result<Keyring, AccessError> {
        let path = data.join(FOLDER).join(FILE);
        let broken = |why: String| AccessError::Broken {
            path: path.display().to_string(),
            why,
        };
        let keys = match files::read_private(&path, MAX_LEN) {
            Ok(bytes) => {
                let keys = serde_json::from_slice(&bytes);
                Some(keys.map_err(|error| broken(error.to_string()))?)
            }
            Err(ReadError::Io(error)) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(broken(error.to_string())),
        };
        Ok(Keyring {
            data: data.to_owned(),
            keys,
        })
    }

    pub(super) fn closed(data: &Path) -> Keyring {
        Keyring {
            data: data.to_owned(),
            keys: Some(Vec::new()),
        }
    }

    /// Creates a token and stores its digest. The token itself is only returned here.
    pub fn make(&mut self, name: &str, role: Role) -> Result<String, AccessError> {
        let refused = |why: String| Err(AccessError::Refused(why));
        if name.is_empty()
            || name.chars().count() > LONGEST_NAME
            || name.chars().any(char::is_control)
        {
            return refused(format!("a token's name has 1 to {LONGEST_NAME} characters"));
        }
        if self.list().iter().any(|key| key.name == name) {
            return refused(format!("there is a token `{name}`: revoke it first"));
        }
        if self.list().len() >= MAX_TOKENS {
            return refused(format!("there are {MAX_TOKENS} tokens: revoke some first"));
        }
        let random = HEXLOWER.encode(&rand::random::<[u8; RANDOM]>());
        let token = format!("{PREFIX}{random}");
        self.keys.get_or_insert_default().push(Key {
            name: name.to_owned(),
            role,
            digest: Digest::new(&token),
        });
        self.write()?;
        Ok(token)
    }

    /// Removes a token. Returns whether there was one of this name.
    pub fn revoke(&mut self, name: &str) -> Result<bool, AccessError> {
        let before = self.list().len();
        if let Some(keys) = &mut self.keys {
            keys.retain(|key| key.name != name);
        }
        if self.list().len() == before {
            return Ok(false);
        }
        self.write().map(|()| true)
    }

    pub fn list(&self) -> &[Key] {
        self.keys.as_deref().unwrap_or_default()
    }

    pub(super) fn find(&self, token: &str) -> Option<&Key> {
        let digest = Digest::new(token);
        self.list().iter().find(|key| key.digest == digest)
    }

    /// Whether no token was ever made. Once there was one, revoking it leaves an empty list, which
    /// admits nobody.
    pub(super) fn is_unused(&self) -> bool {
        self.keys.is_none()
    }

    fn write(&self) -> Result<(), AccessError> {
        let owner = self.data.metadata().map(|folder| folder.uid());
        if owner.is_ok_and(|owner| owner != rustix::process::geteuid().as_raw()) {
            let path = self.data.display().to_string();
            return Err(AccessError::Foreign { path });
        }
        let folder = self.data.join(FOLDER);
        let write = || {
            let bytes = serde_json::to_vec_pretty(self.list())?;
            Folder::make(&folder)?.replace_durably(FILE, &bytes)
        };
        write().map_err(|source| AccessError::Write {
            path: folder.join(FILE).display().to_string(),
            source,
        })
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
        let mut keys = Keyring::open(data.path()).unwrap();
        assert!(keys.is_unused());
        let token = keys.make("phone", Role::Viewer).unwrap();
        assert_eq!(token.len(), PREFIX.len() + 64);
        let path = data.path().join(FOLDER).join(FILE);
        let text = fs::read_to_string(&path).unwrap();
        assert!(!text.contains(&token) && text.contains("phone"), "{text}");
        assert_eq!(
            fs::metadata(&path).unwrap().permissions().mode() & 0o777,
            0o600
        );
        let mut keys = Keyring::open(data.path()).unwrap();
        assert_eq!(keys.find(&token), Some(&keys.list()[0]));
        assert_eq!(keys.find("spykee_"), None);
        assert!(
            keys.make("phone", Role::Driver).is_err(),
            "a name is taken once"
        );
        assert!(keys.revoke("phone").unwrap() && !keys.revoke("phone").unwrap());
        let emptied = Keyring::open(data.path()).unwrap();
        assert_eq!(emptied.find(&token), None);
        assert!(!emptied.is_unused(), "an emptied list admits nobody");
    }

    #[test]
    fn tokens_that_cannot_be_read_are_an_error_and_not_an_empty_list() {
        let data = tempfile::tempdir().unwrap();
        let mut keys = Keyring::open(data.path()).unwrap();
        keys.make("phone", Role::Viewer).unwrap();
        let path = data.path().join(FOLDER).join(FILE);
        fs::set_permissions(&path, Permissions::from_mode(0o644)).unwrap();
        assert!(Keyring::open(data.path()).is_err(), "others can read it");
        fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
        for content in [
            "[{]",
            "[{\"name\":\"a\",\"role\":\"driver\",\"digest\":\"zz\"}]",
        ] {
            fs::write(&path, content).unwrap();
            assert!(Keyring::open(data.path()).is_err(), "{content}");
        }
        fs::remove_file(&path).unwrap();
        fs::create_dir(&path).unwrap();
        assert!(Keyring::open(data.path()).is_err(), "it is a folder");
        fs::remove_dir_all(data.path().join(FOLDER)).unwrap();
        fs::write(data.path().join(FOLDER), "").unwrap();
        assert!(Keyring::open(data.path()).is_err(), "its folder is a file");
    }

    #[test]
    fn a_digest_matches_the_standard_and_its_debug_output_reveals_nothing() {
        // FIPS 180-2, appendix B.1.
        let digest = Digest::new("abc");
        let text = serde_json::to_string(&digest).unwrap();
        let known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(text, format!("\"{known}\""));
        assert_eq!(serde_json::from_str::<Digest>(&text).unwrap(), digest);
        assert_eq!(format!("{digest:?}"), "Digest");
    }
}
