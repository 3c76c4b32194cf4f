//! The robot's wire protocol: encodes and decodes messages in both directions, and the discovery
//! datagrams. Uses no socket and no clock. Facts cite sections of the specification below.
//! [`Decoder`] splits a byte stream into [`Packet`]s; [`Report`] and [`Command`] interpret a
//! packet. Anything that the protocol does not define becomes a value (`Unknown`), never an error.
//!
//! ```
//! use wire::{Command, Decoder, Report};
//!
//! assert_eq!(&Command::STOP.to_bytes()[..], b"PK\x05\x00\x02\x00\x00");
//!
//! // POWER: 57 percent, not charging. A stream may arrive in any pieces.
//! let mut decoder = Decoder::new();
//! let mut input: &[u8] = b"PK\x03\x00\x01\x39PK\x10";
//! let packet = decoder.decode(&mut input)?.expect("a whole packet has arrived");
//! let Report::Power(power) = Report::parse(packet) else { panic!("not POWER") };
//! assert_eq!((power.percent, power.charging), (57, false));
//! assert!(decoder.decode(&mut input)?.is_none());
//! # Ok::<(), wire::FramingError>(())
//! ```
#![doc = ""]
#![doc = include_str!("PROTOCOL.md")]
#![warn(missing_docs)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

mod command;
pub mod discovery;
mod packet;
mod report;
mod text;
mod values;

pub use command::{Command, FileChunk, Login, Secret};
pub use packet::{Decoder, FramingError, HEADER_LEN, MAX_PACKET_LEN, MAX_PAYLOAD_LEN, Packet};
pub use report::{Accepted, Power, Report};
pub use text::{
    Network, Setting, join_settings, latin1, parse_networks, parse_settings, to_latin1,
};
pub use values::{Engage, EngineReport, Led, Refusal, Sound, Stream};

/// TCP and UDP port of the robot (`PROTOCOL.md`, *Network*).
pub const PORT: u16 = 9000;

/// The message types (`PROTOCOL.md`, *TCP messages*).
#[expect(missing_docs, reason = "the page describes each type")]
pub mod kind {
    pub const NONE: u8 = 0;
    pub const AUDIO: u8 = 1;
    pub const VIDEO: u8 = 2;
    pub const POWER: u8 = 3;
    pub const LED: u8 = 4;
    pub const MOVE: u8 = 5;
    pub const FILE: u8 = 6;
    pub const PLAY: u8 = 7;
    pub const STOP: u8 = 8;
    pub const VOLUME: u8 = 9;
    pub const AUTH_REQUEST: u8 = 10;
    pub const AUTH_REPLY: u8 = 11;
    pub const MUTE: u8 = 12;
    pub const CONFIG: u8 = 13;
    pub const WIRELESS_NETWORKS: u8 = 14;
    pub const STREAMCTL: u8 = 15;
    pub const ENGINE: u8 = 16;
    pub const LOG: u8 = 17;
    pub const MOTOR_SPEED: u8 = 18;
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    const PAGE: &str = include_str!("PROTOCOL.md");

    /// The rows of *Byte vectors*: their meanings and bytes.
    fn vectors() -> BTreeMap<&'static str, Vec<u8>> {
        let (_, section) = PAGE.split_once("\n## Byte vectors\n").unwrap();
        let (section, _) = section.split_once("\n## ").unwrap();
        let rows = section.lines().filter_map(|line| {
            let (meaning, bytes) = line.strip_prefix("| ")?.split_once(" | `")?;
            let bytes = bytes.strip_suffix("` |")?.split(' ');
            let bytes = bytes.map(|byte| u8::from_str_radix(byte, 16).unwrap());
            Some((meaning, bytes.collect()))
        });
        rows.collect()
    }

    fn commands() -> [(&'static str, Command); 12] {
        let moves = |left, right| Command::Move { left, right };
        let led = Led::Flash;
        let stream = Stream::Video;
        [
            (
                "log in as admin with admin",
                Command::Login(Login::new("admin", "admin")),
            ),
            ("both tracks forward at 50", moves(50, 50)),
            (
                "turn on the spot: left back, right forward, at 90",
                moves(-90, 90),
            ),
            ("stop the tracks", Command::STOP),
            ("headlight on", Command::Led { led, on: true }),
            ("video on", Command::Stream { stream, on: true }),
            ("undock", Command::Engine(Engage::Undock)),
            ("dock", Command::Engine(Engage::Dock)),
            ("stop searching", Command::Engine(Engage::CancelDock)),
            ("play the laser", Command::Play(Sound::Laser)),
            ("stop the music", Command::StopSound),
            ("volume 50 %", Command::Volume(50)),
        ]
    }

    fn reports() -> [(&'static str, Report); 8] {
        let percent = 80;
        let power = |charging| Report::Power(Power { percent, charging });
        let accepted = Accepted {
            uid: "SPYKEE0001".into(),
            name: "Spykee".into(),
            place: "home".into(),
            firmware: "1.0.22".into(),
            docked: true,
            tail: bytes::Bytes::new(),
        };
        let recorded = Accepted {
            docked: false,
            tail: bytes::Bytes::from_static(Accepted::RECORDED_TAIL),
            ..accepted.clone()
        };
        [
            (
                "accepted: uid SPYKEE0001, names Spykee and home, firmware 1.0.22, docked",
                Report::Accepted(accepted),
            ),
            (
                "accepted: the same, not docked, with the last two bytes of a recorded reply",
                Report::Accepted(recorded),
            ),
            (
                "refused: wrong password",
                Report::Refused(Refusal::WrongPassword),
            ),
            (
                "refused: someone else is connected",
                Report::Refused(Refusal::InUse),
            ),
            ("battery at 80 %, discharging", power(false)),
            ("battery at 80 %, charging", power(true)),
            ("docked", Report::Engine(EngineReport::Docked)),
            (
                "station not found",
                Report::Engine(EngineReport::BaseNotFound),
            ),
        ]
    }

    #[test]
    fn every_byte_vector_of_the_page_holds_in_both_directions() {
        let vectors = vectors();
        let packet = |bytes: &[u8]| Decoder::new().decode(&mut &*bytes).unwrap().unwrap();
        for (meaning, command) in commands() {
            let bytes = &vectors[meaning];
            assert_eq!(command.to_bytes(), bytes, "{meaning}");
            assert_eq!(Command::parse(packet(bytes)), command, "{meaning}");
        }
        for (meaning, report) in reports() {
            let bytes = &vectors[meaning];
            assert_eq!(report.to_bytes(), bytes, "{meaning}");
            assert_eq!(Report::parse(packet(bytes)), report, "{meaning}");
        }
        assert_eq!(vectors.len(), commands().len() + reports().len());
    }

    #[test]
    fn every_message_type_of_the_page_has_its_constant() {
        let source = include_str!("lib.rs");
        let rows = PAGE.lines().filter_map(|line| {
            let mut cells = line.strip_prefix("| ")?.split(" | ");
            let number = cells.next()?.parse::<u8>().ok()?;
            let name = cells.next()?;
            let is_type = name.chars().all(|c| c.is_ascii_uppercase() || c == '_');
            if !is_type {
                return None;
            }
            Some(format!("pub const {name}: u8 = {number};"))
        });
        let rows: Vec<String> = rows.collect();
        assert_eq!(rows.len(), 19);
        for row in rows {
            assert!(source.contains(&row), "{row}");
        }
    }

    #[test]
    fn debug_output_never_contains_a_payload() {
        let secret = "hunter2";
        let chunk = FileChunk::of_sound(Sound::User0, 3, secret.into()).unwrap();
        // A truncated login is not parsed as one, but still contains the password.
        let mut login = Command::Login(Login::new("anna", secret)).to_bytes();
        login.truncate(login.len() - 1);
        let torn = Packet::new(kind::AUTH_REQUEST, login.slice(5..));
        let setting = Setting {
            key: "wifi-key".into(),
            value: secret.into(),
        };
        for shown in [
            format!("{:?}", Command::ConfigSet(secret.into())),
            format!("{:?}", Command::Audio(secret.into())),
            format!("{:?}", Command::File(chunk)),
            format!("{:?}", Command::Login(Login::new("anna", secret))),
            format!("{:?}", Command::parse(torn)),
            format!("{:?}", Report::Config(secret.into())),
            format!("{:?}", Report::Networks(secret.into())),
            format!("{:?}", Report::Log(secret.into())),
            format!("{setting:?}"),
        ] {
            assert!(
                !shown.contains("hunter") && !shown.contains("104, 117"),
                "{shown}"
            );
        }
        assert_eq!(
            format!("{:?}", Report::Config(secret.into())),
            "Config(7 bytes)"
        );
        assert_eq!(
            format!("{setting:?}"),
            "Setting { key: \"wifi-key\", value: 7 bytes }"
        );
        let chunk = FileChunk::of_sound(Sound::User0, 3, secret.into()).unwrap();
        let shown = format!("{chunk:?}");
        assert!(shown.starts_with("FileChunk { id:") && shown.ends_with("content: 7 bytes }"));
    }
}
