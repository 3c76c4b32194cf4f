//! Checks that every citation of `PROTOCOL.md` in the code names one of its sections.

use std::path::{Path, PathBuf};

const PAGE: &str = include_str!("../../src/wire/PROTOCOL.md");
const NAME: &str = "`PROTOCOL.md`, ";

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    paths
        .flat_map(|path| {
            if path.is_dir() {
                rust_files(&path)
            } else {
                vec![path]
            }
        })
        .filter(|path| path.extension().is_some_and(|extension| extension == "rs"))
        .collect()
}

/// A text without line breaks and comment marks, so that a citation may span two lines.
fn joined(text: &str) -> String {
    let lines = text.lines().map(|line| {
        let line = line.trim_start();
        line.trim_start_matches(['/', '!']).trim()
    });
    lines.flat_map(|line| [line, " "]).collect()
}

/// The sections that a text cites, as `*A section*` or `MESSAGE`.
fn citations(text: &str) -> Vec<String> {
    let text = joined(text);
    let cited = text
        .split(NAME)
        .skip(1)
        .map(|rest| match rest.strip_prefix('*') {
            Some(section) => section.split('*').next().unwrap_or_default().to_owned(),
            None => {
                let name = rest.chars();
                name.take_while(|c| c.is_ascii_uppercase() || *c == '_')
                    .collect()
            }
        });
    cited.collect()
}

#[test]
fn every_citation_of_the_protocol_names_a_section() {
    let headings = PAGE.lines().filter_map(|line| line.strip_prefix("##"));
    let headings: Vec<&str> = headings
        .map(|line| line.trim_start_matches('#').trim())
        .collect();
    let (mut count, mut wrong) = (0, Vec::new());
    for file in rust_files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src")) {
        for section in citations(&std::fs::read_to_string(&file).unwrap()) {
            count += 1;
            if !headings.contains(&section.as_str()) {
                wrong.push(format!(
                    "{}: there is no section {section:?}",
                    file.display()
                ));
            }
        }
    }
    assert!(count > 25, "only {count} citations");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn citations_are_found_across_lines() {
    let text =
        "//! Text (`PROTOCOL.md`,\n//! *Order after\n    /// login*) and `PROTOCOL.md`, LED.";
    assert_eq!(citations(text), ["Order after login", "LED"]);
}
