//! Removes addresses from texts. Luau prints values without a text form with their addresses, such
//! as `table: 0x00007f42c8a0b3d0`. Addresses differ from run to run and reveal the memory layout of
//! the process, so they are removed from all output of a script.

use std::borrow::Cow;

const MARK: &str = ": 0x";
/// Digits of an address: some of Luau's functions print leading zeros, some do not.
const DIGITS: std::ops::RangeInclusive<usize> = 11..=16;

/// Returns the text with `table` in place of `table: 0x00007f42c8a0b3d0`.
pub(super) fn without_addresses(text: &str) -> Cow<'_, str> {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(MARK) {
        let (before, marked) = rest.split_at(at);
        let digits = marked[MARK.len()..]
            .bytes()
            .take_while(u8::is_ascii_hexdigit)
            .count();
        let length = if DIGITS.contains(&digits) && ends_with_type_name(before) {
            MARK.len() + digits
        } else {
            out.push_str(before);
            out.push_str(MARK);
            rest = &marked[MARK.len()..];
            continue;
        };
        out.push_str(before);
        rest = &marked[length..];
    }
    if out.is_empty() && rest.len() == text.len() {
        return Cow::Borrowed(text);
    }
    out.push_str(rest);
    Cow::Owned(out)
}

/// Whether the last word is a Luau type, or one of our objects, whose names are capitalised.
fn ends_with_type_name(before: &str) -> bool {
    let word = before
        .rsplit(|letter: char| !letter.is_ascii_alphanumeric())
        .next();
    let word = word.unwrap_or_default();
    matches!(
        word,
        "table" | "function" | "thread" | "userdata" | "buffer"
    ) || word.starts_with(|letter: char| letter.is_ascii_uppercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_values_are_removed_and_other_hex_numbers_stay() {
        for (text, shown) in [
            ("table: 0x00007fa3d80b2b70", "table"),
            ("a.lua:3: table: 0x7fa3d80b2a50", "a.lua:3: table"),
            (
                "{} function: 0x00007fa3d8099520 Task: 0x00007fa3d80b2bb0 x",
                "{} function Task x",
            ),
            ("id: 0x00007fa3d8099520", "id: 0x00007fa3d8099520"),
            ("table: 0xff", "table: 0xff"),
            ("table: 0x00007fa3d80b2b7000", "table: 0x00007fa3d80b2b7000"),
            ("table: 0xtable: 0x00007fa3d80b2b70", "table: 0xtable"),
            (": 0x", ": 0x"),
            ("", ""),
        ] {
            assert_eq!(without_addresses(text), shown);
        }
    }
}
