//! The last setpoint sent to the robot, and when to send the next one: a stop at once, any other
//! setpoint at most [`Tracks::PER_SECOND`] times a second, and every [`Tracks::RESEND`] while the
//! tracks move.

use std::time::Duration;

use tokio::time::Instant;

use crate::robot::Setpoint;

/// Decides when the wanted setpoint is sent.
#[derive(Debug, Clone)]
pub struct Tracks {
    wanted: Setpoint,
    last_sent: Setpoint,
    sent_at: Instant,
    /// The earliest time for the next setpoint that is not a stop.
    next_free: Instant,
    moving_since: Option<Instant>,
    resend: Duration,
}

impl Tracks {
    /// How often a moving setpoint is repeated (5 Hz), for a firmware that may forget it; less
    /// often if the robot executes so slowly that repeats would fill its queue.
    pub const RESEND: Duration = Duration::from_millis(200);
    /// The most MOVE messages in a second.
    pub const PER_SECOND: u32 = 50;
    const SPACING: Duration = Duration::from_millis(1000 / Tracks::PER_SECOND as u64);

    pub fn new(now: Instant) -> Tracks {
        let stop = Setpoint::STOP;
        Tracks {
            wanted: stop,
            last_sent: stop,
            sent_at: now,
            next_free: now,
            moving_since: None,
            resend: Tracks::RESEND,
        }
    }

    /// Sets the time that the robot takes to execute one message.
    pub fn set_pace(&mut self, period: Duration) {
        self.resend = Tracks::RESEND.max(period * 5 / 2);
    }

    /// Sets the wanted setpoint; the next [`Tracks::poll`] sends it.
    pub fn want(&mut self, setpoint: Setpoint) {
        self.wanted = setpoint;
    }

    /// Notes that the robot was stopped by other means, or that a new login has stopped it.
    pub fn note_stop(&mut self, now: Instant) {
        self.wanted = Setpoint::STOP;
        self.record(Setpoint::STOP, now);
    }

    pub fn poll(&mut self, now: Instant) -> Option<Setpoint> {
        if self.next_deadline().is_none_or(|due| due > now) {
            return None;
        }
        self.record(self.wanted, now);
        Some(self.wanted)
    }

    /// When [`Tracks::poll`] has something to send. A time in the past means at once.
    pub fn next_deadline(&self) -> Option<Instant> {
        match (self.wanted == self.last_sent, self.wanted.is_stop()) {
            (true, true) => None,
            (true, false) => Some(self.sent_at + self.resend),
            (false, true) => Some(self.sent_at),
            (false, false) => Some(self.next_free),
        }
    }

    pub fn last_sent(&self) -> Setpoint {
        self.last_sent
    }

    pub fn sent_at(&self) -> Instant {
        self.sent_at
    }

    /// Since when the setpoints sent have moved the robot without a stop; `None` at rest.
    pub fn moving_since(&self) -> Option<Instant> {
        self.moving_since
    }

    fn record(&mut self, setpoint: Setpoint, now: Instant) {
        (self.last_sent, self.sent_at) = (setpoint, now);
        self.next_free = self.next_free.max(now) + Tracks::SPACING;
        if setpoint.is_stop() {
            self.moving_since = None
        } else {
            self.moving_since = self.moving_since.or(Some(now))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: Duration = Duration::from_millis(1);

    fn at(percent: f64) -> Setpoint {
        Setpoint::from_percent(percent, percent).unwrap()
    }

    #[test]
    fn a_setpoint_goes_out_once_and_is_repeated_at_5_hz_while_moving() {
        let now = Instant::now();
        let mut tracks = Tracks::new(now);
        tracks.want(at(50.0));
        assert_eq!(tracks.poll(now), Some(at(50.0)));
        assert_eq!(tracks.poll(now + 199 * MS), None);
        assert_eq!(tracks.poll(now + 200 * MS), Some(at(50.0)));
        tracks.want(Setpoint::STOP);
        assert_eq!(tracks.poll(now + 201 * MS), Some(Setpoint::STOP));
        assert_eq!(tracks.next_deadline(), None);
    }

    #[test]
    fn a_stop_never_waits() {
        let now = Instant::now();
        let mut tracks = Tracks::new(now);
        tracks.want(at(50.0));
        tracks.poll(now);
        tracks.want(Setpoint::STOP);
        assert_eq!(tracks.poll(now), Some(Setpoint::STOP));
    }

    #[test]
    fn standing_still_sends_nothing() {
        let now = Instant::now();
        let mut tracks = Tracks::new(now);
        tracks.want(Setpoint::STOP);
        assert_eq!(tracks.poll(now + 1000 * MS), None);
    }

    proptest! {
            #[test]
            fn at_most_fifty_a_second_and_the_newest_wins(
                wanted in prop::collection::vec((0u32..30, -2i32..3), 1..400),
            ) {
                let start = Instant::now();
                let mut tracks = Tracks::new(start);
                let mut now = start;
    let mut sent = Vec::new();
                for (pause, power) in wanted {
                    now += pause * MS;
                    tracks.want(at(f64::from(power) * 40.0));
                    sent.extend(tracks.poll(now).map(|_| now));
                }
                for window in sent.windows(Tracks::PER_SECOND as usize + 2) {
                    let span = *window.last().unwrap() - window[0];
                    prop_assert!(span >= Duration::from_secs(1), "{span:?}");
                }
                tracks.want(at(100.0));
                let due = tracks.next_deadline().unwrap().max(now);
                prop_assert_eq!(tracks.poll(due), Some(at(100.0)));
            }
        }
}
