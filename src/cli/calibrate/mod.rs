//! `spykee calibrate`: measures the robot's track width and speed with two timed moves and a turn,
//! and with `camera` where its camera is.

mod camera;

use std::f64::consts::{PI, TAU};
use std::io::{BufRead, Read, Write};
use std::ops::RangeInclusive;
use std::time::Duration;

use serde_json::json;

use super::driver::{Driver, drive_target};
use super::settings::CommandSettings;
use super::world::EmbeddedSim;
use super::{ConnectionArgs, Exit, Failure, print, print_json};
use crate::pilot::Status;
use crate::robot::{MotionEnd, Setpoint};
use crate::safety::WatchdogState;
use crate::sanitize;
use crate::script::Calibration;
use crate::sim::{Handle, State};

/// Power of the moves, percent: fast enough to measure, slow enough to watch.
const POWER: f64 = 60.0;
/// Plausible values for a Spykee, metres and metres per second; others are measuring errors.
const WIDTHS: RangeInclusive<f64> = 0.08..=0.8;
const SPEEDS: RangeInclusive<f64> = 0.03..=3.0;
/// Milliseconds of the three steps with a person.
const SHORT: u64 = 1000;
const LONG: u64 = 3000;
const TURN: u64 = 2000;
/// Milliseconds of the steps in the simulator.
const SIM_SHORT: u64 = 1000;
const SIM_LONG: u64 = 1800;
const SIM_TURN: u64 = 1500;
/// Time until the tracks have reached their speed, and until they have stopped again.
const RAMP: Duration = Duration::from_millis(500);
const LEAVING: Duration = Duration::from_secs(20);
const MAX_ANSWER: u64 = 256;

const WELCOME: &str = "\
Put the robot on the floor that it will drive on, off its station, with two metres free ahead of it
and half a metre around it. No stairs, no table, no cables; keep people and animals away while it
moves. Ctrl-C stops it at any time. Lay a tape measure beside it.
";

/// Measure the robot's track width and speed for the config
///
/// Guides you through two moves straight ahead and a turn on the spot, asks how far the robot
/// really went, and computes `calibration:` from your answers. Every step can be repeated. With
/// --sim the simulator does the measuring. Put the robot off its station, on the floor that it will
/// drive on, with two metres free ahead, no stairs and no people in the way. Ctrl-C stops the
/// robot.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Examples:\n  spykee calibrate --robot 172.17.6.1\n  \
                        spykee calibrate --sim --json\n  \
                        spykee calibrate camera --robot 172.17.6.1")]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct CalibrateArgs {
    #[command(subcommand)]
    what: Option<CalibrateCommand>,

    /// Print a JSON object; questions go to stderr
    #[arg(long)]
    json: bool,

    /// Seed for simulator noise [default: random]
    #[arg(long, value_name = "NUMBER")]
    seed: Option<u64>,

    #[command(flatten)]
    connection: ConnectionArgs,
}

#[derive(Debug, Clone, clap::Subcommand)]
enum CalibrateCommand {
    Camera(camera::CameraArgs),
}

pub(super) fn run(args: &CalibrateArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    if let Some(CalibrateCommand::Camera(args)) = &args.what {
        return camera::run(args, settings);
    }
    let seed = args.seed.unwrap_or_else(rand::random);
    let target = args.connection.resolve(settings, seed)?;
    let simulator = target.sim.as_ref().map(EmbeddedSim::handle);
    let mut measured = None;
    let exit = drive_target(&target, seed, async |driver| {
        let round = match &simulator {
            Some(handle) => measure_in_simulator(driver, handle).await?,
            None => measure_with_person(driver, args.json).await?,
        };
        measured = Some(round.calibration(target.config.calibration)?);
        Ok(Exit::Done)
    })?;
    match measured {
        Some(calibration) => conclude(args.json, calibration),
        None => Ok(exit),
    }
}

/// Returns an error with help if the robot may not drive.
pub(super) fn ready(status: Status) -> Result<(), Failure> {
    if status.low {
        let failure = Failure::new(Exit::Safety, "the battery is low: the robot may not drive");
        return Err(failure.help("charge the robot first"));
    }
    if status.safety == WatchdogState::Docked {
        let failure = Failure::new(Exit::Failed, "the robot is on its station");
        return Err(failure.help("`spykee robot undock`, then put it on free floor"));
    }
    Ok(())
}

/// Drives once. A motion that is cut short is an error: it would spoil the measurement.
pub(super) async fn drive_once(
    driver: &mut Driver,
    setpoint: Setpoint,
    duration: Duration,
) -> Result<(), Failure> {
    ready(driver.status())?;
    let drives = driver.ask(async |client| client.run(setpoint, duration).await);
    let end = drives.await?;
    let (exit, help) = match end {
        MotionEnd::Done => return Ok(()),
        MotionEnd::Safety => (Exit::Safety, "charge the robot first"),
        MotionEnd::Disconnected => (
            Exit::Unreachable,
            "is the robot still in reach of its Wi-Fi?",
        ),
        _ => (Exit::Failed, "start again, on free floor"),
    };
    let what = format_args!("the move was cut short: {end}");
    Err(Failure::new(exit, what).help(help))
}

fn conclude(json: bool, calibration: Calibration) -> Result<Exit, Failure> {
    if json {
        return print_json(&json!(calibration));
    }
    let line = config_line(calibration);
    print(&format!(
        "\n{line}\nPaste this line into your config, in place of its `calibration:` if it has one.\n"
    ))
}

pub(super) fn config_line(calibration: Calibration) -> String {
    let Calibration {
        track_width,
        full_speed,
        least_power,
    } = calibration;
    // Measurements are no more precise than a tenth of a millimetre.
    format!(
        "calibration: {{ track_width: {track_width:.4}, full_speed: {full_speed:.4}, \
         least_power: {least_power} }}"
    )
}

fn straight(percent: f64) -> Setpoint {
    Setpoint::from_percent(percent, percent).unwrap_or(Setpoint::STOP)
}

/// A turn on the spot, to the left with positive power.
pub(super) fn turn(percent: f64) -> Setpoint {
    Setpoint::from_percent(-percent, percent).unwrap_or(Setpoint::STOP)
}

/// One round: the speeds of driving and turning at [`POWER`].
#[derive(Debug, Clone, Copy, PartialEq)]
struct Measured {
    /// Metres per second.
    speed: f64,
    /// Radians per second.
    turning: f64,
}

impl Measured {
    /// The calibration, with what was not measured from the one in use.
    fn calibration(self, used: Calibration) -> Result<Calibration, Failure> {
        let full_speed = self.speed / (POWER / 100.0);
        // When turning on the spot, the tracks run in opposite directions at this speed.
        let track_width = 2.0 * self.speed / self.turning;
        if SPEEDS.contains(&full_speed) && WIDTHS.contains(&track_width) {
            return Ok(Calibration {
                full_speed,
                track_width,
                ..used
            });
        }
        let what = format_args!(
            "implausible result: {full_speed:.2} m/s at full power, {track_width:.2} m between the tracks"
        );
        let help = "measure again: distances in centimetres; a full turn counts as 360 degrees";
        Err(Failure::new(Exit::Failed, what).help(help))
    }
}

/// Drives two moves and a turn, and asks the person for each result.
async fn measure_with_person(driver: &mut Driver, json: bool) -> Result<Measured, Failure> {
    ready(driver.status())?;
    say(json, WELCOME)?;
    let how_far = "How far did it go, in centimetres? (r: repeat) ";
    let first = "1/3  It drives forwards for one second.";
    let short = ask(driver, json, first, straight(POWER), SHORT, how_far).await? / 100.0;
    let next = "2/3  Put it back at the start. It drives forwards for three seconds.";
    let long = ask(driver, json, next, straight(POWER), LONG, how_far).await? / 100.0;
    let next = "3/3  Mark where it faces. It turns left on the spot for two seconds.";
    let how_much = "How many degrees did it turn? A full turn counts as 360. (r: repeat) ";
    let degrees = ask(driver, json, next, turn(POWER), TURN, how_much).await?;
    // The difference of two moves cancels the effect of starting and stopping.
    Ok(Measured {
        speed: (long - short) / (LONG - SHORT) as f64 * 1000.0,
        turning: degrees.to_radians() / TURN as f64 * 1000.0,
    })
}

/// Drives one step, repeated as often as the person likes, and returns the person's measurement.
async fn ask(
    driver: &mut Driver,
    json: bool,
    what: &str,
    setpoint: Setpoint,
    millis: u64,
    question: &str,
) -> Result<f64, Failure> {
    loop {
        say(
            json,
            &format!("\n{what}\n     Is the way free? Enter starts it. "),
        )?;
        answer().await?;
        drive_once(driver, setpoint, Duration::from_millis(millis)).await?;
        loop {
            say(json, &format!("     {question}"))?;
            let typed = answer().await?.replace(',', ".");
            match typed.parse::<f64>() {
                Ok(number) if number.is_finite() && number > 0.0 => return Ok(number),
                _ if typed == "r" => break,
                _ => say(json, "     Type a number, such as 27.5, or r.\n")?,
            }
        }
    }
}

/// Prints to the person: on stdout, or on stderr if stdout is for JSON.
fn say(json: bool, text: &str) -> Result<(), Failure> {
    if !json {
        return print(text).map(drop);
    }
    let mut err = std::io::stderr().lock();
    err.write_all(sanitize::text(text, false).as_bytes())
        .map_err(|error| Failure::io("write to stderr", error))
}

/// Waits for a line on a separate thread, so that the pilot keeps running and Ctrl-C works.
pub(super) async fn answer() -> Result<String, Failure> {
    let typed = tokio::task::spawn_blocking(line).await;
    typed.unwrap_or_else(|error| Err(Failure::internal(format_args!("no answer: {error}"))))
}

fn line() -> Result<String, Failure> {
    let mut line = String::new();
    let read = std::io::stdin()
        .lock()
        .take(MAX_ANSWER)
        .read_line(&mut line);
    match read {
        Ok(1..) => Ok(line.trim().to_owned()),
        Ok(0) => Err(
            Failure::usage("no answer: this needs a person at the terminal")
                .help("--sim measures without a person"),
        ),
        Err(error) => Err(Failure::io("read the answer", error)),
    }
}

/// Drives back and forth, short and long, and turns each way: the robot ends where it began.
async fn measure_in_simulator(driver: &mut Driver, sim: &Handle) -> Result<Measured, Failure> {
    if driver.status().safety == WatchdogState::Docked && !driver.status().low {
        driver
            .ask(async |client| client.undock(LEAVING).await)
            .await?;
    }
    ready(driver.status())?;
    let mut speeds = Vec::new();
    for millis in [SIM_SHORT, SIM_LONG] {
        for percent in [-POWER, POWER] {
            let seen = watch(driver, sim, straight(percent), millis).await?;
            speeds.push(rate(&seen, |a, b| a.pose.point().distance(b.pose.point()))?);
        }
    }
    let mut turnings = Vec::new();
    for percent in [POWER, -POWER] {
        let seen = watch(driver, sim, turn(percent), SIM_TURN).await?;
        turnings.push(rate(&seen, |a, b| turned(a, b).abs())?);
    }
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    Ok(Measured {
        speed: mean(&speeds),
        turning: mean(&turnings),
    })
}

/// Drives a step and returns the states while the tracks are at full speed.
async fn watch(
    driver: &mut Driver,
    sim: &Handle,
    setpoint: Setpoint,
    millis: u64,
) -> Result<Vec<State>, Failure> {
    let before = sim.state().collisions;
    let mut seen = Vec::<State>::new();
    let driving = drive_once(driver, setpoint, Duration::from_millis(millis));
    tokio::pin!(driving);
    let mut last = sim.state().time;
    loop {
        tokio::select! {
            biased;
            ended = &mut driving => {
                ended?;
                break;
            }
            state = sim.wait_state(|state| state.time > last) => {
                last = state.time;
                seen.push(state);
            }
        }
    }
    tokio::time::sleep(RAMP).await;
    if sim.state().collisions > before {
        let failure = Failure::new(Exit::Failed, "the simulated robot ran into something");
        return Err(failure.help("choose a world with a metre free around the robot"));
    }
    seen.retain(|state| state.commanded.left != 0);
    let begin = seen.first().map_or(last, |state| state.time) + RAMP;
    seen.retain(|state| state.time >= begin);
    Ok(seen)
}

/// Mean rate of change from the first to the last state.
fn rate(seen: &[State], between: impl Fn(&State, &State) -> f64) -> Result<f64, Failure> {
    let way: f64 = seen
        .windows(2)
        .map(|pair| between(&pair[0], &pair[1]))
        .sum();
    let time = match seen {
        [first, .., last] => (last.time - first.time).as_secs_f64(),
        _ => 0.0,
    };
    // A shorter span means that this computer was suspended or overloaded.
    if time < 0.2 {
        let failure = Failure::new(Exit::Failed, "too few states from the simulator");
        return Err(failure.help("is this computer overloaded? Try again"));
    }
    Ok(way / time)
}

/// Radians turned from one state to the next, at most half a turn.
fn turned(before: &State, after: &State) -> f64 {
    (after.pose.heading - before.pose.heading + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_and_an_angle_give_speed_and_width() {
        // 0.45 m/s and 0.24 m at 60 %: 0.27 m/s, 2.25 rad/s; 3 cm are lost at the start.
        let measured = Measured {
            speed: (0.78 - 0.24) / (3.0 - 1.0),
            turning: 4.5 / 2.0,
        };
        let calibration = measured.calibration(Calibration::default()).unwrap();
        assert!((calibration.full_speed - 0.45).abs() < 1e-9);
        assert!((calibration.track_width - 0.24).abs() < 1e-9);
    }

    #[test]
    fn implausible_measurements_are_refused() {
        for (speed, turning) in [
            (0.27, 0.0),
            (-0.2, 2.0),
            (0.27, -2.0),
            (f64::NAN, 1.0),
            (9.0, 2.0),
        ] {
            let round = Measured { speed, turning };
            let told = round.calibration(Calibration::default());
            assert!(told.is_err(), "{speed} {turning}");
        }
    }
}
