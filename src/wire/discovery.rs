//! The datagrams that discover robots (`PROTOCOL.md`, *Discovery datagrams*).

use super::text::{latin1, to_latin1};

/// The discovery request: "DSCV", 1 (`PROTOCOL.md`, *Discovery datagrams*).
pub const REQUEST: [u8; 5] = *b"DSCV\x01";
/// Clients read at most this many bytes of a reply (`PROTOCOL.md`, *Discovery datagrams*).
pub const MAX_REPLY_LEN: usize = 64;

const REPLY_HEADER: [u8; 5] = *b"DSCV\x02";
const HEADER_LEN: usize = REPLY_HEADER.len() + 1;

/// A robot's reply.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Reply {
    /// The robot's id, such as `SPYKEE0001`.
    pub uid: String,
    /// The connected user, if any.
    pub connected_user: Option<String>,
}

impl Reply {
    /// Encodes the datagram, at most [`MAX_REPLY_LEN`] bytes: longer text is cut off.
    pub fn emit(&self) -> Vec<u8> {
        let mut text = format!("uid={}", self.uid);
        if let Some(user) = &self.connected_user {
            text.push_str(",connected-user=");
            text.push_str(user);
        }
        let payload = to_latin1(&text).take(MAX_REPLY_LEN - HEADER_LEN);
        let payload: Vec<u8> = payload.collect();
        let mut datagram = REPLY_HEADER.to_vec();
        datagram.push(payload.len() as u8);
        datagram.extend(payload);
        datagram
    }

    /// Decodes a datagram; `None` if it is not a reply, for example the broadcaster's own request.
    /// Tolerates a length byte that announces more than was received, and unknown fields.
    pub fn parse(datagram: &[u8]) -> Option<Reply> {
        let rest = datagram.strip_prefix(&REPLY_HEADER[..])?;
        let (&length, payload) = rest.split_first()?;
        let text = latin1(&payload[..payload.len().min(usize::from(length))]);
        let field = |name: &str| {
            let mut fields = text.split(',').filter_map(|field| field.split_once('='));
            let (_, value) = fields.find(|(key, _)| *key == name)?;
            Some(value.to_owned())
        };
        Some(Reply {
            uid: field("uid")?,
            connected_user: field("connected-user").filter(|user| !user.is_empty()),
        })
    }
}

/// Whether a datagram is a discovery request.
pub fn is_request(datagram: &[u8]) -> bool {
    datagram.starts_with(&REQUEST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_request_has_its_golden_bytes() {
        assert_eq!(REQUEST, [0x44, 0x53, 0x43, 0x56, 0x01]);
        assert!(is_request(&[0x44, 0x53, 0x43, 0x56, 0x01]));
    }

    #[test]
    fn a_free_robot_sends_only_its_id() {
        let bytes = b"DSCV\x02\x0Euid=SPYKEE0001";
        let reply = Reply {
            uid: "SPYKEE0001".into(),
            connected_user: None,
        };
        assert_eq!(Reply::parse(bytes), Some(reply.clone()));
        assert_eq!(reply.emit(), bytes);
    }

    #[test]
    fn a_busy_robot_sends_its_user() {
        let bytes = b"DSCV\x02\x22uid=SPYKEE0001,connected-user=anna";
        let reply = Reply::parse(bytes).unwrap();
        assert_eq!(reply.connected_user.as_deref(), Some("anna"));
        assert_eq!(reply.emit()[..5], bytes[..5]);
    }

    #[test]
    fn a_long_text_is_cut_off_and_an_empty_user_is_none() {
        let reply = Reply {
            uid: "SPYKEE0001".into(),
            connected_user: Some("a".repeat(80)),
        };
        let datagram = reply.emit();
        assert_eq!(datagram.len(), MAX_REPLY_LEN);
        assert_eq!(usize::from(datagram[5]), MAX_REPLY_LEN - 6);
        let empty = Reply::parse(b"DSCV\x02\x15uid=S,connected-user=").unwrap();
        assert_eq!(empty.connected_user, None);
    }

    #[test]
    fn only_the_request_datagram_is_a_request() {
        assert!(!is_request(b"DSCV"));
        assert!(!is_request(b"DSCV\x02\x05uid=S"));
    }

    #[test]
    fn the_own_request_is_not_a_reply() {
        assert_eq!(Reply::parse(&REQUEST), None);
    }

    proptest! {
        #[test]
        fn any_datagram_is_parsed_without_panic(bytes in prop::collection::vec(any::<u8>(), 0..80)) {
            let _ = Reply::parse(&bytes);
            let _ = Reply::parse(&[&REPLY_HEADER[..], &bytes].concat());
        }

        #[test]
        fn replies_fit_into_what_clients_read(uid in ".{0,90}", user in ".{0,90}") {
            let reply = Reply { uid, connected_user: Some(user) };
            prop_assert!(reply.emit().len() <= MAX_REPLY_LEN);
        }
    }
}
