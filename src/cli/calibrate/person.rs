//! Measurements by a person with a tape measure.

use std::io::{BufRead, Read, Write};

use super::measure::{Measured, Plan};
use super::{ready, step};
use crate::cli::driver::Driver;
use crate::cli::{Failure, print};
use crate::sanitize;

/// Milliseconds of the three steps.
const SHORT: u64 = 1000;
const LONG: u64 = 3000;
const TURN: u64 = 2000;
/// Maximum length of an answer, bytes.
const MAX_ANSWER: u64 = 256;

const WELCOME: &str = "\
Put the robot on the floor that it will drive on, off its station, with two metres free ahead of it
and half a metre around it. No stairs, no table, no cables; keep people and animals away while it
moves. Ctrl-C stops it at any time. Lay a tape measure beside it.
";

/// Drives two moves and a turn, and asks the person for each result.
pub(super) async fn round(driver: &mut Driver, json: bool) -> Result<Measured, Failure> {
    ready(driver.status())?;
    say(json, WELCOME)?;
    let ahead = |millis| Plan::straight(1.0, millis);
    let how_far = "How far did it go, in centimetres? (r: repeat) ";
    let short = ask(
        driver,
        json,
        "1/3  It drives forwards for one second.",
        ahead(SHORT),
        how_far,
    );
    let short = short.await? / 100.0;
    let next = "2/3  Put it back at the start. It drives forwards for three seconds.";
    let long = ask(driver, json, next, ahead(LONG), how_far).await? / 100.0;
    let next = "3/3  Mark where it faces. It turns left on the spot for two seconds.";
    let how_much = "How many degrees did it turn? A full turn counts as 360. (r: repeat) ";
    let degrees = ask(driver, json, next, Plan::turn(1.0, TURN), how_much).await?;
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
    plan: Plan,
    question: &str,
) -> Result<f64, Failure> {
    loop {
        say(
            json,
            &format!("\n{what}\n     Is the way free? Enter starts it. "),
        )?;
        answer().await?;
        step(driver, plan).await?;
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
        return print(text);
    }
    let mut err = std::io::stderr().lock();
    err.write_all(sanitize::text(text, false).as_bytes())
        .map_err(|error| Failure::io("write to stderr", error))
}

/// Waits for a line on a separate thread, so that the pilot keeps running and Ctrl-C works.
pub(in crate::cli) async fn answer() -> Result<String, Failure> {
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
