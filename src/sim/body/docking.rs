//! The robot's built-in manoeuvres: BASE_FIND searches for the station's beacon and drives onto the
//! contacts, CHARGE_STOP backs out. Computes track speeds; the chassis executes them.
//!
//! How, and for how long, a real robot searches is not known (`PROTOCOL.md`, *Not known*).

use std::f64::consts::PI;
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

use super::chassis::Tracks;
use crate::geometry::obstacles::Obstacles;
use crate::geometry::{Point, Pose, RADIUS, TRACK_WIDTH, wrap};
use crate::world::station::{DockingSettings, Leaves, Station};

/// The whole manoeuvre, search included, ends without success after this time.
const DOCKING_LIMIT: Duration = Duration::from_secs(150);
/// Without the beacon for this long, the robot stops approaching and searches again.
const LOST_AFTER: Duration = Duration::from_secs(3);
/// Time limit for one attempt to drive from in front of the station onto its contacts.
const ENTER_LIMIT: Duration = Duration::from_secs(15);
/// Backing out ends after this time even if something is in the way.
const LEAVE_LIMIT: Duration = Duration::from_secs(6);
/// The robot has left the station at this distance from the contacts, metres.
const LEFT_AT: f64 = 0.40;
/// Half the field of view of the infrared receiver, radians.
const RECEIVER_VIEW: f64 = 0.6;
/// Turning speed of a search, radians per second.
const TURNING: f64 = 0.8;
/// Speed of backing out and of backing off, metres per second.
const BACKING: f64 = 0.15;
/// The turn towards the station's axis after an approach without contact, radians. With it nine in ten
/// dockings without sight take less than a minute.
const SIDESTEP: f64 = 0.5;
/// Clearance between body and obstacles during the approach, metres.
const MARGIN: f64 = 0.03;

pub(crate) struct DockingInputs<'a> {
    pub(crate) pose: Pose,
    pub(crate) station: &'a Station,
    pub(crate) obstacles: &'a Obstacles,
    /// The beacon is on, and the sun does not dazzle the receivers.
    pub(crate) beacon: bool,
    /// The robot is where the contacts are, but they do not touch.
    pub(crate) missed: bool,
}

impl DockingInputs<'_> {
    fn distance(&self) -> f64 {
        self.pose.point().distance(self.station.beacon())
    }

    fn in_light(&self) -> bool {
        self.beacon
            && self
                .station
                .beacon_reaches(self.pose.point(), self.obstacles)
    }

    fn sees_beacon(&self) -> bool {
        self.in_light() && self.pose.bearing_of(self.station.beacon()).abs() < RECEIVER_VIEW
    }

    /// Returns what the receivers hear: all that a robot without eyes for obstacles knows.
    fn receivers(&self) -> Receivers {
        let bearing = self.pose.bearing_of(self.station.beacon());
        let hears = |least: f64, most: f64| self.in_light() && (least..most).contains(&bearing);
        let off_axis = self.station.off_axis(self.pose.point());
        Receivers {
            left: hears(0.08, 1.2),
            front: hears(-0.25, 0.25),
            right: hears(-1.2, -0.08),
            loud: self.in_light() && self.distance() < 0.45,
            left_beam: self.in_light() && off_axis > -0.1,
            right_beam: self.in_light() && off_axis < 0.1,
        }
    }
}

/// Which receivers hear the beacon, and which of its beams, one to each side, as those of robots that
/// dock in the same way have.
#[derive(Debug, Clone, Copy)]
struct Receivers {
    left: bool,
    front: bool,
    right: bool,
    /// As strong as directly in front of the station.
    loud: bool,
    left_beam: bool,
    right_beam: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum DockingStep {
    /// No manoeuvre is active: the commanded speeds apply.
    Free,
    /// Speeds of the tracks, metres per second.
    Drive(Tracks<f64>),
    NotFound,
    Left,
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum DockingPhase {
    #[default]
    Idle,
    Searching,
    Approaching,
    Aligning,
    Entering {
        since: Duration,
    },
    /// Drives towards the beacon by its receivers alone; `loud` for so long.
    Homing {
        loud: Duration,
    },
    /// Backs off after an entry without contact, once it has turned by this angle, radians.
    Retreating {
        since: Duration,
        turn: f64,
    },
    Leaving {
        since: Duration,
    },
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Docking {
    phase: DockingPhase,
    search_limit: Duration,
    elapsed: Duration,
    unseen: Duration,
}

impl Docking {
    /// Creates an idle state. A search fails after `search_limit` without the beacon.
    pub(crate) fn new(search_limit: Duration) -> Docking {
        Docking {
            search_limit,
            ..Docking::default()
        }
    }

    pub(crate) fn find_base(&mut self) {
        *self = Docking {
            phase: DockingPhase::Searching,
            ..Docking::new(self.search_limit)
        };
    }

    pub(crate) fn leave(&mut self) {
        self.phase = DockingPhase::Leaving {
            since: Duration::ZERO,
        };
    }

    pub(crate) fn stop(&mut self) {
        self.phase = DockingPhase::Idle;
    }

    pub(crate) fn searching(&self) -> bool {
        !matches!(
            self.phase,
            DockingPhase::Idle | DockingPhase::Leaving { .. }
        )
    }

    pub(crate) fn leaving(&self) -> bool {
        matches!(self.phase, DockingPhase::Leaving { .. })
    }

    pub(crate) fn step(&mut self, dt: Duration, mut inputs: DockingInputs<'_>) -> DockingStep {
        let leaves = inputs.station.leaves;
        inputs.pose.heading = leaves.turned(inputs.pose.heading);
        match self.step_facing(dt, &inputs) {
            DockingStep::Drive(speeds) if leaves == Leaves::Forward => {
                DockingStep::Drive(Tracks::new(-speeds.right, -speeds.left))
            }
            step => step,
        }
    }

    /// As if the robot docked with its front, whichever side it docks with.
    fn step_facing(&mut self, dt: Duration, inputs: &DockingInputs<'_>) -> DockingStep {
        if self.searching() && self.given_up(dt, inputs) {
            self.stop();
            return DockingStep::NotFound;
        }
        match self.phase {
            DockingPhase::Idle => DockingStep::Free,
            DockingPhase::Searching => self.search(inputs),
            DockingPhase::Approaching => self.approach(inputs),
            DockingPhase::Aligning => self.align(inputs),
            DockingPhase::Entering { since } => self.enter(since + dt, inputs),
            DockingPhase::Homing { loud } => self.home(loud, dt, inputs.receivers()),
            DockingPhase::Retreating { since, turn } => self.retreat(since + dt, turn),
            DockingPhase::Leaving { since } => self.back_out(since + dt, inputs),
        }
    }

    fn given_up(&mut self, dt: Duration, inputs: &DockingInputs<'_>) -> bool {
        let seen = match self.phase {
            DockingPhase::Searching | DockingPhase::Homing { .. } => inputs.sees_beacon(),
            _ => inputs.in_light(),
        };
        self.elapsed += dt;
        self.unseen = if seen {
            Duration::ZERO
        } else {
            self.unseen + dt
        };
        self.unseen > self.search_limit || self.elapsed > DOCKING_LIMIT
    }

    fn search(&mut self, inputs: &DockingInputs<'_>) -> DockingStep {
        if inputs.sees_beacon() {
            self.phase = if inputs.station.docking.sees_obstacles {
                DockingPhase::Approaching
            } else {
                DockingPhase::Homing {
                    loud: Duration::ZERO,
                }
            };
        }
        DockingStep::Drive(twist(0.0, TURNING))
    }

    /// Drives to the staging pose, from which the station can be entered in a straight line.
    fn approach(&mut self, inputs: &DockingInputs<'_>) -> DockingStep {
        const ARRIVED: f64 = 0.04;
        let target = inputs.station.staging_pose().point();
        let distance = inputs.pose.point().distance(target);
        if self.unseen > LOST_AFTER {
            self.phase = DockingPhase::Searching;
        } else if distance < ARRIVED {
            self.phase = DockingPhase::Aligning;
        }
        let off = wrap(free_direction(inputs, target) - inputs.pose.heading);
        let speed = if off.abs() < 0.5 {
            (0.04 + 0.8 * distance).min(0.25)
        } else {
            0.0
        };
        DockingStep::Drive(twist(speed, (2.5 * off).clamp(-1.2, 1.2)))
    }

    fn align(&mut self, inputs: &DockingInputs<'_>) -> DockingStep {
        let off = wrap(inputs.station.inwards() - inputs.pose.heading);
        if off.abs() < 0.03 {
            self.phase = DockingPhase::Entering {
                since: Duration::ZERO,
            };
        }
        DockingStep::Drive(twist(0.0, (2.0 * off).clamp(-0.8, 0.8)))
    }

    /// Drives slowly along the station's axis. `Robot` ends the manoeuvre when the contacts touch.
    fn enter(&mut self, since: Duration, inputs: &DockingInputs<'_>) -> DockingStep {
        let (ahead, aside) = inputs.station.offset(inputs.pose);
        let heading = inputs.station.inwards() + (3.0 * aside).clamp(-0.4, 0.4);
        let off = wrap(heading - inputs.pose.heading);
        if inputs.missed {
            self.back_off(0.0);
            return DockingStep::Drive(Tracks::default());
        }
        self.phase = if since > ENTER_LIMIT {
            DockingPhase::Approaching
        } else {
            DockingPhase::Entering { since }
        };
        DockingStep::Drive(twist(
            (0.05 + 0.3 * ahead).clamp(0.05, 0.15),
            (3.0 * off).clamp(-0.6, 0.6),
        ))
    }

    /// Drives towards the beacon, until it has been in front of the station for long enough to
    /// touch the contacts. Then it turns towards the station's axis and backs off, so that it comes again
    /// from there: contacts close only near the axis.
    fn home(&mut self, loud: Duration, dt: Duration, hears: Receivers) -> DockingStep {
        // Also with an empty battery, which makes a genuine robot slow, it comes to the contacts in time.
        const PRESS: Duration = Duration::from_secs(8);
        let loud = if hears.loud { loud + dt } else { loud };
        self.phase = DockingPhase::Homing { loud };
        if loud > PRESS {
            let side = i8::from(hears.right_beam) - i8::from(hears.left_beam);
            self.back_off(SIDESTEP * f64::from(side));
        } else if self.unseen > LOST_AFTER {
            self.phase = DockingPhase::Searching;
        }
        let turning = f64::from(i8::from(hears.left) - i8::from(hears.right));
        DockingStep::Drive(match (hears.front, hears.loud) {
            (true, true) => twist(0.08, 0.2 * turning),
            (true, false) => twist(0.2, 0.3 * turning),
            (false, _) => twist(0.0, 0.6 * turning),
        })
    }

    fn back_off(&mut self, turn: f64) {
        self.phase = DockingPhase::Retreating {
            since: Duration::ZERO,
            turn,
        };
    }

    fn retreat(&mut self, since: Duration, turn: f64) -> DockingStep {
        const BACK: Duration = Duration::from_secs(5);
        let turned_after = Duration::from_secs_f64(turn.abs() / TURNING);
        self.phase = if since > turned_after + BACK {
            DockingPhase::Searching
        } else {
            DockingPhase::Retreating { since, turn }
        };
        DockingStep::Drive(if since < turned_after {
            twist(0.0, TURNING.copysign(turn))
        } else {
            twist(-BACKING, 0.0)
        })
    }

    fn back_out(&mut self, since: Duration, inputs: &DockingInputs<'_>) -> DockingStep {
        let (ahead, _) = inputs.station.offset(inputs.pose);
        if ahead >= LEFT_AT || since > LEAVE_LIMIT {
            self.stop();
            return DockingStep::Left;
        }
        self.phase = DockingPhase::Leaving { since };
        DockingStep::Drive(twist(-BACKING, 0.0))
    }
}

/// Returns the track speeds for a forward speed (m/s) and a turning speed (rad/s, left positive).
fn twist(speed: f64, turning: f64) -> Tracks<f64> {
    let difference = turning * TRACK_WIDTH / 2.0;
    Tracks::new(speed - difference, speed + difference)
}

/// Returns the best direction towards `target` that is free of obstacles over the look-ahead
/// distance. Deviation from the current heading adds to the cost, so that the robot does not
/// oscillate between two equally good directions.
fn free_direction(inputs: &DockingInputs<'_>, target: Point) -> f64 {
    const LOOK_AHEAD: f64 = 0.5;
    let here = inputs.pose.point();
    let direct = here.direction_of(target);
    let look = here.distance(target).min(LOOK_AHEAD);
    let cost =
        |angle: f64| wrap(angle - direct).abs() + 0.3 * wrap(angle - inputs.pose.heading).abs();
    let free = |angle: &f64| {
        inputs
            .obstacles
            .is_path_free(here, here.ahead(*angle, look), RADIUS + MARGIN)
    };
    let fan = (-8..=8).map(|i| direct + f64::from(i) * PI / 12.0);
    fan.filter(free)
        .min_by(|a, b| cost(*a).total_cmp(&cost(*b)))
        .unwrap_or(direct)
}

#[derive(Debug)]
pub(super) struct Contacts {
    pub(super) touching: bool,
    /// While the robot backs out, true until it has left the station.
    pub(super) docked: bool,
    /// The station's infrared beacon is on.
    pub(super) beacon: bool,
    /// The station charges when the contacts touch.
    pub(super) charger_works: bool,
    settings: DockingSettings,
    random: StdRng,
    /// The robot has entered without contact and not yet left the contacts' place.
    pub(super) missed: bool,
    /// The sun dazzles the receivers, and for how long that stays as it is.
    dazzled: bool,
    dazzle_left: Duration,
    /// How long the contacts have touched, and after how long the station ends charging.
    touched_for: Duration,
    charger_time: Option<Duration>,
}

impl Contacts {
    /// For how long the sun dazzles the receivers, or does not, before that is drawn again.
    const DAZZLE_PERIOD: Duration = Duration::from_secs(2);

    pub(super) fn new(
        settings: DockingSettings,
        touching: bool,
        charger_hours: Option<f64>,
        seed: u64,
    ) -> Contacts {
        Contacts {
            settings,
            random: StdRng::seed_from_u64(seed ^ 0x0063_6f6e_7461_6374),
            missed: false,
            dazzled: false,
            dazzle_left: Duration::ZERO,
            touching,
            docked: touching,
            beacon: true,
            charger_works: true,
            touched_for: Duration::ZERO,
            charger_time: charger_hours.map(|hours| Duration::from_secs_f64(3600.0 * hours)),
        }
    }

    /// Whether receivers in its light hear the beacon.
    pub(super) fn hears_beacon(&self) -> bool {
        self.beacon && !self.dazzled
    }

    pub(super) fn charging(&self) -> bool {
        let over = self
            .charger_time
            .is_some_and(|time| self.touched_for >= time);
        self.touching && self.charger_works && !over
    }

    pub(super) fn step(&mut self, dt: Duration) {
        self.dazzle_left = self.dazzle_left.saturating_sub(dt);
        if self.dazzle_left.is_zero() {
            self.dazzle_left = Contacts::DAZZLE_PERIOD;
            self.dazzled = self.random.random_bool(self.settings.dazzled);
        }
        self.touched_for = if self.touching {
            self.touched_for + dt
        } else {
            Duration::ZERO
        };
    }

    /// `entering` tells whether the robot's own docking brings it here.
    pub(super) fn update(&mut self, station: &Station, pose: Pose, entering: bool) {
        let there = station.touched(pose, self.touching || self.missed);
        if !there {
            self.missed = false;
        } else if entering && !self.touching && !self.missed {
            self.missed = !self.random.random_bool(self.settings.success);
        }
        self.touching = there && !self.missed;
    }

    /// Returns whether the robot is docked, if that has changed since the last call.
    pub(super) fn take_change(&mut self, docking: &Docking) -> Option<bool> {
        let docked = self.touching || (self.docked && docking.leaving());
        let changed = docked != self.docked;
        self.docked = docked;
        if changed { Some(docked) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::chassis::Chassis;
    use crate::world::World;

    const TICK: Duration = Duration::from_millis(20);

    /// The living room with a station that is found from as far as its beacon reaches.
    fn living_room() -> World {
        let yaml = World::builtin_yaml("living_room").unwrap();
        let exact = yaml.replace("preset: genuine", "preset: exact");
        World::from_yaml(&exact, "living_room").unwrap()
    }

    /// Drives until the manoeuvre ends or the contacts touch. Returns the seconds that took, and
    /// whether the contacts touch.
    fn dock_from(world: &World, from: Pose, beacon: bool) -> (f64, bool) {
        let obstacles = world.obstacles();
        let mut body = Chassis::new(from);
        let mut docking = Docking::new(Duration::from_secs(20));
        docking.find_base();
        for step in 0.. {
            let station = &world.station;
            let inputs = DockingInputs {
                pose: body.pose,
                station,
                obstacles: &obstacles,
                beacon,
                missed: false,
            };
            match docking.step(TICK, inputs) {
                DockingStep::Drive(speeds) => body.set_target(speeds),
                DockingStep::NotFound => return (f64::from(step) / 50.0, false),
                other => panic!("{other:?}"),
            }
            body.step(TICK, &obstacles, &[]);
            if station.touched(body.pose, false) {
                return (f64::from(step) / 50.0, true);
            }
        }
        unreachable!()
    }

    #[test]
    fn finds_the_station_from_everywhere_in_the_living_room() {
        let world = living_room();
        let obstacles = world.obstacles();
        let mut tried = 0;
        let mut slowest = 0.0;
        for i in 0..80 {
            let at = Point::new(
                0.3 + f64::from(i % 10) * 0.44,
                0.3 + f64::from(i / 10) * 0.6,
            );
            let lit = world.station.beacon_reaches(at, &obstacles);
            if !lit || obstacles.clearance(at) < RADIUS {
                continue;
            }
            let (seconds, found) = dock_from(&world, Pose::at(at, f64::from(i)), true);
            assert!(found, "not from {at:?}: gave up after {seconds} s");
            (tried, slowest) = (tried + 1, f64::max(slowest, seconds));
        }
        assert!(
            tried > 40 && slowest < 60.0,
            "{tried} tries, slowest {slowest} s"
        );
    }

    #[test]
    fn a_station_behind_a_wall_is_not_found() {
        let world = living_room();
        let (_, found) = dock_from(&world, Pose::new(5.5, 0.6, 0.0), true);
        assert!(!found);
    }

    #[test]
    fn backing_out_ends_clear_of_the_station() {
        let world = living_room();
        let station = &world.station;
        let obstacles = world.obstacles();
        let mut body = Chassis::new(station.dock_pose());
        let mut docking = Docking::new(Duration::ZERO);
        docking.leave();
        for _ in 0..1000 {
            let inputs = DockingInputs {
                pose: body.pose,
                station,
                obstacles: &obstacles,
                beacon: true,
                missed: false,
            };
            match docking.step(TICK, inputs) {
                DockingStep::Drive(speeds) => body.set_target(speeds),
                end => {
                    assert_eq!(end, DockingStep::Left);
                    break;
                }
            }
            body.step(TICK, &obstacles, &[]);
        }
        assert!(!docking.leaving() && station.offset(body.pose).0 >= LEFT_AT);
        assert_eq!(body.collisions, 0);
    }
}
