//! Finds circular imports inside the folders ("rooms") of `src`: modules of one folder that import
//! each other, directly or through others, where each module counts together with its submodules.
//! In the rooms of [`STRICT`] a module and its submodules must not import each other either.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Circles that still exist. The list may only shrink: remove a member as soon as it is in no
/// circle.
const KNOWN: &[&[&str]] = &[];

/// Rooms in which even a parent and its child must not import each other.
const STRICT: &[&str] = &["lab", "sim", "vision", "wire"];

/// A module's path within the crate, such as `["sim", "world"]`; the crate itself is empty.
type ModulePath = Vec<String>;

/// Each module with the modules that it imports, and for each import one path that makes it.
type Graph = BTreeMap<String, BTreeMap<String, String>>;

/// The contents of one file, as far as imports are concerned.
struct Module {
    /// Paths in `use` declarations, the name that each brings, and whether it is public.
    uses: Vec<(Vec<String>, String, bool)>,
    /// Names that the file defines.
    names: BTreeSet<String>,
    /// All code except the `use` declarations.
    body: String,
}

impl Module {
    /// Parses a file's text; skips tests.
    fn read(text: &str) -> Module {
        let code = without_tests(&without_comments(text));
        let (mut uses, mut body) = (Vec::new(), String::new());
        let mut rest = code.as_str();
        while let Some((before, public, after)) = next_use(rest) {
            body += before;
            let (tree, behind) = after.split_once(';').unwrap_or((after, ""));
            expand(&[], tree, public, &mut uses);
            rest = behind;
        }
        body += rest;
        let words: Vec<&str> = body.split_whitespace().collect();
        let defines = |pair: &[&str]| {
            let keywords = [
                "struct", "enum", "fn", "trait", "type", "const", "static", "union",
            ];
            keywords.contains(&pair[0]).then(|| head(pair[1]))
        };
        let names = words.windows(2).filter_map(defines).collect();
        Module { uses, names, body }
    }
}

/// Returns the text before the next `use` declaration, whether that is public, and the text after
/// the keyword.
fn next_use(text: &str) -> Option<(&str, bool, &str)> {
    let mut at = 0;
    for line in text.split_inclusive('\n') {
        let trimmed = line.trim_start();
        let public = trimmed.starts_with("pub");
        let declared = if public {
            let (visibility, rest) = trimmed.split_once(' ').unwrap_or((trimmed, ""));
            (visibility == "pub" || visibility.starts_with("pub(")).then_some(rest)
        } else {
            Some(trimmed)
        };
        if let Some(tree) = declared.and_then(|rest| rest.strip_prefix("use ")) {
            let start = at + line.len() - tree.len();
            return Some((&text[..at], public, &text[start..]));
        }
        at += line.len();
    }
    None
}

/// Expands a `use` tree into all its paths with the names that they bring.
fn expand(
    prefix: &[String],
    tree: &str,
    public: bool,
    found: &mut Vec<(Vec<String>, String, bool)>,
) {
    let segments = |text: &str| {
        let parts = text.split("::").map(str::trim).filter(|s| !s.is_empty());
        parts.map(str::to_owned).collect::<Vec<String>>()
    };
    if let Some((front, group)) = tree.split_once('{') {
        let prefix = [prefix, &segments(front)].concat();
        let (mut depth, mut item) = (0, String::new());
        for c in group.chars() {
            match c {
                '{' => depth += 1,
                '}' if depth == 0 => break,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    expand(&prefix, &std::mem::take(&mut item), public, found);
                    continue;
                }
                _ => {}
            }
            item.push(c);
        }
        if !item.trim().is_empty() {
            expand(&prefix, &item, public, found);
        }
        return;
    }
    let (path, alias) = match tree.split_once(" as ") {
        Some((path, alias)) => (path, Some(alias.trim().to_owned())),
        None => (tree, None),
    };
    let mut path = [prefix, &segments(path)].concat();
    if path.len() > 1 && path.last().is_some_and(|last| last == "self") {
        path.pop();
    }
    if let Some(last) = path.last().cloned() {
        found.push((path, alias.unwrap_or(last), public));
    }
}

fn head(text: &str) -> String {
    let name = text
        .chars()
        .take_while(|c| c.is_alphanumeric() || *c == '_');
    name.collect()
}

fn without_comments(text: &str) -> String {
    let code = text.lines().filter(|l| !l.trim_start().starts_with("//"));
    code.flat_map(|line| [line, "\n"]).collect()
}

/// Drops every item behind `#[cfg(test)]`.
fn without_tests(code: &str) -> String {
    let mut parts = code.split("#[cfg(test)]");
    let mut kept = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let mut depth = 0;
        let end = part.char_indices().find_map(|(at, c)| {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            (depth == 0 && matches!(c, '}' | ';')).then_some(at + 1)
        });
        kept += &part[end.unwrap_or(part.len())..];
    }
    kept
}

/// The modules that a text declares for tests only.
fn test_modules(text: &str) -> impl Iterator<Item = String> {
    let declared = text.split("#[cfg(test)]").skip(1).filter_map(|rest| {
        let name = rest.trim_start().strip_prefix("mod ")?;
        let (name, _) = name.split_once([';', ' '])?;
        Some(name.to_owned())
    });
    declared.collect::<Vec<_>>().into_iter()
}

/// All modules of the crate except its tests.
struct Crate(BTreeMap<ModulePath, Module>);

impl Crate {
    fn read(files: &[(ModulePath, String)]) -> Crate {
        let mut tests = BTreeSet::new();
        for (path, text) in files {
            tests.extend(test_modules(text).map(|name| [&path[..], &[name]].concat()));
        }
        let is_test = |path: &ModulePath| tests.iter().any(|test| path.starts_with(test));
        let modules = files.iter().filter(|(path, _)| !is_test(path));
        let modules = modules.map(|(path, text)| (path.clone(), Module::read(text)));
        Crate(modules.collect())
    }

    /// Resolves a path to a module, as seen from module `from`; follows re-exports.
    fn resolve(&self, from: &[String], path: &[String], depth: u32) -> Option<ModulePath> {
        let mut current = from.to_vec();
        let mut rest = path;
        while let Some((first, behind)) = rest.split_first() {
            match first.as_str() {
                "crate" => current.clear(),
                "super" => drop(current.pop()),
                "self" => {}
                _ => break,
            }
            rest = behind;
        }
        while let Some((first, behind)) = rest.split_first() {
            let child = [&current[..], std::slice::from_ref(first)].concat();
            if self.0.contains_key(&child) {
                (current, rest) = (child, behind);
                continue;
            }
            let module = self.0.get(&current)?;
            let brings = |alias: &String| alias == first || alias == "*";
            let mut uses = module.uses.iter().filter(|(_, alias, _)| brings(alias));
            let through = uses.find_map(|(target, alias, _)| {
                let glob = if alias == "*" { 1 } else { 0 };
                let target = &target[..target.len() - glob];
                let rest = if glob == 1 { rest } else { behind };
                let known = self.is_own(&current, target) && depth < 12;
                known.then(|| self.resolve(&current, &[target, rest].concat(), depth + 1))?
            });
            let here = module.names.contains(first) || depth == 0;
            return through.or_else(|| here.then_some(current));
        }
        Some(current)
    }

    /// Whether a path begins in this crate: with a keyword, or with a child of `from`.
    fn is_own(&self, from: &[String], path: &[String]) -> bool {
        path.first().is_some_and(|first| {
            let child = [from, std::slice::from_ref(first)].concat();
            matches!(first.as_str(), "crate" | "super" | "self") || self.0.contains_key(&child)
        })
    }

    /// All imports, each with the path that makes it.
    fn imports(&self) -> Vec<(ModulePath, ModulePath, String)> {
        let mut found = Vec::new();
        for (from, module) in &self.0 {
            let words: BTreeSet<&str> = words(&module.body).collect();
            let used = module.uses.iter().filter(|(_, alias, public)| {
                // A re-export alone does not count as an import: the module may not use what it
                // re-exports.
                !public || words.contains(alias.as_str())
            });
            let declared = used.map(|(path, ..)| path.clone());
            let written = paths(&module.body);
            for path in declared.chain(written) {
                if !self.is_own(from, &path) {
                    continue;
                }
                let to = self.resolve(from, &path, 0).filter(|to| to != from);
                found.extend(to.map(|to| (from.clone(), to, path.join("::"))));
            }
        }
        found
    }
}

fn words(body: &str) -> impl Iterator<Item = &str> {
    body.split(|c: char| !c.is_alphanumeric() && c != '_')
}

/// All paths of the form `a::b::c` in a text.
fn paths(body: &str) -> Vec<Vec<String>> {
    let in_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    let runs = body.split(|c| !in_path(c));
    let runs = runs.filter(|run| run.contains("::") && !run.starts_with(':'));
    let parts = |run: &str| {
        let parts = run.split("::").filter(|part| !part.is_empty());
        parts.map(str::to_owned).collect()
    };
    runs.map(parts).collect()
}

/// The imports between the children of each folder; each child counts together with its submodules.
fn between_siblings(imports: &[(ModulePath, ModulePath, String)]) -> Graph {
    let mut graph = Graph::new();
    for (from, to, path) in imports {
        let shared = from.iter().zip(to).take_while(|(a, b)| a == b).count();
        if shared == 0 || shared == from.len() || shared == to.len() {
            continue;
        }
        let [a, b] = [from, to].map(|module| module[..=shared].join("::"));
        let why = format!("{} imports {path}", from.join("::"));
        graph.entry(a).or_default().entry(b).or_insert(why);
    }
    graph
}

/// The imports between single files of the strict rooms.
fn between_files(imports: &[(ModulePath, ModulePath, String)]) -> Graph {
    let mut graph = Graph::new();
    for (from, to, path) in imports {
        let strict = |module: &ModulePath| STRICT.contains(&module.first().map_or("", |m| m));
        if strict(from) && from.first() == to.first() {
            let edges = graph.entry(from.join("::")).or_default();
            edges.entry(to.join("::")).or_insert_with(|| path.clone());
        }
    }
    graph
}

/// The shortest path from a module back to itself.
fn circle(graph: &Graph, start: &str) -> Option<Vec<String>> {
    let mut ways = vec![vec![start.to_owned()]];
    let mut seen = BTreeSet::new();
    while !ways.is_empty() {
        let mut longer = Vec::new();
        for way in ways {
            let next = graph.get(&way[way.len() - 1]).into_iter().flatten();
            for (to, _) in next {
                let way = [&way[..], std::slice::from_ref(to)].concat();
                if to == start {
                    return Some(way);
                }
                if seen.insert(to.clone()) {
                    longer.push(way);
                }
            }
        }
        ways = longer;
    }
    None
}

/// Describes a circle: which module imports which, by which path.
fn describe(graph: &Graph, circle: &[String]) -> String {
    let steps = circle.windows(2).map(|pair| {
        let why = &graph[&pair[0]][&pair[1]];
        format!("    {} -> {} ({why})\n", pair[0], pair[1])
    });
    format!("a circle:\n{}", steps.collect::<String>())
}

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// All files below a folder with the paths of their modules.
fn files(folder: &Path, module: &[String]) -> Vec<(ModulePath, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let below = [module, std::slice::from_ref(&name)].concat();
        if path.is_dir() {
            found.extend(files(&path, &below));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let of_folder = matches!(name.as_str(), "mod" | "lib");
            let path_of = if of_folder { module.to_vec() } else { below };
            found.push((path_of, std::fs::read_to_string(&path).unwrap()));
        }
    }
    found
}

#[test]
fn the_modules_of_a_room_have_no_circular_imports() {
    let modules = Crate::read(&files(&source(), &[]));
    let imports = modules.imports();
    assert!(imports.len() > 500, "only {} imports", imports.len());
    let (mut wrong, mut circular) = (BTreeMap::new(), BTreeSet::new());
    // Report each circle once, although each of its members leads to it.
    let mut report = |circle: &[String], text: String| {
        let members: BTreeSet<String> = circle.iter().cloned().collect();
        wrong.entry(members).or_insert(text);
    };
    let siblings = between_siblings(&imports);
    for module in siblings.keys() {
        let Some(circle) = circle(&siblings, module) else {
            continue;
        };
        circular.insert(module.clone());
        let is_known = |known: &&&[&str]| circle.iter().all(|m| known.contains(&m.as_str()));
        if !KNOWN.iter().any(|known| is_known(&known)) {
            report(&circle, describe(&siblings, &circle));
        }
    }
    let files = between_files(&imports);
    for circle in files.keys().filter_map(|module| circle(&files, module)) {
        report(&circle, describe(&files, &circle));
    }
    let known = KNOWN.iter().copied().flatten();
    let needless = known.filter(|module| !circular.contains(**module));
    let needless =
        needless.map(|module| format!("{module} is in no circle any more: take it out of KNOWN"));
    let wrong: Vec<String> = wrong.into_values().chain(needless).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn circles_are_found_through_groups_and_re_exports_and_not_in_tests() {
    let found = |files: &[(&str, &str)]| {
        let file = |(path, text): &(&str, &str)| {
            let path = path.split("::").filter(|part| !part.is_empty());
            (path.map(str::to_owned).collect(), (*text).to_owned())
        };
        let files: Vec<_> = files.iter().map(file).collect();
        let graph = between_siblings(&Crate::read(&files).imports());
        graph.keys().find_map(|module| circle(&graph, module))
    };
    let way = |way: &[&str]| Some(way.iter().map(|m| (*m).to_owned()).collect());
    let room = ("room", "mod a;\nmod b;\nmod c;\npub use b::{B, other};\n");
    let a = ("room::a", "use super::{c::C, B};\nstruct A;\n");
    let b = ("room::b", "pub struct B;\npub fn other() {}\n");
    let c = ("room::c", "struct C;\n");
    assert_eq!(found(&[room, a, b, c]), None);
    let b_uses_a = ("room::b", "pub struct B;\nfn f() { super::a::A; }\n");
    let expected = way(&["room::a", "room::b", "room::a"]);
    assert_eq!(found(&[room, a, b_uses_a, c]), expected);
    let c_uses_a = ("room::c", "use crate::room::a;\nstruct C;\n");
    let expected = way(&["room::a", "room::c", "room::a"]);
    assert_eq!(found(&[room, a, b, c_uses_a]), expected);
    let in_test = (
        "room::c",
        "struct C;\n#[cfg(test)]\nmod tests { use super::super::a::A; }\n",
    );
    assert_eq!(found(&[room, a, b, in_test]), None);
    // Submodules count as part of their module.
    let below = ("room::c::deep", "use crate::room::a::A;\n");
    assert_eq!(
        found(&[room, a, b, c, below]),
        way(&["room::a", "room::c", "room::a"])
    );
}
