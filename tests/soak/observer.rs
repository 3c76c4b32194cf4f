//! Looks at the robot again and again, and at what it has heard, and knows what must not be.

use std::collections::BTreeMap;
use std::time::Duration;

use spykee::sim::{State, Tracks};
use spykee::simulation::{EventKind, Simulation};
use spykee::wire::{Command, Engage};

use super::super::Events;
use super::Ledger;
use super::fault_feed::FaultFeed;
use super::homing_episode::{Account, HomingEpisode, Look};
use super::ledger::HOME;

/// How often it looks, in virtual time.
pub const LOOK_EVERY: Duration = Duration::from_millis(200);

/// At or below this the watchdog has the robot, in percent.
const LOW: u8 = 20;
/// So much later it has acted, when the link is sound: a report, a look, and time to spare.
const TO_ACT: Duration = Duration::from_secs(2);
/// A person finds a flat robot after so long and puts it on its station: the run goes on.
const FOUND_AFTER: Duration = Duration::from_secs(600);
/// The user that our agent is.
const OURS: &str = "admin";
/// The longest of the watchdog's own blind moves, a look included.
const LEG: Duration = Duration::from_millis(4950 + 200);
/// The longest grant of the tracks to the rescue behaviour, a look included.
const DRIVE_GRANT: Duration = Duration::from_millis(8000 + 200);
/// The most power of both, on the wire.
const LEG_POWER: u8 = 27;
/// Setpoints a second; a look's grain of room on top.
const MAX_MOVES: usize = 50 + 2;

/// See the module.
pub struct Observer {
    /// From a low battery to the first look at who drives.
    to_act: Duration,
    ledger: Ledger,
    events: Events,
    /// The next command to be read.
    heard: usize,
    /// The first command after the login of each connection was a stop, or is still to come.
    clients: BTreeMap<u64, bool>,
    /// Since when the battery is low, off the station, with a user and no fault on.
    low_since: Option<Duration>,
    /// Times of setpoints within the last second.
    moves: Vec<Duration>,
    /// Until when a blind move or grant may last that the watchdog has announced.
    homeward: Option<Duration>,
    account: Account,
    /// Low and not charging.
    episode: Option<HomingEpisode>,
    /// Since when it is flat off its station.
    flat_since: Option<Duration>,
}

impl Observer {
    /// The robot tells its battery so late.
    pub fn new(simulation: &Simulation, events: Events, power_late: Duration) -> Observer {
        Observer {
            to_act: TO_ACT + power_late,
            ledger: Ledger::default(),
            events,
            heard: simulation.sim().heard_count(),
            clients: BTreeMap::new(),
            low_since: None,
            moves: Vec::new(),
            homeward: None,
            account: Account::new(simulation.sim().world()),
            episode: None,
            flat_since: None,
        }
    }

    pub fn ledger(&mut self) -> &mut Ledger {
        &mut self.ledger
    }

    pub fn into_ledger(self) -> Ledger {
        self.ledger
    }

    /// One look.
    pub fn look(&mut self, simulation: &Simulation, faults: &FaultFeed) {
        let state = simulation.sim().state();
        let now = simulation.now();
        let calm = faults.is_calm(now);
        self.read_events();
        self.listen(simulation, calm);
        self.watch_battery(&state, now, calm && !faults.has_carried());
        self.watch_spell(&Look {
            state: &state,
            now,
            lasted: LOOK_EVERY,
            online: state.user.as_deref() == Some(OURS),
            disturbed: faults.is_bad(now),
        });
        if let Some(episode) = &mut self.episode
            && faults.has_carried()
        {
            episode.carried();
        }
        self.help_up(simulation, &state, now);
    }

    /// Something goes wrong now, by the fault feed.
    pub fn trouble(&mut self, now: Duration, what: &str) {
        let at = now.as_secs_f64();
        self.ledger.happened(format!("{at:.2} s {what}"));
        if let Some(episode) = &mut self.episode {
            episode.trouble(now, what);
        }
    }

    /// From low to charging, or to flat.
    fn watch_spell(&mut self, look: &Look<'_>) {
        let state = look.state;
        let low = state.power.percent <= LOW && !state.charging && self.flat_since.is_none();
        if !low {
            self.episode = None;
            return;
        }
        let flat = state.battery <= 0.0 && !state.docked;
        let account = &self.account;
        let episode = match self.episode.take() {
            None => HomingEpisode::begin(account, look),
            Some(mut episode) => {
                episode.go_on(account, look);
                episode
            }
        };
        if !flat {
            self.ledger.note(HOME, None);
            self.episode = Some(episode);
            return;
        }
        self.flat_since = Some(look.now);
        self.ledger.lose(episode.lost(account, look));
    }

    /// A flat robot does nothing more by itself.
    fn help_up(&mut self, simulation: &Simulation, state: &State, now: Duration) {
        if state.docked {
            self.flat_since = None;
        }
        if self
            .flat_since
            .is_some_and(|since| now >= since + FOUND_AFTER)
        {
            simulation
                .sim()
                .place(simulation.sim().world().station.dock_pose());
        }
    }

    /// What the robot has heard since the last look.
    fn listen(&mut self, simulation: &Simulation, calm: bool) {
        for heard in simulation.sim().heard_since(self.heard) {
            self.heard = heard.index + 1;
            let stops = matches!(heard.command, Command::Move { left: 0, right: 0 });
            match heard.command {
                Command::Login(_) => drop(self.clients.insert(heard.client, false)),
                _ if self.clients.get(&heard.client) == Some(&false) => {
                    self.clients.insert(heard.client, true);
                    self.ledger.note(
                        "the first command of every connection is a stop",
                        (!stops).then(|| format!("at {:.1?}: {:?}", heard.at, heard.command)),
                    );
                }
                _ => {}
            }
            if let (Command::Engine(Engage::Dock), Some(episode)) =
                (&heard.command, &mut self.episode)
            {
                episode.searched();
            }
            if let Command::Move { left, right } = heard.command {
                self.setpoint(heard.at, (left, right), calm);
            }
        }
        // Only the newest connections matter.
        while self.clients.len() > 100 {
            self.clients.pop_first();
        }
    }

    fn setpoint(&mut self, at: Duration, (left, right): (i8, i8), calm: bool) {
        self.moves
            .retain(|&one| at.saturating_sub(one) < Duration::from_secs(1));
        self.moves.push(at);
        // Bytes that were held up come all at once.
        if calm {
            let count = self.moves.len();
            self.ledger.note(
                "at most 50 MOVE a second",
                (count > MAX_MOVES).then(|| format!("{count} within a second at {at:.1?}")),
            );
        }
        self.ledger.note(
            "no setpoint beyond what a robot takes",
            (left.unsigned_abs() > 90 || right.unsigned_abs() > 90)
                .then(|| format!("{left} {right} at {at:.1?}")),
        );
    }

    /// Low and off the station: once there was time to act, the script drives it no more.
    fn watch_battery(&mut self, state: &State, now: Duration, calm: bool) {
        let low = state.power.percent <= LOW && !state.docked && state.user.is_some() && calm;
        if !low {
            self.low_since = None;
            return;
        }
        let since = *self.low_since.get_or_insert(now);
        if now < since + self.to_act {
            return;
        }
        let Tracks { left, right } = state.commanded;
        let driven = (left != 0 || right != 0) && !state.searching;
        let own = self.homeward.is_some_and(|until| now <= until);
        self.ledger.note(
            "low and off the station: no script moves the robot",
            (driven && !own).then(|| format!("{left} {right} at {now:.1?}")),
        );
        if own {
            let slow = left.unsigned_abs() <= LEG_POWER && right.unsigned_abs() <= LEG_POWER;
            self.ledger.note(
                "blind moves and granted tracks are slow",
                (!slow).then(|| format!("{left} {right} at {now:.1?}")),
            );
        }
    }

    fn read_events(&mut self) {
        for event in self.events.take() {
            let line = format!(
                "{:.2} s {:?} {}",
                event.at.as_secs_f64(),
                event.kind,
                event.text
            );
            self.ledger.happened(line.replace('\n', " / "));
            if event.kind == EventKind::Safety {
                if event.text.contains("makes short blind move") {
                    self.homeward = Some(event.at + LEG);
                }
                if event.text.contains("a rescue behaviour may drive") {
                    self.homeward = Some(event.at + DRIVE_GRANT);
                }
                if let Some(episode) = &mut self.episode {
                    episode.acted(&event.text);
                }
            }
            if event.kind == EventKind::Ended {
                let name = event.field("behaviour").unwrap_or_default();
                let meant = name == "restless";
                self.ledger.note(
                    "patrol and guard never fail",
                    (!meant && event.level == "error")
                        .then(|| format!("{name} at {:.0?}: {}", event.at, event.text)),
                );
            }
            let broken =
                event.text.contains("internal error") || event.text.contains("fault inside");
            if event.level == "error" || broken {
                self.ledger.note(
                    "nothing of ours breaks",
                    broken.then(|| format!("at {:.0?}: {}", event.at, event.text)),
                );
            }
        }
    }
}
