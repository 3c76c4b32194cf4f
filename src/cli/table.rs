//! Tables for people: plain aligned text, cleaned of control sequences.

use crate::sanitize;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Left,
    Right,
}

/// Formats rows below a header; columns are as wide as their widest cell, two spaces apart. A row
/// may have fewer cells.
pub(super) fn aligned(head: &[(&str, Side)], rows: &[Vec<String>]) -> String {
    let titles = head.iter().map(|(title, _)| (*title).to_owned()).collect();
    let rows: Vec<Vec<String>> = std::iter::once(&titles)
        .chain(rows)
        .map(|row| row.iter().map(|cell| sanitize::line(cell)).collect())
        .collect();
    let columns: Vec<(usize, Side)> = head
        .iter()
        .enumerate()
        .map(|(column, (_, side))| (width(&rows, column), *side))
        .collect();
    rows.iter().map(|row| line(row, &columns)).collect()
}

fn width(rows: &[Vec<String>], column: usize) -> usize {
    let cells = rows.iter().filter_map(|row| row.get(column));
    cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
}

fn line(row: &[String], columns: &[(usize, Side)]) -> String {
    let cells: Vec<String> = row
        .iter()
        .zip(columns)
        .map(|(cell, (width, side))| match side {
            Side::Left => format!("{cell:width$}"),
            Side::Right => format!("{cell:>width$}"),
        })
        .collect();
    format!("{}\n", cells.join("  ").trim_end())
}

/// Characters that start a formula; some programs also accept their East Asian wide forms.
const FORMULAS: [char; 8] = [
    '=', '+', '-', '@', '\u{ff1d}', '\u{ff0b}', '\u{ff0d}', '\u{ff20}',
];

/// A CSV cell: quoted if necessary, and never read as a formula, since the text is untrusted.
pub(super) fn csv_cell(text: &str) -> String {
    let mut text = sanitize::text(text, false).replace(['\n', '\r', '\t'], " ");
    if text.starts_with(FORMULAS) {
        text.insert(0, '\'');
    }
    if text.contains([',', '"', ';']) {
        text = format!("\"{}\"", text.replace('"', "\"\""));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_left_numbers_right_and_no_blanks_trail() {
        let row = |cells: &[&str]| cells.iter().map(|cell| (*cell).to_owned()).collect();
        let head = [
            ("FILE", Side::Left),
            ("PIXELS", Side::Right),
            ("EDGE", Side::Left),
        ];
        let rows = [
            row(&["a.jpg", "7", "yes"]),
            row(&["\x1b[2Jlong\n.jpg", "12"]),
        ];
        let expected = "FILE          PIXELS  EDGE\n\
                        a.jpg              7  yes\n\
                        [2Jlong .jpg      12\n";
        assert_eq!(aligned(&head, &rows), expected);
    }

    #[test]
    fn a_csv_cell_is_one_cell_and_not_a_formula() {
        for (text, cell) in [
            ("Ada", "Ada"),
            ("a, b", "\"a, b\""),
            ("it \"drives\"\naway", "\"it \"\"drives\"\" away\""),
            ("=HYPERLINK(1)", "'=HYPERLINK(1)"),
            ("\u{ff1d}1", "'\u{ff1d}1"),
        ] {
            assert_eq!(csv_cell(text), cell);
        }
    }
}
