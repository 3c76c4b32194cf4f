//! `spykee completions`: for the shell, made from the definition of the command line.

use clap::builder::PossibleValuesParser;
use clap_complete::{Shell, generate};

use super::{Exit, Failure, print};
use crate::api;

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
    let (name, mut text) = (command.get_name().to_owned(), Vec::new());
    generate(args.shell, &mut command, name, &mut text);
    print(&String::from_utf8_lossy(&text))?;
    Ok(Exit::Done)
}
