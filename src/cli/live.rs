//! Serves the page of a run or a service, and opens it in the browser.

use std::io::IsTerminal as _;
use std::process::{Command, Stdio};

use tokio::sync::watch;

use super::token::address_for_others;
use super::{Console, Failure};
use crate::agent::Behaviour;
use crate::config::Config;
use crate::control::Run;
use crate::live::{self, Live, LiveError, RunDefinition, Script, WebContext};
use crate::robot::Listener;
use crate::script::ParamValue;

/// Serves the page, logs its address, and opens it in the browser if a person is at the terminal. `bus`
/// listens since before the run has started.
pub(super) fn serve(
    config: &Config,
    run: Run,
    definition: watch::Receiver<RunDefinition>,
    bus: Listener,
    console: &Console,
) -> Result<Live, Failure> {
    let context = WebContext {
        run,
        definition,
        bus,
        log: live::tap(),
        data: config.data_folder().to_owned(),
    };
    let live = Live::start(context, &config.live).map_err(refused)?;
    let url = live.url();
    let others = address_for_others(live.address());
    if others == live.address() {
        tracing::info!("the page is at {url}");
    } else {
        tracing::info!("the page is at {url} (from a phone: http://{others}/)");
    }
    if console.has_status_line() {
        open(&url);
    }
    Ok(live)
}

pub(super) fn script(behaviour: &Behaviour) -> Script {
    let options = &behaviour.launch.options;
    let params = options.params.iter();
    Script {
        name: options.name.clone(),
        file: options.chunk.clone().into(),
        source: String::from_utf8_lossy(&behaviour.launch.source).into_owned(),
        params: params
            .map(|(name, given)| (name.clone(), describe(&given.value)))
            .collect(),
    }
}

fn describe(value: &ParamValue) -> String {
    match value {
        ParamValue::Boolean(on) => on.to_string(),
        ParamValue::Number(number) => number.to_string(),
        ParamValue::Text(text) => text.clone(),
    }
}

fn refused(error: LiveError) -> Failure {
    let help = "without --live, and without `live:` in the config, no page is served";
    match &error {
        LiveError::Access(_) => Failure::usage(error).help(help),
        LiveError::Socket { .. } => Failure::internal(error)
            .help("does another run use it? --live=127.0.0.1:0 picks a free port"),
        LiveError::System(_) => Failure::internal(error).help(help),
    }
}

/// Opens the URL in the browser on a desktop. Without a desktop or `xdg-open` does nothing: the
/// address is in the log.
fn open(url: &str) {
    let desktop = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    if !std::io::stdin().is_terminal() || !(desktop("DISPLAY") || desktop("WAYLAND_DISPLAY")) {
        return;
    }
    let mut command = Command::new("xdg-open");
    command
        .arg(url)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    if let Ok(mut child) = command.spawn() {
        // Reaps the process whenever it ends.
        let _ = std::thread::Builder::new()
            .name("browser".into())
            .spawn(move || child.wait());
    }
}
