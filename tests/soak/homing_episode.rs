//! A robot that is low and off its station: since when, from where, and what was in its way meanwhile.
//! Should it run flat, this says whether it could have come home, and why it did not.

use std::fmt;
use std::time::Duration;

use super::ledger::Loss;
use spykee::clock::hours;
use spykee::sim::{FULL_SPEED, Pose, State, StationDistances, World};

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
