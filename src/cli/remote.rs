//! `--url` and `--token-file`: a service on another computer, in place of a run on this one.

use std::path::PathBuf;

use super::settings::SettingsArgs;
use super::{Exit, Failure, block_on, secret};
use crate::config::{Effective, Named};
use crate::control::{AskError, Client, Remote};

/// Which service.
#[derive(Debug, Clone, Default, clap::Args)]
pub(super) struct RemoteArgs {
    /// Ask the service at this address, http://HOST:PORT, through its JSON API [default: the
    /// config's `remote: url`]
    #[arg(long, value_name = "URL")]
    url: Option<String>,

    /// With --url: a file with a token of that service in its first line (`spykee token new` there
    /// makes one)
    #[arg(long, value_name = "FILE", requires = "url")]
    token_file: Option<PathBuf>,
}

impl RemoteArgs {
    /// The service that is meant, if one is: that of the command line, or else of the config.
    ///
    /// # Errors
    /// An address or a token that is not valid; the service is out of reach, or refuses the token.
    pub(super) fn client(&self, settings: &SettingsArgs) -> Result<Option<Client>, Failure> {
        let effective = settings.load()?;
        let options = &effective.config.remote;
        let (url, token) = match (&self.url, &options.url) {
            (Some(url), _) => {
                let read = |path: &PathBuf| secret::of_chosen_file(path);
                (url, self.token_file.as_ref().map(read).transpose()?)
            }
            (None, Some(url)) => (url, token(effective)?),
            (None, None) => return Ok(None),
        };
        let remote = Remote::new(url, token.as_deref()).map_err(Failure::usage)?;
        let asked = block_on(Client::of_service(remote))?;
        asked.map(Some).map_err(|error| unreachable(url, &error))
    }

    /// It was named on the command line.
    pub(super) fn is_named(&self) -> bool {
        self.url.is_some()
    }
}

/// The config's. One of a config that was found, not named, is beside it.
fn token(effective: &Effective) -> Result<Option<String>, Failure> {
    let Some(path) = &effective.config.remote.token_file else {
        return Ok(None);
    };
    let token = match effective.file_of("remote.token_file") {
        Some((config, Named::Found)) => secret::of_found_file(path, config),
        _ => secret::of_named_file(path),
    };
    token.map(Some)
}

fn unreachable(url: &str, error: &AskError) -> Failure {
    let help = match error {
        AskError::Denied(_) => {
            "--token-file names a file with a token; `spykee token new NAME` makes one there"
        }
        _ => "does it serve there, with `live: { listen: IP:PORT }` in its config?",
    };
    Failure::new(Exit::Unreachable, format_args!("{url}: {error}")).help(help)
}
