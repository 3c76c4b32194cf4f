//! A model of tracks that accelerate and brake: the motion of the robot after a command.

use crate::vision::Drive;

/// Acceleration of a track, in metres per second squared. Small geared motors take some tenths of a
/// second to reach full speed; if they take half or twice as long, `robot.pose()` changes little.
const ACCELERATION: f64 = 1.5;
/// While a track changes its speed, the motion is integrated in steps of this length, in seconds.
const STEP: f64 = 0.02;

/// The speeds of the tracks, in metres a second.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Ramp {
    left: f64,
    right: f64,
}

impl Ramp {
    /// Advances the model by at most `seconds` with this command. Returns the mean motion and the
    /// seconds advanced, which are more than zero unless `seconds` is zero.
    pub(super) fn step(&mut self, command: Drive, track_width: f64, seconds: f64) -> (Drive, f64) {
        let apart = command.turn * track_width / 2.0;
        let (left, right) = (command.forward - apart, command.forward + apart);
        let even = self.left == left && self.right == right;
        let time = if even { seconds } else { seconds.min(STEP) };
        let left = change(&mut self.left, left, time);
        let right = change(&mut self.right, right, time);
        let motion = Drive {
            forward: (left + right) / 2.0,
            turn: (right - left) / track_width,
        };
        (motion, time)
    }
}

/// Brings a speed nearer to the wanted one; returns its mean during that time.
fn change(speed: &mut f64, wanted: f64, seconds: f64) -> f64 {
    let before = *speed;
    let needed = (wanted - before).abs() / ACCELERATION;
    if needed > seconds {
        *speed += (wanted - before).signum() * ACCELERATION * seconds;
        return (before + *speed) / 2.0;
    }
    *speed = wanted;
    let part = if seconds > 0.0 { needed / seconds } else { 0.0 };
    wanted + (before - wanted) / 2.0 * part
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: f64 = 0.24;
    const STOP: Drive = Drive {
        forward: 0.0,
        turn: 0.0,
    };

    /// The distance and the turn in so many seconds of a command.
    fn driven(ramp: &mut Ramp, command: Drive, seconds: f64) -> (f64, f64) {
        let (mut left, mut way, mut turn) = (seconds, 0.0, 0.0);
        while left > 0.0 {
            let (motion, time) = ramp.step(command, WIDTH, left);
            way += motion.forward * time;
            turn += motion.turn * time;
            left -= time;
        }
        (way, turn)
    }

    #[test]
    fn distance_lost_while_accelerating_is_regained_while_braking() {
        let mut ramp = Ramp::default();
        let command = Drive {
            forward: 0.3,
            turn: 1.0,
        };
        let (way, turn) = driven(&mut ramp, command, 1.0);
        assert!(way < 0.29 && turn < 0.99, "{way} m, {turn} rad");
        let (more, on) = driven(&mut ramp, STOP, 1.0);
        assert!((way + more - 0.3).abs() < 1e-6);
        assert!((turn + on - 1.0).abs() < 1e-6);
        assert_eq!(driven(&mut ramp, STOP, 1.0), (0.0, 0.0));
    }

    #[test]
    fn between_straight_motions_a_turn_begins_late_and_ends_late() {
        let (mut ramp, straight) = (Ramp::default(), |forward| Drive { forward, turn: 0.0 });
        driven(&mut ramp, straight(0.2), 1.0);
        let turning = Drive {
            forward: 0.0,
            turn: 2.0,
        };
        let (_, turned) = driven(&mut ramp, turning, 1.0);
        let (_, late) = driven(&mut ramp, straight(0.2), 1.0);
        assert!(late > 0.15 && (turned + late - 2.0).abs() < 1e-6, "{late}");
    }
}
