//! Estimates how fast the battery drains and charges, from its reported levels: percent per minute
//! for each activity, and the minutes that are left.
//!
//! Levels come in whole percents, so time is counted from one change of the level to the next. A
//! level that leaps says nothing about the time before it.

use std::time::Duration;

use tokio::time::Instant;

use super::streak::FASTEST_CHARGE;

/// What the robot spends its battery on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// The tracks are at rest.
    Standing,
    /// The robot searches for its station on its own.
    Searching,
    /// The tracks are driven.
    Driving,
}

impl Activity {
    /// All activities.
    const ALL: [Activity; 3] = [Activity::Standing, Activity::Searching, Activity::Driving];

    /// The assumed drain relative to the other activities, while no rate is known.
    fn guess(self) -> f64 {
        match self {
            Activity::Standing => 1.0,
            Activity::Searching => 1.5,
            Activity::Driving => 2.0,
        }
    }
}

/// Percents and the minutes they took; old data decays.
#[derive(Debug, Clone, Copy, Default)]
struct Account {
    percent: f64,
    minutes: f64,
}

impl Account {
    /// At most this many percent are remembered.
    const MEMORY: f64 = 10.0;
    /// A rate is known from this many percent on.
    const ENOUGH: f64 = 2.0;

    fn add(&mut self, percent: f64, minutes: f64) {
        let (percent, minutes) = (self.percent + percent, self.minutes + minutes);
        let kept = (Account::MEMORY / percent.max(Account::MEMORY)).min(1.0);
        (self.percent, self.minutes) = (percent * kept, minutes * kept);
    }

    fn rate(self) -> Option<f64> {
        let known = self.percent >= Account::ENOUGH - 1e-6 && self.minutes > 0.0;
        known.then(|| self.percent / self.minutes)
    }
}

/// Learns the rates from levels and activities.
#[derive(Debug, Clone, Default)]
pub struct Drain {
    activities: [Account; Activity::ALL.len()],
    charge: Account,
    /// Recent drain of all activities together.
    recent: Account,
    level: Option<u8>,
    charging: bool,
    /// Whether `spent` began at a change of the level.
    edge: bool,
    /// Minutes of each activity since then.
    spent: [f64; Activity::ALL.len()],
    activity: Option<Activity>,
    /// `spent` is counted up to this time.
    counted: Option<Instant>,
}

impl Drain {
    /// A level that moves back by up to this many points is rounding noise.
    const FLICKER: u8 = 2;
    /// A change by more than this many points beyond what the elapsed time explains is a leap.
    const LEAP: f64 = 5.0;
    /// The fastest plausible drain, percent per minute.
    const FASTEST_DRAIN: f64 = 20.0;

    /// Sets the activity from `now` on.
    pub fn advance(&mut self, activity: Activity, now: Instant) {
        self.count(now);
        self.activity = Some(activity);
    }

    /// Forgets level and activity: the link is lost, and what the robot does meanwhile is not
    /// known.
    pub fn interrupt(&mut self) {
        (self.level, self.activity, self.counted) = (None, None, None);
    }

    /// Takes in a level that is believed.
    pub fn level(&mut self, percent: u8, charging: bool, now: Instant) {
        self.count(now);
        let before = match self.level {
            Some(before) if self.charging == charging => before,
            _ => return self.begin(percent, charging),
        };
        let (ahead, back) = if charging {
            (
                percent.saturating_sub(before),
                before.saturating_sub(percent),
            )
        } else {
            (
                before.saturating_sub(percent),
                percent.saturating_sub(before),
            )
        };
        if back > Drain::FLICKER || f64::from(ahead) > Drain::LEAP + self.explained() {
            self.begin(percent, charging);
            self.recent = Account::default();
        } else if ahead > 0 {
            self.learn(f64::from(ahead));
            self.begin(percent, charging);
            self.edge = true;
        }
    }

    /// Percent per minute of one activity; `None` until two percent of it have been observed.
    pub fn rate(&self, activity: Activity) -> Option<f64> {
        self.activities[activity as usize].rate()
    }

    /// Percent per minute on the charger; `None` until two percent have been observed.
    pub fn charging_rate(&self) -> Option<f64> {
        self.charge.rate()
    }

    /// Minutes until the battery is empty, at the average rate of the last ten percent. `None`
    /// while it charges, and until two percent without a leap have been observed.
    pub fn minutes_left(&self) -> Option<f64> {
        if self.charging {
            return None;
        }
        Some(f64::from(self.level?) / self.recent.rate()?)
    }

    /// Minutes until the battery is empty at the rate of this activity alone; `None` until that
    /// rate is known.
    pub fn minutes_left_if(&self, activity: Activity) -> Option<f64> {
        Some(f64::from(self.level?) / self.rate(activity)?)
    }

    fn begin(&mut self, percent: u8, charging: bool) {
        (self.level, self.charging) = (Some(percent), charging);
        (self.edge, self.spent) = (false, [0.0; Activity::ALL.len()]);
    }

    fn count(&mut self, now: Instant) {
        if let (Some(activity), Some(counted)) = (self.activity, self.counted) {
            self.spent[activity as usize] += minutes(now.saturating_duration_since(counted));
        }
        self.counted = Some(now);
    }

    fn explained(&self) -> f64 {
        let fastest = if self.charging {
            60.0 * FASTEST_CHARGE
        } else {
            Drain::FASTEST_DRAIN
        };
        fastest * self.spent.iter().sum::<f64>()
    }

    /// Learns from a level that has changed by `percent` points since its last change.
    fn learn(&mut self, percent: f64) {
        let total: f64 = self.spent.iter().sum();
        if !self.edge || total <= 0.0 {
            return;
        }
        if self.charging {
            return self.charge.add(percent, total);
        }
        self.recent.add(percent, total);
        let needs = self.needs();
        let all: f64 = Activity::ALL
            .iter()
            .map(|one| self.share(*one, &needs))
            .sum();
        for activity in Activity::ALL {
            let share = self.share(activity, &needs) / all;
            let minutes = self.spent[activity as usize];
            self.activities[activity as usize].add(percent * share, minutes);
        }
    }

    fn share(&self, activity: Activity, needs: &[f64; Activity::ALL.len()]) -> f64 {
        needs[activity as usize] * self.spent[activity as usize]
    }

    /// The drain of each activity: as learnt, or else estimated from those that are known.
    fn needs(&self) -> [f64; Activity::ALL.len()] {
        let ratio = |one: &Activity| Some(self.rate(*one)? / one.guess());
        let ratios: Vec<f64> = Activity::ALL.iter().filter_map(ratio).collect();
        let scale = if ratios.is_empty() {
            1.0
        } else {
            ratios.iter().sum::<f64>() / ratios.len() as f64
        };
        Activity::ALL.map(|one| self.rate(one).unwrap_or(one.guess() * scale))
    }
}

fn minutes(span: Duration) -> f64 {
    span.as_secs_f64() / 60.0
}

#[cfg(test)]
mod tests;
