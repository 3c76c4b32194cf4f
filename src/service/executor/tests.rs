//! The executor with a roster whose commands the test answers, in virtual time.

use std::future::Future;

use tokio::sync::oneshot;
use tokio::time::timeout;

use super::*;
use crate::agent::{Bus, BusMessage, Listener};
use crate::robot::{BehaviourId, Priority};
use crate::service::IdlePolicy;
use crate::timetable::{Rule, Timetable};

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
}

impl ServiceFixture {
    /// The executor of a timetable that starts `go` now, for 20 s.
    fn new() -> (ServiceFixture, impl Future<Output = Infallible>) {
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
        let idle = IdlePolicy {
            release: false,
            after: Duration::from_secs(60),
            dock: false,
        };
        let service_plan = ServicePlan {
            specs: Vec::new(),
            always: Vec::new(),
            table: table.clone(),
            quiet_alarm: true,
            idle,
        };
        let bus = Bus::default();
        let statuses = watch::Sender::new(Vec::new());
        let (roster, orders) = Roster::fake(statuses.subscribe());
        let fixture = ServiceFixture {
            roster: roster.clone(),
            status: watch::Sender::new(Status {
                link: LinkState::Up,
                ..Status::default()
            }),
            statuses,
            orders,
            heard: bus.subscribe(),
        };
        let listeners = Listeners {
            file: None,
            notifier: crate::service::ManagerNotifier::default(),
            bus,
            view: View::channel().0,
        };
        let mut executor = Executor::new(
            roster,
            mpsc::channel(8).0,
            fixture.status.subscribe(),
            Clock::default(),
            Planner::new(table, Record::default()),
            service_plan,
            listeners,
        );
        // Nobody reloads.
        let work = async move {
            executor
                .work(mpsc::channel(1).1, CancellationToken::new())
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
async fn beside<T>(work: impl Future<Output = Infallible>, story: impl Future<Output = T>) -> T {
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
        let started = fixture.order("Start(\"go\"").await;
        fixture.shows(BehaviourState::Loading);
        sleep(Duration::from_secs(11)).await;
        fixture.runs(started);
        fixture.order("Stop(\"go\"").await
    };
    let _stopped = beside(work, story).await;
    assert_eq!(begun.elapsed().as_secs(), 20);
    assert!(!fixture.has_missed());
}

#[tokio::test(start_paused = true)]
async fn a_start_that_does_not_reach_the_robot_is_repeated_when_it_is_back() {
    let (mut fixture, work) = ServiceFixture::new();
    let story = async {
        let started = fixture.order("Start(\"go\"").await;
        fixture.link(LinkState::Lost);
        let _ = started.send(Err(RosterError::Offline));
        sleep(Duration::from_secs(60)).await;
        assert!(fixture.orders.is_empty(), "there is no robot");
        fixture.link(LinkState::Up);
        let started = fixture.order("Start(\"go\"").await;
        fixture.runs(started);
        fixture.order("Stop(\"go\"").await
    };
    let _stopped = beside(work, story).await;
    assert!(!fixture.has_missed());
}

#[tokio::test(start_paused = true)]
async fn a_start_that_waits_for_the_robot_is_cancelled_when_a_person_stops_everything() {
    let (mut fixture, work) = ServiceFixture::new();
    let story = async {
        let started = fixture.order("Start(\"go\"").await;
        fixture.link(LinkState::Lost);
        let _ = started.send(Err(RosterError::Offline));
        sleep(Duration::from_secs(60)).await;
        // The roster of this test executes no such command.
        let _ = fixture.roster.stop_all().await;
        fixture.link(LinkState::Up);
        sleep(Duration::from_secs(60)).await;
    };
    beside(work, story).await;
    assert!(fixture.orders.is_empty(), "it was started");
}
