//! From what was measured to the two numbers. Pure.

use std::time::Duration;

use crate::cli::{Exit, Failure};
use crate::robot::Setpoint;
use crate::script::Calibration;

/// The part of full power that is driven with, percent: fast enough to measure, slow enough to
/// watch.
pub(super) const POWER: f64 = 60.0;
/// What can be a Spykee, metres and metres a second; all else is a slip of the tape.
const WIDTHS: std::ops::RangeInclusive<f64> = 0.08..=0.8;
const SPEEDS: std::ops::RangeInclusive<f64> = 0.03..=3.0;

/// One step: what the tracks do, and how long.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plan {
    pub(super) setpoint: Setpoint,
    pub(super) duration: Duration,
}

impl Plan {
    /// Both tracks at this part of [`POWER`], -1 to 1.
    pub(super) fn straight(direction: f64, millis: u64) -> Plan {
        Plan::of(direction, direction, millis)
    }

    /// On the spot, to the left if positive.
    pub(super) fn turn(direction: f64, millis: u64) -> Plan {
        Plan::of(-direction, direction, millis)
    }

    fn of(left: f64, right: f64, millis: u64) -> Plan {
        let setpoint = Setpoint::from_percent(left * POWER, right * POWER);
        Plan {
            setpoint: setpoint.unwrap_or(Setpoint::STOP),
            duration: Duration::from_millis(millis),
        }
    }
}

/// One round: how fast it drove and turned at [`POWER`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    /// Metres a second.
    pub(super) speed: f64,
    /// Radians a second.
    pub(super) turning: f64,
}

impl Measured {
    /// From distances, metres, after two times, seconds, and an angle, radians. The difference of
    /// two moves leaves out how the robot starts and stops.
    pub(super) fn from_tape(
        (short, long): ((f64, f64), (f64, f64)),
        (angle, seconds): (f64, f64),
    ) -> Measured {
        let speed = (long.0 - short.0) / (long.1 - short.1);
        let turning = angle / seconds;
        Measured { speed, turning }
    }

    /// The calibration that the average of all rounds means.
    ///
    /// # Errors
    /// Numbers that no robot has.
    pub(super) fn average(rounds: &[Measured]) -> Result<Calibration, Failure> {
        let count = rounds.len() as f64;
        let speed = rounds.iter().map(|round| round.speed).sum::<f64>() / count;
        let turning = rounds.iter().map(|round| round.turning).sum::<f64>() / count;
        let calibration = Calibration {
            full_speed: speed / (POWER / 100.0),
            // On the spot the tracks run against each other at this speed.
            track_width: 2.0 * speed / turning,
        };
        let Calibration {
            full_speed,
            track_width,
        } = calibration;
        if SPEEDS.contains(&full_speed) && WIDTHS.contains(&track_width) {
            return Ok(calibration);
        }
        let what = format_args!(
            "that cannot be: {full_speed:.2} m/s at full power, {track_width:.2} m between the tracks"
        );
        let help = "measure again: centimetres ahead, degrees with full turns counted as 360";
        Err(Failure::new(Exit::Script, what).help(help))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_and_an_angle_give_speed_and_width() {
        // 0.45 m/s and 0.24 m at 60 %: 0.27 m/s, 2.25 rad/s; 3 cm are lost at the start.
        let measured = Measured::from_tape(((0.24, 1.0), (0.78, 3.0)), (4.5, 2.0));
        let calibration = Measured::average(&[measured]).unwrap();
        assert!((calibration.full_speed - 0.45).abs() < 1e-9);
        assert!((calibration.track_width - 0.24).abs() < 1e-9);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        for (speed, turning) in [
            (0.27, 0.0),
            (-0.2, 2.0),
            (0.27, -2.0),
            (f64::NAN, 1.0),
            (9.0, 2.0),
        ] {
            let round = Measured { speed, turning };
            assert!(Measured::average(&[round]).is_err(), "{speed} {turning}");
        }
    }
}
