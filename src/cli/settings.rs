//! `--config FILE`, and the settings that count then: read once, for the logs and for the command.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{ArgMatches, FromArgMatches};

use super::Failure;
use crate::config::{Config, ConfigError, Effective};

/// The flag, which stands before or behind any command.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct ConfigFlag {
    /// Read the settings from this YAML file [default: $SPYKEE_CONFIG, or else spykee.yaml in the
    /// current folder]
    #[arg(id = CONFIG, long, value_name = "FILE", global = true)]
    pub(super) file: Option<PathBuf>,
}

/// Clap's name of the flag.
const CONFIG: &str = "config";

/// The settings of a command, from the file that [`ConfigFlag`] names.
#[derive(Debug, Clone)]
pub(super) struct SettingsArgs {
    config: Option<PathBuf>,
    read: OnceCell<Arc<Result<Effective, ConfigError>>>,
}

impl FromArgMatches for SettingsArgs {
    fn from_arg_matches(matches: &ArgMatches) -> Result<SettingsArgs, clap::Error> {
        let named = matches.try_get_one::<PathBuf>(CONFIG);
        Ok(SettingsArgs::of(named.ok().flatten().cloned()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = SettingsArgs::from_arg_matches(matches)?;
        Ok(())
    }
}

/// Adds no flag: the one of the whole program is known to every command.
impl clap::Args for SettingsArgs {
    fn augment_args(command: clap::Command) -> clap::Command {
        command
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        command
    }
}

impl SettingsArgs {
    /// Those of this file; `None`: of the usual one.
    pub(super) fn of(config: Option<PathBuf>) -> SettingsArgs {
        SettingsArgs {
            config,
            read: OnceCell::new(),
        }
    }

    /// The settings; the first call reads them.
    ///
    /// # Errors
    /// A config or variable that cannot be used.
    pub(super) fn load(&self) -> Result<&Effective, Failure> {
        let named = self.config.as_deref();
        let read = self.read.get_or_init(|| Arc::new(Effective::load(named)));
        (**read).as_ref().map_err(Failure::usage)
    }

    /// The settings alone.
    ///
    /// # Errors
    /// See [`SettingsArgs::load`].
    pub(super) fn config(&self) -> Result<&Config, Failure> {
        Ok(&self.load()?.config)
    }

    /// The file that they were read from, whether it was named or found.
    pub(super) fn file(&self) -> Option<&Path> {
        let effective = self.load().ok()?;
        effective.file.as_ref().map(|(path, _)| path.as_path())
    }

    /// The file that they are read from, even if it is missing.
    pub(super) fn path(&self) -> PathBuf {
        Effective::path(self.config.as_deref())
    }

    /// The same, to be read anew.
    pub(super) fn anew(&self) -> SettingsArgs {
        SettingsArgs::of(self.config.clone())
    }

    /// Says in the log which file counts.
    pub(super) fn announce(&self) {
        if let Some(path) = self.file() {
            tracing::info!("settings from {}", path.display());
        }
    }
}
