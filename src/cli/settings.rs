//! `--config FILE`, and the settings that count then: read once, for the logs and for the command.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::Failure;
use crate::config::{Config, ConfigError, Effective};

/// Which settings.
#[derive(Debug, Clone, Default, clap::Args)]
pub(super) struct SettingsArgs {
    /// Read the settings from this YAML file, instead of $SPYKEE_CONFIG or spykee.yaml here
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,

    #[arg(skip)]
    read: OnceCell<Arc<Result<Effective, ConfigError>>>,
}

impl SettingsArgs {
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

    /// The same, to be read anew.
    pub(super) fn anew(&self) -> SettingsArgs {
        SettingsArgs {
            config: self.config.clone(),
            read: OnceCell::new(),
        }
    }

    /// Says in the log which file counts.
    pub(super) fn announce(&self) {
        if let Some(path) = self.file() {
            tracing::info!("settings from {}", path.display());
        }
    }
}
