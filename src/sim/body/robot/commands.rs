//! How the robot executes each command.

use std::time::Duration;

use bytes::Bytes;

use super::super::chassis::Tracks;
use super::super::firmware::FirmwareBehaviour;
use super::super::log::describe;
use super::super::trace::TraceEventKind;
use super::Robot;
use crate::wire::{Command, Engage, EngineReport, Report, Sound};

/// ENGINE 1 sent to the robot, as one client does (`PROTOCOL.md`, *Not known*).
const ACTIVATE: u8 = 1;
/// The reply to WIRELESS_NETWORKS.
const NETWORKS: &[u8] = b"home:wpa:82;neighbour:wpa:41;SPYKEE0001:none:100";

impl Robot {
    /// Executes a command. Logins have no effect here; the server handles them.
    pub fn execute(&mut self, command: &Command) {
        match command {
            Command::Move { left, right } => self.execute_move(*left, *right),
            Command::Engine(engage) => self.execute_engine(*engage),
            Command::Led { led, on } => {
                self.mark(TraceEventKind::Light { led: *led, on: *on });
                if !self.leds.switch(*led, *on) {
                    self.note(&format!("no such light: {}", led.to_byte()));
                }
            }
            Command::Play(sound) => self.execute_play(*sound),
            Command::StopSound => self.speaker.stop(),
            Command::Volume(percent) => self.speaker.set_volume(*percent),
            Command::Stream { stream, on } => {
                self.video.trigger_frame();
                if !self.streams.switch(*stream, *on) {
                    self.note(&format!("no such stream: {}", stream.to_byte()));
                }
            }
            Command::PowerQuery => self.send_power(),
            Command::ConfigQuery => self.send_config(),
            Command::ConfigSet(text) => {
                let line = self.memory.configure(text);
                self.note(&line);
            }
            Command::File(chunk) => {
                if let Some(line) = self.memory.store(chunk) {
                    self.note(&line);
                }
            }
            Command::NetworksQuery => {
                self.reports
                    .push(Report::Networks(Bytes::from_static(NETWORKS)));
            }
            Command::LogQuery => self.reports.push(Report::Log(self.log.text())),
            Command::Audio(_) | Command::None | Command::Login(_) => {}
            other => self.note(&format!("accepted without effect: {}", describe(other))),
        }
    }

    /// Executes a MOVE. A docked robot is no special case: driving backwards or turning breaks the
    /// contact, driving forwards pushes against the station.
    fn execute_move(&mut self, left: i8, right: i8) {
        let answer = match () {
            () if self.docking.searching() => self.firmware.move_while_searching,
            () if self.docking.leaving() => self.firmware.move_while_undocking,
            () => FirmwareBehaviour::Ends,
        };
        match answer {
            FirmwareBehaviour::Ends => self.docking.stop(),
            FirmwareBehaviour::Ignored => return,
            FirmwareBehaviour::Obeyed => {}
        }
        self.commanded = Tracks::new(left, right);
        self.since_move = Duration::ZERO;
    }

    fn execute_engine(&mut self, engage: Engage) {
        match engage {
            Engage::Dock if self.contacts.touching() => self.report_engine(EngineReport::Docked),
            Engage::Dock => {
                self.mark(TraceEventKind::FindBase);
                self.commanded = Tracks::default();
                self.docking.find_base();
            }
            Engage::CancelDock if self.docking.searching() => {
                self.commanded = Tracks::default();
                self.docking.stop();
            }
            undock if self.contacts.docked() && self.undocks(undock) => {
                self.commanded = Tracks::default();
                self.docking.leave();
            }
            other => self.note(&format!("engine {} has no effect now", other.to_byte())),
        }
    }

    /// Whether this ENGINE value makes a docked robot back out of its station.
    fn undocks(&self, engage: Engage) -> bool {
        let activate = engage == Engage::Unknown(ACTIVATE);
        engage == Engage::Undock || (activate && self.firmware.activate_undocks)
    }

    fn execute_play(&mut self, sound: Sound) {
        self.mark(match sound {
            Sound::Snapshot => TraceEventKind::Photo,
            sound => TraceEventKind::Sound(sound),
        });
        self.speaker.play(sound);
        if self.speaker.playing().is_none() {
            self.note(&format!("no such sound: {}", sound.to_byte()));
        }
    }

    fn send_config(&mut self) {
        let messages = self.memory.settings(self.speaker.volume());
        self.reports.extend(messages.map(Report::Config));
    }
}
