//! The MQTT broker that the config names: reads its secrets and certificates, and connects the
//! agent to it.

use std::time::Duration;

use super::{Failure, secret};
use crate::config::Effective;
use crate::control::Run;
use crate::files;
use crate::mqtt::{self, Account};
use crate::robot::Bus;
use crate::side_thread::SideThread;

/// Time limit for sending the last words to the broker.
pub(super) const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(2);
/// Maximum size of a certificate file, bytes.
const LONGEST_CERTIFICATES: u64 = 1 << 20;

/// The broker's account, if the config names a broker.
pub(super) fn account(settings: &Effective) -> Result<Option<Account>, Failure> {
    let options = settings.config.mqtt.clone();
    if options.host.is_none() {
        return Ok(None);
    }
    let password = match &options.password_file {
        Some(path) => Some(secret::from_configured_file(path, settings.found_file())?),
        None => None,
    };
    let certificates = |path: &std::path::PathBuf| {
        files::read(path, LONGEST_CERTIFICATES).map_err(|error| {
            Failure::usage(format_args!(
                "cannot read the certificates {} (mqtt.ca_file): {error}",
                path.display()
            ))
        })
    };
    let ca = options.ca_file.as_ref().map(certificates).transpose()?;
    Ok(Some(Account {
        options,
        password,
        ca,
    }))
}

/// The account of the broker that serves requests to a run, if the config names a broker. A config
/// that was found in the current folder may have come from anywhere: it must not hand the robot and
/// its camera to a stranger's broker.
pub(super) fn of_run(settings: &Effective) -> Result<Option<Account>, Failure> {
    let account = account(settings)?;
    if let (Some(_), Some(config)) = (&account, settings.found_file()) {
        let config = config.display();
        let failure = Failure::usage(format_args!(
            "the config {config} would connect the robot to a broker, but was found in the current \
             folder, not named"
        ));
        return Err(failure.help(format!(
            "name the config, --config {config}, if you trust it"
        )));
    }
    Ok(account)
}

/// Starts the broker connection of a run. On an error the run continues without it.
pub(super) fn start(bus: &Bus, run: &Run, account: Option<Account>) -> Option<SideThread> {
    let started = mqtt::start(bus, run.clone(), account?);
    started.map_err(|error| tracing::warn!("{error}")).ok()
}
