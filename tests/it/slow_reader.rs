//! When the robot receives commands while scripts send as much as they can. In virtual time.

use std::time::Duration;

use spykee::pilot::LinkState;
use spykee::sim::{self, Direction, Fault, FaultKind, ReceivedCommand};
use spykee::simulation::{self, Recorder, Simulation};
use spykee::wire::{Command, Engage, Power, Report};
use tokio::time::sleep;

use crate::fast::{behaviour, quiet_world};

const SECOND: Duration = Duration::from_secs(1);

/// Speaks while it drives, one second in each call, with a pause between two calls: 1 s is real
/// time; with less, it sends as much as it is allowed to.
fn talks(pause: f64) -> String {
    format!(
        "robot.stream('audio_out', true)
        local second = buffer.create(32000)
        robot.move(20, -20)
        while true do
            robot.say(second)
            task.wait({pause})
        end"
    )
}

/// Changes its mind as fast as possible.
const CHANGES_ITS_MIND: &str = "
while true do
    task.race(function() robot.dock() end, function() task.wait(0) end)
end
";

/// A robot whose network may have faults.
fn with_faults() -> simulation::Options {
    let sim = sim::Options {
        faults: Some(vec![]),
        ..sim::Options::default()
    };
    simulation::Options {
        sim,
        events: Some(Recorder::keeping().0),
        ..simulation::Options::default()
    }
}

/// A robot that accepts this many bytes per second.
fn slow(rate: u32) -> Fault {
    Fault {
        towards: Direction::Robot,
        ..Fault::new(FaultKind::Drip { rate })
    }
}

fn low() -> Report {
    Report::Power(Power {
        percent: 10,
        charging: false,
    })
}

/// All commands received, after scripts have spoken for `talk`, and the time at which the battery
/// then became low.
fn heard_of(
    scripts: &[String],
    rate: Option<u32>,
    talk: Duration,
) -> (Vec<ReceivedCommand>, Duration) {
    simulation::run(
        quiet_world(),
        with_faults(),
        async |simulation: &Simulation| {
            if let Some(rate) = rate {
                simulation.sim().begin(slow(rate));
            }
            let behaviours = scripts.iter().enumerate();
            let behaviours = behaviours
                .map(|(number, source)| behaviour(&format!("talks{number}"), source, 0, 1))
                .collect();
            let run = simulation.start(behaviours, None);
            sleep(talk).await;
            let low_at = simulation.now();
            simulation.sim().inject(low());
            sleep(SECOND).await;
            drop(run);
            (simulation.sim().heard(), low_at)
        },
    )
    .unwrap()
}

/// The delay of a command, in seconds.
fn lateness((heard, since): &(Vec<ReceivedCommand>, Duration), command: &Command) -> f64 {
    let found = heard
        .iter()
        .find(|heard| heard.at >= *since && heard.command == *command);
    let found = found.unwrap_or_else(|| panic!("{command:?} was not received within a second"));
    (found.at - *since).as_secs_f64()
}

#[test]
fn a_robot_that_reads_at_the_rate_of_speech_receives_stop_and_search_in_time() {
    let (talks, shouts) = (talks(1.0), talks(0.05));
    for (scripts, seconds) in [
        (vec![talks], 30),
        (vec![shouts.clone()], 3),
        (vec![shouts.clone(), shouts], 120),
    ] {
        let heard = heard_of(&scripts, Some(32_000), SECOND * seconds);
        for command in [Command::STOP, Command::Engine(Engage::Dock)] {
            let late = lateness(&heard, &command);
            assert!(late < 0.5, "{command:?} arrived {late} s late");
        }
    }
}

/// Plays what it has received as soon as a fifth of a second is there, and counts how often the
/// buffer ran empty while more was to come.
fn gaps(heard: &[ReceivedCommand]) -> usize {
    const FIRST: f64 = 0.2;
    let mut gaps = 0;
    let mut buffered = 0.0;
    let mut playing = false;
    let mut at = 0.0;
    for heard in heard {
        let Command::Audio(samples) = &heard.command else {
            continue;
        };
        let now = heard.at.as_secs_f64();
        if playing {
            buffered -= now - at;
        }
        if playing && buffered < -1e-9 {
            (gaps, playing, buffered) = (gaps + 1, false, 0.0);
        }
        buffered += samples.len() as f64 / 32_000.0;
        playing |= buffered >= FIRST;
        at = now;
    }
    gaps
}

#[test]
fn speech_plays_without_a_gap() {
    for rate in [None, Some(64_000)] {
        let (heard, _) = heard_of(&[talks(1.0)], rate, SECOND * 30);
        let spoken: usize = heard
            .iter()
            .map(|heard| match &heard.command {
                Command::Audio(samples) => samples.len(),
                _ => 0,
            })
            .sum();
        assert!(spoken > 29 * 32_000, "{spoken}");
        assert_eq!(gaps(&heard), 0, "at {rate:?} bytes a second");
    }
}

#[test]
fn a_script_that_requests_dockings_endlessly_does_not_flood_the_link() {
    let heard = simulation::run(
        quiet_world(),
        with_faults(),
        async |simulation: &Simulation| {
            let run = simulation.start(vec![behaviour("dithers", CHANGES_ITS_MIND, 0, 1)], None);
            sleep(SECOND * 10).await;
            drop(run);
            simulation.sim().heard()
        },
    )
    .unwrap();
    let engine = |heard: &&ReceivedCommand| matches!(heard.command, Command::Engine(_));
    assert!(heard.iter().filter(engine).count() > 50, "it was not asked");
    assert!(
        heard.len() < 100 * 11 + 20,
        "{} commands in 10 s",
        heard.len()
    );
}

#[test]
fn a_robot_that_acknowledges_but_sends_nothing_is_reconnected() {
    simulation::run(
        quiet_world(),
        with_faults(),
        async |simulation: &Simulation| {
            let run = simulation.start(vec![behaviour("idles", "task.wait(10000)", 0, 1)], None);
            sleep(SECOND * 60).await;
            let mut status = run.status();
            assert_eq!(status.borrow().link, LinkState::Up);
            simulation.sim().mute(true);
            let lost = status.wait_for(|status| status.link != LinkState::Up);
            let lost = tokio::time::timeout(SECOND * 100, lost).await.is_ok();
            assert!(lost, "the silent robot is not detected");
            simulation.sim().mute(false);
            let up = status.wait_for(|status| status.link == LinkState::Up);
            let up = tokio::time::timeout(SECOND * 100, up).await.is_ok();
            assert!(up, "not connected again");
        },
    )
    .unwrap();
}
