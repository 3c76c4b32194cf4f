//! The events that an agent publishes on its bus.

use std::time::Duration;

use spykee::agent::{AgentEvent, Bus, BusMessage, Listener};
use spykee::robot::{DockEnd, EndReason, WatchdogState};
use spykee::script;
use spykee::simulation::{self, Simulation};

use crate::long_runs::behaviour;
use crate::rig::exact;

/// All events that have arrived so far.
fn all(listener: &mut Listener) -> Vec<AgentEvent> {
    std::iter::from_fn(|| match listener.try_next()? {
        BusMessage::Event(one) => Some(one.what.clone()),
        BusMessage::Missed(missed) => panic!("{missed} missed"),
    })
    .collect()
}

fn play(source: &str, work: impl AsyncFnOnce(&Simulation) + Send) -> Vec<AgentEvent> {
    let bus = Bus::default();
    let mut listener = bus.subscribe();
    let options = simulation::Options {
        bus,
        ..simulation::Options::default()
    };
    let one = script::Options::new("one", "one.lua");
    let behaviours = vec![behaviour(source, one)];
    simulation::run(
        exact("living_room"),
        options,
        async |simulation: &Simulation| {
            let run = simulation.start(behaviours, Some(Duration::from_secs(600)));
            work(simulation).await;
            run.outcome().await.unwrap();
        },
    )
    .unwrap();
    all(&mut listener)
}

fn at(said: &[AgentEvent], is: impl Fn(&AgentEvent) -> bool) -> usize {
    let found = said.iter().position(is);
    found.unwrap_or_else(|| panic!("no such event: {said:#?}"))
}

#[test]
fn the_events_of_a_run_arrive_in_order_with_endings_and_places() {
    let source = "journal.add('moved', {energy = 2})\nnotify.send('hello')\nerror('no')";
    let said = play(source, async |_| {});
    let up = at(
        &said,
        |one| matches!(one, AgentEvent::LinkUp { robot, .. } if robot.simulated),
    );
    let battery = at(&said, |one| matches!(one, AgentEvent::Battery(_)));
    let started = at(
        &said,
        |one| matches!(one, AgentEvent::Started { behaviour, .. } if behaviour == "one"),
    );
    let entry = at(
        &said,
        |one| matches!(one, AgentEvent::Entry { kind, data, .. } if kind == "moved" && data["energy"] == 2.0),
    );
    let notice = at(
        &said,
        |one| matches!(one, AgentEvent::Notify { text, .. } if text == "hello"),
    );
    let ended = at(&said, |one| match one {
        AgentEvent::Ended {
            reason, message, ..
        } => {
            let message = message.as_deref().unwrap_or_default();
            *reason == EndReason::Error && message.contains("one.lua:3")
        }
        _ => false,
    });
    let order = [up, battery, started, entry, notice, ended];
    assert!(order.is_sorted(), "{order:?}");
}

#[test]
fn a_low_battery_and_the_way_home_are_reported() {
    let said = play("while true do task.wait(1) end", async |simulation| {
        tokio::time::sleep(Duration::from_secs(5)).await;
        simulation.sim().set_battery(10.0);
        let home = simulation
            .sim()
            .wait_state(|state| state.docked && state.charging);
        tokio::time::timeout(Duration::from_secs(400), home)
            .await
            .unwrap();
        tokio::time::sleep(Duration::from_secs(30)).await;
    });
    let low = at(&said, |one| {
        let AgentEvent::Watchdog { state, low, .. } = one else {
            return false;
        };
        *low && *state == WatchdogState::LowGoingHome
    });
    let docked = at(&said, |one| {
        let AgentEvent::Dock {
            by,
            end,
            attempts,
            seconds,
        } = one
        else {
            return false;
        };
        by.is_none() && *end == DockEnd::Done && *attempts == 1 && *seconds > 1.0
    });
    let on_station = at(&said, |one| {
        matches!(one, AgentEvent::Watchdog { docked: true, .. })
    });
    assert!(
        low < on_station && on_station <= docked + 1,
        "{low} {on_station} {docked}"
    );
    let levels = said
        .iter()
        .filter(|one| matches!(one, AgentEvent::Battery(_)));
    assert!(levels.count() >= 2);
}
