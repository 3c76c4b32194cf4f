//! Tables for people: plain aligned text, cleaned of control sequences.

use crate::sanitize;

/// The text of a cell, or a dash if there is none.
pub(super) fn or_dash(cell: Option<impl ToString>) -> String {
    cell.map_or_else(|| "-".to_owned(), |cell| cell.to_string())
}

/// Formats rows below a head such as `FILE|>PIXELS`, in which `>` marks a column of numbers,
/// aligned to the right. Columns are as wide as their widest cell, two spaces apart. A row may have
/// fewer cells.
pub(super) fn aligned(head: &str, rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let is_number: Vec<bool> = head
        .split('|')
        .map(|title| title.starts_with('>'))
        .collect();
    let titles = head
        .split('|')
        .map(|title| title.trim_start_matches('>').to_owned());
    let rows: Vec<Vec<String>> = std::iter::once(titles.collect())
        .chain(rows)
        .map(|row: Vec<String>| row.iter().map(|cell| sanitize::line(cell)).collect())
        .collect();
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..is_number.len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).zip(&is_number);
        let cells: Vec<String> = cells
            .map(|((cell, width), is_number)| match is_number {
                false => format!("{cell:width$}"),
                true => format!("{cell:>width$}"),
            })
            .collect();
        format!("{}\n", cells.join("  ").trim_end())
    };
    rows.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_left_numbers_right_and_no_blanks_trail() {
        let row = |cells: &[&str]| cells.iter().map(|cell| (*cell).to_owned()).collect();
        let rows = [
            row(&["a.jpg", "7", "yes"]),
            row(&["\x1b[2Jlong\n.jpg", "12"]),
        ];
        let expected = "FILE          PIXELS  EDGE\n\
                        a.jpg              7  yes\n\
                        [2Jlong .jpg      12\n";
        assert_eq!(aligned("FILE|>PIXELS|EDGE", rows), expected);
    }
}
