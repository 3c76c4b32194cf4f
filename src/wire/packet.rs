//! One message on the wire, and the decoder that splits a byte stream into such messages.

use bytes::{Bytes, BytesMut};

const MAGIC: [u8; 2] = *b"PK";
const KIND_OFFSET: usize = 2;
const LENGTH_OFFSET: usize = 3;

/// Length of every header (`PROTOCOL.md`, *TCP messages*): "PK", type, big-endian payload length.
pub const HEADER_LEN: usize = 5;
/// The longest payload that the 16-bit length field can announce (`PROTOCOL.md`, *TCP messages*).
pub const MAX_PAYLOAD_LEN: usize = u16::MAX as usize;
/// The longest message, and the most bytes that a [`Decoder`] ever buffers.
pub const MAX_PACKET_LEN: usize = HEADER_LEN + MAX_PAYLOAD_LEN;

/// A message whose payload has not been decoded yet.
#[derive(Clone, PartialEq, Eq)]
pub struct Packet {
    /// The type byte; see [`super::kind`].
    pub kind: u8,
    /// 0 to [`MAX_PAYLOAD_LEN`] bytes; [`Packet::emit`] cuts off the rest.
    pub payload: Bytes,
}

impl Packet {
    /// A packet with this type and payload.
    pub fn new(kind: u8, payload: impl Into<Bytes>) -> Packet {
        Packet {
            kind,
            payload: payload.into(),
        }
    }

    /// Appends header and payload to `out`.
    pub fn emit(&self, out: &mut BytesMut) {
        emit(self.kind, &self.payload, out);
    }
}

/// Payloads may carry passwords or a whole picture: only type and length are shown.
impl std::fmt::Debug for Packet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let length = self.payload.len();
        write!(f, "Packet {{ kind: {}, {length} bytes }}", self.kind)
    }
}

/// Appends one message to `out`. A payload over [`MAX_PAYLOAD_LEN`] is cut off there: the length
/// field cannot express more, and a wrong length would desynchronise the peer.
pub(super) fn emit(kind: u8, payload: &[u8], out: &mut BytesMut) {
    let payload = &payload[..payload.len().min(MAX_PAYLOAD_LEN)];
    out.extend_from_slice(&MAGIC);
    out.extend_from_slice(&[kind]);
    out.extend_from_slice(&(payload.len() as u16).to_be_bytes());
    out.extend_from_slice(payload);
}

/// The stream has no "PK" where a header must begin: it is out of sync and cannot be trusted any
/// more. The connection must be closed and opened again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("expected a message header ({:02X} {:02X}), found {:02X} {:02X}", MAGIC[0], MAGIC[1], found[0], found[1])]
pub struct FramingError {
    /// The two bytes found; the second is 0 when only one had arrived.
    pub found: [u8; 2],
}

/// Splits a byte stream, received in slices of any size, into [`Packet`]s. Buffers at most
/// [`MAX_PACKET_LEN`] bytes; memory grows with the bytes received, not with the announced length.
#[derive(Debug, Default)]
pub struct Decoder {
    partial: BytesMut,
    failed: Option<FramingError>,
}

impl Decoder {
    /// A decoder at the start of a stream.
    pub fn new() -> Decoder {
        Decoder::default()
    }

    /// Takes bytes from the front of `input` until a packet is complete. `Ok(None)` means that
    /// `input` is used up and the packet is still incomplete.
    ///
    /// # Errors
    /// [`FramingError`] as soon as a byte cannot belong to a header, and for every later call.
    pub fn decode(&mut self, input: &mut &[u8]) -> Result<Option<Packet>, FramingError> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        self.take(input, HEADER_LEN);
        self.check_magic()?;
        let Some(length) = self.announced_length() else {
            return Ok(None);
        };
        self.take(input, HEADER_LEN + length);
        if self.partial.len() < HEADER_LEN + length {
            return Ok(None);
        }
        let whole = self.partial.split().freeze();
        Ok(Some(Packet {
            kind: whole[KIND_OFFSET],
            payload: whole.slice(HEADER_LEN..),
        }))
    }

    /// Buffered bytes of an incomplete message.
    pub fn buffered(&self) -> usize {
        self.partial.len()
    }

    fn take(&mut self, input: &mut &[u8], upto: usize) {
        let missing = upto.saturating_sub(self.partial.len()).min(input.len());
        let (head, rest) = input.split_at(missing);
        self.partial.extend_from_slice(head);
        *input = rest;
    }

    fn check_magic(&mut self) -> Result<(), FramingError> {
        let held = self.partial.len().min(MAGIC.len());
        if self.partial[..held] == MAGIC[..held] {
            return Ok(());
        }
        let byte = |at: usize| self.partial.get(at).copied().unwrap_or(0);
        let error = FramingError {
            found: [byte(0), byte(1)],
        };
        self.failed = Some(error);
        Err(error)
    }

    fn announced_length(&self) -> Option<usize> {
        let header = self.partial.get(..HEADER_LEN)?;
        Some(u16::from_be_bytes([header[LENGTH_OFFSET], header[LENGTH_OFFSET + 1]]) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_header_without_pk_ends_the_stream_permanently() {
        let mut decoder = Decoder::new();
        let mut input: &[u8] = b"PX";
        let error = decoder.decode(&mut input).unwrap_err();
        assert_eq!(error.found, *b"PX");
        let mut good: &[u8] = &[0x50, 0x4B, 8, 0, 0];
        assert_eq!(decoder.decode(&mut good), Err(error));
    }

    #[test]
    fn the_first_wrong_byte_is_enough() {
        let mut input: &[u8] = b"G";
        assert!(Decoder::new().decode(&mut input).is_err());
    }

    #[test]
    fn a_claim_of_64_kib_reserves_nothing_before_the_bytes_arrive() {
        let mut decoder = Decoder::new();
        let mut input: &[u8] = &[0x50, 0x4B, 2, 0xFF, 0xFF, 1, 2, 3];
        assert_eq!(decoder.decode(&mut input), Ok(None));
        assert_eq!(decoder.buffered(), 8);
        assert!(decoder.partial.capacity() < 1024);
    }

    #[test]
    fn emit_cuts_off_what_the_length_field_cannot_express() {
        let mut out = BytesMut::new();
        Packet::new(1, vec![0xA5; MAX_PAYLOAD_LEN + 9]).emit(&mut out);
        assert_eq!(out.len(), MAX_PACKET_LEN);
        assert_eq!(out[3..5], [0xFF, 0xFF]);
    }

    #[test]
    fn debug_output_shows_type_and_length_but_not_the_payload() {
        let shown = format!("{:?}", Packet::new(10, &b"hunter2"[..]));
        assert_eq!(shown, "Packet { kind: 10, 7 bytes }");
    }

    #[test]
    fn a_length_over_255_is_read_with_both_bytes() {
        let mut decoder = Decoder::new();
        let mut input: &[u8] = &[0x50, 0x4B, 2, 1, 4];
        assert_eq!(decoder.decode(&mut input), Ok(None));
        let mut payload = &[7; 260][..];
        let packet = decoder.decode(&mut payload).unwrap().unwrap();
        assert_eq!(packet.payload.len(), 260);
    }

    fn any_packet() -> impl Strategy<Value = Packet> {
        (any::<u8>(), prop::collection::vec(any::<u8>(), 0..300))
            .prop_map(|(kind, payload)| Packet::new(kind, payload))
    }

    proptest! {
            #[test]
            fn slices_of_any_size_yield_the_same_packets(
                packets in prop::collection::vec(any_packet(), 0..8),
                cuts in prop::collection::vec(1usize..40, 1..40),
            ) {
                let mut stream = BytesMut::new();
                packets.iter().for_each(|packet| packet.emit(&mut stream));
                let mut decoder = Decoder::new();
                let mut seen = Vec::new();
                let mut rest = &stream[..];
    let mut turn = 0;
                while !rest.is_empty() {
                    let cut = cuts[turn % cuts.len()].min(rest.len());
                    let (mut slice, tail) = rest.split_at(cut);
                    while let Some(packet) = decoder.decode(&mut slice).unwrap() {
                        seen.push(packet);
                    }
                    (rest, turn) = (tail, turn + 1);
                }
                prop_assert_eq!(seen, packets);
                prop_assert_eq!(decoder.buffered(), 0);
            }

            #[test]
            fn random_bytes_never_panic_nor_grow(
                slices in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..64), 0..64),
            ) {
                let mut decoder = Decoder::new();
                for slice in &slices {
                    let mut input = &slice[..];
                    while let Ok(Some(_)) = decoder.decode(&mut input) {}
                    prop_assert!(decoder.buffered() <= MAX_PACKET_LEN);
                }
            }
        }
}
