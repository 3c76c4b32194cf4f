//! `spykee config test-notify`, and the notifications of a run: reads the config's targets and
//! their secrets.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use tokio_util::sync::CancellationToken;

use super::settings::CommandSettings;
use super::{Exit, Failure, fleet, print, secret};
use crate::agent::Bus;
use crate::config::Effective;
use crate::mqtt::publish;
use crate::notify::{BrokerPublisher, Delivery, Notice, Notifier, Options, Rule, Target, deliver};

/// Time limit for the last deliveries at the end of a run.
pub(super) const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(3);

/// The picture of a test: who tries out a target sees whether pictures arrive.
const EXAMPLE: &[u8] = include_bytes!("../../behaviours/guide/pictures/seen.jpg");

/// Send a message to some or all notification targets and print the result of each delivery
///
/// Sends at once, without queue, rules or rate limits. The exit code is 4 if a delivery failed.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Example: spykee config test-notify phone --picture spykee-data/guard/1.jpg"
)]
pub(super) struct TestArgs {
    /// Names of targets in the config's `notify: { targets: ... }` [default: all]
    #[arg(value_name = "TARGET")]
    targets: Vec<String>,

    /// Text of the message
    #[arg(long, default_value = "a test of spykee's notifications")]
    text: String,

    /// JPEG picture to attach [default: one of a simulated robot]
    #[arg(long, value_name = "FILE.jpg")]
    picture: Option<PathBuf>,
}

pub(super) fn run(args: &TestArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let settings = settings.load()?;
    let options = &settings.config.notify;
    let chosen = chosen(options, &args.targets)?;
    let tokens = tokens(settings, chosen.iter().copied())?;
    let publisher = publisher(settings)?;
    let folder = tempfile::tempdir().map_err(|error| Failure::io("create a folder", error))?;
    let picture = match &args.picture {
        Some(picture) => absolute(picture)?,
        None => example_in(folder.path())?,
    };
    let notice = Notice {
        rule: Rule::Test,
        text: args.text.clone(),
        robot: "spykee".to_owned(),
        at: 0,
        time: String::new(),
        picture: Some(picture),
    };
    let notice = notice.at(Timestamp::now(), &settings.config.zone());
    let mut exit = Exit::Done;
    let never = CancellationToken::new();
    for (name, target) in chosen {
        let token = tokens.get(name).map_or("", String::as_str);
        let outcome = match deliver(target, token, &publisher, &notice, &never) {
            Delivery::Done => "sent".to_owned(),
            Delivery::Later(why) | Delivery::Refused(why) => {
                exit = Exit::Check;
                format!("not sent: {why}")
            }
        };
        print(&format!("{name}: {outcome}\n"))?;
    }
    Ok(exit)
}

/// Writes a picture to this folder, as if a script had saved it.
fn example_in(folder: &Path) -> Result<PathBuf, Failure> {
    let path = folder.join("test.jpg");
    let written = std::fs::write(&path, EXAMPLE);
    written.map_err(|error| Failure::unwritable(&path, error))?;
    Ok(path)
}

fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    path.canonicalize()
        .map_err(|error| Failure::unreadable_file("the picture", path, error))
}

fn chosen<'a>(
    options: &'a Options,
    names: &[String],
) -> Result<Vec<(&'a String, &'a Target)>, Failure> {
    if options.targets.is_empty() {
        return Err(Failure::usage("the config names no target to notify").help(
            "add notify: { targets: { phone: { url: \"https://ntfy.sh/your-topic\" } } }; \
             see the book's chapter Notifications",
        ));
    }
    if names.is_empty() {
        return Ok(options.targets.iter().collect());
    }
    let find = |name: &String| {
        options.targets.get_key_value(name).ok_or_else(|| {
            let known: Vec<&str> = options.targets.keys().map(String::as_str).collect();
            Failure::usage(format_args!("there is no target {name}"))
                .help(format!("the config has {}", known.join(", ")))
        })
    };
    names.iter().map(find).collect()
}

/// The notifications of a run, if the config wants any. One that was found in the current folder may have
/// come from anywhere: it sends nothing to anybody.
pub(super) fn start(settings: &Effective, bus: &Bus) -> Result<Option<Notifier>, Failure> {
    let options = &settings.config.notify;
    if options.targets.is_empty() {
        return Ok(None);
    }
    if let Some(config) = settings.found_file() {
        let what = format_args!(
            "the config {} would send messages and pictures to its targets, but was found in the \
             current folder, not named",
            config.display()
        );
        return Err(secret::refuse_found(config, what));
    }
    let tokens = tokens(settings, &options.targets)?;
    let data = settings.config.data_folder();
    let zone = settings.config.zone();
    let publisher = publisher(settings)?;
    let started = Notifier::start(bus, data, zone, options, &tokens, &publisher);
    Ok(started.map_err(|error| tracing::warn!("{error}")).ok())
}

/// The function that publishes to the broker, if a target is a topic.
fn publisher(settings: &Effective) -> Result<BrokerPublisher, Failure> {
    if settings.config.notify.needs_broker().is_none() {
        return Ok(None);
    }
    let Some(account) = fleet::account(settings)? else {
        return Ok(None);
    };
    Ok(Some(Arc::new(move |topic, payload| {
        publish(&account, topic, payload)
    })))
}

/// The secrets of those of these targets that have one, by name.
fn tokens<'a>(
    settings: &Effective,
    targets: impl IntoIterator<Item = (&'a String, &'a Target)>,
) -> Result<BTreeMap<String, String>, Failure> {
    let found = settings.found_file();
    let mut tokens = BTreeMap::new();
    for (name, target) in targets {
        if let Some(config) = found {
            trusted(name, target, config)?;
        }
        if let Some(token) = token(name, target, found)? {
            tokens.insert(name.clone(), token);
        }
    }
    Ok(tokens)
}

/// Refuses targets of a config that was found in the current folder if they start programs or use
/// a broker: such a config may have come from anywhere.
fn trusted(name: &str, target: &Target, config: &Path) -> Result<(), Failure> {
    let what = match target {
        Target { command, .. } if !command.is_empty() => "runs a program",
        Target { topic: Some(_), .. } => "uses a broker",
        _ => return Ok(()),
    };
    let what = format_args!(
        "the target {name} {what}, but its config {} was found in the current folder, not named",
        config.display()
    );
    Err(secret::refuse_found(config, what))
}

fn token(name: &str, target: &Target, found: Option<&Path>) -> Result<Option<String>, Failure> {
    let read = secret::from_optional_file(target.token_file.as_deref(), found);
    read.map_err(|failure| Failure {
        what: format!("the target {name}: {}", failure.what),
        ..failure
    })
}
