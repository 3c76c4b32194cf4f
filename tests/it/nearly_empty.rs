//! The last of the battery is reserved for the way home. In virtual time.

use std::time::Duration;

use spykee::safety::{Limits, PowerMeaning, Rescue};
use spykee::sim::{self, PowerReading, State, World};
use spykee::simulation::{self, Simulation};
use spykee::wire::{Command, Engage, Led, Stream};
use tokio::time::{sleep, timeout};

use crate::fast::{behaviour, quiet_world};
use crate::rig::moves;

const SECOND: Duration = Duration::from_secs(1);

/// A script that uses all devices of the robot.
const USES_ALL: &str = "
for _, stream in { 'video', 'audio_in', 'audio_out' } do robot.stream(stream, true) end
while true do
    robot.led('all', true)
    robot.play('laser')
    robot.volume(math.random(1, 50))
    robot.say(buffer.create(32000))
    task.wait(0.5)
    robot.led('all', false)
    task.wait(0.5)
end
";

fn options(rescue: Rescue) -> simulation::Options {
    let limits = Limits {
        rescue,
        ..Limits::default()
    };
    simulation::Options {
        limits,
        sim: sim::Options {
            fps: Some(5.0),
            ..sim::Options::default()
        },
        ..simulation::Options::default()
    }
}

async fn becomes(simulation: &Simulation, what: &str, wanted: impl Fn(&State) -> bool) -> State {
    let state = timeout(SECOND * 300, simulation.sim().wait_state(wanted)).await;
    state.unwrap_or_else(|_| panic!("never {what}: {:?}", simulation.sim().state()))
}

/// Starts a busy run, then makes the battery nearly empty and the station unreachable.
async fn nearly_empty(simulation: &Simulation) -> simulation::Running {
    let run = simulation.start(vec![behaviour("uses all", USES_ALL, 0, 1)], None);
    becomes(simulation, "all on", |state| {
        state.streams.video && state.streams.audio_in && state.streams.audio_out
    })
    .await;
    simulation.sim().hide_station(true);
    simulation.sim().set_battery(5.0);
    run
}

/// Drives to and fro, with rests; and on the spot for good.
const TO_AND_FRO: &str =
    "while true do robot.move(40, 40, 1.5) task.wait(1) robot.move(-40, -40, 1.5) end";
const ON_THE_SPOT: &str = "robot.drive(0, 1) task.wait(1e6)";

/// The energy when a robot that drives is sent home, percent.
fn energy_when_sent_home(script: &str, meaning: PowerMeaning, world: World) -> f64 {
    let options = simulation::Options {
        limits: Limits {
            power: meaning,
            ..Limits::default()
        },
        ..simulation::Options::default()
    };
    simulation::run(world, options, async |simulation: &Simulation| {
        let _run = simulation.start(vec![behaviour("drives", script, 0, 1)], None);
        let home = |command: &Command| *command == Command::Engine(Engage::Dock);
        let sent = timeout(SECOND * 3600, simulation.sim().wait_heard(0, home)).await;
        assert!(sent.is_ok(), "never sent home: {script}");
        simulation.sim().state().battery
    })
    .unwrap()
}

#[test]
fn a_robot_that_reports_a_voltage_goes_home_with_as_much_energy_as_another() {
    let mut world = quiet_world();
    world.battery.level = 60.0;
    world.battery.idle_drain_per_minute = 3.0;
    world.battery.driving_drain_per_minute = 6.0;
    let energy = energy_when_sent_home(TO_AND_FRO, PowerMeaning::Auto, world.clone());
    assert!((29.0..=31.0).contains(&energy), "percent: {energy}");
    world.battery.power = PowerReading::Voltage;
    for (script, meaning) in [
        (TO_AND_FRO, PowerMeaning::Auto),
        (TO_AND_FRO, PowerMeaning::Voltage),
        (ON_THE_SPOT, PowerMeaning::Voltage),
    ] {
        let energy = energy_when_sent_home(script, meaning, world.clone());
        assert!((24.0..=40.0).contains(&energy), "{meaning:?}: {energy}");
    }
    let energy = energy_when_sent_home(TO_AND_FRO, PowerMeaning::Percent, world);
    assert!(energy < 10.0, "this battery shows the difference: {energy}");
}

/// Whether a command is neither a motion nor part of the watchdog's alarm.
fn is_luxury(command: &Command) -> bool {
    match command {
        Command::Led { led, .. } => *led != Led::Flash,
        Command::Audio(_) => true,
        Command::Stream { on, .. } => *on,
        _ => false,
    }
}

#[test]
fn a_nearly_empty_battery_switches_off_camera_lights_and_speech() {
    simulation::run(
        quiet_world(),
        options(Rescue::Off),
        async |simulation: &Simulation| {
            let _run = nearly_empty(simulation).await;
            let off = |state: &State| {
                !(state.streams.video || state.streams.audio_in || state.streams.audio_out)
            };
            becomes(simulation, "all off", off).await;
            let since = simulation.sim().heard_count();
            sleep(SECOND * 60).await;
            let heard = simulation.sim().heard_since(since);
            let luxury = heard.iter().find(|heard| is_luxury(&heard.command));
            assert_eq!(luxury, None);
            assert!(off(&simulation.sim().state()));
        },
    )
    .unwrap();
}

#[test]
fn with_a_nearly_empty_battery_only_the_rescue_behaviour_has_the_camera() {
    simulation::run(
        quiet_world(),
        options(Rescue::Builtin),
        async |simulation: &Simulation| {
            let _run = nearly_empty(simulation).await;
            becomes(simulation, "silent in both directions", |state| {
                !(state.streams.audio_in || state.streams.audio_out)
            })
            .await;
            let since = simulation.sim().heard_count();
            let driven = timeout(SECOND * 300, simulation.sim().wait_heard(since, moves)).await;
            assert!(driven.is_ok(), "the rescue behaviour does not drive");
            let state = simulation.sim().state();
            assert!(state.streams.video, "the rescue behaviour has no camera");
            sleep(SECOND * 60).await;
            let heard = simulation.sim().heard_since(since);
            let camera = Command::Stream {
                stream: Stream::Video,
                on: true,
            };
            let luxury = |command: &Command| is_luxury(command) && *command != camera;
            let luxury = heard.iter().find(|heard| luxury(&heard.command));
            assert_eq!(luxury, None);
        },
    )
    .unwrap();
}

#[test]
fn streams_and_lights_return_when_the_battery_is_good() {
    simulation::run(
        quiet_world(),
        options(Rescue::Off),
        async |simulation: &Simulation| {
            let _run = nearly_empty(simulation).await;
            becomes(simulation, "blind", |state| !state.streams.video).await;
            simulation.sim().set_battery(80.0);
            becomes(simulation, "all on", |state| {
                state.streams.video && state.streams.audio_in && state.streams.audio_out
            })
            .await;
            let since = simulation.sim().heard_count();
            let lights = |command: &Command| matches!(command, Command::Led { on: true, .. });
            let lit = timeout(SECOND * 5, simulation.sim().wait_heard(since, lights)).await;
            assert!(lit.is_ok(), "the lights do not return");
        },
    )
    .unwrap();
}
