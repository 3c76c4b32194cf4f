//! `spykee api`: the reference of the script API, for people and editors.

use std::fs;
use std::path::{Path, PathBuf};

use super::{Exit, Failure, print, settings_page};
use crate::api;
use crate::yaml::suggestion;

/// Show the script API: a list, or one entry in full
#[derive(Debug, Clone, clap::Args)]
pub(super) struct ApiArgs {
    /// Function, namespace, module, object, field or event, such as robot.move, vision, bt, frame
    /// or Blob.cx; or one of the lists: events, objects, modules
    #[arg(value_name = "NAME")]
    name: Option<String>,

    /// Print a definition file for luau-lsp, for completion in editors
    #[arg(long, conflicts_with_all = ["name", "markdown"])]
    luau: bool,

    /// Write the reference of the book into a folder, as Markdown: a page for each namespace or
    /// group of its calls, and one for the settings
    #[arg(long, value_name = "DIR", conflicts_with = "name")]
    markdown: Option<PathBuf>,
}

pub(super) fn run(args: &ApiArgs) -> Result<Exit, Failure> {
    if let Some(folder) = &args.markdown {
        return write_reference(folder);
    }
    let text = match &args.name {
        Some(name) => one(name)?,
        None if args.luau => api::luau(),
        None => api::list(),
    };
    print(&text)
}

/// All generated pages of the book.
fn reference() -> Vec<api::Page> {
    let mut pages = api::pages();
    pages.push(settings_page::page());
    pages
}

fn write_reference(folder: &Path) -> Result<Exit, Failure> {
    let made = fs::create_dir_all(folder);
    made.map_err(|error| Failure::unwritable(folder, error))?;
    for page in reference() {
        let path = folder.join(format!("{}.md", page.name));
        let written = fs::write(&path, page.text);
        written.map_err(|error| Failure::unwritable(&path, error))?;
    }
    Ok(Exit::Done)
}

/// Maximum number of names with the text that was asked for.
const MAX_LIKE: usize = 12;

fn one(name: &str) -> Result<String, Failure> {
    api::page(name).ok_or_else(|| {
        let known = api::known();
        let near = suggestion(name, known.iter().map(String::as_str));
        let failure = Failure::usage(format_args!("nothing in the API is called '{name}'{near}"));
        let part = name.to_lowercase();
        let mut like: Vec<&str> = known.iter().map(String::as_str).collect();
        like.retain(|one| one.to_lowercase().contains(&part));
        like.truncate(MAX_LIKE);
        failure.help(if like.is_empty() || part.is_empty() {
            "spykee api lists everything".to_owned()
        } else {
            format!("there are {}", like.join(", "))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reference_of_the_book_is_the_generated_one() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/behaviours/guide/reference");
        let mut found: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        found.sort();
        let mut expected = Vec::new();
        for page in reference() {
            let name = format!("{}.md", page.name);
            let text = fs::read_to_string(Path::new(folder).join(&name)).unwrap_or_default();
            assert!(
                text == page.text,
                "{name} is not the generated page: spykee api --markdown behaviours/guide/reference"
            );
            expected.push(name);
        }
        expected.sort();
        assert_eq!(found, expected);
    }
}
