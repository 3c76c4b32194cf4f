//! `spykee config`: shows the settings and their origins, checks config files, and shows what their
//! timetable and notification targets come to.

use std::path::{Path, PathBuf};

use clap::Subcommand;
use jiff::Timestamp;
use serde_json::{Value as Json, json};

use super::notify::TestArgs;
use super::settings::CommandSettings;
use super::table::aligned;
use super::usable::check_config;
use super::{Console, Exit, Failure, argument, notify, print, print_json};
use crate::clock::{self, Clock, Date, Zone};
use crate::config::{self, Config, Setting};
use crate::sanitize;
use crate::timetable::{PredictedStart, Reason, Timetable, predict_starts};

#[derive(Debug, Clone, Subcommand)]
pub(super) enum Action {
    /// Print the settings in effect: $SPYKEE_ROBOT overrides the file, which overrides the defaults
    Show {
        /// Show where each value comes from
        #[arg(long)]
        origin: bool,

        /// Print a JSON array, with origins
        #[arg(long)]
        json: bool,
    },
    /// Check a config file: also its scripts and their parameters, its timetable, its files with
    /// secrets, and the access to its page
    Check {
        /// Config file [default: the one of --config, or else $SPYKEE_CONFIG, or else spykee.yaml]
        #[arg(value_name = "FILE")]
        file: Option<PathBuf>,
    },
    Schedule(ScheduleArgs),
    TestNotify(TestArgs),
    /// Print the JSON Schema of the config, for editors
    Schema,
}

impl Action {
    pub(super) fn uses_settings(&self) -> bool {
        !matches!(self, Action::Schema)
    }
}

/// Shows or checks the settings. Only the test of notification targets reads secrets.
pub(super) fn run(
    action: &Action,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    match action {
        Action::Show { origin, json } => show(*origin, *json, settings),
        Action::Check { file } => check(&file.clone().unwrap_or_else(|| settings.path()), console),
        Action::Schedule(args) => schedule(args, settings),
        Action::TestNotify(args) => notify::run(args, settings),
        Action::Schema => print(&format!("{:#}\n", config::schema())),
    }
}

fn check(file: &Path, console: &Console) -> Result<Exit, Failure> {
    let config = Config::load(file).map_err(|error| Failure::new(Exit::Check, error))?;
    check_config(file, &config, console)?;
    print(&format!("{}: valid\n", file.display()))
}

fn show(origin: bool, json: bool, settings: &CommandSettings) -> Result<Exit, Failure> {
    let settings = settings.load()?.settings();
    print(&if json {
        format!("{:#}\n", json!(settings))
    } else {
        settings
            .iter()
            .map(|setting| line(setting, origin))
            .collect()
    })
}

fn line(setting: &Setting, origin: bool) -> String {
    let value = serde_json::to_value(&setting.value).unwrap_or(Json::Null);
    let value = match value {
        Json::Null => "-".to_owned(),
        value => sanitize::json_text(&value),
    };
    if origin {
        format!("{:<34} {value:<16} {}\n", setting.key, setting.origin)
    } else {
        format!("{:<34} {value}\n", setting.key)
    }
}

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
}

fn schedule(args: &ScheduleArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let config = settings.config()?;
    let table = config.timetable();
    let now = match args.from {
        Some(date) => date.at(&config.zone()),
        None => Clock::default().now(),
    };
    let starts = predict_starts(&table, &names(config), now, usize::from(args.next));
    if args.json {
        let starts: Vec<Json> = starts.iter().map(|one| object(one, &table.zone)).collect();
        return print_json(&starts);
    }
    if !clock::is_plausible(now) {
        tracing::warn!("this computer's clock is not set: a service waits until it is");
    }
    if starts.is_empty() {
        return print(&match settings.file() {
            Some(file) => format!("{} has no `schedule:`\n", file.display()),
            None => "no config named, no spykee.yaml here: there is no `schedule:`\n".to_owned(),
        });
    }
    let rows = starts.iter().map(|one| row(one, &table.zone));
    print(&aligned("WHEN|BEHAVIOUR|UNTIL|", rows))?;
    print(&format!("times in {}\n", table.zone))
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

fn object(one: &PredictedStart, zone: &Zone) -> Json {
    let time = |at: Timestamp| zone.time(at).strftime("%Y-%m-%dT%H:%M:%S%:z").to_string();
    let has = |reason| one.reasons.contains(&reason);
    json!({
        "at": time(one.at), "run": one.run, "until": one.until.map(time), "starts": one.happens(),
        "quiet": has(Reason::Quiet), "overlap": has(Reason::Overlap), "unknown": has(Reason::Unknown),
    })
}

fn names(config: &Config) -> Vec<String> {
    let entries = config.behaviours.iter();
    entries.filter_map(|entry| entry.name().ok()).collect()
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
