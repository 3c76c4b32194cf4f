//! Computes the two numbers of the calibration from measurements. Pure.

use std::time::Duration;

use crate::cli::{Exit, Failure};
use crate::robot::Setpoint;
use crate::script::Calibration;

/// Power of the moves, percent: fast enough to measure, slow enough to watch.
pub(super) const POWER: f64 = 60.0;
/// Plausible values for a Spykee, metres and metres per second; others are measuring errors.
const WIDTHS: std::ops::RangeInclusive<f64> = 0.08..=0.8;
const SPEEDS: std::ops::RangeInclusive<f64> = 0.03..=3.0;

/// One step: the setpoint of the tracks and its duration.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plan {
    pub(super) setpoint: Setpoint,
    pub(super) duration: Duration,
}

impl Plan {
    /// Both tracks at this fraction of [`POWER`], -1 to 1.
    pub(super) fn straight(direction: f64, millis: u64) -> Plan {
        Plan::new(direction, direction, millis)
    }

    /// A turn on the spot, to the left if positive.
    pub(super) fn turn(direction: f64, millis: u64) -> Plan {
        Plan::new(-direction, direction, millis)
    }

    fn new(left: f64, right: f64, millis: u64) -> Plan {
        let setpoint = Setpoint::from_percent(left * POWER, right * POWER);
        Plan {
            setpoint: setpoint.unwrap_or(Setpoint::STOP),
            duration: Duration::from_millis(millis),
        }
    }
}

/// One round: the speeds of driving and turning at [`POWER`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    /// Metres per second.
    pub(super) speed: f64,
    /// Radians per second.
    pub(super) turning: f64,
}

impl Measured {
    pub(super) fn calibration(self) -> Result<Calibration, Failure> {
        let full_speed = self.speed / (POWER / 100.0);
        // When turning on the spot, the tracks run in opposite directions at this speed.
        let track_width = 2.0 * self.speed / self.turning;
        if SPEEDS.contains(&full_speed) && WIDTHS.contains(&track_width) {
            return Ok(Calibration {
                full_speed,
                track_width,
            });
        }
        let what = format_args!(
            "implausible result: {full_speed:.2} m/s at full power, {track_width:.2} m between the tracks"
        );
        let help = "measure again: distances in centimetres; a full turn counts as 360 degrees";
        Err(Failure::new(Exit::Failed, what).help(help))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_and_an_angle_give_speed_and_width() {
        // 0.45 m/s and 0.24 m at 60 %: 0.27 m/s, 2.25 rad/s; 3 cm are lost at the start.
        let measured = Measured {
            speed: (0.78 - 0.24) / (3.0 - 1.0),
            turning: 4.5 / 2.0,
        };
        let calibration = measured.calibration().unwrap();
        assert!((calibration.full_speed - 0.45).abs() < 1e-9);
        assert!((calibration.track_width - 0.24).abs() < 1e-9);
    }

    #[test]
    fn implausible_measurements_are_refused() {
        for (speed, turning) in [
            (0.27, 0.0),
            (-0.2, 2.0),
            (0.27, -2.0),
            (f64::NAN, 1.0),
            (9.0, 2.0),
        ] {
            let round = Measured { speed, turning };
            assert!(round.calibration().is_err(), "{speed} {turning}");
        }
    }
}
