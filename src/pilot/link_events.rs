//! Handles what comes over the line: a login, reports, the loss of the link. A function fails with
//! [`LinkLost`] when it finds that the link is lost.

use bytes::Bytes;
use tokio::time::Instant;
use tracing::{debug, info, warn};

use super::line::{LinkEvent, NewSession};
use super::lost::{LinkEventError, LinkLost};
use super::{FAILED_EVERY, Pilot};
use crate::budget::Repeats;
use crate::link::Received;
use crate::robot::{Event, Frame, PartialFrame, RobotInfo};
use crate::safety::Fact;
use crate::wire::{Accepted, EngineReport, Report};

impl Pilot {
    pub(super) fn handle_event(&mut self, event: LinkEvent) -> Result<(), LinkEventError> {
        self.wake()?;
        match event {
            LinkEvent::Up(session) => self.connected(*session)?,
            LinkEvent::Received(Received::Report(report)) => self.report(report)?,
            LinkEvent::Received(Received::PartialFrame(part)) => self.partial_frame(part),
            LinkEvent::Lost(error) => return Err(LinkLost::from(error).into()),
            LinkEvent::Accepted(socket) => self.guard_login(socket),
            LinkEvent::Ended(delivery) => {
                debug!("at the end of a link: {delivery}");
                self.release_guard();
            }
            LinkEvent::Failed(error) => {
                // If the robot had accepted the login, the last words were sent.
                self.release_guard();
                if self.info.is_none() {
                    return Err(LinkEventError::First(error));
                }
                self.log_failed_attempt(&error.to_string());
            }
        }
        Ok(())
    }

    fn connected(&mut self, session: NewSession) -> Result<(), LinkLost> {
        let NewSession {
            accepted,
            power,
            peer,
            early,
            writer,
        } = session;
        let Accepted {
            uid,
            name,
            firmware,
            docked,
            ..
        } = accepted;
        let address = peer.to_string();
        info!(%uid, %address, %firmware, docked, battery = power.percent, "connected");
        let info = RobotInfo {
            uid,
            name,
            firmware,
            address,
            simulated: self.simulated,
        };
        self.writer = Some(writer);
        self.guard();
        self.lights.forget();
        self.shown.lights = Default::default();
        self.silence.begin(Instant::now());
        self.publish_link_up(&info, docked);
        self.info = Some(info);
        self.failed = Repeats::new(FAILED_EVERY);
        let mut lost = self
            .take(Fact::LinkUp { docked, power })
            .and(self.repeat_halt());
        self.note_level();
        self.publish_battery();
        self.seats.welcome_all(&self.welcome());
        for report in early {
            lost = lost.and(self.report(report));
        }
        lost?;
        self.apply_streams(true)?;
        self.sound_alarm()
    }

    /// The events that tell a behaviour the state of a connected robot.
    pub(super) fn welcome(&self) -> Vec<Event> {
        let (Some(info), Some(battery)) = (&self.info, self.battery()) else {
            return vec![];
        };
        if self.writer.is_none() {
            return vec![];
        }
        let connected = Event::Connected {
            info: info.clone(),
            docked: self.watchdog.docked(),
        };
        vec![Event::Battery(battery), connected]
    }

    fn report(&mut self, report: Report) -> Result<(), LinkLost> {
        self.silence.note_received(Instant::now());
        let lost = self.take(Fact::BytesReceived);
        match report {
            Report::Power(power) => {
                self.silence.level(Instant::now());
                return lost.and(self.take_battery_fact(Fact::Power(power)));
            }
            Report::Engine(report) => return lost.and(self.engine(report)),
            Report::Video(jpeg) => self.frame(jpeg),
            Report::Audio(samples) => self.seats.tell_listeners(&Event::Audio(samples)),
            Report::SoundFinished => self.seats.tell_all(&Event::SoundFinished),
            Report::Unknown(packet) => self.log_unknown_message(packet.kind),
            Report::Accepted(_) | Report::Refused(_) => debug!("unexpected login reply"),
            Report::Config(_) | Report::Networks(_) | Report::Log(_) => {}
        }
        lost
    }

    // Events go to behaviours before the answers that they cause: an answer to a waiting call must
    // not overtake the event that ended the call. Sending an event never blocks, so nothing is
    // delayed.

    /// Takes in a fact that may change what is believed of the battery, and publishes such a
    /// change.
    fn take_battery_fact(&mut self, fact: Fact) -> Result<(), LinkLost> {
        let before = self.watchdog.battery();
        let acts = self.watchdog.take(fact, Instant::now());
        self.note_level();
        if let (Some(before), Some(battery)) = (before, self.battery()) {
            if battery.is_news_after(&before) {
                self.seats.tell_all(&Event::Battery(battery));
                self.publish_battery();
            }
            if battery.charging != before.charging {
                let on = battery.charging;
                self.seats.tell_all(&Event::Charging { on });
            }
        }
        self.perform(acts)
    }

    fn note_level(&mut self) {
        if let Some(battery) = self.watchdog.battery() {
            self.minutes_left.level(battery, Instant::now());
        }
    }

    fn engine(&mut self, report: EngineReport) -> Result<(), LinkLost> {
        let event = match report {
            EngineReport::Docked => Event::Docked,
            EngineReport::Undocked => Event::Undocked,
            EngineReport::Charged => Event::Charged,
            EngineReport::BaseNotFound => Event::BaseNotFound,
            EngineReport::Unknown(code) => Event::Engine { code },
        };
        self.log_engine_report(report);
        self.seats.tell_all(&event);
        self.take_battery_fact(Fact::Engine(report))
    }

    /// Puts a frame into the slot of the newest one without decoding it: its readers validate it.
    fn frame(&mut self, jpeg: Bytes) {
        let (at, mut seq) = (Instant::now(), 0);
        self.status.send_if_modified(|status| {
            seq = status.count_frame();
            false
        });
        self.stopwatch.frame(at);
        self.pictures
            .send_modify(|pictures| pictures.push(Frame { seq, at, jpeg }));
        self.seats.notify_frame();
    }

    fn partial_frame(&mut self, jpeg: Bytes) {
        self.silence.note_received(Instant::now());
        let seq = self.status.borrow().frames + 1;
        self.pictures
            .send_modify(|pictures| pictures.partial = Some(PartialFrame { seq, jpeg }));
        self.seats.notify_frame();
    }

    /// Logs each reason at long intervals: a robot may be out of reach for weeks.
    fn log_failed_attempt(&mut self, error: &str) {
        match self.failed.note(error.to_owned(), Instant::now()) {
            Some(0) => warn!("still not connected: {error}"),
            Some(repeated) => warn!(repeated, "still not connected: {error}"),
            None => debug!("still not connected: {error}"),
        }
    }

    /// Limits the log: a broken or faked robot may repeat a report a thousand times a second.
    fn log_engine_report(&mut self, report: EngineReport) {
        let said = match report {
            EngineReport::Unknown(code) => {
                self.unknown.note(UnknownKind::Engine(code), Instant::now())
            }
            known => self.engine_log.note(known, Instant::now()),
        };
        match said {
            Some(0) => info!("the robot says: {}", describe(report)),
            Some(repeated) => info!(repeated, "the robot says: {}", describe(report)),
            None => {}
        }
    }

    fn log_unknown_message(&mut self, kind: u8) {
        if let Some(repeated) = self
            .unknown
            .note(UnknownKind::Message(kind), Instant::now())
        {
            info!(
                kind,
                repeated, "a message of unknown type or length; logged once per type and minute"
            );
        }
    }
}

/// A kind of unknown value: each is logged once a minute.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum UnknownKind {
    Message(u8),
    Engine(u8),
}

fn describe(report: EngineReport) -> String {
    match report {
        EngineReport::Docked => "on the station".to_owned(),
        EngineReport::Undocked => "off the station".to_owned(),
        EngineReport::Charged => "the battery is full".to_owned(),
        EngineReport::BaseNotFound => "station not found".to_owned(),
        EngineReport::Unknown(code) => format!("ENGINE {code}, an unknown value"),
    }
}
