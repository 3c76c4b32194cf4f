//! The book: every script in it does what its chapter says, every command line and every config is
//! accepted.

mod commands;
mod days;
mod service;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

use spykee::api::{Availability, Function, Namespace};

use crate::rig::{Rig, assert_contains, exact_yaml, run_in, sized};

/// The scenarios that check the scripts of the book.
const SCENARIOS: &str = include_str!("../guide/guide_test.lua");
/// The longest chapter, in lines.
const LONGEST_CHAPTER: usize = 250;

/// A chapter of the book.
struct Chapter {
    /// Its path below `behaviours/guide`.
    name: String,
    text: String,
}

impl Chapter {
    fn is_generated(&self) -> bool {
        self.name.starts_with("reference/")
    }

    /// The blocks of code in a language.
    fn blocks(&'static self, language: &str) -> Vec<&'static str> {
        let begins = format!("```{language}\n");
        let blocks = self.text.split(&begins).skip(1);
        blocks
            .map(|block| block.split("```").next().unwrap())
            .collect()
    }

    /// The indented lines, which are commands, without their comments. Generated pages have none.
    fn commands(&'static self) -> Vec<&'static str> {
        let text = if self.is_generated() { "" } else { &self.text };
        let prose = text.split("```").step_by(2);
        let lines = prose.flat_map(str::lines);
        lines
            .filter_map(|line| line.strip_prefix("    "))
            .map(|line| line.split(" # ").next().unwrap().trim())
            .collect()
    }

    /// What the names of its scripts begin with: the number of a step, or else its file's name.
    fn key(&self) -> &str {
        let stem = self.name.rsplit('/').next().unwrap();
        let stem = stem.trim_end_matches(".md");
        match stem.split_once('-') {
            Some((number, _)) if number.parse::<u32>().is_ok() => number,
            _ => stem,
        }
    }
}

/// The chapters in the order of the book.
static CHAPTERS: LazyLock<Vec<Chapter>> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("behaviours/guide");
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let summary = read("SUMMARY.md");
    let links = summary.split("](").skip(1);
    let names = links.map(|rest| rest.split(')').next().unwrap());
    names
        .map(|name| Chapter {
            name: name.to_owned(),
            text: read(name),
        })
        .collect()
});

fn chapter(name: &str) -> &'static Chapter {
    let found = CHAPTERS.iter().find(|chapter| chapter.name == name);
    found.unwrap_or_else(|| panic!("no chapter {name}"))
}

/// The behaviours of the book by key: `03` is the first one of step 3, `03-2` the second.
fn behaviours() -> BTreeMap<String, &'static str> {
    let mut found = BTreeMap::new();
    for chapter in CHAPTERS.iter().filter(|chapter| !chapter.is_generated()) {
        let scripts = chapter.blocks("lua").into_iter();
        let scripts = scripts.filter(|script| !script.starts_with("scenario("));
        for (script, number) in scripts.zip(1..) {
            let key = match number {
                1 => chapter.key().to_owned(),
                _ => format!("{}-{number}", chapter.key()),
            };
            assert_eq!(found.insert(key, script), None, "{}", chapter.name);
        }
    }
    found
}

/// The behaviours of the book as files, and the scenarios that check them.
fn files() -> Vec<(String, &'static str)> {
    let behaviours = behaviours().into_iter();
    let mut files: Vec<_> = behaviours
        .map(|(key, script)| (format!("guide_{key}.lua"), script))
        .collect();
    files.push(("guide_test.lua".to_owned(), SCENARIOS));
    files
}

#[test]
fn every_script_of_the_book_has_a_scenario() {
    let behaviours = behaviours();
    assert!(behaviours.len() > 20, "{} scripts", behaviours.len());
    for key in behaviours.keys() {
        let name = format!("scenario(\"{key} ");
        assert_eq!(SCENARIOS.matches(&name).count(), 1, "{name}");
    }
}

/// For each change with one seed, in `scripts/nightly` with as many as the scenarios set.
#[test]
fn every_script_of_the_book_does_what_its_text_says() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files() {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    std::fs::write(folder.path().join("exact.yaml"), exact_yaml("living_room")).unwrap();
    let seeds = sized(&["--seeds", "1"][..], &[]);
    let played = run_in(
        folder.path(),
        &[&["test", "guide_test.lua"][..], seeds].concat(),
    );
    let said = played.out;
    assert_eq!(played.code, Some(0), "{said}");
    assert_contains(&said, &[" runs passed; "]);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_check_finds_nothing_in_the_book() {
    let rig = Rig::quiet().await;
    for (file, text) in files() {
        rig.file(&file, text);
        let mut run = rig.spykee(&["check", &file]);
        assert_eq!(run.code().await, Some(0), "{file}: {}", run.text());
        for word in ["warning", "error:"] {
            assert!(!run.text().contains(word), "{file}: {}", run.text());
        }
    }
}

/// The calls of scenarios: their examples run beside a behaviour that says hello.
#[test]
fn every_example_of_a_scenarios_call_runs() {
    let folder = tempfile::tempdir().unwrap();
    let waits = "while true do task.wait(1) end";
    for (name, begins) in [
        ("hello.lua", "print('hello')"),
        ("patrol.lua", ""),
        (
            "guard.lua",
            "params.declare({ loud = { default = false } })",
        ),
    ] {
        std::fs::write(folder.path().join(name), format!("{begins}\n{waits}")).unwrap();
    }
    let of_scenarios = |one: &&Namespace| one.availability == Availability::Scenario;
    let functions = spykee::api::namespaces().filter(of_scenarios);
    let functions = functions.flat_map(|one| one.functions);
    let methods = spykee::api::methods().filter(|one| one.owner() == "sim");
    let examples = functions.chain(methods).map(|one| {
        let runs = match one.path {
            spykee::api::SCENARIO => return one.example.to_owned(),
            "sim:run" => "",
            _ => "sim:run('hello.lua') sim:wait(1)",
        };
        let Function { path, example, .. } = one;
        format!(
            "scenario('{path}', {{ world = 'playpen' }}, function(sim)\n{runs}\n{example}\nend)"
        )
    });
    let examples: Vec<String> = examples.collect();
    assert!(examples.len() > 20, "{} examples", examples.len());
    std::fs::write(folder.path().join("examples_test.lua"), examples.join("\n")).unwrap();
    let played = run_in(folder.path(), &["test", "examples_test.lua"]);
    assert_eq!(played.code, Some(0), "{}", played.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn the_patrol_of_the_book_passes_its_scenarios() {
    let rig = Rig::quiet().await;
    let scenarios = chapter("learn/18-scenarios.md").blocks("lua");
    let [scenario] = scenarios[..] else {
        panic!("{} files of scenarios", scenarios.len());
    };
    rig.file("my_patrol.lua", behaviours()["17"]);
    rig.file("my_patrol_test.lua", scenario);
    let mut run = rig.spykee(&["test"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let shown = chapter("learn/18-scenarios.md").blocks("text");
    let without_digits = |text: &str| text.replace(|c: char| c.is_ascii_digit(), "");
    let shown = without_digits(shown[0]);
    assert!(
        without_digits(&run.text()).contains(&shown),
        "{shown}: {}",
        run.text()
    );
}

#[test]
fn every_config_of_the_book_is_read() {
    let mut configs = 0;
    for chapter in CHAPTERS.iter() {
        for block in chapter.blocks("yaml") {
            let read = match block {
                _ if block.starts_with("faults:") => {
                    spykee::sim::Fault::list_from_yaml(block, &chapter.name)
                        .map(|_| ())
                        .map_err(|error| error.to_string())
                }
                _ if block.starts_with("stops_on_disconnect:") => {
                    spykee::sim::Firmware::from_yaml(block, &chapter.name)
                        .map(|_| ())
                        .map_err(|error| error.to_string())
                }
                _ => {
                    configs += 1;
                    spykee::config::Config::parse(block, &chapter.name)
                        .map(|_| ())
                        .map_err(|error| error.to_string())
                }
            };
            read.unwrap_or_else(|error| panic!("{error}\n{block}"));
        }
    }
    assert!(configs >= 9, "{configs} configs");
}

#[test]
fn every_link_leads_to_a_file() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = root.join("behaviours/guide");
    let chapters = CHAPTERS.iter();
    let chapters = chapters.map(|one| (folder.join(&one.name), &one.text[..]));
    let readme = (root.join("README.md"), include_str!("../../README.md"));
    let mut seen = 0;
    for (path, text) in chapters.chain([readme]) {
        let prose: String = text.split("```").step_by(2).collect();
        for rest in prose.split("](").skip(1) {
            let target = rest.split([')', '#']).next().unwrap();
            if target.is_empty() || target.contains("://") {
                continue;
            }
            seen += 1;
            let exists = path.parent().unwrap().join(target).exists();
            assert!(exists, "{}: there is no {target}", path.display());
        }
    }
    assert!(seen > 100, "{seen} links");
}

#[test]
fn no_chapter_is_long() {
    for chapter in CHAPTERS.iter() {
        let lines = chapter.text.lines().count();
        assert!(lines <= LONGEST_CHAPTER, "{}: {lines} lines", chapter.name);
    }
}

#[test]
fn the_readme_is_short() {
    let lines = include_str!("../../README.md").lines().count();
    assert!(lines <= 180, "{lines} lines");
}

#[test]
fn the_tests_of_the_promises_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut named = 0;
    for chapter in CHAPTERS.iter().filter(|one| one.name.starts_with("trust/")) {
        // Names in code, such as `tests/it/link.rs`, or `link.rs` behind it.
        for name in chapter.text.split('`').skip(1).step_by(2) {
            let is_test = name.ends_with(".rs") || name.starts_with("tests/");
            if !is_test || name.contains(char::is_whitespace) {
                continue;
            }
            named += 1;
            let places = [root.join(name), root.join("tests/it").join(name)];
            let exists = places.iter().any(|place| place.exists());
            assert!(exists, "{}: there is no {name}", chapter.name);
        }
    }
    assert!(named > 20, "{named} tests");
}
