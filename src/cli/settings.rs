//! `--config FILE` and the settings from it: read once, for the logs and for the command.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::Failure;
use crate::config::{Config, ConfigError, Effective};

/// The settings of a command, from the file that `--config` names.
#[derive(Debug, Clone)]
pub(super) struct CommandSettings {
    config: Option<PathBuf>,
    read: OnceCell<Arc<Result<Effective, ConfigError>>>,
}

impl CommandSettings {
    /// The settings of this file; `None`: of the default one.
    pub(super) fn new(config: Option<PathBuf>) -> CommandSettings {
        CommandSettings {
            config,
            read: OnceCell::new(),
        }
    }

    /// The settings with their origins; the first call reads them.
    pub(super) fn load(&self) -> Result<&Effective, Failure> {
        let named = self.config.as_deref();
        let read = self.read.get_or_init(|| Arc::new(Effective::load(named)));
        (**read).as_ref().map_err(Failure::usage)
    }

    pub(super) fn config(&self) -> Result<&Config, Failure> {
        Ok(&self.load()?.config)
    }

    /// The same settings or, if they cannot be used, those of the file alone, or else the defaults,
    /// with a warning: for a stop, which a mistake in the settings must not prevent.
    pub(super) fn or_defaults(&self) -> CommandSettings {
        let Err(failure) = self.load() else {
            return self.clone();
        };
        let settings = Effective::load_file(self.config.as_deref()).unwrap_or_default();
        let used = match settings.file {
            Some(_) => "only the settings of the file",
            None => "the default settings",
        };
        tracing::warn!("{failure}; {used} are used");
        CommandSettings {
            config: None,
            read: OnceCell::from(Arc::new(Ok(settings))),
        }
    }

    /// The file from which the settings were read, whether it was named or found.
    pub(super) fn file(&self) -> Option<&Path> {
        let effective = self.load().ok()?;
        effective.file.as_ref().map(|(path, _)| path.as_path())
    }

    /// The file from which to read the settings, even if it is missing.
    pub(super) fn path(&self) -> PathBuf {
        Effective::path(self.config.as_deref())
    }

    /// The same settings, to be read again.
    pub(super) fn reloaded(&self) -> CommandSettings {
        CommandSettings::new(self.config.clone())
    }

    /// Warns about variables that look like settings but that nothing reads.
    pub(super) fn warn_about_variables(&self) {
        let Ok(effective) = self.load() else { return };
        if !effective.unread_variables.is_empty() {
            tracing::warn!(
                "spykee does not read {}: settings other than SPYKEE_CONFIG, SPYKEE_PASSWORD and \
                 SPYKEE_ROBOT belong in a config file",
                effective.unread_variables.join(", ")
            );
        }
    }

    pub(super) fn announce(&self) {
        if let Some(path) = self.file() {
            tracing::info!("settings from {}", path.display());
        }
    }
}
