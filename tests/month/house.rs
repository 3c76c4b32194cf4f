//! The service under test: made anew after each power cut, on the same data folder and the same robot.

use std::path::Path;
use std::time::Duration;

use spykee::agent::{Agent, AgentError, Blueprint, Bus, Outcome, Tries, until_answered};
use spykee::clock::{Clock, Span};
use spykee::journal::{About, LabJournal, Options};
use spykee::lab::Lab;
use spykee::link;
use spykee::robot::{Priority, Streams, Use};
use spykee::script;
use spykee::service::{Duties, IdlePolicy, ManagerNotifier, RecordFile, Service, View};
use spykee::timetable::{Rule, Timetable};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::super::behaviour;
use super::calendar::{CATCH_UP, PATROL};

/// Days that the journal remembers, and how large it may be.
pub const KEEPS: Options = Options {
    record: spykee::journal::When::On,
    keep_days: 10,
    max_mib: 8,
};
/// A light of the robot that is on for as long as a patrol runs: the robot's own account of runs.
const WITNESSED: &str = "robot.led('left', true) \
                         script.on_stop(function() robot.led('left', false) end) ";
const LOOK: &str = "robot.led('right', true)
local frame = robot.wait_frame(5)
local path = if frame then frame:save('look.jpg') else nil
robot.stream('video', false)
journal.add('looked', { seen = path ~= nil })
robot.led('right', false)";

/// A service that runs.
pub struct House {
    stop: CancellationToken,
    service: JoinHandle<Result<Outcome, AgentError>>,
    journal: LabJournal,
}

impl House {
    pub fn open(lab: &Lab, data: &Path, seed: u64) -> House {
        let bus = Bus::default();
        let about = About {
            target: "a simulated robot".to_owned(),
            simulated: true,
        };
        let journal = LabJournal::start(&bus, data, KEEPS, about);
        let duties = duties(data, seed);
        let mut plan = lab.plan(Vec::new());
        plan.stays = true;
        plan.blueprints = duties.blueprints.clone();
        plan.dial = until_answered(plan.dial, link::Options::default(), seed, Tries::default());
        plan.bus = bus.clone();
        let (agent, status) = Agent::new(plan);
        // Nobody reloads.
        let (_, reloads) = mpsc::channel(1);
        let service = Service {
            agent,
            status,
            clock: Clock::default(),
            duties,
            record: RecordFile::open_in_lab(data),
            notifier: ManagerNotifier::default(),
            bus,
            view: View::channel().0,
            reloads,
            ended_by_person: CancellationToken::new(),
        };
        let stop = CancellationToken::new();
        let service = tokio::task::spawn_local(service.run(stop.clone()));
        House {
            stop,
            service,
            journal,
        }
    }

    /// It has ended by itself.
    pub fn is_over(&self) -> bool {
        self.service.is_finished()
    }

    /// Ended without a word: nothing is written any more.
    pub fn cut(self) {
        self.service.abort();
    }

    /// As by SIGTERM.
    pub async fn close(self) -> bool {
        self.stop.cancel();
        let ended = matches!(self.service.await, Ok(Ok(_)));
        self.journal.finish().await;
        ended
    }
}

fn duties(data: &Path, seed: u64) -> Duties {
    let patrol = include_str!("../../behaviours/patrol.lua");
    let scripts = [
        ("patrol", format!("{WITNESSED}{patrol}")),
        ("look", LOOK.to_owned()),
    ];
    let blueprints = scripts
        .into_iter()
        .zip(seed..)
        .map(|((name, source), seed)| blueprint(name, source, seed, data));
    let rule = |run: &str, at: &str, lasts: Option<Duration>| Rule {
        run: run.to_owned(),
        at: at.parse().unwrap(),
        lasts: lasts.map(|lasts| Span::minutes(lasts.as_secs() / 60)),
    };
    Duties {
        blueprints: blueprints.collect(),
        always: Vec::new(),
        table: Timetable {
            rules: vec![
                rule("patrol", "0 9,21 * * *", Some(PATROL)),
                rule("look", "30 14 * * *", None),
            ],
            zone: "Europe/Rome".parse().unwrap(),
            quiet: Some("22:00-07:00".parse().unwrap()),
            catch_up: Span::minutes(CATCH_UP.as_secs() / 60),
        },
        quiet_alarm: true,
        idle: IdlePolicy {
            release: false,
            after: Duration::from_secs(60),
            dock: true,
        },
    }
}

fn blueprint(name: &'static str, source: String, seed: u64, data: &Path) -> Blueprint {
    let streams = Streams {
        // A patrol's pictures are not what is tested here.
        video: if name == "patrol" {
            Use::Off
        } else {
            Use::Auto
        },
        ..Streams::default()
    };
    let options = script::Options {
        seed,
        streams,
        data_dir: Some(data.join(name)),
        time_zone: "Europe/Rome".to_owned(),
        ..script::Options::new(name, format!("{name}.lua"))
    };
    Blueprint::new(name, Priority(0), move || {
        Ok(behaviour(source.clone(), options.clone()))
    })
}
