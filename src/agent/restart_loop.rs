//! Runs one behaviour, restarts it when it has failed or its file was saved, and gives it up when
//! it fails too often.

use std::pin::{Pin, pin};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::spawn_blocking;
use tokio::time::{Instant, sleep};
use tracing::{error, info, warn};

use super::Behaviour;
use crate::behaviour::{
    Handle, HostContext, Inspector, Launch, Prepared, RestartDecision, RestartPolicy,
    RestartTracker, ScriptChecker, Supervisor,
};
use crate::clock::or_never;
use crate::robot::channel::{Request, Role};
use crate::robot::{AgentEvent, BehaviourId, EndReason};
use crate::script::ScriptExit;

struct Loaded {
    host: Prepared,
    source: Vec<u8>,
}

type Loading = Pin<Box<dyn Future<Output = Result<Loaded, ScriptExit>> + Send>>;

pub(super) struct RestartLoop {
    context: HostContext,
    /// Ends it for good.
    stop: Handle,
    pub(super) by: BehaviourId,
    role: Role,
    /// Its `launch` holds the text that runs, or ran last.
    behaviour: Behaviour,
    restarts: RestartTracker,
    /// The last saved text cannot be loaded: the one before it is not started again.
    outdated: bool,
}

impl RestartLoop {
    pub(super) fn new(
        context: HostContext,
        stop: Handle,
        by: BehaviourId,
        role: Role,
        behaviour: Behaviour,
    ) -> RestartLoop {
        RestartLoop {
            context,
            stop,
            by,
            role,
            restarts: RestartTracker::new(behaviour.restart, behaviour.launch.options.seed),
            behaviour,
            outdated: false,
        }
    }

    pub(super) fn name(&self) -> &str {
        &self.behaviour.launch.options.name
    }

    /// A text that cannot be loaded may be corrected during the run.
    pub(super) fn is_watched(&self) -> bool {
        self.behaviour.reloads.is_some()
    }

    /// Lets a host load the text; it does not run yet.
    pub(super) async fn prepare(&self) -> Result<Prepared, ScriptExit> {
        let source = self.behaviour.launch.source.clone();
        self.load(source).await.map(|loaded| loaded.host)
    }

    /// Runs until nothing is left to do. Returns the name and the last ending.
    pub(super) async fn run(mut self, first: Result<Prepared, ScriptExit>) -> (String, ScriptExit) {
        self.outdated = first.is_err();
        let mut next = first;
        loop {
            let began = Instant::now();
            let (exit, successor) = match next {
                Ok(host) => self.live(host).await,
                Err(exit) => (exit, None),
            };
            report(self.name(), &exit);
            self.publish_ended(&exit, began.elapsed());
            next = match successor {
                Some(loaded) => Ok(self.adopt(loaded)),
                None => match self.decide_next(&exit).await {
                    Some(next) => next,
                    None => return (self.behaviour.launch.options.name, exit),
                },
            };
        }
    }

    /// Returns how it has ended, and a text that was saved and loaded meanwhile. The old text runs
    /// until the new one is loaded.
    async fn live(&mut self, host: Prepared) -> (ScriptExit, Option<Loaded>) {
        self.context.bus.publish(AgentEvent::Started {
            behaviour: self.name().to_owned(),
            by: self.stop.started_by.clone(),
        });
        let handle = self.stop.one_life();
        let supervisor = Supervisor::register(host, self.role, self.context.clone(), None).await;
        let mut life = pin!(supervisor.run(handle.clone()));
        let mut loading = None;
        let mut successor = None;
        let mut stopping = false;
        let exit = loop {
            tokio::select! {
                biased;
                reason = self.stop.stopped(), if !stopping => {
                    stopping = true;
                    handle.stop(reason);
                }
                exit = &mut life => break exit,
                Some(source) = or_never(self.behaviour.reloads.as_mut().map(mpsc::Receiver::recv)) => {
                    loading = Some(self.load(source));
                }
                loaded = or_never(loading.as_mut()) => {
                    loading = None;
                    if let Some(loaded) = self.accept(loaded, "the old script still runs") {
                        successor = Some(loaded);
                        handle.stop(EndReason::Reload);
                    }
                }
            }
        };
        if stopping {
            return (exit, None);
        }
        if let Some(loading) = loading {
            successor = self.finish(loading).await.or(successor);
        }
        (exit, successor)
    }

    /// Decides what follows an ending that no save has caused; `None`: nothing.
    async fn decide_next(&mut self, exit: &ScriptExit) -> Option<Result<Prepared, ScriptExit>> {
        let verdict = if self.outdated || self.stop.reason().is_some() {
            RestartDecision::Over
        } else {
            self.restarts.ended(exit.reason, Instant::now())
        };
        let RestartDecision::Again { pause, number } = verdict else {
            if verdict == RestartDecision::GivenUp {
                self.give_up(exit).await;
            }
            return self.wait_for_fix(None).await.map(Ok);
        };
        let behaviour = self.name();
        let of = self.limits();
        warn!(
            behaviour,
            "restarts in {:.1} s: restart {number} {of}",
            pause.as_secs_f64()
        );
        tokio::select! {
            biased;
            _ = self.stop.stopped() => return None,
            Some(source) = or_never(self.behaviour.reloads.as_mut().map(mpsc::Receiver::recv)) => {
                return self.wait_for_fix(Some(source)).await.map(Ok);
            }
            () = sleep(pause) => {}
        }
        tokio::select! {
            biased;
            _ = self.stop.stopped() => None,
            prepared = self.prepare() => Some(prepared),
        }
    }

    pub(super) fn publish_ended(&self, exit: &ScriptExit, ran: Duration) {
        self.context.bus.publish(AgentEvent::Ended {
            behaviour: self.name().to_owned(),
            reason: exit.reason,
            message: exit.message.clone(),
            seconds: ran.as_secs_f64(),
            by: self.stop.ended_by(),
        });
    }

    async fn give_up(&self, exit: &ScriptExit) {
        let behaviour = self.name();
        let reason = exit.reason;
        let message = exit.text();
        let of = self.limits();
        error!(behaviour, %reason, "given up, no restart is left {of}: {message}");
        self.context.bus.publish(AgentEvent::GivenUp {
            behaviour: behaviour.to_owned(),
            message: message.to_owned(),
        });
        let _ = self.context.requests.send(Request::Alarm).await;
    }

    /// The limit of restarts, such as `of 5 within 600 s`.
    fn limits(&self) -> String {
        match self.behaviour.restart {
            RestartPolicy::Never => String::new(),
            RestartPolicy::OnFailure(restarts) => format!(
                "of {} within {} s",
                restarts.max_restarts,
                restarts.within.as_secs_f64()
            ),
        }
    }

    /// Waits for a saved text that can be loaded; `None`: no file is watched, or the run ends.
    async fn wait_for_fix(&mut self, mut saved_text: Option<Vec<u8>>) -> Option<Prepared> {
        if !self.is_watched() || self.stop.reason().is_some() {
            return None;
        }
        loop {
            let behaviour = self.name();
            if saved_text.is_none() {
                info!(
                    behaviour,
                    "the robot stands still until the script is saved again"
                );
            }
            let source = match saved_text.take() {
                Some(source) => source,
                None => tokio::select! {
                    biased;
                    _ = self.stop.stopped() => return None,
                    source = or_never(self.behaviour.reloads.as_mut().map(mpsc::Receiver::recv)) => source?,
                },
            };
            let loading = self.load(source);
            match self.finish(loading).await {
                Some(loaded) => return Some(self.adopt(loaded)),
                None if self.stop.reason().is_some() => return None,
                None => {}
            }
        }
    }

    /// `None`: the text cannot be loaded, or the run ends.
    async fn finish(&mut self, loading: Loading) -> Option<Loaded> {
        tokio::select! {
            biased;
            _ = self.stop.stopped() => None,
            loaded = loading => self.accept(loaded, "nothing runs in its place"),
        }
    }

    /// Logs whether a saved text could be loaded, and returns it if so.
    fn accept(&mut self, loaded: Result<Loaded, ScriptExit>, meanwhile: &str) -> Option<Loaded> {
        let behaviour = &self.behaviour.launch.options.name;
        self.outdated = loaded.is_err();
        match loaded {
            Ok(loaded) => {
                info!(behaviour, "saved: the new script takes over");
                Some(loaded)
            }
            Err(exit) => {
                let why = exit.text();
                error!(
                    behaviour,
                    "saved, but cannot be loaded ({meanwhile}): {why}"
                );
                None
            }
        }
    }

    /// Adopts a new text, and forgets the earlier failures.
    fn adopt(&mut self, loaded: Loaded) -> Prepared {
        self.behaviour.launch.source = loaded.source;
        self.restarts.forget();
        loaded.host
    }

    fn load(&self, source: Vec<u8>) -> Loading {
        let context = self.context.clone();
        let by = self.by;
        let priority = self.behaviour.priority;
        let launch = Launch {
            source: source.clone(),
            ..self.behaviour.launch.clone()
        };
        let checked = self.behaviour.checked;
        Box::pin(async move {
            if checked {
                // Checking a long text takes time and must not block this runtime.
                let text = launch.clone();
                let inspector = context.launcher.inspector();
                let looked = spawn_blocking(move || check_text(&text, inspector)).await;
                looked.unwrap_or(Ok(()))?;
            }
            let host = Prepared::start(&context, by, priority, launch).await?;
            Ok(Loaded { host, source })
        })
    }
}

/// Refuses a text if the check finds an error in it or in one of its modules.
fn check_text(launch: &Launch, inspector: Option<Inspector>) -> Result<(), ScriptExit> {
    let failed = |message| ScriptExit {
        reason: EndReason::Error,
        message: Some(message),
    };
    let mut checker = ScriptChecker::new(inspector);
    checker.behaviour(launch).map_err(failed)?;
    match checker.errors().next() {
        Some(error) => Err(failed(error.text())),
        None => Ok(()),
    }
}

pub(super) fn report(name: &str, exit: &ScriptExit) {
    let reason = exit.reason;
    let message = exit.text();
    match reason {
        EndReason::Error | EndReason::Cpu | EndReason::Memory | EndReason::Safety => {
            error!(behaviour = name, %reason, "{message}");
        }
        _ => info!(behaviour = name, %reason, "{message}"),
    }
}
