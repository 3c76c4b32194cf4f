//! What a run or a service refuses of a valid config before it begins, for those who check it first.

use std::path::Path;

use super::behaviour_loader::BehaviourLoader;
use super::config::unknown_behaviour;
use super::{Console, Exit, Failure, check, service};
use crate::clock::Clock;
use crate::config::Config;
use crate::http::{Access, AccessError};

/// Checks the scripts with their parameters, the timetable, the files with secrets, and whether anybody
/// could drive through the page.
pub(super) fn check_config(file: &Path, config: &Config, console: &Console) -> Result<(), Failure> {
    let checked = scripts_and_timetable(file, config, console)
        .and_then(|()| secrets(config))
        .and_then(|()| page(config));
    checked.map_err(|failure| Failure {
        exit: Exit::Check,
        what: format!("{}: {}", file.display(), failure.what),
        ..failure
    })
}

fn scripts_and_timetable(file: &Path, config: &Config, console: &Console) -> Result<(), Failure> {
    let missing = config.behaviours.iter().find(|entry| !entry.file.is_file());
    if let Some(entry) = missing {
        let script = entry.file.display();
        let failure = Failure::usage(format_args!("there is no behaviour {script}"));
        return Err(failure.help("paths are relative to the config's folder"));
    }
    let loader = BehaviourLoader {
        config,
        file: Some(file),
        params: &[],
        annotate: None,
        restart: None,
        checked: true,
        watch: false,
        seed: 0,
        clock: Clock::default(),
        zone: config.zone(),
    };
    let loaded = loader.load(&config.behaviours)?;
    check::before_run(&loaded.behaviours, console)
        .map_err(|failure| failure.help("a run with this config would be refused"))?;
    let names: Vec<String> = loaded
        .specs
        .iter()
        .map(|one| one.name().to_owned())
        .collect();
    match unknown_behaviour(&config.timetable(), &names) {
        Some((what, known)) => Err(Failure::usage(what).help(known)),
        None => Ok(()),
    }
}

/// Whether the files are there; only the service's user, or root, may be able to read them.
fn secrets(config: &Config) -> Result<(), Failure> {
    let secrets = service::secrets(config).into_iter();
    let mut missing = secrets.filter(|path| path.try_exists().is_ok_and(|exists| !exists));
    match missing.next() {
        Some(path) => {
            let failure = Failure::usage(format_args!("there is no file {}", path.display()));
            Err(failure.help("its first line must be the password or the token"))
        }
        None => Ok(()),
    }
}

/// Tokens that only another user can read are not judged.
fn page(config: &Config) -> Result<(), Failure> {
    let Some(listen) = config.live.listen else {
        return Ok(());
    };
    match Access::new(&config.live, listen, config.data_folder()) {
        Err(error @ AccessError::Open(_)) => Err(Failure::usage(error)),
        _ => Ok(()),
    }
}
