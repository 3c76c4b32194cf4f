//! A font of three by five dots, sufficient for names and numbers in a picture.

/// The dots of each letter, row by row; the highest of 15 bits is the top left one.
const GLYPHS: [(char, u16); 41] = [
    ('A', 0b010_101_111_101_101),
    ('B', 0b110_101_110_101_110),
    ('C', 0b011_100_100_100_011),
    ('D', 0b110_101_101_101_110),
    ('E', 0b111_100_110_100_111),
    ('F', 0b111_100_110_100_100),
    ('G', 0b011_100_101_101_011),
    ('H', 0b101_101_111_101_101),
    ('I', 0b111_010_010_010_111),
    ('J', 0b001_001_001_101_010),
    ('K', 0b101_101_110_101_101),
    ('L', 0b100_100_100_100_111),
    ('M', 0b101_111_111_101_101),
    ('N', 0b110_101_101_101_101),
    ('O', 0b010_101_101_101_010),
    ('P', 0b110_101_110_100_100),
    ('Q', 0b010_101_101_010_001),
    ('R', 0b110_101_110_101_101),
    ('S', 0b011_100_010_001_110),
    ('T', 0b111_010_010_010_010),
    ('U', 0b101_101_101_101_111),
    ('V', 0b101_101_101_101_010),
    ('W', 0b101_101_111_111_101),
    ('X', 0b101_101_010_101_101),
    ('Y', 0b101_101_010_010_010),
    ('Z', 0b111_001_010_100_111),
    ('0', 0b111_101_101_101_111),
    ('1', 0b010_110_010_010_111),
    ('2', 0b110_001_010_100_111),
    ('3', 0b110_001_010_001_110),
    ('4', 0b101_101_111_001_001),
    ('5', 0b111_100_110_001_110),
    ('6', 0b011_100_111_101_111),
    ('7', 0b111_001_010_010_010),
    ('8', 0b111_101_111_101_111),
    ('9', 0b111_101_111_001_110),
    ('-', 0b000_000_111_000_000),
    ('_', 0b000_000_000_000_111),
    ('.', 0b000_000_000_000_010),
    ('#', 0b101_111_101_111_101),
    ('+', 0b000_010_111_010_000),
];

/// Columns of a letter, without the gap after it.
pub(crate) const WIDTH: i32 = 3;
/// Rows of a letter.
pub(crate) const HEIGHT: i32 = 5;

/// The dots of a letter as column and row. Lower-case letters look like upper-case ones; unknown
/// letters are empty.
pub(crate) fn dots(letter: char) -> impl Iterator<Item = (i32, i32)> {
    let letter = letter.to_ascii_uppercase();
    let bits = GLYPHS
        .iter()
        .find(|glyph| glyph.0 == letter)
        .map_or(0, |glyph| glyph.1);
    (0..WIDTH * HEIGHT)
        .filter(move |dot| bits >> (WIDTH * HEIGHT - 1 - dot) & 1 == 1)
        .map(|dot| (dot % WIDTH, dot / WIDTH))
}
