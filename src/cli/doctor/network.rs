//! Checks of the network and of the robot on it.

use std::time::Duration;

use bytes::Bytes;
use tokio::net::TcpStream;
use tokio::time::{Instant, timeout, timeout_at};

use super::{CheckResult, DoctorReport};
use crate::cli::embedded::Simulated;
use crate::cli::interrupt::interruption;
use crate::cli::robot::send_home_if_low;
use crate::cli::robot_target::ChosenRobot;
use crate::cli::startup::is_stopped;
use crate::cli::{ConnectionArgs, Exit, Failure, RobotChoice};
use crate::config::{Config, Effective};
use crate::link::{self, LinkError, Session, Target, discover};
use crate::pilot::DELIVERY;
use crate::robot::Battery;
use crate::vision::{Camera, Decoder, Paper, pose_from_sheets, validate_markers};
use crate::wire::{Command, Report, Stream};

/// Time to listen for replies to discovery.
const DISCOVERY_PERIOD: Duration = Duration::from_secs(1);
/// Time to count frames.
const VIDEO_PERIOD: Duration = Duration::from_secs(3);
const REPLY_TIMEOUT: Duration = Duration::from_secs(2);
/// Latency above which behaviours that steer by pictures work badly.
const SLOW: Duration = Duration::from_millis(150);
/// Questions that measure how fast it executes.
const QUESTIONS: usize = 8;
/// How long another message of an answer may take.
const QUIET: Duration = Duration::from_secs(1);
/// A robot that needs less time for a command executes it at once, as far as people can tell.
const AT_ONCE: Duration = Duration::from_millis(20);
/// Frames per second below which behaviours cannot follow anything.
const FEW_FRAMES: f64 = 5.0;

/// Runs all checks that need a network, and those of the robot if one is named. Ctrl-C ends them.
pub(super) async fn examine(
    place: Option<RobotChoice>,
    connection: &ConnectionArgs,
    settings: &Effective,
    report: &mut DoctorReport,
) -> Result<(), Failure> {
    let interrupted = interruption()?;
    let checks = async {
        report.add(interfaces())?;
        report.add(discovery().await)?;
        match place {
            None => {
                let help = "name a robot with --robot HOST[:PORT] or in the config; --sim checks a \
                            simulated one";
                report.add(CheckResult::warn(
                    "robot",
                    "no robot named: not checked",
                    help,
                ))
            }
            Some(place) => robot(place, connection, settings, report).await,
        }
    };
    tokio::select! {
        biased;
        () = interrupted => Err(Failure::new(Exit::Interrupted, "interrupted")),
        done = checks => done,
    }
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

async fn robot(
    place: RobotChoice,
    connection: &ConnectionArgs,
    settings: &Effective,
    report: &mut DoctorReport,
) -> Result<(), Failure> {
    let config = &settings.config;
    let options = link::Options::default();
    let login = connection.login.login(settings)?;
    let chosen = ChosenRobot::from_choice(place)?;
    let (target, sim) = chosen.start(&login, 0, Simulated::default())?;
    let reachable = check_reachable(&target, options.connect_timeout).await;
    let open = reachable.verdict != super::Verdict::Fail;
    report.add(reachable)?;
    if !open {
        return Ok(());
    }
    let mut session = match link::connect(&target, &login, vec![Command::STOP], &options).await {
        Ok(session) => session,
        Err(error) => {
            return report.add(CheckResult::fail("login", error.to_string(), error.help()));
        }
    };
    let who = &session.accepted;
    let docked = if who.docked { "on" } else { "off" };
    let found = format!(
        "{} accepted the login, firmware {}, {docked} its station",
        who.uid, who.firmware
    );
    report.add(CheckResult::ok("login", found))?;
    report.add(battery(&session, config))?;
    let stopped = is_stopped(config, sim.is_some());
    // In a simulation the world's camera counts, not the config's.
    let camera = sim.is_none().then_some(config.camera);
    match check_link(&mut session, config, camera, stopped, report).await {
        Ok(result) => result?,
        Err(error) => {
            return report.add(CheckResult::fail("link", error.to_string(), error.help()));
        }
    }
    link::close_gracefully(session.reader, session.writer, DELIVERY).await;
    Ok(())
}

async fn check_link(
    session: &mut Session,
    config: &Config,
    camera: Option<Camera>,
    stopped: bool,
    report: &mut DoctorReport,
) -> Result<Result<(), Failure>, LinkError> {
    if !stopped {
        send_home_if_low(session, config).await?;
    }
    let latency = latency(session).await?;
    if let Err(failure) = report.add(latency) {
        return Ok(Err(failure));
    }
    let execution = execution(session).await?;
    if let Err(failure) = report.add(execution_result(&execution)) {
        return Ok(Err(failure));
    }
    let (video, frame) = video(session).await?;
    let added = report.add(video);
    if let (Some(camera), Some(jpeg)) = (camera, frame)
        && let Some(pose) = camera_pose(&jpeg, camera)
    {
        return Ok(added.and_then(|()| report.add(pose)));
    }
    Ok(added)
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
async fn check_reachable(target: &Target, limit: Duration) -> CheckResult {
    let began = Instant::now();
    let help = "is the robot on, and is this computer in its Wi-Fi? `spykee discover` lists robots";
    match timeout(
        limit,
        TcpStream::connect((target.host.as_str(), target.port)),
    )
    .await
    {
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
    let charging = if battery.charging { ", charging" } else { "" };
    let found = format!("{}{charging}", battery.level());
    let low = |percent| percent <= config.watchdog.low;
    if battery.charging || !battery.percent.is_some_and(low) {
        return CheckResult::ok("battery", found);
    }
    let help = "too low to drive: put the robot on its station";
    CheckResult::warn("battery", found, help)
}

/// Measures the time from a request to its reply, including the robot's processing time.
async fn latency(session: &mut Session) -> Result<CheckResult, LinkError> {
    let began = Instant::now();
    session.writer.write(&[Command::PowerQuery]).await?;
    loop {
        let Ok(report) = timeout_at(began + REPLY_TIMEOUT, session.reader.next()).await else {
            let found = "the robot did not reply to a battery request";
            let help = "some robots may not reply; check whether frames arrive";
            return Ok(CheckResult::warn("latency", found, help));
        };
        if let Report::Power(_) = report? {
            break;
        }
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

/// Whether the robot's program answers questions, and how fast it executes what it is sent.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Execution {
    /// It answers none.
    Silent,
    /// It answers this one, faster than can be told.
    AtOnce(Command),
    /// It answers this one; the number it executes per second.
    PerSecond(Command, f64),
}

impl Execution {
    /// The question that it answers.
    pub(super) fn question(&self) -> Option<&Command> {
        match self {
            Execution::Silent => None,
            Execution::AtOnce(question) | Execution::PerSecond(question, _) => Some(question),
        }
    }
}

/// Sends questions all at once: the time from one answer to the next is that of one command. CONFIG
/// never comes unasked, as POWER does, but may come in several messages.
pub(super) async fn execution(session: &mut Session) -> Result<Execution, LinkError> {
    for question in [Command::ConfigQuery, Command::PowerQuery] {
        let questions = vec![question.clone(); QUESTIONS];
        session.writer.write(&questions).await?;
        let mut answers = Vec::new();
        let mut until = Instant::now() + REPLY_TIMEOUT;
        while let Ok(report) = timeout_at(until, session.reader.next()).await {
            let is_answer = match report? {
                Report::Config(_) => question == Command::ConfigQuery,
                Report::Power(_) => question == Command::PowerQuery,
                _ => false,
            };
            if is_answer {
                answers.push(Instant::now());
                let is_complete = answers.len().is_multiple_of(QUESTIONS);
                until = Instant::now() + if is_complete { QUIET } else { REPLY_TIMEOUT };
            }
        }
        let messages_each = (answers.len() / QUESTIONS).max(1);
        // The first question may have waited for other commands.
        if let [first, .., last] = answers[(messages_each - 1).min(answers.len())..] {
            let others = answers.len() / messages_each - 1;
            let period = (last - first) / others as u32;
            return Ok(if period < AT_ONCE {
                Execution::AtOnce(question)
            } else {
                Execution::PerSecond(question, 1.0 / period.as_secs_f64())
            });
        }
    }
    Ok(Execution::Silent)
}

fn execution_result(execution: &Execution) -> CheckResult {
    let speed = match execution {
        Execution::Silent => {
            let found = "the robot does not say what it has executed";
            let help = "a stop counts as acknowledged, not as executed, and five commands a second \
                        are sent";
            return CheckResult::warn("commands", found, help);
        }
        Execution::AtOnce(_) => "at once".to_owned(),
        Execution::PerSecond(_, rate) => format!("about {rate:.0} a second"),
    };
    let found = format!("the robot executes them {speed}, and says so");
    CheckResult::ok("commands", found)
}

/// Counts frames; returns an intact one too.
async fn video(session: &mut Session) -> Result<(CheckResult, Option<Bytes>), LinkError> {
    let stream = |on| Command::Stream {
        stream: Stream::Video,
        on,
    };
    session.writer.write(&[stream(true)]).await?;
    let mut frames = 0_u32;
    let mut damaged = 0_u32;
    let mut first = None;
    let mut intact = None;
    let until = Instant::now() + VIDEO_PERIOD;
    while let Ok(report) = timeout_at(until, session.reader.next()).await {
        if let Report::Video(jpeg) = report? {
            first.get_or_insert_with(Instant::now);
            frames += 1;
            match validate_markers(&jpeg) {
                Ok(_) => intact = Some(jpeg),
                Err(_) => damaged += 1,
            }
        }
    }
    session.writer.write(&[stream(false)]).await?;
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
    use super::super::Verdict;
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
