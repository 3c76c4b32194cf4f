//! Messages from the robot (`PROTOCOL.md`, *TCP messages*).

use std::fmt;

use bytes::{Bytes, BytesMut};

use super::text::{emit_prefixed, parse_prefixed};
use super::{EngineReport, Packet, Refusal, kind, packet};

/// A message from the robot. Each variant's doc begins with its section of `PROTOCOL.md`.
#[derive(Clone, PartialEq, Eq)]
pub enum Report {
    /// AUDIO: microphone, s16 little-endian, 16 kHz, mono. An odd last byte is possible.
    Audio(Bytes),
    /// VIDEO: one JPEG frame, as received.
    Video(Bytes),
    /// POWER: the battery.
    Power(Power),
    /// STOP, empty: the music has ended.
    SoundFinished,
    /// AUTH_REPLY: accepted.
    Accepted(Accepted),
    /// AUTH_REPLY: refused; the robot closes the connection after it.
    Refused(Refusal),
    /// CONFIG: `key=value&...`, possibly one of several messages.
    Config(Bytes),
    /// WIRELESS_NETWORKS: `essid:encryption:strength;...`
    Networks(Bytes),
    /// ENGINE: docked, undocked, charged, or the search has failed.
    Engine(EngineReport),
    /// LOG: text of the robot's log.
    Log(Bytes),
    /// A type or a length that the protocol does not define; also MUTE and NONE.
    Unknown(Packet),
}

impl Report {
    /// Appends the message to `out`.
    pub fn emit(&self, out: &mut BytesMut) {
        match self {
            Report::Audio(samples) => packet::emit(kind::AUDIO, samples, out),
            Report::Video(jpeg) => packet::emit(kind::VIDEO, jpeg, out),
            Report::Power(power) => packet::emit(kind::POWER, &[power.to_byte()], out),
            Report::SoundFinished => packet::emit(kind::STOP, &[], out),
            Report::Accepted(accepted) => accepted.emit(out),
            Report::Refused(refusal) => {
                packet::emit(kind::AUTH_REPLY, &[0, refusal.to_byte()], out);
            }
            Report::Config(text) => packet::emit(kind::CONFIG, text, out),
            Report::Networks(text) => packet::emit(kind::WIRELESS_NETWORKS, text, out),
            Report::Engine(report) => packet::emit(kind::ENGINE, &[report.to_byte()], out),
            Report::Log(text) => packet::emit(kind::LOG, text, out),
            Report::Unknown(packet) => packet.emit(out),
        }
    }

    /// The encoded message.
    pub fn to_bytes(&self) -> Bytes {
        let mut out = BytesMut::new();
        self.emit(&mut out);
        out.freeze()
    }

    /// Decodes a packet. A payload too short for its type gives [`Report::Unknown`]; bytes beyond what
    /// a type needs are ignored.
    pub fn parse(packet: Packet) -> Report {
        let payload = &packet.payload;
        match (packet.kind, &payload[..]) {
            (kind::AUDIO, _) => Report::Audio(payload.clone()),
            (kind::VIDEO, _) => Report::Video(payload.clone()),
            (kind::POWER, &[byte, ..]) => Report::Power(Power::from_byte(byte)),
            (kind::STOP, _) => Report::SoundFinished,
            // A reply without a reason counts as reason 0.
            (kind::AUTH_REPLY, [0]) => Report::Refused(Refusal::Unknown(0)),
            (kind::AUTH_REPLY, &[0, reason, ..]) => Report::Refused(reason.into()),
            (kind::AUTH_REPLY, &[_, ref rest @ ..]) => Accepted::parse(rest)
                .map_or_else(|| Report::Unknown(packet.clone()), Report::Accepted),
            (kind::CONFIG, _) => Report::Config(payload.clone()),
            (kind::WIRELESS_NETWORKS, _) => Report::Networks(payload.clone()),
            (kind::ENGINE, &[report, ..]) => Report::Engine(report.into()),
            (kind::LOG, _) => Report::Log(payload.clone()),
            _ => Report::Unknown(packet),
        }
    }
}

/// Payloads that may contain secrets or that are long are shown only as a number of bytes.
impl fmt::Debug for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Report::Audio(bytes) => write!(f, "Audio({} bytes)", bytes.len()),
            Report::Video(bytes) => write!(f, "Video({} bytes)", bytes.len()),
            Report::Power(power) => write!(f, "Power({power:?})"),
            Report::SoundFinished => f.write_str("SoundFinished"),
            Report::Accepted(accepted) => write!(f, "Accepted({accepted:?})"),
            Report::Refused(refusal) => write!(f, "Refused({refusal:?})"),
            Report::Config(bytes) => write!(f, "Config({} bytes)", bytes.len()),
            Report::Networks(bytes) => write!(f, "Networks({} bytes)", bytes.len()),
            Report::Engine(report) => write!(f, "Engine({report:?})"),
            Report::Log(bytes) => write!(f, "Log({} bytes)", bytes.len()),
            Report::Unknown(packet) => write!(f, "Unknown({packet:?})"),
        }
    }
}

/// The battery (`PROTOCOL.md`, POWER): one signed byte, negative while charging.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Power {
    /// The number without its sign, 0..=128. Beyond 100 it is no level: see [`Power::level`].
    pub percent: u8,
    /// Charging. At a level of 0 the wire format cannot express this.
    pub charging: bool,
}

impl Power {
    /// The level, 0..=100 percent; `None` if the report has none, as may happen while the robot
    /// charges.
    pub fn level(self) -> Option<u8> {
        if self.percent <= 100 {
            Some(self.percent)
        } else {
            None
        }
    }

    /// Decodes the byte.
    pub fn from_byte(byte: u8) -> Power {
        let level = i8::from_be_bytes([byte]);
        Power {
            percent: level.unsigned_abs(),
            charging: level < 0,
        }
    }

    /// The byte on the wire; a number that it cannot hold becomes the nearest.
    pub fn to_byte(self) -> u8 {
        if self.charging {
            self.percent.min(128).wrapping_neg()
        } else {
            self.percent.min(127)
        }
    }
}

/// A login that was accepted (`PROTOCOL.md`, AUTH_REPLY).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Accepted {
    /// The robot's id, such as `SPYKEE0001`.
    pub uid: String,
    /// The robot's name.
    pub name: String,
    /// A third name of unknown meaning.
    pub place: String,
    /// The firmware version, such as `1.0.22`.
    pub firmware: String,
    /// The robot stands on its charging station.
    pub docked: bool,
    /// Further bytes of unknown meaning; a recorded reply has [`Accepted::RECORDED_TAIL`].
    pub tail: Bytes,
}

impl Accepted {
    const DOCKED: u8 = 0;
    /// The last bytes of a recorded reply of a real robot.
    pub const RECORDED_TAIL: &[u8] = &[1, 2];

    fn emit(&self, out: &mut BytesMut) {
        let mut payload = BytesMut::from(&[1][..]);
        for text in [&self.uid, &self.name, &self.place, &self.firmware] {
            emit_prefixed(text, &mut payload);
        }
        payload.extend_from_slice(&[if self.docked { Self::DOCKED } else { 1 }]);
        payload.extend_from_slice(&self.tail);
        packet::emit(kind::AUTH_REPLY, &payload, out);
    }

    fn parse(mut rest: &[u8]) -> Option<Accepted> {
        let uid = parse_prefixed(&mut rest)?;
        let name = parse_prefixed(&mut rest)?;
        let place = parse_prefixed(&mut rest)?;
        let firmware = parse_prefixed(&mut rest)?;
        let (state, tail) = rest.split_first()?;
        Some(Accepted {
            uid,
            name,
            place,
            firmware,
            docked: *state == Self::DOCKED,
            tail: Bytes::copy_from_slice(tail),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::Decoder;
    use super::*;
    use proptest::prelude::*;

    fn parse_bytes(mut bytes: &[u8]) -> Report {
        Report::parse(Decoder::new().decode(&mut bytes).unwrap().unwrap())
    }

    /// `PROTOCOL.md`, *TCP messages*, column *from robot*.
    #[test]
    fn every_type_of_the_table_is_parsed_and_encoded() {
        let bytes = Bytes::from_static(b"a=1&b=2");
        for (kind, payload, meaning) in [
            (1, bytes.clone(), Report::Audio(bytes.clone())),
            (2, bytes.clone(), Report::Video(bytes.clone())),
            (8, Bytes::new(), Report::SoundFinished),
            (13, bytes.clone(), Report::Config(bytes.clone())),
            (14, bytes.clone(), Report::Networks(bytes.clone())),
            (
                16,
                Bytes::from_static(&[1]),
                Report::Engine(EngineReport::Undocked),
            ),
            (
                16,
                Bytes::from_static(&[3]),
                Report::Engine(EngineReport::Charged),
            ),
            (17, bytes.clone(), Report::Log(bytes.clone())),
        ] {
            let packet = Packet::new(kind, payload);
            let mut encoded = BytesMut::new();
            packet.emit(&mut encoded);
            assert_eq!(meaning.to_bytes(), encoded, "{meaning:?}");
            assert_eq!(Report::parse(packet), meaning);
        }
    }

    #[test]
    fn every_power_is_parsed_and_beyond_a_hundred_it_has_no_level() {
        for byte in 0..=u8::MAX {
            let number = i16::from(i8::from_be_bytes([byte]));
            let power = Power {
                percent: number.unsigned_abs() as u8,
                charging: number < 0,
            };
            let parsed = Report::parse(Packet::new(kind::POWER, vec![byte]));
            assert_eq!(parsed, Report::Power(power), "{number}");
            assert_eq!(power.to_byte(), byte);
            assert_eq!(power.level().is_some(), (-100..=100).contains(&number));
        }
    }

    #[test]
    fn bytes_after_the_docked_flag_change_nothing() {
        let payload = [&[1, 1, b'S', 0, 0, 0, 1][..], &[7, 7, 7]].concat();
        let Report::Accepted(accepted) = Report::parse(Packet::new(kind::AUTH_REPLY, payload))
        else {
            panic!("not accepted");
        };
        assert_eq!((accepted.uid.as_str(), accepted.docked), ("S", false));
    }

    #[test]
    fn a_refusal_without_a_reason_is_still_a_refusal() {
        let report = Report::parse(Packet::new(kind::AUTH_REPLY, vec![0]));
        assert_eq!(report, Report::Refused(Refusal::Unknown(0)));
    }

    #[test]
    fn odd_lengths_and_unknown_types_are_values() {
        for packet in [
            Packet::new(kind::POWER, vec![]),
            Packet::new(kind::ENGINE, vec![]),
            Packet::new(kind::AUTH_REPLY, vec![]),
            Packet::new(kind::AUTH_REPLY, vec![1, 40, b'x']),
            Packet::new(kind::MUTE, vec![1]),
            Packet::new(77, vec![]),
        ] {
            assert_eq!(Report::parse(packet.clone()), Report::Unknown(packet));
        }
        let report = Report::parse(Packet::new(kind::ENGINE, vec![42]));
        assert_eq!(report, Report::Engine(EngineReport::Unknown(42)));
    }

    proptest! {
        #[test]
        fn any_packet_parses_and_its_encoding_parses_to_the_same(
            kind in any::<u8>(),
            payload in prop::collection::vec(any::<u8>(), 0..64),
        ) {
            let report = Report::parse(Packet::new(kind, payload));
            prop_assert_eq!(parse_bytes(&report.to_bytes()), report);
        }
    }
}
