//! `spykee check`: finds mistakes in scripts without running them.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use super::behaviour_loader::{params, read_source};
use super::settings::CommandSettings;
use super::{Console, Exit, Failure, plural, print, print_coloured};
use crate::agent::Behaviour;
use crate::behaviour::{Inspector, Launch, Library, ScriptChecker};
use crate::check::{Diagnostic, Severity};
use crate::config::{Config, Entry};
use crate::sanitize;
use crate::script::Options;

/// Check behaviours for mistakes without running them
#[derive(Debug, Clone, clap::Args)]
pub(super) struct CheckArgs {
    /// Scripts, or folders of scripts
    #[arg(value_name = "FILE.lua", required = true)]
    files: Vec<PathBuf>,

    /// Print a JSON array
    #[arg(long)]
    json: bool,
}

const MAX_DEPTH: u32 = 16;

pub(super) fn run(args: &CheckArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let config = settings.config()?;
    let path = settings.file();
    let mut files = Vec::new();
    for path in &args.files {
        files.extend(scripts(path, ".lua")?);
    }
    let mut checker = checker()?;
    for file in &files {
        let launch = of_file(file, config, path)?;
        checker.behaviour(&launch).map_err(cannot_check)?;
    }
    let count = checker.seen.len();
    let diagnostics = checker.diagnostics;
    if args.json {
        let text = serde_json::to_string_pretty(&diagnostics).map_err(Failure::internal)?;
        print(&format!("{text}\n"))?;
    } else {
        print_coloured(&report(&diagnostics, count), colours())?;
    }
    Ok(if has_errors(&diagnostics) {
        Exit::Check
    } else {
        Exit::Done
    })
}

fn of_file(file: &Path, config: &Config, path: Option<&Path>) -> Result<Launch, Failure> {
    let source = read_source(file)?;
    let is_this = |entry: &&Entry| same_file(&entry.file, file);
    let entry = config.behaviours.iter().find(is_this);
    let options = Options {
        params: entry.map(|entry| params(entry, path)).unwrap_or_default(),
        ..config.script("check", file.display().to_string(), 0)
    };
    Ok(launch(source, options))
}

/// A launch for a check only: modules are found beside the file that the options name.
fn launch(source: Vec<u8>, options: Options) -> Launch {
    let library = Library::beside(Path::new(&options.chunk));
    Launch {
        source,
        options,
        library,
    }
}

pub(super) fn same_file(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}

/// The diagnostics for a script that would run with these options.
pub(super) fn of_source(source: &[u8], options: Options) -> Result<Vec<Diagnostic>, Failure> {
    let mut checker = checker()?;
    let launch = launch(source.to_vec(), options);
    checker.behaviour(&launch).map_err(cannot_check)?;
    Ok(checker.diagnostics)
}

/// Returns an error if a behaviour has errors; only prints warnings.
pub(super) fn before_run<'a>(
    behaviours: impl IntoIterator<Item = &'a Behaviour>,
    console: &Console,
) -> Result<(), Failure> {
    let mut checker = checker()?;
    for behaviour in behaviours {
        checker.behaviour(&behaviour.launch).map_err(cannot_check)?;
    }
    let mut texts = Vec::new();
    for one in &checker.diagnostics {
        match one.severity {
            Severity::Error => texts.push(one.text()),
            Severity::Warning => console.write_line("WARN", &one.to_string()),
        }
    }
    if texts.is_empty() {
        Ok(())
    } else {
        Err(Failure::new(Exit::Check, texts.join("\n\nerror: "))
            .help("nothing was run; --no-check skips this check"))
    }
}

/// Whether a script with these diagnostics is refused before a run.
pub(super) fn has_errors(diagnostics: &[Diagnostic]) -> bool {
    diagnostics
        .iter()
        .any(|diagnostic| diagnostic.severity == Severity::Error)
}

/// A file as it is, or all files of a folder whose names end so, in alphabetical order. Skips
/// hidden folders, `target` folders and symbolic links to folders.
pub(super) fn scripts(path: &Path, ending: &str) -> Result<Vec<PathBuf>, Failure> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut files = Vec::new();
    search(path, ending, 0, &mut files)?;
    Ok(files)
}

fn search(
    folder: &Path,
    ending: &str,
    depth: u32,
    files: &mut Vec<PathBuf>,
) -> Result<(), Failure> {
    let cannot = |error| Failure::unreadable(folder, error);
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(cannot)? {
        paths.push(entry.map_err(cannot)?.path());
    }
    paths.sort();
    for path in paths {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() {
            let skipped = name.starts_with('.') || name == "target" || path.is_symlink();
            if !skipped && depth < MAX_DEPTH {
                search(&path, ending, depth + 1, files)?;
            }
        } else if name.ends_with(ending) {
            // Without `./`, as people would write it.
            let shown = path.strip_prefix("./").map(Path::to_owned);
            files.push(shown.unwrap_or(path));
        }
    }
    Ok(())
}

fn report(diagnostics: &[Diagnostic], files: usize) -> String {
    let mut text = String::new();
    for diagnostic in diagnostics {
        text += &if colours() {
            coloured(diagnostic)
        } else {
            diagnostic.to_string()
        };
        text += "\n\n";
    }
    let is_error = |one: &&Diagnostic| one.severity == Severity::Error;
    let count = diagnostics.iter().filter(is_error).count();
    let errors = plural(count, "error");
    let warnings = plural(diagnostics.len() - count, "warning");
    text += &match (count, diagnostics.len() - count) {
        _ if files == 0 => "no script found: no file there ends in .lua\n".to_owned(),
        (0, 0) => format!("{}: no problems found\n", plural(files, "script")),
        (_, 0) => format!("{errors}\n"),
        (0, _) => format!("{warnings}\n"),
        _ => format!("{errors}, {warnings}\n"),
    };
    text
}

fn coloured(diagnostic: &Diagnostic) -> String {
    let (colour, word) = match diagnostic.severity {
        Severity::Error => ("\x1b[1;31m", "error:"),
        Severity::Warning => ("\x1b[1;33m", "warning:"),
    };
    let text = diagnostic.to_string();
    let text = sanitize::text(&text, false);
    let carets = diagnostic.carets();
    let marked = carets.replacen('^', &format!("{colour}^"), 1) + "\x1b[0m";
    let text = text.replacen(word, &format!("{colour}{word}\x1b[0m"), 1);
    match text.rfind(&format!("| {carets}")) {
        Some(at) => format!(
            "{}| {marked}{}",
            &text[..at],
            &text[at + 2 + carets.len()..]
        ),
        None => text,
    }
}

fn colours() -> bool {
    let refused = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    !refused && std::io::stdout().is_terminal()
}

/// A checker that inspects each file in a confined process.
fn checker() -> Result<ScriptChecker, Failure> {
    let inspector = Inspector::of_this_executable()
        .map_err(|error| Failure::io("find this program's own file", error))?;
    Ok(ScriptChecker::new(Some(inspector)))
}

fn cannot_check(why: String) -> Failure {
    Failure::new(Exit::Check, why)
}
