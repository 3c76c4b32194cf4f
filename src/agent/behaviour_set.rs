//! The behaviours that run side by side in one agent: executes the commands of the
//! [`Roster`](super::roster). Nothing here is on the driving core or can move the robot.

use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::task::{JoinSet, spawn_blocking};
use tokio::time::{Instant, timeout};
use tracing::{error, info, warn};

use super::restart_loop::{RestartLoop, report};
use super::roster::{
    BehaviourSpec, BehaviourState, BehaviourStatus, Change, Reply, Roster, RosterCommand,
    RosterError,
};
use super::{AgentError, Behaviour, SCRIPTS_END};
use crate::behaviour::{Handle, HostContext, Prepared};
use crate::clock::until;
use crate::pilot::{LinkState, Status};
use crate::robot::channel::Role;
use crate::robot::{AgentEvent, BehaviourId, EndReason, Priority};
use crate::script::ScriptExit;

/// The most behaviours that run at the same time: each is a process.
const MAX_BEHAVIOURS: usize = 32;
/// Behaviours have numbers below this; persons and the rescue behaviour have higher ones.
const NUMBERS: u16 = 0xF000;

/// A behaviour with its first host, or why it could not be started.
type PreparedBehaviour = (RestartLoop, Result<Prepared, ScriptExit>);

type Loaded = (BehaviourId, Result<(RestartLoop, Prepared), RosterError>);

pub(super) struct BehaviourSet {
    context: HostContext,
    commands: mpsc::Receiver<RosterCommand>,
    specs: Vec<BehaviourSpec>,
    active: Vec<ActiveBehaviour>,
    running: JoinSet<(BehaviourId, String, ScriptExit)>,
    loading: JoinSet<Loaded>,
    /// Each behaviour's last ending by name, in the order in which they ended. Why a script could not be
    /// loaded is in its spec.
    exits: Vec<(String, ScriptExit)>,
    statuses: watch::Sender<Vec<BehaviourStatus>>,
    status: watch::Receiver<Status>,
    last: u16,
}

impl BehaviourSet {
    pub(super) fn new(
        context: HostContext,
        status: watch::Receiver<Status>,
        specs: Vec<BehaviourSpec>,
    ) -> (BehaviourSet, Roster) {
        let statuses = watch::Sender::new(Vec::new());
        let (roster, commands) = Roster::new(statuses.subscribe(), context.viewers.clone());
        let behaviour_set = BehaviourSet {
            context,
            commands,
            specs,
            active: Vec::new(),
            running: JoinSet::new(),
            loading: JoinSet::new(),
            exits: Vec::new(),
            statuses,
            status,
            last: NUMBERS - 1,
        };
        behaviour_set.publish();
        (behaviour_set, roster)
    }

    /// Fails with the first script that cannot be loaded, and that no file watch can reload.
    pub(super) async fn prepare(
        &mut self,
        behaviours: Vec<Behaviour>,
    ) -> Result<Vec<PreparedBehaviour>, (String, ScriptExit)> {
        let mut prepared = Vec::new();
        for behaviour in behaviours {
            let name = &behaviour.launch.options.name;
            if !self.specs.iter().any(|known| known.name() == name) {
                self.specs.push(BehaviourSpec::from_behaviour(&behaviour));
            }
            let by = self.number();
            let stop = Handle::default();
            let context = self.context.clone();
            let restart_loop =
                RestartLoop::new(context, stop.clone(), by, Role::Behaviour, behaviour);
            match restart_loop.prepare().await {
                Err(exit) if !restart_loop.is_watched() => {
                    let name = restart_loop.name().to_owned();
                    report(&name, &exit);
                    restart_loop.publish_ended(&exit, Duration::ZERO);
                    return Err((name, exit));
                }
                first => {
                    let name = restart_loop.name().to_owned();
                    self.active.push(ActiveBehaviour::new(by, name, stop, None));
                    prepared.push((restart_loop, first));
                }
            }
        }
        Ok(prepared)
    }

    pub(super) fn begin(&mut self, prepared: Vec<PreparedBehaviour>) {
        for (restart_loop, first) in prepared {
            self.run(restart_loop, first);
        }
        self.publish();
    }

    pub(super) fn is_empty(&self) -> bool {
        self.active.is_empty()
    }

    /// Executes commands while nothing can be started. Never returns; cancel-safe.
    pub(super) async fn wait_for_robot(&mut self) -> std::convert::Infallible {
        while let Some(command) = self.commands.recv().await {
            let offline = self.status.borrow().link != LinkState::Up;
            match command {
                RosterCommand::Change(Change::Start | Change::Restart, name, .., reply)
                    if offline =>
                {
                    let refusal = match self.spec(&name) {
                        Some(_) => RosterError::Offline,
                        None => self.unknown(&name),
                    };
                    let _ = reply.send(Err(refusal));
                }
                command => self.execute(command),
            }
        }
        std::future::pending().await
    }

    /// Handles the next event: a command, a script that is loaded, a behaviour that has ended.
    /// Cancel-safe.
    pub(super) async fn handle_next(&mut self) -> Result<(), AgentError> {
        let next = self
            .active
            .iter()
            .filter_map(ActiveBehaviour::deadline)
            .min();
        tokio::select! {
            biased;
            () = until(next) => self.end_overdue(Instant::now()),
            Some(ended) = self.running.join_next() => {
                let (by, name, exit) = ended.map_err(|_| AgentError::Broken("a supervisor"))?;
                self.behaviour_ended(by, name, exit);
            }
            Some(loaded) = self.loading.join_next() => {
                let (by, loaded) = loaded.map_err(|_| AgentError::Broken("a supervisor"))?;
                self.loaded(by, loaded);
            }
            Some(command) = self.commands.recv() => self.execute(command),
            else => std::future::pending().await,
        }
        Ok(())
    }

    pub(super) async fn end(mut self, reason: EndReason) -> Vec<(String, ScriptExit)> {
        self.commands.close();
        for one in &mut self.active {
            one.restart = None;
            one.stop.stop(reason);
        }
        let scripts = async {
            while let Some(Ok((by, name, exit))) = self.running.join_next().await {
                self.behaviour_ended(by, name, exit);
            }
        };
        if timeout(SCRIPTS_END, scripts).await.is_err() {
            warn!("scripts that did not end in time were abandoned");
        }
        let problems = self.specs.iter();
        let problems = problems.filter_map(|spec| Some((spec.name().to_owned(), spec.exit()?)));
        self.exits.into_iter().chain(problems).collect()
    }

    /// After an internal error: ends all hosts at once.
    pub(super) async fn abandon(mut self) {
        self.loading.shutdown().await;
        self.running.shutdown().await;
    }

    fn execute(&mut self, command: RosterCommand) {
        match command {
            RosterCommand::Change(change, name, time_limit, by, reply) => {
                self.change(change, name, time_limit, &by, reply);
            }
            RosterCommand::StopAll(by, reply) => self.stop_those(|_| true, &by, reply),
            RosterCommand::StopDrivers(by, reply) => {
                self.stop_those(ActiveBehaviour::has_driven, &by, reply);
            }
            RosterCommand::Define(specs, reply) => {
                self.specs = specs;
                let _ = reply.send(Ok(()));
            }
        }
        self.publish();
    }

    /// Whoever gets the reply then waits for the behaviours in state `Ending`.
    fn stop_those(&mut self, which: impl Fn(&ActiveBehaviour) -> bool, by: &str, reply: Reply) {
        for one in self.active.iter_mut().filter(|one| which(one)) {
            one.stop_for_good(by);
        }
        self.publish();
        let _ = reply.send(Ok(()));
    }

    fn change(
        &mut self,
        change: Change,
        name: String,
        time_limit: Option<Duration>,
        by: &str,
        reply: Reply,
    ) {
        match (change, self.find(&name)) {
            (Change::Start, Some(_)) => refuse(reply, RosterError::RunsAlready(name)),
            (Change::Stop, Some(one)) => {
                one.stop_for_good(by);
                one.ended.push(reply);
            }
            (Change::Stop, None) => {
                let why = match self.spec(&name) {
                    Some(_) => RosterError::DoesNotRun(name),
                    None => self.unknown(&name),
                };
                refuse(reply, why);
            }
            (Change::Restart, Some(one)) => {
                one.stop.stop_by(EndReason::Reload, by);
                if let Some((_, earlier)) = one.restart.replace((by.to_owned(), reply)) {
                    refuse(earlier, RosterError::Busy);
                }
            }
            (Change::Start | Change::Restart, None) => self.start(&name, time_limit, by, reply),
        }
    }

    /// Loads the script of a behaviour that does not run.
    fn start(&mut self, name: &str, time_limit: Option<Duration>, who: &str, reply: Reply) {
        let Some(spec) = self.spec(name).cloned() else {
            let unknown = self.unknown(name);
            return refuse(reply, unknown);
        };
        if self.active.len() >= MAX_BEHAVIOURS {
            return refuse(reply, RosterError::Full(MAX_BEHAVIOURS));
        }
        let by = self.number();
        let stop = Handle::for_start(who);
        let context = self.context.clone();
        let status = self.status.clone();
        let loaded = load(context, stop.clone(), by, spec, status);
        self.loading.spawn(async move { (by, loaded.await) });
        let mut one = ActiveBehaviour::new(by, name.to_owned(), stop, time_limit);
        one.started = Some(reply);
        self.active.push(one);
    }

    fn loaded(&mut self, by: BehaviourId, loaded: Result<(RestartLoop, Prepared), RosterError>) {
        let Some(at) = self.active.iter().position(|one| one.by == by) else {
            return;
        };
        let stopped = self.active[at].stop.reason();
        match (loaded, stopped) {
            (Ok((restart_loop, host)), None) => {
                let one = &mut self.active[at];
                if let Some(reply) = one.started.take() {
                    let _ = reply.send(Ok(()));
                }
                let name = one.name.clone();
                self.set_problem(&name, None);
                self.run(restart_loop, Ok(host));
            }
            (loaded, _) => {
                let mut one = self.active.remove(at);
                let refusal = match loaded.map_err(|why| one.refusal(why)) {
                    Err(why) => {
                        error!(behaviour = one.name, "cannot be started: {why}");
                        if let RosterError::CannotLoad(why) = &why {
                            self.context.bus.publish(AgentEvent::Ended {
                                behaviour: one.name.clone(),
                                reason: EndReason::Error,
                                message: Some(why.clone()),
                                seconds: 0.0,
                                by: None,
                            });
                            self.set_problem(&one.name, Some(why.clone()));
                        }
                        why
                    }
                    Ok(_) => RosterError::StoppedFirst(one.name.clone()),
                };
                if let Some(reply) = one.started.take() {
                    refuse(reply, refusal);
                }
                self.close(one);
            }
        }
        self.publish();
    }

    fn run(&mut self, restart_loop: RestartLoop, first: Result<Prepared, ScriptExit>) {
        let by = restart_loop.by;
        if let Some(one) = self.active.iter_mut().find(|one| one.by == by) {
            one.since = Some(Instant::now());
        }
        self.running.spawn(async move {
            let (name, exit) = restart_loop.run(first).await;
            (by, name, exit)
        });
    }

    fn behaviour_ended(&mut self, by: BehaviourId, name: String, exit: ScriptExit) {
        self.exits.retain(|(of, _)| *of != name);
        self.exits.push((name, exit));
        if let Some(at) = self.active.iter().position(|one| one.by == by) {
            let one = self.active.remove(at);
            self.close(one);
        }
        self.publish();
    }

    fn close(&mut self, one: ActiveBehaviour) {
        for reply in one.ended {
            let _ = reply.send(Ok(()));
        }
        if let Some((by, reply)) = one.restart {
            self.start(&one.name, one.time_limit, &by, reply);
        }
    }

    fn end_overdue(&mut self, now: Instant) {
        for one in &self.active {
            if one.deadline().is_some_and(|deadline| deadline <= now) {
                info!(behaviour = one.name, "its time is over");
                one.stop.stop_by(EndReason::Cancelled, "its time is over");
            }
        }
        self.publish();
    }

    /// Remembers why a script cannot be loaded, or that it can.
    fn set_problem(&mut self, name: &str, problem: Option<String>) {
        let spec = self.specs.iter_mut().find(|known| known.name() == name);
        if let Some(spec) = spec {
            spec.problem = problem;
        }
    }

    fn number(&mut self) -> BehaviourId {
        loop {
            self.last = (self.last + 1) % NUMBERS;
            let by = BehaviourId(self.last);
            if !self.active.iter().any(|one| one.by == by) {
                return by;
            }
        }
    }

    fn find(&mut self, name: &str) -> Option<&mut ActiveBehaviour> {
        self.active.iter_mut().find(|one| one.name == name)
    }

    fn spec(&self, name: &str) -> Option<&BehaviourSpec> {
        self.specs.iter().find(|known| known.name() == name)
    }

    fn unknown(&self, name: &str) -> RosterError {
        RosterError::unknown(name, self.specs.iter().map(BehaviourSpec::name))
    }

    fn publish(&self) {
        let statuses = statuses(&self.specs, &self.active, &self.exits);
        self.statuses.send_replace(statuses);
    }
}

fn refuse(reply: Reply, why: RosterError) {
    let _ = reply.send(Err(why));
}

/// How long a loaded behaviour waits for the robot.
const REACH: Duration = Duration::from_millis(3500);

/// A behaviour that is told to end meanwhile does not run.
pub(super) async fn load(
    context: HostContext,
    stop: Handle,
    by: BehaviourId,
    spec: BehaviourSpec,
    mut status: watch::Receiver<Status>,
) -> Result<(RestartLoop, Prepared), RosterError> {
    let made = spawn_blocking(move || spec.make()).await;
    let broken = "internal error: the behaviour could not be created".to_owned();
    let behaviour = made.unwrap_or(Err(RosterError::CannotLoad(broken)))?;
    let restart_loop = RestartLoop::new(context, stop, by, Role::Behaviour, behaviour);
    let prepared = restart_loop.prepare().await;
    let host = prepared.map_err(|exit| RosterError::CannotLoad(exit.text().to_owned()))?;
    // A robot whose link was released is being dialled meanwhile.
    let up = status.wait_for(|status| status.link == LinkState::Up);
    match timeout(REACH, up).await {
        Ok(Ok(_)) => Ok((restart_loop, host)),
        _ => Err(RosterError::Offline),
    }
}

pub(super) struct ActiveBehaviour {
    pub(super) by: BehaviourId,
    pub(super) name: String,
    pub(super) stop: Handle,
    /// When it began; `None`: it is being loaded.
    pub(super) since: Option<Instant>,
    pub(super) time_limit: Option<Duration>,
    pub(super) started: Option<Reply>,
    pub(super) ended: Vec<Reply>,
    /// Present if it is to be started again when it has ended: who wants that, and what receives the
    /// outcome.
    pub(super) restart: Option<(String, Reply)>,
}

impl ActiveBehaviour {
    pub(super) fn new(
        by: BehaviourId,
        name: String,
        stop: Handle,
        time_limit: Option<Duration>,
    ) -> ActiveBehaviour {
        ActiveBehaviour {
            by,
            name,
            stop,
            since: None,
            time_limit,
            started: None,
            ended: Vec::new(),
            restart: None,
        }
    }

    /// When its time is over; `None`: it has no limit, or is ending already.
    pub(super) fn deadline(&self) -> Option<Instant> {
        if self.stop.reason().is_some() {
            return None;
        }
        Some(self.since? + self.time_limit?)
    }

    fn has_driven(&self) -> bool {
        self.stop.has_driven()
    }

    /// Tells it to end, and not to start again.
    pub(super) fn stop_for_good(&mut self, by: &str) {
        self.stop.stop_by(EndReason::Cancelled, by);
        if let Some((_, again)) = self.restart.take() {
            let _ = again.send(Err(RosterError::StoppedFirst(self.name.clone())));
        }
    }

    /// Why it was not started. A missing robot is no reason if it was stopped as well: nobody must
    /// start it when the robot is back.
    pub(super) fn refusal(&self, why: RosterError) -> RosterError {
        match why {
            RosterError::Offline if self.stop.reason().is_some() => {
                RosterError::StoppedFirst(self.name.clone())
            }
            why => why,
        }
    }

    pub(super) fn state(&self) -> BehaviourState {
        match self.since {
            _ if self.stop.reason().is_some() => BehaviourState::Ending,
            Some(since) => BehaviourState::Running { by: self.by, since },
            None => BehaviourState::Loading,
        }
    }
}

/// Those of the specs first, then those that still run but are no longer in the config.
fn statuses(
    specs: &[BehaviourSpec],
    active: &[ActiveBehaviour],
    exits: &[(String, ScriptExit)],
) -> Vec<BehaviourStatus> {
    let status = |name: &str, priority: Priority, problem: Option<ScriptExit>| {
        let running = active.iter().find(|one| one.name == name);
        let exit = exits.iter().find(|(of, _)| of == name);
        BehaviourStatus {
            name: name.to_owned(),
            priority,
            state: running.map_or(BehaviourState::Idle, ActiveBehaviour::state),
            exit: problem.or(exit.map(|(_, exit)| exit.clone())),
        }
    };
    let known = |name: &str| specs.iter().any(|one| one.name() == name);
    let all = specs.iter();
    let all = all.map(|one| status(one.name(), one.priority, one.exit()));
    let rest = active.iter().filter(|one| !known(&one.name));
    let rest = rest.map(|one| status(&one.name, Priority::default(), None));
    all.chain(rest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_behaviour_that_was_stopped_is_not_said_to_wait_for_the_robot() {
        let one = ActiveBehaviour::new(BehaviourId(1), "go".to_owned(), Handle::default(), None);
        assert_eq!(one.refusal(RosterError::Offline), RosterError::Offline);
        one.stop.stop(EndReason::Cancelled);
        let stopped = RosterError::StoppedFirst("go".to_owned());
        assert_eq!(one.refusal(RosterError::Offline), stopped);
        let broken = RosterError::CannotLoad("broken".to_owned());
        assert_eq!(one.refusal(broken.clone()), broken);
    }
}
