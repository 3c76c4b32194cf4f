//! Messages to the robot (`PROTOCOL.md`, *TCP messages*).

use std::fmt;

use bytes::{Bytes, BytesMut};

use super::text::{emit_prefixed, parse_prefixed};
use super::{Engage, Led, Packet, Sound, Stream, kind, packet};

/// A message to the robot. Each variant's doc begins with its section of `PROTOCOL.md`.
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
                let powers = [left.to_be_bytes()[0], right.to_be_bytes()[0]];
                packet::emit(kind::MOVE, &powers, out);
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

/// Payloads that may contain secrets or that are long are shown only as a number of bytes.
impl fmt::Debug for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Command::None => f.write_str("None"),
            Command::Audio(bytes) => write!(f, "Audio({} bytes)", bytes.len()),
            Command::PowerQuery => f.write_str("PowerQuery"),
            Command::Led { led, on } => write!(f, "Led {{ led: {led:?}, on: {on} }}"),
            Command::Move { left, right } => {
                write!(f, "Move {{ left: {left}, right: {right} }}")
            }
            Command::File(chunk) => write!(f, "File({chunk:?})"),
            Command::Play(sound) => write!(f, "Play({sound:?})"),
            Command::StopSound => f.write_str("StopSound"),
            Command::Volume(percent) => write!(f, "Volume({percent})"),
            Command::Login(login) => write!(f, "Login({login:?})"),
            Command::Mute(bytes) => write!(f, "Mute({} bytes)", bytes.len()),
            Command::ConfigQuery => f.write_str("ConfigQuery"),
            Command::ConfigSet(bytes) => write!(f, "ConfigSet({} bytes)", bytes.len()),
            Command::NetworksQuery => f.write_str("NetworksQuery"),
            Command::Stream { stream, on } => {
                write!(f, "Stream {{ stream: {stream:?}, on: {on} }}")
            }
            Command::Engine(engage) => write!(f, "Engine({engage:?})"),
            Command::LogQuery => f.write_str("LogQuery"),
            Command::MotorSpeed(bytes) => write!(f, "MotorSpeed({} bytes)", bytes.len()),
            Command::Unknown(packet) => write!(f, "Unknown({packet:?})"),
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
        if !free {
            return None;
        }
        Some(FileChunk {
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

impl fmt::Debug for FileChunk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FileChunk { id, flags, content } = self;
        let length = content.len();
        write!(
            f,
            "FileChunk {{ id: {id}, flags: {flags}, content: {length} bytes }}"
        )
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

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("***")
    }
}

#[cfg(test)]
mod tests {
    use super::super::Decoder;
    use super::*;
    use proptest::prelude::*;

    fn parse_bytes(mut bytes: &[u8]) -> Command {
        Command::parse(Decoder::new().decode(&mut bytes).unwrap().unwrap())
    }

    /// `PROTOCOL.md`, *TCP messages*, column *to robot*.
    #[test]
    fn every_type_of_the_table_is_parsed_and_encoded() {
        let bytes = Bytes::from_static(b"\x06\x03mp3");
        let sound = FileChunk::of_sound(Sound::User0, 3, bytes.slice(2..)).unwrap();
        assert_eq!((sound.id(), sound.flags()), (6, 3));
        assert_eq!(sound.content(), &b"mp3"[..]);
        let flash = Command::Led {
            led: Led::Flash,
            on: false,
        };
        let video_off = Command::Stream {
            stream: Stream::Video,
            on: false,
        };
        for (kind, payload, meaning) in [
            (0, Bytes::new(), Command::None),
            (1, bytes.clone(), Command::Audio(bytes.clone())),
            (3, Bytes::new(), Command::PowerQuery),
            (4, Bytes::from_static(&[0, 0]), flash),
            (6, bytes.clone(), Command::File(sound)),
            (8, Bytes::new(), Command::StopSound),
            (12, bytes.clone(), Command::Mute(bytes.clone())),
            (13, Bytes::new(), Command::ConfigQuery),
            (13, bytes.clone(), Command::ConfigSet(bytes.clone())),
            (14, Bytes::new(), Command::NetworksQuery),
            (15, Bytes::from_static(&[1, 0]), video_off),
            (17, Bytes::new(), Command::LogQuery),
            (18, bytes.clone(), Command::MotorSpeed(bytes.clone())),
        ] {
            let packet = Packet::new(kind, payload);
            let mut encoded = BytesMut::new();
            packet.emit(&mut encoded);
            assert_eq!(meaning.to_bytes(), encoded, "{meaning:?}");
            assert_eq!(Command::parse(packet), meaning);
        }
    }

    #[test]
    fn emit_leaves_the_content_of_the_buffer_unchanged() {
        let mut out = BytesMut::from(&[0xA5, 0xA5][..]);
        Command::STOP.emit(&mut out);
        assert_eq!(out[..], [0xA5, 0xA5, 0x50, 0x4B, 5, 0, 2, 0, 0]);
    }

    #[test]
    fn a_move_of_three_bytes_is_a_move() {
        let bytes = [0x50, 0x4B, 5, 0, 3, 0x7F, 0x81, 9];
        assert_eq!(
            parse_bytes(&bytes),
            Command::Move {
                left: 127,
                right: -127
            }
        );
    }

    #[test]
    fn odd_lengths_and_unknown_types_are_values() {
        for packet in [
            Packet::new(kind::MOVE, vec![1]),
            Packet::new(kind::LED, vec![]),
            Packet::new(kind::AUTH_REQUEST, vec![9, b'x']),
            Packet::new(kind::AUTH_REPLY, vec![1]),
            Packet::new(200, vec![1, 2, 3]),
        ] {
            assert_eq!(Command::parse(packet.clone()), Command::Unknown(packet));
        }
        assert_eq!(
            parse_bytes(&[0x50, 0x4B, 16, 0, 1, 99]),
            Command::Engine(Engage::Unknown(99))
        );
    }

    #[test]
    fn only_sounds_can_be_uploaded() {
        assert!(FileChunk::of_sound(Sound::Unknown(66), 3, Bytes::new()).is_none());
        assert!(FileChunk::of_sound(Sound::Alarm, 3, Bytes::new()).is_none());
        let chunk = FileChunk::of_sound(Sound::User0, 3, Bytes::from_static(b"mp3")).unwrap();
        let bytes = Command::File(chunk).to_bytes();
        assert_eq!(bytes[..], [0x50, 0x4B, 6, 0, 5, 6, 3, b'm', b'p', b'3']);
    }

    #[test]
    fn names_longer_than_the_length_prefix_allows_are_cut_off() {
        let bytes = Command::Login(Login::new("u".repeat(300), "é€")).to_bytes();
        assert_eq!(bytes[5], 255);
        assert_eq!(bytes[6 + 255..], [2, 0xE9, b'?']);
    }

    proptest! {
        #[test]
        fn any_packet_parses_and_its_encoding_parses_to_the_same(
            kind in any::<u8>(),
            payload in prop::collection::vec(any::<u8>(), 0..64),
        ) {
            let command = Command::parse(Packet::new(kind, payload));
            prop_assert_eq!(parse_bytes(&command.to_bytes()), command);
        }
    }
}
