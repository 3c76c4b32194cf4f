//! `spykee colour`: finds and learns colours in pictures. Colours by name: those of the config and
//! the nine built-in ones.

mod find;
mod learn;
mod marked_pictures;
pub(super) mod picture;

use super::settings::SettingsArgs;
use super::{Console, Exit, Failure};
use crate::config::Config;
use crate::script::suggestion;
use crate::vision::{Colour, MAX_COLOURS};

/// Messages cut longer names to this many characters.
const MAX_SHOWN: usize = 40;

/// Find colours in pictures, as scripts do, or learn a new one
#[derive(Debug, Clone, clap::Args)]
pub(super) struct ColourArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Clone, clap::Subcommand)]
enum Action {
    Find(find::FindArgs),
    Learn(learn::LearnArgs),
}

impl ColourArgs {
    pub(super) fn settings(&self) -> Option<&SettingsArgs> {
        match &self.action {
            Action::Find(args) => Some(&args.settings),
            Action::Learn(_) => None,
        }
    }
}

pub(super) fn run(args: &ColourArgs, console: &Console) -> Result<Exit, Failure> {
    match &args.action {
        Action::Find(args) => find::run(args, console),
        Action::Learn(args) => learn::run(args, console),
    }
}

/// The colours with these names, in the same order. The config's names override built-in ones.
fn of_names(names: &[String], config: &Config) -> Result<Vec<Colour>, Failure> {
    if names.len() > MAX_COLOURS {
        return Err(Failure::usage(format_args!(
            "{} colours; at most {MAX_COLOURS} can be distinguished at once",
            names.len()
        )));
    }
    names.iter().map(|name| of_name(name, config)).collect()
}

fn of_name(name: &str, config: &Config) -> Result<Colour, Failure> {
    let known = config.colours.get(name).copied();
    known
        .or_else(|| Colour::named(name))
        .ok_or_else(|| unknown(name, config))
}

fn unknown(name: &str, config: &Config) -> Failure {
    let own: Vec<&str> = config.colours.keys().map(String::as_str).collect();
    let shown: String = name.chars().take(MAX_SHOWN).collect();
    let known = own.iter().copied().chain(Colour::NAMES);
    let what = format!("there is no colour '{shown}'{}", suggestion(name, known));
    let built_in = Colour::NAMES.join(", ");
    let help = if own.is_empty() {
        format!("colours: {built_in}, and those under `colours:` of --config FILE")
    } else {
        format!("colours: {built_in}; from the config: {}", own.join(", "))
    };
    Failure::usage(what).help(help)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> Config {
        Config::parse("colours: { sock: { h: [270, 310] } }", "test").unwrap()
    }

    #[test]
    fn names_are_found_in_the_config_and_among_the_nine() {
        let names = ["sock", "red"].map(str::to_owned);
        let colours = of_names(&names, &config()).unwrap();
        assert_eq!(colours[1], Colour::named("red").unwrap());
        assert_ne!(colours[0], colours[1]);
    }

    #[test]
    fn the_error_for_a_long_name_is_short() {
        let report = of_name(&"r".repeat(100_000), &config())
            .unwrap_err()
            .report();
        assert!(report.len() < 400, "{report}");
    }

    #[test]
    fn more_colours_than_the_maximum_are_refused() {
        let names = vec!["red".to_owned(); MAX_COLOURS + 1];
        assert!(of_names(&names, &config()).is_err());
    }
}
