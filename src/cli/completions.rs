//! `spykee completions`: for the shell, made from the definition of the command line.

use clap::builder::PossibleValuesParser;
use clap_complete::{Shell, generate};

use super::{Exit, Failure, print};
use crate::api;

/// Stands in the scripts, as they are generated, where a shell asks for names of behaviours.
const BEHAVIOURS: &str = "__spykee_behaviours";
/// Names them: those of the run that is on in the data folder.
const ASK: &str = "spykee behaviour list --names 2>/dev/null";

/// Print completions for a shell
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "\
Install them, then open a new shell:
  bash        spykee completions bash > ~/.local/share/bash-completion/completions/spykee
  zsh         spykee completions zsh > ~/.zfunc/_spykee
              (~/.zshrc: fpath+=~/.zfunc; autoload -Uz compinit && compinit)
  fish        spykee completions fish > ~/.config/fish/completions/spykee.fish
  elvish      spykee completions elvish >> ~/.config/elvish/rc.elv
  powershell  spykee completions powershell >> $PROFILE")]
pub(super) struct CompletionsArgs {
    /// For which shell
    shell: Shell,
}

/// Prints them to stdout.
///
/// # Errors
/// A stdout that cannot be written to.
pub(super) fn run(args: &CompletionsArgs, mut command: clap::Command) -> Result<Exit, Failure> {
    // Only here: elsewhere a wrong name gets a suggestion. Shells split words at colons.
    let mut titles = api::titles();
    titles.retain(|title| !title.contains(':'));
    command = command.mut_subcommand("api", |api| {
        api.mut_arg("name", |name| {
            name.value_parser(PossibleValuesParser::new(titles))
        })
    });
    for change in ["start", "stop", "restart"] {
        command = command.mut_subcommand("behaviour", |behaviour| {
            behaviour.mut_subcommand(change, |change| change.mut_arg("name", placeholder))
        });
    }
    let (name, mut text) = (command.get_name().to_owned(), Vec::new());
    generate(args.shell, &mut command, name, &mut text);
    let text = String::from_utf8_lossy(&text);
    print(&match args.shell {
        // Within the double quotes of a list of words.
        Shell::Bash => text.replace(BEHAVIOURS, &format!("$({ASK})")),
        // The action of an argument: words in brackets, or code in braces.
        Shell::Zsh => text.replace(
            &format!("({BEHAVIOURS})"),
            &format!("{{compadd -- $({ASK})}}"),
        ),
        Shell::Fish => {
            let lines = text.into_owned() + &fish_arguments(&command, &[]);
            lines.replace(BEHAVIOURS, &format!("({ASK})"))
        }
        _ => text.into_owned(),
    })?;
    Ok(Exit::Done)
}

fn placeholder(name: clap::Arg) -> clap::Arg {
    name.value_parser(PossibleValuesParser::new([BEHAVIOURS]))
}

/// What clap_complete leaves out for fish: the words that arguments without a dash may be.
fn fish_arguments(command: &clap::Command, path: &[&str]) -> String {
    let mut lines = String::new();
    for argument in command.get_positionals() {
        let words = argument.get_possible_values();
        let words: Vec<&str> = words.iter().map(|word| word.get_name()).collect();
        if let ([first, rest @ ..], false) = (path, words.is_empty()) {
            let second = rest
                .iter()
                .map(|name| format!("; and __fish_seen_subcommand_from {name}"));
            let (second, words) = (second.collect::<String>(), words.join(" "));
            lines += &format!(
                "complete -c spykee -n \"__fish_spykee_using_subcommand {first}{second}\" -f -a \"{words}\"\n"
            );
        }
    }
    for below in command.get_subcommands() {
        lines += &fish_arguments(below, &[path, &[below.get_name()]].concat());
    }
    lines
}
