//! Looks at the robot again and again, and at what it has heard, and knows what must not be.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use spykee::clock::hours;
use spykee::safety::Limits;
use spykee::sim::{FULL_SPEED, Pose, State, Tracks, World};
use spykee::simulation::{EventKind, Simulation};
use spykee::wire::{Command, Engage};

use super::super::Events;
use super::super::flats::station_distances::StationDistances;
use super::{FaultFeed, HOME, Ledger, Loss};

/// How often it looks, in virtual time.
pub const LOOK_EVERY: Duration = Duration::from_millis(200);

/// So much later it has acted, when the link is sound: a report, a look, and time to spare.
const TO_ACT: Duration = Duration::from_secs(2);
/// A person finds a flat robot after so long and puts it on its station: the run goes on.
const FOUND_AFTER: Duration = Duration::from_secs(600);
/// The user that our agent is.
const OURS: &str = "admin";
/// The longest of the watchdog's own blind moves, a look included.
const BLIND_MOVE: Duration = Duration::from_millis(4950 + 200);
/// The longest grant of the tracks to the rescue behaviour, a look included.
const GRANT: Duration = Duration::from_millis(40_000 + 200);
/// The most power of both, on the wire: 30 and 45 % of 90.
const BLIND_POWER: u8 = 27;
const GRANT_POWER: u8 = 40;
/// Setpoints a second; a look's grain of room on top.
const MAX_MOVES: usize = 50 + 2;

/// Whether the robot reports a level at which the watchdog has it.
fn is_low(state: &State) -> bool {
    state.power.percent <= Limits::default().low.get()
}

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
    /// Until when a blind move or grant may last that the watchdog has announced, and the most power.
    homeward: Option<(Duration, u8)>,
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
        let low = is_low(state) && !state.charging && self.flat_since.is_none();
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
        let low = is_low(state) && !state.docked && state.user.is_some() && calm;
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
        let own = self.homeward.filter(|(until, _)| now <= *until);
        self.ledger.note(
            "low and off the station: no script moves the robot",
            (driven && own.is_none()).then(|| format!("{left} {right} at {now:.1?}")),
        );
        if let Some((_, most)) = own {
            let slow = left.unsigned_abs() <= most && right.unsigned_abs() <= most;
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
                    self.homeward = Some((event.at + BLIND_MOVE, BLIND_POWER));
                }
                if event.text.contains("a rescue behaviour may drive") {
                    self.homeward = Some((event.at + GRANT, GRANT_POWER));
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

/// How fast the watchdog and those that it grants the tracks to may drive, as a share.
const SLOW: f64 = 0.3;
/// For the robot's own search and its way onto the contacts, beside the way to them.
const SEARCH: Duration = Duration::from_secs(60);
/// A battery that loses more than this between two looks, percent, has collapsed.
const COLLAPSE: f64 = 0.5;
/// Troubles so long before the end are told.
const RECENT: Duration = Duration::from_secs(300);

/// What the way home takes, by the simulator's own account.
pub struct Account {
    distances: StationDistances,
    /// Percent a minute.
    drain: f64,
}

/// What the way home takes from some place.
struct Need {
    way: f64,
    time: Duration,
    /// Percent.
    charge: f64,
}

/// A place from which the robot had to come home by itself.
struct Stand {
    since: Duration,
    pose: Pose,
    battery: f64,
    need: Option<Need>,
    /// So long since then the link was sound and the station on.
    undisturbed: Duration,
}

/// See the module.
pub struct HomingEpisode {
    began: Duration,
    /// Since when it stood where it could have come home from, and did not.
    missed: Option<Duration>,
    story: Vec<String>,
    stand: Stand,
    battery: f64,
    offline: Duration,
    searches: usize,
    blind_moves: usize,
    grants: usize,
    troubles: Vec<(Duration, String)>,
    placed: bool,
}

/// One look at the robot and at what surrounds it.
pub struct Look<'a> {
    pub state: &'a State,
    pub now: Duration,
    /// Since the look before.
    pub lasted: Duration,
    /// Our agent is its user.
    pub online: bool,
    /// A fault is on.
    pub disturbed: bool,
}

impl Account {
    pub fn new(world: &World) -> Account {
        Account {
            distances: StationDistances::new(world),
            drain: world.battery.driving_drain_per_minute,
        }
    }

    fn need(&self, pose: Pose) -> Option<Need> {
        let way = self.distances.length(pose.point())?;
        let time = SEARCH + Duration::from_secs_f64(way / (SLOW * FULL_SPEED));
        let charge = time.as_secs_f64() / 60.0 * self.drain;
        Some(Need { way, time, charge })
    }

    fn stand(&self, Look { state, now, .. }: &Look<'_>) -> Stand {
        Stand {
            since: *now,
            pose: state.pose,
            battery: state.battery,
            need: self.need(state.pose),
            undisturbed: Duration::ZERO,
        }
    }
}

impl HomingEpisode {
    /// The robot is low now.
    pub fn begin(account: &Account, look: &Look<'_>) -> HomingEpisode {
        let stand = account.stand(look);
        HomingEpisode {
            began: look.now,
            missed: None,
            story: vec![format!("Low at {} with {stand}.", hours(look.now))],
            battery: stand.battery,
            stand,
            offline: Duration::ZERO,
            searches: 0,
            blind_moves: 0,
            grants: 0,
            troubles: Vec::new(),
            placed: false,
        }
    }

    /// It is still low.
    pub fn go_on(&mut self, account: &Account, look: &Look<'_>) {
        let collapsed = look.state.battery < self.battery - COLLAPSE;
        if collapsed {
            self.stand_anew("The battery collapsed", account, look);
        } else if std::mem::take(&mut self.placed) {
            self.stand_anew("Carried away", account, look);
        }
        self.battery = look.state.battery;
        if !look.online {
            self.offline += look.lasted;
        } else if !look.disturbed {
            self.stand.undisturbed += look.lasted;
        }
    }

    /// What was possible before is possible no more, or only now.
    fn stand_anew(&mut self, what: &str, account: &Account, look: &Look<'_>) {
        self.close_stand();
        self.stand = account.stand(look);
        let stand = &self.stand;
        self.story
            .push(format!("{what} at {}: now with {stand}.", hours(look.now)));
    }

    fn close_stand(&mut self) -> Option<String> {
        let excuse = self.stand.excuse();
        if excuse.is_none() {
            self.missed.get_or_insert(self.stand.since);
        }
        excuse
    }

    /// Something went wrong, by the fault feed.
    pub fn trouble(&mut self, now: Duration, what: &str) {
        self.troubles.push((now, what.to_owned()));
    }

    /// Somebody has carried the robot away; the next look shows where.
    pub fn carried(&mut self) {
        self.placed = true;
    }

    /// The robot was told to search.
    pub fn searched(&mut self) {
        self.searches += 1;
    }

    /// The watchdog has acted.
    pub fn acted(&mut self, text: &str) {
        self.blind_moves += usize::from(text.contains("makes short blind move"));
        self.grants += usize::from(text.contains("a rescue behaviour may drive"));
    }

    /// The robot is flat now: why.
    pub fn lost(mut self, account: &Account, look: &Look<'_>) -> Loss {
        let end = account.stand(look);
        let now = hours(look.now);
        let after = hours(look.now.saturating_sub(self.began));
        self.story
            .push(format!("Flat at {now}, {after} later, with {end}."));
        self.story.push(self.surroundings(look.now));
        let excuse = self.close_stand();
        self.story.push(match (self.missed, excuse) {
            (None, Some(why)) => format!("It could not be helped: {why}."),
            (since, _) => format!(
                "It could have come home from where it stood at {}: a way, the charge and the time \
                 were there.",
                hours(since.unwrap_or(self.began))
            ),
        });
        Loss {
            avoidable: self.missed.is_some(),
            story: self.story.join(" "),
        }
    }

    /// What was done for it, and what was in its way.
    fn surroundings(&self, now: Duration) -> String {
        let late = self.troubles.iter().filter(|(at, _)| *at + RECENT >= now);
        let late: Vec<String> = late
            .map(|(at, what)| format!("{} {what}", hours(*at)))
            .collect();
        format!(
            "It heard {} searches, drove {} legs and had {} grants. The link was away for {} in all; \
             troubles in the last {}: {}.",
            self.searches,
            self.blind_moves,
            self.grants,
            hours(self.offline),
            hours(RECENT),
            late.join(", ")
        )
    }
}

impl Stand {
    /// Why the robot could not come home from here.
    fn excuse(&self) -> Option<String> {
        let Stand {
            need,
            battery,
            undisturbed,
            ..
        } = self;
        let Some(Need { time, charge, .. }) = need else {
            return Some("there was no way home".to_owned());
        };
        if battery < charge {
            return Some(format!(
                "with {battery:.1} % it could not drive for {charge:.1} %"
            ));
        }
        (undisturbed < time).then(|| {
            format!(
                "with a sound link and a working station it had {} for a way of {}",
                hours(*undisturbed),
                hours(*time)
            )
        })
    }
}

impl fmt::Display for Stand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Pose { x, y, .. } = self.pose;
        write!(f, "{:.1} % at ({x:.2}, {y:.2}), ", self.battery)?;
        match &self.need {
            None => write!(f, "without a way home"),
            Some(Need { way, time, charge }) => write!(
                f,
                "{way:.1} m from home by the shortest way ({} and {charge:.1} % with one search)",
                hours(*time)
            ),
        }
    }
}
