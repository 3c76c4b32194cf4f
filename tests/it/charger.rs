//! A station that ends charging after some hours.

use std::time::Duration;

use spykee::script;
use spykee::sim::{self, Firmware, World};
use spykee::simulation::{self, Recorder, Simulation};

use crate::long_runs::behaviour;

/// The battery lasts 25 minutes at rest and charges in twice that time.
const WORLD: &str = "
room: { width: 3.0, depth: 2.5 }
station: { at: [0, 1.25], heading_degrees: 0 }
battery: { level: 60, idle_drain_per_minute: 4, driving_drain_per_minute: 6, charge_per_minute: 8 }
";

#[derive(Debug)]
struct Stay {
    lowest: f64,
    /// The longest time off the station.
    away: Duration,
    /// How often the watchdog did each.
    again: usize,
    alarms: usize,
}

/// Stands on a station for an hour that ends charging after 12 minutes, or does not charge at all.
fn stays(seed: u64, charges: bool) -> Stay {
    let (recorder, events) = Recorder::keeping();
    let options = simulation::Options {
        seed,
        events: Some(recorder),
        sim: sim::Options {
            firmware: Firmware {
                charger_hours: Some(0.2),
                ..Firmware::default()
            },
            ..sim::Options::default()
        },
        ..simulation::Options::default()
    };
    let world = World::from_yaml(WORLD, "charger").unwrap();
    let idle = behaviour("task.wait(1e6)", script::Options::new("idle", "idle.lua"));
    let stay = simulation::run(world, options, async |simulation: &Simulation| {
        let run = simulation.start(vec![idle], None);
        let sim = simulation.sim();
        sim.set_charging_broken(!charges);
        if !charges {
            sim.set_battery(80.0);
        }
        let step = Duration::from_secs(1);
        let mut stay = Stay {
            lowest: 100.0,
            away: Duration::ZERO,
            again: 0,
            alarms: 0,
        };
        let mut away = Duration::ZERO;
        for _ in 0..if charges { 3600 } else { 480 } {
            tokio::time::sleep(step).await;
            let state = sim.state();
            stay.lowest = stay.lowest.min(state.battery);
            away = if state.docked {
                Duration::ZERO
            } else {
                away + step
            };
            stay.away = stay.away.max(away);
        }
        run.stop();
        let _ = run.outcome().await;
        stay
    });
    let events = events.lock();
    let count = |text: &str| {
        events
            .iter()
            .filter(|event| event.text.contains(text))
            .count()
    };
    Stay {
        again: count("leaves it and docks again"),
        alarms: count("Play(Alarm)"),
        ..stay.unwrap()
    }
}

#[test]
fn a_robot_docks_again_when_its_station_has_ended_charging_and_is_never_low() {
    for seed in 1..=3 {
        let stay = stays(seed, true);
        assert!(stay.lowest > 50.0, "{seed}: {} %", stay.lowest);
        assert!((2..=5).contains(&stay.again), "{seed}: {}", stay.again);
        assert!(
            stay.away < Duration::from_secs(60),
            "{seed}: {:?}",
            stay.away
        );
        assert_eq!(stay.alarms, 0, "{seed}");
    }
}

#[test]
fn a_person_is_called_before_the_battery_is_low_if_docking_again_does_not_help() {
    let stay = stays(4, false);
    let is_called = stay.again >= 1 && stay.alarms >= 1 && stay.lowest > 30.0;
    assert!(is_called, "{stay:?}");
}
