//! Executes the decisions of the timetable and of the idle robot: polls their state machines
//! whenever something has changed, and gives the orders.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep};
use tokio_util::sync::CancellationToken;
use tracing::{error, info, warn};

use super::idle::{self, IdleAction, IdleRobot};
use super::orders::{OrderResult, Orders};
use super::record::is_news;
use super::{Listeners, Reload, ServicePlan, View, describe};
use crate::agent::{AgentEvent, BehaviourState, BehaviourStatus, Roster, RosterError};
use crate::clock::{self, Clock};
use crate::pilot::{LinkState, Status};
use crate::robot::channel::{Quiet, Request};
use crate::timetable::{Act, Notice, Planner, PlannerInputs, Record};

/// Longest interval between two polls.
const LONGEST: Duration = Duration::from_secs(15);

/// See the module.
pub(super) struct Executor {
    statuses: watch::Receiver<Vec<BehaviourStatus>>,
    stops: watch::Receiver<u64>,
    requests: mpsc::Sender<Request>,
    status: watch::Receiver<Status>,
    clock: Clock,
    planner: Planner,
    service_plan: ServicePlan,
    idle: IdleRobot,
    orders: Orders,
    /// The behaviours that were not idle at the last poll.
    running: BTreeSet<String>,
    /// Permanent behaviours that were not started yet.
    waiting: BTreeSet<String>,
    /// The order that sends the idle robot to its station.
    docking_task: Option<tokio::task::AbortHandle>,
    quiet: Quiet,
    last_record: Option<Record>,
    listeners: Listeners,
    last_status: String,
    implausible: bool,
}

impl Executor {
    pub(super) fn new(
        roster: Roster,
        requests: mpsc::Sender<Request>,
        status: watch::Receiver<Status>,
        clock: Clock,
        planner: Planner,
        service_plan: ServicePlan,
        listeners: Listeners,
    ) -> Executor {
        Executor {
            statuses: roster.statuses(),
            stops: roster.stops(),
            requests,
            status,
            clock,
            planner,
            idle: IdleRobot::new(service_plan.idle),
            waiting: service_plan.always.iter().cloned().collect(),
            service_plan,
            orders: Orders::new(roster),
            running: BTreeSet::new(),
            docking_task: None,
            quiet: Quiet::Off,
            last_record: None,
            listeners,
            last_status: String::new(),
            implausible: false,
        }
    }

    /// Never returns. Does nothing after `stop`, so that behaviours running then stay recorded as
    /// under way for the next service.
    pub(super) async fn work(
        &mut self,
        mut reloads: mpsc::Receiver<Reload>,
        stop: CancellationToken,
    ) -> Infallible {
        self.listeners.notifier.ready();
        loop {
            let pause = self.step();
            tokio::select! {
                biased;
                () = stop.cancelled() => std::future::pending().await,
                Some(result) = self.orders.next() => self.handle_result(result),
                Some(reload) = reloads.recv() => self.reload(reload).await,
                Ok(()) = self.statuses.changed() => {}
                Ok(()) = self.status.changed() => {}
                () = sleep(pause) => {}
            }
        }
    }

    /// Records that no run is under way, so that the next service resumes none.
    pub(super) async fn forget_runs(self) {
        let record = Record {
            under_way: Vec::new(),
            ..self.planner.record()
        };
        if let Some(file) = self.listeners.file {
            file.finish(record).await;
        }
    }

    /// Polls the state machines and gives the resulting orders. Returns the time to wait until the
    /// next poll.
    fn step(&mut self) -> Duration {
        let (now, at) = (self.clock.now(), Instant::now());
        let status = *self.status.borrow_and_update();
        let running = self.update_running();
        let up = status.link == LinkState::Up;
        self.start_permanent(up);
        self.apply_quiet_hours(now);
        let names: Vec<String> = running.iter().cloned().collect();
        if self.stops.has_changed().unwrap_or(false) {
            self.stops.mark_unchanged();
            self.planner.forget_waiting();
        }
        let acts = self.planner.poll(PlannerInputs {
            now,
            at,
            ready: up,
            running: &names,
        });
        for act in acts {
            self.act(act);
        }
        self.check_clock(now);
        let inputs = idle::IdleInputs {
            now: at,
            busy: !running.is_empty() || !self.orders.is_empty() || self.planner.is_due(),
            link: status.link,
            docked: status.docked,
            low: status.low,
        };
        if let Some(action) = self.idle.poll(inputs) {
            self.execute(action);
        }
        self.save_record();
        self.publish_status(&status, now);
        let idle = self.idle.next_deadline().filter(|next| *next > at);
        let idle = idle.map_or(LONGEST, |next| next - at);
        self.planner.pause(now, at).min(idle).min(LONGEST)
    }

    /// Returns the behaviours that are not idle, and informs the planner of those that have ended.
    fn update_running(&mut self) -> BTreeSet<String> {
        let statuses = self.statuses.borrow_and_update();
        let running = statuses
            .iter()
            .filter(|one| one.state != BehaviourState::Idle);
        let running: BTreeSet<String> = running.map(|one| one.name.clone()).collect();
        drop(statuses);
        for name in self.running.difference(&running) {
            if !self.orders.has(name) {
                self.planner.ended(name);
            }
        }
        self.running = running.clone();
        running
    }

    /// Starts the permanent behaviours as soon as the robot is connected.
    fn start_permanent(&mut self, up: bool) {
        let waiting = self
            .waiting
            .iter()
            .filter(|name| up && !self.orders.has(name));
        let waiting: Vec<String> = waiting.cloned().collect();
        for name in waiting {
            self.orders.start(name);
        }
    }

    fn apply_quiet_hours(&mut self, now: jiff::Timestamp) {
        let quiet = self.service_plan.quiet(now);
        if quiet == self.quiet {
            return;
        }
        // If the pilot's queue is full, the next poll tries again.
        if self.requests.try_send(Request::Quiet(quiet)).is_ok() {
            self.quiet = quiet;
            describe::log_quiet_hours(quiet);
        }
    }

    fn act(&mut self, act: Act) {
        match act {
            Act::Start {
                run,
                planned,
                resumed,
                ..
            } => {
                let planned = clock::describe(&self.service_plan.table.zone.time(planned));
                if resumed {
                    info!(
                        behaviour = run,
                        "resumes a run that was interrupted, from {planned}"
                    )
                } else {
                    info!(
                        behaviour = run,
                        "starts by the timetable, planned for {planned}"
                    )
                }
                self.orders.start(run);
            }
            Act::End { run } => {
                info!(behaviour = run, "its time is over");
                self.orders.stop(run);
            }
            Act::Report(notice) => self.report_notice(&notice),
        }
    }

    fn report_notice(&self, notice: &Notice) {
        if let Some((run, reason)) = describe::log_notice(notice, &self.service_plan.table.zone) {
            self.report_missed(run, reason.to_owned());
        }
    }

    fn report_missed(&self, run: &str, reason: String) {
        self.listeners.bus.publish(AgentEvent::StartMissed {
            behaviour: run.to_owned(),
            reason,
        });
    }

    fn check_clock(&mut self, now: jiff::Timestamp) {
        let implausible = !clock::is_plausible(now) && !self.service_plan.table.rules.is_empty();
        if implausible != self.implausible {
            self.implausible = implausible;
            if implausible {
                warn!("the clock is not set ({now}): the timetable waits until it is")
            } else {
                info!("the clock is set: the timetable begins")
            }
        }
    }

    fn execute(&mut self, action: IdleAction) {
        match action {
            IdleAction::Connect => self.ask(Request::Release(false)),
            IdleAction::Release => self.ask(Request::Release(true)),
            IdleAction::CancelDocking => {
                if let Some(task) = self.docking_task.take() {
                    task.abort();
                }
            }
            IdleAction::Dock => {
                info!("no behaviour runs and the robot is off its station: sending it there");
                self.docking_task = Some(self.orders.send_home(self.requests.clone()));
            }
        }
    }

    /// Sends a request to the pilot. If its queue is full, the action is repeated after the next
    /// change of the link.
    fn ask(&self, request: Request) {
        if self.requests.try_send(request).is_err() {
            warn!("the pilot's queue is full: a request was dropped");
        }
    }

    fn handle_result(&mut self, result: OrderResult) {
        match result {
            OrderResult::Started(run, started) => {
                let offline = started == Err(RosterError::Offline);
                if offline && self.waiting.contains(&run) {
                    return;
                }
                if offline && self.planner.postpone(&run) {
                    return info!(behaviour = run, "starts when the robot is connected again");
                }
                self.waiting.remove(&run);
                if let Err(why) = started {
                    error!(behaviour = run, "was not started: {why}");
                    self.report_missed(&run, why.to_string());
                    if !matches!(why, RosterError::RunsAlready(_)) {
                        self.planner.ended(&run);
                    }
                }
            }
            OrderResult::Changed(run, changed) => {
                match changed {
                    Ok(()) | Err(RosterError::DoesNotRun(_)) => {}
                    Err(why) => error!(behaviour = run, "{why}"),
                }
                let runs =
                    |one: &BehaviourStatus| one.name == run && one.state != BehaviourState::Idle;
                if !self.statuses.borrow().iter().any(runs) {
                    self.planner.ended(&run);
                }
            }
            OrderResult::Home(ended) => {
                if !self.idle.is_docking() {
                    return;
                }
                self.docking_task = None;
                let done = describe::log_homing(&ended);
                self.idle.docked(done, Instant::now());
            }
        }
    }

    /// Applies a new plan. Behaviours that have not changed keep running.
    async fn reload(&mut self, reload: Reload) {
        let Reload {
            service_plan,
            changed,
        } = reload;
        if let Err(why) = self.orders.define(service_plan.specs.clone()).await {
            return error!("the new settings were not applied: {why}");
        }
        let known: BTreeSet<&str> = service_plan.specs.iter().map(|one| one.name()).collect();
        for run in self.running.clone() {
            let gone = !known.contains(run.as_str());
            if !gone && !changed.contains(&run) {
                continue;
            }
            if gone {
                self.orders.stop(run)
            } else {
                self.orders.restart(run)
            }
        }
        let before = std::mem::replace(&mut self.service_plan, service_plan);
        let always = &self.service_plan.always;
        self.waiting.retain(|name| always.contains(name));
        let new = always.iter().filter(|name| !before.always.contains(name));
        let new = new.filter(|name| !self.running.contains(*name)).cloned();
        self.waiting.extend(new);
        self.planner.replace(self.service_plan.table.clone());
        self.idle.replace(self.service_plan.idle);
        info!("the new settings are in effect");
    }

    /// Writes the record when something starts or ends, and every hour; not at each poll.
    fn save_record(&mut self) {
        let Some(file) = &self.listeners.file else {
            return;
        };
        let record = self.planner.record();
        if is_news(self.last_record.as_ref(), &record) && file.save(record.clone()) {
            self.last_record = Some(record);
        }
    }

    /// Updates the view and the status line of the service manager.
    fn publish_status(&mut self, status: &Status, now: jiff::Timestamp) {
        let next = if clock::is_plausible(now) {
            self.planner.next_start()
        } else {
            None
        };
        let view = View {
            next: next.map(|(at, run)| (at, run.to_owned())),
            quiet: self.quiet != Quiet::Off,
        };
        self.listeners.view.send_if_modified(|shown| {
            let news = *shown != view;
            shown.clone_from(&view);
            news
        });
        let running = self.running.iter().map(String::as_str);
        let text = describe::status(status, running, next, &self.service_plan.table.zone);
        if text != self.last_status {
            self.listeners.notifier.status(text.clone());
            self.last_status = text;
        }
    }
}

#[cfg(test)]
mod tests;
