//! The simulated robot: commands and time steps go in, reports come out. Knows no socket, no clock
//! and no login; who may talk to it is decided in `server`.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bytes::Bytes;

use crate::wire::{Command, Engage, EngineNews, Power, Report, Sound};

use super::battery::Battery;
use super::chassis::{Body, Tracks};
use super::docking::{Docking, Order, Senses};
use super::firmware::Firmware;
use super::grip::Grip;
use super::memory::Memory;
use super::microphone::Microphone;
use super::speaker::Speaker;
use super::state::{Leds, State, Streams};
use super::trace::{Trace, What};
use crate::sim::camera::{Camera, Shot};
use crate::sim::geometry::obstacles::{Circle, Obstacles};
use crate::sim::geometry::{Point, Pose};
use crate::sim::geometry::{RADIUS, TRACK_WIDTH};
use crate::sim::world::document::World;
use crate::sim::world::movers::Movers;

/// Lines that the robot's own log keeps.
const LOG_LINES: usize = 64;
/// What it answers to WIRELESS_NETWORKS.
const NETWORKS: &[u8] = b"home:wpa:82;neighbour:wpa:41;SPYKEE0001:none:100";

/// A robot in a world.
pub struct Robot {
    world: World,
    firmware: Firmware,
    obstacles: Obstacles,
    movers: Movers,
    grip: Grip,
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
    /// Frames that are still on their way, with the time at which they come.
    developing: VecDeque<(Duration, Bytes)>,
    trace: Arc<Mutex<Trace>>,
    log: VecDeque<String>,
    memory: Memory,
    reports: Vec<Report>,
}

impl Robot {
    /// A robot where the world says that it starts. `seed` gives the noise of eyes and ears.
    pub fn new(world: World, firmware: Firmware, seed: u64) -> Robot {
        let pose = world.start_pose();
        let contact = world.station.touched(pose, true);
        let mut robot = Robot {
            obstacles: world.obstacles(),
            movers: Movers::of(&world),
            grip: Grip::new(world.tracks, seed),
            body: Body::new(pose),
            battery: Battery::new(world.battery),
            docking: Docking::new(firmware.search_limit),
            speaker: Speaker::new(firmware.music),
            microphone: Microphone::new(seed, &world.sounds),
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
            developing: VecDeque::new(),
            trace: Arc::new(Mutex::new(Trace::from(pose))),
            log: VecDeque::new(),
            memory: Memory::new(&firmware.version),
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

    /// What it did so far; shared with whoever looks on.
    pub(crate) fn trace_cell(&self) -> Arc<Mutex<Trace>> {
        self.trace.clone()
    }

    /// What it did so far.
    pub fn trace(&self) -> Trace {
        lock(&self.trace).clone()
    }

    /// The place that it lives in, as it was at first.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Puts a ball somewhere, at rest; the number is its place in the world's list.
    pub fn put_ball(&mut self, index: usize, place: Point) {
        if index < self.world.balls.len() && place.x.is_finite() && place.y.is_finite() {
            self.movers.put_ball(index, place);
            self.obstacles.move_round(index, place);
        }
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
                self.mark(What::Light { led: *led, on: *on });
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
            Command::ConfigSet(text) => {
                let line = self.memory.configure(text);
                self.note(line);
            }
            Command::File(chunk) => {
                let line = self.memory.store(chunk);
                line.into_iter().for_each(|line| self.note(line));
            }
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
        let balls = self.movers.places().take(self.world.balls.len());
        lock(&self.trace).follow(self.time, self.body.pose, balls);
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
            distance: lock(&self.trace).distance(),
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

    /// Makes all light so many times as bright as the world says.
    pub fn set_light(&mut self, gain: f64) {
        if (0.0..=100.0).contains(&gain) {
            self.camera.set_light(gain as f32);
        }
    }

    /// A tone of this level, dBFS, sounds at the microphone for so long.
    pub fn disturb(&mut self, dbfs: f64, time: Duration) {
        if dbfs.is_finite() {
            self.microphone.disturb(dbfs.min(0.0), self.time + time);
        }
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
                self.mark(What::FindBase);
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
        self.mark(match sound {
            Sound::Snapshot => What::Photo,
            sound => What::Sound(sound),
        });
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
            self.grip.step(wanted, dt)
        });
        self.move_on(dt);
    }

    /// The robot and all that moves besides it, after `dt`.
    fn move_on(&mut self, dt: Duration) {
        let seconds = dt.as_secs_f64();
        let here = Circle::new(self.body.pose.point(), RADIUS);
        self.movers.step(seconds, here, &mut self.obstacles);
        let Tracks { left, right } = self.body.speeds();
        let speed = (left + right) / 2.0;
        if speed != 0.0 {
            // A little farther than it gets: who is touched makes way first.
            let next = here
                .middle
                .ahead(self.body.pose.heading, 1.5 * speed * seconds);
            let next = Circle::new(next, RADIUS);
            self.movers.make_way(next, speed, &mut self.obstacles);
        }
        let before = self.body.collisions();
        self.body.step(dt, &self.obstacles);
        if self.body.collisions() != before {
            let way = if speed < 0.0 { -RADIUS } else { RADIUS };
            let bumper = self.body.pose.point().ahead(self.body.pose.heading, way);
            let name = self.world.name_of(self.obstacles.nearest(bumper));
            self.note(format!("ran into: {name}"));
            self.mark(What::Collision(name));
        }
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
        let here = self.body.pose.point();
        self.microphone.turn_to(self.time, here, &self.obstacles);
        let chunk = self
            .microphone
            .listen(dt, self.body.effort(), &mut self.speaker);
        self.reports.extend(chunk.map(Report::Audio));
    }

    fn look(&mut self, dt: Duration) {
        if !self.streams.video {
            self.developing.clear();
            return;
        }
        self.frame_due += dt.as_secs_f64() * self.world.camera.fps;
        if self.frame_due >= 1.0 {
            self.frame_due = (self.frame_due - 1.0).min(1.0);
            self.frames += 1;
            let due = self.time + Duration::from_secs_f64(self.world.camera.latency);
            let jpeg = self.take_frame();
            self.developing.push_back((due, jpeg));
        }
        while self
            .developing
            .front()
            .is_some_and(|(due, _)| *due <= self.time)
        {
            let ready = self.developing.pop_front();
            self.reports
                .extend(ready.map(|(_, jpeg)| Report::Video(jpeg)));
        }
    }

    fn take_frame(&mut self) -> Bytes {
        let Tracks { left, right } = self.body.speeds();
        self.camera.move_rounds(self.movers.places());
        self.camera.frame(Shot {
            pose: self.body.pose,
            flash: self.leds.flash,
            turning: (right - left) / TRACK_WIDTH,
            time: self.time,
        })
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
        match news {
            EngineNews::Docked => self.mark(What::Docked),
            EngineNews::Undocked => self.mark(What::Undocked),
            EngineNews::BaseNotFound => self.mark(What::BaseNotFound),
            _ => {}
        }
        self.reports.push(Report::Engine(news));
    }

    fn say_config(&mut self) {
        let messages = self.memory.settings(self.speaker.volume());
        self.reports.extend(messages.map(Report::Config));
    }

    fn say_log(&mut self) {
        let lines: Vec<&str> = self.log.iter().map(String::as_str).collect();
        self.reports
            .push(Report::Log(Bytes::from(lines.join("\n"))));
    }

    /// Writes down what whoever looks on has seen, for the picture of the run.
    pub fn mark(&self, what: What) {
        lock(&self.trace).note(what);
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

fn lock(trace: &Mutex<Trace>) -> MutexGuard<'_, Trace> {
    trace.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A command in a few words: payloads may be long, and secret.
pub(crate) fn describe(command: &Command) -> String {
    match command {
        Command::MotorSpeed(payload) => format!("motor speed ({} bytes)", payload.len()),
        Command::Mute(payload) => format!("mute ({} bytes)", payload.len()),
        Command::Unknown(packet) => {
            format!("type {} ({} bytes)", packet.kind, packet.payload.len())
        }
        other => format!("{other:?}"),
    }
}
