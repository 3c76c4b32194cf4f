//! Checks of the network and of the robot on it.

use std::time::Duration;

use bytes::Bytes;
use tokio::net::TcpStream;
use tokio::time::{Instant, timeout};

use super::{CheckResult, DoctorReport, Verdict};
use crate::cli::connection::RobotTarget;
use crate::cli::interrupt::unless_interrupted;
use crate::cli::robot::{RobotSession, video};
use crate::cli::status::charge;
use crate::cli::{ConnectionArgs, Failure, block_on};
use crate::config::{Config, Effective};
use crate::link::{self, Session, Target, discover};
use crate::robot::Battery;
use crate::sim;
use crate::vision::{Camera, Decoder, Paper, pose_from_sheets, validate_markers};
use crate::wire::{Command, Report};

const DISCOVERY_PERIOD: Duration = Duration::from_secs(1);
const VIDEO_PERIOD: Duration = Duration::from_secs(3);
const REPLY_TIMEOUT: Duration = Duration::from_secs(2);
/// Latency above which behaviours that steer by pictures work badly.
const SLOW: Duration = Duration::from_millis(150);
/// Questions that measure how fast it executes.
const QUESTIONS: usize = 8;
/// A robot that needs less time for a command executes it at once, as far as people can tell.
const AT_ONCE: Duration = Duration::from_millis(20);
/// Frames per second below which behaviours cannot follow anything.
const FEW_FRAMES: f64 = 5.0;

/// Runs all checks that need a network, and those of the robot if one is named. Ctrl-C ends them.
pub(super) fn examine(
    connection: &ConnectionArgs,
    mut settings: Effective,
    report: &mut DoctorReport,
) -> Result<(), Failure> {
    report.add(interfaces());
    report.add(interruptible(discovery())?);
    let Some(chosen) = connection.choose(&mut settings.config)? else {
        let help = "name a robot with --robot HOST[:PORT] or in the config; --sim checks a \
                    simulated one";
        report.add(CheckResult::warn(
            "robot",
            "no robot named: not checked",
            help,
        ));
        return Ok(());
    };
    let login = connection.login.login(&settings)?;
    let options = sim::Options {
        login,
        ..sim::Options::default()
    };
    let target = chosen.start(settings.config, options)?;
    interruptible(robot(&target, report))
}

fn interruptible<T>(checks: impl Future<Output = T>) -> Result<T, Failure> {
    block_on(unless_interrupted(checks))??.ok_or_else(Failure::interrupted)
}

fn interfaces() -> CheckResult {
    let all = if_addrs::get_if_addrs().unwrap_or_default();
    let shown: Vec<String> = all
        .iter()
        .filter(|interface| !interface.is_loopback() && interface.ip().is_ipv4())
        .map(|interface| format!("{} {}", interface.name, interface.ip()))
        .collect();
    if shown.is_empty() {
        let help = "join the robot's Wi-Fi (SPYKEE...), or the network that it is in";
        return CheckResult::warn("network", "no interface has an IPv4 address", help);
    }
    CheckResult::ok("network", shown.join(", "))
}

async fn discovery() -> CheckResult {
    match discover::discover(DISCOVERY_PERIOD, &[]).await {
        Err(error) => CheckResult::fail(
            "discovery",
            format!("cannot broadcast: {error}"),
            "may this user open UDP sockets?",
        ),
        Ok(found) if found.is_empty() => CheckResult::warn(
            "discovery",
            "searched every network; no robot answered",
            "is the robot on, and is this computer in its Wi-Fi (SPYKEE...)? A firewall must let \
             UDP port 9000 through",
        ),
        Ok(found) => {
            let robot = |robot: &discover::Found| {
                let user = robot.connected_user.as_deref();
                let user = user.map_or_else(String::new, |user| format!(" (used by {user})"));
                format!("{} at {}{user}", robot.uid, robot.addr)
            };
            let robots: Vec<String> = found.iter().map(robot).collect();
            CheckResult::ok("discovery", robots.join(", "))
        }
    }
}

async fn robot(target: &RobotTarget, report: &mut DoctorReport) {
    let reachable = check_reachable(&target.address).await;
    let open = reachable.verdict != Verdict::Fail;
    report.add(reachable);
    if !open {
        return;
    }
    let mut session = match RobotSession::begin(target).await {
        Ok(session) => session,
        Err(error) => {
            return report.add(CheckResult::fail("login", error.to_string(), error.help()));
        }
    };
    let who = &session.link.accepted;
    let docked = if who.docked { "on" } else { "off" };
    let found = format!(
        "{} accepted the login, firmware {}, {docked} its station",
        who.uid, who.firmware
    );
    report.add(CheckResult::ok("login", found));
    report.add(battery(&session.link, &target.config));
    let ended = match check_link(&mut session, &target.config, report).await {
        Ok(()) => session.end().await,
        lost => lost,
    };
    if let Err(failure) = ended {
        let help = failure.help.unwrap_or_default();
        report.add(CheckResult::fail("link", failure.what, &help));
    }
}

async fn check_link(
    session: &mut RobotSession,
    config: &Config,
    report: &mut DoctorReport,
) -> Result<(), Failure> {
    report.add(latency(session).await?);
    report.add(execution_result(execution(session).await?));
    let (rate, frame) = count_frames(session).await?;
    report.add(rate);
    // A simulated robot has its world's camera, not the config's.
    let frame = if session.simulated { None } else { frame };
    if let Some(pose) = frame.and_then(|jpeg| camera_pose(&jpeg, config.camera)) {
        report.add(pose);
    }
    Ok(())
}

/// Compares the config's camera with paper on the floor, if there is any in this picture.
fn camera_pose(jpeg: &[u8], camera: Camera) -> Option<CheckResult> {
    let mut decoder = Decoder::default();
    let image = decoder.decode(jpeg).ok()?;
    let papers = [Paper::A4, Paper::Letter];
    let measured = papers.map(|paper| pose_from_sheets(image, camera, paper).ok());
    let found: Vec<_> = measured.into_iter().flatten().collect();
    if found.iter().any(|pose| pose.fits(&camera)) {
        let found = "the config's camera fits the paper on the floor";
        return Some(CheckResult::ok("camera", found));
    }
    let seen = found.first().filter(|pose| pose.agree)?.camera;
    let found = format!(
        "the config says height {:.2} m, pitch {:.0}, roll {:.0}; paper on the floor says {:.2} m, \
         {:.0}, {:.0}",
        camera.height, camera.pitch, camera.roll, seen.height, seen.pitch, seen.roll
    );
    let help = "if there is paper on the floor, `spykee calibrate camera` measures it";
    Some(CheckResult::warn("camera", found, help))
}

/// Opens one TCP connection and closes it at once: this takes one round trip.
async fn check_reachable(target: &Target) -> CheckResult {
    let limit = link::Options::default().connect_timeout;
    let began = Instant::now();
    let help = "is the robot on, and is this computer in its Wi-Fi? `spykee discover` lists robots";
    let connecting = TcpStream::connect((target.host.as_str(), target.port));
    match timeout(limit, connecting).await {
        Ok(Ok(_)) => {
            let took = began.elapsed().as_secs_f64() * 1000.0;
            CheckResult::ok("robot", format!("{target} can be reached, in {took:.1} ms"))
        }
        Ok(Err(error)) => {
            CheckResult::fail("robot", format!("cannot reach {target}: {error}"), help)
        }
        Err(_) => {
            let found = format!("{target} did not answer within {} s", limit.as_secs());
            CheckResult::fail("robot", found, help)
        }
    }
}

fn battery(session: &Session, config: &Config) -> CheckResult {
    let battery = Battery::reported(session.power);
    let found = charge(battery);
    let low = |percent| percent <= config.watchdog.low;
    if battery.charging || !battery.percent.is_some_and(low) {
        return CheckResult::ok("battery", found);
    }
    let help = "too low to drive: put the robot on its station";
    CheckResult::warn("battery", found, help)
}

/// Measures the time from a request to its reply, including the robot's processing time.
async fn latency(session: &mut RobotSession) -> Result<CheckResult, Failure> {
    let began = Instant::now();
    session.send(&[Command::PowerQuery]).await?;
    let answer = |report| matches!(report, Report::Power(_)).then_some(());
    if session.receive(REPLY_TIMEOUT, answer).await?.is_none() {
        let found = "the robot did not reply to a battery request";
        let help = "some robots may not reply; check whether frames arrive";
        return Ok(CheckResult::warn("latency", found, help));
    }
    let took = began.elapsed();
    let found = format!(
        "{:.1} ms from a request to its reply",
        took.as_secs_f64() * 1000.0
    );
    Ok(if took > SLOW {
        CheckResult::warn("latency", found, "bring robot and computer closer together")
    } else {
        CheckResult::ok("latency", found)
    })
}

/// How long the robot's program takes for a command: the median time between its answers to several
/// questions that were sent at once; `None` if it does not answer. The question is CONFIG: unlike
/// POWER it never comes unasked. An answer may consist of several messages, one right after another.
pub(super) async fn execution(session: &mut RobotSession) -> Result<Option<Duration>, Failure> {
    session.send(&vec![Command::ConfigQuery; QUESTIONS]).await?;
    let answer = |report| matches!(report, Report::Config(_)).then(Instant::now);
    let mut times = Vec::new();
    while let Some(time) = session.receive(REPLY_TIMEOUT, answer).await? {
        times.push(time);
    }
    let mut gaps: Vec<Duration> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort();
    let has_all = times.len() >= QUESTIONS;
    Ok(has_all.then(|| gaps[gaps.len() - QUESTIONS / 2]))
}

/// The number of commands that a robot executes per second which takes so long for one; `None`: at
/// once, as far as people can tell.
pub(super) fn per_second(time: Duration) -> Option<f64> {
    (time >= AT_ONCE).then(|| 1.0 / time.as_secs_f64())
}

fn execution_result(executes: Option<Duration>) -> CheckResult {
    let Some(time) = executes else {
        let found = "the robot does not say what it has executed";
        let help = "a stop counts as acknowledged, not as executed, and five commands a second are \
                    sent";
        return CheckResult::warn("commands", found, help);
    };
    let speed = match per_second(time) {
        None => "at once".to_owned(),
        Some(rate) => format!("about {rate:.0} a second"),
    };
    let found = format!("the robot executes them {speed}, and says so");
    CheckResult::ok("commands", found)
}

/// Counts frames; returns an intact one too.
async fn count_frames(session: &mut RobotSession) -> Result<(CheckResult, Option<Bytes>), Failure> {
    session.send(&[video(true)]).await?;
    let mut frames = 0_u32;
    let mut damaged = 0_u32;
    let mut first = None;
    let mut intact = None;
    let until = Instant::now() + VIDEO_PERIOD;
    let frame = |report| match report {
        Report::Video(jpeg) => Some(jpeg),
        _ => None,
    };
    while let Some(jpeg) = session
        .receive(until.saturating_duration_since(Instant::now()), frame)
        .await?
    {
        first.get_or_insert_with(Instant::now);
        frames += 1;
        match validate_markers(&jpeg) {
            Ok(_) => intact = Some(jpeg),
            Err(_) => damaged += 1,
        }
    }
    session.send(&[video(false)]).await?;
    let seconds = first
        .map_or(VIDEO_PERIOD, |first| first.elapsed())
        .as_secs_f64();
    let rate = f64::from(frames) / seconds.max(0.1);
    Ok((video_result(frames, damaged, rate), intact))
}

fn video_result(frames: u32, damaged: u32, rate: f64) -> CheckResult {
    let found = format!("{rate:.0} frames per second, {damaged} of {frames} damaged");
    if frames == 0 {
        let help =
            "scripts that use the camera will get no pictures: switch the robot off and on again";
        return CheckResult::fail("video", "no frame arrived within 3 s", help);
    }
    if rate < FEW_FRAMES || damaged * 10 > frames {
        return CheckResult::warn("video", found, "bring robot and computer closer together");
    }
    CheckResult::ok("video", found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_or_damaged_frames_get_a_warning() {
        let verdict = |frames, damaged, rate| video_result(frames, damaged, rate).verdict;
        assert_eq!(verdict(45, 0, 15.0), Verdict::Ok);
        assert_eq!(verdict(45, 9, 15.0), Verdict::Warn);
        assert_eq!(verdict(6, 0, 2.0), Verdict::Warn);
        assert_eq!(verdict(0, 0, 0.0), Verdict::Fail);
    }
}
