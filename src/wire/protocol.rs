//! Checks `PROTOCOL.md` and the code against each other.

use super::{Command, Decoder, Report};

const PAGE: &str = include_str!("PROTOCOL.md");

/// The rows of *Byte vectors*: their meanings and bytes.
fn vectors() -> Vec<(&'static str, Vec<u8>)> {
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

#[test]
fn every_byte_vector_of_the_page_is_one_known_message() {
    let vectors = vectors();
    assert_eq!(vectors.len(), 20);
    for (meaning, bytes) in vectors {
        let packet = Decoder::new().decode(&mut &bytes[..]).unwrap();
        let packet = packet.unwrap_or_else(|| panic!("{meaning}: the message is incomplete"));
        let report = Report::parse(packet.clone());
        let command = Command::parse(packet);
        let known = [
            (!matches!(report, Report::Unknown(_)), report.to_bytes()),
            (!matches!(command, Command::Unknown(_)), command.to_bytes()),
        ];
        assert!(
            known
                .iter()
                .any(|(known, again)| *known && again[..] == bytes),
            "{meaning}: {report:?} or {command:?}"
        );
    }
}

#[test]
fn every_message_type_of_the_page_has_its_constant() {
    let source = include_str!("mod.rs");
    let rows = PAGE.lines().filter_map(|line| {
        let mut cells = line.strip_prefix("| ")?.split(" | ");
        let number = cells.next()?.parse::<u8>().ok()?;
        let name = cells.next()?;
        let is_type = name.chars().all(|c| c.is_ascii_uppercase() || c == '_');
        is_type.then(|| format!("pub const {name}: u8 = {number};"))
    });
    let rows: Vec<String> = rows.collect();
    assert_eq!(rows.len(), 19);
    for row in rows {
        assert!(source.contains(&row), "{row}");
    }
}
