//! `spykee config`: shows the settings and their origins, checks config files, and shows what their
//! timetable and notification targets come to.

use std::path::{Path, PathBuf};

use clap::Subcommand;
use serde_json::{Value as Json, json};

use super::notify::TestArgs;
use super::schedule::{ScheduleArgs, unknown_behaviour};
use super::settings::SettingsArgs;
use super::{Exit, Failure, notify, print, schedule};
use crate::config::{self, Config, Setting};

/// Show the settings and where they come from, check a config file, list its coming starts, test its
/// notification targets
#[derive(Debug, Clone, clap::Args)]
pub(super) struct ConfigArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Clone, Subcommand)]
enum Action {
    /// Print the settings in effect: $SPYKEE_ROBOT overrides the file, which overrides the defaults
    Show(ShowArgs),
    /// Check a config file
    Check {
        /// Config file [default: the one of --config, or else $SPYKEE_CONFIG, or else spykee.yaml]
        #[arg(value_name = "FILE")]
        file: Option<PathBuf>,

        #[command(flatten)]
        settings: SettingsArgs,
    },
    Schedule(ScheduleArgs),
    TestNotify(TestArgs),
    /// Print the JSON Schema of the config, for editors
    Schema,
}

#[derive(Debug, Clone, clap::Args)]
struct ShowArgs {
    #[command(flatten)]
    settings: SettingsArgs,

    /// Show where each value comes from
    #[arg(long)]
    origin: bool,

    /// Print a JSON array, with origins
    #[arg(long)]
    json: bool,
}

impl ConfigArgs {
    pub(super) fn settings(&self) -> Option<&SettingsArgs> {
        match &self.action {
            Action::Show(args) => Some(&args.settings),
            Action::Check { settings, .. } => Some(settings),
            Action::Schedule(args) => Some(&args.settings),
            Action::TestNotify(args) => Some(&args.settings),
            Action::Schema => None,
        }
    }
}

/// Shows or checks the settings. Only the test of notification targets reads secrets.
pub(super) fn run(args: &ConfigArgs) -> Result<Exit, Failure> {
    match &args.action {
        Action::Show(args) => show(args),
        Action::Check { file, settings } => match file {
            Some(file) => check(file),
            None => check(&settings.path()),
        },
        Action::Schedule(args) => schedule::run(args),
        Action::TestNotify(args) => notify::run(args),
        Action::Schema => {
            print(&format!("{:#}\n", config::schema()))?;
            Ok(Exit::Done)
        }
    }
}

fn check(file: &Path) -> Result<Exit, Failure> {
    let config = Config::load(file).map_err(|error| Failure::new(Exit::Check, error))?;
    let missing = config.behaviours.iter().find(|entry| !entry.file.is_file());
    if let Some(entry) = missing {
        let file = file.display();
        let script = entry.file.display();
        let what = format_args!("{file}: there is no behaviour {script}");
        return Err(
            Failure::new(Exit::Check, what).help("paths are relative to the config's folder")
        );
    }
    let names = config
        .behaviours
        .iter()
        .filter_map(|entry| entry.name().ok());
    let names: Vec<String> = names.collect();
    if let Some((what, known)) = unknown_behaviour(&config.timetable(), &names) {
        let what = format!("{}: {what}", file.display());
        return Err(Failure::new(Exit::Check, what).help(known));
    }
    print(&format!("{}: valid\n", file.display()))?;
    Ok(Exit::Done)
}

fn show(args: &ShowArgs) -> Result<Exit, Failure> {
    let settings = args.settings.load()?.settings();
    print(&if args.json {
        format!(
            "{:#}\n",
            Json::Array(settings.iter().map(as_json).collect())
        )
    } else {
        settings
            .iter()
            .map(|setting| line(setting, args.origin))
            .collect()
    })?;
    Ok(Exit::Done)
}

fn as_json(setting: &Setting) -> Json {
    json!({
        "key": setting.key,
        "value": serde_json::to_value(&setting.value).unwrap_or(Json::Null),
        "origin": setting.origin,
    })
}

fn line(setting: &Setting, origin: bool) -> String {
    let value = serde_json::to_value(&setting.value).unwrap_or(Json::Null);
    let value = match value {
        Json::Null => "-".to_owned(),
        Json::String(text) => text,
        other => other.to_string(),
    };
    if origin {
        format!("{:<34} {value:<16} {}\n", setting.key, setting.origin)
    } else {
        format!("{:<34} {value}\n", setting.key)
    }
}
