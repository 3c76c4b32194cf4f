//! Arbitrary bytes, in slices of any size, through the decoder; every packet is interpreted as a
//! report and as a command.
#![no_main]

use bytes::BytesMut;
use libfuzzer_sys::fuzz_target;
use spykee::wire::{Command, Decoder, MAX_PACKET_LEN, Packet, Report};

fuzz_target!(|input: &[u8]| {
    let Some((&count, rest)) = input.split_first() else {
        return;
    };
    let (cuts, stream) = rest.split_at(rest.len().min(usize::from(count % 8)));
    let packets = decode(stream, cuts);
    assert_eq!(packets, decode(stream, &[]), "slices change the result");
    packets.into_iter().for_each(interpret);
});

/// Decodes the stream in slices, with the lengths in `cuts` in rotation.
fn decode(stream: &[u8], cuts: &[u8]) -> Vec<Packet> {
    let mut decoder = Decoder::new();
let mut packets = Vec::new();
    let mut lengths = cuts.iter().map(|&cut| usize::from(cut).max(1)).cycle();
    let mut rest = stream;
    while !rest.is_empty() {
        let cut = lengths.next().unwrap_or(usize::MAX).min(rest.len());
        let (mut slice, tail) = rest.split_at(cut);
        loop {
            match decoder.decode(&mut slice) {
                Ok(Some(packet)) => packets.push(packet),
                Ok(None) => break,
                Err(_) => return packets,
            }
        }
        assert!(slice.is_empty(), "bytes left over");
        assert!(
            decoder.buffered() <= MAX_PACKET_LEN,
            "holds more than one message"
        );
        rest = tail;
    }
    packets
}

/// Checks that a parsed packet, emitted and parsed again, is the same and fits into one message.
fn interpret(packet: Packet) {
    let mut out = BytesMut::new();
let report = Report::parse(packet.clone());
    report.emit(&mut out);
    assert_eq!(Report::parse(only_packet(&out)), report);
    let mut out = BytesMut::new();
let command = Command::parse(packet);
    command.emit(&mut out);
    assert_eq!(Command::parse(only_packet(&out)), command);
}

fn only_packet(mut bytes: &[u8]) -> Packet {
    assert!(bytes.len() <= MAX_PACKET_LEN);
    let packet = Decoder::new().decode(&mut bytes);
    assert!(bytes.is_empty());
    packet.expect("in step").expect("whole")
}
