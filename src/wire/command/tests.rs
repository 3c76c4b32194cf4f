//! Encoding and decoding of commands.

use super::*;
use crate::wire::Decoder;
use proptest::prelude::*;

fn parse_bytes(mut bytes: &[u8]) -> Command {
    Command::parse(Decoder::new().decode(&mut bytes).unwrap().unwrap())
}

/// The vectors of `PROTOCOL.md`, *Byte vectors*.
fn golden() -> Vec<(Command, &'static [u8])> {
    vec![
        (
            Command::Login(Login::new("admin", "admin")),
            &[
                0x50, 0x4B, 0x0A, 0x00, 0x0C, 0x05, 0x61, 0x64, 0x6D, 0x69, 0x6E, 0x05, 0x61, 0x64,
                0x6D, 0x69, 0x6E,
            ],
        ),
        (
            Command::Move {
                left: 50,
                right: 50,
            },
            &[0x50, 0x4B, 0x05, 0x00, 0x02, 0x32, 0x32],
        ),
        (
            Command::Move {
                left: -90,
                right: 90,
            },
            &[0x50, 0x4B, 0x05, 0x00, 0x02, 0xA6, 0x5A],
        ),
        (Command::STOP, &[0x50, 0x4B, 0x05, 0x00, 0x02, 0x00, 0x00]),
        (
            Command::Led {
                led: Led::Flash,
                on: true,
            },
            &[0x50, 0x4B, 0x04, 0x00, 0x02, 0x00, 0x01],
        ),
        (
            Command::Stream {
                stream: Stream::Video,
                on: true,
            },
            &[0x50, 0x4B, 0x0F, 0x00, 0x02, 0x01, 0x01],
        ),
        (
            Command::Engine(Engage::Undock),
            &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x05],
        ),
        (
            Command::Engine(Engage::Dock),
            &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x06],
        ),
        (
            Command::Engine(Engage::CancelDock),
            &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x07],
        ),
        (
            Command::Play(Sound::Laser),
            &[0x50, 0x4B, 0x07, 0x00, 0x01, 0x02],
        ),
        (Command::StopSound, &[0x50, 0x4B, 0x08, 0x00, 0x00]),
        (Command::Volume(50), &[0x50, 0x4B, 0x09, 0x00, 0x01, 0x32]),
    ]
}

#[test]
fn golden_vectors_hold_in_both_directions() {
    for (command, bytes) in golden() {
        assert_eq!(&command.to_bytes()[..], bytes, "{command:?}");
        assert_eq!(parse_bytes(bytes), command);
    }
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
fn empty_and_filled_config_differ() {
    assert_eq!(
        Command::parse(Packet::new(kind::CONFIG, vec![])),
        Command::ConfigQuery
    );
    let set = Command::ConfigSet(Bytes::from_static(b"volume=3"));
    assert_eq!(parse_bytes(&set.to_bytes()), set);
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
fn debug_output_never_shows_a_password() {
    let shown = format!("{:?}", Command::Login(Login::new("admin", "hunter2")));
    assert!(!shown.contains("hunter2"), "{shown}");
    assert!(shown.contains("password: ***"), "{shown}");
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
