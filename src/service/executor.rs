//! Executes the decisions of the timetable and of the idle robot: polls their state machines
//! whenever something has changed, and gives the orders.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::{mpsc, watch};
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::{Instant, sleep};
use tokio_util::sync::CancellationToken;
use tracing::{error, info, warn};

use super::idle::{Activity, IdleAction, IdleRobot};
use super::record::is_news;
use super::standstill::Standstill;
use super::{ManagerNotifier, RecordFile, ServicePlan, View};
use crate::agent::{
    AgentEvent, BehaviourSpec, BehaviourState, BehaviourStatus, Bus, Change, PilotClient,
    PilotClientError, Roster, RosterError,
};
use crate::clock::{self, Clock, Zone};
use crate::control;
use crate::pilot::{LinkState, Status};
use crate::robot::channel::{Quiet, Request, Role};
use crate::robot::{BehaviourId, DockEnd, DockOutcome, DockPlan, Priority, STOP_HOLDS};
use crate::timetable::{Act, Due, NextStart, Planner, PlannerInputs, Record, TimetableOrder};

/// Who ends and restarts what a new config changes.
const READ_AGAIN: &str = "the config was read again";
/// Longest interval between two polls.
const LONGEST: Duration = Duration::from_secs(15);

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
    file: RecordFile,
    pub(super) notifier: ManagerNotifier,
    pub(super) bus: Bus,
    pub(super) view: watch::Sender<View>,
    last_status: String,
    implausible: bool,
    /// Whether a person's STOP holds.
    stopped: bool,
    standstill: Standstill,
}

impl Executor {
    /// An executor whose manager, bus and view are those of nobody.
    pub(super) fn new(
        roster: Roster,
        requests: mpsc::Sender<Request>,
        status: watch::Receiver<Status>,
        clock: Clock,
        service_plan: ServicePlan,
        file: RecordFile,
    ) -> Executor {
        Executor {
            statuses: roster.statuses(),
            stops: roster.stops(),
            requests,
            status,
            clock,
            planner: Planner::new(service_plan.table.clone(), file.record.clone()),
            idle: IdleRobot::new(service_plan.idle.clone()),
            waiting: service_plan.always.iter().cloned().collect(),
            service_plan,
            orders: Orders::new(roster),
            running: BTreeSet::new(),
            docking_task: None,
            quiet: Quiet::Off,
            last_record: None,
            file,
            notifier: ManagerNotifier::default(),
            bus: Bus::default(),
            view: View::channel().0,
            last_status: String::new(),
            implausible: false,
            stopped: false,
            standstill: Standstill::default(),
        }
    }

    /// Never returns. Does nothing after `stop`, so that behaviours running then stay recorded as
    /// under way for the next service.
    pub(super) async fn work(
        &mut self,
        mut reloads: mpsc::Receiver<ServicePlan>,
        mut changes: mpsc::Receiver<TimetableOrder>,
        stop: CancellationToken,
    ) -> Infallible {
        self.notifier.ready();
        loop {
            let pause = self.step();
            tokio::select! {
                biased;
                () = stop.cancelled() => std::future::pending().await,
                Some(result) = self.orders.next() => self.handle_result(result),
                Some(service_plan) = reloads.recv() => self.reload(service_plan).await,
                Some(order) = changes.recv() => self.change_timetable(order),
                Ok(()) = self.statuses.changed() => {}
                Ok(()) = self.status.changed() => {}
                () = sleep(pause) => {}
            }
        }
    }

    /// Polls the state machines and gives the resulting orders. Returns the time to wait until the
    /// next poll.
    fn step(&mut self) -> Duration {
        let now = self.clock.now();
        let at = Instant::now();
        let status = *self.status.borrow_and_update();
        self.hold_permanent(status.emergency_stop);
        self.update_running();
        let up = status.link == LinkState::Up;
        if up && !self.stopped {
            self.start_permanent();
        }
        self.apply_quiet_hours(now);
        let names: Vec<String> = self.running.iter().cloned().collect();
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
        self.report_standstill(&status, at);
        let runs = !self.runs_only_permanent();
        let activity = if runs || !self.orders.is_empty() || self.planner.is_due() {
            Activity::Busy
        } else if self.running.is_empty() {
            Activity::None
        } else {
            Activity::Watched
        };
        if let Some(action) = self.idle.poll(&status, activity, at) {
            self.execute(action);
        }
        self.save_record();
        self.publish_status(&status, now);
        let idle = self.idle.next_deadline().filter(|next| *next > at);
        let idle = idle.map_or(LONGEST, |next| next - at);
        self.planner.pause(now, at).min(idle).min(LONGEST)
    }

    fn runs_only_permanent(&self) -> bool {
        let always = &self.service_plan.always;
        self.running.iter().all(|name| always.contains(name))
    }

    fn report_standstill(&mut self, status: &Status, at: Instant) {
        let expected = !self.runs_only_permanent();
        let reason = self.standstill.poll(status, &self.running, expected, at);
        if let Some(reason) = reason {
            let running: Vec<&str> = self.running.iter().map(String::as_str).collect();
            self.bus.publish(AgentEvent::Standstill {
                behaviour: running.join(", "),
                reason,
            });
        }
    }

    /// Updates the behaviours that are not idle, and informs the planner of those that have ended.
    fn update_running(&mut self) {
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
        self.running = running;
    }

    /// Permanent behaviours that run when a person presses STOP, and may be ended with it, start
    /// again when it is released.
    fn hold_permanent(&mut self, stopped: bool) {
        if stopped && !self.stopped {
            let always = self.service_plan.always.iter();
            let running = always.filter(|name| self.running.contains(*name));
            self.waiting.extend(running.cloned());
        }
        self.stopped = stopped;
    }

    fn start_permanent(&mut self) {
        self.waiting.retain(|name| !self.running.contains(name));
        let waiting = self.waiting.iter().filter(|name| !self.orders.has(name));
        let waiting: Vec<String> = waiting.cloned().collect();
        for name in waiting {
            self.orders.give(Change::Start, name, "always on");
        }
    }

    fn apply_quiet_hours(&mut self, now: Timestamp) {
        let quiet = self.service_plan.quiet(now);
        if quiet == self.quiet {
            return;
        }
        // If the pilot's queue is full, the next poll tries again.
        if self.requests.try_send(Request::Quiet(quiet)).is_ok() {
            self.quiet = quiet;
            log_quiet_hours(quiet);
        }
    }

    fn act(&mut self, act: Act) {
        match act {
            Act::Start(due) => self.start(due),
            Act::End { run } => {
                info!(behaviour = run, "its time is over");
                self.orders.give(Change::Stop, run, "its time is over");
            }
            Act::ReportMissed {
                run,
                planned,
                count,
            } => {
                let planned = self.describe(planned);
                warn!(
                    behaviour = run,
                    count,
                    "a start was missed: the service did not run, or the clock was not set; the last \
                     one was planned for {planned}"
                );
                self.report_missed(&run, "the service did not run then");
            }
            Act::ReportNoRobot { run, planned } => {
                let planned = self.describe(planned);
                warn!(
                    behaviour = run,
                    "a start was missed: no robot was connected; it was planned for {planned}"
                );
                self.report_missed(&run, "no robot was connected");
            }
            Act::ReportOverlap { run, planned } => {
                let planned = self.describe(planned);
                warn!(behaviour = run, "not started at {planned}: it still runs");
                self.report_missed(&run, "it still runs");
            }
            Act::ReportClockSet { seconds } => info!("the clock was set by {seconds} s"),
        }
    }

    fn describe(&self, at: Timestamp) -> String {
        clock::describe(&self.service_plan.table.zone.time(at))
    }

    fn start(&mut self, due: Due) {
        let run = due.run;
        if self.stopped {
            warn!(behaviour = run, "is not started: {STOP_HOLDS}");
            self.report_missed(&run, STOP_HOLDS);
            return self.planner.ended(&run);
        }
        let doing = if due.resumed {
            "resumes a run that was interrupted, from"
        } else {
            "starts by the timetable, planned for"
        };
        let planned = self.describe(due.planned);
        info!(behaviour = run, "{doing} {planned}");
        self.orders.give(Change::Start, run, "the timetable");
    }

    fn report_missed(&self, run: &str, reason: impl Into<String>) {
        self.bus.publish(AgentEvent::StartMissed {
            behaviour: run.to_owned(),
            reason: reason.into(),
        });
    }

    fn check_clock(&mut self, now: Timestamp) {
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
                info!("nothing is under way and the robot is off its station: sending it there");
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
            OrderResult::Changed(Change::Start, run, started) => {
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
            OrderResult::Changed(_, run, changed) => {
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
                if !self.idle.docking {
                    return;
                }
                self.docking_task = None;
                let done = log_homing(&ended);
                match ended {
                    Ok(docked) if docked.end == DockEnd::Preempted => self.idle.preempted(),
                    _ => self.idle.docked(done, Instant::now()),
                }
            }
        }
    }

    /// Applies a new plan. Behaviours that have not changed keep running.
    async fn reload(&mut self, service_plan: ServicePlan) {
        if let Err(why) = self.orders.define(service_plan.specs.clone()).await {
            return error!("the new settings were not applied: {why}");
        }
        let can_start = |run: &str| {
            let spec = service_plan.specs.iter().find(|one| one.name() == run);
            spec.is_some_and(|spec| spec.problem.is_none())
        };
        for run in self.running.clone() {
            let before = self.service_plan.fingerprints.get(&run);
            match service_plan.fingerprints.get(&run) {
                None => self.orders.give(Change::Stop, run, READ_AGAIN),
                now if now != before && can_start(&run) => {
                    self.orders.give(Change::Restart, run, READ_AGAIN)
                }
                _ => {}
            }
        }
        let before = std::mem::replace(&mut self.service_plan, service_plan);
        let always = &self.service_plan.always;
        self.waiting.retain(|name| always.contains(name));
        let new = always.iter().filter(|name| !before.always.contains(name));
        let new = new.filter(|name| !self.running.contains(*name)).cloned();
        self.waiting.extend(new);
        self.planner.replace(self.service_plan.table.clone());
        self.idle.replace(self.service_plan.idle.clone());
        info!("the new settings are in effect");
    }

    /// Changes what a person asks for, and answers when the disk has it.
    fn change_timetable(&mut self, order: TimetableOrder) {
        let changed = self.planner.change(&order, self.clock.now());
        let text = match changed {
            Ok(Some(text)) => text,
            unchanged => {
                let done = unchanged.map(|_| ()).map_err(|why| why.to_string());
                // Who has asked may no longer wait.
                let _ = order.answer.send(done);
                return;
            }
        };
        self.bus
            .publish(AgentEvent::TimetableChanged { by: order.by, text });
        // Publishes and records it.
        self.step();
        let kept = self.file.kept();
        tokio::spawn(async move {
            let kept = kept
                .await
                .map_err(|why| format!("it is changed, but only until this program ends: {why}"));
            let _ = order.answer.send(kept);
        });
    }

    /// Writes the record when something starts or ends, and every hour; not at each poll.
    fn save_record(&mut self) {
        let record = self.planner.record();
        let is_news = is_news(self.last_record.as_ref(), &record);
        if is_news && self.file.save(record.clone()) {
            self.last_record = Some(record);
        }
    }

    fn publish_status(&mut self, status: &Status, now: Timestamp) {
        let next = if clock::is_plausible(now) {
            self.planner.next_start()
        } else {
            None
        };
        let view = View {
            next: next.clone(),
            hold: self.planner.hold().clone(),
            quiet: self.quiet != Quiet::Off,
            always: self.service_plan.always.clone(),
        };
        self.view.send_if_modified(|shown| {
            let news = *shown != view;
            shown.clone_from(&view);
            news
        });
        let running = self.running.iter().map(String::as_str);
        let text = status_line(status, running, next, &self.service_plan.table.zone);
        if text != self.last_status {
            self.notifier.status(&text);
            self.last_status = text;
        }
    }
}

/// The client with which an idle robot is sent home; its number is between those of the persons and
/// of the rescue behaviour.
const IDLE_CLIENT: BehaviourId = BehaviourId(0xFFFD);
const LOWEST: Priority = Priority(i16::MIN);

#[derive(Debug)]
pub(super) enum OrderResult {
    /// A behaviour was started, stopped or restarted.
    Changed(Change, String, Result<(), RosterError>),
    /// An idle robot was sent home.
    Home(Result<DockOutcome, PilotClientError>),
}

/// Outstanding orders. They run concurrently: a script that loads slowly delays neither the
/// timetable nor the idle robot.
pub(super) struct Orders {
    roster: Roster,
    tasks: JoinSet<OrderResult>,
    /// Behaviours with an outstanding order.
    names: BTreeSet<String>,
}

impl Orders {
    pub(super) fn new(roster: Roster) -> Orders {
        Orders {
            roster,
            tasks: JoinSet::new(),
            names: BTreeSet::new(),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    pub(super) fn has(&self, run: &str) -> bool {
        self.names.contains(run)
    }

    pub(super) fn give(&mut self, order: Change, run: String, by: &'static str) {
        self.names.insert(run.clone());
        let roster = self.roster.without_timeout();
        self.tasks.spawn(async move {
            let done = roster.change(order, &run, None, by).await;
            OrderResult::Changed(order, run, done)
        });
    }

    /// Sends the idle robot to its station. Aborting the returned task cancels the docking.
    pub(super) fn send_home(&mut self, requests: mpsc::Sender<Request>) -> AbortHandle {
        self.tasks
            .spawn(async move { OrderResult::Home(send_home(requests).await) })
    }

    /// Returns the next result; `None` while no order is outstanding. Cancel-safe.
    pub(super) async fn next(&mut self) -> Option<OrderResult> {
        loop {
            // An aborted order has no result.
            if let Ok(result) = self.tasks.join_next().await? {
                if let OrderResult::Changed(_, run, _) = &result {
                    self.names.remove(run);
                }
                return Some(result);
            }
        }
    }

    pub(super) async fn define(&self, specs: Vec<BehaviourSpec>) -> Result<(), RosterError> {
        self.roster.define(specs).await
    }
}

/// Docks with the lowest priority. Dropping the future cancels the docking.
async fn send_home(requests: mpsc::Sender<Request>) -> Result<DockOutcome, PilotClientError> {
    let client =
        PilotClient::join(requests, IDLE_CLIENT, "an idle robot", LOWEST, Role::Person).await;
    client?.dock(DockPlan::ORDERED).await
}

fn log_quiet_hours(quiet: Quiet) {
    match quiet {
        Quiet::Off => info!("quiet hours are over"),
        Quiet::Scripts => info!("quiet hours: no sounds and no headlight but the alarm's"),
        Quiet::WithAlarm => info!("quiet hours: no sounds, no headlight, no alarm"),
    }
}

/// Logs the result of sending an idle robot to its station. Returns whether it arrived.
fn log_homing(ended: &Result<DockOutcome, PilotClientError>) -> bool {
    let why = match ended {
        Ok(DockOutcome {
            end: DockEnd::Done | DockEnd::AlreadyDocked,
            ..
        }) => {
            info!("the idle robot is on its station");
            return true;
        }
        Ok(docked) => docked.end.to_string(),
        Err(why) => why.to_string(),
    };
    warn!("the idle robot is not on its station: {why}");
    false
}

/// Returns the status line for the service manager: the robot, the running behaviours, and the next
/// start.
fn status_line<'a>(
    status: &Status,
    running: impl Iterator<Item = &'a str>,
    next: Option<NextStart>,
    zone: &Zone,
) -> String {
    let robot = control::describe(status);
    let running: Vec<&str> = running.collect();
    let running = if running.is_empty() {
        "no behaviour runs".to_owned()
    } else {
        running.join(", ")
    };
    let next = next.map(|next| format!("; next {}", next.describe(zone)));
    format!("{robot}; {running}{}", next.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use std::future::Future;

    use tokio::sync::oneshot;
    use tokio::time::timeout;

    use super::*;
    use crate::agent::{BusMessage, Listener};
    use crate::config;
    use crate::robot::{BehaviourId, Priority};
    use crate::timetable::{Hold, Rule, Timetable, TimetableChange};

    type Reply = oneshot::Sender<Result<(), RosterError>>;

    /// The longest wait for an order.
    const LIMIT: Duration = Duration::from_secs(300);

    /// What surrounds the executor: the robot, the roster, and those who hear of missed starts.
    struct ServiceFixture {
        roster: Roster,
        status: watch::Sender<Status>,
        statuses: watch::Sender<Vec<BehaviourStatus>>,
        orders: mpsc::UnboundedReceiver<(String, Reply)>,
        heard: Listener,
        changes: mpsc::Sender<TimetableOrder>,
        view: watch::Receiver<View>,
    }

    impl ServiceFixture {
        /// The executor of a timetable that starts `go` now, for 20 s.
        fn new() -> (ServiceFixture, impl Future<Output = Infallible>) {
            ServiceFixture::with_record(RecordFile::default())
        }

        fn with_record(record: RecordFile) -> (ServiceFixture, impl Future<Output = Infallible>) {
            clock::begin_virtual(Some("2026-05-04T09:00:00Z".parse().unwrap()));
            let table = Timetable {
                rules: vec![Rule {
                    run: "go".to_owned(),
                    at: "0 9 * * *".parse().unwrap(),
                    lasts: Some("20s".parse().unwrap()),
                }],
                zone: clock::Zone::utc(),
                quiet: None,
                catch_up: "10m".parse().unwrap(),
            };
            let service_plan = ServicePlan {
                specs: Vec::new(),
                fingerprints: Default::default(),
                always: Vec::new(),
                table,
                quiet_alarm: true,
                idle: config::Service {
                    dock: false,
                    ..config::Service::default()
                },
            };
            let bus = Bus::default();
            let statuses = watch::Sender::new(Vec::new());
            let (roster, orders) = Roster::fake(statuses.subscribe());
            let (sender, changes) = mpsc::channel(1);
            let (view, seen) = View::channel();
            let fixture = ServiceFixture {
                roster: roster.clone(),
                status: watch::Sender::new(Status {
                    link: LinkState::Up,
                    ..Status::default()
                }),
                statuses,
                orders,
                heard: bus.subscribe(),
                changes: sender,
                view: seen,
            };
            let mut executor = Executor {
                bus,
                view,
                ..Executor::new(
                    roster,
                    mpsc::channel(8).0,
                    fixture.status.subscribe(),
                    Clock::default(),
                    service_plan,
                    record,
                )
            };
            // Nobody reloads.
            let work = async move {
                executor
                    .work(mpsc::channel(1).1, changes, CancellationToken::new())
                    .await
            };
            (fixture, work)
        }

        fn link(&self, link: LinkState) {
            self.status.send_modify(|status| status.link = link);
        }

        /// The roster shows `go` in this state.
        fn shows(&self, state: BehaviourState) {
            self.statuses.send_replace(vec![BehaviourStatus {
                name: "go".to_owned(),
                priority: Priority::default(),
                state,
                exit: None,
            }]);
        }

        /// The roster has started `go`.
        fn runs(&self, started: Reply) {
            let by = BehaviourId(1);
            let since = Instant::now();
            self.shows(BehaviourState::Running { by, since });
            let _ = started.send(Ok(()));
        }

        /// Waits for the next order, which begins with these words.
        async fn order(&mut self, words: &str) -> Reply {
            let order = timeout(LIMIT, self.orders.recv()).await;
            let (text, reply) = order.expect("no order").expect("no executor");
            assert!(text.starts_with(words), "{text}");
            reply
        }

        fn has_missed(&mut self) -> bool {
            let heard = std::iter::from_fn(|| self.heard.try_next());
            let missed = |one: BusMessage| {
                matches!(one, BusMessage::Event(one)
                if matches!(one.what, AgentEvent::StartMissed { .. }))
            };
            heard.take(100).any(missed)
        }
    }

    /// Plays a story while the executor works.
    async fn beside<T>(
        work: impl Future<Output = Infallible>,
        story: impl Future<Output = T>,
    ) -> T {
        tokio::select! {
            never = work => match never {},
            told = story => told,
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_run_that_loads_slowly_is_ended_on_time() {
        let (mut fixture, work) = ServiceFixture::new();
        let begun = Instant::now();
        let story = async {
            let started = fixture.order("Change(Start, \"go\"").await;
            fixture.shows(BehaviourState::Loading);
            sleep(Duration::from_secs(11)).await;
            fixture.runs(started);
            fixture.order("Change(Stop, \"go\"").await
        };
        let _stopped = beside(work, story).await;
        assert_eq!(begun.elapsed().as_secs(), 20);
        assert!(!fixture.has_missed());
    }

    #[tokio::test(start_paused = true)]
    async fn a_start_that_does_not_reach_the_robot_is_repeated_when_it_is_back() {
        let (mut fixture, work) = ServiceFixture::new();
        let story = async {
            let started = fixture.order("Change(Start, \"go\"").await;
            fixture.link(LinkState::Lost);
            let _ = started.send(Err(RosterError::Offline));
            sleep(Duration::from_secs(60)).await;
            assert!(fixture.orders.is_empty(), "there is no robot");
            fixture.link(LinkState::Up);
            let started = fixture.order("Change(Start, \"go\"").await;
            fixture.runs(started);
            fixture.order("Change(Stop, \"go\"").await
        };
        let _stopped = beside(work, story).await;
        assert!(!fixture.has_missed());
    }

    #[tokio::test(start_paused = true)]
    async fn a_start_that_waits_for_the_robot_is_cancelled_when_a_person_stops_everything() {
        let (mut fixture, work) = ServiceFixture::new();
        let story = async {
            let started = fixture.order("Change(Start, \"go\"").await;
            fixture.link(LinkState::Lost);
            let _ = started.send(Err(RosterError::Offline));
            sleep(Duration::from_secs(60)).await;
            // The roster of this test executes no such command.
            let _ = fixture.roster.stop_all("a person").await;
            fixture.link(LinkState::Up);
            sleep(Duration::from_secs(60)).await;
        };
        beside(work, story).await;
        assert!(fixture.orders.is_empty(), "it was started");
    }

    /// Sends a change of the timetable, and returns its answer.
    async fn change(
        changes: &mpsc::Sender<TimetableOrder>,
        change: TimetableChange,
        until: Option<&str>,
    ) -> Result<(), String> {
        let (answer, answered) = oneshot::channel();
        let order = TimetableOrder {
            change,
            until: until.map(str::to_owned),
            start: None,
            by: "a person".to_owned(),
            answer,
        };
        changes.send(order).await.unwrap();
        answered.await.unwrap()
    }

    #[tokio::test(start_paused = true)]
    async fn a_paused_timetable_starts_nothing_and_the_journal_knows_who() {
        let data = tempfile::tempdir().unwrap();
        let record = RecordFile::open_in_simulation(data.path());
        let (mut fixture, work) = ServiceFixture::with_record(record);
        let changes = fixture.changes.clone();
        let story = async {
            let started = fixture.order("Change(Start, \"go\"").await;
            fixture.runs(started);
            let stopped = fixture.order("Change(Stop, \"go\"").await;
            fixture.shows(BehaviourState::Idle);
            let _ = stopped.send(Ok(()));
            let pause = TimetableChange::Pause;
            let refused = change(&changes, pause, Some("2026-05-04 09:00")).await;
            assert!(refused.unwrap_err().contains("is over"));
            let done = change(&changes, pause, Some("2026-05-05 09:30")).await;
            assert_eq!(done, Ok(()));
            let hold = RecordFile::hold(data.path());
            assert_eq!(
                fixture.view.borrow().hold,
                hold,
                "it is kept before the answer"
            );
            assert!(hold.paused.is_some());
            sleep(Duration::from_secs(25 * 3600)).await;
        };
        beside(work, story).await;
        assert!(fixture.orders.is_empty(), "it was started");
        assert_eq!(fixture.view.borrow().hold, Hold::default(), "it is over");
        let heard = std::iter::from_fn(|| fixture.heard.try_next());
        let events: Vec<AgentEvent> = heard
            .take(100)
            .filter_map(|one| match one {
                BusMessage::Event(one) => Some(one.what.clone()),
                _ => None,
            })
            .collect();
        let by = "a person".to_owned();
        let text = "nothing starts until Tue 2026-05-05 09:30".to_owned();
        assert_eq!(events, [AgentEvent::TimetableChanged { by, text }]);
    }

    #[tokio::test(start_paused = true)]
    async fn a_change_that_the_disk_does_not_take_is_told() {
        let home = tempfile::tempdir().unwrap();
        let data = home.path().join("data");
        std::fs::write(&data, "a file in the place of the folder").unwrap();
        let record = RecordFile::open(&data);
        let (fixture, work) = ServiceFixture::with_record(record);
        let changes = fixture.changes.clone();
        let story = change(&changes, TimetableChange::Skip, None);
        let answer = beside(work, story).await.unwrap_err();
        assert!(answer.contains("only until this program ends"), "{answer}");
    }

    #[tokio::test(start_paused = true)]
    async fn a_start_is_recorded_as_missed_while_a_persons_stop_holds() {
        let (mut fixture, work) = ServiceFixture::new();
        let stop = |on| {
            let set = move |status: &mut Status| status.emergency_stop = on;
            fixture.status.send_modify(set);
        };
        stop(true);
        let story = async {
            sleep(Duration::from_secs(60)).await;
            stop(false);
            sleep(Duration::from_secs(60)).await;
        };
        beside(work, story).await;
        assert!(fixture.orders.is_empty(), "it was started");
        let heard = std::iter::from_fn(|| fixture.heard.try_next());
        let reasons: Vec<String> = heard
            .take(100)
            .filter_map(|one| match one {
                BusMessage::Event(one) => match &one.what {
                    AgentEvent::StartMissed { reason, .. } => Some(reason.clone()),
                    _ => None,
                },
                _ => None,
            })
            .collect();
        assert_eq!(reasons, [STOP_HOLDS]);
    }
}
