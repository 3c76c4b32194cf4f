//! What is found out while the tracks stand, and how the robot leaves its station by itself.

use std::time::Duration;

use tokio::time::{Instant, sleep, timeout_at};

use super::super::network::{Execution, execution};
use super::Walk;
use crate::cli::{Failure, print};
use crate::link::Session;
use crate::robot::Battery;
use crate::vision::{Decoder, Glance, drove_forwards};
use crate::wire::{Command, Engage, EngineReport, Report, Stream};

const REPLY_TIMEOUT: Duration = Duration::from_secs(2);
/// How often a question is asked.
const REPEATS: usize = 3;
const LEAVING_TIMEOUT: Duration = Duration::from_secs(15);
/// How long the robot may take to stand after it has reported that it has left.
const COMING_TO_REST: Duration = Duration::from_secs(2);
/// Time between two views that are compared.
const VIEW_INTERVAL: Duration = Duration::from_millis(300);

/// How fast the robot's program is, which questions it answers, and what POWER says.
pub(super) async fn ask_robot(walk: &mut Walk, session: &mut Session) -> Result<(), Failure> {
    print("\n1  It is asked some questions; nothing moves.\n")?;
    let execution = execution(session).await?;
    const SPEED: &str = "executes commands";
    match &execution {
        Execution::Silent => walk.unknown(
            SPEED,
            "not known: it does not say what it has executed; it is sent five a second",
        )?,
        Execution::AtOnce(_) => walk.measured(SPEED, "at once")?,
        Execution::PerSecond(_, rate) => {
            let found = format!("about {} a second", significant(*rate));
            walk.measured(SPEED, &found)?;
        }
    }
    let mut answers = Vec::new();
    for (name, question) in [
        ("POWER", Command::PowerQuery),
        ("CONFIG", Command::ConfigQuery),
        ("LOG", Command::LogQuery),
    ] {
        if execution.question() == Some(&question) || is_answered(session, question).await? {
            answers.push(name);
        }
    }
    let answers = match &answers[..] {
        [] => "none".to_owned(),
        names => names.join(", "),
    };
    walk.measured("answers questions", &answers)?;
    let battery = Battery::reported(session.power);
    let found = match (battery.percent, battery.charging) {
        (Some(level), true) => format!("{level}, charging"),
        (Some(level), false) => level.to_string(),
        (None, charging) => {
            let byte = session.power.to_byte().cast_signed();
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

/// Asks several times: one POWER may come unasked.
async fn is_answered(session: &mut Session, question: Command) -> Result<bool, Failure> {
    let questions = vec![question.clone(); REPEATS];
    session.writer.write(&questions).await?;
    let mut answers = 0;
    let mut until = Instant::now() + REPLY_TIMEOUT;
    while answers < REPEATS
        && let Ok(report) = timeout_at(until, session.reader.next()).await
    {
        let is_answer = match report? {
            Report::Power(_) => question == Command::PowerQuery,
            Report::Config(_) => question == Command::ConfigQuery,
            Report::Log(_) => question == Command::LogQuery,
            _ => false,
        };
        if is_answer {
            answers += 1;
            until = Instant::now() + REPLY_TIMEOUT;
        }
    }
    Ok(answers == REPEATS)
}

/// Lets the robot leave its station, and finds out which way. It does that by itself, and ends it by
/// itself.
pub(super) async fn leave_station(walk: &mut Walk, session: &mut Session) -> Result<(), Failure> {
    const WHAT: &str = "leaves its station";
    print("\n4  It leaves its station, by half a metre or so.\n")?;
    let battery = Battery::reported(session.power);
    if !session.accepted.docked {
        return walk.unknown(WHAT, "not known: it is not on its station");
    }
    if battery.percent.is_some_and(|level| level <= walk.low) {
        return walk.unknown(WHAT, "not known: the battery is low");
    }
    let asks = match battery.percent {
        Some(_) => "Is the way free?",
        None => "Its level is not known. Has it charged for an hour, and is the way free?",
    };
    if !walk.person.agrees(asks).await? {
        return walk.unknown(WHAT, "not known: skipped");
    }
    let video = |on| Command::Stream {
        stream: Stream::Video,
        on,
    };
    session.writer.write(&[video(true)]).await?;
    sleep(COMING_TO_REST / 2).await;
    session
        .writer
        .write(&[Command::Engine(Engage::Undock)])
        .await?;
    let mut until = Instant::now() + LEAVING_TIMEOUT;
    let mut decoder = Decoder::default();
    let mut views: Vec<(Instant, Glance)> = Vec::new();
    let mut has_left = false;
    while let Ok(report) = timeout_at(until, session.reader.next()).await {
        let now = Instant::now();
        match report? {
            Report::Engine(EngineReport::Undocked) => {
                has_left = true;
                until = now + COMING_TO_REST;
            }
            Report::Video(jpeg) => {
                let due = |(last, _): &(Instant, Glance)| now >= *last + VIEW_INTERVAL;
                if views.last().is_none_or(due) {
                    let image = decoder.decode(&jpeg).ok();
                    let view = image.and_then(|image| Glance::new(image, walk.camera));
                    views.extend(view.map(|view| (now, view)));
                }
            }
            _ => {}
        }
    }
    session.writer.write(&[Command::STOP, video(false)]).await?;
    walk.is_docked = !has_left;
    if !has_left {
        return walk.unknown(
            WHAT,
            "not known: it did not say within 15 s that it has left",
        );
    }
    let views: Vec<&Glance> = views.iter().map(|(_, view)| view).collect();
    let seen = drove_forwards(&views);
    let asks = "Did it leave forwards (f) or backwards (b)? Enter: as its pictures say";
    let told = match walk.person.types(asks).await?.as_str() {
        "f" => Some(true),
        "b" => Some(false),
        _ => None,
    };
    let way = |forwards| if forwards { "forwards" } else { "backwards" };
    match (told, seen) {
        (Some(told), _) => walk.asked(WHAT, way(told)),
        (None, Some(seen)) => walk.measured(WHAT, way(seen)),
        (None, None) => walk.unknown(WHAT, "not known: its pictures do not tell"),
    }
}
