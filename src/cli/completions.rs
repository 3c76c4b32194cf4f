//! `spykee completions`: shell completions, generated from the definition of the command line.

use clap::builder::PossibleValuesParser;
use clap_complete::{Shell, generate};

use super::lesson::lesson_names;
use super::{Exit, Failure, print};
use crate::api;
use crate::sim::World;

/// Placeholder in the generated scripts for the names of behaviours.
const BEHAVIOURS: &str = "__spykee_behaviours";
/// The command that replaces it: prints the behaviours of the active run in the data folder.
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
    /// The shell
    shell: Shell,
}

pub(super) fn run(args: &CompletionsArgs, mut command: clap::Command) -> Result<Exit, Failure> {
    // The names are set only here: elsewhere a wrong name must reach the suggestions. Names with
    // colons are left out, as shells split words at colons.
    let mut titles = api::titles();
    titles.retain(|title| !title.contains(':'));
    command = with_names(command).mut_subcommand("api", |api| {
        api.mut_arg("name", |name| {
            name.value_parser(PossibleValuesParser::new(titles))
        })
    });
    for change in ["start", "stop", "restart"] {
        command = command.mut_subcommand("behaviour", |behaviour| {
            behaviour.mut_subcommand(change, |change| change.mut_arg("name", placeholder))
        });
    }
    let name = command.get_name().to_owned();
    let mut text = Vec::new();
    generate(args.shell, &mut command, name, &mut text);
    let text = String::from_utf8_lossy(&text);
    print(&match args.shell {
        // The list of words is in double quotes.
        Shell::Bash => text.replace(BEHAVIOURS, &format!("$({ASK})")),
        // The action of an argument is either words in parentheses or code in braces.
        Shell::Zsh => text.replace(
            &format!("({BEHAVIOURS})"),
            &format!("{{compadd -- $({ASK})}}"),
        ),
        Shell::Fish => {
            let lines = text.into_owned() + &fish_arguments(&command, &[]);
            lines.replace(BEHAVIOURS, &format!("({ASK})"))
        }
        _ => text.into_owned(),
    })
}

/// Adds the names of the built-in worlds and of the lessons to all arguments that take one.
fn with_names(command: clap::Command) -> clap::Command {
    let named = |argument: clap::Arg| match argument.get_id().as_str() {
        "sim" | "world" => argument.value_parser(PossibleValuesParser::new(World::builtin_names())),
        "lesson" => argument.value_parser(PossibleValuesParser::new(lesson_names())),
        _ => argument,
    };
    command.mut_args(named).mut_subcommands(with_names)
}

fn placeholder(name: clap::Arg) -> clap::Arg {
    name.value_parser(PossibleValuesParser::new([BEHAVIOURS]))
}

/// The possible values of positional arguments, which clap_complete leaves out for fish.
fn fish_arguments(command: &clap::Command, path: &[&str]) -> String {
    let mut lines = String::new();
    for argument in command.get_positionals() {
        let words = argument.get_possible_values();
        let words: Vec<&str> = words.iter().map(|word| word.get_name()).collect();
        if let ([first, rest @ ..], false) = (path, words.is_empty()) {
            let second = rest
                .iter()
                .map(|name| format!("; and __fish_seen_subcommand_from {name}"));
            let second = second.collect::<String>();
            let words = words.join(" ");
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
