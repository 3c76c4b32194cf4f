//! Every command line of the book and the README: the indented ones are run, or at least parsed;
//! those in the text name commands, flags and scripts that exist.

use std::collections::BTreeSet;
use std::path::Path;

use clap::Command;

use super::{CHAPTERS, behaviours, chapter};
use crate::rig::{Rig, run_in};

const README: &str = include_str!("../../../README.md");

/// Chapters whose indented commands are run, here or in `service.rs`.
const RUN: &[&str] = &[
    "learn/01-first-script.md",
    "learn/02-driving.md",
    "learn/08-events.md",
    "learn/09-pictures.md",
    "learn/12-parameters.md",
    "learn/18-scenarios.md",
    "learn/ready-behaviours.md",
    "operate/journal.md",
    "operate/notifications.md",
    "operate/config.md",
    "operate/run.md",
    "operate/service.md",
    "teach/lessons.md",
    "teach/grading.md",
    "inside/simulator.md",
];
/// Other indented commands, and why they are parsed only.
const PARSED: &[(&str, &str)] = &[
    ("spykee discover", "asks the whole network"),
    ("spykee sim living_room", "serves until it is ended"),
    ("spykee run look.lua", "run with the README's script, below"),
    ("spykee doctor --robot", "asks a person before each step"),
    (
        "spykee class",
        "serves until it is ended; see the tests of `class`",
    ),
    (
        "spykee run behaviours/hello.lua --robot",
        "as in the tests of `run`",
    ),
];

/// Splits a command as a shell would, without its redirection into a file.
pub(super) fn words(command: &str) -> Vec<String> {
    let command = command.split(" > ").next().unwrap();
    let quoted = command.split('"').enumerate();
    let words = quoted.flat_map(|(index, part)| match index % 2 {
        0 => part.split_whitespace().map(str::to_owned).collect(),
        _ => vec![part.to_owned()],
    });
    words.collect()
}

/// Runs a command in a folder with further arguments, and checks its exit code.
fn runs(folder: &Path, command: &str, more: &[&str], code: i32) {
    let words = words(command);
    let mut args: Vec<&str> = words.iter().map(String::as_str).collect();
    assert_eq!(args.remove(0), "spykee", "{command}");
    args.extend(more);
    let ended = run_in(folder, &args);
    assert_eq!(ended.code, Some(code), "{command}: {}", ended.text());
}

fn parse(command: &str) {
    let parsed = spykee::cli::command().try_get_matches_from(words(command));
    if let Err(error) = parsed {
        panic!("{command}: {error}");
    }
}

/// The lines of the README that are commands.
fn readme_commands() -> impl Iterator<Item = &'static str> {
    let prose = README.split("```").step_by(2);
    prose
        .flat_map(str::lines)
        .filter_map(|line| line.strip_prefix("    "))
}

#[test]
fn every_command_line_is_run_or_parsed() {
    let mut seen = 0;
    for chapter in CHAPTERS.iter() {
        for command in chapter.commands() {
            seen += 1;
            is_known(&chapter.name, command);
        }
        // What a terminal shows: the lines of the prompt.
        let shown = chapter.blocks("console").into_iter().flat_map(str::lines);
        for command in shown.filter_map(|line| line.strip_prefix("$ ")) {
            parse(command);
        }
    }
    for command in readme_commands() {
        seen += 1;
        match command.strip_prefix("cargo run --release -- ") {
            Some(args) => parse(&format!("spykee {args}")),
            None => is_known("README.md", command),
        }
    }
    assert!(seen > 40, "{seen} commands");
}

fn is_known(chapter: &str, command: &str) {
    let first = command.split_whitespace().next().unwrap_or_default();
    match first {
        "spykee" => {
            parse(command);
            let is_listed = PARSED.iter().any(|(begins, _)| command.starts_with(begins));
            let is_run = RUN
                .iter()
                .any(|name| super::chapter(name).commands().contains(&command));
            let is_run = is_run || RUN.contains(&chapter) || is_listed;
            assert!(is_run, "{chapter}: no test runs `{command}`");
        }
        "git" | "cd" | "cargo" | "curl" | "sudo" | "podman" => {}
        script if script.starts_with("scripts/") => {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(script);
            assert!(path.is_file(), "{chapter}: there is no {script}");
        }
        _ => panic!("{chapter}: what is `{command}`?"),
    }
}

#[test]
fn the_commands_of_the_first_steps_run() {
    for (name, file, key) in [
        ("learn/01-first-script.md", "first.lua", "01"),
        ("learn/02-driving.md", "driving.lua", "02"),
        ("learn/08-events.md", "listen.lua", "08"),
        ("learn/12-parameters.md", "legs.lua", "12"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(file), behaviours()[key]).unwrap();
        for command in chapter(name).commands() {
            runs(folder.path(), command, &["--fast"], 0);
        }
    }
}

#[test]
fn the_commands_for_the_ready_behaviours_run() {
    let folder = tempfile::tempdir().unwrap();
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("behaviours");
    let to = folder.path().join("behaviours");
    std::fs::create_dir(&to).unwrap();
    for name in ["patrol.lua", "hello.lua"] {
        std::fs::copy(from.join(name), to.join(name)).unwrap();
    }
    for name in ["learn/ready-behaviours.md", "operate/run.md"] {
        for command in chapter(name).commands() {
            runs(folder.path(), command, &["--fast", "--for", "20"], 0);
        }
    }
}

#[test]
fn the_script_of_the_readme_prints_what_the_readme_shows() {
    let folder = tempfile::tempdir().unwrap();
    let block = |language: &str| {
        let start = README.split(&format!("```{language}\n")).nth(1).unwrap();
        start.split("```").next().unwrap()
    };
    std::fs::write(folder.path().join("look.lua"), block("lua")).unwrap();
    let command = readme_commands().find(|one| one.starts_with("spykee run look.lua"));
    let words = words(command.unwrap());
    let mut args: Vec<&str> = words[1..].iter().map(String::as_str).collect();
    args.push("--fast");
    let ended = run_in(folder.path(), &args);
    assert_eq!(ended.code, Some(0), "{}", ended.text());
    let shown = block("text").trim();
    assert!(ended.text().contains(shown), "{shown}: {}", ended.text());
}

#[test]
fn the_commands_for_a_config_run() {
    let folder = tempfile::tempdir().unwrap();
    let behaviours = folder.path().join("behaviours");
    std::fs::create_dir(&behaviours).unwrap();
    for name in ["patrol.lua", "follow_colour.lua"] {
        std::fs::write(behaviours.join(name), "").unwrap();
    }
    let chapter = chapter("operate/config.md");
    std::fs::write(folder.path().join("spykee.yaml"), chapter.blocks("yaml")[0]).unwrap();
    for command in chapter.commands() {
        runs(folder.path(), command, &[], 0);
    }
}

#[test]
fn the_commands_for_worlds_and_colours_run() {
    for name in ["inside/simulator.md", "learn/09-pictures.md"] {
        let folder = tempfile::tempdir().unwrap();
        for command in chapter(name).commands() {
            runs(folder.path(), command, &[], 0);
        }
    }
}

#[test]
fn the_commands_of_the_lessons_run() {
    let home = tempfile::tempdir().unwrap();
    let mut folder = home.path().to_owned();
    for command in chapter("teach/lessons.md").commands() {
        match command.strip_prefix("cd ") {
            Some(into) => folder.push(into),
            // What the lesson begins with is incomplete.
            None if command.contains("check") => runs(&folder, command, &[], 4),
            None => runs(&folder, command, &[], 0),
        }
    }
}

#[test]
fn the_commands_for_a_class_run() {
    let home = tempfile::tempdir().unwrap();
    let lesson = Path::new(env!("CARGO_MANIFEST_DIR")).join("behaviours/lessons/03-moving");
    let handed_in = home.path().join("handed-in");
    std::fs::create_dir(&handed_in).unwrap();
    std::fs::copy(lesson.join("solution.lua"), handed_in.join("Ada.lua")).unwrap();
    std::fs::write(home.path().join("class.txt"), "Ada\nBo\n").unwrap();
    for command in chapter("teach/grading.md").commands() {
        runs(home.path(), command, &[], 0);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_behaviour_runs_on_a_robot_as_written() {
    let rig = Rig::quiet().await;
    let behaviours = rig.folder().join("behaviours");
    std::fs::create_dir(&behaviours).unwrap();
    let hello = Path::new(env!("CARGO_MANIFEST_DIR")).join("behaviours/hello.lua");
    std::fs::copy(hello, behaviours.join("hello.lua")).unwrap();
    let chapter = chapter("operate/first-robot.md").commands();
    let command = chapter.iter().find(|one| one.starts_with("spykee run"));
    let command = command.unwrap().replace("172.17.6.1", &rig.address);
    let words = words(&command);
    let args: Vec<&str> = words[1..].iter().map(String::as_str).collect();
    let mut run = rig.spykee(&args);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}

/// The spans of code in a text, without the blocks.
fn spans(text: &str) -> Vec<String> {
    let prose: String = text.split("```").step_by(2).collect();
    let spans = prose.split('`').skip(1).step_by(2);
    spans.map(|span| span.replace('\n', " ")).collect()
}

/// The long flags of a command and all its subcommands.
fn flags(command: &Command, found: &mut BTreeSet<String>) {
    for argument in command.get_arguments() {
        found.extend(argument.get_long().map(str::to_owned));
    }
    for subcommand in command.get_subcommands() {
        flags(subcommand, found);
    }
}

#[test]
fn the_text_names_only_commands_flags_and_scripts_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut program = spykee::cli::command();
    program.build();
    let pages = CHAPTERS
        .iter()
        .map(|chapter| (&chapter.name[..], &chapter.text[..]));
    let mut seen = 0;
    for (page, text) in pages.chain([("README.md", README)]) {
        for span in spans(text) {
            let first = span.split_whitespace().next().unwrap_or_default();
            if first.starts_with("scripts/") {
                assert!(root.join(first).exists(), "{page}: there is no {first}");
            }
            let Some(rest) = span.strip_prefix("spykee ") else {
                continue;
            };
            seen += 1;
            let name = rest.split_whitespace().next().unwrap_or_default();
            let mut known = BTreeSet::from(["help".to_owned(), "version".to_owned()]);
            let is_placeholder = name.chars().all(|c| c.is_ascii_uppercase());
            if is_placeholder {
                continue;
            }
            if !name.starts_with('-') {
                let command = program.find_subcommand(name);
                let command = command.unwrap_or_else(|| panic!("{page}: `{span}`"));
                flags(command, &mut known);
            }
            let is_flag = |c: char| c.is_ascii_lowercase() || c == '-';
            for flag in rest
                .split(|c| !is_flag(c))
                .filter_map(|word| word.strip_prefix("--"))
            {
                assert!(
                    known.contains(flag),
                    "{page}: `{span}`: there is no --{flag}"
                );
            }
        }
    }
    assert!(seen > 60, "{seen} commands");
}

#[test]
fn the_chapter_on_runs_names_all_flags() {
    let mut known = BTreeSet::new();
    let program = spykee::cli::command();
    flags(program.find_subcommand("run").unwrap(), &mut known);
    let text = &chapter("operate/run.md").text;
    for flag in known {
        assert!(text.contains(&format!("`--{flag}")), "--{flag}");
    }
}

#[test]
fn the_chapter_on_commands_names_all_of_them() {
    let text = &chapter("operate/commands.md").text;
    for command in spykee::cli::command().get_subcommands() {
        let name = command.get_name();
        let is_named = text.contains(&format!("`spykee {name}")) || command.is_hide_set();
        assert!(is_named, "spykee {name}");
    }
}
