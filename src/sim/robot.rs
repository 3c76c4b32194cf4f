//! The simulated robot: commands and time steps go in, reports come out. Knows no socket, no clock
//! and no login; who may talk to it is decided in `server`.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::Bytes;

use crate::wire::{Command, Engage, EngineNews, Power, Report, Sound};

use super::battery::Battery;
use super::body::{Body, Tracks};
use super::camera::Camera;
use super::docking::{Docking, Order, Senses};
use super::firmware::Firmware;
use super::geometry::Pose;
use super::microphone::Microphone;
use super::obstacles::Obstacles;
use super::speaker::Speaker;
use super::state::{Leds, State, Streams};
use super::world::World;

/// Lines that the robot's own log keeps.
const LOG_LINES: usize = 64;
/// What it answers to WIRELESS_NETWORKS.
const NETWORKS: &[u8] = b"home:wpa:82;neighbour:wpa:41;SPYKEE0001:none:100";

/// A robot in a world.
pub struct Robot {
    world: World,
    firmware: Firmware,
    obstacles: Obstacles,
    body: Body,
    battery: Battery,
    docking: Docking,
    speaker: Speaker,
    microphone: Microphone,
    camera: Camera,
    leds: Leds,
    streams: Streams,
    time: Duration,
    commanded: Tracks<i8>,
    since_move: Duration,
    contact: bool,
    docked: bool,
    beacon: bool,
    charger_works: bool,
    session: bool,
    told: Option<Power>,
    until_told: Duration,
    frame_due: f64,
    frames: u64,
    log: VecDeque<String>,
    reports: Vec<Report>,
}

impl Robot {
    /// A robot where the world says that it starts. `seed` gives the noise of eyes and ears.
    pub fn new(world: World, firmware: Firmware, seed: u64) -> Robot {
        let pose = world.start_pose();
        let contact = world.station.touched(pose, true);
        let mut robot = Robot {
            obstacles: Obstacles::of(&world),
            body: Body::new(pose),
            battery: Battery::new(world.battery),
            docking: Docking::new(firmware.search_limit),
            speaker: Speaker::new(firmware.music),
            microphone: Microphone::new(seed),
            camera: Camera::new(&world, seed),
            leds: Leds::default(),
            streams: Streams::default(),
            time: Duration::ZERO,
            commanded: Tracks::default(),
            since_move: Duration::ZERO,
            contact,
            docked: contact,
            beacon: true,
            charger_works: true,
            session: false,
            told: None,
            until_told: Duration::ZERO,
            frame_due: 0.0,
            frames: 0,
            log: VecDeque::new(),
            reports: Vec::new(),
            world,
            firmware,
        };
        robot.battery.set_charging(contact);
        robot
    }

    /// What the robot has said since the last time, oldest first.
    pub fn take_reports(&mut self) -> Vec<Report> {
        std::mem::take(&mut self.reports)
    }

    /// On the station; AUTH_REPLY says so too.
    pub fn docked(&self) -> bool {
        self.docked
    }

    /// Somebody has logged in: POWER follows, all streams are off.
    pub fn begin_session(&mut self) {
        self.session = true;
        self.streams = Streams::default();
        self.microphone.forget();
        self.told = None;
        self.until_told = self.firmware.power_after_login;
        self.note("user connected".into());
        self.tell_power();
    }

    /// The user has gone. The tracks go on unless the firmware stops them.
    pub fn end_session(&mut self) {
        self.session = false;
        self.streams = Streams::default();
        if self.firmware.stops_on_disconnect {
            self.commanded = Tracks::default();
        }
        self.note("user disconnected".into());
    }

    /// Starts afresh where it stands: everything that it was told is forgotten, its battery is not.
    pub fn reboot(&mut self) {
        self.commanded = Tracks::default();
        self.docking.stop();
        self.body.want(Tracks::default());
        self.speaker = Speaker::new(self.firmware.music);
        self.leds = Leds::default();
        self.streams = Streams::default();
        self.log.clear();
        self.note("started".into());
    }

    /// Does what a command asks. Logins are not for the robot and change nothing.
    pub fn obey(&mut self, command: &Command) {
        match command {
            Command::Move { left, right } => self.obey_move(*left, *right),
            Command::Engine(engage) => self.obey_engine(*engage),
            Command::Led { led, on } => {
                if !self.leds.switch(*led, *on) {
                    self.note(format!("no such light: {}", led.to_byte()));
                }
            }
            Command::Play(sound) => self.obey_play(*sound),
            Command::StopSound => self.speaker.stop(),
            Command::Volume(percent) => self.speaker.set_volume(*percent),
            Command::Stream { stream, on } => {
                self.frame_due = 1.0;
                if !self.streams.switch(*stream, *on) {
                    self.note(format!("no such stream: {}", stream.to_byte()));
                }
            }
            Command::PowerQuery => self.say_power(),
            Command::ConfigQuery => self.say_config(),
            Command::NetworksQuery => {
                self.reports
                    .push(Report::Networks(Bytes::from_static(NETWORKS)));
            }
            Command::LogQuery => self.say_log(),
            Command::Audio(_) | Command::None | Command::Login(_) => {}
            other => self.note(format!("accepted without effect: {}", describe(other))),
        }
    }

    /// Lets `dt` pass; a few hundredths of a second at most.
    pub fn step(&mut self, dt: Duration) {
        self.time += dt;
        self.drive(dt);
        self.touch();
        self.battery.step(dt, self.body.effort());
        if self.battery.take_full() {
            self.say_engine(EngineNews::Charged);
        }
        if self.speaker.step(dt) == Some(Sound::Music) {
            self.reports.push(Report::SoundFinished);
        }
        self.listen(dt);
        self.look(dt);
        self.until_told = self.until_told.saturating_sub(dt);
        self.tell_power();
    }

    /// The robot as it is now; the server adds who is connected.
    pub fn state(&self) -> State {
        State {
            time: self.time,
            pose: self.body.pose,
            battery: self.battery.percent(),
            power: self.battery.power(),
            charging: self.battery.charging(),
            docked: self.docked,
            searching: self.docking.searching(),
            leaving: self.docking.leaving(),
            commanded: self.commanded,
            speeds: self.body.speeds(),
            blocked: self.body.blocked(),
            collisions: self.body.collisions(),
            leds: self.leds,
            sound: self.speaker.playing(),
            volume: self.speaker.volume(),
            streams: self.streams,
            user: None,
            frames: self.frames,
            dropped: 0,
        }
    }

    /// Sets the battery's level, percent.
    pub fn set_battery(&mut self, percent: f64) {
        self.battery.set_percent(percent);
        self.tell_power();
    }

    /// With a broken charger the robot docks and does not charge.
    pub fn set_charger_works(&mut self, works: bool) {
        self.charger_works = works;
        self.touch();
        self.tell_power();
    }

    /// Puts the robot somewhere else; a pose that is no place is ignored.
    pub fn place(&mut self, pose: Pose) {
        if ![pose.x, pose.y, pose.heading]
            .iter()
            .all(|number| number.is_finite())
        {
            return;
        }
        self.body.pose = pose;
        self.touch();
        self.tell_power();
    }

    /// With the beacon dark the station cannot be found.
    pub fn set_beacon(&mut self, on: bool) {
        self.beacon = on;
    }

    /// Any MOVE ends a manoeuvre, MOVE 0 0 too. On the station nothing is special: driving
    /// backwards or turning breaks the contact, driving forwards pushes against the station.
    fn obey_move(&mut self, left: i8, right: i8) {
        self.docking.stop();
        self.commanded = Tracks::new(left, right);
        self.since_move = Duration::ZERO;
    }

    fn obey_engine(&mut self, engage: Engage) {
        match engage {
            Engage::Dock if self.contact => self.say_engine(EngineNews::Docked),
            Engage::Dock => {
                self.commanded = Tracks::default();
                self.docking.find_base();
            }
            Engage::CancelDock if self.docking.searching() => self.docking.stop(),
            Engage::Undock if self.docked => {
                self.commanded = Tracks::default();
                self.docking.leave();
            }
            other => self.note(format!("engine {} has no effect now", other.to_byte())),
        }
    }

    fn obey_play(&mut self, sound: Sound) {
        self.speaker.play(sound);
        if self.speaker.playing().is_none() {
            self.note(format!("no such sound: {}", sound.to_byte()));
        }
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
        let senses = Senses {
            pose: self.body.pose,
            station: &self.world.station,
            obstacles: &self.obstacles,
            beacon: self.beacon,
        };
        let wanted = match self.docking.step(dt, &senses) {
            Order::Free => self.commanded.speeds(),
            Order::Drive(speeds) => speeds,
            Order::Left => Tracks::default(),
            Order::NotFound => {
                self.say_engine(EngineNews::BaseNotFound);
                Tracks::default()
            }
        };
        self.body.want(if self.battery.empty() {
            Tracks::default()
        } else {
            wanted
        });
        self.body.step(dt, &self.obstacles);
    }

    /// Notices what the contacts of the station do.
    fn touch(&mut self) {
        self.contact = self.world.station.touched(self.body.pose, self.contact);
        self.battery
            .set_charging(self.contact && self.charger_works);
        if self.contact && self.docking.searching() {
            self.docking.stop();
            self.body.want(Tracks::default());
        }
        let docked = self.contact || (self.docked && self.docking.leaving());
        if docked != self.docked {
            self.docked = docked;
            self.say_engine(if docked {
                EngineNews::Docked
            } else {
                EngineNews::Undocked
            });
        }
    }

    fn listen(&mut self, dt: Duration) {
        if !self.streams.audio_in {
            return;
        }
        let chunk = self
            .microphone
            .listen(dt, self.body.effort(), &mut self.speaker);
        self.reports.extend(chunk.map(Report::Audio));
    }

    fn look(&mut self, dt: Duration) {
        if !self.streams.video {
            return;
        }
        self.frame_due += dt.as_secs_f64() * self.world.camera.fps;
        if self.frame_due >= 1.0 {
            self.frame_due = (self.frame_due - 1.0).min(1.0);
            self.frames += 1;
            let jpeg = self.camera.frame(self.body.pose, self.leds.flash);
            self.reports.push(Report::Video(jpeg));
        }
    }

    /// POWER: first when due after the login, then on every change and when the period is over.
    fn tell_power(&mut self) {
        let changed = self.told.is_some_and(|told| told != self.battery.power());
        if self.session && (changed || self.until_told.is_zero()) {
            self.say_power();
        }
    }

    fn say_power(&mut self) {
        let power = self.battery.power();
        self.told = Some(power);
        self.until_told = self.firmware.power_period;
        self.reports.push(Report::Power(power));
    }

    fn say_engine(&mut self, news: EngineNews) {
        self.note(format!("engine says {news:?}"));
        self.reports.push(Report::Engine(news));
    }

    /// In two messages: clients must put them together.
    fn say_config(&mut self) {
        let first = format!("name=Spykee&version={}&", self.firmware.version);
        let second = format!(
            "volume={}&motor-speed=90&wifi-mode=adhoc",
            self.speaker.volume()
        );
        self.reports
            .extend([first, second].map(|text| Report::Config(Bytes::from(text))));
    }

    fn say_log(&mut self) {
        let lines: Vec<&str> = self.log.iter().map(String::as_str).collect();
        self.reports
            .push(Report::Log(Bytes::from(lines.join("\n"))));
    }

    fn note(&mut self, line: String) {
        tracing::debug!(target: "spykee::sim", seconds = self.time.as_secs_f64(), "{line}");
        if self.log.len() == LOG_LINES {
            self.log.pop_front();
        }
        self.log
            .push_back(format!("[{:.1}] {line}", self.time.as_secs_f64()));
    }
}

/// A command in a few words: payloads may be long, and secret.
pub(super) fn describe(command: &Command) -> String {
    match command {
        Command::File(chunk) => {
            format!(
                "file {} flags {} ({} bytes)",
                chunk.id(),
                chunk.flags(),
                chunk.content().len()
            )
        }
        Command::ConfigSet(text) => format!("config ({} bytes)", text.len()),
        Command::MotorSpeed(payload) => format!("motor speed ({} bytes)", payload.len()),
        Command::Mute(payload) => format!("mute ({} bytes)", payload.len()),
        Command::Unknown(packet) => {
            format!("type {} ({} bytes)", packet.kind, packet.payload.len())
        }
        other => format!("{other:?}"),
    }
}
