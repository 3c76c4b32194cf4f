//! Colours of the things in a world, by name or as `#rrggbb`.

use serde::{Deserialize, Deserializer};

use crate::yaml;

const NAMED: [(&str, [u8; 3]); 12] = [
    ("red", [206, 28, 36]),
    ("orange", [238, 120, 20]),
    ("yellow", [240, 208, 24]),
    ("green", [36, 160, 60]),
    ("cyan", [30, 190, 210]),
    ("blue", [32, 76, 200]),
    ("magenta", [200, 40, 160]),
    ("white", [236, 236, 232]),
    ("black", [26, 26, 28]),
    ("grey", [128, 128, 126]),
    ("brown", [112, 74, 44]),
    ("beige", [206, 188, 154]),
];

/// A colour: red, green and blue, 0..=255, under full light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Paint(pub [u8; 3]);

impl Paint {
    /// Parses a colour name or `#rrggbb`.
    pub fn parse(text: &str) -> Option<Paint> {
        let named = NAMED.iter().find(|(name, _)| *name == text);
        named
            .map(|(_, rgb)| Paint(*rgb))
            .or_else(|| Paint::parse_hex(text))
    }

    fn parse_hex(text: &str) -> Option<Paint> {
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6)?;
        if !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return None;
        }
        let number = u32::from_str_radix(digits, 16).ok()?;
        let [_, red, green, blue] = number.to_be_bytes();
        Some(Paint([red, green, blue]))
    }
}

impl<'de> Deserialize<'de> for Paint {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Paint, D::Error> {
        let names = NAMED.map(|(name, _)| name).join(", ");
        let expected = format!("a colour: {names}, or \"#rrggbb\" in quotes");
        yaml::known_text(from, &expected, Paint::parse)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_parsed_from_names_and_hex() {
        assert_eq!(Paint::parse("#0A141e"), Some(Paint([10, 20, 30])));
        assert_eq!(Paint::parse("red"), Some(Paint([206, 28, 36])));
        for wrong in ["rot", "#12", "#gg0000", "", "#+12345"] {
            assert_eq!(Paint::parse(wrong), None, "{wrong}");
        }
    }
}
