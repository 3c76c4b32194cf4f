//! The pilot with the simulated robot, without scripts: requests in, commands out.

use std::time::Duration;

use spykee::link;
use spykee::pilot::{Connector, Pilot, Settings, Shutdown, Status};
use spykee::robot::channel::{EventReceiver, MAX_REQUESTS, PilotMessage, Request, events};
use spykee::robot::{BehaviourId, Event, Intent, MotionEnd, MotionId, Percent, Priority, Setpoint};
use spykee::safety::Limits;
use spykee::wire::{Command, Engage, Led, Login, Power, Report, Stream};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};

use crate::rig::{Rig, WAIT_LIMIT, moves};

const WHO: BehaviourId = BehaviourId(0);

/// A running pilot, and one behaviour that the test plays.
struct TestPilot {
    requests: mpsc::Sender<Request>,
    inbox: EventReceiver,
    status: watch::Receiver<Status>,
    shutdown: Shutdown,
    task: JoinHandle<()>,
}

fn connector(address: String) -> Connector {
    Box::new(move |words| {
        let target = address.parse().unwrap();
        Box::pin(async move {
            let login = Login::new("admin", "admin");
            link::connect(&target, &login, words, &link::Options::default()).await
        })
    })
}

impl TestPilot {
    /// Runs another future in the pilot's task, which may panic.
    async fn with(rig: &Rig, beside: impl Future<Output = ()> + Send + 'static) -> TestPilot {
        TestPilot::new(&rig.address, beside).await
    }

    /// The same, with any robot.
    async fn new(address: &str, beside: impl Future<Output = ()> + Send + 'static) -> TestPilot {
        let settings = Settings {
            limits: Limits::default(),
            simulated: true,
            seed: 1,
            link: link::Options::default(),
            waits: false,
            streams: Default::default(),
        };
        let (pilot, _, status) = Pilot::new(&settings);
        let (requests, received) = mpsc::channel(MAX_REQUESTS);
        let shutdown = Shutdown::default();
        let run = pilot.run(
            connector(address.to_owned()),
            settings,
            received,
            shutdown.clone(),
        );
        let task = tokio::spawn(async move {
            let (ended, ()) = tokio::join!(run, beside);
            ended.unwrap();
        });
        let (to_behaviour, inbox) = events();
        let join = Request::Join {
            by: WHO,
            name: "script".to_owned(),
            priority: Priority(0),
            role: Default::default(),
            events: to_behaviour,
        };
        requests.send(join).await.unwrap();
        TestPilot {
            requests,
            inbox,
            status,
            shutdown,
            task,
        }
    }

    async fn start(rig: &Rig) -> TestPilot {
        TestPilot::with(rig, async {}).await
    }

    async fn ask(&self, intent: Intent) {
        self.requests
            .send(Request::Intent(WHO, intent))
            .await
            .unwrap();
    }

    /// Requests that a stream be on.
    async fn want(&self, stream: Stream) {
        self.ask(Intent::Stream { stream, on: true }).await;
    }

    async fn drive(&self, percent: f64, duration: Option<Duration>) {
        let setpoint = Setpoint::from_percent(percent, percent).unwrap();
        self.ask(Intent::Move {
            motion: MotionId(1),
            setpoint,
            duration,
        })
        .await;
    }

    /// Waits for a matching event.
    async fn wait_for(&mut self, wanted: impl Fn(&Event) -> bool) -> Event {
        let received = async {
            loop {
                match self.inbox.next().await {
                    PilotMessage::Event(event) if wanted(&event) => return event,
                    PilotMessage::Event(_) => {}
                    other => panic!("{other:?}"),
                }
            }
        };
        timeout(WAIT_LIMIT, received).await.expect("no such event")
    }

    async fn connected(&mut self) {
        self.wait_for(|event| matches!(event, Event::Connected { .. }))
            .await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_pilot_that_is_dropped_stops_the_tracks() {
    let rig = Rig::quiet().await;
    let mut test_pilot = TestPilot::start(&rig).await;
    test_pilot.connected().await;
    test_pilot.drive(50.0, Some(WAIT_LIMIT)).await;
    let moving = rig.heard_motion(0).await;
    test_pilot.task.abort();
    rig.heard_stop(moving).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_panic_in_the_pilots_task_stops_the_tracks() {
    let rig = Rig::quiet().await;
    let sim = rig.sim.clone();
    let bomb = async move {
        sim.wait_heard(0, moves).await;
        panic!("an expected panic of this test");
    };
    let mut test_pilot = TestPilot::with(&rig, bomb).await;
    test_pilot.connected().await;
    test_pilot.drive(50.0, Some(WAIT_LIMIT)).await;
    let moving = rig.heard_motion(0).await;
    rig.heard_stop(moving).await;
    assert!(test_pilot.task.await.unwrap_err().is_panic());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_behaviour_without_a_sign_of_life_is_stopped_and_ended() {
    let rig = Rig::quiet().await;
    let mut test_pilot = TestPilot::start(&rig).await;
    test_pilot.connected().await;
    test_pilot.drive(50.0, None).await;
    let moving = rig.heard_motion(0).await;
    let held = rig.heard_stop(moving).await;
    let killed = async { while !matches!(test_pilot.inbox.next().await, PilotMessage::Kill(_)) {} };
    timeout(WAIT_LIMIT, killed)
        .await
        .expect("the host was not killed");
    let index = rig.heard_stop(held + 1).await + 1;
    test_pilot.drive(50.0, None).await;
    test_pilot
        .ask(Intent::Led {
            led: Led::Left,
            on: true,
        })
        .await;
    sleep(Duration::from_millis(300)).await;
    assert_eq!(
        rig.commands(index),
        [],
        "an ended behaviour is still obeyed"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn commands_are_sent_on_change_only() {
    let rig = Rig::quiet().await;
    let mut test_pilot = TestPilot::start(&rig).await;
    test_pilot.connected().await;
    let from = rig.heard_stop(0).await + 1;
    for _ in 0..3 {
        test_pilot
            .ask(Intent::Led {
                led: Led::Left,
                on: true,
            })
            .await;
        test_pilot
            .ask(Intent::Volume(Percent::new(30).unwrap()))
            .await;
        test_pilot.want(Stream::AudioIn).await;
    }
    rig.heard(from, |command| matches!(command, Command::Stream { .. }))
        .await;
    test_pilot
        .ask(Intent::Led {
            led: Led::Left,
            on: false,
        })
        .await;
    rig.heard(from, |c| {
        *c == Command::Led {
            led: Led::Left,
            on: false,
        }
    })
    .await;
    assert_eq!(
        rig.commands(from),
        [
            Command::Led {
                led: Led::Left,
                on: true
            },
            Command::Volume(30),
            Command::Stream {
                stream: Stream::AudioIn,
                on: true
            },
            Command::Led {
                led: Led::Left,
                on: false
            },
        ]
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn at_the_end_a_stop_is_written_and_streams_are_switched_off() {
    let rig = Rig::quiet().await;
    let mut test_pilot = TestPilot::start(&rig).await;
    test_pilot.connected().await;
    test_pilot.want(Stream::Video).await;
    test_pilot.drive(50.0, Some(WAIT_LIMIT)).await;
    let moving = rig.heard_motion(0).await;
    test_pilot.shutdown.stop_motion.cancel();
    let end = test_pilot
        .wait_for(|event| matches!(event, Event::MotionEnded { .. }))
        .await;
    assert_eq!(
        end,
        Event::MotionEnded {
            motion: MotionId(1),
            end: MotionEnd::Cancelled
        }
    );
    test_pilot.shutdown.close_link.cancel();
    timeout(WAIT_LIMIT, &mut test_pilot.task)
        .await
        .unwrap()
        .unwrap();
    let off = Command::Stream {
        stream: Stream::Video,
        on: false,
    };
    rig.heard(moving, |command| *command == off).await;
    rig.heard_stop(moving).await;
    timeout(WAIT_LIMIT, rig.sim.wait_state(|state| state.user.is_none()))
        .await
        .unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn streams_are_switched_on_again_after_a_reconnect() {
    let rig = Rig::quiet().await;
    let mut test_pilot = TestPilot::start(&rig).await;
    test_pilot.connected().await;
    test_pilot.want(Stream::Video).await;
    let on = |command: &Command| {
        *command
            == Command::Stream {
                stream: Stream::Video,
                on: true,
            }
    };
    let first = rig.heard(0, on).await;
    rig.sim.disconnect_all();
    test_pilot
        .wait_for(|event| matches!(event, Event::Disconnected { .. }))
        .await;
    test_pilot.connected().await;
    rig.heard(first + 1, on).await;
}

/// The next connection of a pilot, whose login is accepted.
async fn accepted(robot: &TcpListener) -> TcpStream {
    let (mut pilot, _) = robot.accept().await.unwrap();
    read(&mut pilot, &Command::Login(Login::new("admin", "admin"))).await;
    pilot
        .write_all(&crate::rig::accepted().to_bytes())
        .await
        .unwrap();
    pilot
}

/// Reads up to the end of this command.
async fn read(pilot: &mut TcpStream, command: &Command) {
    let wanted = command.to_bytes();
    let mut heard = Vec::new();
    while !heard.ends_with(&wanted) {
        heard.push(pilot.read_u8().await.unwrap());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_last_words_of_a_login_in_progress_follow_a_persons_stop() {
    let robot = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = robot.local_addr().unwrap().to_string();
    let mut test_pilot = TestPilot::new(&address, async {}).await;
    let told = async {
        let mut link = accepted(&robot).await;
        let percent = 10;
        let charging = false;
        let power = Report::Power(Power { percent, charging });
        link.write_all(&power.to_bytes()).await.unwrap();
        read(&mut link, &Command::Engine(Engage::Dock)).await;
        drop(link);
        let mut link = accepted(&robot).await;
        test_pilot
            .requests
            .send(Request::EmergencyStop(true))
            .await
            .unwrap();
        let emergency_stop = test_pilot
            .status
            .wait_for(|status| status.emergency_stop)
            .await;
        drop(emergency_stop.unwrap());
        link.shutdown().await.unwrap();
        let mut told = Vec::new();
        link.read_to_end(&mut told).await.unwrap();
        told
    };
    let told = timeout(WAIT_LIMIT, told).await.expect("waits");
    let end = Command::Engine(Engage::CancelDock).to_bytes();
    assert!(told.starts_with(&[Command::STOP.to_bytes(), end].concat()));
}
