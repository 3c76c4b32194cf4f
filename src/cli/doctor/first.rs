//! `spykee doctor --first`: finds out, with a person, what is not known of a robot (`PROTOCOL.md`,
//! *Not known*), and writes the config.

mod moving;
#[cfg(test)]
mod tests;

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use tokio::time::Instant;

use self::moving::LinkCut;
use super::DoctorArgs;
use super::network::{execution, per_second};
use crate::agent::PilotPlan;
use crate::cli::calibrate::{answer, config_line};
use crate::cli::driver::{Driver, drive};
use crate::cli::interrupt::unless_interrupted;
use crate::cli::robot::{RobotSession, video};
use crate::cli::settings::CommandSettings;
use crate::cli::{Exit, Failure, block_on, print};
use crate::pilot::{Connector, Settings};
use crate::robot::{Battery, Percent, Streams};
use crate::script::Calibration;
use crate::vision::{Camera, Decoder, Glance, drove_forwards};
use crate::wire::{Command, Engage, EngineReport, Report};

/// How long it may take to answer all questions.
const ANSWERS_TIMEOUT: Duration = Duration::from_secs(10);
/// How often POWER is asked.
const REPEATS: usize = 3;
const LEAVING_TIMEOUT: Duration = Duration::from_secs(15);
/// How long the robot may take to stand after it has reported that it has left.
const COMING_TO_REST: Duration = Duration::from_secs(2);
/// Time between two views that are compared.
const VIEW_INTERVAL: Duration = Duration::from_millis(300);

const INTRODUCTION: &str = "
This finds out what is not known of your robot, in about ten minutes:
  1  it is asked some questions; nothing moves
  2  its camera
  3  you are asked whether it could fall
  4  it leaves its station, if it is on it
  5  it turns left and right on the spot, with rising power
  6  the same at half power, to see whether POWER falls meanwhile
  7  it turns slowly; after a second the connection is cut for two seconds

Put it on its station, in a well-lit room. A metre before the station must be free floor: no stairs,
no table, no cables; keep people and animals away. You are asked before each motion, and can skip
it. Ctrl-C stops the robot at any time.
";

#[derive(Debug)]
struct Finding {
    what: &'static str,
    found: String,
    /// How it was found out.
    how: &'static str,
}

/// What is known so far, and what the steps need of it.
struct Walk {
    /// Nobody is beside the robot, and every motion is allowed.
    yes: bool,
    camera: Camera,
    calibration: Calibration,
    /// At this level it may not leave its station.
    low: Percent,
    is_docked: bool,
    findings: Vec<Finding>,
    /// Lines for the config, and what its `watchdog:` gets.
    lines: Vec<String>,
    watchdog: Vec<&'static str>,
}

impl Walk {
    /// Whether a motion may begin.
    async fn agrees(&self, question: &str) -> Result<bool, Failure> {
        let question = format!("{question} Enter: yes, s: skip it");
        Ok(self.types(&question).await? != "s")
    }

    /// What the person types; nothing if there is nobody.
    async fn types(&self, question: &str) -> Result<String, Failure> {
        print(&format!("     {question} "))?;
        if self.yes {
            print("(--yes)\n")?;
            return Ok(String::new());
        }
        let help = "with --yes nobody is asked before a motion";
        answer().await.map_err(|failure| failure.help(help))
    }
    fn measured(&mut self, what: &'static str, found: &str) -> Result<(), Failure> {
        self.note("measured", what, found)
    }

    fn asked(&mut self, what: &'static str, found: &str) -> Result<(), Failure> {
        self.note("asked", what, found)
    }

    fn unknown(&mut self, what: &'static str, why: &str) -> Result<(), Failure> {
        self.note("not known", what, &format!("not known: {why}"))
    }

    fn note(&mut self, how: &'static str, what: &'static str, found: &str) -> Result<(), Failure> {
        let found = found.to_owned();
        print(&format!("     -> {what}: {found}\n"))?;
        self.findings.push(Finding { what, found, how });
        Ok(())
    }

    fn set_least_power(&mut self, percent: u8) {
        self.calibration.least_power = f64::from(percent);
        self.lines.push(config_line(self.calibration));
    }

    fn summary(&self) -> String {
        let mut text = "\nWhat this robot is:\n".to_owned();
        for Finding { what, found, how } in &self.findings {
            text.push_str(&format!("  {how:9}  {what:20}  {found}\n"));
        }
        text
    }
}

/// Walks a person through everything that can be found out, and writes the config. After an error, what
/// was found out until then is printed.
pub(super) fn run(args: &DoctorArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let seed = rand::random();
    let robot = args.connection.resolve(settings, seed)?;
    let (_core, plan) = robot.driver_plan(seed)?;
    let mut walk = Walk {
        yes: args.yes,
        camera: robot.config.camera,
        calibration: robot.config.calibration,
        low: robot.config.watchdog.low,
        is_docked: true,
        findings: Vec::new(),
        lines: Vec::new(),
        watchdog: Vec::new(),
    };
    if robot.sim.is_none() {
        walk.lines.push(format!("robot: {}", robot.address));
    }
    let exit = block_on(find_out(&mut walk, plan))?;
    print(&walk.summary())?;
    let exit = exit?;
    if exit == Exit::Done {
        conclude(&walk, &settings.path())?;
    }
    Ok(exit)
}

async fn find_out(walk: &mut Walk, plan: PilotPlan) -> Result<Exit, Failure> {
    let (mut connector, cut) = LinkCut::new(plan.connector);
    print(INTRODUCTION)?;
    match unless_interrupted(stand(walk, &mut connector)).await? {
        Some(standing) => standing?,
        None => return Ok(Exit::Interrupted),
    }
    let settings = Settings {
        // It may take a moment until the robot notices that the first connection has ended.
        waits: true,
        ..moving::as_reported(plan.settings)
    };
    let plan = PilotPlan {
        connector,
        settings,
        ..plan
    };
    drive(plan, async |driver| move_about(walk, driver, &cut).await).await
}

/// The steps without the tracks, over a plain link.
async fn stand(walk: &mut Walk, connector: &mut Connector) -> Result<(), Failure> {
    let link = connector(vec![Command::STOP].into()).await?;
    walk.is_docked = link.accepted.docked;
    let mut session = RobotSession::new(link, false, Streams::default());
    ask_robot(walk, &mut session).await?;
    let hint = "its pose: `spykee calibrate camera` measures it from one picture";
    print("\n2  Its camera looks up or down, and may be tilted.\n")?;
    walk.note("not known", "camera", hint)?;
    ask_person(walk).await?;
    leave_station(walk, &mut session).await?;
    session.end().await
}

async fn move_about(walk: &mut Walk, driver: &mut Driver, cut: &LinkCut) -> Result<Exit, Failure> {
    if walk.is_docked {
        for what in ["least power", "POWER is", "without a connection"] {
            walk.unknown(what, "it stands on its station")?;
        }
        return Ok(Exit::Done);
    }
    moving::drive_about(walk, driver, cut).await?;
    Ok(Exit::Done)
}

async fn ask_person(walk: &mut Walk) -> Result<(), Failure> {
    print(
        "\n3  A robot with a low battery that does not find its station drives elsewhere between two \
         searches.\n",
    )?;
    let asks = "Could it fall where it drives, from stairs or an edge (y/n)? Enter: not known";
    match walk.types(asks).await?.as_str() {
        "y" => {
            walk.watchdog.extend(["blind_moves: false", "rescue: off"]);
            walk.asked(
                "can fall",
                "yes: it does not drive by itself to find its station",
            )
        }
        "n" => walk.asked("can fall", "no"),
        _ => walk.unknown(
            "can fall",
            "if it can, set watchdog: { blind_moves: false, rescue: off }",
        ),
    }
}

/// How fast the robot's program is, which questions it answers, and what POWER says.
async fn ask_robot(walk: &mut Walk, session: &mut RobotSession) -> Result<(), Failure> {
    print("\n1  It is asked some questions; nothing moves.\n")?;
    const SPEED: &str = "executes commands";
    match execution(session).await?.map(per_second) {
        Some(None) => walk.measured(SPEED, "at once")?,
        Some(Some(rate)) => {
            walk.measured(SPEED, &format!("about {} a second", significant(rate)))?;
        }
        None => walk.unknown(
            SPEED,
            "it does not say what it has executed; it is sent five a second",
        )?,
    }
    let answers = questions_answered(session).await?;
    walk.measured("answers questions", &answers)?;
    let battery = Battery::reported(session.link.power);
    let found = match (battery.percent, battery.charging) {
        (Some(level), true) => format!("{level}, charging"),
        (Some(level), false) => level.to_string(),
        (None, charging) => {
            let byte = session.link.power.to_byte().cast_signed();
            let charging = if charging { "charging, " } else { "" };
            format!("{charging}out of range ({byte}): its level is not known")
        }
    };
    walk.measured("POWER", &found)
}

/// Two digits that count.
fn significant(rate: f64) -> f64 {
    if rate < 10.0 {
        (rate * 10.0).round() / 10.0
    } else {
        rate.round()
    }
}

/// The questions that it answers, in turn. One POWER may come unasked before the answer to CONFIG,
/// but not several.
async fn questions_answered(session: &mut RobotSession) -> Result<String, Failure> {
    let mut questions = vec![Command::PowerQuery; REPEATS];
    questions.extend([Command::LogQuery, Command::ConfigQuery]);
    session.send(&questions).await?;
    let (mut powers, mut logs) = (0, 0);
    let answer = |report| {
        match report {
            Report::Power(_) => powers += 1,
            Report::Log(_) => logs += 1,
            Report::Config(_) => return Some(()),
            _ => {}
        }
        None
    };
    let config = session.receive(ANSWERS_TIMEOUT, answer).await?.is_some();
    let answered = [
        ("POWER", powers >= REPEATS),
        ("CONFIG", config),
        ("LOG", logs > 0),
        ("none", powers < REPEATS && !config && logs == 0),
    ];
    let answered = answered.into_iter().filter(|(_, answered)| *answered);
    Ok(answered
        .map(|(name, _)| name)
        .collect::<Vec<_>>()
        .join(", "))
}

/// Lets the robot leave its station, and finds out which way. It does that by itself, and ends it
/// by itself.
async fn leave_station(walk: &mut Walk, session: &mut RobotSession) -> Result<(), Failure> {
    const WHAT: &str = "leaves its station";
    print("\n4  It leaves its station, by half a metre or so.\n")?;
    let battery = Battery::reported(session.link.power);
    if !session.link.accepted.docked {
        return walk.unknown(WHAT, "it is not on its station");
    }
    if battery.percent.is_some_and(|level| level <= walk.low) {
        return walk.unknown(WHAT, "the battery is low");
    }
    let asks = match battery.percent {
        Some(_) => "Is the way free?",
        None => "Its level is not known. Has it charged for an hour, and is the way free?",
    };
    if !walk.agrees(asks).await? {
        return walk.unknown(WHAT, "skipped");
    }
    let Some(views) = watch_leaving(walk.camera, session).await? else {
        return walk.unknown(WHAT, "it did not say within 15 s that it has left");
    };
    walk.is_docked = false;
    let seen = drove_forwards(&views.iter().collect::<Vec<_>>());
    let asks = "Did it leave forwards (f) or backwards (b)? Enter: as its pictures say";
    match (walk.types(asks).await?.as_str(), seen) {
        ("f", _) => walk.asked(WHAT, "forwards"),
        ("b", _) => walk.asked(WHAT, "backwards"),
        (_, Some(true)) => walk.measured(WHAT, "forwards"),
        (_, Some(false)) => walk.measured(WHAT, "backwards"),
        (_, None) => walk.unknown(WHAT, "its pictures do not tell"),
    }
}

/// What it sees while it leaves, nothing if something moves already before; `None` if it does not
/// say that it has left.
async fn watch_leaving(
    camera: Camera,
    session: &mut RobotSession,
) -> Result<Option<Vec<Glance>>, Failure> {
    session.send(&[video(true)]).await?;
    // The exposure takes a moment.
    watch(camera, session, COMING_TO_REST / 2).await?;
    let (before, _) = watch(camera, session, COMING_TO_REST).await?;
    session.send(&[Command::Engine(Engage::Undock)]).await?;
    let (mut views, has_left) = watch(camera, session, LEAVING_TIMEOUT).await?;
    session.send(&[Command::STOP, video(false)]).await?;
    let change = |views: &[Glance]| {
        let changes = views.windows(2).map(|pair| pair[0].difference(&pair[1]));
        changes.fold(0.0, f64::max)
    };
    if change(&before) > change(&views) / 2.0 {
        views.clear();
    }
    Ok(has_left.then_some(views))
}

/// What it sees for this long, or until it stands after it has left its station; and whether it has.
async fn watch(
    camera: Camera,
    session: &mut RobotSession,
    time: Duration,
) -> Result<(Vec<Glance>, bool), Failure> {
    let mut until = Instant::now() + time;
    let mut decoder = Decoder::default();
    let mut views = Vec::new();
    let mut next_view = Instant::now();
    let mut has_left = false;
    while let Some(report) = session
        .receive(until.saturating_duration_since(Instant::now()), Some)
        .await?
    {
        let now = Instant::now();
        match report {
            Report::Engine(EngineReport::Undocked) => {
                has_left = true;
                until = now + COMING_TO_REST;
            }
            Report::Video(jpeg) if now >= next_view => {
                let image = decoder.decode(&jpeg).ok();
                if let Some(view) = image.and_then(|image| Glance::new(image, camera)) {
                    views.push(view);
                    next_view = now + VIEW_INTERVAL;
                }
            }
            _ => {}
        }
    }
    Ok((views, has_left))
}

/// Writes the config, or prints its lines if there is one.
fn conclude(walk: &Walk, path: &Path) -> Result<Exit, Failure> {
    let mut lines = walk.lines.clone();
    if !walk.watchdog.is_empty() {
        lines.push(format!("watchdog: {{ {} }}", walk.watchdog.join(", ")));
    }
    if lines.is_empty() {
        return print("\nNothing to set in the config.\n");
    }
    let text = lines.join("\n") + "\n";
    if create(path, &text)? {
        return print(&format!("\nWritten to {}:\n{text}", path.display()));
    }
    print(&format!(
        "\nFor {}, in place of its lines with these names:\n{text}",
        path.display()
    ))
}

/// Writes a new file; `false` if there is one, which stays as it is.
fn create(path: &Path, text: &str) -> Result<bool, Failure> {
    let mut file = match OpenOptions::new().write(true).create_new(true).open(path) {
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => return Ok(false),
        opened => opened.map_err(|error| Failure::unwritable(path, error))?,
    };
    file.write_all(text.as_bytes())
        .map_err(|error| Failure::unwritable(path, error))?;
    Ok(true)
}
