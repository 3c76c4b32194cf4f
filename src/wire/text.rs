//! Texts on the wire, in ISO-8859-1 (`PROTOCOL.md`, AUTH_REQUEST, CONFIG, WIRELESS_NETWORKS). No
//! escape sequences are known: separators are always taken literally.

use bytes::{Bytes, BytesMut};

pub(super) const MAX_TEXT_LEN: usize = u8::MAX as usize;

/// Appends `text` after its length. Characters outside ISO-8859-1 become `?`; text beyond
/// [`MAX_TEXT_LEN`] bytes is cut off.
pub(super) fn emit_prefixed(text: &str, out: &mut BytesMut) {
    let bytes: Vec<u8> = to_latin1(text).take(MAX_TEXT_LEN).collect();
    out.extend_from_slice(&[bytes.len() as u8]);
    out.extend_from_slice(&bytes);
}

/// Takes one prefixed text from the front of `input`; `None` if it is truncated.
pub(super) fn parse_prefixed(input: &mut &[u8]) -> Option<String> {
    let (&length, rest) = input.split_first()?;
    let (text, rest) = rest.split_at_checked(usize::from(length))?;
    *input = rest;
    Some(latin1(text))
}

/// One setting of the robot's configuration.
#[derive(Clone, PartialEq, Eq)]
pub struct Setting {
    /// Its name.
    pub key: String,
    /// Its value; empty if the text has no `=`.
    pub value: String,
}

/// Hides the value, which may be a Wi-Fi key.
impl std::fmt::Debug for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Setting { key, value } = self;
        write!(
            f,
            "Setting {{ key: {key:?}, value: {} bytes }}",
            value.len()
        )
    }
}

/// One wireless network that the robot sees.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Network {
    /// Its name; may be empty or contain colons.
    pub essid: String,
    /// As the robot names it; the possible values are unknown.
    pub encryption: String,
    /// Signal strength in an unknown unit of the robot; `None` if it is not a number.
    pub strength: Option<i32>,
}

/// Decodes a payload as ISO-8859-1; every byte is a character.
pub fn latin1(payload: &[u8]) -> String {
    payload.iter().map(|&byte| char::from(byte)).collect()
}

/// Encodes a text as ISO-8859-1; other characters become `?`.
pub fn to_latin1(text: &str) -> impl Iterator<Item = u8> {
    text.chars()
        .map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?'))
}

/// Parses the joined text of CONFIG messages. Parts without a key are skipped.
pub fn parse_settings(payload: &[u8]) -> Vec<Setting> {
    let text = latin1(payload);
    let mut settings = Vec::new();
    for part in text.trim_end_matches(['\0', '\r', '\n']).split('&') {
        let (key, value) = part.split_once('=').unwrap_or((part, ""));
        if !key.trim().is_empty() {
            settings.push(Setting {
                key: key.trim().to_owned(),
                value: value.to_owned(),
            });
        }
    }
    settings
}

/// Joins the text of several CONFIG messages. Where the robot splits the text is unknown: between
/// two pairs, with or without the `&`, or within one. If the parts on both sides of a split look
/// like pairs, the split is between pairs and an `&` is inserted.
pub fn join_settings(messages: &[Bytes]) -> Bytes {
    let mut text = BytesMut::new();
    for message in messages {
        let before = text.rsplit(|byte| *byte == b'&').next();
        let after = message.split(|byte| *byte == b'&').next();
        if before.is_some_and(is_pair) && after.is_some_and(is_pair) {
            text.extend_from_slice(b"&");
        }
        text.extend_from_slice(message);
    }
    text.freeze()
}

fn is_pair(part: &[u8]) -> bool {
    part.contains(&b'=')
}

/// Parses the joined text of WIRELESS_NETWORKS messages. Parts without both colons are skipped.
pub fn parse_networks(payload: &[u8]) -> Vec<Network> {
    let text = latin1(payload);
    let network = |part: &str| {
        let mut fields = part.rsplitn(3, ':');
        let strength = fields.next()?;
        let encryption = fields.next()?;
        let essid = fields.next()?;
        Some(Network {
            essid: essid.to_owned(),
            encryption: encryption.to_owned(),
            strength: strength.trim().parse().ok(),
        })
    };
    text.trim_end_matches(['\0', '\r', '\n'])
        .split(';')
        .filter_map(network)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Packet, Report, kind};
    use super::*;
    use proptest::prelude::*;

    fn setting(key: &str, value: &str) -> Setting {
        Setting {
            key: key.into(),
            value: value.into(),
        }
    }

    #[test]
    fn replies_are_parsed_from_these_bytes() {
        let packet = |kind, text: &'static [u8]| Report::parse(Packet::new(kind, text.to_vec()));
        let Report::Config(text) = packet(kind::CONFIG, b"name=Sp\xFCkee&volume=80&flag&=x&")
        else {
            panic!("no configuration");
        };
        assert_eq!(
            parse_settings(&text),
            [
                setting("name", "Spükee"),
                setting("volume", "80"),
                setting("flag", "")
            ]
        );
        let Report::Networks(text) = packet(kind::WIRELESS_NETWORKS, b"a:b:wpa:82;;:none:x;odd")
        else {
            panic!("no networks");
        };
        let networks = parse_networks(&text);
        assert_eq!((networks.len(), networks[0].essid.as_str()), (2, "a:b"));
        assert_eq!(
            (networks[0].strength, networks[1].strength),
            (Some(82), None)
        );
    }

    #[test]
    fn split_settings_are_joined_wherever_the_robot_splits_them() {
        const TEXT: &[u8] = b"name=Spykee&volume=80&wifi-mode=adhoc";
        for cut in 0..=TEXT.len() {
            let (first, second) = TEXT.split_at(cut);
            let messages = [first, second].map(Bytes::copy_from_slice);
            assert_eq!(join_settings(&messages), TEXT, "cut at {cut}");
        }
        let apart = [&b"name=Spykee"[..], b"volume=80", b"wifi-mode=adhoc"];
        assert_eq!(join_settings(&apart.map(Bytes::copy_from_slice)), TEXT);
    }

    proptest! {
        #[test]
        fn any_bytes_are_parsed_without_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            prop_assert!(parse_settings(&bytes).iter().all(|setting| !setting.key.is_empty()));
            let _ = parse_networks(&bytes);
            prop_assert_eq!(latin1(&bytes).chars().count(), bytes.len());
        }
    }
}
