//! A robot that a person or the service sends to its station, in virtual time: it comes home, also from
//! where it does not find its station, and stays there.

use std::time::Duration;

use spykee::agent::{Agent, AgentError, AgentEvent, Behaviour, Bus, BusMessage, Outcome, Plan};
use spykee::clock::{Clock, Zone};
use spykee::control::{self, EmergencyStop, RunRequest};
use spykee::robot::DockEnd;
use spykee::safety::{Limits, Rescue};
use spykee::service::{ManagerNotifier, RecordFile, Service, ServicePlan};
use spykee::sim::World;
use spykee::simulation::{self, Simulation};
use spykee::timetable::Timetable;
use spykee::wire::{Command, Engage};
use spykee::{config, timetable};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};

use crate::fast::behaviour;
use crate::long_runs::in_parallel;
use crate::long_runs::rescue::{Battery, Name, Place, Start};
use crate::rig::{moves, near_home, sized};

/// Leaves its station whenever it can, and drives a little.
const PATROL: &str =
    "while true do robot.undock() robot.forward(0.2) robot.forward(-0.2) task.wait(1) end";

/// Time limit for the way home of a robot in the next room.
const LIMIT: Duration = Duration::from_secs(20 * 60);

/// A run with these behaviours, to which a person gives orders.
fn run(
    simulation: &Simulation,
    behaviours: Vec<Behaviour>,
) -> (control::Run, JoinHandle<Result<Outcome, AgentError>>) {
    let plan = Plan {
        stays: true,
        ..simulation.plan(behaviours)
    };
    let (agent, status) = Agent::new(plan);
    let run = control::Run {
        simulated: true,
        ..control::Run::new(&agent, "test", EmergencyStop::default(), status)
    };
    let agent = tokio::task::spawn_local(agent.run(simulation.stop()));
    (run, agent)
}

fn leaves(command: &Command) -> bool {
    moves(command) || *command == Command::Engine(Engage::Undock)
}

#[test]
fn what_drives_ends_and_the_robot_is_still_on_its_station_ten_minutes_later() {
    let world = World::from_yaml(&near_home(), "test world").unwrap();
    let bus = Bus::default();
    let options = simulation::Options {
        bus: bus.clone(),
        ..simulation::Options::default()
    };
    let mut listener = bus.subscribe();
    simulation::run(world, options, async |simulation: &Simulation| {
        let (run, agent) = run(simulation, vec![behaviour("patrol", PATROL, 0, 1)]);
        let drives = simulation.sim().wait_state(|state| state.moving());
        timeout(Duration::from_secs(60), drives).await.unwrap();
        let answer = run.perform(dock_order(), "anna");
        let answer = timeout(LIMIT, answer).await.unwrap();
        assert_eq!(answer.dock_end(), Some(DockEnd::Done));
        let from = simulation.sim().heard_count();
        sleep(Duration::from_secs(600)).await;
        assert!(simulation.sim().state().docked);
        let heard = simulation.sim().heard_since(from);
        assert!(!heard.iter().any(|heard| leaves(&heard.command)));
        simulation.stop().cancel();
        agent.await.unwrap().unwrap();
    })
    .unwrap();
    let heard = std::iter::from_fn(|| listener.try_next()).take(1000);
    let ended = heard.filter_map(|message| match message {
        BusMessage::Event(event) => match &event.what {
            AgentEvent::Ended { by, .. } => Some(by.clone()),
            _ => None,
        },
        _ => None,
    });
    let by = Some("docking, ordered by anna".to_owned());
    assert_eq!(ended.collect::<Vec<_>>(), [by]);
}

/// Ctrl-C at `robot dock` at any moment: as soon as the robot has heard the order, what drives has ended.
#[test]
fn an_order_to_dock_that_is_dropped_at_once_has_ended_what_drives() {
    let mut heard = 0;
    for steps in 0..40 {
        let world = World::from_yaml(&near_home(), "test world").unwrap();
        let options = simulation::Options::default();
        simulation::run(world, options, async |simulation: &Simulation| {
            let (run, agent) = run(simulation, vec![behaviour("patrol", PATROL, 0, 1)]);
            let drives = simulation.sim().wait_state(|state| state.moving());
            timeout(Duration::from_secs(60), drives).await.unwrap();
            let from = simulation.sim().heard_count();
            let order = run.perform(dock_order(), "anna");
            tokio::select! {
                biased;
                _ = order => panic!("it is at home at once"),
                () = async {
                    for _ in 0..steps {
                        tokio::task::yield_now().await;
                    }
                } => {}
            }
            sleep(Duration::from_secs(3)).await;
            let searches = |one: &Command| *one == Command::Engine(Engage::Dock);
            let since = simulation.sim().heard_since(from);
            if since.iter().any(|heard| searches(&heard.command)) {
                heard += 1;
                let from = simulation.sim().heard_count();
                sleep(Duration::from_secs(60)).await;
                let heard = simulation.sim().heard_since(from);
                let drives = heard.iter().any(|heard| leaves(&heard.command));
                assert!(!drives, "after {steps} steps it drives on");
            }
            simulation.stop().cancel();
            agent.await.unwrap().unwrap();
        })
        .unwrap();
    }
    assert!(heard > 0, "the order never came to the robot");
}

fn dock_order() -> RunRequest {
    RunRequest::Dock {
        seconds: None,
        retries: None,
    }
}

#[derive(Debug, Clone, Copy)]
enum By {
    Person,
    /// As before there was a rescue: two retries from the same spot.
    PersonWithoutRescue,
    Idle,
    IdleWithoutRescue,
    Script,
}

/// Whether a robot in the next room, with a battery that lasts, comes home in time.
fn comes_home(place: &Place, start: &Start, by: By) -> bool {
    let mut world = place.world.clone();
    world.battery.idle_drain_per_minute = 0.01;
    world.battery.driving_drain_per_minute = 0.01;
    // Five pictures a second are enough for the rescue behaviour to find its way.
    world.camera.fps = sized(5.0, world.camera.fps);
    let rescue = match by {
        By::PersonWithoutRescue | By::IdleWithoutRescue => Rescue::Off,
        By::Person | By::Idle | By::Script => Rescue::Builtin,
    };
    let options = simulation::Options {
        seed: start.seed,
        limits: Limits {
            rescue,
            ..Limits::default()
        },
        ..simulation::Options::default()
    };
    simulation::run(world, options, async |simulation: &Simulation| {
        simulation.sim().place(start.pose);
        simulation.sim().set_battery(80.0);
        match by {
            By::Person => person(simulation, None).await,
            By::PersonWithoutRescue => person(simulation, Some(2)).await,
            By::Idle | By::IdleWithoutRescue => idle(simulation).await,
            By::Script => script(simulation, start.seed).await,
        }
    })
    .unwrap()
}

async fn person(simulation: &Simulation, retries: Option<u32>) -> bool {
    let (run, agent) = run(simulation, Vec::new());
    let mut status = run.status.clone();
    let up = status.wait_for(|status| status.link == spykee::pilot::LinkState::Up);
    timeout(LIMIT, up).await.unwrap().unwrap();
    let seconds = None;
    let order = run.perform(RunRequest::Dock { seconds, retries }, "anna");
    let answer = timeout(LIMIT, order).await;
    simulation.stop().cancel();
    agent.await.unwrap().unwrap();
    answer.is_ok_and(|answer| answer.dock_end() == Some(DockEnd::Done))
}

async fn script(simulation: &Simulation, seed: u64) -> bool {
    let source = "print(robot.dock({ retries = 8 }))";
    let run = simulation.start(vec![behaviour("dock", source, 0, seed)], Some(LIMIT));
    run.outcome().await.unwrap();
    simulation.sim().state().docked
}

async fn idle(simulation: &Simulation) -> bool {
    let plan = Plan {
        stays: true,
        ..simulation.plan(Vec::new())
    };
    let bus = plan.pilot.bus.clone();
    let (agent, status) = Agent::new(plan);
    let service = Service {
        agent,
        status,
        clock: Clock::default(),
        service_plan: ServicePlan {
            specs: Vec::new(),
            fingerprints: Default::default(),
            always: Vec::new(),
            table: Timetable {
                rules: Vec::new(),
                zone: Zone::utc(),
                quiet: None,
                catch_up: "10m".parse().unwrap(),
            },
            quiet_alarm: true,
            idle: config::Service::default(),
        },
        record: RecordFile::default(),
        notifier: ManagerNotifier::default(),
        bus,
        view: timetable::View::channel().0,
        reloads: mpsc::channel(1).1,
        changes: mpsc::channel(1).1,
    };
    let service = tokio::task::spawn_local(service.run(simulation.stop()));
    let home = simulation.sim().wait_state(|state| state.charging);
    let home = timeout(LIMIT, home).await.is_ok();
    simulation.stop().cancel();
    service.await.unwrap().unwrap();
    home
}

/// Counts come from `NIGHTLY=1 cargo test --test it -- sent_home --nocapture`; on push it shows only
/// that the rescue works at all.
#[test]
fn a_robot_in_the_next_room_comes_home_whoever_orders_it() {
    let place = Place::new(Name::LivingRoom, 1, "exact", Battery::HalfHour);
    let starts = place.starts(sized(2, 20), 7);
    let orders = [By::Person, By::Idle, By::Script];
    let before = [By::PersonWithoutRescue, By::IdleWithoutRescue];
    for by in orders.into_iter().chain(sized(&[][..], &before).to_vec()) {
        let home = in_parallel(&starts, 2, |start| comes_home(&place, start, by));
        let home = home.into_iter().filter(|home| *home).count();
        println!("{by:?}: {home} of {} come home", starts.len());
        let is_rescued = orders.iter().any(|one| *one as u8 == by as u8);
        assert!(
            !is_rescued || home >= starts.len() * 3 / 4,
            "{by:?}: {home}"
        );
    }
}
