//! A behaviour whose host has loaded its script but does not run it yet: the host's process, the
//! two ends of its pipe, and the modules that it requests.

use std::io;
use std::time::Duration;

use tokio::runtime::Handle as Runtime;
use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tokio::time::timeout;

use super::library::Library;
use super::log_limiter::LogLimiter;
use super::message::{FromHost, Launch, ToHost};
use super::name::validate_name;
use super::pipe::{Receiver, Sender};
use super::process::{HostProcess, Launcher, PipeReader, PipeWriter};
use super::report_limiter::ReportLimiter;
use crate::robot::{BehaviourId, EndReason, Priority};
use crate::script::{ModuleName, NoModule, ScriptExit};

/// Capacity of the queue of messages to a host.
const MAX_WAITING: usize = 128;
/// Maximum number of modules that a host may request in its lifetime; an honest one requests fewer.
const MAX_MODULES: usize = 256;
/// How long a host may take to load its script.
const LOAD_TIME: Duration = Duration::from_secs(5);
/// How long a host may take to exit after it reported its end.
pub(super) const EXIT_TIME: Duration = Duration::from_millis(100);

/// A behaviour whose script is loaded but does not run yet.
#[derive(Debug)]
pub struct Prepared {
    pub(super) by: BehaviourId,
    pub(super) name: String,
    pub(super) priority: Priority,
    pub(super) process: HostProcess,
    pub(super) from_host: Receiver<FromHost>,
    pub(super) to_host: mpsc::Sender<ToHost>,
    pub(super) modules: mpsc::Sender<ModuleName>,
    pump: AbortHandle,
    /// False in virtual time, in which no sign of life is expected.
    pub(super) in_real_time: bool,
    pub(super) log_limiter: LogLimiter,
    pub(super) report_limiter: ReportLimiter,
}

impl Prepared {
    /// Starts a host and lets it load the script. The runtime `core` serves its pipe.
    ///
    /// # Errors
    /// An [`ScriptExit`], in words for the script's author, if the script fails to load or the host
    /// cannot be started.
    pub async fn start(
        launcher: &Launcher,
        core: &Runtime,
        by: BehaviourId,
        priority: Priority,
        launch: Launch,
    ) -> Result<Prepared, ScriptExit> {
        let name = launch.options.name.clone();
        let broken = |error: io::Error| {
            exit(
                EndReason::Error,
                &format!("{name}: its host cannot be started: {error}"),
            )
        };
        validate_name(&name).map_err(|error| exit(EndReason::Error, &error.to_string()))?;
        let log_limiter = LogLimiter::new(launch.options.limits.log_bytes_a_day);
        let folder = launch.options.data_dir.clone();
        let report_limiter = ReportLimiter::new(name.clone(), folder, &launch.options.limits);
        let started = launcher.start(&launch.options.folders(), core);
        let (process, reader, writer) = started.map_err(broken)?;
        let (from_host, to_host, pump) = connect(reader, writer, core);
        let modules = serve_modules(
            launch.library.clone(),
            to_host.clone(),
            launcher.is_in_this_thread(),
        );
        let mut prepared = Prepared {
            by,
            name: name.clone(),
            priority,
            process,
            from_host,
            to_host,
            modules,
            pump,
            in_real_time: !launcher.is_in_this_thread(),
            log_limiter,
            report_limiter,
        };
        let _ = prepared.to_host.try_send(ToHost::Load(Box::new(launch)));
        match timeout(LOAD_TIME, prepared.from_host.next()).await {
            Ok(Ok(Some(FromHost::Ready))) => Ok(prepared),
            Ok(Ok(Some(FromHost::Ended(exit)))) => Err(exit),
            Ok(Ok(_)) => Err(prepared.failure_exit().await),
            Ok(Err(error)) => Err(broken(error)),
            Err(_) => Err(broken(io::ErrorKind::TimedOut.into())),
        }
    }

    /// Describes the end of a host that exited without reporting a reason.
    pub(super) async fn failure_exit(&mut self) -> ScriptExit {
        let status = match timeout(EXIT_TIME, self.process.wait()).await {
            Ok(status) => status,
            Err(_) => self.process.kill().await,
        };
        let status = status.map_or_else(|error| error.to_string(), |status| status.to_string());
        let words = timeout(EXIT_TIME, self.process.last_words())
            .await
            .unwrap_or_default();
        let text = format!(
            "{}: its process ended unexpectedly ({status}) {words}",
            self.name
        );
        exit(EndReason::Error, text.trim_end())
    }
}

impl Drop for Prepared {
    fn drop(&mut self) {
        self.pump.abort();
    }
}

fn connect(
    reader: PipeReader,
    writer: PipeWriter,
    core: &Runtime,
) -> (Receiver<FromHost>, mpsc::Sender<ToHost>, AbortHandle) {
    let (to_host, waiting) = mpsc::channel(MAX_WAITING);
    let pump = core.spawn(Sender::new(writer).pump(waiting)).abort_handle();
    (Receiver::new(reader), to_host, pump)
}

/// Reads modules for a host, one after the other, on a thread that may block on the disk; with
/// `here`, for virtual time, on the current thread. Ends with the behaviour.
fn serve_modules(
    library: Library,
    to_host: mpsc::Sender<ToHost>,
    here: bool,
) -> mpsc::Sender<ModuleName> {
    let (ask, mut asked) = mpsc::channel::<ModuleName>(MAX_MODULES);
    tokio::spawn(async move {
        let mut left = MAX_MODULES;
        while let Some(name) = asked.recv().await {
            left = match left.checked_sub(1) {
                Some(left) => left,
                None => return,
            };
            let source = library.clone();
            let wanted = name.clone();
            let refused = |error: &dyn std::fmt::Display| NoModule(error.to_string());
            let fetch = move || source.fetch(&wanted).map_err(|error| refused(&error));
            let file = if here {
                fetch()
            } else {
                let fetched = tokio::task::spawn_blocking(fetch).await;
                fetched.unwrap_or_else(|error| Err(refused(&error)))
            };
            if to_host.send(ToHost::Module(name, file)).await.is_err() {
                return;
            }
        }
    });
    ask
}

pub(super) fn exit(reason: EndReason, message: &str) -> ScriptExit {
    ScriptExit {
        reason,
        message: Some(message.to_owned()),
    }
}
