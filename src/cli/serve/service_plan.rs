//! Builds the plan of a service from its config, at the start and again at each SIGHUP.

use std::convert::Infallible;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use tokio::signal::unix::Signal;
use tokio::sync::{mpsc, watch};

use crate::agent::Behaviour;
use crate::cli::assembly::zone;
use crate::cli::behaviour_loader::{BehaviourLoader, LoadedBehaviours};
use crate::cli::config::unknown_behaviour;
use crate::cli::settings::CommandSettings;
use crate::cli::usable::check_service;
use crate::cli::{Console, Failure, live};
use crate::clock::Clock;
use crate::config::{Config, Entry, Service, Start};
use crate::live::RunDefinition;
use crate::service::ServicePlan;
use crate::timetable::Timetable;
use crate::vision::Camera;

/// Builds the plan from the config, at the start and at each reload.
#[derive(Clone)]
pub(super) struct PlanLoader {
    pub(super) settings: CommandSettings,
    /// Whether to check scripts first.
    pub(super) checked: bool,
    pub(super) seed: u64,
    pub(super) console: Console,
    pub(super) clock: Clock,
    /// The camera of a simulated robot, instead of the config's.
    pub(super) camera: Option<Camera>,
    pub(super) fast: bool,
}

impl PlanLoader {
    /// The plan, and what the page shows of it.
    pub(super) fn load(&self, config: &Config) -> Result<(ServicePlan, RunDefinition), Failure> {
        let loader = BehaviourLoader {
            config,
            file: self.settings.file(),
            params: &[],
            annotate: None,
            restart: None,
            checked: self.checked,
            is_service: true,
            watch: false,
            seed: self.seed,
            clock: self.clock,
            zone: zone(self.fast, config),
        };
        let mut loaded = loader.load(&config.behaviours)?;
        check_service(&mut loaded, config, self.checked, &self.console)?;
        let LoadedBehaviours {
            behaviours, specs, ..
        } = loaded;
        let names: Vec<String> = specs.iter().map(|one| one.name().to_owned()).collect();
        let table = Timetable {
            zone: zone(self.fast, config),
            ..config.timetable()
        };
        if let Some((what, known)) = unknown_behaviour(&table, &names) {
            return Err(Failure::usage(what).help(known));
        }
        let always = always(&config.behaviours, &names, &table);
        let fingerprints = behaviours.iter().map(fingerprint);
        let fingerprints = names.into_iter().zip(fingerprints).collect();
        let definition = RunDefinition {
            scripts: behaviours.iter().map(live::script).collect(),
            timetable: (!table.rules.is_empty()).then(|| (table.clone(), self.clock)),
        };
        let service_plan = ServicePlan {
            specs,
            fingerprints,
            always,
            table,
            quiet_alarm: config.quiet_alarm,
            idle: config.service.clone(),
        };
        Ok((service_plan, definition))
    }

    /// Reloads the config at each SIGHUP; a config with an error changes nothing. Never returns.
    pub(super) async fn reload_on_hangup(
        self,
        mut hangup: Signal,
        reload: mpsc::Sender<ServicePlan>,
        shown: watch::Sender<RunDefinition>,
        mut config: Config,
    ) -> Infallible {
        while hangup.recv().await.is_some() {
            tracing::info!("SIGHUP: reloading the settings");
            let loader = self.clone();
            let read = tokio::task::spawn_blocking(move || loader.reload()).await;
            match read {
                Ok(Ok((new_config, (service_plan, definition)))) => {
                    warn_restart_needed(&config, &new_config);
                    config = new_config;
                    shown.send_replace(definition);
                    let _ = reload.send(service_plan).await;
                }
                Ok(Err(failure)) => tracing::error!(
                    "the new settings are invalid, the old ones stay in effect: {}",
                    failure.what
                ),
                Err(error) => tracing::error!("the new settings could not be read: {error}"),
            }
        }
        std::future::pending().await
    }

    fn reload(&self) -> Result<(Config, (ServicePlan, RunDefinition)), Failure> {
        let loader = PlanLoader {
            settings: self.settings.reloaded(),
            ..self.clone()
        };
        let mut config = loader.settings.config()?.clone();
        config.camera = self.camera.unwrap_or(config.camera);
        let loaded = loader.load(&config)?;
        Ok((config, loaded))
    }
}

/// The names of those behaviours that run whenever the service does.
fn always(entries: &[Entry], names: &[String], table: &Timetable) -> Vec<String> {
    let scheduled = |name: &String| table.rules.iter().any(|rule| rule.run == *name);
    let always = |(entry, name): &(&Entry, &String)| match entry.start {
        Some(start) => start == Start::Always,
        None => !scheduled(name),
    };
    let always = entries.iter().zip(names).filter(always);
    always.map(|(_, name)| name.clone()).collect()
}

/// The fingerprint of a behaviour: equal if script, options, priority and restart policy are equal.
fn fingerprint(behaviour: &Behaviour) -> u64 {
    let mut hasher = DefaultHasher::new();
    behaviour.launch.source.hash(&mut hasher);
    let rest = (
        &behaviour.launch.options,
        behaviour.priority,
        behaviour.restart,
    );
    format!("{rest:?}").hash(&mut hasher);
    hasher.finish()
}

/// Logs the changed settings that only take effect after a restart of the service.
fn warn_restart_needed(old: &Config, new: &Config) {
    const RESTART_KEYS: &str = "robot user password_file watchdog streams data journal notify live \
                                mqtt service";
    let tree = |config: &Config| {
        let mut config = config.clone();
        config.service = Service {
            user: config.service.user,
            ..Default::default()
        };
        serde_yaml::to_value(config).unwrap_or_default()
    };
    let old = tree(old);
    let new = tree(new);
    let needs_restart = RESTART_KEYS
        .split(' ')
        .filter(|key| old.get(*key) != new.get(*key));
    let needs_restart: Vec<&str> = needs_restart.collect();
    if !needs_restart.is_empty() {
        tracing::warn!(
            "takes effect when the service is restarted: {}",
            needs_restart.join(", ")
        );
    }
}
