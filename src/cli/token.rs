//! `spykee token`: manages the tokens with which programs on other computers use the page's API.

use clap::{Subcommand, ValueEnum};

use super::settings::SettingsArgs;
use super::table::{Side, aligned};
use super::{Exit, Failure, print};
use crate::http::{Keyring, KeyringError, Role};

/// Create, list and revoke tokens for the page and the JSON API
///
/// A token is 256 random bits. It is printed once; the data folder keeps its SHA-256 digest in a
/// private file. Programs send it as `Authorization: Bearer TOKEN`, and people can log in to the
/// page with it.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee token new phone --role viewer")]
pub(super) struct TokenArgs {
    #[command(subcommand)]
    action: Action,
    #[command(flatten)]
    pub(super) settings: SettingsArgs,
}

#[derive(Debug, Clone, Subcommand)]
enum Action {
    /// Create a token and print it; it is shown only once
    New {
        /// Name of your choice, such as the program that uses the token
        name: String,
        /// Role of the token
        #[arg(long, value_enum, default_value_t = Wanted::Viewer)]
        role: Wanted,
    },
    /// List the tokens by name
    List,
    /// Revoke a token; an active run accepts it until it is restarted
    Revoke {
        /// Name of the token
        name: String,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Wanted {
    /// May look and stop the robot
    Viewer,
    /// May do everything that the page and the API offer
    Driver,
}

/// Runs the subcommand.
///
/// # Errors
/// A config or token file that cannot be used; a name that is already used or unknown.
pub(super) fn run(args: &TokenArgs) -> Result<Exit, Failure> {
    let data = args.settings.config()?.data_folder();
    let mut keys = Keyring::open(data).map_err(refused)?;
    match &args.action {
        Action::New { name, role } => {
            let role = match role {
                Wanted::Viewer => Role::Viewer,
                Wanted::Driver => Role::Driver,
            };
            let token = keys.make(name, role).map_err(refused)?;
            tracing::info!(
                "the token is shown only this once; its role is {}",
                role.name()
            );
            print(&format!("{token}\n"))?;
        }
        Action::List if keys.list().is_empty() => print("there are no tokens\n")?,
        Action::List => {
            let rows: Vec<Vec<String>> = (keys.list().into_iter())
                .map(|key| vec![key.name, key.role.name().to_owned()])
                .collect();
            print(&aligned(
                &[("NAME", Side::Left), ("ROLE", Side::Left)],
                &rows,
            ))?;
        }
        Action::Revoke { name } => {
            if !keys.revoke(name).map_err(refused)? {
                let failure = Failure::usage(format_args!("there is no token `{name}`"));
                return Err(failure.help("spykee token list"));
            }
            tracing::info!("an active run accepts the token until it is restarted");
        }
    }
    Ok(Exit::Done)
}

fn refused(error: KeyringError) -> Failure {
    let help = match &error {
        KeyringError::Broken { .. } => "remove the file and create new tokens",
        KeyringError::Write { .. } => "`data:` in the config sets the data folder",
        KeyringError::Refused(_) => "spykee token list",
    };
    Failure::usage(error).help(help)
}
