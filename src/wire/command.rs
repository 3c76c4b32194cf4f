//! Messages to the robot (`PROTOCOL.md`, *TCP messages*). The agent encodes them, the simulator
//! decodes them.

use bytes::{Bytes, BytesMut};

use super::text::{emit_prefixed, parse_prefixed};
use super::{Led, Packet, Sound, Stream, kind, packet};

/// A message to the robot. Each variant's doc begins with the message's name, which is also the
/// name of its section of `PROTOCOL.md`.
#[derive(Clone, PartialEq, Eq)]
pub enum Command {
    /// NONE: no content.
    None,
    /// AUDIO: samples for the speaker, played while stream `audio_out` is on.
    Audio(Bytes),
    /// POWER, empty: requests the battery level (one known client does this).
    PowerQuery,
    /// LED: switches a light.
    Led {
        /// Which light.
        led: Led,
        /// On or off; on the wire 1 or 0.
        on: bool,
    },
    /// MOVE: power of the two tracks. The agent sends -90..=90; other clients send up to 127. Bytes
    /// after the second are ignored.
    Move {
        /// Left track, negative is backwards.
        left: i8,
        /// Right track, negative is backwards.
        right: i8,
    },
    /// FILE: one chunk of an upload.
    File(FileChunk),
    /// PLAY: plays a sound.
    Play(Sound),
    /// STOP: stops the music now playing.
    StopSound,
    /// VOLUME: 0..=100 percent.
    Volume(u8),
    /// AUTH_REQUEST: logs in.
    Login(Login),
    /// MUTE: meaning unknown; the payload as received.
    Mute(Bytes),
    /// CONFIG, empty: requests the configuration.
    ConfigQuery,
    /// CONFIG: settings to change, as `key=value&...`.
    ConfigSet(Bytes),
    /// WIRELESS_NETWORKS: requests a scan.
    NetworksQuery,
    /// STREAMCTL: switches a stream.
    Stream {
        /// Which stream.
        stream: Stream,
        /// On or off; on the wire 1 or 0.
        on: bool,
    },
    /// ENGINE: docking and undocking.
    Engine(Engage),
    /// LOG: requests the robot's log.
    LogQuery,
    /// MOTOR_SPEED: stored in the robot's memory, meaning unknown.
    MotorSpeed(Bytes),
    /// A type or length that the protocol does not define.
    Unknown(Packet),
}

impl Command {
    /// Stops both tracks.
    pub const STOP: Command = Command::Move { left: 0, right: 0 };

    /// Appends the message to `out`.
    pub fn emit(&self, out: &mut BytesMut) {
        match self {
            Command::None => packet::emit(kind::NONE, &[], out),
            Command::Audio(samples) => packet::emit(kind::AUDIO, samples, out),
            Command::PowerQuery => packet::emit(kind::POWER, &[], out),
            Command::Led { led, on } => {
                packet::emit(kind::LED, &[led.to_byte(), u8::from(*on)], out);
            }
            Command::Move { left, right } => {
                packet::emit(
                    kind::MOVE,
                    &[left.to_be_bytes()[0], right.to_be_bytes()[0]],
                    out,
                );
            }
            Command::File(chunk) => chunk.emit(out),
            Command::Play(sound) => packet::emit(kind::PLAY, &[sound.to_byte()], out),
            Command::StopSound => packet::emit(kind::STOP, &[], out),
            Command::Volume(percent) => packet::emit(kind::VOLUME, &[*percent], out),
            Command::Login(login) => login.emit(out),
            Command::Mute(payload) => packet::emit(kind::MUTE, payload, out),
            Command::ConfigQuery => packet::emit(kind::CONFIG, &[], out),
            Command::ConfigSet(text) => packet::emit(kind::CONFIG, text, out),
            Command::NetworksQuery => packet::emit(kind::WIRELESS_NETWORKS, &[], out),
            Command::Stream { stream, on } => {
                packet::emit(kind::STREAMCTL, &[stream.to_byte(), u8::from(*on)], out);
            }
            Command::Engine(engage) => packet::emit(kind::ENGINE, &[engage.to_byte()], out),
            Command::LogQuery => packet::emit(kind::LOG, &[], out),
            Command::MotorSpeed(payload) => packet::emit(kind::MOTOR_SPEED, payload, out),
            Command::Unknown(packet) => packet.emit(out),
        }
    }

    /// The encoded message.
    pub fn to_bytes(&self) -> Bytes {
        let mut out = BytesMut::new();
        self.emit(&mut out);
        out.freeze()
    }

    /// Decodes a packet. A payload too short for its type gives [`Command::Unknown`]; bytes beyond
    /// what a type needs are ignored.
    pub fn parse(packet: Packet) -> Command {
        let payload = &packet.payload;
        match (packet.kind, &payload[..]) {
            (kind::NONE, _) => Command::None,
            (kind::AUDIO, _) => Command::Audio(payload.clone()),
            (kind::POWER, []) => Command::PowerQuery,
            (kind::LED, &[led, on, ..]) => Command::Led {
                led: led.into(),
                on: on != 0,
            },
            (kind::MOVE, &[left, right, ..]) => Command::Move {
                left: i8::from_be_bytes([left]),
                right: i8::from_be_bytes([right]),
            },
            (kind::FILE, &[id, flags, ..]) => Command::File(FileChunk {
                id,
                flags,
                content: payload.slice(2..),
            }),
            (kind::PLAY, &[sound, ..]) => Command::Play(sound.into()),
            (kind::STOP, _) => Command::StopSound,
            (kind::VOLUME, &[percent, ..]) => Command::Volume(percent),
            (kind::AUTH_REQUEST, text) => {
                Login::parse(text).map_or_else(|| Command::Unknown(packet.clone()), Command::Login)
            }
            (kind::MUTE, _) => Command::Mute(payload.clone()),
            (kind::CONFIG, []) => Command::ConfigQuery,
            (kind::CONFIG, _) => Command::ConfigSet(payload.clone()),
            (kind::WIRELESS_NETWORKS, _) => Command::NetworksQuery,
            (kind::STREAMCTL, &[stream, on, ..]) => Command::Stream {
                stream: stream.into(),
                on: on != 0,
            },
            (kind::ENGINE, &[engage, ..]) => Command::Engine(engage.into()),
            (kind::LOG, _) => Command::LogQuery,
            (kind::MOTOR_SPEED, _) => Command::MotorSpeed(payload.clone()),
            _ => Command::Unknown(packet),
        }
    }
}

/// The request in an ENGINE message (`PROTOCOL.md`, ENGINE).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Engage {
    /// 5 CHARGE_STOP: leave the station.
    Undock,
    /// 6 BASE_FIND: search for the station and drive onto it.
    Dock,
    /// 7 BASE_FIND_CANCEL: stop searching.
    CancelDock,
    /// A byte that the protocol does not list.
    Unknown(u8),
}

impl Engage {
    /// The byte on the wire.
    pub fn to_byte(self) -> u8 {
        match self {
            Engage::Undock => 5,
            Engage::Dock => 6,
            Engage::CancelDock => 7,
            Engage::Unknown(byte) => byte,
        }
    }
}

impl From<u8> for Engage {
    fn from(byte: u8) -> Engage {
        match byte {
            5 => Engage::Undock,
            6 => Engage::Dock,
            7 => Engage::CancelDock,
            other => Engage::Unknown(other),
        }
    }
}

/// One chunk of an upload (`PROTOCOL.md`, FILE). Can only be created for sounds: a firmware image
/// (file 66) is never sent.
#[derive(Clone, PartialEq, Eq)]
pub struct FileChunk {
    id: u8,
    flags: u8,
    content: Bytes,
}

impl FileChunk {
    /// Flag of a file's first chunk.
    pub const FIRST: u8 = 1;
    /// Flag of a file's last chunk; a single chunk has both.
    pub const LAST: u8 = 2;

    /// A chunk of an uploaded sound; `None` unless `slot` is one that the user may write: `user0`,
    /// `user1` or `music`.
    pub fn of_sound(slot: Sound, flags: u8, content: Bytes) -> Option<FileChunk> {
        let free = matches!(slot, Sound::User0 | Sound::User1 | Sound::Music);
        free.then(|| FileChunk {
            id: slot.to_byte(),
            flags,
            content,
        })
    }

    /// The file's number on the robot.
    pub fn id(&self) -> u8 {
        self.id
    }

    /// [`FileChunk::FIRST`], [`FileChunk::LAST`], both or none.
    pub fn flags(&self) -> u8 {
        self.flags
    }

    /// The chunk's bytes.
    pub fn content(&self) -> &Bytes {
        &self.content
    }

    fn emit(&self, out: &mut BytesMut) {
        let mut payload = BytesMut::with_capacity(2 + self.content.len());
        payload.extend_from_slice(&[self.id, self.flags]);
        payload.extend_from_slice(&self.content);
        packet::emit(kind::FILE, &payload, out);
    }
}

/// User and password (`PROTOCOL.md`, AUTH_REQUEST).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Login {
    /// The user's name, ISO-8859-1, at most 255 characters.
    pub user: String,
    /// The password, ISO-8859-1, at most 255 characters.
    pub password: Secret,
}

impl Login {
    /// A login with this user and password.
    pub fn new(user: impl Into<String>, password: impl Into<String>) -> Login {
        Login {
            user: user.into(),
            password: Secret::new(password),
        }
    }

    fn emit(&self, out: &mut BytesMut) {
        let mut payload = BytesMut::new();
        emit_prefixed(&self.user, &mut payload);
        emit_prefixed(self.password.reveal(), &mut payload);
        packet::emit(kind::AUTH_REQUEST, &payload, out);
    }

    fn parse(mut payload: &[u8]) -> Option<Login> {
        let user = parse_prefixed(&mut payload)?;
        let password = parse_prefixed(&mut payload)?;
        Some(Login::new(user, password))
    }
}

/// Text that never appears in a log, an error or `Debug` output.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(String);

impl Secret {
    /// Wraps a secret text.
    pub fn new(text: impl Into<String>) -> Secret {
        Secret(text.into())
    }

    /// The text itself, for the code that encodes it.
    pub fn reveal(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("***")
    }
}

#[cfg(test)]
mod tests;
