//! `spykee check`: finds mistakes in scripts without running them.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use super::behaviour_loader::params;
use super::behaviour_loader::read_source;
use super::script_checker::ScriptChecker;
use super::settings::SettingsArgs;
use super::{Console, Exit, Failure, plural, print, print_coloured};
use crate::agent::Behaviour;
use crate::behaviour::Launch;
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

    #[command(flatten)]
    pub(super) settings: SettingsArgs,

    /// Print a JSON array
    #[arg(long)]
    json: bool,
}

/// Maximum depth of nested folders.
const MAX_DEPTH: u32 = 16;

pub(super) fn run(args: &CheckArgs) -> Result<Exit, Failure> {
    let config = args.settings.config()?;
    let path = args.settings.file();
    let mut files = Vec::new();
    for path in &args.files {
        collect(path, 0, &mut files)?;
    }
    let mut checker = ScriptChecker::new()?;
    for file in &files {
        let (source, options) = of_file(file, config, path)?;
        checker.behaviour(&source, &options)?;
    }
    let count = checker.count();
    let diagnostics = checker.diagnostics;
    let text = if args.json {
        format!(
            "{}\n",
            serde_json::to_string_pretty(&diagnostics).map_err(Failure::internal)?
        )
    } else {
        report(&diagnostics, count)
    };
    if args.json {
        print(&text)?
    } else {
        print_coloured(&text, colours())?
    }
    Ok(if has_errors(&diagnostics) {
        Exit::Check
    } else {
        Exit::Done
    })
}

/// Reads a script and its options from the config.
fn of_file(
    file: &Path,
    config: &Config,
    path: Option<&Path>,
) -> Result<(Vec<u8>, Options), Failure> {
    let source = read_source(file)?;
    let is_this = |entry: &&Entry| match (entry.file.canonicalize(), file.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    };
    let entry = config.behaviours.iter().find(is_this);
    let options = Options {
        params: entry.map(|entry| params(entry, path)).unwrap_or_default(),
        ..config.script("check", file.display().to_string(), 0)
    };
    Ok((source, options))
}

/// The diagnostics for a script that would run with these options.
pub(super) fn of_source(source: &[u8], options: &Options) -> Result<Vec<Diagnostic>, Failure> {
    let mut checker = ScriptChecker::new()?;
    checker.behaviour(source, options)?;
    Ok(checker.diagnostics)
}

/// Returns an error if a behaviour has errors; only prints warnings.
pub(super) fn before_run(behaviours: &[Behaviour], console: &Console) -> Result<(), Failure> {
    let mut checker = ScriptChecker::new()?;
    for behaviour in behaviours {
        let Launch {
            source, options, ..
        } = &behaviour.launch;
        checker.behaviour(source, options)?;
    }
    let (errors, warnings): (Vec<_>, Vec<_>) = checker
        .diagnostics
        .into_iter()
        .partition(|diagnostic| diagnostic.severity == Severity::Error);
    for warning in warnings {
        console.write_line("WARN", &warning.text());
    }
    let texts: Vec<_> = errors.iter().map(Diagnostic::text).collect();
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

/// Collects the scripts of a folder in alphabetical order; a file is taken as it is.
fn collect(path: &Path, depth: u32, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    if !path.is_dir() {
        files.push(path.to_path_buf());
        return Ok(());
    }
    let cannot = |error| {
        Failure::usage(format_args!(
            "cannot read the folder {}: {error}",
            path.display()
        ))
    };
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(path).map_err(cannot)? {
        entries.push(entry.map_err(cannot)?.path());
    }
    entries.sort();
    for entry in entries {
        let script = entry
            .extension()
            .is_some_and(|extension| extension == "lua");
        let folder = entry.is_dir() && !entry.is_symlink() && depth < MAX_DEPTH;
        if script || folder {
            collect(&entry, depth + 1, files)?;
        }
    }
    Ok(())
}

fn report(diagnostics: &[Diagnostic], files: usize) -> String {
    let mut text = shown(diagnostics, colours());
    let errors = diagnostics
        .iter()
        .filter(|one| one.severity == Severity::Error)
        .count();
    let warnings = diagnostics.len() - errors;
    text += &match (errors, warnings) {
        _ if files == 0 => "no script found: no file there ends in .lua\n".to_owned(),
        (0, 0) => format!("{}: no problems found\n", plural(files, "script")),
        (_, 0) => format!("{}\n", plural(errors, "error")),
        (0, _) => format!("{}\n", plural(warnings, "warning")),
        _ => format!(
            "{}, {}\n",
            plural(errors, "error"),
            plural(warnings, "warning")
        ),
    };
    text
}

/// Diagnostics for people, separated by blank lines.
fn shown(diagnostics: &[Diagnostic], colours: bool) -> String {
    let one = |diagnostic: &Diagnostic| {
        if colours {
            coloured(diagnostic)
        } else {
            diagnostic.to_string()
        }
    };
    diagnostics
        .iter()
        .map(|diagnostic| one(diagnostic) + "\n\n")
        .collect()
}

fn coloured(diagnostic: &Diagnostic) -> String {
    let colour = match diagnostic.severity {
        Severity::Error => "\x1b[1;31m",
        Severity::Warning => "\x1b[1;33m",
    };
    let text = diagnostic.to_string();
    let text = sanitize::text(&text, false);
    let carets = diagnostic.carets();
    let marked = carets.replacen('^', &format!("{colour}^"), 1) + "\x1b[0m";
    let word = match diagnostic.severity {
        Severity::Error => "error:",
        Severity::Warning => "warning:",
    };
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
