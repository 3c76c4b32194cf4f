//! Messages from the robot (`PROTOCOL.md`, *TCP messages*). The agent decodes them, the simulator
//! encodes them.

use bytes::{Bytes, BytesMut};

use super::text::{emit_prefixed, parse_prefixed};
use super::{Packet, kind, packet};

/// A message from the robot. Each variant's doc begins with the message's name, which is also the
/// name of its section of `PROTOCOL.md`.
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
    /// A type, a length or a battery level that the protocol does not define; also MUTE and NONE.
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

    /// Decodes a packet. A payload too short for its type and a battery level beyond 100 % give
    /// [`Report::Unknown`]; bytes beyond what a type needs are ignored.
    pub fn parse(packet: Packet) -> Report {
        let payload = &packet.payload;
        match (packet.kind, &payload[..]) {
            (kind::AUDIO, _) => Report::Audio(payload.clone()),
            (kind::VIDEO, _) => Report::Video(payload.clone()),
            (kind::POWER, &[level, ..]) => Power::from_byte(level)
                .map_or_else(|| Report::Unknown(packet.clone()), Report::Power),
            (kind::STOP, _) => Report::SoundFinished,
            (kind::AUTH_REPLY, &[0, ..]) => Report::Refused(Refusal::parse(&payload[1..])),
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

/// The battery (`PROTOCOL.md`, POWER): one signed byte, negative while charging.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Power {
    /// 0..=100 percent.
    pub percent: u8,
    /// Charging. At a level of 0 the wire format cannot express this.
    pub charging: bool,
}

impl Power {
    /// Decodes the byte; `None` for undefined levels beyond 100.
    pub fn from_byte(byte: u8) -> Option<Power> {
        let level = i8::from_be_bytes([byte]);
        let percent = level.unsigned_abs();
        (percent <= 100).then_some(Power {
            percent,
            charging: level < 0,
        })
    }

    /// The byte on the wire.
    pub fn to_byte(self) -> u8 {
        let level = self.percent.min(100);
        if self.charging {
            level.wrapping_neg()
        } else {
            level
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
        let docked = *state == Self::DOCKED;
        Some(Accepted {
            uid,
            name,
            place,
            firmware,
            docked,
            tail: Bytes::copy_from_slice(tail),
        })
    }
}

/// Why a login was refused (`PROTOCOL.md`, AUTH_REPLY).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// 1: wrong user or password.
    WrongPassword,
    /// 3: another user is connected.
    InUse,
    /// A reason that the protocol does not list.
    Unknown(u8),
}

impl Refusal {
    /// A reply without a reason counts as reason 0.
    fn parse(rest: &[u8]) -> Refusal {
        match rest.first().copied().unwrap_or(0) {
            1 => Refusal::WrongPassword,
            3 => Refusal::InUse,
            other => Refusal::Unknown(other),
        }
    }

    fn to_byte(self) -> u8 {
        match self {
            Refusal::WrongPassword => 1,
            Refusal::InUse => 3,
            Refusal::Unknown(byte) => byte,
        }
    }
}

/// The event in an ENGINE message (`PROTOCOL.md`, ENGINE).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum EngineReport {
    /// 1 ACTIVATE: the robot has left the charging station.
    Undocked,
    /// 2 DEACTIVATE: the robot is on the charging station.
    Docked,
    /// 3 BATTERY_CHARGED: the battery is full.
    Charged,
    /// 8 BASE_NOT_FOUND: the search failed.
    BaseNotFound,
    /// A byte that the protocol does not list.
    Unknown(u8),
}

impl EngineReport {
    /// The byte on the wire.
    pub fn to_byte(self) -> u8 {
        match self {
            EngineReport::Undocked => 1,
            EngineReport::Docked => 2,
            EngineReport::Charged => 3,
            EngineReport::BaseNotFound => 8,
            EngineReport::Unknown(byte) => byte,
        }
    }
}

impl From<u8> for EngineReport {
    fn from(byte: u8) -> EngineReport {
        match byte {
            1 => EngineReport::Undocked,
            2 => EngineReport::Docked,
            3 => EngineReport::Charged,
            8 => EngineReport::BaseNotFound,
            other => EngineReport::Unknown(other),
        }
    }
}

#[cfg(test)]
mod tests;
