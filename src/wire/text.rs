//! Length-prefixed ISO-8859-1 text, as logins and their answers carry it (`PROTOCOL.md`,
//! AUTH_REQUEST, and `PROTOCOL.md`, AUTH_REPLY).

use bytes::BytesMut;

/// The longest text that the one-byte prefix can announce.
pub(super) const MAX_TEXT_LEN: usize = u8::MAX as usize;

/// Appends `text` with its length in front. Characters outside ISO-8859-1 become `?`; what is over
/// [`MAX_TEXT_LEN`] bytes is cut.
pub(super) fn emit_prefixed(text: &str, out: &mut BytesMut) {
    let latin = text
        .chars()
        .map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?'));
    let bytes: Vec<u8> = latin.take(MAX_TEXT_LEN).collect();
    out.extend_from_slice(&[bytes.len() as u8]);
    out.extend_from_slice(&bytes);
}

/// Takes one prefixed text off the front of `input`; `None` if it is cut short.
pub(super) fn parse_prefixed(input: &mut &[u8]) -> Option<String> {
    let (&length, rest) = input.split_first()?;
    let (text, rest) = rest.split_at_checked(usize::from(length))?;
    *input = rest;
    Some(from_latin1(text))
}

/// Every byte is a character of the same number: this cannot fail.
pub(super) fn from_latin1(bytes: &[u8]) -> String {
    bytes.iter().map(|&byte| char::from(byte)).collect()
}
