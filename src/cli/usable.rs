//! What a run or a service refuses of a valid config before it begins, for those who check it first.

use std::path::Path;

use super::behaviour_loader::{BehaviourLoader, LoadedBehaviours, read_source};
use super::config::unknown_behaviour;
use super::{Console, Exit, Failure, check, service};
use crate::clock::Clock;
use crate::config::{Config, Entry, Start};
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
    let missing = |entry: &&Entry| entry.start != Some(Start::Asked) && !entry.file.is_file();
    if let Some(entry) = config.behaviours.iter().find(missing) {
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
        is_service: true,
        watch: false,
        seed: 0,
        clock: Clock::default(),
        zone: config.zone(),
    };
    let mut loaded = loader.load(&config.behaviours)?;
    check_service(&mut loaded, config, true, console)
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

/// Checks the scripts of a service, with `scripts` also their text. One that starts by itself must be
/// right. One that only people start may be mended until then: a warning tells why it cannot be
/// started, and so does its spec.
pub(super) fn check_service(
    loaded: &mut LoadedBehaviours,
    config: &Config,
    scripts: bool,
    console: &Console,
) -> Result<(), Failure> {
    let table = config.timetable();
    let mut automatic = Vec::new();
    let behaviours = loaded.behaviours.iter().zip(&mut loaded.specs);
    for (entry, (behaviour, spec)) in config.behaviours.iter().zip(behaviours) {
        // What the loader could not read is empty.
        let read = if behaviour.launch.source.is_empty() {
            read_source(&entry.file).map(drop)
        } else {
            Ok(())
        };
        let is_scheduled = table.rules.iter().any(|rule| rule.run == spec.name());
        if entry.start != Some(Start::Asked) || is_scheduled {
            read?;
            automatic.push(behaviour);
            continue;
        }
        let checked = match read {
            Ok(()) if scripts => check::before_run([behaviour], console),
            read => read,
        };
        if let Err(failure) = checked {
            let text = format!("`{}` cannot start: {}", spec.name(), failure.what);
            console.write_line("WARN", &text);
            spec.problem = failure.what.lines().next().map(str::to_owned);
        }
    }
    if scripts {
        check::before_run(automatic, console)?;
    }
    Ok(())
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
