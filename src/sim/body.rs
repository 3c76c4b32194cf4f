//! The simulated robot: takes commands and time steps, and returns reports. Handles no sockets, no
//! clock and no logins; `server` decides which client controls it.

mod battery;
pub(crate) mod chassis;
mod docking;
pub(crate) mod firmware;
mod memory;
mod microphone;
mod speaker;
pub(crate) mod trace;

use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use parking_lot::Mutex;
use wire::{Command, Engage, EngineReport, Led, Power, Report, Sound, Stream};

use self::battery::{Battery, PowerReports};
use self::chassis::{Chassis, TrackSlip, Tracks};
use self::docking::{Contacts, Docking, DockingInputs, DockingStep};
use self::firmware::{Firmware, FirmwareBehaviour};
use self::memory::{Memory, RobotLog};
use self::microphone::Microphone;
use self::speaker::Speaker;
use self::trace::{Trace, TraceEventKind};
use crate::camera::{Shot, Video};
use crate::faults::FaultKind;
use crate::geometry::{Point, Pose, RADIUS};
use crate::world::World;
use crate::world::dynamics::Environment;

/// ENGINE 1 sent to the robot, as one client does (`PROTOCOL.md`, *Not known*).
const ACTIVATE: u8 = 1;
/// The reply to WIRELESS_NETWORKS.
const NETWORKS: &[u8] = b"home:wpa:82;neighbour:wpa:41;SPYKEE0001:none:100";

/// A simulated robot without a network: commands go in, reports come out, and the caller advances
/// its time. [`Server`](crate::Server) connects one to clients.
pub struct Robot {
    firmware: Firmware,
    time: Duration,
    environment: Environment,
    // Driving.
    commanded: Tracks<i8>,
    since_move: Duration,
    docking: Docking,
    track_slip: TrackSlip,
    chassis: Chassis,
    // The station and power.
    contacts: Contacts,
    battery: Battery,
    power: PowerReports,
    // Lights, sounds and streams.
    leds: Leds,
    speaker: Speaker,
    streams: Streams,
    microphone: Microphone,
    video: Video,
    // Settings, log and output.
    memory: Memory,
    log: RobotLog,
    trace: Arc<Mutex<Trace>>,
    reports: Vec<Report>,
}

impl Robot {
    /// Creates a robot at the world's start pose. `seed` determines the noise of camera and
    /// microphone, and the slip of the tracks.
    pub fn new(world: World, firmware: Firmware, seed: u64) -> Robot {
        let pose = world.start_pose();
        let touching = world.station.touched(pose, true);
        let mut battery = Battery::new(world.battery);
        battery.set_charging(touching);
        Robot {
            time: Duration::ZERO,
            commanded: Tracks::default(),
            since_move: Duration::ZERO,
            docking: Docking::new(firmware.search_limit),
            track_slip: TrackSlip::new(world.tracks, seed),
            chassis: Chassis::new(pose),
            contacts: Contacts::new(
                world.station.docking,
                touching,
                firmware.charger_hours,
                seed,
            ),
            battery,
            power: PowerReports::new(firmware.power_late, firmware.power_while_charging, seed),
            leds: Leds::default(),
            speaker: Speaker::new(firmware.music),
            streams: Streams::default(),
            microphone: Microphone::new(seed, &world.sounds),
            video: Video::new(&world, seed),
            memory: Memory::new(&firmware.version),
            log: RobotLog::default(),
            trace: Arc::new(Mutex::new(Trace::from(pose))),
            reports: Vec::new(),
            environment: Environment::new(world),
            firmware,
        }
    }

    /// Returns the reports since the last call, oldest first.
    pub fn take_reports(&mut self) -> Vec<Report> {
        std::mem::take(&mut self.reports)
    }

    pub(crate) fn trace_cell(&self) -> Arc<Mutex<Trace>> {
        self.trace.clone()
    }

    /// Returns a copy of the trace so far.
    pub fn trace(&self) -> Trace {
        self.trace.lock().clone()
    }

    /// Returns the world that it is in.
    pub fn world(&self) -> &World {
        &self.environment.world
    }

    /// Puts a ball at a place, at rest; `index` is its index in the world's list.
    pub fn put_ball(&mut self, index: usize, place: Point) {
        self.environment.put_ball(index, place);
    }

    /// Returns what the Wi-Fi does where the robot is, as a fault of the network.
    pub(crate) fn radio_fault(&self) -> Option<FaultKind> {
        let place = self.chassis.pose.point();
        self.environment.world.radio_fault(place)
    }

    /// Whether the robot is on its station; AUTH_REPLY reports this too.
    pub fn docked(&self) -> bool {
        self.contacts.docked
    }

    /// Starts the session of a user: all streams are off, and POWER follows.
    pub fn begin_session(&mut self) {
        self.streams = Streams::default();
        self.microphone.clear();
        self.power.begin_session(self.firmware.power_after_login);
        self.note("user connected");
        self.report_power();
    }

    /// Ends the session of a user. The tracks keep running unless the firmware stops them.
    pub fn end_session(&mut self) {
        self.power.end_session();
        self.streams = Streams::default();
        if self.firmware.stops_on_disconnect {
            self.commanded = Tracks::default();
        }
        self.note("user disconnected");
    }

    /// Reboots in place: resets all commanded state and the log, and keeps the battery's level.
    pub fn reboot(&mut self) {
        self.commanded = Tracks::default();
        self.docking.stop();
        self.chassis.set_target(Tracks::default());
        self.speaker = Speaker::new(self.firmware.music);
        self.leds = Leds::default();
        self.streams = Streams::default();
        self.log.clear();
        self.note("started");
    }

    /// Advances by `dt`, at most a few hundredths of a second.
    pub fn step(&mut self, dt: Duration) {
        self.time += dt;
        self.drive(dt);
        self.contacts.step(dt);
        self.update_contacts();
        let places = self.environment.places();
        let balls = self.environment.world.balls.len();
        self.trace
            .lock()
            .add_sample(self.time, self.chassis.pose, places, balls);
        self.battery.step(dt, self.chassis.effort());
        if self.battery.take_full() {
            self.report_engine(EngineReport::Charged);
        }
        if self.speaker.step(dt) == Some(Sound::Music) {
            self.reports.push(Report::SoundFinished);
        }
        self.step_microphone(dt);
        self.step_camera(dt);
        self.power.step(dt);
        self.report_power();
    }

    /// Returns the current state; the server adds the connected user and the queued commands.
    pub fn state(&self) -> State {
        State {
            time: self.time,
            pose: self.chassis.pose,
            battery: self.battery.percent,
            power: self.battery.power(),
            charging: self.battery.charging,
            docked: self.contacts.docked,
            searching: self.docking.searching(),
            leaving: self.docking.leaving(),
            commanded: self.commanded,
            speeds: self.chassis.speeds,
            blocked: self.chassis.blocked,
            collisions: self.chassis.collisions,
            distance: self.trace.lock().distance(),
            leds: self.leds,
            sound: self.speaker.playing(),
            volume: self.speaker.volume,
            streams: self.streams,
            queued: 0,
            user: None,
            frames: self.video.frames,
            dropped: 0,
        }
    }

    /// Sets the battery's level, percent.
    pub fn set_battery(&mut self, percent: f64) {
        self.battery.set_percent(percent);
        self.report_power();
    }

    /// Repairs or breaks the charger; with a broken one the robot docks but does not charge.
    pub fn set_charger_works(&mut self, works: bool) {
        self.contacts.charger_works = works;
        self.update_contacts();
        self.report_power();
    }

    /// Moves the robot to a pose. Ignores a pose that is not finite.
    pub fn place(&mut self, pose: Pose) {
        if !(pose.x.is_finite() && pose.y.is_finite() && pose.heading.is_finite()) {
            return;
        }
        self.chassis.pose = pose;
        self.update_contacts();
        self.report_power();
    }

    /// Multiplies all light of the world by `gain`.
    pub fn set_light(&mut self, gain: f64) {
        if (0.0..=100.0).contains(&gain) {
            self.video.camera.set_light(gain as f32);
        }
    }

    /// Plays a tone of this level, dBFS, at the microphone for `time`.
    pub fn disturb(&mut self, dbfs: f64, time: Duration) {
        if dbfs.is_finite() {
            self.microphone.disturb(dbfs.min(0.0), self.time + time);
        }
    }

    /// Switches the beacon; while it is off, the robot cannot find the station.
    pub fn set_beacon(&mut self, on: bool) {
        self.contacts.beacon = on;
    }

    fn drive(&mut self, dt: Duration) {
        self.since_move += dt;
        if self
            .firmware
            .stops_without_repeat
            .is_some_and(|limit| self.since_move > limit)
        {
            self.commanded = Tracks::default();
        }
        let inputs = DockingInputs {
            pose: self.chassis.pose,
            station: &self.environment.world.station,
            obstacles: &self.environment.obstacles,
            beacon: self.contacts.hears_beacon(),
            missed: self.contacts.missed,
        };
        let world = &self.environment.world;
        let commanded = self.commanded.speeds(world.tracks.dead_zone);
        let response = world.track_response(self.battery.percent, self.chassis.pose.point());
        let wanted = match self.docking.step(dt, inputs) {
            DockingStep::Free => commanded,
            DockingStep::Drive(speeds) if self.commanded == Tracks::default() => speeds,
            DockingStep::Drive(_) => commanded,
            DockingStep::Left => Tracks::default(),
            DockingStep::NotFound => {
                self.report_engine(EngineReport::BaseNotFound);
                Tracks::default()
            }
        };
        self.chassis.set_target(if self.battery.empty() {
            Tracks::default()
        } else {
            self.track_slip.step(wanted.scaled(response), dt)
        });
        self.step_motion(dt);
    }

    fn step_motion(&mut self, dt: Duration) {
        let speed = self.chassis.forward_speed();
        self.environment
            .step(dt.as_secs_f64(), self.chassis.pose, speed);
        let before = self.chassis.collisions;
        let environment = &self.environment;
        self.chassis
            .step(dt, &environment.obstacles, &environment.bumps);
        if self.chassis.collisions != before {
            let reach = if speed < 0.0 { -RADIUS } else { RADIUS };
            let pose = self.chassis.pose;
            let bumper = pose.point().ahead(pose.heading, reach);
            let name = self.environment.name_at(bumper);
            self.note(&format!("ran into: {name}"));
            self.mark(TraceEventKind::Collision(name));
        }
    }

    fn update_contacts(&mut self) {
        let station = &self.environment.world.station;
        let entering = self.docking.searching();
        self.contacts.update(station, self.chassis.pose, entering);
        self.battery.set_charging(self.contacts.charging());
        if self.contacts.touching && self.docking.searching() {
            self.docking.stop();
            self.chassis.set_target(Tracks::default());
        }
        if let Some(docked) = self.contacts.take_change(&self.docking) {
            self.report_engine(if docked {
                EngineReport::Docked
            } else {
                EngineReport::Undocked
            });
        }
    }

    fn step_microphone(&mut self, dt: Duration) {
        if !self.streams.audio_in {
            // What it has not sent is not sent later: a noise would be heard that is over.
            self.microphone.clear();
            return;
        }
        let here = self.chassis.pose.point();
        self.microphone
            .update_sources(self.time, here, &self.environment.obstacles);
        let chunk = self
            .microphone
            .record(dt, self.chassis.effort(), &mut self.speaker);
        self.reports.extend(chunk.map(Report::Audio));
    }

    fn step_camera(&mut self, dt: Duration) {
        if !self.streams.video {
            self.video.stop();
            return;
        }
        let shot = Shot {
            pose: self.chassis.pose,
            flash: self.leds.flash,
            turning: self.chassis.turning_speed(),
            time: self.time,
        };
        let environment = &self.environment;
        self.video.step(dt, |camera| {
            camera.move_rounds(environment.places());
            shot
        });
        while let Some(jpeg) = self.video.take(self.time) {
            self.reports.push(Report::Video(jpeg));
        }
    }

    fn report_power(&mut self) {
        let power = self.power.level(self.battery.power());
        if self.power.due(power) {
            self.send_power();
        }
    }

    fn send_power(&mut self) {
        let power = self.power.level(self.battery.power());
        let said = self.power.send(power, self.firmware.power_period);
        self.reports.push(Report::Power(said));
    }

    fn report_engine(&mut self, report: EngineReport) {
        self.note(&format!("engine reports {report:?}"));
        match report {
            EngineReport::Docked => self.mark(TraceEventKind::Docked),
            EngineReport::Undocked => self.mark(TraceEventKind::Undocked),
            EngineReport::BaseNotFound => self.mark(TraceEventKind::BaseNotFound),
            _ => {}
        }
        self.reports.push(Report::Engine(report));
    }

    /// Adds an event to the trace, for the map of the run.
    pub fn mark(&self, kind: TraceEventKind) {
        self.trace.lock().add_event(kind);
    }

    fn note(&mut self, line: &str) {
        self.log.write(self.time, line);
    }

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
            Command::PowerQuery if self.firmware.answers_power_query => self.send_power(),
            Command::PowerQuery => {}
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
                let networks = Bytes::from_static(NETWORKS);
                self.reports.push(Report::Networks(networks));
            }
            Command::LogQuery => self.reports.push(Report::Log(self.log.text())),
            Command::Audio(_) | Command::None | Command::Login(_) => {}
            other => self.note(&format!("accepted without effect: {other:?}")),
        }
    }

    /// Executes a MOVE. A docked robot is no special case: driving backwards or turning breaks the
    /// contact, driving forwards pushes against the station.
    fn execute_move(&mut self, left: i8, right: i8) {
        let answer = if self.docking.searching() {
            self.firmware.move_while_searching
        } else if self.docking.leaving() {
            self.firmware.move_while_undocking
        } else {
            FirmwareBehaviour::Ends
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
            Engage::Dock if self.contacts.touching => self.report_engine(EngineReport::Docked),
            Engage::Dock => {
                self.mark(TraceEventKind::FindBase);
                self.commanded = Tracks::default();
                self.docking.find_base();
            }
            Engage::CancelDock if self.docking.searching() => {
                self.commanded = Tracks::default();
                self.docking.stop();
            }
            undock if self.contacts.docked && self.undocks(undock) => {
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
        let messages = self.memory.settings(self.speaker.volume);
        self.reports.extend(messages.map(Report::Config));
    }
}

/// Which lights are on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Leds {
    /// The headlight in the centre.
    pub flash: bool,
    /// The light on the left.
    pub left: bool,
    /// The light on the right.
    pub right: bool,
}

impl Leds {
    /// Switches a light; false if there is no such light.
    pub(crate) fn switch(&mut self, led: Led, on: bool) -> bool {
        match led {
            Led::Flash => self.flash = on,
            Led::Left => self.left = on,
            Led::Right => self.right = on,
            Led::Unknown(_) => return false,
        }
        true
    }
}

/// Which streams are on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Streams {
    /// Frames of the camera.
    pub video: bool,
    /// Samples of the robot's microphone.
    pub audio_in: bool,
    /// Samples for its speaker.
    pub audio_out: bool,
}

impl Streams {
    /// Switches a stream; false if there is no such stream.
    pub(crate) fn switch(&mut self, stream: Stream, on: bool) -> bool {
        match stream {
            Stream::Video => self.video = on,
            Stream::AudioIn => self.audio_in = on,
            Stream::AudioOut => self.audio_out = on,
            Stream::Unknown(_) => return false,
        }
        true
    }
}

/// The robot's state, as shown by handles and status lines.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Simulated time since the start.
    pub time: Duration,
    /// The place of its centre, and its heading.
    pub pose: Pose,
    /// The battery's level, 0..=100, unrounded.
    pub battery: f64,
    /// What an exact POWER would report now.
    pub power: Power,
    /// Current flows into the battery.
    pub charging: bool,
    /// The robot is on the station; while it backs out, true until it has left.
    pub docked: bool,
    /// The robot is driving to the station or searching for it.
    pub searching: bool,
    /// The robot is driving off its station.
    pub leaving: bool,
    /// The last MOVE that was not ignored, as received; 0 if since then the firmware stopped the
    /// tracks, or a manoeuvre was started or cancelled.
    pub commanded: Tracks<i8>,
    /// The actual speeds of the tracks, metres per second.
    pub speeds: Tracks<f64>,
    /// Something stands in its way, against which the tracks push.
    pub blocked: bool,
    /// How often it ran into something.
    pub collisions: u64,
    /// Metres driven.
    pub distance: f64,
    /// Its lights.
    pub leds: Leds,
    /// The sound that is playing.
    pub sound: Option<Sound>,
    /// The volume, 0..=100 percent.
    pub volume: u8,
    /// The user's streams.
    pub streams: Streams,
    /// Commands that were received and wait to be executed.
    pub queued: usize,
    /// The name of the client that may command the robot.
    pub user: Option<String>,
    /// Frames rendered so far.
    pub frames: u64,
    /// Frames and audio chunks dropped so far because the user read too slowly.
    pub dropped: u64,
}

impl State {
    /// Whether a track moves.
    pub fn moving(&self) -> bool {
        self.speeds.left != 0.0 || self.speeds.right != 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_microphone_that_comes_back_does_not_send_what_was_heard_before() {
        let world = World::builtin("yard").unwrap();
        let mut robot = Robot::new(world, Firmware::default(), 1);
        let listen = |on| Command::Stream {
            stream: Stream::AudioIn,
            on,
        };
        let tick = Duration::from_millis(20);
        robot.execute(&listen(true));
        for _ in 0..50 {
            robot.step(tick);
        }
        // A noise of which a part is not sent yet.
        robot.disturb(-3.0, Duration::from_millis(400));
        for _ in 0..8 {
            robot.step(tick);
        }
        robot.execute(&listen(false));
        for _ in 0..500 {
            robot.step(tick);
        }
        robot.take_reports();
        robot.execute(&listen(true));
        for _ in 0..100 {
            robot.step(tick);
        }
        let loudest = robot
            .take_reports()
            .into_iter()
            .filter_map(|report| match report {
                Report::Audio(samples) => Some(samples),
                _ => None,
            });
        let loudest = loudest.flat_map(|samples| {
            let samples = samples.chunks_exact(2);
            let samples = samples.map(|two| i16::from_le_bytes([two[0], two[1]]).unsigned_abs());
            samples.max()
        });
        let loudest = loudest.max().unwrap();
        assert!(loudest < 500, "{loudest}");
    }
}
