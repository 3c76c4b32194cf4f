//! The service's log messages and status line.

use jiff::Timestamp;
use tracing::{info, warn};

use crate::agent::PilotClientError;
use crate::clock::{self, Zone};
use crate::pilot::{LinkState, Status};
use crate::robot::channel::Quiet;
use crate::robot::{DockEnd, DockOutcome};
use crate::timetable::Notice;

/// Logs a notice of the timetable. For a start that did not happen, returns the behaviour and the
/// reason.
pub(super) fn log_notice<'a>(notice: &'a Notice, zone: &Zone) -> Option<(&'a str, &'static str)> {
    let time = |at: &Timestamp| clock::describe(&zone.time(*at));
    match notice {
        Notice::Missed {
            run,
            planned,
            count,
        } => {
            let planned = time(planned);
            warn!(
                behaviour = run,
                count,
                "a start was missed: the service did not run, or the clock was not set; the last one \
                 was planned for {planned}"
            );
            Some((run.as_str(), "the service did not run then"))
        }
        Notice::NoRobot { run, planned } => {
            let planned = time(planned);
            warn!(
                behaviour = run,
                "a start was missed: no robot was connected; it was planned for {planned}"
            );
            Some((run.as_str(), "no robot was connected"))
        }
        Notice::Overlap { run, planned } => {
            let planned = time(planned);
            warn!(behaviour = run, "not started at {planned}: it still runs");
            Some((run.as_str(), "it still runs"))
        }
        Notice::ClockSet { seconds } => {
            info!("the clock was set by {seconds} s");
            None
        }
    }
}

pub(super) fn log_quiet_hours(quiet: Quiet) {
    match quiet {
        Quiet::Off => info!("quiet hours are over"),
        Quiet::Scripts => info!("quiet hours: no sounds and no headlight but the alarm's"),
        Quiet::WithAlarm => info!("quiet hours: no sounds, no headlight, no alarm"),
    }
}

/// Logs the result of sending an idle robot to its station. Returns whether it arrived.
pub(super) fn log_homing(ended: &Result<DockOutcome, PilotClientError>) -> bool {
    let why = match ended {
        Ok(DockOutcome {
            end: DockEnd::Done | DockEnd::AlreadyDocked,
            ..
        }) => {
            info!("the idle robot is on its station");
            return true;
        }
        Ok(docked) => docked.end.to_string(),
        Err(why) => why.to_string(),
    };
    warn!("the idle robot is not on its station: {why}");
    false
}

/// Returns the status line for the service manager: the robot, the running behaviours, and the next
/// start.
pub(super) fn status<'a>(
    status: &Status,
    running: impl Iterator<Item = &'a str>,
    next: Option<(Timestamp, &str)>,
    zone: &Zone,
) -> String {
    let robot = match (status.link, status.link.absence()) {
        (LinkState::Connecting, _) => "waiting for the robot".to_owned(),
        (_, Some(words)) => words.to_owned(),
        (_, None) if status.emergency_stop => "stopped by a person".to_owned(),
        (_, None) => status.safety.to_string(),
    };
    let running: Vec<&str> = running.collect();
    let running = if running.is_empty() {
        "no behaviour runs".to_owned()
    } else {
        running.join(", ")
    };
    let next = next.map(|(at, run)| format!("; next {run} {}", clock::describe(&zone.time(at))));
    format!("{robot}; {running}{}", next.unwrap_or_default())
}
