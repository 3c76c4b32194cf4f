//! `spykee history`: shows the journal as a table, as JSON or CSV.

mod moment;
mod runs;
mod view;

use std::path::Path;

use clap::ValueEnum;
use jiff::Timestamp;
use jiff::tz::TimeZone;

use self::view::View;
use super::settings::SettingsArgs;
use super::{Exit, Failure, print};
use crate::journal::{JournalReader, Kinds, Record, Span};

/// Show the journal: links, battery, docks, alarms, runs, pictures, entries by scripts
///
/// `spykee serve` keeps a journal; `spykee run` keeps one with `journal: { record: on }` in the
/// config. Times are local. The page draws the same journal: spykee run --live, or a service.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee history --since 1d\n  spykee history docks --since 2026-11-01 \
                        --csv > docks.csv"
)]
pub(super) struct HistoryArgs {
    /// Kind of entries to show
    #[arg(value_enum, default_value_t = Topic::All)]
    topic: Topic,

    /// Only entries since this time: an age (30m, 12h, 7d), a date (2026-11-01), or a date and a
    /// time (2026-11-01T21:30) [default: the newest 1000 entries]
    #[arg(long, value_name = "WHEN", value_parser = moment::parse)]
    since: Option<moment::Moment>,

    /// Only entries until this time, in the same form
    #[arg(long, value_name = "WHEN", value_parser = moment::parse)]
    until: Option<moment::Moment>,

    /// Only entries of this robot
    #[arg(long, value_name = "UID")]
    robot: Option<String>,

    /// Print a JSON array
    #[arg(long, conflicts_with = "csv")]
    json: bool,

    /// Print CSV for spreadsheets
    #[arg(long)]
    csv: bool,

    #[command(flatten)]
    pub(super) settings: SettingsArgs,
}

/// The entries to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Topic {
    /// Everything except the battery level
    All,
    /// The battery level, each minute and at each change
    Battery,
    /// Connections to the robot: when the link was up and down
    Link,
    /// Dockings and undockings: how they ended, tries, time
    Docks,
    /// Watchdog actions, STOP, behaviours that were given up, missed starts, events that were lost
    Alarms,
    /// Behaviours: start, end, and how they ended
    Runs,
    /// Pictures and their paths
    Pictures,
    /// Entries that scripts added with journal.add
    Entries,
    /// Messages that scripts sent with notify.send
    Messages,
}

impl Topic {
    fn kinds(self) -> Kinds {
        Kinds::Of(match self {
            Topic::All => return Kinds::All,
            Topic::Battery => &["battery"],
            Topic::Link => &["link_up", "link_down"],
            Topic::Docks => &["dock", "undock"],
            Topic::Alarms => &[
                "safety",
                "given_up",
                "start_missed",
                "stop_engaged",
                "stop_reset",
                "lost",
            ],
            Topic::Runs => &["started", "ended"],
            Topic::Pictures => &["picture"],
            Topic::Entries => &["entry"],
            Topic::Messages => &["notify"],
        })
    }
}

const DEFAULT_LIMIT: u32 = 1000;

pub(super) fn run(args: &HistoryArgs) -> Result<Exit, Failure> {
    let config = args.settings.config()?;
    let data = config.data_folder();
    let zone = config.zone().time_zone().clone();
    let now = Timestamp::now();
    let resolve = |moment: &Option<moment::Moment>| {
        let moment = moment.as_ref().map(|moment| moment.resolve(now, &zone));
        moment.transpose().map_err(Failure::usage)
    };
    let span = Span {
        since: resolve(&args.since)?,
        until: resolve(&args.until)?,
        robot: args.robot.clone(),
        newest: None,
    };
    list(args, &open(data)?, span, &zone)
}

fn open(data: &Path) -> Result<JournalReader, Failure> {
    let data_shown = data.display();
    match JournalReader::open(data) {
        Ok(Some(history)) => Ok(history),
        Ok(None) => Err(
            Failure::usage(format_args!("there is no journal in {data_shown}")).help(
                "`spykee serve` keeps one, and with `journal: { record: on }` in the config `spykee \
                 run` too; --config selects another config and its data folder",
            ),
        ),
        Err(error) => {
            let doing = format_args!("read the journal in {data_shown}");
            Err(Failure::io(doing, error))
        }
    }
}

fn list(
    args: &HistoryArgs,
    history: &JournalReader,
    mut span: Span,
    zone: &TimeZone,
) -> Result<Exit, Failure> {
    let limited = span.since.is_some();
    if !limited {
        span.newest = Some(DEFAULT_LIMIT);
    }
    let records = match args.topic {
        Topic::Battery => history.battery(&span),
        topic => history.records(&topic.kinds(), &span),
    };
    let records = records.map_err(unreadable)?;
    if !limited && records.len() == DEFAULT_LIMIT as usize {
        tracing::warn!("only the newest {DEFAULT_LIMIT} entries are shown; --since shows more");
    }
    if args.json {
        let text = serde_json::to_string(&records).map_err(Failure::internal)?;
        print(&format!("{text}\n"))?;
        return Ok(Exit::Done);
    }
    let view = view(args.topic, &records, zone);
    if args.csv {
        print(&view.csv())?;
    } else if view.is_empty() {
        print("the journal has no such entries\n")?;
    } else {
        print(&view.table())?;
    }
    Ok(Exit::Done)
}

fn view(topic: Topic, records: &[Record], zone: &TimeZone) -> View {
    let columns: &'static [&'static str] = match topic {
        Topic::All | Topic::Alarms => &["time", "robot", "event", "what"],
        Topic::Battery => &["time", "robot", "percent", "charging"],
        Topic::Link => &["time", "robot", "link", "what"],
        Topic::Docks => &["time", "robot", "event", "by", "end", "attempts", "seconds"],
        Topic::Runs => return View::of_runs(&runs::runs(records), zone),
        Topic::Pictures => &["time", "behaviour", "path"],
        Topic::Entries => &["time", "behaviour", "kind", "fields"],
        Topic::Messages => &["time", "behaviour", "text", "picture"],
    };
    View::new(columns, records, zone)
}

fn unreadable(error: crate::journal::JournalError) -> Failure {
    Failure::io("read the journal", error)
}
