//! The status of a run: one line that is redrawn on a terminal, or a line for each change if the
//! output is a file or a pipe.

use std::convert::Infallible;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;

use super::Console;
use super::table::or_dash;
use crate::clock::every;
use crate::control;
use crate::live::FrameRate;
use crate::pilot::{LinkState, Status};
use crate::robot::Battery;
use crate::sim::{Handle, State};

/// Interval between redraws of the status line.
const STATUS_PERIOD: Duration = Duration::from_millis(250);
/// In a file, interval at which the status is written even if nothing has changed.
const PLAIN_PERIOD: Duration = Duration::from_secs(60);

/// Formats the status, and remembers the last one to detect changes.
pub(super) struct StatusLine {
    behaviours: String,
    sim: Option<Handle>,
    rate: FrameRate,
    last_reported: Option<(Instant, Status)>,
}

impl StatusLine {
    /// Creates the line for behaviours with these names. With a simulator it shows the robot's true
    /// position; before the first connection it shows the number of failed attempts.
    pub(super) fn new(behaviours: String, sim: Option<Handle>) -> StatusLine {
        StatusLine {
            behaviours,
            sim,
            rate: FrameRate::new(Instant::now()),
            last_reported: None,
        }
    }

    fn draw(&mut self, status: &Status) -> String {
        let battery = or_dash(status.battery.map(charge));
        let mut parts = vec![state(status), format!("battery {battery}")];
        if let Some(sim) = &self.sim {
            let state = sim.state();
            let pose = state.pose;
            let degrees = pose.heading.to_degrees().rem_euclid(360.0);
            parts.push(format!("at {:.2} {:.2} m, {degrees:.0}°", pose.x, pose.y));
            parts.extend(lights(&state));
            parts.extend(state.sound.map(|sound| format!("plays {}", sound.name())));
        }
        let rate = self.rate.count(status.frames, Instant::now());
        parts.push(format!("{rate} fps"));
        parts.push(self.behaviours.clone());
        parts.join(" · ")
    }

    /// The line for a file, if the status has changed or the last line is old.
    fn plain_line(&mut self, status: &Status) -> Option<String> {
        let charging = |one: &Status| one.battery.map(|battery| battery.charging);
        let is_news = |(at, last): &(Instant, Status)| {
            last.link != status.link
                || last.safety != status.safety
                || charging(last) != charging(status)
                || last.emergency_stop != status.emergency_stop
                || at.elapsed() >= PLAIN_PERIOD
        };
        if !self.last_reported.as_ref().is_none_or(is_news) {
            return None;
        }
        self.last_reported = Some((Instant::now(), *status));
        Some(self.draw(status))
    }
}

fn state(status: &Status) -> String {
    match (status.link, status.attempts) {
        (LinkState::Connecting, attempts @ 1..) => {
            format!("waiting for the robot, attempts so far: {attempts}")
        }
        _ => control::describe(status),
    }
}

fn lights(state: &State) -> Option<String> {
    let leds = [
        ("flash", state.leds.flash),
        ("left", state.leds.left),
        ("right", state.leds.right),
    ];
    let on: Vec<&str> = leds.iter().filter(|led| led.1).map(|led| led.0).collect();
    (!on.is_empty()).then(|| format!("lights: {}", on.join(" ")))
}

/// The battery's level, and whether it charges.
pub(super) fn charge(battery: Battery) -> String {
    let charging = if battery.charging { ", charging" } else { "" };
    format!("{}{charging}", battery.level())
}

/// Shows the status behind this prefix: on a terminal, or in a file, which the status of a service
/// would flood in weeks.
pub(super) async fn show(
    mut line: StatusLine,
    status: watch::Receiver<Status>,
    console: &Console,
    is_service: bool,
    prefix: impl Fn() -> String,
) -> Infallible {
    let mut ticks = every(STATUS_PERIOD);
    loop {
        ticks.tick().await;
        let newest = *status.borrow();
        if console.has_status_line() {
            console.status(format!("{}{}", prefix(), line.draw(&newest)));
        } else if !is_service && let Some(text) = line.plain_line(&newest) {
            console.status_line_plain(&format!("{}{text}", prefix()));
        }
    }
}
