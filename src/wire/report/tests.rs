use super::super::Decoder;
use super::*;
use proptest::prelude::*;

fn parse_bytes(mut bytes: &[u8]) -> Report {
    Report::parse(Decoder::new().decode(&mut bytes).unwrap().unwrap())
}

/// The vectors of `PROTOCOL.md`, *Byte vectors*.
fn golden() -> Vec<(Report, &'static [u8])> {
    let accepted = Accepted {
        uid: "SPYKEE0001".into(),
        name: "Spykee".into(),
        place: "home".into(),
        firmware: "1.0.22".into(),
        docked: true,
        tail: Bytes::new(),
    };
    let recorded = Accepted {
        docked: false,
        tail: Bytes::from_static(Accepted::RECORDED_TAIL),
        ..accepted.clone()
    };
    vec![
        (
            Report::Accepted(recorded),
            &[
                0x50, 0x4B, 0x0B, 0x00, 0x22, 0x01, 0x0A, 0x53, 0x50, 0x59, 0x4B, 0x45, 0x45, 0x30,
                0x30, 0x30, 0x31, 0x06, 0x53, 0x70, 0x79, 0x6B, 0x65, 0x65, 0x04, 0x68, 0x6F, 0x6D,
                0x65, 0x06, 0x31, 0x2E, 0x30, 0x2E, 0x32, 0x32, 0x01, 0x01, 0x02,
            ],
        ),
        (
            Report::Accepted(accepted),
            &[
                0x50, 0x4B, 0x0B, 0x00, 0x20, 0x01, 0x0A, 0x53, 0x50, 0x59, 0x4B, 0x45, 0x45, 0x30,
                0x30, 0x30, 0x31, 0x06, 0x53, 0x70, 0x79, 0x6B, 0x65, 0x65, 0x04, 0x68, 0x6F, 0x6D,
                0x65, 0x06, 0x31, 0x2E, 0x30, 0x2E, 0x32, 0x32, 0x00,
            ],
        ),
        (
            Report::Refused(Refusal::WrongPassword),
            &[0x50, 0x4B, 0x0B, 0x00, 0x02, 0x00, 0x01],
        ),
        (
            Report::Refused(Refusal::InUse),
            &[0x50, 0x4B, 0x0B, 0x00, 0x02, 0x00, 0x03],
        ),
        (
            Report::Power(Power {
                percent: 80,
                charging: false,
            }),
            &[0x50, 0x4B, 0x03, 0x00, 0x01, 0x50],
        ),
        (
            Report::Power(Power {
                percent: 80,
                charging: true,
            }),
            &[0x50, 0x4B, 0x03, 0x00, 0x01, 0xB0],
        ),
        (
            Report::Engine(EngineReport::Docked),
            &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x02],
        ),
        (
            Report::Engine(EngineReport::BaseNotFound),
            &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x08],
        ),
    ]
}

#[test]
fn golden_vectors_hold_in_both_directions() {
    for (report, bytes) in golden() {
        assert_eq!(&report.to_bytes()[..], bytes, "{report:?}");
        assert_eq!(parse_bytes(bytes), report);
    }
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
fn levels_up_to_a_hundred_are_parsed_and_levels_beyond_are_unknown() {
    for byte in 0..=u8::MAX {
        let level = i16::from(i8::from_be_bytes([byte]));
        let packet = Packet::new(kind::POWER, vec![byte]);
        let expected = match level.abs() {
            0..=100 => Report::Power(Power {
                percent: level.unsigned_abs() as u8,
                charging: level < 0,
            }),
            _ => Report::Unknown(packet.clone()),
        };
        assert_eq!(Report::parse(packet), expected, "{level}");
    }
}

#[test]
fn bytes_after_the_docked_flag_change_nothing() {
    let payload = [&[1, 1, b'S', 0, 0, 0, 1][..], &[7, 7, 7]].concat();
    let Report::Accepted(accepted) = Report::parse(Packet::new(kind::AUTH_REPLY, payload)) else {
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
