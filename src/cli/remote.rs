//! `--url` and `--token-file`: a service on another computer, instead of a run on this one.

use std::path::PathBuf;

use super::settings::SettingsArgs;
use super::{Exit, Failure, block_on, secret};
use crate::config::{Effective, ServiceUrl};
use crate::control::{AskError, Client, Remote};

/// Selects the service.
#[derive(Debug, Clone, Default, clap::Args)]
pub(super) struct RemoteArgs {
    /// Address of a service, http://HOST:PORT, to use through its JSON API instead of a local run
    /// [default: the config's `remote: url`]
    #[arg(long, value_name = "URL")]
    url: Option<ServiceUrl>,

    /// With --url: file with a token of that service in its first line; `spykee token new` on its
    /// computer creates one
    #[arg(long, value_name = "FILE", requires = "url")]
    token_file: Option<PathBuf>,
}

impl RemoteArgs {
    /// A client of the service that the command line or else the config names, if any.
    ///
    /// # Errors
    /// An invalid token; the service cannot be reached or refuses the token.
    pub(super) fn client(&self, settings: &SettingsArgs) -> Result<Option<Client>, Failure> {
        let effective = settings.load()?;
        let options = &effective.config.remote;
        let (url, token) = match (&self.url, &options.url) {
            (Some(url), _) => {
                let read = |path: &PathBuf| secret::from_chosen_file(path);
                (url, self.token_file.as_ref().map(read).transpose()?)
            }
            (None, Some(url)) => (url, token(effective)?),
            (None, None) => return Ok(None),
        };
        let remote = Remote::new(url.clone(), token.as_deref()).map_err(Failure::usage)?;
        let asked = block_on(Client::of_service(remote))?;
        asked.map(Some).map_err(|error| unreachable(url, &error))
    }

    /// Whether the command line names a service.
    pub(super) fn is_named(&self) -> bool {
        self.url.is_some()
    }
}

/// The token of the config. A config that was found, not named, may only name a file in its own
/// folder.
fn token(effective: &Effective) -> Result<Option<String>, Failure> {
    let Some(path) = &effective.config.remote.token_file else {
        return Ok(None);
    };
    secret::from_configured_file(path, effective.found_file()).map(Some)
}

fn unreachable(url: &ServiceUrl, error: &AskError) -> Failure {
    let help = match error {
        AskError::Denied(_) => {
            "name a file with a token, --token-file FILE; `spykee token new NAME` there creates one"
        }
        _ => "is the service running there, with `live: { listen: IP:PORT }` in its config?",
    };
    Failure::new(Exit::Unreachable, format_args!("{url}: {error}")).help(help)
}
