//! `robot.move`, `robot.drive`, `robot.forward`, `robot.turn`, `robot.stop`, docking, and the
//! resulting pose.

use std::time::Duration;

use super::super::options::Calibration;
use super::super::task::{Cancel, Task, Wait};
use super::{Call, NativeResult, Natives, of_row};
use crate::odometry::ACCELERATION;
use crate::robot::{DockPlan, Intent, MotionEnd, Setpoint};

pub(super) const NATIVES: &Natives = &[
    ("robot.move", move_tracks),
    ("robot.drive", drive),
    ("robot.forward", forward),
    ("robot.turn", turn),
    ("robot.stop", stop),
    ("robot.pose", pose),
    ("robot.reset_pose", |call| {
        call.state.odometry.reset();
        call.reply(())
    }),
    ("robot.dock", dock),
    ("robot.undock", undock),
    ("robot.cancel_dock", cancel_dock),
];

/// The longest drive of one call, in seconds, as in the rows of `robot.move` and `robot.drive`.
const LONGEST_DRIVE: f64 = 3600.0;

/// Default speed of `forward` and `turn`, as a share of full speed.
const USUAL: f64 = 0.5;

/// A setpoint whose faster track would have less than this share of the least power stands: small
/// corrections would else swing the robot to and fro.
const STANDS: f64 = 1.0 / 3.0;

/// Speeds of the tracks, in metres per second.
#[derive(Debug, Clone, Copy, PartialEq)]
struct TrackSpeeds {
    left: f64,
    right: f64,
}

impl TrackSpeeds {
    /// Differential drive: a left turn is positive and makes the right track the faster one.
    fn from_speeds(linear: f64, angular: f64, calibration: Calibration) -> TrackSpeeds {
        let swing = angular * calibration.track_width / 2.0;
        TrackSpeeds {
            left: linear - swing,
            right: linear + swing,
        }
    }

    fn fastest(self) -> f64 {
        self.left.abs().max(self.right.abs())
    }

    /// The setpoint in percent of power, and the factor by which both tracks were changed so that the
    /// faster one has at least the least power and at most full power; the curve stays the same as
    /// far as the slower one can run.
    fn setpoint(self, calibration: Calibration) -> (Option<Setpoint>, f64) {
        let fastest = self.fastest() / calibration.full_speed * 100.0;
        if fastest == 0.0 {
            return (Some(Setpoint::STOP), 1.0);
        }
        let factor = fastest.clamp(calibration.least_power, 100.0) / fastest;
        let percent = |speed: f64| speed * factor / calibration.full_speed * 100.0;
        let mut left = percent(self.left);
        let mut right = percent(self.right);
        if left.abs() < right.abs() {
            run_or_stand(&mut left, &mut right, calibration.least_power);
        } else {
            run_or_stand(&mut right, &mut left, calibration.least_power);
        }
        let left = left.clamp(-100.0, 100.0);
        let setpoint = Setpoint::from_percent(left, right.clamp(-100.0, 100.0));
        (setpoint, factor)
    }
}

/// Gives the slower track, both in percent of power, the least power if it has at least half of it,
/// and the faster one as much more, so that the turn stays; else the slower one stands.
fn run_or_stand(slower: &mut f64, faster: &mut f64, least: f64) {
    let lacking = least - slower.abs();
    if lacking > least / 2.0 {
        *slower = 0.0;
    } else if lacking > 0.0 {
        let more = lacking.copysign(*slower);
        *slower += more;
        if *slower * *faster > 0.0 {
            *faster += more;
        }
    }
}

fn move_tracks(call: &mut Call<'_>) -> NativeResult {
    let left = call.args.get(0)?;
    let right = call.args.get(1)?;
    let time = call.args.get(2)?;
    let setpoint = Setpoint::from_percent(left, right);
    start_motion(call, setpoint, time, Duration::ZERO)
}

fn drive(call: &mut Call<'_>) -> NativeResult {
    let linear = call.args.get(0)?;
    let angular = call.args.get(1)?;
    let time = call.args.get(2)?;
    let calibration = call.state.options.calibration;
    let tracks = TrackSpeeds::from_speeds(linear, angular, calibration);
    let least = calibration.full_speed * calibration.least_power / 100.0;
    let setpoint = if tracks.fastest() < least * STANDS {
        Some(Setpoint::STOP)
    } else {
        tracks.setpoint(calibration).0
    };
    start_motion(call, setpoint, time, Duration::ZERO)
}

fn forward(call: &mut Call<'_>) -> NativeResult {
    let calibration = call.state.options.calibration;
    let metres = call.args.get(0)?;
    let usual = calibration.full_speed * USUAL;
    let speed = call.args.get::<Option<f64>>(1)?;
    let speed = speed.unwrap_or(usual).copysign(metres);
    travel(
        call,
        metres,
        TrackSpeeds::from_speeds(speed, 0.0, calibration),
        speed,
    )
}

fn turn(call: &mut Call<'_>) -> NativeResult {
    let calibration = call.state.options.calibration;
    let angle = call.args.get(0)?;
    let usual = calibration.full_speed * USUAL * 2.0 / calibration.track_width;
    let speed = call.args.get::<Option<f64>>(1)?;
    let speed = speed.unwrap_or(usual).copysign(angle);
    travel(
        call,
        angle,
        TrackSpeeds::from_speeds(0.0, speed, calibration),
        speed,
    )
}

/// Drives `tracks` until `way` is covered at `speed`, both in the same unit and of the same sign.
fn travel(call: &mut Call<'_>, way: f64, tracks: TrackSpeeds, speed: f64) -> NativeResult {
    let calibration = call.state.options.calibration;
    let (setpoint, factor) = tracks.setpoint(calibration);
    let seconds = way / (speed * factor);
    if seconds > LONGEST_DRIVE {
        return Err(call.misuse(&format!(
            "that would take {seconds:.0} seconds; the most is {LONGEST_DRIVE}"
        )));
    }
    if seconds <= 0.0 {
        return call.reply((true, MotionEnd::Done.name()));
    }
    let time = Duration::from_secs_f64(seconds);
    let runs_on = Duration::from_secs_f64(tracks.fastest() * factor / ACCELERATION);
    start_motion(call, setpoint, Some(time), runs_on)
}

/// Sets the setpoint of the tracks; waits for the end if there is a time, and until the tracks,
/// which run on for a while, stand.
fn start_motion(
    call: &mut Call<'_>,
    setpoint: Option<Setpoint>,
    time: Option<Duration>,
    runs_on: Duration,
) -> NativeResult {
    let Some(setpoint) = setpoint else {
        return Err(call.misuse("the speeds are not numbers"));
    };
    if !may_move(call) {
        return refused(call, time.is_some());
    }
    let Some(owner) = call.state.owner() else {
        return refused(call, false);
    };
    if time.is_none() && call.state.motion.is_set(owner, setpoint) {
        return call.reply(());
    }
    if time.is_some() {
        call.may_wait()?;
    }
    call.make_room(0)?;
    let now = call.state.now;
    let runs_on = time.map(|_| runs_on);
    let motion = call.state.motion.set(owner, setpoint, runs_on, now);
    call.state.output.send(Intent::Move {
        motion,
        setpoint,
        duration: time,
    });
    match time {
        Some(_) => call.wait(Wait::Motion(motion), None),
        None => call.reply(()),
    }
}

/// Whether the task may move the robot: not if the script is ending or the task was cancelled.
pub(super) fn may_move(call: &mut Call<'_>) -> bool {
    let cancelled = |task: &mut Task| task.cancel != Cancel::No;
    call.state.is_running() && !call.state.tasks.running().is_none_or(cancelled)
}

/// Returns `false, "cancelled"`. A call that would wait raises the cancellation in a cancelled
/// task, as other waits do.
pub(super) fn refused(call: &mut Call<'_>, waits: bool) -> NativeResult {
    if waits && call.state.is_running() {
        call.may_wait()?;
    }
    call.reply((false, MotionEnd::Cancelled.name()))
}

/// `robot.stop()`: always works.
fn stop(call: &mut Call<'_>) -> NativeResult {
    let _ = call.state.motion.release_any();
    call.state.output.send_stop();
    call.reply(())
}

fn pose(call: &mut Call<'_>) -> NativeResult {
    let pose = call.state.odometry.pose();
    let table = call.lua.create_table_with_capacity(0, 5)?;
    table.raw_set("x", pose.x)?;
    table.raw_set("y", pose.y)?;
    table.raw_set("heading", pose.heading)?;
    table.raw_set("error", pose.error)?;
    table.raw_set("heading_error", pose.heading_error)?;
    call.reply(of_row("PoseEstimate", table))
}

fn dock(call: &mut Call<'_>) -> NativeResult {
    let options = call.args.options(0)?;
    let plan = DockPlan {
        timeout: options.get("timeout")?,
        retries: options.get("retries")?,
        charge_timeout: options.get("charge_timeout")?,
    };
    if !may_move(call) {
        return refused(call, true);
    }
    call.may_wait()?;
    let id = call.state.next_call();
    call.send(Intent::Dock { call: id, plan })?;
    call.wait(Wait::Dock(id), None)
}

fn undock(call: &mut Call<'_>) -> NativeResult {
    let timeout = call.args.options(0)?.get("timeout")?;
    if !may_move(call) {
        return refused(call, true);
    }
    call.may_wait()?;
    let id = call.state.next_call();
    call.send(Intent::Undock { call: id, timeout })?;
    call.wait(Wait::Undock(id), None)
}

fn cancel_dock(call: &mut Call<'_>) -> NativeResult {
    call.send(Intent::CancelDock)?;
    call.reply(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CALIBRATION: Calibration = Calibration {
        track_width: 0.2,
        full_speed: 0.5,
        least_power: 20.0,
    };

    fn percent(linear: f64, angular: f64) -> (i8, i8) {
        let (setpoint, _) =
            TrackSpeeds::from_speeds(linear, angular, CALIBRATION).setpoint(CALIBRATION);
        let setpoint = setpoint.unwrap();
        (setpoint.left.get(), setpoint.right.get())
    }

    #[test]
    fn a_left_turn_is_positive_and_makes_the_right_track_faster() {
        assert_eq!(percent(0.25, 0.0), (45, 45));
        assert_eq!(percent(0.0, 1.0), (-18, 18));
        assert_eq!(percent(0.25, 0.5), (36, 54));
    }

    #[test]
    fn too_fast_motions_are_slowed_and_keep_their_curve() {
        assert_eq!(percent(1.0, 0.0), (90, 90));
        assert_eq!(percent(1.0, 5.0), (30, 90));
        assert_eq!(percent(1000.0, -1000.0), (90, 74));
    }

    #[test]
    fn no_track_has_less_than_the_least_power_and_the_turn_keeps_its_side() {
        // The least power is 18: a turn and a line get it, curves keep their turn or their slower
        // track stands.
        assert_eq!(percent(0.0, 0.4), (-18, 18));
        assert_eq!(percent(-0.05, 0.0), (-18, -18));
        assert_eq!(percent(0.12, 0.5), (18, 36));
        assert_eq!(percent(0.12, 0.9), (0, 38));
        assert_eq!(percent(0.1, 1.4), (0, 43));
        assert_eq!(percent(0.1, 1.7), (-18, 49));
        for step in -60i32..=60 {
            let angular = f64::from(step) / 20.0;
            for linear in [-0.3, -0.05, 0.0, 0.02, 0.1, 0.2, 0.49] {
                let (left, right) = percent(linear, angular);
                let told = format!("{linear} {angular}: {left} {right}");
                for track in [left, right] {
                    assert!(track == 0 || (18..=90).contains(&track.abs()), "{told}");
                }
                assert_eq!((right - left).signum(), step.signum() as i8, "{told}");
            }
        }
        assert_eq!(percent(0.0, 0.0), (0, 0));
    }
}
