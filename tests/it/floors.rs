//! Checks every path into the crate against the table of floors in `src/lib.rs`: a module may
//! import only from floors below its own.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The floor of a module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Floor {
    Number(u32),
    /// `side`: imports floor 0 only.
    Side,
}

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// Rows such as ``//! | 2 | `link` | connect ... |``.
fn floors(lib: &str) -> BTreeMap<String, Floor> {
    let row = |line: &str| {
        let mut cells = line.strip_prefix("//! |")?.split('|').map(str::trim);
        let (floor, module) = (cells.next()?, cells.next()?);
        let floor = match floor {
            "side" => Floor::Side,
            number => Floor::Number(number.parse().ok()?),
        };
        Some((module.trim_matches('`').to_owned(), floor))
    };
    lib.lines().filter_map(row).collect()
}

/// All crate-level modules that a source text names with `crate::`, including groups such as
/// `crate::{wire, robot::Event}`; comments are ignored.
fn imports(text: &str) -> BTreeSet<String> {
    let code = without_comment_lines(text);
    let mut found = BTreeSet::new();
    for (at, path) in code.match_indices("crate::") {
        let within_a_name =
            code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == '$');
        if within_a_name && !code[..at].ends_with('$') {
            continue;
        }
        let rest = code[at + path.len()..].trim_start();
        match rest.strip_prefix('{') {
            Some(group) => found.extend(heads_of_group(group)),
            None => found.extend(head(rest)),
        }
    }
    found
}

fn head(path: &str) -> Option<String> {
    let name: String = path
        .chars()
        .take_while(|c| c.is_alphanumeric() || *c == '_')
        .collect();
    (!name.is_empty()).then_some(name)
}

/// The first names of `a::b, c::{d, e}, f}`.
fn heads_of_group(group: &str) -> Vec<String> {
    let (mut depth, mut heads, mut item) = (0, Vec::new(), String::new());
    for c in group.chars() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => heads.extend(head(std::mem::take(&mut item).trim())),
            _ => {}
        }
        if depth == 0 && c != ',' {
            item.push(c);
        }
    }
    heads.extend(head(item.trim()));
    heads
}

/// A path in a string or in a comment behind code counts as an import: that fails visibly, while a
/// smarter parser might miss an import.
fn without_comment_lines(text: &str) -> String {
    let is_code = |line: &&str| !line.trim_start().starts_with("//");
    text.lines()
        .filter(is_code)
        .flat_map(|line| [line, "\n"])
        .collect()
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files
}

/// `src/link/mod.rs` and `src/link.rs` belong to `link`; `lib.rs` and `main.rs` belong to no
/// module.
fn module_of(file: &Path) -> Option<String> {
    let inside = file.strip_prefix(source()).unwrap();
    let first = Path::new(inside.components().next().unwrap().as_os_str());
    let name = first.file_stem().unwrap().to_str().unwrap().to_owned();
    (!matches!(name.as_str(), "lib" | "main")).then_some(name)
}

/// Describes what is wrong with an import, if anything.
fn verdict(floors: &BTreeMap<String, Floor>, from: &str, to: &str) -> Result<(), String> {
    let floor = |module: &str| {
        let known = floors.get(module).copied();
        known.ok_or_else(|| format!("`{module}` is not in the floors table of src/lib.rs"))
    };
    let allowed = match (floor(from)?, floor(to)?) {
        _ if from == to => true,
        (Floor::Side, to) => to == Floor::Number(0),
        (Floor::Number(_), Floor::Side) => is_top(floors, from),
        (Floor::Number(from), Floor::Number(to)) => to < from,
    };
    allowed
        .then_some(())
        .ok_or_else(|| format!("`{from}` must not import `{to}`"))
}

/// Only wiring and commands may start a simulator: the three top floors.
fn is_top(floors: &BTreeMap<String, Floor>, module: &str) -> bool {
    let number = |floor: &Floor| match floor {
        Floor::Number(number) => Some(*number),
        Floor::Side => None,
    };
    let top = floors.values().filter_map(number).max().unwrap_or(0);
    floors
        .get(module)
        .and_then(number)
        .is_some_and(|floor| floor + 2 >= top)
}

/// Modules that import themselves through others. The floors forbid it; this checks the table
/// itself.
fn circles(graph: &BTreeMap<String, BTreeSet<String>>) -> Vec<String> {
    let reaches_itself = |start: &String| {
        let mut seen = BTreeSet::new();
        let mut open: Vec<&String> = graph[start].iter().filter(|to| *to != start).collect();
        while let Some(module) = open.pop() {
            if module == start {
                return true;
            }
            if seen.insert(module) {
                open.extend(graph.get(module).into_iter().flatten());
            }
        }
        false
    };
    graph
        .keys()
        .filter(|module| reaches_itself(module))
        .cloned()
        .collect()
}

#[test]
fn every_module_imports_only_from_lower_floors() {
    let floors = floors(&std::fs::read_to_string(source().join("lib.rs")).unwrap());
    assert!(
        floors.len() >= 10,
        "the floors table cannot be read: {floors:?}"
    );
    let mut graph: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut wrong = Vec::new();
    for file in rust_files(&source()) {
        let Some(from) = module_of(&file) else {
            continue;
        };
        let imported = imports(&std::fs::read_to_string(&file).unwrap());
        graph
            .entry(from.clone())
            .or_default()
            .extend(imported.iter().cloned());
        // Modules without imports must have a row too.
        for to in imported.iter().chain([&from]) {
            if let Err(why) = verdict(&floors, &from, to) {
                wrong.push(format!("{}: {why}", file.display()));
            }
        }
    }
    wrong.extend(
        circles(&graph)
            .iter()
            .map(|module| format!("`{module}` is in a circle")),
    );
    assert!(
        graph.contains_key("wire") && graph.contains_key("sim"),
        "found no modules"
    );
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_parser_finds_all_kinds_of_imports() {
    let text = "use crate::wire::Power;\nuse crate::{link, robot::{Event, Intent}, sim};\n\
                /// [`crate::comment`]\nlet x = crate::pilot::run(crate::agent::x);\n\
                $crate::safety; mycrate::other;";
    let expected = ["agent", "link", "pilot", "robot", "safety", "sim", "wire"];
    assert_eq!(imports(text), expected.map(String::from).into());

    let table = "//! | 0 | `wire` | a |\n//! | 1 | `robot` | a |\n//! | 2 | `link` | b |\n\
                 //! | 2 | `safety` | c |\n//! | 4 | `agent` | d |\n//! | 5 | `cli` | d |\n\
                 //! | side | `sim` | e |";
    let floors = floors(table);
    let allowed = |from, to| verdict(&floors, from, to).is_ok();
    assert!(allowed("link", "wire") && allowed("link", "link") && allowed("sim", "wire"));
    assert!(allowed("cli", "sim") && allowed("agent", "sim"));
    for (from, to) in [
        ("wire", "robot"),
        ("link", "safety"),
        ("sim", "robot"),
        ("link", "sim"),
        ("cli", "unknown"),
        ("unknown", "wire"),
    ] {
        assert!(!allowed(from, to), "{from} -> {to}");
    }

    let edge = |from: &str, to: &str| (from.to_owned(), BTreeSet::from([to.to_owned()]));
    assert_eq!(
        circles(&[edge("a", "b"), edge("b", "c"), edge("c", "b")].into()),
        ["b", "c"]
    );
    assert_eq!(circles(&[edge("a", "a"), edge("b", "a")].into()), [""; 0]);
}
