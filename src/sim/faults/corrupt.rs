//! Corrupts messages. Pure functions; random numbers come from the caller's generator.

use bytes::{BufMut, Bytes, BytesMut};
use rand::rngs::StdRng;
use rand::{Rng, RngExt};
use wire::{Decoder, HEADER_LEN, MAX_PAYLOAD_LEN, Packet, Power, kind};

use super::{Fault, FaultKind};

/// Position of the payload's length in a header (`PROTOCOL.md`, *TCP messages*).
const LENGTH: std::ops::Range<usize> = 3..5;
/// The start of a JPEG, after which a comment may follow.
const JPEG_START: &[u8] = &[0xFF, 0xD8];
/// The marker of a JPEG comment.
const COMMENT: [u8; 2] = [0xFF, 0xFE];
/// Length of the marker and of the length field, which counts itself.
const COMMENT_OVERHEAD: usize = 4;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Section {
    Message(Packet),
    /// Bytes of a stream that is out of sync, passed on unchanged.
    Raw(Bytes),
}

/// Splits a stream at message boundaries.
#[derive(Debug, Default)]
pub(crate) struct Splitter {
    decoder: Decoder,
    /// The bytes since the last message.
    partial: BytesMut,
    out_of_sync: bool,
}

impl Splitter {
    /// Returns the sections completed by these bytes.
    pub(crate) fn feed(&mut self, mut input: &[u8]) -> Vec<Section> {
        let mut sections = Vec::new();
        while !self.out_of_sync {
            let before = input;
            match self.decoder.decode(&mut input) {
                Ok(Some(packet)) => {
                    self.partial.clear();
                    sections.push(Section::Message(packet));
                }
                Ok(None) => {
                    self.partial.extend_from_slice(before);
                    return sections;
                }
                Err(_) => {
                    self.out_of_sync = true;
                    input = before;
                }
            }
        }
        self.partial.extend_from_slice(input);
        sections.extend(self.rest());
        sections
    }

    pub(crate) fn rest(&mut self) -> Option<Section> {
        let rest = self.partial.split().freeze();
        if rest.is_empty() {
            return None;
        }
        Some(Section::Raw(rest))
    }
}

/// Applies all faults to a message; `None` if the message is dropped.
pub(crate) fn corrupt<'a>(
    mut packet: Packet,
    faults: impl Iterator<Item = &'a Fault>,
    rng: &mut StdRng,
) -> Option<Packet> {
    for fault in faults.filter(|fault| fault.kind.alters_messages()) {
        let hit = packet.kind == message_kind_of(fault.kind)
            && rng.random_bool(fault.chance.clamp(0.0, 1.0));
        packet.payload = match fault.kind {
            _ if !hit => continue,
            FaultKind::NoPower => return None,
            FaultKind::PowerJumps { percent } => jump(&packet.payload, percent, rng),
            FaultKind::PowerGarbage => garbage(1, rng),
            FaultKind::HugeFrames => pad(&packet.payload),
            FaultKind::TruncatedFrames => truncate(&packet.payload, rng),
            FaultKind::FlippedFrames { bytes } => flip(&packet.payload, bytes, rng),
            _ => continue,
        };
    }
    Some(packet)
}

fn message_kind_of(fault: FaultKind) -> u8 {
    match fault {
        FaultKind::NoPower | FaultKind::PowerJumps { .. } | FaultKind::PowerGarbage => kind::POWER,
        _ => kind::VIDEO,
    }
}

fn jump(payload: &[u8], percent: Option<u8>, rng: &mut StdRng) -> Bytes {
    let charging = payload
        .first()
        .is_some_and(|&byte| Power::from_byte(byte).charging);
    let percent = percent.unwrap_or_else(|| rng.random_range(0..=100));
    Bytes::from(vec![Power { percent, charging }.to_byte()])
}

/// Pads a frame to the maximum message length with a comment; the image stays the same.
fn pad(jpeg: &Bytes) -> Bytes {
    let missing = MAX_PAYLOAD_LEN.saturating_sub(jpeg.len());
    if !jpeg.starts_with(JPEG_START) || missing < COMMENT_OVERHEAD {
        return jpeg.clone();
    }
    let mut huge = BytesMut::with_capacity(MAX_PAYLOAD_LEN);
    huge.put_slice(JPEG_START);
    huge.put_slice(&COMMENT);
    huge.put_u16((missing - COMMENT.len()) as u16);
    huge.put_bytes(b' ', missing - COMMENT_OVERHEAD);
    huge.put_slice(&jpeg[JPEG_START.len()..]);
    huge.freeze()
}

fn truncate(payload: &Bytes, rng: &mut StdRng) -> Bytes {
    payload.slice(..rng.random_range(0..payload.len().max(1)))
}

fn flip(payload: &Bytes, count: usize, rng: &mut StdRng) -> Bytes {
    let mut flipped = BytesMut::from(&payload[..]);
    for _ in 0..count.min(payload.len()) {
        let at = rng.random_range(0..flipped.len());
        flipped[at] ^= rng.random_range(1..=u8::MAX);
    }
    flipped.freeze()
}

pub(crate) fn garbage(count: usize, rng: &mut StdRng) -> Bytes {
    let mut bytes = vec![0; count];
    rng.fill_bytes(&mut bytes);
    Bytes::from(bytes)
}

pub(crate) fn falsify_length(message: &mut [u8], claim: Option<u16>, rng: &mut StdRng) {
    let truth = message.len().saturating_sub(HEADER_LEN) as u16;
    let claim = claim.unwrap_or_else(|| truth.wrapping_add(rng.random_range(1..=u16::MAX)));
    if let Some(length) = message.get_mut(LENGTH) {
        length.copy_from_slice(&claim.to_be_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;

    fn test_rng() -> StdRng {
        StdRng::seed_from_u64(5)
    }

    fn corrupted(packet: &Packet, fault_kind: FaultKind) -> Option<Packet> {
        corrupt(
            packet.clone(),
            [Fault::new(fault_kind)].iter(),
            &mut test_rng(),
        )
    }

    fn frame() -> Packet {
        Packet::new(
            kind::VIDEO,
            [&[0xFF, 0xD8][..], &[7; 500], &[0xFF, 0xD9]].concat(),
        )
    }

    #[test]
    fn frame_faults_affect_only_frames() {
        let power = Packet::new(kind::POWER, vec![80]);
        for fault_kind in [
            FaultKind::HugeFrames,
            FaultKind::TruncatedFrames,
            FaultKind::FlippedFrames { bytes: 3 },
        ] {
            assert_ne!(
                corrupted(&frame(), fault_kind),
                Some(frame()),
                "{fault_kind:?}"
            );
            assert_eq!(corrupted(&power, fault_kind), Some(power.clone()));
        }
        let huge = corrupted(&frame(), FaultKind::HugeFrames).unwrap();
        assert_eq!(huge.payload.len(), MAX_PAYLOAD_LEN);
        assert_eq!(huge.payload[..4], [0xFF, 0xD8, 0xFF, 0xFE]);
        assert!(huge.payload.ends_with(&frame().payload[2..]));
    }

    #[test]
    fn power_is_dropped_or_wrong_and_keeps_its_sign() {
        for (byte, jumped) in [(80u8, 5u8), (176, 251)] {
            let power = Packet::new(kind::POWER, vec![byte]);
            assert_eq!(corrupted(&power, FaultKind::NoPower), None);
            let wrong = corrupted(&power, FaultKind::PowerJumps { percent: Some(5) });
            assert_eq!(wrong.unwrap().payload[..], [jumped]);
        }
        assert_eq!(corrupted(&frame(), FaultKind::NoPower), Some(frame()));
    }

    #[test]
    fn power_garbage_is_any_byte_and_frames_are_unchanged() {
        let power = Packet::new(kind::POWER, vec![80]);
        let mut rng = test_rng();
        let faults = [Fault::new(FaultKind::PowerGarbage)];
        let bytes = (0..2000).filter_map(|_| corrupt(power.clone(), faults.iter(), &mut rng));
        let seen: std::collections::BTreeSet<u8> = bytes.map(|packet| packet.payload[0]).collect();
        assert_eq!(seen.len(), 256);
        assert_eq!(corrupted(&frame(), FaultKind::PowerGarbage), Some(frame()));
    }

    #[test]
    fn a_wrong_length_changes_only_the_length_field() {
        let stop = [0x50, 0x4B, 5, 0, 2, 0, 0];
        let mut message = stop;
        falsify_length(&mut message, Some(0xFFFF), &mut test_rng());
        assert_eq!(message, [0x50, 0x4B, 5, 0xFF, 0xFF, 0, 0]);
        let mut message = stop;
        falsify_length(&mut message, None, &mut test_rng());
        assert_ne!(message, stop);
    }

    proptest! {
            #[test]
            fn splitting_and_joining_preserves_the_stream(
                slices in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 0..20),
                in_step in any::<bool>(),
            ) {
                let mut splitter = Splitter::default();
    let mut sent = BytesMut::new();
    let mut came = BytesMut::new();
                let slices = slices.iter().map(|slice| {
                    if !in_step { return Bytes::from(slice.clone()); }
                    let mut message = BytesMut::new();
                    Packet::new(9, slice.clone()).emit(&mut message);
                    message.freeze()
                });
                for slice in slices {
                    sent.extend_from_slice(&slice);
                    for section in splitter.feed(&slice) {
                        prop_assert!(!in_step || matches!(section, Section::Message(_)));
                        put(section, &mut came);
                    }
                }
                splitter.rest().into_iter().for_each(|section| put(section, &mut came));
                prop_assert_eq!(came, sent);
            }

            #[test]
            fn no_payload_causes_a_panic(payload in prop::collection::vec(any::<u8>(), 0..50), seed in any::<u64>()) {
                let mut rng = StdRng::seed_from_u64(seed);
                for kind in [kind::VIDEO, kind::POWER] {
                    for fault_kind in [
                        FaultKind::HugeFrames, FaultKind::TruncatedFrames, FaultKind::FlippedFrames { bytes: 9 },
                        FaultKind::PowerJumps { percent: None }, FaultKind::PowerGarbage,
                    ] {
                        corrupt(Packet::new(kind, payload.clone()), [Fault::new(fault_kind)].iter(), &mut rng);
                    }
                }
                falsify_length(&mut payload.clone(), None, &mut rng);
            }
        }

    fn put(section: Section, out: &mut BytesMut) {
        match section {
            Section::Message(packet) => packet.emit(out),
            Section::Raw(bytes) => out.extend_from_slice(&bytes),
        }
    }
}
