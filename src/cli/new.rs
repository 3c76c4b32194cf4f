//! `spykee new`: creates a project folder with a behaviour, its config, its tests and files for
//! editors.

use std::fs;
use std::path::Path;

use clap::ValueEnum;

use super::{Exit, Failure, print};
use crate::api;
use crate::behaviour::MAX_NAME;
use crate::config;
use crate::script;

/// Create a folder for a new behaviour: script, config, scenarios, completion for editors
#[derive(Debug, Clone, clap::Args)]
pub(super) struct NewArgs {
    /// Name of the behaviour and its folder: letters, digits, `_` and `-`, beginning with a letter
    #[arg(value_name = "NAME", value_parser = parse_name)]
    name: String,

    /// Behaviour to start from
    #[arg(long, value_enum, default_value = "patrol")]
    template: Template,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Template {
    /// Drives a square repeatedly
    Patrol,
    /// Follows a red object
    Follow,
    /// Prints a greeting
    Empty,
}

impl Template {
    fn texts(self) -> (&'static str, &'static str) {
        match self {
            Template::Patrol => (
                include_str!("new/patrol.lua"),
                include_str!("new/patrol_test.lua"),
            ),
            Template::Follow => (
                include_str!("new/follow.lua"),
                include_str!("new/follow_test.lua"),
            ),
            Template::Empty => (
                include_str!("new/empty.lua"),
                include_str!("new/empty_test.lua"),
            ),
        }
    }
}

/// Parses a name, which must be valid for a folder, a file and a behaviour.
fn parse_name(text: &str) -> Result<String, String> {
    let usual = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
    let right = text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(usual)
        && text.len() <= MAX_NAME
        && !text.ends_with("_test");
    if !right {
        return Err(format!(
            "expected at most {MAX_NAME} letters, digits, `_` and `-`, beginning with a letter and \
             not ending in `_test`"
        ));
    }
    Ok(text.to_owned())
}

pub(super) fn run(args: &NewArgs) -> Result<Exit, Failure> {
    let folder = Path::new(&args.name);
    let files = files(&args.name, args.template);
    create_project(folder, &files, "choose another name")?;
    let shown = folder.display();
    print(&format!(
        "created {shown}\n\nnext:\n  cd {shown}\n  spykee run {}.lua --sim\n",
        args.name
    ))
}

/// Creates a folder with these files. Does not change an existing one, and then says what to do
/// instead.
pub(super) fn create_project(
    folder: &Path,
    files: &[(String, String)],
    instead: &str,
) -> Result<(), Failure> {
    let shown = folder.display();
    fs::create_dir(folder).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => Failure::usage(format_args!("{shown} already exists"))
            .help(format!("nothing was changed; {instead}")),
        _ => Failure::io(format_args!("create {shown}"), error),
    })?;
    for (name, text) in files {
        let path = folder.join(name);
        let parent = path.parent().map_or(Ok(()), fs::create_dir_all);
        let written = parent.and_then(|()| fs::write(&path, text));
        written.map_err(|error| Failure::unwritable(&path, error))?;
    }
    Ok(())
}

/// The files that are the same for all templates.
const FILES: [(&str, &str); 6] = [
    ("spykee.yaml", include_str!("new/spykee.yaml")),
    ("README.md", include_str!("new/README.md")),
    (".gitignore", include_str!("new/gitignore")),
    (".luaurc", include_str!("new/luaurc")),
    (".vscode/settings.json", include_str!("new/settings.json")),
    (
        ".vscode/extensions.json",
        include_str!("new/extensions.json"),
    ),
];

fn files(name: &str, template: Template) -> Vec<(String, String)> {
    let (behaviour, test) = template.texts();
    let own = |text: &str| text.replace("{{NAME}}", name);
    let mut files = vec![
        (format!("{name}.lua"), own(behaviour)),
        (format!("{name}_test.lua"), own(test)),
        ("spykee.d.luau".to_owned(), api::luau()),
        (
            "spykee.schema.json".to_owned(),
            format!("{:#}\n", config::schema()),
        ),
    ];
    files.extend(FILES.map(|(file, text)| (file.to_owned(), own(text))));
    // The editor knows only the names of modules that are not documented.
    files.extend(script::module_names().map(|name| {
        let described = api::modules().find(|module| module.name == name);
        let stub = described.map_or_else(|| "return {} :: any\n".to_owned(), api::module_stub);
        (format!(".spykee/{name}.luau"), stub)
    }));
    files
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_are_paths_or_flags_are_refused() {
        for wrong in ["", "a/b", "../a", ".", "1st", "-v", "a b", "é", "x_test"] {
            assert!(parse_name(wrong).is_err(), "{wrong}");
        }
        assert!(parse_name("night-guard_2").is_ok());
        assert!(parse_name(&"a".repeat(65)).is_err());
    }

    #[test]
    fn the_written_files_are_valid() {
        for template in Template::value_variants() {
            let files = files("mine", *template);
            for (name, text) in &files {
                assert!(!text.contains("{{"), "{name}");
            }
            let text = |wanted: &str| &files.iter().find(|(name, _)| name == wanted).unwrap().1;
            config::Config::parse(text("spykee.yaml"), "spykee.yaml").unwrap();
            assert!(text(".spykee/bt.luau").contains("function bt.sequence("));
            for json in [
                ".luaurc",
                ".vscode/settings.json",
                ".vscode/extensions.json",
            ] {
                serde_json::from_str::<serde_json::Value>(text(json)).unwrap();
            }
        }
    }
}
