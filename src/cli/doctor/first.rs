//! `spykee doctor --first`: finds out, with a person, what is not known of a robot (`PROTOCOL.md`,
//! *Not known*), and writes the config.

mod link_cut;
mod moving;
mod standing;
#[cfg(test)]
mod tests;

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;

use self::link_cut::LinkCut;
use super::DoctorArgs;
use crate::cli::calibrate::person;
use crate::cli::driver::{Driver, DriverParts, drive};
use crate::cli::interrupt::interruption;
use crate::cli::robot::TargetArgs;
use crate::cli::{Exit, Failure, block_on, print};
use crate::link::close_gracefully;
use crate::pilot::{Connector, DELIVERY};
use crate::robot::Percent;
use crate::vision::Camera;
use crate::wire::Command;

const INTRODUCTION: &str = "
This finds out what is not known of your robot, in about ten minutes:
  1  it is asked some questions; nothing moves
  2  its camera
  3  you are asked whether it could fall
  4  it leaves its station, if it is on it
  5  it turns left and right on the spot, with rising power
  6  the same at half power, to see whether POWER falls meanwhile
  7  it turns slowly for two seconds; in the second one the connection is cut

Put it on its station, in a well-lit room. A metre before the station must be free floor: no stairs,
no table, no cables; keep people and animals away. You are asked before each motion, and can skip
it. Ctrl-C stops the robot at any time.
";

/// How something was found out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum How {
    Measured,
    Asked,
    NotKnown,
}

#[derive(Debug)]
struct Finding {
    what: &'static str,
    found: String,
    how: How,
}

/// What is known so far, and what the steps need of it.
struct Walk {
    person: Person,
    camera: Camera,
    /// At this level it may not leave its station.
    low: Percent,
    is_docked: bool,
    findings: Vec<Finding>,
    /// Lines for the config, and what its `watchdog:` gets.
    lines: Vec<String>,
    watchdog: Vec<&'static str>,
}

/// The person beside the robot; or nobody, and every motion is allowed.
struct Person {
    yes: bool,
}

impl Person {
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
        person::answer().await.map_err(|failure| failure.help(help))
    }
}

impl Walk {
    fn measured(&mut self, what: &'static str, found: &str) -> Result<(), Failure> {
        self.note(what, found, How::Measured)
    }

    fn asked(&mut self, what: &'static str, found: &str) -> Result<(), Failure> {
        self.note(what, found, How::Asked)
    }

    fn unknown(&mut self, what: &'static str, why: &str) -> Result<(), Failure> {
        self.note(what, why, How::NotKnown)
    }

    fn note(&mut self, what: &'static str, found: &str, how: How) -> Result<(), Failure> {
        let found = found.to_owned();
        print(&format!("     -> {what}: {found}\n"))?;
        self.findings.push(Finding { what, found, how });
        Ok(())
    }

    fn summary(&self) -> String {
        let mut text = "\nWhat this robot is:\n".to_owned();
        for Finding { what, found, how } in &self.findings {
            let how = match how {
                How::Measured => "measured",
                How::Asked => "asked",
                How::NotKnown => "not known",
            };
            text.push_str(&format!("  {how:9}  {what:20}  {found}\n"));
        }
        text
    }
}

/// Walks a person through everything that can be found out, and writes the config.
///
/// # Errors
/// A robot that cannot be reached or may not drive, or a person who does not answer. What was found
/// out until then is printed.
pub(super) fn run(args: &DoctorArgs, yes: bool) -> Result<Exit, Failure> {
    let target = TargetArgs {
        settings: args.settings.clone(),
        connection: args.connection.clone(),
    };
    let seed = rand::random();
    let robot = target.resolve(seed)?;
    let parts = robot.driver_parts(seed)?;
    let mut walk = Walk {
        person: Person { yes },
        camera: robot.config.camera,
        low: robot.config.watchdog.low,
        is_docked: true,
        findings: Vec::new(),
        lines: Vec::new(),
        watchdog: Vec::new(),
    };
    if robot.sim.is_none() {
        walk.lines.push(format!("robot: {}", robot.address));
    }
    let exit = block_on(find_out(&mut walk, parts))?;
    print(&walk.summary())?;
    let exit = exit?;
    if exit == Exit::Done {
        conclude(&walk, args)?;
    }
    Ok(exit)
}

async fn find_out(walk: &mut Walk, parts: DriverParts) -> Result<Exit, Failure> {
    let (mut connector, cut) = LinkCut::of(parts.connector);
    let interrupted = interruption()?;
    print(INTRODUCTION)?;
    let standing = tokio::select! {
        biased;
        () = interrupted => return Ok(Exit::Interrupted),
        standing = stand(walk, &mut connector) => standing,
    };
    standing?;
    let parts = DriverParts {
        connector,
        settings: moving::as_reported(parts.settings),
        ..parts
    };
    drive(parts, async |driver| move_about(walk, driver, &cut).await).await
}

/// The steps without the tracks, over a plain link.
async fn stand(walk: &mut Walk, connector: &mut Connector) -> Result<(), Failure> {
    let mut session = connector(vec![Command::STOP].into()).await?;
    walk.is_docked = session.accepted.docked;
    standing::ask_robot(walk, &mut session).await?;
    let hint = "its pose: `spykee calibrate camera` measures it from one picture";
    print("\n2  Its camera looks up or down, and may be tilted.\n")?;
    walk.unknown("camera", hint)?;
    ask_person(walk).await?;
    standing::leave_station(walk, &mut session).await?;
    close_gracefully(session.reader, session.writer, DELIVERY).await;
    Ok(())
}

async fn move_about(walk: &mut Walk, driver: &mut Driver, cut: &LinkCut) -> Result<Exit, Failure> {
    if walk.is_docked {
        for what in ["least power", "POWER is", "without a connection"] {
            walk.unknown(what, "not known: it stands on its station")?;
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
    match walk.person.types(asks).await?.as_str() {
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
            "not known: if it can, set watchdog: { blind_moves: false, rescue: off }",
        ),
    }
}

/// Writes the config, or prints its lines if there is one.
fn conclude(walk: &Walk, args: &DoctorArgs) -> Result<(), Failure> {
    let mut lines = walk.lines.clone();
    if !walk.watchdog.is_empty() {
        lines.push(format!("watchdog: {{ {} }}", walk.watchdog.join(", ")));
    }
    if lines.is_empty() {
        return print("\nNothing to set in the config.\n");
    }
    let text = lines.join("\n") + "\n";
    let path = args.settings.path();
    if create(&path, &text)? {
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
