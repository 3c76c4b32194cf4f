//! `spykee config schedule`: lists the timetable's coming starts, and those that will not happen and why.

use jiff::Timestamp;
use serde_json::{Value, json};

use super::serve::or_now;
use super::settings::SettingsArgs;
use super::table::{Side, aligned};
use super::{Exit, Failure, argument, print};
use crate::clock::{self, Date, Zone};
use crate::timetable::{PredictedStart, Reason, Timetable, predict_starts};

const HEAD: [(&str, Side); 4] = [
    ("WHEN", Side::Left),
    ("BEHAVIOUR", Side::Left),
    ("UNTIL", Side::Left),
    ("", Side::Left),
];

/// List the coming starts of the timetable, and those that will not happen and why
///
/// Reads only the config: it does not know whether the robot will be in reach or what people will
/// start in the meantime.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee config schedule --next 20 --from \"2026-03-28 12:00\"")]
pub(super) struct ScheduleArgs {
    /// Number of starts to show
    #[arg(long, value_name = "COUNT", default_value_t = 10, value_parser = argument::whole::<u16>(1..=1000))]
    next: u16,

    /// Date and time to list from, in the config's time zone [default: now]
    #[arg(long, value_name = "DATE")]
    from: Option<Date>,

    /// Print a JSON array
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    pub(super) settings: SettingsArgs,
}

/// Prints the predicted starts.
pub(super) fn run(args: &ScheduleArgs) -> Result<Exit, Failure> {
    let config = args.settings.config()?;
    let table = config.timetable();
    let names = config
        .behaviours
        .iter()
        .filter_map(|entry| entry.name().ok());
    let names: Vec<String> = names.collect();
    let now = or_now(args.from, config);
    let starts = predict_starts(&table, &names, now, usize::from(args.next));
    if args.json {
        let starts = starts.iter().map(|one| object(one, &table.zone)).collect();
        print(&format!("{}\n", Value::Array(starts)))?;
        return Ok(Exit::Done);
    }
    if !clock::is_plausible(now) {
        tracing::warn!("this computer's clock is not set: a service waits until it is");
    }
    if starts.is_empty() {
        print(&match args.settings.file() {
            Some(file) => format!("{} has no `schedule:`\n", file.display()),
            None => "no config named, no spykee.yaml here: there is no `schedule:`\n".to_owned(),
        })?;
        return Ok(Exit::Done);
    }
    let rows: Vec<Vec<String>> = starts.iter().map(|one| row(one, &table.zone)).collect();
    print(&aligned(&HEAD, &rows))?;
    print(&format!("times in {}\n", table.zone))?;
    Ok(Exit::Done)
}

fn row(one: &PredictedStart, zone: &Zone) -> Vec<String> {
    let day = zone.time(one.at).date();
    let until = one.until.map(|until| {
        let until = zone.time(until);
        if until.date() == day {
            until.strftime("%H:%M").to_string()
        } else {
            clock::describe(&until)
        }
    });
    let notes: Vec<&str> = one.reasons.iter().map(|reason| describe(*reason)).collect();
    vec![
        clock::describe(&zone.time(one.at)),
        one.run.clone(),
        until.unwrap_or_else(|| "it ends".to_owned()),
        notes.join("; "),
    ]
}

fn describe(reason: Reason) -> &'static str {
    match reason {
        Reason::Quiet => "quiet hours: no sounds, no headlight",
        Reason::Overlap => "will not start: it still runs then",
        Reason::Unknown => "will not start: the config has no such behaviour",
    }
}

fn object(one: &PredictedStart, zone: &Zone) -> Value {
    let time = |at: Timestamp| zone.time(at).strftime("%Y-%m-%dT%H:%M:%S%:z").to_string();
    let has = |reason| one.reasons.contains(&reason);
    json!({
        "at": time(one.at), "run": one.run, "until": one.until.map(time), "starts": one.happens(),
        "quiet": has(Reason::Quiet), "overlap": has(Reason::Overlap), "unknown": has(Reason::Unknown),
    })
}

/// Describes the first rule of the timetable that names no behaviour of the config, and lists the
/// behaviours that the config has.
pub(super) fn unknown_behaviour(table: &Timetable, names: &[String]) -> Option<(String, String)> {
    let unknown = *table.unknown(names).first()?;
    let what = format!("the timetable runs `{unknown}`, but the config has no such behaviour");
    let known = if names.is_empty() {
        "the config names no behaviours".to_owned()
    } else {
        format!("the config has {}", names.join(", "))
    };
    Some((what, known))
}
