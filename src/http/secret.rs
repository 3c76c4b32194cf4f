//! Secrets are stored only as SHA-256 digests, which are compared in constant time.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use sha2::{Digest as _, Sha256};
use subtle::ConstantTimeEq as _;

/// Number of random bytes in a token or session: 256 bits cannot be guessed, so no slow hash is
/// needed.
const RANDOM: usize = 32;

/// The digest of a secret. Its debug output reveals nothing.
#[derive(Clone, PartialEq, Eq, Hash)]
pub(super) struct Digest([u8; 32]);

impl Digest {
    pub(super) fn of(secret: &str) -> Digest {
        Digest(Sha256::digest(secret.as_bytes()).into())
    }

    /// Compares two digests in constant time.
    pub(super) fn is(&self, other: &Digest) -> bool {
        self.0.ct_eq(&other.0).into()
    }
}

impl std::fmt::Debug for Digest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Digest")
    }
}

impl Serialize for Digest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&hex(&self.0))
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Digest, D::Error> {
        let text = String::deserialize(from)?;
        let bytes = bytes(&text).and_then(|bytes| bytes.try_into().ok());
        let expected = "64 hexadecimal digits";
        bytes
            .map(Digest)
            .ok_or_else(|| serde::de::Error::custom(format!("expected {expected}")))
    }
}

/// Returns a new secret of 64 hexadecimal digits.
pub(super) fn random() -> String {
    hex(&rand::random::<[u8; RANDOM]>())
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes(text: &str) -> Option<Vec<u8>> {
    let pairs = text.as_bytes().chunks(2);
    let byte = |pair: &[u8]| {
        let digits = std::str::from_utf8(pair)
            .ok()
            .filter(|digits| digits.len() == 2)?;
        u8::from_str_radix(digits, 16).ok()
    };
    pairs.map(byte).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_matches_the_standard_and_its_debug_output_reveals_nothing() {
        // FIPS 180-2, appendix B.1.
        let digest = Digest::of("abc");
        let text = serde_json::to_string(&digest).unwrap();
        let known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(text, format!("\"{known}\""));
        let again: Digest = serde_json::from_str(&text).unwrap();
        assert!(again.is(&digest) && !again.is(&Digest::of("abd")));
        assert_eq!(format!("{digest:?}"), "Digest");
    }

    #[test]
    fn secrets_differ_and_invalid_digests_are_refused() {
        assert_ne!(random(), random());
        assert_eq!(random().len(), 64);
        for wrong in ["\"\"", "\"abc\"", "\"zz\"", "7"] {
            assert!(serde_json::from_str::<Digest>(wrong).is_err(), "{wrong}");
        }
    }
}
