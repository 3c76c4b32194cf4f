//! Length-prefixed ISO-8859-1 text, as used in logins and their replies (`PROTOCOL.md`,
//! AUTH_REQUEST, and `PROTOCOL.md`, AUTH_REPLY).

use bytes::BytesMut;

/// The longest text that the one-byte length prefix allows.
pub(super) const MAX_TEXT_LEN: usize = u8::MAX as usize;

/// Appends `text` after its length. Characters outside ISO-8859-1 become `?`; text beyond
/// [`MAX_TEXT_LEN`] bytes is cut off.
pub(super) fn emit_prefixed(text: &str, out: &mut BytesMut) {
    let latin = text
        .chars()
        .map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?'));
    let bytes: Vec<u8> = latin.take(MAX_TEXT_LEN).collect();
    out.extend_from_slice(&[bytes.len() as u8]);
    out.extend_from_slice(&bytes);
}

/// Takes one prefixed text from the front of `input`; `None` if it is truncated.
pub(super) fn parse_prefixed(input: &mut &[u8]) -> Option<String> {
    let (&length, rest) = input.split_first()?;
    let (text, rest) = rest.split_at_checked(usize::from(length))?;
    *input = rest;
    Some(from_latin1(text))
}

/// Cannot fail: every byte is the code of a character.
pub(super) fn from_latin1(bytes: &[u8]) -> String {
    bytes.iter().map(|&byte| char::from(byte)).collect()
}
