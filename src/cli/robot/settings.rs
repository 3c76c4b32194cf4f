//! `spykee robot config` and `wifi`: print the robot's settings, and change them after a typed
//! confirmation. Keys and passwords are never shown.

use std::io::{BufRead, IsTerminal, Read};
use std::path::Path;

use serde_json::{Map, Value, json};

use super::session::{RobotSession, with_exclusive_session};
use crate::cli::settings::CommandSettings;
use crate::cli::table::{aligned, or_dash};
use crate::cli::{ConnectionArgs, Exit, Failure, print, print_json};
use crate::wire::{Command, Network, Setting, join_settings, parse_networks, parse_settings};

/// Printed in place of a secret value.
const HIDDEN: &str = "***";
/// Settings whose key contains one of these are secret.
const SECRETS: [&str; 7] = ["key", "pass", "psk", "pwd", "secret", "wep", "wpa"];
/// Settings whose key contains one of these concern the network.
const NETWORK: [&str; 7] = ["wifi", "wlan", "essid", "ssid", "wep", "wpa", "channel"];
/// Maximum length of a key and its value, characters.
const MAX_VALUE: usize = 255;

#[derive(Debug, Clone, clap::Args)]
pub(in crate::cli) struct SettingArgs {
    /// Change a setting, after a typed confirmation; KEY=@FILE reads the value from the first line
    /// of a file; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Confirm the change with the robot's id instead of typing it: for scripts
    #[arg(long, value_name = "ID", requires = "set")]
    yes_i_mean: Option<String>,
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    connection: ConnectionArgs,
}

pub(super) fn config(args: &SettingArgs, used: &CommandSettings) -> Result<Exit, Failure> {
    let wanted = wanted(args)?;
    with_exclusive_session(&args.connection, used, async |session| {
        let settings = change(session, args, &wanted, |_| true).await?;
        if args.json {
            print_json(&object(&settings))
        } else {
            print(&table(&settings))
        }
    })
}

pub(super) fn wifi(args: &SettingArgs, used: &CommandSettings) -> Result<Exit, Failure> {
    let wanted = wanted(args)?;
    if let Some(other) = wanted.iter().find(|wanted| !concerns_network(&wanted.key)) {
        let what = format_args!("{} is not a network setting", other.key);
        return Err(
            Failure::usage(what).help("change other settings with `spykee robot config --set`")
        );
    }
    with_exclusive_session(&args.connection, used, async |session| {
        let own = change(session, args, &wanted, concerns_network).await?;
        let text = session.text(Command::NetworksQuery, "networks").await?;
        show_networks(&parse_networks(&text), &own, args.json)
    })
}

fn show_networks(networks: &[Network], own: &[Setting], json: bool) -> Result<Exit, Failure> {
    if json {
        return print_json(&json!({ "networks": networks, "settings": object(own) }));
    }
    let row = |network: &Network| {
        let strength = or_dash(network.strength);
        vec![network.essid.clone(), network.encryption.clone(), strength]
    };
    let networks = aligned("NETWORK|ENCRYPTION|>STRENGTH", networks.iter().map(row));
    print(&format!("{networks}\n{}", table(own)))
}

async fn settings(session: &mut RobotSession) -> Result<Vec<Setting>, Failure> {
    let messages = session
        .messages(Command::ConfigQuery, "its settings")
        .await?;
    Ok(parse_settings(&join_settings(&messages)))
}

/// The settings whose keys are meant. If some are to be changed: checks the changes, asks for
/// confirmation, sends them, and reads the settings back.
async fn change(
    session: &mut RobotSession,
    args: &SettingArgs,
    wanted: &[Setting],
    is_meant: impl Fn(&str) -> bool,
) -> Result<Vec<Setting>, Failure> {
    let mut listed = settings(session).await?;
    listed.retain(|setting| is_meant(&setting.key));
    if wanted.is_empty() {
        return Ok(listed);
    }
    if let Some(unknown) = wanted
        .iter()
        .find(|w| !listed.iter().any(|l| l.key == w.key))
    {
        let keys: Vec<&str> = listed.iter().map(|setting| setting.key.as_str()).collect();
        let what = format!("the robot has no such setting: {}", unknown.key);
        return Err(Failure::usage(what).help(format!("it has {}", keys.join(", "))));
    }
    confirm(&session.link.accepted.uid, args, wanted)?;
    let pair = |setting: &Setting| format!("{}={}", setting.key, setting.value);
    let pairs: Vec<String> = wanted.iter().map(pair).collect();
    // `wanted` accepts only characters that fit into one byte.
    let byte = |c| u8::try_from(u32::from(c)).unwrap_or(b'?');
    let text = pairs.join("&").chars().map(byte).collect();
    session.send(&[Command::ConfigSet(text)]).await?;
    let mut now = settings(session).await?;
    now.retain(|setting| is_meant(&setting.key));
    match wanted.iter().find(|wanted| !now.contains(wanted)) {
        None => Ok(now),
        Some(refused) => {
            let what = format!("the robot did not accept {}", refused.key);
            let help =
                "it may do so after it is switched off and on; check with `spykee robot config`";
            Err(Failure::new(Exit::Failed, what).help(help))
        }
    }
}

/// Requires the robot's id, typed by a person at a terminal or given by a script.
fn confirm(uid: &str, args: &SettingArgs, wanted: &[Setting]) -> Result<(), Failure> {
    let typed = match &args.yes_i_mean {
        Some(typed) => typed.clone(),
        None if !std::io::stdin().is_terminal() => {
            let failure = Failure::usage("cannot confirm the change: stdin is not a terminal");
            return Err(
                failure.help("confirm it with --yes-i-mean ID; `spykee robot info` shows the id")
            );
        }
        None => {
            let changes = table(wanted);
            print(&format!(
                "This changes the robot {uid}:\n{changes}A wrong setting may leave it unreachable. \
                 Type its id to continue: "
            ))?;
            let mut line = String::new();
            std::io::stdin()
                .lock()
                .take(MAX_VALUE as u64)
                .read_line(&mut line)
                .map_err(|error| Failure::io("read the answer", error))?;
            line.trim().to_owned()
        }
    };
    if typed == uid {
        return Ok(());
    }
    let what = format_args!("`{typed}` is not this robot's id: nothing was changed");
    Err(Failure::usage(what).help("`spykee robot info` shows the robot's id"))
}

/// Parses the `--set` options, before connecting to the robot.
fn wanted(args: &SettingArgs) -> Result<Vec<Setting>, Failure> {
    args.set.iter().map(|text| parse_change(text)).collect()
}

fn parse_change(text: &str) -> Result<Setting, Failure> {
    let wrong = |what: &str| Failure::usage(format_args!("--set {what}"));
    let (key, value) = text
        .split_once('=')
        .filter(|(key, _)| !key.is_empty())
        .ok_or_else(|| wrong("expects KEY=VALUE"))?;
    let value = match value.strip_prefix('@') {
        Some(path) => first_line(Path::new(path))?,
        None if is_secret(key) => {
            let failure = wrong(&format!("{key}: a secret must not be on the command line"));
            return Err(failure.help(format!("put it into a file: --set {key}=@FILE")));
        }
        None => value.to_owned(),
    };
    let unsendable = |c: char| matches!(c, '&' | '=') || c.is_control() || u32::from(c) > 255;
    if key.contains(unsendable) || value.contains(unsendable) {
        return Err(wrong(&format!(
            "{key}: a character that cannot be sent to the robot"
        ))
        .help("&, = and letters outside western European languages cannot be sent"));
    }
    if key.chars().count() + value.chars().count() > MAX_VALUE {
        return Err(wrong(&format!("{key}: longer than {MAX_VALUE} characters")));
    }
    let key = key.to_owned();
    Ok(Setting { key, value })
}

fn first_line(path: &Path) -> Result<String, Failure> {
    let cannot = |error: std::io::Error| Failure::unreadable(path, error);
    let mut text = String::new();
    let file = std::fs::File::open(path).map_err(cannot)?;
    file.take(4096).read_to_string(&mut text).map_err(cannot)?;
    Ok(text.lines().next().unwrap_or_default().to_owned())
}

fn is_secret(key: &str) -> bool {
    let key = key.to_lowercase();
    SECRETS.iter().any(|word| key.contains(word))
}

fn concerns_network(key: &str) -> bool {
    let key = key.to_lowercase();
    NETWORK.iter().any(|word| key.contains(word))
}

/// The value, or asterisks if it is secret.
fn shown(setting: &Setting) -> &str {
    if is_secret(&setting.key) && !setting.value.is_empty() {
        HIDDEN
    } else {
        &setting.value
    }
}

fn table(settings: &[Setting]) -> String {
    let row = |setting: &Setting| vec![setting.key.clone(), shown(setting).to_owned()];
    aligned("SETTING|VALUE", settings.iter().map(row))
}

fn object(settings: &[Setting]) -> Map<String, Value> {
    let pair = |setting: &Setting| (setting.key.clone(), Value::from(shown(setting)));
    settings.iter().map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_are_never_shown_and_never_on_the_command_line() {
        let setting = Setting {
            key: "wifi-Key".into(),
            value: "hunter2".into(),
        };
        assert_eq!(shown(&setting), HIDDEN);
        assert!(!table(std::slice::from_ref(&setting)).contains("hunter2"));
        let refusal = parse_change("wifi-key=hunter2").unwrap_err();
        assert!(
            !refusal.report().contains("hunter2"),
            "{}",
            refusal.report()
        );
        assert!(refusal.report().contains("=@FILE"));
    }

    #[test]
    fn values_that_would_change_other_settings_are_refused() {
        for text in [
            "name",
            "=x",
            "name=a&b=c",
            "name=a=b",
            "name=a\nb",
            "name=\u{20AC}",
        ] {
            assert!(parse_change(text).is_err(), "{text}");
        }
        assert_eq!(parse_change("name=Anna").unwrap().value, "Anna");
    }
}
