//! When a simulated robot was really held, and what its script was told.

use std::collections::BTreeMap;
use std::time::Duration;

use spykee::sim::{Pose, State};

/// It must be told so soon.
const IN_TIME: Duration = Duration::from_secs(1);
/// What is told so long after the robot was held is not for nothing.
const LATELY: Duration = Duration::from_millis(500);
/// A robot that gets free for less time is still held.
const AGAIN: Duration = Duration::from_millis(100);
/// Percent of the blockings, and calls for nothing an hour.
const GOAL: (f64, f64) = (90.0, 1.0);

/// What the script says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Said {
    /// It begins a motion that is to last so long.
    Begins(Duration, &'static str),
    /// It was told that the robot is held.
    Blocked,
    /// Its pose begins here.
    Origin,
    /// Its pose: metres ahead and to the left, and degrees to the left.
    Pose([f64; 3]),
}

impl Said {
    /// Of a line of its log.
    pub fn parse(line: &str) -> Option<Said> {
        if line == "blocked" {
            return Some(Said::Blocked);
        }
        if line == "origin" {
            return Some(Said::Origin);
        }
        if let Some(pose) = line.strip_prefix("pose ") {
            let mut numbers = pose.split(' ').map_while(|word| word.parse().ok());
            return Some(Said::Pose([
                numbers.next()?,
                numbers.next()?,
                numbers.next()?,
            ]));
        }
        let (seconds, how) = line.strip_prefix("for ")?.split_once(' ')?;
        let how = ["straight", "curve", "turn"]
            .into_iter()
            .find(|one| *one == how)?;
        let time = Duration::try_from_secs_f64(seconds.parse().ok()?).ok()?;
        Some(Said::Begins(time, how))
    }
}

/// Of some blockings.
#[derive(Debug, Default, Clone, Copy)]
pub struct Count {
    blockings: usize,
    in_time: usize,
    late: usize,
}

impl Count {
    fn add(&mut self, other: Count) {
        self.blockings += other.blockings;
        self.in_time += other.in_time;
        self.late += other.late;
    }

    fn cells(&self) -> String {
        let Count {
            blockings,
            in_time,
            late,
        } = self;
        format!(
            "{blockings} | {in_time} ({:.0} %) | {late}",
            percent(*in_time, *blockings)
        )
    }
}

/// What became of robots.
#[derive(Debug, Default, Clone)]
pub struct Score {
    kinds: BTreeMap<&'static str, Count>,
    for_nothing: usize,
    driven: Duration,
    /// How far off poses were, in metres and in degrees.
    off: [Vec<f64>; 2],
    /// What was missed, and what was told for nothing.
    pub notes: Vec<String>,
}

impl Score {
    /// Of a table of scores.
    pub fn heading(first: &str) -> String {
        let columns = "blockings | told within a second | told later | told for nothing |";
        format!("| {first} | {columns}\n| --- | --- | --- | --- | --- |")
    }

    pub fn add(&mut self, other: Score) {
        for (kind, count) in other.kinds {
            self.kinds.entry(kind).or_default().add(count);
        }
        self.for_nothing += other.for_nothing;
        self.driven += other.driven;
        for (off, more) in self.off.iter_mut().zip(other.off) {
            off.extend(more);
        }
        self.notes.extend(other.notes);
    }

    pub fn line(&self, name: &str) -> String {
        let hours = hours(self.driven);
        format!(
            "| {name} | {} | {} in {hours:.1} h |",
            self.all().cells(),
            self.for_nothing
        )
    }

    /// The rates, in a sentence.
    pub fn rates(&self) -> String {
        let Count {
            blockings,
            in_time,
            late,
        } = self.all();
        let of_ten = |off: &Vec<f64>, tenths: usize| {
            let mut off = off.clone();
            off.sort_by(f64::total_cmp);
            off.get(off.len() * tenths / 10).copied().unwrap_or(0.0)
        };
        let [metres, degrees] = &self.off;
        format!(
            "{:.0} % of {blockings} blockings told within a second, {:.0} % at all, {:.1} false \
             alarms an hour; poses off by {:.2} m and {:.0} degrees after a minute in half of {} \
             cases, {:.2} m and {:.0} degrees in nine of ten",
            percent(in_time, blockings),
            percent(in_time + late, blockings),
            self.for_nothing as f64 / hours(self.driven).max(0.1),
            of_ten(metres, 5),
            of_ten(degrees, 5),
            metres.len(),
            of_ten(metres, 9),
            of_ten(degrees, 9),
        )
    }

    /// A line for each kind of obstacle.
    pub fn print_kinds(&self) {
        println!("\n| held by | blockings | told within a second | told later |");
        println!("| --- | --- | --- | --- |");
        for (kind, count) in &self.kinds {
            println!("| {kind} | {} |", count.cells());
        }
    }

    pub fn reaches_the_goals(&self) -> bool {
        let all = self.all();
        let an_hour = self.for_nothing as f64 / hours(self.driven).max(1.0);
        percent(all.in_time, all.blockings) >= GOAL.0 && an_hour <= GOAL.1
    }

    fn all(&self) -> Count {
        let mut all = Count::default();
        self.kinds.values().for_each(|count| all.add(*count));
        all
    }
}

fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

fn hours(time: Duration) -> f64 {
    time.as_secs_f64() / 3600.0
}

/// When the robot was held although its tracks should have moved it on.
#[derive(Default)]
pub struct Looks {
    held: Vec<Held>,
    ways: Vec<(Duration, Pose, &'static str)>,
    /// The last look found it held.
    holds: bool,
}

struct Held {
    from: Duration,
    to: Duration,
    pose: Pose,
    /// Metres that it moved meanwhile.
    moved: f64,
    what: &'static str,
}

impl Looks {
    /// At a time; `what` says what it ran into last.
    pub fn take(&mut self, now: Duration, state: &State, what: impl FnOnce() -> &'static str) {
        let pushes = i16::from(state.commanded.left) + i16::from(state.commanded.right) != 0;
        let holds = state.blocked && pushes && !state.docked && !state.leaving;
        let pose = state.pose;
        let docking = match state {
            State { docked: true, .. } => ", docked",
            State { leaving: true, .. } => ", leaving its station",
            State { blocked: true, .. } => ", against something",
            _ => "",
        };
        self.ways.push((now, pose, docking));
        if let (true, Some(last)) = (holds, self.held.last_mut())
            && (self.holds || now - last.to < AGAIN)
        {
            last.moved = (pose.x - last.pose.x).hypot(pose.y - last.pose.y);
            last.to = now;
        } else if holds {
            self.held.push(Held {
                from: now,
                to: now,
                pose,
                moved: 0.0,
                what: what(),
            });
        }
        self.holds = holds;
    }

    /// A blocking that ended by itself within the time for telling it is none, nor one whose motion was to
    /// end within that time anyway.
    pub fn score(&self, heard: &[(Duration, Said)], driven: Duration, who: &str) -> Score {
        let mut score = Score {
            driven,
            ..Score::default()
        };
        let told = || {
            heard
                .iter()
                .filter(|(_, said)| *said == Said::Blocked)
                .map(|(at, _)| *at)
        };
        for held in &self.held {
            let planned = heard.iter().rev().find_map(|(at, said)| match said {
                Said::Begins(time, _) if *at <= held.from => Some(*at + *time),
                _ => None,
            });
            if planned.is_none_or(|end| end < held.from + IN_TIME) {
                continue;
            }
            let answer = told().find(|at| *at >= held.from && *at <= held.to + LATELY);
            let in_time = answer.is_some_and(|at| at <= held.from + IN_TIME);
            if answer.is_none() && held.to < held.from + IN_TIME {
                continue;
            }
            let late = answer.is_some() && !in_time;
            let count = Count {
                blockings: 1,
                in_time: in_time.into(),
                late: late.into(),
            };
            score.kinds.entry(held.what).or_default().add(count);
            if !in_time {
                let Pose { x, y, heading } = held.pose;
                score.notes.push(format!(
                    "{who}: held by {} at {:.1} s for {:.1} s at {x:.2} {y:.2} m, {:.0} degrees, moved {:.2} m; \
                     told after {:.1?}", held.what, held.from.as_secs_f64(), (held.to - held.from).as_secs_f64(),
                     heading.to_degrees(), held.moved, answer.map(|at| at - held.from),
                ));
            }
        }
        for at in told() {
            let really = |held: &Held| held.from <= at && at <= held.to + LATELY;
            if !self.held.iter().any(really) {
                score.for_nothing += 1;
                let seconds = at.as_secs_f64();
                let way = self.way_before(at);
                score
                    .notes
                    .push(format!("{who}: told for nothing at {seconds:.1} s{way}"));
            }
        }
        score.off = self.pose_errors(heard);
        score
    }

    /// How far off the poses were that the script said, in metres and in degrees.
    fn pose_errors(&self, heard: &[(Duration, Said)]) -> [Vec<f64>; 2] {
        let true_pose = |time: Duration| {
            let index = self.ways.partition_point(|(then, ..)| *then <= time);
            Some(self.ways.get(index.checked_sub(1)?)?.1)
        };
        let mut off = [Vec::new(), Vec::new()];
        let mut origin = None;
        for (at, said) in heard {
            match said {
                Said::Origin => origin = true_pose(*at),
                Said::Pose([x, y, degrees]) => {
                    let (Some(from), Some(to)) = (origin, true_pose(*at)) else {
                        continue;
                    };
                    let (sin, cos) = from.heading.sin_cos();
                    let dx = to.x - from.x;
                    let dy = to.y - from.y;
                    let ahead = dx * cos + dy * sin;
                    let aside = dy * cos - dx * sin;
                    let turned = (to.heading - from.heading).to_degrees() - degrees;
                    off[0].push((ahead - x).hypot(aside - y));
                    off[1].push((turned + 180.0).rem_euclid(360.0) - 180.0);
                }
                _ => {}
            }
        }
        off[1]
            .iter_mut()
            .for_each(|degrees| *degrees = degrees.abs());
        off
    }

    /// Where it was then, and how far it had come within a second.
    fn way_before(&self, at: Duration) -> String {
        let until = |time: Duration| self.ways.iter().rev().find(|(then, ..)| *then <= time);
        let (Some((_, before, _)), Some((_, now, docking))) =
            (until(at.saturating_sub(IN_TIME)), until(at))
        else {
            return String::new();
        };
        let moved = (now.x - before.x).hypot(now.y - before.y);
        let x = now.x;
        let y = now.y;
        let degrees = now.heading.to_degrees();
        format!(" at {x:.2} {y:.2} m, {degrees:.0} degrees, moved {moved:.2} m{docking}")
    }
}
