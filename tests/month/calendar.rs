//! When what goes wrong, and what the timetable wants: the test's own account of both.

use std::time::Duration;

use jiff::civil::Date;
use jiff::tz::TimeZone;
use jiff::{SignedDuration, Timestamp, ToSpan as _, Zoned};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// In Rome: within thirty days its clock goes back by an hour.
const BEGINS: &str = "2026-10-05T08:00:00[Europe/Rome]";
/// A start that was missed by less is made up for.
pub const CATCH_UP: Duration = Duration::from_secs(600);
/// How long a patrol of the timetable lasts.
pub const PATROL: Duration = Duration::from_secs(1800);
const HOUR: u64 = 3600;
const DAY: u64 = 24 * HOUR;

/// The first look at the wall.
pub fn begins() -> Timestamp {
    BEGINS.parse::<Zoned>().unwrap().timestamp()
}

/// Where the wall is.
pub fn rome() -> TimeZone {
    TimeZone::get("Europe/Rome").unwrap()
}

/// What happens to the robot, the network, the computer or its clock.
#[derive(Debug, Clone, PartialEq)]
pub enum Trouble {
    /// A fault of the simulator, for so long; `SECONDS` stands for it.
    Fault(&'static str, Duration),
    /// For so long the robot does not find its station. The link is as good as ever.
    StationUnseen(Duration),
    /// The battery collapses to this, percent.
    Battery(f64),
    /// The computer is dark for so long. The robot hears no last word of it.
    PowerCut(Duration),
    /// The program is killed; its guardian stops the robot. Started again at once.
    Killed,
    /// Somebody sets the clock back by a day.
    ClockBack,
}

/// A trouble and its time since the beginning.
pub type Due = (Duration, Trouble);

const OUTAGES: [&str; 7] = [
    "{ fault: drop }",
    "{ fault: reset }",
    "{ fault: half_open, for: SECONDS }",
    "{ fault: delay, seconds: 0.1, jitter: 0.2, for: SECONDS }",
    "{ fault: reboot, for: SECONDS, state: kept }",
    "{ fault: reboot, for: SECONDS, state: lost }",
    "{ fault: take_over, for: SECONDS }",
];

/// All troubles of so many days, in their order. What must not be missing is in the first two.
pub fn troubles(days: u64, seed: u64) -> Vec<Due> {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut all = Vec::new();
    let minutes = |minutes: u64| Duration::from_secs(minutes * 60);
    let mut wall = Wall::new(begins());
    for day in 0..days {
        let began = Duration::from_secs(day * DAY);
        let gone_at_night = day % 6 == 1;
        // After the change of the clock the wall shows seven when so many days have passed.
        let hour = wall.at(began).to_zoned(rome()).hour();
        let eight = began + minutes(60) * u32::from(hour.abs_diff(8));
        let mut at = |since_eight: u64, trouble: Trouble| {
            let since = eight + Duration::from_secs(since_eight);
            all.push((since, trouble));
        };
        for _ in 0..3 {
            let what = OUTAGES[rng.random_range(0..OUTAGES.len())];
            let seconds = rng.random_range(5..90);
            let lasts = Duration::from_secs(seconds);
            at(rng.random_range(0..DAY), Trouble::Fault(what, lasts));
        }
        // In the middle of the morning's patrol.
        if day % 2 == 0 {
            at(HOUR + 600, Trouble::PowerCut(minutes(3)));
        }
        if day % 3 == 1 {
            at(HOUR + 700, Trouble::Killed);
        }
        if day % 4 == 1 {
            at(HOUR + 900, Trouble::Battery(18.0));
        }
        // A low robot that finds no station sounds the alarm, in the evening's patrol.
        if matches!(day % 5, 0 | 3) && !gone_at_night {
            at(13 * HOUR + 300, Trouble::StationUnseen(minutes(12)));
            at(13 * HOUR + 310, Trouble::Battery(19.0));
        }
        if day % 6 == 4 {
            let broken = "{ fault: no_charge, for: SECONDS }";
            at(3 * HOUR, Trouble::Fault(broken, minutes(100)));
        }
        // From half past eight in the evening to half past eight in the morning.
        if gone_at_night {
            let gone = "{ fault: reboot, for: SECONDS, state: kept }";
            at(12 * HOUR + 1800, Trouble::Fault(gone, minutes(12 * 60)));
        }
        if day % 10 == 1 {
            at(4 * HOUR, Trouble::ClockBack);
            wall.set_back(eight + minutes(4 * 60), minutes(24 * 60));
        }
        if day % 3 == 2 {
            let dark = minutes(rng.random_range(1..90));
            at(
                rng.random_range(5 * HOUR..12 * HOUR),
                Trouble::PowerCut(dark),
            );
        }
    }
    all.retain(|(at, _)| *at < Duration::from_secs(days * DAY));
    all.sort_by_key(|(at, _)| *at);
    all
}

/// The starts that the timetable wants between two looks at the wall, by the calendar alone: patrols at
/// nine and at twenty-one o'clock, a look at half past fourteen.
pub fn planned(from: Timestamp, until: Timestamp) -> Vec<(Timestamp, &'static str)> {
    let mut all = Vec::new();
    let mut date: Date = from.to_zoned(rome()).date();
    while date <= until.to_zoned(rome()).date() {
        for (hour, minute, run) in [(9, 0, "patrol"), (14, 30, "look"), (21, 0, "patrol")] {
            let wall = date.at(hour, minute, 0, 0).to_zoned(rome()).unwrap();
            all.push((wall.timestamp(), run));
        }
        date = date.checked_add(1.day()).unwrap();
    }
    all.retain(|(at, _)| from < *at && *at <= until);
    all
}

/// What the wall shows, as it was set: from which moment on, and what it showed then.
#[derive(Debug, Clone)]
pub struct Wall(Vec<(Duration, Timestamp)>);

impl Wall {
    pub fn new(begins: Timestamp) -> Wall {
        Wall(vec![(Duration::ZERO, begins)])
    }

    pub fn at(&self, moment: Duration) -> Timestamp {
        let (since, shown) = self.0[self.part_of(moment)];
        shown + SignedDuration::try_from(moment - since).unwrap()
    }

    fn part_of(&self, moment: Duration) -> usize {
        self.0
            .iter()
            .rposition(|(since, _)| *since <= moment)
            .unwrap()
    }

    /// Somebody sets it back; what it shows from now on.
    pub fn set_back(&mut self, moment: Duration, by: Duration) -> Timestamp {
        let shown = self.at(moment) - by;
        self.0.push((moment, shown));
        shown
    }

    /// The moments at which the timetable wants starts, until this one.
    pub fn planned(&self, until: Duration) -> Vec<(Duration, &'static str)> {
        let ends = self
            .0
            .iter()
            .skip(1)
            .map(|(since, _)| *since)
            .chain([until]);
        let parts = self.0.iter().zip(ends);
        let starts = parts.flat_map(|((since, shown), end)| {
            let last = *shown + SignedDuration::try_from(end - *since).unwrap();
            planned(*shown, last).into_iter().map(|(at, run)| {
                let after = Duration::try_from(at.duration_since(*shown)).unwrap();
                (*since + after, run)
            })
        });
        starts.collect()
    }

    /// The moments of a journal's rows, which are in the order in which they were written: a time that
    /// is hours before the one before is of a clock that was set back. The newest are of the last
    /// part; the oldest may be of any, since a journal forgets.
    pub fn moments(&self, rows: impl DoubleEndedIterator<Item = Timestamp>) -> Vec<Duration> {
        let mut part = self.0.len() - 1;
        let mut oldest = Timestamp::MAX;
        let rows = rows.rev().map(|at| {
            let set_back = at.duration_since(oldest) > SignedDuration::from_hours(12);
            if set_back && part > 0 {
                (part, oldest) = (part - 1, at);
            }
            oldest = oldest.min(at);
            let (since, shown) = self.0[part];
            let after = at.duration_since(shown);
            since.saturating_add(Duration::try_from(after).unwrap_or(Duration::ZERO))
        });
        let mut moments: Vec<Duration> = rows.collect();
        moments.reverse();
        moments
    }
}
