//! Seeds of the fuzz targets that contain typed messages: they must match the current message
//! format.

use std::path::Path;
use std::time::Duration;

use spykee::robot::{Intent, MotionId, Setpoint};
use spykee::safety::{Act, Fact, Limits, Watchdog};
use spykee::script::FromHost;
use spykee::wire::{Command, EngineReport, Power};
use tokio::time::Instant;

/// An event between two messages, as `tests/fuzz/targets/messages.rs` decodes it from a byte.
enum StepEvent {
    NotFound,
    Percent(u8),
    /// This many milliseconds pass: a power of two.
    Passes(u32),
}

impl StepEvent {
    fn byte(&self) -> u8 {
        match self {
            StepEvent::NotFound => 8 << 3,
            StepEvent::Percent(percent) => (percent / 4) << 3 | 1,
            StepEvent::Passes(millis) => (millis.trailing_zeros() as u8) << 3 | 4,
        }
    }

    fn apply(&self, dog: &mut Watchdog, now: &mut Instant) -> Vec<Act> {
        match self {
            StepEvent::NotFound => dog.handle(Fact::Engine(EngineReport::BaseNotFound), *now),
            StepEvent::Percent(percent) => {
                let percent = *percent;
                let charging = false;
                dog.handle(Fact::Power(Power { percent, charging }), *now)
            }
            StepEvent::Passes(millis) => {
                *now += Duration::from_millis((*millis).into());
                dog.poll(*now)
            }
        }
    }
}

/// A script that wants to drive, on a robot whose battery becomes low and whose searches fail; the
/// watchdog moves it between them.
fn leg_of_a_low_robot() -> Vec<(FromHost, StepEvent)> {
    use StepEvent::{NotFound, Passes, Percent};
    let happens = [
        Percent(20),
        Passes(1024),
        NotFound,
        Passes(1024),
        Passes(1024),
        Passes(1024),
        NotFound,
        Passes(512),
        Passes(4096),
    ];
    let intent = Intent::Move {
        motion: MotionId(1),
        setpoint: Setpoint::from_percent(100.0, 100.0).unwrap(),
        duration: Some(Duration::from_secs(60)),
    };
    let drives = FromHost::Intent(intent);
    let alive = std::iter::repeat_with(|| FromHost::Alive);
    std::iter::once(drives).chain(alive).zip(happens).collect()
}

#[test]
fn the_seed_of_a_low_robots_leg_is_in_the_current_message_format() {
    let seed =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/seeds/messages/leg-of-a-low-robot");
    let mut bytes = Vec::new();
    for (message, happens) in leg_of_a_low_robot() {
        bytes.extend(postcard::to_allocvec(&message).unwrap());
        bytes.push(happens.byte());
    }
    if std::env::var_os("RENEW_SEEDS").is_some() {
        std::fs::write(&seed, &bytes).unwrap();
    }
    let stale = "RENEW_SEEDS=1 cargo test seeds writes it again";
    assert!(std::fs::read(&seed).unwrap() == bytes, "{stale}");
}

#[test]
fn in_the_seed_of_a_low_robots_leg_the_watchdog_drives_one() {
    let mut now = Instant::now();
    let mut dog = Watchdog::new(Limits::default(), now);
    let percent = 80;
    let charging = false;
    let power = Power { percent, charging };
    let docked = false;
    dog.handle(Fact::LinkUp { docked, power }, now);
    let mut commands = Vec::new();
    for (_, happens) in leg_of_a_low_robot() {
        let acts = happens.apply(&mut dog, &mut now);
        commands.extend(acts.iter().filter_map(Act::command));
    }
    let drives = |command: &Command| matches!(command, Command::Move { left, right } if (*left, *right) != (0, 0));
    assert!(commands.iter().any(drives), "{commands:?}");
}
