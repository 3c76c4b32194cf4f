//! A service: an agent that runs permanently, with its timetable and the handling of an idle robot.
//! Nothing here runs on the driving core: a service that hangs does not affect the watchdog and the
//! running behaviours, and systemd notices it (see [`ManagerNotifier::pass_on`]).

mod executor;
mod idle;
mod manager_notifier;
mod record;
mod standstill;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

use self::executor::Executor;
use crate::agent::{Agent, AgentError, BehaviourSpec, Bus, Outcome};
use crate::clock::{Clock, is_plausible};
use crate::config;
use crate::pilot::Status;
use crate::robot::channel::Quiet;
use crate::timetable::{Timetable, TimetableOrder};

pub use manager_notifier::ManagerNotifier;
pub use record::RecordFile;

pub use crate::timetable::View;

/// What a service does: everything that a reload may change.
#[derive(Debug, Clone)]
pub struct ServicePlan {
    pub specs: Vec<BehaviourSpec>,
    /// A number for each behaviour, by name, that differs after a reload if its definition does:
    /// then it is restarted.
    pub fingerprints: BTreeMap<String, u64>,
    /// Names of the behaviours that are started as soon as the robot is connected.
    pub always: Vec<String>,
    /// The timetable of the other behaviours.
    pub table: Timetable,
    /// Whether quiet hours also silence the alarm.
    pub quiet_alarm: bool,
    /// What happens while no behaviour runs.
    pub idle: config::Service,
}

impl ServicePlan {
    fn quiet(&self, now: Timestamp) -> Quiet {
        match self.table.quiet {
            Some(hours) if is_plausible(now) && hours.covers(now, &self.table.zone) => {
                if self.quiet_alarm {
                    Quiet::WithAlarm
                } else {
                    Quiet::Scripts
                }
            }
            _ => Quiet::Off,
        }
    }
}

pub struct Service {
    /// The permanent agent; its plan contains no behaviours.
    pub agent: Agent,
    pub status: watch::Receiver<Status>,
    pub clock: Clock,
    pub service_plan: ServicePlan,
    pub record: RecordFile,
    pub notifier: ManagerNotifier,
    /// Publishes missed starts; the bus of the agent's plan.
    pub bus: Bus,
    /// Publishes the next start, for display: see [`View::channel`].
    pub view: watch::Sender<View>,
    pub reloads: mpsc::Receiver<ServicePlan>,
    pub changes: mpsc::Receiver<TimetableOrder>,
}

impl Service {
    pub async fn run(self, stop: CancellationToken) -> Result<Outcome, AgentError> {
        let notifier = self.notifier.clone();
        let mut executor = Executor::new(
            self.agent.roster(),
            self.agent.requests(),
            self.status,
            self.clock,
            self.service_plan,
            self.record,
        );
        executor.notifier = self.notifier;
        executor.bus = self.bus;
        executor.view = self.view;
        let outcome = tokio::select! {
            biased;
            outcome = self.agent.run(stop.clone()) => outcome,
            never = executor.work(self.reloads, self.changes, stop) => match never {},
        };
        notifier.stopping();
        outcome
    }
}

/// A file that systemd passes to a service, under a name; it may belong to root.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Credential {
    name: String,
    path: PathBuf,
}

impl Credential {
    pub fn password(path: PathBuf) -> Credential {
        let name = PASSWORD_CREDENTIAL.to_owned();
        Credential { name, path }
    }

    /// A secret that the config names.
    pub fn of_config(path: PathBuf) -> Credential {
        let name = credential_name(&path);
        Credential { name, path }
    }
}

/// The name of the credential with the robot's password.
pub const PASSWORD_CREDENTIAL: &str = "password";

/// The name of the credential that holds the content of this file, such as `etc-spykee-mqtt.password`.
pub fn credential_name(path: &Path) -> String {
    let plain = |c: char| {
        if c.is_ascii_alphanumeric() || matches!(c, '.' | '_') {
            c
        } else {
            '-'
        }
    };
    let path = path.display().to_string();
    path.trim_start_matches('/').chars().map(plain).collect()
}

/// A unit for systemd. Without a user, systemd creates one, called spykee.
pub fn unit(
    program: &Path,
    config: &Path,
    credentials: &[Credential],
    user: Option<&str>,
) -> String {
    let credentials = credentials
        .iter()
        .map(|Credential { name, path }| format!("LoadCredential={name}:{}\n", escaped(path)));
    let credentials: String = credentials.collect();
    let user = match user {
        Some(name) => format!("User={}", name.replace('%', "%%")),
        None => "DynamicUser=yes\nUser=spykee".to_owned(),
    };
    TEMPLATE
        .replace("@USER@", &user)
        .replace("@PROGRAM@", &escaped(program))
        .replace("@CONFIG@", &escaped(config))
        .replace("@CREDENTIALS@\n", &credentials)
}

fn escaped(path: &Path) -> String {
    let text = path.display().to_string().replace('%', "%%");
    if text.contains([' ', '"', '\\', '\'']) {
        format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
    } else {
        text
    }
}

const TEMPLATE: &str = include_str!("spykee.service");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_placeholders_of_the_unit_are_filled() {
        let program = Path::new("/opt/my robot/spykee");
        let config = Path::new("/etc/spykee/100%.yaml");
        let text = unit(
            program,
            config,
            &[
                Credential::password("/etc/spykee/password".into()),
                Credential::of_config("/etc/spykee/my mqtt.password".into()),
            ],
            None,
        );
        assert!(
            text.contains(
                "ExecStart=\"/opt/my robot/spykee\" serve --config /etc/spykee/100%%.yaml"
            )
        );
        assert!(text.contains("LoadCredential=password:/etc/spykee/password\n"));
        let secret = "etc-spykee-my-mqtt.password:\"/etc/spykee/my mqtt.password\"\n";
        assert!(text.contains(&format!("LoadCredential={secret}")), "{text}");
        assert!(text.contains("DynamicUser=yes\nUser=spykee\n"));
        assert!(!text.contains("@PROGRAM@") && !text.contains("@CONFIG@"));
        let without = unit(program, config, &[], Some("rover"));
        assert!(!without.contains("LoadCredential") && !without.contains("@CREDENTIALS@"));
        assert!(without.contains("\nUser=rover\n") && !without.contains("DynamicUser"));
        assert!(!without.contains("@USER@"));
    }
}
