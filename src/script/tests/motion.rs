use super::*;
use crate::robot::{DockEnd, DockOutcome, MotionId, Setpoint};

fn setpoint(left: f64, right: f64) -> Setpoint {
    Setpoint::from_percent(left, right).unwrap()
}

#[test]
fn move_sets_a_setpoint_that_lasts_until_its_task_ends() {
    let mut rig = Rig::new("robot.move(50, -50) task.wait(1)");
    assert_eq!(
        rig.take_intents(),
        [Intent::Move {
            motion: MotionId(1),
            setpoint: setpoint(50.0, -50.0),
            duration: None,
        }]
    );
    assert!(rig.script.has_motion());
    rig.pass(2.0);
    assert_eq!(
        rig.take_intents(),
        [Intent::Release {
            motion: MotionId(1)
        }]
    );
    assert!(!rig.script.has_motion());
}

#[test]
fn a_setpoint_to_stand_still_needs_signs_of_life_too() {
    let mut rig = Rig::new("robot.move(0, 0) task.wait(1)");
    assert!(rig.script.has_motion());
    rig.pass(2.0);
    assert!(!rig.script.has_motion());
}

#[test]
fn move_with_seconds_waits_for_the_answer() {
    let mut rig = Rig::new("print(robot.move(50, 50, 2)) print(robot.move(10, 10, 1))");
    let intents = rig.take_intents();
    assert!(
        matches!(intents[..], [Intent::Move { duration: Some(time), .. }] if time == Duration::from_secs(2))
    );
    rig.pass(5.0);
    assert!(rig.log.is_empty());
    rig.deliver(motion_ended(&intents[0], MotionEnd::Done));
    let intents = rig.take_intents();
    rig.deliver(motion_ended(&intents[0], MotionEnd::Safety));
    rig.pass(0.2);
    assert_eq!(rig.logged(Level::Info), ["true done", "false safety"]);
    assert_eq!(rig.take_intents(), []);
}

#[test]
fn an_unchanged_setpoint_is_sent_once() {
    let mut rig = Rig::new(
        "for _ = 1, 5 do robot.move(30, 30) task.wait(0.1) end
         robot.move(30, 31) task.wait(1) robot.move(30, 31) task.wait(9)",
    );
    rig.pass(1.0);
    let intents = rig.take_intents();
    assert_eq!(intents.len(), 2);
    // The setpoint was ended by the robot side, so the same setpoint is sent again.
    rig.deliver(motion_ended(&intents[1], MotionEnd::Preempted));
    assert!(!rig.script.has_motion());
    rig.pass(1.0);
    assert_eq!(rig.take_intents().len(), 1);
}

#[test]
fn a_setpoint_ends_with_its_task_unless_another_task_has_set_its_own() {
    let mut rig = Rig::new(
        "local a = task.spawn(function() robot.move(10, 10) task.wait(9) end)
         local b = task.spawn(function() task.wait(1) robot.move(20, 20) task.wait(9) end)
         task.wait(2) a:cancel() task.wait(1) b:cancel() task.wait(1)",
    );
    rig.pass(2.5);
    assert_eq!(rig.take_intents().len(), 2);
    rig.pass(2.0);
    assert_eq!(
        rig.take_intents(),
        [Intent::Release {
            motion: MotionId(2)
        }]
    );
}

#[test]
fn a_handlers_setpoint_outlives_the_single_run_and_ends_with_the_subscription() {
    let mut rig = Rig::new(
        "local s = robot.on('sound_finished', function() robot.move(10, 10) end)
         robot.once('docked', function() s:off() end)",
    );
    rig.deliver(Event::SoundFinished);
    rig.deliver(Event::SoundFinished);
    assert!(matches!(rig.take_intents()[..], [Intent::Move { .. }]));
    rig.deliver(Event::Docked);
    assert!(matches!(rig.take_intents()[..], [Intent::Release { .. }]));
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn cancelling_a_timed_move_releases_it() {
    let mut rig = Rig::new("print(task.timeout(1, function() robot.move(50, 50, 10) end))");
    rig.pass(2.0);
    assert_eq!(rig.texts(), ["false timeout"]);
    assert_eq!(
        rig.intents[1],
        Intent::Release {
            motion: MotionId(1)
        }
    );
}

/// Answers each motion at once for this many seconds; returns how many there were.
fn refuse_for(rig: &mut Rig, seconds: u32, ends: &[MotionEnd]) -> usize {
    let mut count = 0;
    for _ in 0..seconds * 100 {
        for intent in rig.take_intents() {
            if matches!(intent, Intent::Move { .. }) {
                rig.deliver(motion_ended(&intent, ends[count % ends.len()]));
                count += 1;
            }
        }
        rig.pass(0.01);
    }
    count
}

#[test]
fn a_refused_motion_takes_a_moment_and_its_reason_is_told_once() {
    use MotionEnd::{Docked, Done, Preempted, Safety};
    let mut rig = Rig::new("while true do robot.move(30, 30, 1) end");
    let refused = refuse_for(&mut rig, 5, &[Docked]);
    assert!((30..=51).contains(&refused), "{refused}");
    let docked = "the robot is on its station: robot.undock() first";
    assert_eq!(rig.logged(Level::Warn), [docked]);
    refuse_for(&mut rig, 1, &[Safety]);
    refuse_for(&mut rig, 2, &[Preempted, Done]);
    assert_eq!(rig.logged(Level::Warn).len(), 3);
    rig.deliver(Event::Undocked);
    refuse_for(&mut rig, 1, &[Preempted]);
    assert_eq!(rig.logged(Level::Warn).len(), 4, "{:?}", rig.log);
}

#[test]
fn a_handler_that_drives_without_a_time_is_told_too_and_goes_on() {
    let mut rig = Rig::new("robot.on('sound_finished', function() robot.move(10, 10) end)");
    for _ in 0..20 {
        rig.deliver(Event::SoundFinished);
        let intents = rig.take_intents();
        rig.deliver(motion_ended(&intents[0], MotionEnd::Docked));
    }
    assert_eq!(rig.logged(Level::Warn).len(), 1);
    // A handler that waits for its motion is called again after it.
    let mut rig =
        Rig::new("robot.on('sound_finished', function() print(robot.move(10, 10, 1)) end)");
    for _ in 0..3 {
        rig.deliver(Event::SoundFinished);
        let intents = rig.take_intents();
        rig.deliver(motion_ended(&intents[0], MotionEnd::Docked));
        rig.pass(0.2);
    }
    assert_eq!(rig.logged(Level::Info), ["false docked"; 3]);
}

#[test]
fn two_loops_that_drive_do_not_spin() {
    let mut rig = Rig::new(
        "local function go() while true do robot.move(30, 30, 1) end end
         task.spawn(go) task.spawn(go)",
    );
    let mut last = None;
    let mut count = 0;
    for _ in 0..100 {
        for intent in rig.take_intents() {
            if let Some(last) = last.replace(intent) {
                rig.deliver(motion_ended(&last, MotionEnd::Preempted));
            }
            count += 1;
        }
        rig.pass(0.01);
    }
    assert!((2..=22).contains(&count), "{count}");
    assert_eq!(rig.logged(Level::Warn).len(), 1, "{:?}", rig.log);
}

#[test]
fn a_refused_motion_can_be_cancelled_before_its_call_returns() {
    let mut rig = Rig::new("print(task.timeout(0.05, function() robot.move(10, 10, 1) end))");
    let intents = rig.take_intents();
    rig.deliver(motion_ended(&intents[0], MotionEnd::Docked));
    rig.pass(0.06);
    assert_eq!(rig.logged(Level::Info), ["false timeout"]);
    rig.assert_ended(EndReason::Done, "");
}

#[test]
fn drive_forward_and_turn_go_through_the_calibration() {
    let mut rig = Rig::with(
        "robot.drive(0.25, 0) robot.drive(0.25, 0.5)
         print(robot.forward(1, 0.25)) print(robot.forward(-1, 5)) print(robot.turn(math.pi, 1)) print(robot.turn(0))",
        |options| {
            options.calibration.track_width = 0.2;
            options.calibration.full_speed = 0.5;
        },
    );
    let mut moves = Vec::new();
    for _ in 0..3 {
        let intents = rig.take_intents();
        rig.deliver(motion_ended(intents.last().unwrap(), MotionEnd::Done));
        // Until the tracks stand.
        rig.pass(0.5);
        for intent in intents {
            if let Intent::Move {
                setpoint, duration, ..
            } = intent
            {
                let seconds = duration.map_or(0.0, |time| time.as_secs_f64());
                moves.push((
                    setpoint.left.get(),
                    setpoint.right.get(),
                    (seconds * 1e3).round(),
                ));
            }
        }
    }
    assert_eq!(
        moves,
        [
            (45, 45, 0.0),
            (36, 54, 0.0),
            (45, 45, 4000.0),
            (-90, -90, 2000.0),
            (-18, 18, 3142.0),
        ]
    );
    assert_eq!(rig.texts(), ["true done"; 4]);
}

#[test]
fn stop_always_works() {
    let mut rig = Rig::new("robot.move(10, 10) robot.stop() task.wait(1) robot.move(10, 10)");
    assert_eq!(rig.take_intents()[1], Intent::Stop);
    assert!(!rig.script.has_motion());
    rig.pass(1.5);
    assert!(matches!(
        rig.take_intents()[..],
        [Intent::Move { .. }, Intent::Release { .. }]
    ));
}

#[test]
fn wrong_numbers_are_refused_with_a_message() {
    for (call, words) in cases(
        "robot.move(140, 0) => robot.move: left must be between -100 and 100, got 140
         robot.move(0, -100.5) => robot.move: right must be between -100 and 100, got -100.5
         robot.move(0/0, 0) => robot.move: left must be a number, got NaN
         robot.move(10) => robot.move: right is missing; it must be a number
         robot.move('fast', 0) => robot.move: left must be a number, got 'fast'
         robot:move(10, 10) => call it with a dot: robot.move, not robot:move
         robot.move(10, 10, -1) => seconds must be above 0 and at most 3600, got -1
         robot.move(10, 10, 0) => seconds must be above 0
         robot.drive(math.huge, 0) => linear must be between -1000 and 1000, got inf
         robot.forward(1, 0) => speed must be above 0
         robot.forward(1e5) => that would take
         robot.turn() => robot.turn: angle is missing
         robot.dock{timeout = 0} => timeout must be between 1 and 3600, got 0
         robot.dock{retries = 1.5} => retries must be a whole number
         robot.dock{retrys = 1} => unknown option 'retrys'; did you mean 'retries'?
         robot.dock(5) => the options must be a table, got 5",
    ) {
        let text = failure(call);
        assert!(text.starts_with("test.lua:1: "), "{text}");
        assert!(text.contains(words), "{text:?} lacks {words:?}");
    }
}

#[test]
fn dock_waits_for_its_answer_and_returns_it() {
    let mut rig = Rig::new(
        "local ok, code, info = robot.dock{timeout = 60, retries = 1}
         print(ok, code, info.attempts, info.seconds)
         print(robot.dock()) print(robot.undock()) print(robot.undock{timeout = 5})",
    );
    let ends = [
        (DockEnd::Done, 2),
        (DockEnd::BaseNotFound, 3),
        (DockEnd::Done, 0),
        (DockEnd::Timeout, 0),
    ];
    for (end, attempts) in ends {
        let intents = rig.take_intents();
        let answer = match intents[..] {
            [Intent::Dock { call, .. }] => Event::DockEnded {
                call,
                outcome: DockOutcome {
                    end,
                    attempts,
                    took: Duration::from_millis(1500),
                },
            },
            [Intent::Undock { call, .. }] => Event::UndockEnded { call, end },
            _ => panic!("{intents:?}"),
        };
        rig.deliver(answer);
        rig.pass(0.2);
    }
    assert_eq!(rig.texts()[0], "true done 2 1.5");
    let failed = &rig.texts()[1];
    let (ended, about) = failed.split_once(" {").unwrap();
    assert_eq!(ended, "false base_not_found");
    assert!(
        about.contains("attempts=3") && about.contains("seconds=1.5"),
        "{about}"
    );
    assert_eq!(rig.texts()[2..], ["true done", "false timeout"]);
}

#[test]
fn a_timed_out_docking_is_cancelled() {
    let mut rig = Rig::new("task.timeout(10, robot.dock) robot.cancel_dock()");
    assert!(matches!(rig.take_intents()[..], [Intent::Dock { plan, .. }] if plan.retries == 2));
    rig.pass(11.0);
    assert_eq!(rig.take_intents(), [Intent::CancelDock, Intent::CancelDock]);
}

#[test]
fn the_end_of_the_script_cancels_a_docking() {
    let mut rig = Rig::new("robot.dock()");
    rig.script.stop(EndReason::Shutdown, rig.now);
    rig.collect();
    assert_eq!(rig.intents[1..], [Intent::CancelDock]);
    rig.assert_ended(EndReason::Shutdown, "");
}

#[test]
fn commands_without_a_wait_are_bounded_but_stop_is_always_sent() {
    let rig = Rig::new("for i = 1, 10000 do robot.move(i % 100, 0) end");
    rig.assert_ended(EndReason::Error, "too many commands at once");
    assert!(rig.intents.len() < 300);
    let rig = Rig::new(
        "for i = 1, 1000 do pcall(robot.move, i % 100, 0) end for i = 1, 1000 do robot.stop() end",
    );
    assert_eq!(rig.intents.last(), Some(&Intent::Stop));
    assert!(rig.intents.len() < 300);
}
