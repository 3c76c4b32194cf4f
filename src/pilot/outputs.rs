//! What goes to the robot: executes the watchdog's acts, all commands of one batch in one write, and
//! decides what is withheld: by a person's STOP, in quiet hours, with a nearly empty battery, and
//! while the alarm sounds. Also keeps the last words: what the writer, the connection and the
//! guardian send to the robot if all else fails.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::time::Instant;
use tracing::warn;

use super::Pilot;
use super::connection::Connection;
use super::core::Heartbeat;
use crate::guardian::Route;
use crate::link::{AcceptedLogin, LinkError, Writer};
use crate::robot::channel::{Quiet, Role};
use crate::robot::{AgentEvent, Event};
use crate::safety::{Act, Fact, Watchdog};
use crate::wire::{Command, Engage, Led, Login, Stream};

/// The commands that begin it: the tracks stop, and a search ends.
const STOP: [Command; 2] = [Command::STOP, Command::Engine(Engage::CancelDock)];
/// The shortest interval between repeated STOPs that are sent.
const AGAIN: Duration = Duration::from_millis(200);

/// What behaviours may still use of the robot while its battery is nearly empty, or the watchdog's
/// alarm sounds. Motion is not affected: the watchdog decides on it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Restrictions {
    /// Everything that the way home does not need is off: see [`Watchdog::shed`].
    pub(super) shed: bool,
    /// The alarm controls sounds, volume and headlight: see [`Watchdog::alarm_sounds`].
    pub(super) alarm: bool,
}

impl Restrictions {
    pub(super) fn demanded_by(watchdog: &Watchdog) -> Restrictions {
        Restrictions {
            shed: watchdog.shed(),
            alarm: watchdog.alarm_sounds(),
        }
    }

    /// Whether a behaviour's command that is not a motion may be sent. A rescue behaviour may need
    /// the headlight to see. A new sound replaces the one that plays, so none is allowed while the
    /// alarm sounds.
    pub(super) fn allows(self, role: Role, command: &Command) -> bool {
        match command {
            Command::Led {
                led: Led::Flash, ..
            } => role == Role::Rescuer || !(self.shed || self.alarm),
            Command::Led { .. } => !self.shed,
            Command::StopSound => !self.alarm,
            Command::Play(_) | Command::Volume(_) | Command::Audio(_) => !(self.shed || self.alarm),
            _ => true,
        }
    }

    pub(super) fn allows_stream(self, role: Role, stream: Stream) -> bool {
        let sees = role == Role::Rescuer && stream == Stream::Video;
        sees || !self.shed
    }
}

/// Which commands are withheld from the robot in quiet hours. Motion is not affected.
impl Quiet {
    /// Whether a behaviour's command may be sent. A rescue behaviour may need the headlight to see
    /// the way home, and a person who sends commands knows what time it is.
    pub(super) fn allows(self, role: Role, command: &Command) -> bool {
        self == Quiet::Off || role != Role::Behaviour || !disturbs(command)
    }

    /// Whether a command of the watchdog, or of the alarm, may be sent.
    pub(super) fn allows_alarm(self, command: &Command) -> bool {
        self != Quiet::WithAlarm || !disturbs(command)
    }

    /// The commands that end the noise when quiet hours begin; `alarm`: the alarm sounds at
    /// present.
    pub(super) fn commands_at_start(self, alarm: bool) -> &'static [Command] {
        const SILENCE: &[Command] = &[
            Command::StopSound,
            Command::Led {
                led: Led::Flash,
                on: false,
            },
        ];
        match self {
            Quiet::Off => &[],
            Quiet::Scripts if alarm => &[],
            Quiet::Scripts | Quiet::WithAlarm => SILENCE,
        }
    }
}

impl Pilot {
    /// Gives a fact to the watchdog and executes its acts. Like all functions here it fails if the
    /// link is lost.
    pub(super) fn handle(&mut self, fact: Fact) -> Result<(), LinkError> {
        let acts = self.watchdog.handle(fact, Instant::now());
        self.perform(acts)
    }

    /// Executes acts: first all commands in one write, then the rest.
    pub(super) fn perform(&mut self, acts: Vec<Act>) -> Result<(), LinkError> {
        let commands = acts.iter().filter_map(Act::command);
        let commands: Vec<Command> = commands
            .filter(|command| self.quiet.allows_alarm(command))
            .collect();
        let mut done = self.send(&commands);
        for act in acts {
            match act {
                Act::Send(_) => {}
                Act::Tell(by, event) => {
                    self.publish_undocking(by, &event);
                    self.sessions.tell(by, event);
                }
                Act::Announce(mut event) => {
                    if let Event::BatteryLow(battery) | Event::BatteryOk(battery) = &mut event {
                        battery.minutes_left = self.minutes_left.estimate();
                    }
                    if let Event::Safety { action, reason } = &event {
                        warn!(%action, "watchdog: {reason}");
                        self.bus.publish(AgentEvent::Safety {
                            action: *action,
                            reason: reason.clone(),
                        });
                    }
                    self.sessions.tell_all(&event);
                }
                Act::Kill(by, reason) => self.sessions.kill(by, reason),
                Act::Reconnect(reason) => done = done.and(Err(LinkError::ClosedHere(reason))),
            }
        }
        done
    }

    /// Sends commands without blocking. Without a link they are dropped: the robot's next login
    /// begins with a stop.
    pub(super) fn send(&mut self, commands: &[Command]) -> Result<(), LinkError> {
        let commands = &*self.replace_while_stopped(commands);
        for command in commands {
            if self.simulated && self.writer.is_some() {
                self.actuators.log(command);
            }
            self.actuators.record(command);
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
        if self.writer.is_some() {
            self.debt.handle(commands, Instant::now());
            self.tell_guardian_of_debt();
        }
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        writer.queue(commands, Instant::now())?;
        // Before the robot receives them: the guardian may have to send the last words instead of
        // this process.
        tell_guardian(&mut self.heartbeat, writer);
        writer.write_ready()?;
        // Again: a message may be partly written now.
        tell_guardian(&mut self.heartbeat, writer);
        self.stopwatch.wrote(commands, Instant::now());
        Ok(())
    }

    /// A person's STOP: while it is on, no command that moves the robot is sent, not even when the
    /// watchdog would send a robot with a low battery home. It stays on until a person releases it,
    /// across lost links: each login repeats it. It also applies to the last words.
    pub(super) fn set_emergency_stop(&mut self, on: bool) -> Result<(), LinkError> {
        let was = std::mem::replace(&mut self.emergency_stop, on);
        let now = Instant::now();
        self.watchdog.apply(Fact::StoppedByPerson(on), now);
        match (was, on) {
            (false, true) => {
                warn!("stopped by a person: nothing moves the robot until a person releases it");
                self.send_emergency_stop()
            }
            (true, true) => {
                let lately = |at: Instant| at.elapsed() < AGAIN;
                if self.emergency_stop_sent.is_some_and(lately) {
                    return Ok(());
                }
                self.send_emergency_stop()
            }
            (true, false) => {
                warn!("released by a person: the robot may move again");
                // The robot's state differs from what the watchdog assumes: the watchdog starts
                // over, with a stop.
                self.handle(Fact::Suspended)
            }
            (false, false) => Ok(()),
        }
    }

    /// Sends it again if it is on: the robot may not have received it over an earlier link.
    pub(super) fn repeat_emergency_stop(&mut self) -> Result<(), LinkError> {
        if self.emergency_stop {
            self.send_emergency_stop()
        } else {
            Ok(())
        }
    }

    fn send_emergency_stop(&mut self) -> Result<(), LinkError> {
        self.emergency_stop_sent = Some(Instant::now());
        self.send(&STOP)?;
        self.debt.ask_at_once(Instant::now());
        self.check_execution()
    }

    pub(super) fn replace_while_stopped(&self, commands: &[Command]) -> Vec<Command> {
        if !self.emergency_stop {
            return commands.to_vec();
        }
        let mut replaced: Vec<Command> = commands.iter().filter_map(while_stopped).collect();
        // A search that ends may leave the tracks on.
        if replaced.last() == Some(&Command::Engine(Engage::CancelDock)) {
            replaced.push(Command::STOP);
        }
        replaced
    }

    /// Switches off what a nearly empty battery must not feed, and the streams on again when it
    /// charges; drops queued speech when the alarm sounds or the battery is nearly empty. What the
    /// watchdog wants was sent before.
    pub(super) fn apply_restrictions(&mut self) -> Result<(), LinkError> {
        let now = Restrictions::demanded_by(&self.watchdog);
        let before = std::mem::replace(&mut self.restrictions, now);
        if before == now {
            return Ok(());
        }
        if let Some(writer) = &mut self.writer
            && (now.shed || now.alarm)
        {
            writer.drop_audio();
        }
        if now.shed && !before.shed {
            let off = self.actuators.off(now.alarm);
            self.send(&off)?;
        }
        self.apply_streams(false)
    }

    /// Stores the current last words with the writer, the connection and the guardian; a released
    /// connection stops connecting.
    pub(super) fn store_last_words(&mut self, connection: &mut Connection) {
        let last_words = self.renew_last_words();
        // Without a link, too: the guardian dials for a debt.
        if self.writer.is_none()
            && let Some(guardian) = self.heartbeat.as_mut().and_then(Heartbeat::guardian)
        {
            guardian.set_last_words(&[], &bytes_of(&last_words));
        }
        connection.set_last_words(last_words);
        connection.set_released(self.released);
        connection.set_hurried(self.is_hurried());
        if let Some(writer) = &self.writer {
            tell_guardian(&mut self.heartbeat, writer);
        }
    }

    /// Returns the current last words and stores them with the writer, if there is one.
    pub(super) fn renew_last_words(&mut self) -> Vec<Command> {
        let last_words = self.replace_while_stopped(&self.watchdog.last_words().commands());
        if let Some(writer) = &mut self.writer {
            writer.set_last_words(last_words.clone());
        }
        last_words
    }

    /// Gives the guardian a link whose login the robot has accepted, and its last words; `None`: that
    /// link has ended.
    pub(super) fn watch_login(&mut self, accepted: Option<AcceptedLogin>) {
        let last_words = bytes_of(&self.renew_last_words());
        let Some(AcceptedLogin {
            socket,
            peer,
            login,
        }) = accepted
        else {
            return self.release_guardian();
        };
        self.set_route(peer, login);
        if let Some(guardian) = self.heartbeat.as_mut().and_then(Heartbeat::guardian) {
            guardian.watch(socket, last_words, true);
        }
    }

    pub(super) fn watch_link(&mut self) {
        let guardian = self.heartbeat.as_mut().and_then(Heartbeat::guardian);
        let socket = self.writer.as_ref().and_then(Writer::socket);
        if let (Some(guardian), Some(socket), Some(writer)) = (guardian, socket, &self.writer) {
            guardian.watch(socket, writer.last_words().1, false);
        }
    }

    /// Tells the guardian how to reach the robot if this program no longer can.
    pub(super) fn set_route(&mut self, address: SocketAddr, login: Login) {
        if let Some(guardian) = self.heartbeat.as_mut().and_then(Heartbeat::guardian) {
            let login = Command::Login(login).to_bytes().to_vec();
            guardian.set_route(Route { address, login });
        }
    }

    /// Tells the guardian whether a stop is owed; only a change is sent.
    pub(super) fn tell_guardian_of_debt(&mut self) {
        if let Some(guardian) = self.heartbeat.as_mut().and_then(Heartbeat::guardian) {
            guardian.set_debt(self.debt.is_owed());
        }
    }

    /// Tells the guardian that the link is closed and its last words were sent.
    pub(super) fn release_guardian(&mut self) {
        if let Some(guardian) = self.heartbeat.as_mut().and_then(Heartbeat::guardian) {
            guardian.release();
        }
    }
}

/// What is sent instead of a command while the STOP is on: a stop for each MOVE, the end of a search
/// for its begin, and nothing for an undocking.
fn while_stopped(command: &Command) -> Option<Command> {
    match command {
        Command::Move { .. } => Some(Command::STOP),
        Command::Engine(Engage::Dock) => Some(Command::Engine(Engage::CancelDock)),
        Command::Engine(Engage::Undock) => None,
        other => Some(other.clone()),
    }
}

fn disturbs(command: &Command) -> bool {
    match command {
        Command::Play(_) | Command::Audio(_) => true,
        Command::Led { led, on } => *led == Led::Flash && *on,
        _ => false,
    }
}

fn bytes_of(commands: &[Command]) -> Vec<u8> {
    commands.iter().flat_map(Command::to_bytes).collect()
}

/// Gives the guardian the data that this writer would send last.
pub(super) fn tell_guardian(heartbeat: &mut Option<Heartbeat>, writer: &Writer) {
    if let Some(guardian) = heartbeat.as_mut().and_then(Heartbeat::guardian) {
        let (partly_written, words) = writer.last_words();
        guardian.set_last_words(partly_written, &words);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::safety::{ALARM, LastWords};
    use crate::wire::Sound;

    /// The robot may not have received the STOP, and a stop of the tracks alone may not end a
    /// search.
    #[test]
    fn last_words_that_would_begin_a_search_end_it() {
        let sent = LastWords::StopAndDock.commands();
        let sent: Vec<Command> = sent.iter().filter_map(while_stopped).collect();
        assert_eq!(sent, STOP);
    }

    const NOISE: [Command; 3] = [
        Command::Play(Sound::Laser),
        Command::Audio(bytes::Bytes::new()),
        Command::Led {
            led: Led::Flash,
            on: true,
        },
    ];

    #[test]
    fn quiet_hours_withhold_sounds_and_headlight_from_scripts_but_no_motion() {
        for quiet in [Quiet::Scripts, Quiet::WithAlarm] {
            let scripts = |command: &Command| quiet.allows(Role::Behaviour, command);
            assert!(!NOISE.iter().any(scripts));
            assert!(NOISE.iter().all(|noise| quiet.allows(Role::Person, noise)));
            for command in [Command::STOP, Command::Engine(Engage::Dock)] {
                assert!(scripts(&command) && quiet.allows_alarm(&command));
            }
        }
        assert!(
            NOISE
                .iter()
                .all(|noise| Quiet::Off.allows(Role::Behaviour, noise))
        );
    }

    #[test]
    fn the_alarm_sounds_at_night_only_if_the_config_says_so() {
        let play = |command: &&Command| matches!(command, Command::Play(_));
        let sound = ALARM.iter().find(play).unwrap();
        assert!(Quiet::Scripts.allows_alarm(sound));
        assert!(!Quiet::WithAlarm.allows_alarm(sound));
    }

    const EMPTY: Restrictions = Restrictions {
        shed: true,
        alarm: false,
    };
    const ALARMING: Restrictions = Restrictions {
        shed: false,
        alarm: true,
    };

    fn led(led: Led) -> Command {
        Command::Led { led, on: true }
    }

    fn sounds() -> [Command; 3] {
        [
            Command::Play(Sound::Laser),
            Command::Volume(0),
            Command::Audio(vec![0; 4].into()),
        ]
    }

    #[test]
    fn without_restrictions_everything_is_allowed() {
        let usual = Restrictions::default();
        let lights = [led(Led::Flash), led(Led::Left), Command::StopSound];
        for command in sounds().iter().chain(&lights) {
            assert!(usual.allows(Role::Behaviour, command), "{command:?}");
        }
        assert!(usual.allows_stream(Role::Behaviour, Stream::AudioIn));
    }

    #[test]
    fn no_role_can_silence_the_alarm() {
        for role in [Role::Behaviour, Role::Rescuer] {
            for command in sounds().iter().chain(&[Command::StopSound]) {
                assert!(!ALARMING.allows(role, command), "{command:?}");
            }
            assert!(ALARMING.allows(role, &led(Led::Left)));
            assert!(ALARMING.allows_stream(role, Stream::AudioIn));
        }
        assert!(!ALARMING.allows(Role::Behaviour, &led(Led::Flash)));
    }

    #[test]
    fn with_a_nearly_empty_battery_lights_and_sounds_are_refused() {
        for role in [Role::Behaviour, Role::Rescuer] {
            for command in sounds().iter().chain(&[led(Led::Left), led(Led::Right)]) {
                assert!(!EMPTY.allows(role, command), "{command:?}");
            }
            assert!(EMPTY.allows(role, &Command::StopSound));
            assert!(!EMPTY.allows_stream(role, Stream::AudioIn));
            assert!(!EMPTY.allows_stream(role, Stream::AudioOut));
        }
    }

    #[test]
    fn only_the_rescuer_keeps_the_camera() {
        for restrictions in [EMPTY, ALARMING] {
            assert!(restrictions.allows_stream(Role::Rescuer, Stream::Video));
            assert!(restrictions.allows(Role::Rescuer, &led(Led::Flash)));
        }
        assert!(!EMPTY.allows_stream(Role::Behaviour, Stream::Video));
        assert!(!EMPTY.allows(Role::Behaviour, &led(Led::Flash)));
    }
}
