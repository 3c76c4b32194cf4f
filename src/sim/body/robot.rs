//! The simulated robot: commands and time steps go in, reports come out. Knows no socket, no clock
//! and no login; who may talk to it is decided in `server`.

mod obey;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::wire::{EngineReport, Report, Sound};

use super::battery::Battery;
use super::chassis::{Chassis, Tracks};
use super::contacts::Contacts;
use super::docking::{Docking, DockingStep, Senses};
use super::firmware::Firmware;
use super::grip::Grip;
use super::log::RobotLog;
use super::memory::Memory;
use super::microphone::Microphone;
use super::power::PowerReports;
use super::speaker::Speaker;
use super::state::{Leds, State, Streams};
use super::surroundings::Surroundings;
use super::trace::{Movers, Trace, What};
use super::video::Video;
use crate::sim::camera::Shot;
use crate::sim::geometry::{Point, Pose, RADIUS};
use crate::sim::world::document::World;

/// A robot in a world.
pub struct Robot {
    firmware: Firmware,
    time: Duration,
    surroundings: Surroundings,
    // Driving.
    commanded: Tracks<i8>,
    since_move: Duration,
    docking: Docking,
    grip: Grip,
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
    // What it keeps and says.
    memory: Memory,
    log: RobotLog,
    trace: Arc<Mutex<Trace>>,
    reports: Vec<Report>,
}

impl Robot {
    /// A robot where the world says that it starts. `seed` draws the noise of camera and
    /// microphone.
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
            grip: Grip::new(world.tracks, seed),
            chassis: Chassis::new(pose),
            contacts: Contacts::new(touching),
            battery,
            power: PowerReports::new(firmware.power_late),
            leds: Leds::default(),
            speaker: Speaker::new(firmware.music),
            streams: Streams::default(),
            microphone: Microphone::new(seed, &world.sounds),
            video: Video::new(&world, seed),
            memory: Memory::new(&firmware.version),
            log: RobotLog::default(),
            trace: Arc::new(Mutex::new(Trace::from(pose))),
            reports: Vec::new(),
            surroundings: Surroundings::of(world),
            firmware,
        }
    }

    /// The reports since the last call, oldest first.
    pub fn take_reports(&mut self) -> Vec<Report> {
        std::mem::take(&mut self.reports)
    }

    /// The trace so far, shared with handles.
    pub(crate) fn trace_cell(&self) -> Arc<Mutex<Trace>> {
        self.trace.clone()
    }

    /// What it did so far.
    pub fn trace(&self) -> Trace {
        lock(&self.trace).clone()
    }

    /// The world, in its initial state.
    pub fn world(&self) -> &World {
        &self.surroundings.world
    }

    /// Puts a ball somewhere, at rest; the number is its place in the world's list.
    pub fn put_ball(&mut self, index: usize, place: Point) {
        self.surroundings.put_ball(index, place);
    }

    /// On the station; AUTH_REPLY says so too.
    pub fn docked(&self) -> bool {
        self.contacts.docked()
    }

    /// A user has logged in: POWER follows, all streams are off.
    pub fn begin_session(&mut self) {
        self.streams = Streams::default();
        self.microphone.forget();
        self.power.begin_session(self.firmware.power_after_login);
        self.note("user connected");
        self.report_power();
    }

    /// The user has disconnected. The tracks keep running unless the firmware stops them.
    pub fn end_session(&mut self) {
        self.power.end_session();
        self.streams = Streams::default();
        if self.firmware.stops_on_disconnect {
            self.commanded = Tracks::default();
        }
        self.note("user disconnected");
    }

    /// Reboots in place: all commanded state is reset, the battery's level stays.
    pub fn reboot(&mut self) {
        self.commanded = Tracks::default();
        self.docking.stop();
        self.chassis.want(Tracks::default());
        self.speaker = Speaker::new(self.firmware.music);
        self.leds = Leds::default();
        self.streams = Streams::default();
        self.log.clear();
        self.note("started");
    }

    /// Lets `dt` pass; a few hundredths of a second at most.
    pub fn step(&mut self, dt: Duration) {
        self.time += dt;
        self.drive(dt);
        self.touch();
        let (places, balls) = (
            self.surroundings.places(),
            self.surroundings.world.balls.len(),
        );
        lock(&self.trace).follow(self.time, self.chassis.pose, Movers { places, balls });
        self.battery.step(dt, self.chassis.effort());
        if self.battery.take_full() {
            self.report_engine(EngineReport::Charged);
        }
        if self.speaker.step(dt) == Some(Sound::Music) {
            self.reports.push(Report::SoundFinished);
        }
        self.listen(dt);
        self.look(dt);
        self.power.step(dt);
        self.report_power();
    }

    /// The robot as it is now; the server adds who is connected.
    pub fn state(&self) -> State {
        State {
            time: self.time,
            pose: self.chassis.pose,
            battery: self.battery.percent(),
            power: self.battery.power(),
            charging: self.battery.charging(),
            docked: self.contacts.docked(),
            searching: self.docking.searching(),
            leaving: self.docking.leaving(),
            commanded: self.commanded,
            speeds: self.chassis.speeds(),
            blocked: self.chassis.blocked(),
            collisions: self.chassis.collisions(),
            distance: lock(&self.trace).distance(),
            leds: self.leds,
            sound: self.speaker.playing(),
            volume: self.speaker.volume(),
            streams: self.streams,
            user: None,
            frames: self.video.frames(),
            dropped: 0,
        }
    }

    /// Sets the battery's level, percent.
    pub fn set_battery(&mut self, percent: f64) {
        self.battery.set_percent(percent);
        self.report_power();
    }

    /// With a broken charger the robot docks and does not charge.
    pub fn set_charger_works(&mut self, works: bool) {
        self.contacts.charger_works = works;
        self.touch();
        self.report_power();
    }

    /// Moves the robot to a pose; one that is not finite is ignored.
    pub fn place(&mut self, pose: Pose) {
        if ![pose.x, pose.y, pose.heading]
            .iter()
            .all(|number| number.is_finite())
        {
            return;
        }
        self.chassis.pose = pose;
        self.touch();
        self.report_power();
    }

    /// Multiplies all light of the world by `gain`.
    pub fn set_light(&mut self, gain: f64) {
        if (0.0..=100.0).contains(&gain) {
            self.video.camera.set_light(gain as f32);
        }
    }

    /// A tone of this level, dBFS, sounds at the microphone for so long.
    pub fn disturb(&mut self, dbfs: f64, time: Duration) {
        if dbfs.is_finite() {
            self.microphone.disturb(dbfs.min(0.0), self.time + time);
        }
    }

    /// With the beacon off the station cannot be found.
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
        let senses = Senses {
            pose: self.chassis.pose,
            station: &self.surroundings.world.station,
            obstacles: &self.surroundings.obstacles,
            beacon: self.contacts.beacon,
        };
        let wanted = match self.docking.step(dt, &senses) {
            DockingStep::Free => self.commanded.speeds(),
            DockingStep::Drive(speeds) if self.commanded == Tracks::default() => speeds,
            DockingStep::Drive(_) => self.commanded.speeds(),
            DockingStep::Left => Tracks::default(),
            DockingStep::NotFound => {
                self.report_engine(EngineReport::BaseNotFound);
                Tracks::default()
            }
        };
        self.chassis.want(if self.battery.empty() {
            Tracks::default()
        } else {
            self.grip.step(wanted, dt)
        });
        self.move_on(dt);
    }

    /// The robot and all that moves besides it, after `dt`.
    fn move_on(&mut self, dt: Duration) {
        self.surroundings.step(dt.as_secs_f64(), &self.chassis);
        let speed = self.chassis.forward_speed();
        let before = self.chassis.collisions();
        self.chassis.step(dt, &self.surroundings.obstacles);
        if self.chassis.collisions() != before {
            let reach = if speed < 0.0 { -RADIUS } else { RADIUS };
            let Pose { heading, .. } = self.chassis.pose;
            let bumper = self.chassis.pose.point().ahead(heading, reach);
            let name = self.surroundings.name_at(bumper);
            self.note(&format!("ran into: {name}"));
            self.mark(What::Collision(name));
        }
    }

    /// Notices what the contacts of the station do.
    fn touch(&mut self) {
        let station = &self.surroundings.world.station;
        self.contacts.touch(station, self.chassis.pose);
        self.battery.set_charging(self.contacts.charging());
        if self.contacts.touching() && self.docking.searching() {
            self.docking.stop();
            self.chassis.want(Tracks::default());
        }
        if let Some(docked) = self.contacts.take_change(&self.docking) {
            self.report_engine(if docked {
                EngineReport::Docked
            } else {
                EngineReport::Undocked
            });
        }
    }

    fn listen(&mut self, dt: Duration) {
        if !self.streams.audio_in {
            return;
        }
        let here = self.chassis.pose.point();
        self.microphone
            .turn_to(self.time, here, &self.surroundings.obstacles);
        let chunk = self
            .microphone
            .listen(dt, self.chassis.effort(), &mut self.speaker);
        self.reports.extend(chunk.map(Report::Audio));
    }

    fn look(&mut self, dt: Duration) {
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
        let surroundings = &self.surroundings;
        self.video.step(dt, |camera| {
            camera.move_rounds(surroundings.places());
            shot
        });
        while let Some(jpeg) = self.video.take(self.time) {
            self.reports.push(Report::Video(jpeg));
        }
    }

    /// Sends POWER if it is due.
    fn report_power(&mut self) {
        let power = self.power.level(self.battery.power());
        if self.power.due(power) {
            self.send_power();
        }
    }

    fn send_power(&mut self) {
        let power = self.power.level(self.battery.power());
        self.power.sent(power, self.firmware.power_period);
        self.reports.push(Report::Power(power));
    }

    fn report_engine(&mut self, report: EngineReport) {
        self.note(&format!("engine says {report:?}"));
        match report {
            EngineReport::Docked => self.mark(What::Docked),
            EngineReport::Undocked => self.mark(What::Undocked),
            EngineReport::BaseNotFound => self.mark(What::BaseNotFound),
            _ => {}
        }
        self.reports.push(Report::Engine(report));
    }

    /// Adds an observation to the trace, for the picture of the run.
    pub fn mark(&self, what: What) {
        lock(&self.trace).note(what);
    }

    fn note(&mut self, line: &str) {
        self.log.write(self.time, line);
    }
}

fn lock(trace: &Mutex<Trace>) -> MutexGuard<'_, Trace> {
    trace.lock().unwrap_or_else(PoisonError::into_inner)
}
