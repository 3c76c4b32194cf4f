//! Executes the watchdog's acts: all commands of one batch in one write, then the rest.

use tokio::time::Instant;
use tracing::warn;

use super::Pilot;
use super::last_words::tell_guardian;
use super::lost::LinkLost;
use crate::robot::Event;
use crate::safety::{Act, Fact};
use crate::wire::Command;

impl Pilot {
    /// Gives a fact to the watchdog and executes its acts. Like all functions here it fails if the
    /// link is lost.
    pub(super) fn take(&mut self, fact: Fact) -> Result<(), LinkLost> {
        let acts = self.watchdog.take(fact, Instant::now());
        self.perform(acts)
    }

    /// Executes acts: first all commands in one write, then the rest.
    pub(super) fn perform(&mut self, acts: Vec<Act>) -> Result<(), LinkLost> {
        let commands = acts.iter().filter_map(Act::command);
        let commands: Vec<Command> = commands
            .filter(|command| self.quiet_hours.allows_alarm(command))
            .collect();
        let mut done = self.send(&commands);
        for act in acts {
            match act {
                Act::Send(_) => {}
                Act::Tell(by, event) => {
                    self.publish_undocking(by, &event);
                    self.seats.tell(by, event);
                }
                Act::Announce(mut event) => {
                    if let Event::BatteryLow(battery) | Event::BatteryOk(battery) = &mut event {
                        battery.minutes_left = self.minutes_left.estimate();
                    }
                    if let Event::Safety { action, reason } = &event {
                        warn!(%action, "watchdog: {reason}");
                    }
                    self.publish_safety(&event);
                    self.seats.tell_all(&event);
                }
                Act::Kill(by, reason) => self.seats.kill(by, reason),
                Act::Reconnect(reason) => done = done.and(Err(LinkLost::because(reason))),
            }
        }
        done
    }

    /// Sends commands without blocking. Without a link they are dropped: the robot's next login
    /// begins with a stop.
    pub(super) fn send(&mut self, commands: &[Command]) -> Result<(), LinkLost> {
        let commands = &*self.replace_while_halted(commands);
        for command in commands {
            if self.simulated && self.writer.is_some() {
                self.lights.log(command);
            }
            self.lights.note(command);
            self.shown.note(command);
        }
        if commands
            .iter()
            .any(|command| matches!(command, Command::Play(_)))
        {
            self.tell_sound();
        }
        if commands.is_empty() {
            return Ok(());
        }
        self.renew_last_words();
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        writer.queue(commands, Instant::now())?;
        // Before the robot receives them: the guardian may have to send the last words instead of
        // this process.
        tell_guardian(&mut self.pulse, writer);
        writer.write_ready()?;
        // Again: a message may be partly written now.
        tell_guardian(&mut self.pulse, writer);
        self.stopwatch.wrote(commands, Instant::now());
        Ok(())
    }
}
