//! Arbitrary text as a world: a robot can drive and see in it, or the error names a place in the
//! text.
#![no_main]

use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use spykee::sim::{DocumentError, Firmware, Robot, World};
use spykee::vision::validate_markers;
use spykee::wire::{Command, Engage, Report, Stream};

/// Number of physics steps: one second.
const STEPS: u32 = 50;

fuzz_target!(|text: &str| {
    match World::from_yaml(text, "fuzz.yaml") {
        Ok(world) => live_in(world),
        Err(DocumentError::Invalid {
            line,
            column,
            message,
            ..
        }) => {
            assert!(line >= 1 && column >= 1 && !message.is_empty());
            let breaks = ['\n', '\r', '\u{85}', '\u{2028}', '\u{2029}']; // all line breaks of YAML
            let lines = text.matches(breaks).count() + 1;
            assert!(line <= lines + 1, "line {line} of {text:?}");
        }
        Err(other) => panic!("{other}"),
    }
});

fn live_in(world: World) {
    let mut robot = Robot::new(world, Firmware::default(), 1);
    robot.begin_session();
    robot.execute(&Command::Stream {
        stream: Stream::Video,
        on: true,
    });
    for step in 0..STEPS {
        match step {
            0 => robot.execute(&Command::Engine(Engage::Undock)),
            10 => robot.execute(&Command::Move {
                left: 90,
                right: 60,
            }),
            30 => robot.execute(&Command::Engine(Engage::Dock)),
            _ => {}
        }
        robot.step(Duration::from_millis(20));
        check(robot.take_reports());
    }
    let pose = robot.state().pose;
    assert!(pose.x.is_finite() && pose.y.is_finite() && pose.heading.is_finite());
}

fn check(reports: Vec<Report>) {
    for report in reports {
        match report {
            Report::Power(power) => assert!(power.percent <= 128),
            Report::Video(jpeg) => assert_eq!(validate_markers(&jpeg).err(), None),
            _ => {}
        }
    }
}
